"""Virtual bench: real drivers and bytes, virtual devices on one virtual clock."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, Self

from pydantic import ValidationError

from rig.devices.base import ForceSensor, Stage
from rig.devices.make_drivers import force_driver, stage_driver
from rig.devices.registry import (
    DEFAULTS,
    DeviceKind,
    Opener,
    StageKind,
    as_kind,
    find,
    kind_of,
    moves_along,
    stage_ports,
)
from rig.engine.bench import LOOK_S, NO_PAUSE, Meanwhile, Pause
from rig.engine.bench_memory import LastKnown
from rig.engine.contact import KnownContact
from rig.engine.limits import Heartbeat
from rig.engine.sensing import ForceZero
from rig.errors import BadInputError, first_problem
from rig.plan.config import Config
from rig.plan.finger_model import with_stored_file
from rig.settings import DeviceSettings, ForceSettings, Framing, StageSettings, SyncSettings
from rig.transport.stop_gate import StopGate
from rig.transport.wire import LoggedTransport, LoopbackTransport, Sink, Transport
from rig.units import GWT_N
from sim.carriage import Carriage, Placement, Screws, TruePose, Truth, Turn
from sim.devices.clock import Scheduler, VirtualClock
from sim.devices.line import (
    Load,
    Relay,
    SerialLine,
    StopPins,
    TwinError,
    VirtualForceSpec,
    VirtualStage,
    VirtualStageSpec,
    load_cell,
)
from sim.models.relaxation import PronyTerm

if TYPE_CHECKING:
    from sim.models.fingertip import Fingertip
    from sim.plant import Plant


def calibrated_steps_per_mm(config: Config, axis: str) -> float:
    """Return the calibrated or nominal steps per mm, negative if the motor runs against the axis."""
    nominal = find(StageKind, config.stage.kind).steps_per_mm(config.stage, axis)
    return config.calibration.value(f"{axis}_steps_per_mm", nominal)


def _screw(config: Config, axis: str) -> float:
    """Return the steps per mm of the true screw."""
    true: float | None = getattr(config.virtual, f"{axis}_screw_steps_per_mm")
    return true or abs(calibrated_steps_per_mm(config, axis))


def lost_steps(config: Config, axis: str) -> float:
    """Return the lost motion of the true screw (steps)."""
    backlash_mm: float = getattr(config.virtual, f"{axis}_screw_backlash_mm")
    return backlash_mm * _screw(config, axis)


def with_framing(config: Config, framing: Framing) -> Config:
    """Return the configuration with a default Modbus framing."""
    stage = config.stage.model_copy(update={"framing": config.stage.framing or framing})
    force = config.force.model_copy(update={"framing": config.force.framing or framing})
    return config.model_copy(update={"stage": stage, "force": force})


def with_kinds(config: Config, stage: str | None, force: str | None) -> Config:
    """Return the configuration with devices of these types; None keeps a device. Raises BadInputError."""
    parts: dict[str, DeviceSettings] = {}
    try:
        parts["stage"] = config.stage if stage is None else as_kind(StageSettings, config.stage, stage)
        parts["force"] = config.force if force is None else as_kind(ForceSettings, config.force, force)
    except ValidationError as error:
        raise first_problem("--force-sensor" if "stage" in parts else "--stage", error) from None
    return config.model_copy(update=parts)


def true_carriage(stage: VirtualStage, config: Config) -> Carriage:
    """Return the true carriage: true screws, true position of the finger."""
    virtual, frame = config.virtual, config.frame
    return Carriage(
        stage.nut_steps_at,
        Screws(_screw(config, "x"), _screw(config, "z")),
        Placement(
            frame.pad_centre_x_mm + virtual.finger_x_offset_mm,
            frame.apex_z_mm + virtual.finger_z_offset_mm,
            frame.pad_y_mm + virtual.finger_along_offset_mm if moves_along(config.stage) else None,
        ),
    )


def truth(config: Config) -> Truth:
    """Return how finger and rig of the virtual bench differ from the model."""
    virtual = config.virtual
    turn = Turn(virtual.finger_roll_deg, virtual.finger_tilt_deg)
    return Truth(virtual.stiffness, virtual.compliance_mm_per_n, turn)


def relaxation(config: Config) -> list[PronyTerm]:
    """Return the relaxation of the tissue; empty if it is elastic."""
    return [PronyTerm(share, tau_s) for share, tau_s in config.virtual.relaxation]


def load_on_sensor(load: Load, config: Config) -> Load:
    """Return the force as the sensor measures it, with the configured delay, noise and drift."""
    virtual = config.virtual
    latency_s = virtual.cell_latency_s
    force_n = load_cell(
        load.force_n,
        sample_period_s=config.force.sample_period_s,
        noise_n=virtual.cell_noise_gwt * GWT_N,
        latency_s=latency_s,
        drift_n_per_s=virtual.cell_drift_gwt_per_min * GWT_N / 60,
        seed=virtual.noise_seed,
    )
    return Load(force_n, lambda t_s: load.fresh(t_s - latency_s))


_ETHERNET_BIT_S = 1e9


def virtual_line(scheduler: Scheduler, device: StageSettings | ForceSettings) -> SerialLine:
    """Return the line to a device: at its baud rate, or as fast as Ethernet if it sends datagrams."""
    baud = _ETHERNET_BIT_S if kind_of(device).datagrams else device.baud
    return SerialLine(scheduler, baud)


def virtual_stage(scheduler: Scheduler, line: SerialLine, config: Config) -> VirtualStage:
    """Create the twin of the configured stage on a line; its further ports get lines. Raises BadInputError."""
    more = find(StageKind, config.stage.kind).further_ports
    line.further = line.further or tuple(SerialLine(scheduler, config.stage.baud) for _ in more)
    x, y, z = (calibrated_steps_per_mm(config, axis) for axis in "xyz")
    description = VirtualStageSpec(
        config.stage.travel_mm,
        (x, y, z),
        (lost_steps(config, "x"), 0.0, lost_steps(config, "z")),
        config.stage.framing or "rtu",
        _own(config.stage),
        config.sync.model_dump(),
        config.stop.inputs_register,
        config.stage.acceleration_mm_s2,
    )
    return _made(config.stage, lambda twin: twin(scheduler, line, description))


def stage_opener(config: Config, line: SerialLine, wire: Callable[[SerialLine, str], Transport]) -> Opener:
    """Return the opener of the virtual ports of a stage.

    wire: returns the transport over a line of the stage, with a name for the log.
    """
    entry = find(StageKind, config.stage.kind)
    names = ("stage", *(f"stage.{entry.place}.{key}" for key in entry.further_ports))
    wires = [wire(one, name) for one, name in zip((line, *line.further), names, strict=True)]
    return lambda port: wires[stage_ports(config.stage).index(port)] if line.further else wires[0]


def virtual_force(scheduler: Scheduler, line: SerialLine, config: Config, load: Load) -> object:
    """Create the twin of the configured force sensor on a line, under a load. Raises BadInputError."""
    force = config.force
    description = VirtualForceSpec(
        force.sample_period_s,
        config.virtual.cell_resolution_gwt,
        force.framing or "rtu",
        _own(force),
        config.stop.trip_gwt,
    )
    return _made(force, lambda twin: twin(scheduler, line, description, load))


def wire_hardware_trip(config: Config, stage: object, sensor: object) -> None:
    """Connect the relay of the virtual transmitter to the stop input of the virtual stage, as in [stop]."""
    name = config.stop.trip_input
    if name is None or not (isinstance(stage, StopPins) and isinstance(sensor, Relay)):
        return
    sensor.wire(lambda closed: stage.press(name) if closed else stage.release(name))


def refuse_twinless(*devices: DeviceSettings) -> None:
    """Raise BadInputError for a device without a usable virtual twin."""
    for device in devices:
        _twin(kind_of(device))


def with_stand_ins(config: Config) -> Config:
    """Replace devices without a virtual twin by the default types, for a rehearsal."""
    stage = None if kind_of(config.stage).twin else DEFAULTS["stage"]
    force = None if kind_of(config.force).twin else DEFAULTS["force"]
    kept = stage is None or config.sync.adapter is not None
    sync = config.sync if kept else SyncSettings()  # The outputs of stages differ.
    return with_kinds(config, stage, force).model_copy(update={"sync": sync})


def _own(device: DeviceSettings) -> Mapping[str, Any]:
    entry = kind_of(device)
    return {} if entry.settings is None else device.own(entry.settings).model_dump()


def _made(device: DeviceSettings, make: Callable[[Callable[..., Any]], Any]) -> Any:
    try:
        return make(_twin(kind_of(device)))
    except TwinError as problem:
        raise BadInputError(f"{device.room}.{problem}", problem.code) from None


def _twin(entry: DeviceKind) -> Callable[..., Any]:
    what = f"{entry.room}.kind = {entry.name!r}"
    if not entry.twin:
        usual = f"{entry.room}.kind = {DEFAULTS[entry.room]!r}"
        raise BadInputError(f"{what}: this device has no virtual twin; use one that has, such as {usual}", "no_twin")
    module, _, function = entry.twin.partition(":")
    try:
        twin: Callable[..., Any] = getattr(import_module(module), function)
    except (Exception, SystemExit) as error:  # Importing a package may raise anything.
        raise BadInputError(
            f"{what}: its virtual twin {entry.twin} cannot be loaded: {type(error).__name__}: "
            f"{' '.join(str(error).split())}",
            "twin_not_loaded",
        ) from error
    return twin


class AnyPlant(Protocol):
    """Finger under the virtual indentor."""

    def mount(self, indentor: str) -> None: ...

    def pose_at(self, t_s: float) -> TruePose: ...

    def force_n(self, t_s: float) -> float: ...


@contextmanager
def looked_after_by(clock: VirtualClock, heartbeat: Heartbeat) -> Iterator[None]:
    """Monitor a heartbeat from a timer of the virtual clock."""
    active = True

    def look() -> None:
        heartbeat.look()
        if active:
            clock.call_at(clock.monotonic_s() + LOOK_S, look)

    look()
    try:
        yield
    finally:
        active = False


@dataclass(frozen=True)
class VirtualBench:
    """Virtual bench, with its plant. It is its own operator."""

    clock: VirtualClock
    stage: Stage
    force: ForceSensor
    plant: AnyPlant
    pause: Pause
    virtual: Literal[True] = True
    board: VirtualStage | None = None
    shape_files: Path | None = None  # folder of the run, with its copies of shape files

    @property
    def operator(self) -> Self:
        """Operator, which is the bench itself."""
        return self

    def mount(self, indentor: str, meanwhile: Meanwhile) -> str:
        """Mount an indentor; the virtual operator makes no mistakes."""
        self.plant.mount(indentor if self.shape_files is None else with_stored_file(self.shape_files, indentor))
        return indentor

    def witness(self, stream: str, data: Mapping[str, Any]) -> dict[str, float]:
        """Return the true position of the indentor at a touch and at the end of a hold (mm)."""
        if stream.endswith("hold_end"):
            pose = self.plant.pose_at(self.clock.monotonic_s())
            return {"true_x_mm": round(pose.x_mm, 9), "true_doi_mm": round(pose.doi_mm, 9)}
        if stream.endswith("touch"):
            pose = self.plant.pose_at(self.clock.monotonic_s())
            return {"true_doi_bias_mm": round(pose.doi_mm - data["doi_mm"], 6)}
        return {}

    def monitor(self, heartbeat: Heartbeat) -> AbstractContextManager[None]:
        """Monitor the heartbeat from a timer of the virtual clock."""
        return looked_after_by(self.clock, heartbeat)

    @property
    def before(self) -> LastKnown:
        """Empty: every virtual bench is new."""
        return LastKnown()

    def touched(self, known: KnownContact) -> None:
        """Do nothing: a virtual bench keeps no record."""

    def record_zero(self, zero: ForceZero | None) -> None:
        """Do nothing: every virtual bench is new."""

    def close(self) -> None:
        """Do nothing."""


def virtual_bench(
    config: Config, finger: "Fingertip", byte_log: Sink, clock: VirtualClock, pause: Pause
) -> VirtualBench:
    """Create the configured devices with the fingertip under the indentor; the bytes go to `byte_log`."""
    from sim.plant import Plant, RelaxingPlant  # a bench of springs, or of real devices, never solves

    terms, period_s = relaxation(config), config.force.sample_period_s

    def plant(carriage: Carriage) -> "Plant":
        if terms:
            return RelaxingPlant(finger, carriage, terms, truth(config), clock, period_s)
        return Plant(finger, carriage, truth(config))

    return bench_around(plant, config, clock, byte_log, pause)


def bench_around(
    make_plant: Callable[[Carriage], AnyPlant],
    config: Config,
    clock: VirtualClock,
    byte_log: Sink,
    pause: Pause = NO_PAUSE,
    gate: StopGate | None = None,
) -> VirtualBench:
    """Create the configured devices around a plant; the bytes go to `byte_log`.

    gate: gate between the stage and its driver, which a stop closes.
    """
    config = with_framing(config, "rtu")  # Drives share one wire, whatever ports are configured.
    stage_line, force_line = virtual_line(clock, config.stage), virtual_line(clock, config.force)
    board = virtual_stage(clock, stage_line, config)
    plant = make_plant(true_carriage(board, config))
    load = load_on_sensor(Load(plant.force_n), config)
    wire_hardware_trip(config, board, virtual_force(clock, force_line, config, load))

    def stage_wire(line: SerialLine, name: str) -> Transport:
        wire = LoggedTransport(LoopbackTransport(line, clock, name=name), clock, byte_log)
        return wire if gate is None else gate.guarded(wire)

    force_port = LoggedTransport(LoopbackTransport(force_line, clock, name="force"), clock, byte_log)
    return VirtualBench(
        clock,
        stage_driver(stage_opener(config, stage_line, stage_wire), clock, config),
        force_driver(lambda _port: force_port, clock, config),
        plant,
        pause,
        board=board,
    )
