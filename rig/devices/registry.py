"""Registry of device types, by their names in a configuration; checks the settings of a bench against it.

BUILT_IN names the types of this program; the module of that name in this package holds the entry, DEVICE. An
installed package adds a type by an entry point of the group rig.devices: `"force.NAME" = "its_module:DEVICE"`.
Listing names imports no driver, and using a type imports only its own.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, ClassVar, Literal, Self, TypeVar

from pydantic import BaseModel, Field, ValidationError, ValidationInfo, create_model, field_validator, model_validator
from pydantic_core import InitErrorDetails

from rig.clock import Clock
from rig.devices.base import ForceSensor, Stage
from rig.errors import RigError, RuleError
from rig.printable import either
from rig.settings import NOMINAL_STEPS_PER_MM, BenchSettings, DeviceSettings, ForceSettings, Settings, StageSettings
from rig.transport import Transport

Opener = Callable[[str], Transport]
Probe = Callable[[Opener, Clock, BenchSettings], str | None]
Room = Literal["stage", "force"]


class NumberedIdentity(str):
    """Identity of a device, with the serial number that its settings may name.

    Parameters
    ----------
    identity : str
        Description of the device.
    serial : int
        Its serial number.
    """

    serial: int

    def __new__(cls, identity: str, serial: int) -> Self:
        """Make the description, with the serial number as its attribute."""
        made = super().__new__(cls, identity)
        made.serial = serial
        return made


def nominal_steps_per_mm(stage: StageSettings, axis: str) -> float:
    """Return the steps per mm of an axis that is not calibrated."""
    return NOMINAL_STEPS_PER_MM


def own_port(stage: StageSettings) -> tuple[str, ...]:
    """Return the port of a stage with one device on one port."""
    return (stage.port,)


def one_second(force: ForceSettings) -> float:
    """Return the maximum sample age of a sensor that declares none (s)."""
    return 1.0


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Evidence of the tests of driver and virtual twin; an empty text claims nothing.

    Parameters
    ----------
    manual : str, optional
        Source of the bytes that the tests compare with.
    client : str, optional
        Programs of others that opened the virtual twin.
    firmware : str, optional
        Firmware or emulator of the maker that the driver drove.
    hardware : str, optional
        Real device that the driver drove, with its firmware and the date.
    """

    manual: str = ""
    client: str = ""
    firmware: str = ""
    hardware: str = ""


@dataclass(frozen=True, kw_only=True)
class DeviceKind:
    """Entry of a device in the registry.

    Parameters
    ----------
    name : str
        Name in the configuration, ``kind = "…"``.
    device : str
        What the device is, in words.
    tests : tuple of str
        Test modules that compare the driver with the bytes of the real device, from the folder of its project.
    evidence : Evidence, optional
        What these tests and others compared the driver with. Default: nothing.
    settings : type of Settings, optional
        Table of the configuration that only this kind has.
    table : str, optional
        Name of that table in [stage] or [force]. Default: `name`.
    twin : str, optional
        Virtual twin as "module:function" (`sim/devices/line.py`: `StageTwin`, `ForceTwin`). Without one the device
        cannot be dry-run.
    probe : callable, optional
        Asks a port whether the device is there, for `rig init`. It sends questions only, nothing that can move, zero
        or set anything, because any device may be on that port. It returns the identity, or None if no such device
        answers, and raises StageError or ForceError if one answers but cannot be used. Without it, `rig init` lists
        the kind and asks for its port.
    datagrams : bool, optional
        Whether the device sends datagrams over Ethernet (udp://) and serves a web page at the same address.
    page_port : str, optional
        Key of the kind's own table for the TCP port of that page. The page of a virtual device is at the number of
        its UDP port: `rig serve` prints the key with it, and `rig init` asks there, too.
    """

    room: ClassVar[Room]
    name: str
    device: str
    tests: tuple[str, ...]
    evidence: Evidence = Evidence()
    settings: type[Settings] | None = None
    table: str = ""
    twin: str = ""
    probe: Probe | None = None
    datagrams: bool = False
    page_port: str = ""

    @property
    def place(self) -> str:
        """Name of the kind's own table in [stage] or [force]."""
        return self.table or self.name


@dataclass(frozen=True, kw_only=True)
class StageKind(DeviceKind):
    """Entry of a stage in the registry.

    Parameters
    ----------
    name, device, tests, evidence, settings, table, twin, probe, datagrams, page_port : as in DeviceKind
        See there.
    driver : callable
        Makes the `Stage` from a function that opens ports, the clock and the settings. It raises what that function
        raises.
    ports : callable, optional
        Returns every port that the stage uses, from its settings. Default: its `port`.
    further_ports : tuple of str, optional
        Keys of the kind's own table that name a port each, beside the `port` of the stage. The twin finds their
        lines in `SerialLine.further`.
    serial_keys : tuple of str, optional
        Keys of the kind's own table for the serial numbers of the controllers on its port and its further ports, in
        that order, as ``axis.key``. `rig init` writes them; the probe returns a `NumberedIdentity`.
    axes : {'xz', 'xyz'}, optional
        Axes with a motor: x lateral, y along the finger, z vertical.
    outputs : tuple of str, optional
        Values of `sync.output` that the stage can switch.
    steps_per_mm : callable, optional
        Returns the steps per mm of an axis that is not calibrated, from its settings and the name of the axis;
        negative where the motor runs against the axis. Default: 400.
    inputs : tuple of str, optional
        Names of the stop inputs that the driver can report, for [stop].
    ramps : bool, optional
        Whether a move of the vertical axis may be a ramp into the finger: it has one speed from start to end, the
        target is confirmed or protected by a checksum, and `Stage.moving` reports the position every look_s while
        `Stage.halt` can end the move. Default: no ramp.
    """

    room: ClassVar[Room] = "stage"
    driver: Callable[[Opener, Clock, BenchSettings], Stage]
    ports: Callable[[StageSettings], tuple[str, ...]] = own_port
    further_ports: tuple[str, ...] = ()
    serial_keys: tuple[str, ...] = ()
    axes: Literal["xz", "xyz"] = "xyz"
    steps_per_mm: Callable[[StageSettings, str], float] = nominal_steps_per_mm
    outputs: tuple[str, ...] = ("off",)
    inputs: tuple[str, ...] = ()
    ramps: bool = False


@dataclass(frozen=True, kw_only=True)
class ForceKind(DeviceKind):
    """Entry of a force sensor in the registry.

    Parameters
    ----------
    name, device, tests, evidence, settings, table, twin, probe, datagrams, page_port : as in DeviceKind
        See there.
    driver : callable
        Makes the `ForceSensor` from a function that opens ports, the clock and the settings. It raises what that
        function raises.
    max_age_s : callable, optional
        Returns the longest time from the request for a reading to its arrival (s), from the settings. An older
        reading trips. Default: 1 s.
    also : tuple of str, optional
        Keys of `ForceReading.also`, which samples of the journal then have (`rig/data/events.py`: `OF_A_SENSOR`).
    """

    room: ClassVar[Room] = "force"
    driver: Callable[[Opener, Clock, BenchSettings], ForceSensor]
    max_age_s: Callable[[ForceSettings], float] = one_second
    also: tuple[str, ...] = ()


GROUP = "rig.devices"
BUILT_IN: dict[Room, tuple[str, ...]] = {
    "stage": ("grbl", "leadshine", "zaber", "standa", "tmcl"),
    "force": ("mtsics", "laumas", "text_cell", "net_ft"),
}
"""Built-in types, the default first."""
DEFAULTS: dict[Room, str] = {room: names[0] for room, names in BUILT_IN.items()}
KINDS: tuple[type[DeviceKind], ...] = (StageKind, ForceKind)
_OF: dict[Room, type[DeviceKind]] = {of.room: of for of in KINDS}

K = TypeVar("K", bound=DeviceKind)


class KindError(RigError, ValueError):
    """Error of a kind that does not exist, or whose package cannot be used."""

    default_code = "no_kind"


def find(of: type[K], name: str) -> K:
    """Return the entry of a kind of stage or of force sensor. Raises KindError."""
    if name in BUILT_IN[of.room]:
        found: K = import_module(f"rig.devices.{name}").DEVICE
        return found
    offers = _offered().get(f"{of.room}.{name}", ())
    if not offers:
        known = names(of.room)
        raise KindError(f"must be {either([repr(one) for one in known])}", "unknown_kind")
    if len(offers) > 1:
        raise KindError(
            f"offered by {' and '.join(map(package, offers))}; uninstall one of these packages", "offered_twice"
        )
    return _loaded(of, name, offers[0])


def names(room: Room) -> list[str]:
    """Return the names of the kinds of stage or force sensor, the default first."""
    there = [point.partition(".")[2] for point in _offered() if point.startswith(f"{room}.")]
    return list(dict.fromkeys([*BUILT_IN[room], *there]))


def third_party() -> dict[str, str]:
    """Return the packages that add devices, by entry point, such as `force.NAME`."""
    return {point: " and ".join(map(package, offers)) for point, offers in _offered().items()}


def problems() -> Iterator[KindError]:
    """Yield an error for each entry point that cannot be used; this imports all of them."""
    for point, who in third_party().items():
        room, _, name = point.partition(".")
        of = next((kind for kind in KINDS if kind.room == room), None)
        if of is None or not name:
            yield KindError(
                f"{who}: entry point {point!r} of {GROUP} must be named stage.NAME or force.NAME", "bad_entry_point"
            )
        elif name in BUILT_IN[of.room]:
            yield KindError(
                f"{who}: {room}.kind = {name!r} is the name of a built-in driver, which is used instead", "name_taken"
            )
        else:
            try:
                find(of, name)
            except KindError as problem:
                yield KindError(f"{room}.kind = {name!r}: {problem}", problem.code)


@cache
def _offered() -> dict[str, tuple[EntryPoint, ...]]:
    """Return the entry points, sorted by name."""
    found: dict[str, tuple[EntryPoint, ...]] = {}
    for point in sorted(entry_points(group=GROUP), key=lambda point: (point.name, package(point))):
        found[point.name] = (*found.get(point.name, ()), point)
    return found


def package(point: EntryPoint) -> str:
    """Return the name and version of the package that an entry point belongs to."""
    return "a package" if point.dist is None else f"{point.dist.name} {point.dist.version}"


def _loaded(of: type[K], name: str, point: EntryPoint) -> K:
    try:
        found = point.load()
    except (Exception, SystemExit) as error:  # Importing a package may raise anything.
        what = " ".join(str(error).split())
        raise KindError(f"{package(point)} cannot be used: {type(error).__name__}: {what}", "not_imported") from error
    if not isinstance(found, of):
        raise KindError(f"{package(point)} cannot be used: {point.value} is not a {of.__name__}", "wrong_type")
    if found.name != name:
        raise KindError(
            f"{package(point)} cannot be used: {point.value} is named {found.name!r}, expected {name!r}", "wrong_name"
        )
    return found


D = TypeVar("D", bound=DeviceSettings)
M = TypeVar("M", bound=BaseModel)


def kind_of(device: DeviceSettings) -> DeviceKind:
    """Return the entry of a device's kind. Raises KindError."""
    return find(_OF[device.room], device.kind)


def stage_ports(stage: StageSettings) -> tuple[str, ...]:
    """Return every port that the stage uses."""
    return find(StageKind, stage.kind).ports(stage)


def bench_ports(settings: BenchSettings) -> tuple[str, ...]:
    """Return every port that a run opens: of the stage, the force sensor, and the adapter of the sync line."""
    adapter = settings.sync.adapter
    return (*stage_ports(settings.stage), settings.force.port, *([] if adapter is None else [adapter.port]))


def moves_along(stage: StageSettings) -> bool:
    """Return whether the stage has an axis along the finger."""
    return "y" in find(StageKind, stage.kind).axes


def ramps(stage: StageSettings) -> bool:
    """Return whether the stage may move into the finger at constant speed."""
    return find(StageKind, stage.kind).ramps


def checked(settings: type[D], device: Any) -> D:
    """Return the settings of [stage] or [force] from a file or code, checked with the kind's own table.

    Raises ValidationError. The table of the type is part of the settings and validated like any other.
    """
    if isinstance(device, settings):
        device = device.model_dump()
    if not isinstance(device, Mapping):
        return settings.model_validate(device)
    kind = device.get("kind", settings.model_fields["kind"].default)
    whole = of_kind(settings, kind)
    _refuse_table_of_another(whole, device)
    try:
        entry = find(_OF[settings.room], kind if isinstance(kind, str) else "")
    except KindError as error:
        raise _refused(settings, error, kind, "kind") from None
    found = whole.model_validate(device)
    if entry.settings is not None:
        found._place = entry.place
    return found


def _refuse_table_of_another(settings: type[DeviceSettings], device: Mapping[str, Any]) -> None:
    for key in device:
        if key not in settings.model_fields and key in names(settings.room):
            raise _refused(settings, ValueError(f"{key}: allowed only with kind = {key!r}"), device)


def _refused(settings: type[DeviceSettings], error: ValueError, value: object, *place: str) -> ValidationError:
    """Return the ValidationError that pydantic would raise for this error at this location."""
    problem = InitErrorDetails(type="value_error", loc=place, input=value, ctx={"error": error})
    return ValidationError.from_exception_data(settings.__name__, [problem])


def as_kind(settings: type[D], device: D, name: str) -> D:
    """Return the settings for another kind, whose own table has its defaults. Raises ValidationError."""
    if name == device.kind:
        return device
    return checked(settings, device.model_dump(include=set(settings.model_fields)) | {"kind": name})


def of_kind(settings: type[D], name: object) -> type[D]:
    """Return the class of settings with a kind's own table, if it has one; another check reports an unknown kind."""
    try:
        entry = find(_OF[settings.room], name) if isinstance(name, str) else None
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


class KnownBench(BenchSettings):
    """Settings of a bench whose kinds exist, with the kinds' own tables."""

    @field_validator("stage", "force", mode="before")
    @classmethod
    def _of_a_kind(cls, device: Any, info: ValidationInfo) -> DeviceSettings:
        return checked(StageSettings if info.field_name == "stage" else ForceSettings, device)

    @model_validator(mode="after")
    def _output_there(self) -> Self:
        allowed = (*find(StageKind, self.stage.kind).outputs, "rts:PORT", "dtr:PORT")
        if self.sync.adapter is None and self.sync.output not in allowed[:-2]:
            raise RuleError(
                f"sync.output: {self.sync.output!r} is not available on a {self.stage.kind} stage; allowed: "
                f"{either(allowed)}",
                "no_such_output",
            )
        if self.sync.output == "drive" and self.sync.words is None:
            raise RuleError(
                "sync: output = 'drive' requires register_address, on_word and off_word, from the manual of "
                "the drive",
                "incomplete_sync",
            )
        if self.sync.inverted and self.sync.adapter is None:
            raise RuleError("sync.inverted: allowed only with output = 'rts:PORT' or 'dtr:PORT'", "not_inverted")
        return self

    @model_validator(mode="after")
    def _inputs_there(self) -> Self:
        inputs = find(StageKind, self.stage.kind).inputs
        allowed = either(inputs) or "none, because it reports no inputs"
        for key, name in self.stop.inputs.items():
            if name not in inputs:
                raise RuleError(
                    f"stop.{key} = {name!r} is not available on a {self.stage.kind} stage; allowed: {allowed}",
                    "no_such_input",
                )
        return self


def with_kind_tables(model: type[M], tables: Mapping[str, Any]) -> type[M]:
    """Return the model of a whole configuration, with the own tables of the kinds that it names."""
    parts: dict[str, Any] = {}
    for room in DEFAULTS:
        part: Any = model.model_fields[room].annotation
        table = tables.get(room)
        if isinstance(table, Mapping):
            parts[room] = (of_kind(part, table.get("kind")), Field(default_factory=part))
    return create_model(model.__name__, __base__=model, **parts)
