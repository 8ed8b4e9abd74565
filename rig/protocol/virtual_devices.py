"""The virtual devices by the names of their kinds, and the finger they stand around, as a configuration says.

A new virtual device is one function here and one line in STAGES or FORCES.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from rig.protocol.config import Config
from rig.protocol.errors import BadInputError
from rig.units import GWT_N
from sim.clock import Scheduler
from sim.devices.balance import VirtualBalance
from sim.devices.cell import load_cell
from sim.devices.grbl import VirtualGrbl
from sim.devices.line import SerialLine
from sim.plant import Carriage, Placement, Screws
from sim.relaxation import PronyTerm, RelaxingForce

STEPS_PER_MM = 400.0


class VirtualStage(Protocol):
    """What the bench needs to know of a stage: the steps it has really made."""

    def carriage_steps_at(self, t_s: float) -> tuple[int, int, int]: ...


@dataclass(frozen=True)
class Load:
    """What stands on a force sensor: N at an instant in s, and whether that is known or the last one before."""

    force_n: Callable[[float], float]
    fresh: Callable[[float], bool] = lambda t_s: True


def _grbl(scheduler: Scheduler, line: SerialLine, config: Config) -> VirtualStage:
    x, y, z = config.stage.travel_mm
    steps = [config.calibration.value(f"{axis}_steps_per_mm", STEPS_PER_MM) for axis in "xyz"]
    reversed_axes = sum(1 << i for i, per_mm in enumerate(steps) if per_mm < 0)
    settings = {3: reversed_axes, 130: x, 131: y, 132: z, **{100 + i: abs(v) for i, v in enumerate(steps)}}
    return VirtualGrbl(scheduler, line, settings=settings)


def _mtsics(scheduler: Scheduler, line: SerialLine, config: Config, load: Load) -> None:
    VirtualBalance(
        scheduler,
        line,
        load.force_n,
        resolution_g=config.virtual.cell_resolution_gwt,
        sample_period_s=config.force.sample_period_s,
        fresh=load.fresh,
    )


STAGES: dict[str, Callable[[Scheduler, SerialLine, Config], VirtualStage]] = {"grbl": _grbl}
FORCES: dict[str, Callable[[Scheduler, SerialLine, Config, Load], None]] = {"mtsics": _mtsics}
_PROMISED = {"leadshine", "laumas"}


def checked_kind(option: str, kind: str, table: dict[str, object]) -> str:
    """The kind, if it is in a table; raises BadInputError."""
    if kind in table:
        return kind
    problem = "not built yet" if kind in _PROMISED else "no such device"
    raise BadInputError(f"{option} {kind}: {problem}, expected {' or '.join(table)}")


def true_carriage(stage: VirtualStage, config: Config) -> Carriage:
    """Where the stage's steps really put the indentor: true screws, true place of the finger."""
    virtual, frame = config.virtual, config.frame
    return Carriage(
        stage.carriage_steps_at,
        Screws(
            virtual.x_screw_steps_per_mm or abs(config.calibration.value("x_steps_per_mm", STEPS_PER_MM)),
            virtual.z_screw_steps_per_mm or abs(config.calibration.value("z_steps_per_mm", STEPS_PER_MM)),
        ),
        Placement(frame.pad_centre_x_mm + virtual.finger_x_offset_mm, frame.apex_z_mm + virtual.finger_z_offset_mm),
    )


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
