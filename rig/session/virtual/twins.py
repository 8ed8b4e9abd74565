"""The virtual twins that the catalogue names: found here and nowhere else, told what the configuration says."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from rig.devices.bench_settings import SyncSettings
from rig.devices.catalogue import DEFAULTS
from rig.devices.kinds import Kind
from rig.devices.own_table import DeviceSettings
from rig.errors import around
from rig.plan.config import Config
from rig.protocol.errors import BadInputError
from rig.session.virtual.virtual_devices import believed_steps_per_mm, lost_steps, with_kinds
from sim.devices.clock import Scheduler
from sim.devices.line import ForceTold, Load, Relay, SerialLine, StageTold, StopPins, TwinError, VirtualStage


def virtual_stage(scheduler: Scheduler, line: SerialLine, config: Config) -> VirtualStage:
    """The twin of the configured stage, on a line. Raises BadInputError."""
    x, y, z = (believed_steps_per_mm(config, axis) for axis in "xyz")
    told = StageTold(
        config.stage.travel_mm,
        (x, y, z),
        (lost_steps(config, "x"), 0.0, lost_steps(config, "z")),
        config.stage.framing or "rtu",
        _own(config.stage),
        config.sync.model_dump(),
        config.stop.inputs_register,
    )
    return _made(config.stage, lambda twin: twin(scheduler, line, told))


def virtual_force(scheduler: Scheduler, line: SerialLine, config: Config, load: Load) -> object:
    """The twin of the configured force sensor, on a line, under a load. Raises BadInputError."""
    force = config.force
    told = ForceTold(
        force.sample_period_s,
        config.virtual.cell_resolution_gwt,
        force.framing or "rtu",
        _own(force),
        config.stop.trip_gwt,
    )
    return _made(force, lambda twin: twin(scheduler, line, told, load))


def wire_hardware_trip(config: Config, stage: object, sensor: object) -> None:
    """Lead the relay of the virtual transmitter to the stop input of the virtual stage, as [stop] says."""
    name = config.stop.trip_input
    if name is None or not (isinstance(stage, StopPins) and isinstance(sensor, Relay)):
        return
    sensor.wire(lambda closed: stage.press(name) if closed else stage.release(name))


def refuse_twinless(*devices: DeviceSettings) -> None:
    """Raises BadInputError for a device without a virtual twin, or with one that is not there."""
    for device in devices:
        _twin(device.entry)


def with_stand_ins(config: Config) -> Config:
    """The usual kind of device in the place of one without a virtual twin: what a rehearsal can do without."""
    stage = None if config.stage.entry.twin else DEFAULTS["stage"]
    force = None if config.force.entry.twin else DEFAULTS["force"]
    sync = config.sync if stage is None else SyncSettings()  # whose outputs are others
    return with_kinds(config, stage, force).model_copy(update={"sync": sync})


def _own(device: DeviceSettings) -> Mapping[str, Any]:
    entry = device.entry
    return {} if entry.settings is None else device.own(entry.settings).model_dump()


def _made(device: DeviceSettings, make: Callable[[Callable[..., Any]], Any]) -> Any:
    try:
        return make(_twin(device.entry))
    except TwinError as problem:
        raise around(BadInputError, "{room}.{problem}", problem, room=device.entry.room) from None


def _twin(entry: Kind) -> Callable[..., Any]:
    what = f"{entry.room}.kind = {entry.name!r}"
    if not entry.twin:
        usual = f"{entry.room}.kind = {DEFAULTS[entry.room]!r}"
        raise BadInputError("{what}: this device has no virtual twin, expected another one here, such as {usual}",
                            code="no_twin", what=what, room=entry.room, kind=entry.name, usual=usual)  # fmt: skip
    module, _, function = entry.twin.partition(":")
    try:
        twin: Callable[..., Any] = getattr(import_module(module), function)
    except (Exception, SystemExit) as error:  # whatever a package does when it is imported
        raise BadInputError(
            "{what}: its virtual twin {twin}: {exception}: {problem}",
            code="twin_not_loaded",
            what=what,
            twin=entry.twin,
            exception=type(error).__name__,
            problem=" ".join(str(error).split()),
        ) from error
    return twin
