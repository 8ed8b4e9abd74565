"""The table that a kind of device has of its own, inside [stage] or [force]."""

from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar, Self, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    Field,
    ModelWrapValidatorHandler,
    create_model,
    model_validator,
)

from rig.devices.catalogue import DEFAULTS, KindError, find, names
from rig.devices.kinds import Kind
from rig.transport.port_settings import Settings

T = TypeVar("T", bound=Settings)
D = TypeVar("D", bound="DeviceSettings")
M = TypeVar("M", bound=BaseModel)


def known(of: type[Kind]) -> BeforeValidator:
    """Checks `kind = "…"` against the catalogue."""

    def check(name: object) -> object:
        find(of, name if isinstance(name, str) else "")
        return name

    return BeforeValidator(check)


class DeviceSettings(Settings):
    """[stage] or [force]. A kind's own table is a part of it, checked like any other, for that kind only."""

    kinds: ClassVar[type[Kind]]
    kind: str

    @property
    def entry(self) -> Kind:
        """Its kind, in the catalogue."""
        return find(self.kinds, self.kind)

    def own(self, table: type[T]) -> T:
        """The kind's own table. Raises TypeError if it is another one."""
        found = getattr(self, self.entry.place, None)
        if not isinstance(found, table):
            raise TypeError(f"{self.entry.name} has no {table.__name__}")
        return found

    @model_validator(mode="wrap")
    @classmethod
    def _with_its_table(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        wanted = cls if not isinstance(data, Mapping) else of_kind(cls, data.get("kind"))
        if wanted is not cls:
            return wanted.model_validate(data)
        _refuse_table_of_another(cls, data)
        return handler(data)


def _refuse_table_of_another(settings: type[DeviceSettings], data: object) -> None:
    unknown = [key for key in data if key not in settings.model_fields] if isinstance(data, Mapping) else []
    for key in unknown:
        if key in names(settings.kinds.room):
            raise ValueError(f"{key}: expected with kind = {key!r} only")


def as_kind(settings: type[D], told: D, name: str) -> D:
    """The same for another kind, whose own table is as by default. Raises ValidationError."""
    if name == told.kind:
        return told
    return settings.model_validate(told.model_dump(include=set(settings.model_fields)) | {"kind": name})


def of_kind(settings: type[D], name: object) -> type[D]:
    """The settings with the own table of a kind, if it has one and they have not; a bad name is told elsewhere."""
    try:
        entry = find(settings.kinds, name) if isinstance(name, str) else None
    except KindError:
        entry = None
    if entry is None or entry.settings is None or entry.place in settings.model_fields:
        return settings
    return _with(settings, entry.place, entry.settings)


@cache
def _with(settings: type[D], place: str, table: type[Settings]) -> type[D]:
    required = any(field.is_required() for field in table.model_fields.values())
    return create_model(
        settings.__name__,
        __base__=settings,
        **{place: (table, Field(...) if required else Field(default_factory=table))},
    )  # type: ignore[call-overload]


def as_asked(model: type[M], tables: Mapping[str, Any]) -> type[M]:
    """The model of a whole configuration, with the own tables of the kinds that it names."""
    parts: dict[str, Any] = {}
    for room in DEFAULTS:
        part: Any = model.model_fields[room].annotation
        table = tables.get(room)
        if isinstance(table, Mapping):
            parts[room] = (of_kind(part, table.get("kind")), Field(default_factory=part))
    return create_model(model.__name__, __base__=model, **parts)
