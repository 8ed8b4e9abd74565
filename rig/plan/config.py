"""Every key of a configuration: what it is, its unit, its default, and what it may be."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import date
from typing import Any, Literal, get_args, get_origin

import tomlkit
from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from rig.devices.catalogue import names
from rig.devices.own_table import DeviceSettings
from rig.protocol.errors import WRITTEN_BY_COMMANDS

# Endings of names, the longer before those that they end on.
UNITS = {
    "steps_per_mm": "steps/mm",
    "mm_per_n": "mm/N",
    "n_cm2": "N/cm²",
    "mm_s2": "mm/s²",
    "mm_s": "mm/s",
    "gwt": "gwt",
    "deg": "°",
    "rpm": "1/min",
    "mm": "mm",
    "ms": "ms",
    "gb": "GB",
    "baud": "bit/s",
    "s": "s",
    "n": "N",
    "g": "g",
}
ABSENT = "…"
_KINDS: dict[Any, str] = {
    bool: "true | false",
    int: "whole number",
    float: "number",
    str: "text",
    date: "day, such as 2026-03-01",
}
_SIGNS = {Gt: ">", Ge: "≥", Lt: "<", Le: "≤"}


@dataclass(frozen=True)
class Key:
    """One key, or an optional table as a whole; `value` is the configuration's, None where it says nothing."""

    table: str
    name: str
    value: Any
    default: Any
    unit: str
    allowed: str
    what: str

    @property
    def place(self) -> str:
        """As it is named in errors."""
        return f"{self.table}.{self.name}"

    @property
    def allowed_in_words(self) -> str:
        """Unit and what it may be."""
        return ", ".join(part for part in (self.unit, self.allowed) if part)

    @property
    def lines(self) -> str:
        """As it stands in a file, what it is above it; what has no value is a comment."""
        usual = "" if self.value == self.default else f"; by default {as_toml(self.default)}"
        given = self.name if self.value is not None else f"# {self.name}"
        return f"# {self.what} ({self.allowed_in_words}{usual})\n{given} = {as_toml(self.value)}\n"


def keys(settings: BaseModel) -> Iterator[Key]:
    """Every key of a configuration that a person writes, in the order of its tables."""
    return _keys(settings, type(settings)(), "")


def _keys(settings: BaseModel, default: BaseModel | None, table: str) -> Iterator[Key]:
    inner = []
    for name, field in type(settings).model_fields.items():
        if field.json_schema_extra == WRITTEN_BY_COMMANDS:
            continue
        value, usual = getattr(settings, name), _usual(default, name, field)
        if isinstance(value, BaseModel):
            inner.append((value, usual, f"{table}.{name}".lstrip(".")))
        else:
            allowed = _allowed(field, settings if name == "kind" else None)
            yield Key(table, name, value, usual, unit(name), allowed, field.description or "")
    for value, usual, place in inner:
        yield from _keys(value, usual, place)


def _usual(default: BaseModel | None, name: str, field: FieldInfo) -> Any:
    """What a key is where nothing is said, in a table that may be absent itself."""
    if default is not None:
        return getattr(default, name, None)
    return None if field.is_required() else field.get_default(call_default_factory=True)


def unit(name: str) -> str:
    """Of a key, by the end of its name; empty for what is counted, named or a ratio."""
    return next((said for end, said in UNITS.items() if name == end or name.endswith(f"_{end}")), "")


def _allowed(field: FieldInfo, device: BaseModel | None) -> str:
    """The words, the range or the kind of value."""
    if isinstance(device, DeviceSettings):
        return " | ".join(names(device.kinds.room))
    options = [one for one in get_args(field.annotation) if one is not type(None)]
    kind = options[0] if type(None) in get_args(field.annotation) else field.annotation
    bounds = [*field.metadata, *getattr(kind, "__metadata__", ())]
    kind = get_args(kind)[0] if hasattr(kind, "__metadata__") else kind
    if get_origin(kind) is Literal:
        return " | ".join(get_args(kind))
    if get_origin(kind) is tuple:
        return _several(get_args(kind), bounds)
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return f"table of {', '.join(kind.model_fields)}"
    return f"{_KINDS.get(kind, kind)} {_range(bounds)}".rstrip()


def _several(parts: tuple[Any, ...], bounds: list[Any]) -> str:
    if parts[-1] is ...:
        return f"rows of {len(get_args(parts[0]))} numbers"
    each = getattr(parts[0], "__metadata__", ())
    return f"{len(parts)} numbers {_range([*bounds, *each])}".rstrip()


def _range(bounds: Iterable[Any]) -> str:
    found = []
    for bound in bounds:
        for kind, sign in _SIGNS.items():
            if isinstance(bound, kind):
                found.append(f"{sign} {getattr(bound, kind.__name__.lower()):.7g}")
    return ", ".join(found)


def as_toml(value: Any) -> str:
    """A value as it stands in a file."""
    if value is None:
        return ABSENT
    return tomlkit.item(list(value) if isinstance(value, tuple) else value).as_string()
