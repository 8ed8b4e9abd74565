"""What a bench tells the virtual twin of a device, and what a twin is: a function that puts a device on a line.

`twin(scheduler, line, told)` for a stage, and `twin(scheduler, line, told, load)` for a force sensor.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

from sim.devices.cell import Load
from sim.devices.clock import Scheduler
from sim.devices.line import SerialLine
from sim.errors import SimError

PerAxis = tuple[float, float, float]
Framing = Literal["rtu", "tcp"]


class TwinError(SimError, ValueError):
    """A twin cannot be as it is told; begins with the key that says so."""

    default_code = "bad_twin"


class VirtualStage(Protocol):
    """What a bench needs to know of a stage: where what hangs on its screws is, in steps."""

    def nut_steps_at(self, t_s: float) -> tuple[int, int, int]:
        """Steps from machine zero (x, y, z) at an instant."""
        ...


@dataclass(frozen=True)
class StageTold:
    """Of a stage, each along x, y and z.

    steps_per_mm: as the rig believes, negative where the motor runs against the axis. play_steps: what the true
    screws lose. own: the table of its kind; sync: what the configuration says of the amplifier's pulse.
    inputs_register: of a drive's digital inputs.
    """

    travel_mm: PerAxis
    steps_per_mm: PerAxis
    play_steps: PerAxis = (0.0, 0.0, 0.0)
    framing: Framing = "rtu"
    own: Mapping[str, Any] = field(default_factory=dict)
    sync: Mapping[str, Any] = field(default_factory=dict)
    inputs_register: int = 0x0179


@dataclass(frozen=True)
class ForceTold:
    """Of a force sensor; resolution_g is what it truly shows, own the table of its kind.

    set_point_g: where its relay switches; None: it has none.
    """

    sample_period_s: float
    resolution_g: float
    framing: Framing = "rtu"
    own: Mapping[str, Any] = field(default_factory=dict)
    set_point_g: float | None = None


@runtime_checkable
class StopPins(Protocol):
    """A virtual stage with inputs that stop it, whatever its host does."""

    def press(self, name: str) -> None:
        """Somebody presses what is wired to it."""
        ...

    def release(self, name: str) -> None:
        """They let it go."""
        ...


@runtime_checkable
class Relay(Protocol):
    """A virtual sensor with a relay that switches at its set-point."""

    def wire(self, switch: Callable[[bool], None]) -> None:
        """Have it switched, from now on, at every sample."""
        ...


StageTwin = Callable[[Scheduler, SerialLine, StageTold], VirtualStage]
ForceTwin = Callable[[Scheduler, SerialLine, ForceTold, Load], object]
