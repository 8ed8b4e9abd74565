"""The bench's physics: where the screws have really put the indentor, and the force that answers."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from sim.contact.indentor import Indentor
from sim.contact.shapes import parse_shape
from sim.contact.solver import ContactState
from sim.fingertip import FARTHEST_X_MM, Fingertip, ModelRangeError

_WARM_MOVE_MM = 0.1

StepsAt = Callable[[float], tuple[int, int, int]]


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
class Pose:
    """Where the indentor really is: x from the pad's centre, its lowest point above the apex, mm."""

    x_mm: float
    above_apex_mm: float


@dataclass(frozen=True)
class TruePose:
    """What no instrument of the rig can see; mm in the finger's frame."""

    x_mm: float
    height_mm: float  # of the indentor's lowest point, in the finger's y
    doi_mm: float  # negative above the skin


@dataclass(frozen=True)
class Carriage:
    """From the steps a stage has really made to the pose of the indentor."""

    steps_at: StepsAt
    screws: Screws = Screws()
    placement: Placement = Placement()

    def pose_at(self, t_s: float) -> Pose:
        """The indentor's true pose at an instant."""
        x, _, z = self.steps_at(t_s)
        return Pose(
            x / self.screws.x_steps_per_mm - self.placement.pad_centre_x_mm,
            z / self.screws.z_steps_per_mm - self.placement.apex_z_mm,
        )


class Press:
    """A finger under an indentor: the force at one pose after another."""

    def __init__(self, finger: Fingertip, indentor: str, stiffness: float = 1.0) -> None:
        """stiffness multiplies every force. Raises ShapeError."""
        self._finger = finger
        self._indentor: Indentor = parse_shape(indentor)
        self._stiffness = stiffness
        self._touch_mm = (math.nan, math.nan)  # height of first touch at the last x
        self._last: tuple[Pose, float, ContactState | None] | None = None
        self.contact_solves = 0

    def doi_mm(self, pose: Pose) -> float:
        """Depth past first contact; negative above the skin, -inf where there is no finger below."""
        if abs(pose.x_mm) > FARTHEST_X_MM:
            return -math.inf
        if self._touch_mm[0] != pose.x_mm:
            self._touch_mm = (pose.x_mm, self._finger.touch_height_mm(self._indentor, pose.x_mm))
        return self._touch_mm[1] - (pose.above_apex_mm + self._finger.apex_height_mm)

    def force_n(self, pose: Pose) -> float:
        """Downward force on the finger, N. Raises ModelRangeError."""
        doi = self.doi_mm(pose)
        if doi <= 0:
            return 0.0
        if self._last is None or self._last[0] != pose:
            force, state = self._solve(pose, doi)
            self._last = (pose, force, state)
        return self._stiffness * self._last[1]

    def _solve(self, pose: Pose, doi_mm: float) -> tuple[float, ContactState]:
        """Continue from the last state when it is near: the branch reached by pressing in."""
        self.contact_solves += 1
        start = None
        if self._last is not None:
            before, _, state = self._last
            by_mm = abs(before.above_apex_mm - pose.above_apex_mm)
            start = state if before.x_mm == pose.x_mm and by_mm <= _WARM_MOVE_MM else None
        result = self._finger.indent(self._indentor, pose.x_mm, doi_mm=doi_mm, start=start)
        if not result.state.converged:
            raise ModelRangeError(
                f"the virtual finger has no answer for {self._indentor.name} at x = {pose.x_mm:g} mm, DOI "
                f"{doi_mm:g} mm: residual {result.state.residual:.0e}"
            )
        return result.force_n, result.state


class Plant:
    """A fingertip under a stage. Nothing is computed until somebody asks for a force."""

    def __init__(self, finger: Fingertip, carriage: Carriage, stiffness: float = 1.0) -> None:
        self._finger, self._carriage, self._stiffness = finger, carriage, stiffness
        self._press: Press | None = None

    @property
    def contact_solves(self) -> int:
        """How often the contact was solved for the indentor that is on."""
        return 0 if self._press is None else self._press.contact_solves

    def mount(self, indentor: str) -> None:
        """Put an indentor on the carriage; raises ShapeError."""
        self._press = Press(self._finger, indentor, self._stiffness)

    def pose_at(self, t_s: float) -> TruePose:
        """The indentor's true pose at an instant."""
        pose = self._carriage.pose_at(t_s)
        doi = float("-inf") if self._press is None else self._press.doi_mm(pose)
        return TruePose(pose.x_mm, pose.above_apex_mm + self._finger.apex_height_mm, doi)

    def force_n(self, t_s: float) -> float:
        """Downward force on the finger at an instant, N. Raises ModelRangeError."""
        return 0.0 if self._press is None else self._press.force_n(self._carriage.pose_at(t_s))
