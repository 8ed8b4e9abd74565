"""The virtual devices by the names of their kinds, and the finger they stand around, as a configuration says.

A new virtual device is one function here and one line in STAGES or FORCES.
"""

from collections.abc import Callable
from typing import Protocol

from rig.devices.bench_settings import NOMINAL_STEPS_PER_MM, DriveSettings
from rig.devices.units import GWT_N
from rig.plan.config import Config
from rig.protocol.errors import BadInputError
from rig.transport.port_settings import Framing
from sim.devices.balance import BalanceMenu, VirtualBalance
from sim.devices.cell import Load, load_cell
from sim.devices.clock import Scheduler
from sim.devices.grbl.board import VirtualGrbl
from sim.devices.grbl.core import Mechanics
from sim.devices.laumas import TransmitterFirmware, TransmitterMenu, VirtualLaumas
from sim.devices.leadshine import DrivePair, DriveParameters, VirtualDrive
from sim.devices.line import SerialLine
from sim.devices.modbus import ModbusBus
from sim.plant.plant import Carriage, Placement, Screws, Truth, Turn
from sim.plant.relaxation import PronyTerm, RelaxingForce

# Ids that clients may believe in: a transmitter is alone on its port, and answers to them too.
_USUAL_IDS = (1, 2)


class VirtualStage(Protocol):
    """What the bench needs to know of a stage: where what hangs on its screws is, in steps."""

    def nut_steps_at(self, t_s: float) -> tuple[int, int, int]: ...


def _grbl(scheduler: Scheduler, line: SerialLine, config: Config) -> VirtualStage:
    x, y, z = config.stage.travel_mm
    steps = [_steps_per_mm(config, axis) for axis in "xyz"]
    reversed_axes = sum(1 << i for i, per_mm in enumerate(steps) if per_mm < 0)
    settings = {3: reversed_axes, 130: x, 131: y, 132: z, **{100 + i: abs(v) for i, v in enumerate(steps)}}
    mechanics = Mechanics(play_steps=(_play(config, "x"), 0.0, _play(config, "z")))
    return VirtualGrbl(scheduler, line, settings=settings, mechanics=mechanics)


def _leadshine(scheduler: Scheduler, line: SerialLine, config: Config) -> VirtualStage:
    drives = config.stage.drives
    if drives.x.device_id == drives.z.device_id:
        raise BadInputError("stage.drives: the virtual drives share one port, expected different device ids")
    x, z = (_drive(scheduler, config, axis, drive) for axis, drive in (("x", drives.x), ("z", drives.z)))
    devices = {drives.x.device_id: x, drives.z.device_id: z}
    ModbusBus(scheduler, line, devices, framing=config.stage.framing or "rtu")
    return DrivePair(x, z)


def _drive(scheduler: Scheduler, config: Config, axis: str, drive: DriveSettings) -> VirtualDrive:
    parameters = DriveParameters(
        pulses_per_rev=drive.pulses_per_rev,
        inverted=_steps_per_mm(config, axis) < 0,
        ramp_rpm=drive.ramp_rpm,
        pulses_per_rev_register=drive.pulses_per_rev_register,
        jog_rpm_register=drive.jog_rpm_register,
        output_register=config.sync.register_address if axis == config.sync.drive else None,
    )
    return VirtualDrive(scheduler, parameters, play=_play(config, axis))


def _mtsics(scheduler: Scheduler, line: SerialLine, config: Config, load: Load) -> None:
    menu = BalanceMenu(resolution_g=config.virtual.cell_resolution_gwt, sample_period_s=config.force.sample_period_s)
    VirtualBalance(scheduler, line, load, menu)


def _laumas(scheduler: Scheduler, line: SerialLine, config: Config, load: Load) -> None:
    settings = config.force.laumas
    menu = TransmitterMenu(
        sample_period_s=config.force.sample_period_s,
        filter_samples=settings.filter_samples,
        count_g=settings.count_g,
        division_g=config.virtual.cell_resolution_gwt,
        units_word=settings.units_word,
    )
    firmware = TransmitterFirmware(
        signs=settings.signs,
        tare_command=settings.tare_command,
        zero_command=settings.zero_command,
        gross_command=settings.gross_command,
    )
    transmitter = VirtualLaumas(scheduler, load, menu, firmware)
    devices = dict.fromkeys((*_USUAL_IDS, settings.device_id), transmitter)
    ModbusBus(scheduler, line, devices, framing=config.force.framing or "rtu")


STAGES: dict[str, Callable[[Scheduler, SerialLine, Config], VirtualStage]] = {"grbl": _grbl, "leadshine": _leadshine}
FORCES: dict[str, Callable[[Scheduler, SerialLine, Config, Load], None]] = {"mtsics": _mtsics, "laumas": _laumas}


def _steps_per_mm(config: Config, axis: str) -> float:
    return config.calibration.value(f"{axis}_steps_per_mm", NOMINAL_STEPS_PER_MM)


def _screw(config: Config, axis: str) -> float:
    """Steps in a mm of the true screw."""
    true: float | None = getattr(config.virtual, f"{axis}_screw_steps_per_mm")
    return true or abs(_steps_per_mm(config, axis))


def _play(config: Config, axis: str) -> float:
    """Lost motion of the true screw, steps."""
    backlash_mm: float = getattr(config.virtual, f"{axis}_screw_backlash_mm")
    return backlash_mm * _screw(config, axis)


def with_framing(config: Config, framing: Framing) -> Config:
    """The configuration, Modbus framed like this where it does not say."""
    stage = config.stage.model_copy(update={"framing": config.stage.framing or framing})
    force = config.force.model_copy(update={"framing": config.force.framing or framing})
    return config.model_copy(update={"stage": stage, "force": force})


def checked_kind(option: str, kind: str, table: dict[str, object]) -> str:
    """The kind, if it is in a table; raises BadInputError."""
    if kind in table:
        return kind
    raise BadInputError(f"{option} {kind}: no such device, expected {' or '.join(table)}")


def true_carriage(stage: VirtualStage, config: Config) -> Carriage:
    """Where the stage's steps really put the indentor: true screws, true place of the finger."""
    virtual, frame = config.virtual, config.frame
    return Carriage(
        stage.nut_steps_at,
        Screws(_screw(config, "x"), _screw(config, "z")),
        Placement(
            frame.pad_centre_x_mm + virtual.finger_x_offset_mm,
            frame.apex_z_mm + virtual.finger_z_offset_mm,
            frame.pad_y_mm + virtual.finger_along_offset_mm if config.stage.moves_along else None,
        ),
    )


def truth(config: Config) -> Truth:
    """How the finger and the rig of the virtual bench differ from the model."""
    virtual = config.virtual
    turn = Turn(virtual.finger_roll_deg, virtual.finger_tilt_deg)
    return Truth(virtual.stiffness, virtual.compliance_mm_per_n, turn)


def load_on_sensor(scheduler: Scheduler, elastic: Load, config: Config) -> Load:
    """The elastic force of the finger as the sensor gets it: relaxed, late and noisy where that is configured."""
    virtual, period_s = config.virtual, config.force.sample_period_s
    force_n = elastic.force_n
    if virtual.relaxation:
        terms = [PronyTerm(share, tau_s) for share, tau_s in virtual.relaxation]
        force_n = RelaxingForce(scheduler, force_n, terms, period_s).force_n
    noise_n, latency_s = virtual.cell_noise_gwt * GWT_N, virtual.cell_latency_s
    force_n = load_cell(
        force_n, sample_period_s=period_s, noise_n=noise_n, latency_s=latency_s, seed=virtual.noise_seed
    )
    return Load(force_n, lambda t_s: elastic.fresh(t_s - latency_s))
