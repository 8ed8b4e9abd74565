"""Carriage of the indentor: from true steps of a stage to the pose over a finger. Nothing here solves."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

StepsAt = Callable[[float], tuple[float, float, float]]


@dataclass(frozen=True)
class Screws:
    """True steps per millimeter of travel: x lateral, z vertical, y along the finger."""

    x_steps_per_mm: float = 400.0
    z_steps_per_mm: float = 400.0
    y_steps_per_mm: float = 400.0


@dataclass(frozen=True)
class Placement:
    """True position of the finger, in mm of true carriage travel from the home switches."""

    pad_centre_x_mm: float = -30.0
    apex_z_mm: float = -25.0  # carriage height with the indentor's lowest point at the apex
    pad_y_mm: float | None = None  # over the receptor plane; None without an axis along the finger


class Pose(NamedTuple):
    """True pose of the indentor: x from the pad's center, and height of its lowest point above the apex (mm).

    along_mm is from the receptor plane towards the tip.
    """

    x_mm: float
    above_apex_mm: float
    along_mm: float = 0.0

    def over(self, other: "Pose") -> bool:
        """Return whether both poses are over the same point of the finger."""
        return (self.x_mm, self.along_mm) == (other.x_mm, other.along_mm)


@dataclass(frozen=True)
class Turn:
    """Orientation of a finger: rolled about its own axis, then tilted about x (degrees), both about the apex."""

    roll_deg: float = 0.0
    tilt_deg: float = 0.0

    def seen_from_finger(self, pose: Pose, radius_mm: float) -> Pose:
        """Return the pose of a sphere in the finger's own frame."""
        if not (self.roll_deg or self.tilt_deg):
            return pose
        from scipy.spatial.transform import Rotation  # slow to import, and few fingers are turned

        turn = Rotation.from_euler("zx", (self.roll_deg, self.tilt_deg), degrees=True)
        centre = turn.inv().apply((pose.x_mm, pose.above_apex_mm + radius_mm, pose.along_mm))
        return Pose(float(centre[0]), float(centre[1]) - radius_mm, float(centre[2]))


STRAIGHT = Turn()


@dataclass(frozen=True)
class Truth:
    """Differences between the true finger and rig and the model."""

    stiffness: float = 1.0  # factor of every force
    compliance_mm_per_n: float = 0.0  # of the rig
    turn: Turn = STRAIGHT


AS_MODELLED = Truth()


@dataclass(frozen=True)
class TruePose:
    """True pose, which no instrument of the rig measures, in mm in the finger's frame."""

    x_mm: float
    height_mm: float  # of the indentor's lowest point along the finger's y, for a rigid rig
    doi_mm: float  # negative above the skin, −∞ beside the finger


@dataclass(frozen=True)
class Carriage:
    """Conversion from a stage's true steps to the pose of the indentor."""

    steps_at: StepsAt
    screws: Screws = Screws()
    placement: Placement = Placement()

    def pose_at(self, t_s: float) -> Pose:
        """Return the indentor's true pose at a time."""
        x, y, z = self.steps_at(t_s)
        pad_y_mm = self.placement.pad_y_mm
        return Pose(
            x / self.screws.x_steps_per_mm - self.placement.pad_centre_x_mm,
            z / self.screws.z_steps_per_mm - self.placement.apex_z_mm,
            0.0 if pad_y_mm is None else y / self.screws.y_steps_per_mm - pad_y_mm,
        )
