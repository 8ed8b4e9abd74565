"""The whole configuration: its tables, its keys, and errors in its file."""

import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args, get_origin

import tomlkit
from annotated_types import Ge, Gt, Le, Lt
from pydantic import AfterValidator, BaseModel, Field, ValidationError, ValidationInfo, model_validator
from pydantic.fields import FieldInfo

from rig.devices.registry import BUILT_IN, KINDS, KnownBench, find, names, with_kind_tables
from rig.errors import WRITTEN_BY_COMMANDS, RigError, RuleError, first_problem
from rig.plan.finger_file import (
    IdentifiedFinger,
    checked_relaxation,
    read_finger_file,
    refuse_flagged,
    refuse_unusable,
    tables_in,
)
from rig.settings import DeviceSettings, RigSettings, Settings
from rig.units import unit_of_key
from sim.config import FingertipConfig


def _named(indentor: str, info: ValidationInfo) -> str:
    if not indentor.strip():
        raise ValueError("the name is empty; give an indentor, such as bar:3.0")
    if not indentor.startswith(("profile:", "heightmap:")):
        return indentor
    from sim.contact.shapes import ShapeError, with_file_beside  # a configuration seldom names a file

    try:
        return with_file_beside(Path((info.context or {}).get("folder", ".")), indentor)
    except ShapeError:
        return indentor  # only what mounts it needs the file


class VirtualSettings(Settings):
    """Differences between the virtual bench and the configured rig; none by default."""

    x_screw_steps_per_mm: float | None = Field(
        None, gt=1, lt=1e6, description="true motor steps per mm of the lateral axis; absent: as calibrated"
    )
    z_screw_steps_per_mm: float | None = Field(
        None, gt=1, lt=1e6, description="true motor steps per mm of the vertical axis; absent: as calibrated"
    )
    x_screw_backlash_mm: float = Field(
        0.0, ge=0, le=1, description="true lost motion of the lateral axis at each reversal, in mm"
    )
    z_screw_backlash_mm: float = Field(
        0.0, ge=0, le=1, description="true lost motion of the vertical axis at each reversal, in mm"
    )
    compliance_mm_per_n: float = Field(0.0, ge=0, le=1, description="true compliance of the rig, in mm/N")
    finger_x_offset_mm: float = Field(
        0.0, ge=-5, le=5, description="true center of the pad minus frame.pad_centre_x_mm, in mm"
    )
    finger_z_offset_mm: float = Field(
        0.0, ge=-2, le=2, description="true height of the apex minus frame.apex_z_mm, in mm"
    )
    finger_along_offset_mm: float = Field(
        0.0, ge=-3, le=3, description="true receptor plane minus frame.pad_y_mm, in mm"
    )
    finger_roll_deg: float = Field(
        0.0, ge=-20, le=20, description="roll of the finger about its long axis, in degrees; used for spheres only"
    )
    finger_tilt_deg: float = Field(
        0.0, ge=-20, le=20, description="tilt of the finger about the x axis, in degrees; used for spheres only"
    )
    stiffness: float = Field(1.0, gt=0, le=100, description="true force divided by the predicted force")
    relaxation: tuple[tuple[float, float], ...] = Field(
        (),
        description="Prony series of the tissue, rows of [share, time constant in s, at most 60]; the shares sum to "
        "less than 1",
    )
    cell_noise_gwt: float = Field(
        0.0, ge=0, le=10, description="standard deviation of the noise of each sample, in gwt"
    )
    cell_drift_gwt_per_min: float = Field(0.0, ge=-5, le=5, description="drift of the cell's zero, in gwt/min")
    cell_latency_s: float = Field(0.0, ge=0, le=1, description="true delay of a sample behind the force, in s")
    cell_resolution_gwt: float = Field(
        0.01, ge=0.001, le=10, description="smallest step of the virtual sensor's reading, in gwt"
    )
    noise_seed: int = Field(0, ge=0, description="seed of the random generator for the noise")
    indentor: Annotated[str, AfterValidator(_named)] = Field(
        "bar:3.0", description="indentor that `rig serve` mounts, such as bar:3.0"
    )

    @model_validator(mode="after")
    def _relaxes(self) -> Self:
        try:
            checked_relaxation(self.relaxation)
        except RuleError as error:
            raise RuleError(f"relaxation: {error}", error.code) from None
        return self


class Config(RigSettings, KnownBench):
    """Configuration file. Every table and key has a default."""

    finger: FingertipConfig = FingertipConfig()
    virtual: VirtualSettings = VirtualSettings()
    identified: IdentifiedFinger | None = Field(
        None,
        description="results of the identification of this finger: docs/identify.md",
        json_schema_extra=WRITTEN_BY_COMMANDS,
    )

    def as_toml(self) -> str:
        """Return a configuration file with every table and value.

        Returns
        -------
        str
            Text in TOML that gives this configuration.
        """
        return tomlkit.dumps(self.model_dump(mode="json", exclude_none=True))


def load_config(path: Path | None) -> Config:
    """Load the configuration from a TOML file; paths in it are relative to its folder.

    Parameters
    ----------
    path : Path or None
        The file; None for the defaults.

    Returns
    -------
    Config
        The configuration.

    Raises
    ------
    BadInputError
        If the file cannot be read, or a key or value in it is wrong.
    """
    if path is None:
        return Config()
    where = f"config {path}"
    return config_from(where, tables_in(where, path), path.parent)


def config_from(where: str, tables: Mapping[str, Any], folder: Path) -> Config:
    """Return the configuration of a file's tables, whose paths are relative to its folder. Raises BadInputError."""
    try:
        found = Config.model_validate(tables, context={"folder": folder})
    except ValidationError as error:
        raise first_problem(where, error, with_kind_tables(Config, tables)) from None
    if found.identified is not None:
        refuse_unusable(where, found.finger, found.identified)
    return found


def with_finger(config: Config, path: Path | None, *, force: bool = False) -> Config:
    """Return the configuration with an identified finger.

    The virtual bench's finger relaxes as the identified one, unless the configuration sets `virtual.relaxation`.

    Parameters
    ----------
    config : Config
        The configuration.
    path : Path or None
        File that `rig identify` wrote; None to keep the finger of the configuration.
    force : bool, optional
        Accept a file that `rig identify` flagged because no finger of its prior explains the presses.

    Returns
    -------
    Config
        The configuration.

    Raises
    ------
    BadInputError
        If the file cannot be read, is flagged, or a key or value in it is wrong.
    """
    all_the_same = ", or add --accept-flagged to use the finger all the same"
    if path is None:
        if config.identified is not None and not force:
            refuse_flagged("[identified] of the configuration", config.identified, all_the_same)
        return config
    found = read_finger_file(path)
    if not force:
        refuse_flagged(f"finger file {path}", found.identified, all_the_same)
    sets_its_own = "relaxation" in config.virtual.model_fields_set
    relaxes = {} if sets_its_own else {"relaxation": found.relaxation}
    virtual = config.virtual.model_copy(update=relaxes)
    return config.model_copy(update={"finger": found.finger, "identified": found.identified, "virtual": virtual})


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
    """One key, or a whole optional table. `value` is None if the configuration does not set it."""

    table: str
    name: str
    value: Any
    default: Any
    unit: str
    allowed: str
    what: str

    @property
    def place(self) -> str:
        """Full name of the key, as in error messages."""
        return f"{self.table}.{self.name}"

    @property
    def allowed_in_words(self) -> str:
        """Unit and allowed values."""
        return ", ".join(part for part in (self.unit, self.allowed) if part)

    @property
    def lines(self) -> str:
        """Lines of a configuration file: the description as a comment, then the key (a comment if not set)."""
        usual = "" if self.value == self.default else f"; by default {as_toml(self.default)}"
        given = self.name if self.value is not None else f"# {self.name}"
        return f"# {self.what} ({self.allowed_in_words}{usual})\n{given} = {as_toml(self.value)}\n"


def keys(settings: BaseModel) -> Iterator[Key]:
    """Yield every key that a person may write, in the order of the tables."""
    return _keys(settings, type(settings)(), "")


def keys_of_other_kinds(config: Config) -> Iterator[Key]:
    """Yield the keys in the own tables of built-in kinds that this configuration does not use."""
    for of in KINDS:
        device = getattr(config, of.room)
        for name in BUILT_IN[of.room]:
            entry = find(of, name)
            if entry.settings is not None and not hasattr(device, entry.place):
                yield from _keys(entry.settings(), entry.settings(), f"{of.room}.{entry.place}")


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
            yield Key(table, name, value, usual, unit_of_key(name), allowed, field.description or "")
    for value, usual, place in inner:
        yield from _keys(value, usual, place)


def _usual(default: BaseModel | None, name: str, field: FieldInfo) -> Any:
    """Return the default of a key, whose table may be absent."""
    if default is not None:
        return getattr(default, name, None)
    return None if field.is_required() else field.get_default(call_default_factory=True)


def _allowed(field: FieldInfo, device: BaseModel | None) -> str:
    """Return the allowed words, the range or the type of a value."""
    if isinstance(device, DeviceSettings):
        return " | ".join(names(device.room))
    options = [one for one in get_args(field.annotation) if one is not type(None)]
    kind = options[0] if type(None) in get_args(field.annotation) else field.annotation
    bounds = [*field.metadata, *getattr(kind, "__metadata__", ())]
    kind = get_args(kind)[0] if hasattr(kind, "__metadata__") else kind
    if get_origin(kind) is Literal:
        return " | ".join(map(str, get_args(kind)))
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
    """Return a value as TOML."""
    if value is None:
        return ABSENT
    return tomlkit.item(list(value) if isinstance(value, tuple) else value).as_string()


@contextmanager
def reraised_as(where: str, error: type[RigError], model: type[BaseModel] | None = None) -> Iterator[None]:
    """Re-raise errors of reading and validating a TOML file as `error`, with `where` in front.

    model: validated model; for an unknown key the most similar ones are suggested.
    """
    try:
        yield
    except OSError as problem:
        raise error(f"{where}: {problem.strerror or problem}", "unreadable") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise error(f"{where}: not valid TOML: {problem}", "no_toml") from None
    except ValidationError as problem:
        found = first_problem(where, problem, model)
        raise error(str(found), found.code) from None
