"""The virtual bench as the configuration says: where the finger truly lies, and what the sensor gets of it."""

from pydantic import ValidationError

from rig.devices.bench_settings import NOMINAL_STEPS_PER_MM, ForceSettings, StageSettings
from rig.devices.own_table import DeviceSettings, as_kind
from rig.devices.units import GWT_N
from rig.plan.config import Config
from rig.protocol.errors import first_problem
from rig.transport.port_settings import Framing
from sim.devices.line import Load, VirtualStage, load_cell
from sim.models.relaxation import PronyTerm
from sim.plant import Carriage, Placement, Screws, Truth, Turn


def believed_steps_per_mm(config: Config, axis: str) -> float:
    """As measured, or nominal; negative where the motor runs against the axis."""
    return config.calibration.value(f"{axis}_steps_per_mm", NOMINAL_STEPS_PER_MM)


def _screw(config: Config, axis: str) -> float:
    """Steps in a mm of the true screw."""
    true: float | None = getattr(config.virtual, f"{axis}_screw_steps_per_mm")
    return true or abs(believed_steps_per_mm(config, axis))


def lost_steps(config: Config, axis: str) -> float:
    """Lost motion of the true screw."""
    backlash_mm: float = getattr(config.virtual, f"{axis}_screw_backlash_mm")
    return backlash_mm * _screw(config, axis)


def with_framing(config: Config, framing: Framing) -> Config:
    """The configuration, Modbus framed like this where it does not say."""
    stage = config.stage.model_copy(update={"framing": config.stage.framing or framing})
    force = config.force.model_copy(update={"framing": config.force.framing or framing})
    return config.model_copy(update={"stage": stage, "force": force})


def with_kinds(config: Config, stage: str | None, force: str | None) -> Config:
    """The configuration with devices of these kinds; None leaves what is there. Raises BadInputError."""
    parts: dict[str, DeviceSettings] = {}
    try:
        parts["stage"] = config.stage if stage is None else as_kind(StageSettings, config.stage, stage)
        parts["force"] = config.force if force is None else as_kind(ForceSettings, config.force, force)
    except ValidationError as error:
        raise first_problem("--force" if "stage" in parts else "--stage", error) from None
    return config.model_copy(update=parts)


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


def relaxation(config: Config) -> list[PronyTerm]:
    """Of the tissue; none: it is elastic."""
    return [PronyTerm(share, tau_s) for share, tau_s in config.virtual.relaxation]


def load_on_sensor(felt: Load, config: Config) -> Load:
    """The force on the finger as the sensor gets it: late, noisy and drifting where that is configured."""
    virtual = config.virtual
    latency_s = virtual.cell_latency_s
    force_n = load_cell(
        felt.force_n,
        sample_period_s=config.force.sample_period_s,
        noise_n=virtual.cell_noise_gwt * GWT_N,
        latency_s=latency_s,
        drift_n_per_s=virtual.cell_drift_gwt_per_min * GWT_N / 60,
        seed=virtual.noise_seed,
    )
    return Load(force_n, lambda t_s: felt.fresh(t_s - latency_s))
