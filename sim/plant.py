"""The bench's physics: where the screws have really put the indentor, and the force that answers."""

from collections.abc import Callable
from dataclasses import dataclass

from sim.contact.indentor import Indentor
from sim.contact.shapes import parse_shape
from sim.contact.solver import ContactState
from sim.fingertip import Fingertip, ModelRangeError
from sim.result import IndentationResult

_WARM_MOVE_MM = 0.1


@dataclass(frozen=True)
class Screws:
    """What the screws really are: steps for each millimetre of travel, x lateral and z vertical."""

    x_steps_per_mm: float = 400.0
    z_steps_per_mm: float = 400.0


@dataclass(frozen=True)
class Placement:
    """Where the finger really lies, in mm of true carriage travel from the home switches."""

    pad_centre_x_mm: float = -30.0
    apex_z_mm: float = -25.0  # carriage height at which an indentor's lowest point is level with the apex


@dataclass(frozen=True)
class TruePose:
    """What no instrument of the rig can see; mm in the finger's frame."""

    x_mm: float
    height_mm: float  # of the indentor's lowest point, in the finger's y
    doi_mm: float  # negative above the skin


class Plant:
    """A fingertip under a stage. Nothing is computed until somebody asks for a force."""

    def __init__(
        self,
        finger: Fingertip,
        carriage_steps_at: Callable[[float], tuple[int, int, int]],
        screws: Screws | None = None,
        placement: Placement | None = None,
    ) -> None:
        self._finger = finger
        self._steps_at = carriage_steps_at
        self._screws = Screws() if screws is None else screws
        self._placement = Placement() if placement is None else placement
        self._indentor: Indentor | None = None
        self._touch: dict[float, float] = {}
        self._last: tuple[TruePose, float, ContactState | None] | None = None
        self.contact_solves = 0

    def mount(self, indentor: str) -> None:
        """Put an indentor on the carriage; raises ShapeError."""
        self._indentor = parse_shape(indentor)
        self._touch.clear()
        self._last = None

    def pose_at(self, t_s: float) -> TruePose:
        """The indentor's true pose at an instant."""
        steps = self._steps_at(t_s)
        x = steps[0] / self._screws.x_steps_per_mm - self._placement.pad_centre_x_mm
        above_apex = steps[2] / self._screws.z_steps_per_mm - self._placement.apex_z_mm
        height = above_apex + self._finger.apex_height_mm
        return TruePose(x, height, self._touch_height_mm(x) - height)

    def force_n(self, t_s: float) -> float:
        """Downward force on the finger at an instant, N. Raises ModelRangeError."""
        pose = self.pose_at(t_s)
        if pose.doi_mm <= 0 or self._indentor is None:
            return 0.0
        if self._last is None or self._last[0] != pose:
            result = self._press(pose)
            self._last = (pose, result.force_n, result.state)
        return self._last[1]

    def _press(self, pose: TruePose) -> IndentationResult:
        """Continue from the last state when it is near: the branch reached by pressing in."""
        assert self._indentor is not None
        self.contact_solves += 1
        start = None
        if self._last is not None:
            before, _, state = self._last
            near = before.x_mm == pose.x_mm and abs(before.doi_mm - pose.doi_mm) <= _WARM_MOVE_MM
            start = state if near else None
        result = self._finger.indent(self._indentor, pose.x_mm, doi_mm=pose.doi_mm, start=start)
        if not result.state.converged:
            raise ModelRangeError(
                f"the virtual finger has no answer for {self._indentor.name} at x = {pose.x_mm:g} mm, DOI "
                f"{pose.doi_mm:g} mm: residual {result.state.residual:.0e}"
            )
        return result

    def _touch_height_mm(self, x_mm: float) -> float:
        if self._indentor is None:
            return float("-inf")
        if x_mm not in self._touch:
            self._touch[x_mm] = self._finger.touch_height_mm(self._indentor, x_mm)
        return self._touch[x_mm]
