"""Frame of the finger, fitted to touches of a sphere."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NotRequired

import numpy as np
import tomlkit
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import stdtrit

from rig.data import Run
from rig.errors import BadInputError
from rig.plan.config import Config
from rig_shared.outputs import Output
from sim.carriage import Pose, Turn
from sim.finger.surface import FingertipSurface
from sim.models.fingertip import Fingertip

Array = NDArray[np.float64]

NAMES = ("pad_centre_x_mm", "apex_z_mm", "pad_y_mm", "roll_deg", "tilt_deg")
_SPACING_MM = 0.05  # spacing of the skin's points; the error of a touch between two of them is 0.3 µm
_TOUCHED_RAD = 1.2  # on either side of the apex
# Touches are accurate to a few micrometers: steps of the stage, and readings of a hundredth of a gram-weight.
_LEAST_SD_MM = 0.003
_WALK = (0.05, 0.05, 0.05, 1.0, 1.0)  # steps of the derivatives, mm and degrees


class FingerFrameJson(Output):
    """Position of the finger in machine coordinates."""

    pad_centre_x_mm: float
    apex_z_mm: float
    pad_y_mm: NotRequired[float]
    roll_deg: NotRequired[float]
    tilt_deg: NotRequired[float]


@dataclass(frozen=True)
class FittedFrame:
    """Frame in machine coordinates, by the keys of [frame]: values, standard deviations, and their correlation.

    residual_mm: root mean square distance of the touches from the fitted finger (mm).
    """

    value: dict[str, float]
    sd: dict[str, float]
    correlation: Array
    residual_mm: float
    touches: int

    def as_toml(self) -> str:
        """Return the [frame] table of a configuration file."""
        frame = tomlkit.table()
        for name, value in self.value.items():
            frame.add(name, tomlkit.value(f"{value:.4f}").comment(f"± {2 * self.sd[name]:.4f} (95 %)"))
        return tomlkit.dumps({"frame": frame})


_FREE: tuple[Literal["pad_y_mm", "roll_deg", "tilt_deg"], ...] = ("pad_y_mm", "roll_deg", "tilt_deg")
"""Keys that touches may leave undetermined."""


def frame_as_json(frame: Mapping[str, float]) -> FingerFrameJson:
    """Return the fitted keys of a frame, or their standard deviations, as commands print them."""
    found: FingerFrameJson = {"pad_centre_x_mm": frame["pad_centre_x_mm"], "apex_z_mm": frame["apex_z_mm"]}
    for name in _FREE:
        if name in frame:
            found[name] = frame[name]
    return found


class _Skin:
    """Points of the pulp: (n,) x, height above the apex and distance from the receptor plane (mm)."""

    def __init__(self, finger: Fingertip) -> None:
        surface: FingertipSurface = finger.surface
        length = surface.geometry.length_mm
        z = np.linspace(0.02 * length, 0.98 * length, int(length / _SPACING_MM))
        phi = np.pi / 2 + np.linspace(-_TOUCHED_RAD, _TOUCHED_RAD, int(8 * _TOUCHED_RAD / _SPACING_MM))
        x, y = surface.section(*np.meshgrid(phi, z))
        self.x, self.y = x.ravel(), y.ravel() - finger.apex_height_mm
        self.along = np.repeat(z, len(phi)) - finger.config.receptor_plane_mm

    def touched_at(self, pose: Pose, radius_mm: float) -> float:
        """Return the height of the sphere's lowest point at first touch, above the apex (mm)."""
        under = radius_mm**2 - (self.x - pose.x_mm) ** 2 - (self.along - pose.along_mm) ** 2
        near = under > 0
        return float((self.y[near] + np.sqrt(under[near])).max() - radius_mm) if near.any() else -radius_mm


def find(run: Run, config: Config, finger: Fingertip) -> FittedFrame:
    """Fit the finger's frame to the touches of a run. Raises BadInputError for too few touches, or not by a sphere.

    Least squares over lateral, vertical and axial offset, roll and tilt. Touches at one position along the finger
    leave the axial offset and the tilt unchanged.
    """
    touches = run.stream("find")
    radius_mm = _radius(run, touches)
    places = np.array([(e["x_mm"], e["contact_height_mm"], e["along_mm"]) for e in touches])
    free = [0, 1, 3] if np.ptp(places[:, 2]) == 0 else [0, 1, 2, 3, 4]
    if len(places) <= len(free) + 1 or np.ptp(places[:, 0]) == 0:
        raise BadInputError(
            f"run folder {run.folder.path} has {len(places)} touches; at least {len(free) + 2}, at several x, are "
            "needed",
            "too_few_touches",
        )
    skin = _Skin(finger)

    def off_mm(found: Array) -> Array:
        dx, dy, along, roll, tilt = _full(found, free)
        turn = Turn(roll, tilt)
        poses = (turn.seen_from_finger(Pose(x - dx, h - dy, a - along), radius_mm) for x, h, a in places)
        return np.array([pose.above_apex_mm - skin.touched_at(pose, radius_mm) for pose in poses])

    walk = np.array(_WALK)[free]
    fit = least_squares(off_mm, np.zeros(len(free)), x_scale=walk, jac=_by_differences(off_mm, walk))
    return _lie(fit.x, _by_differences(off_mm, walk)(fit.x), off_mm(fit.x), free, config)


_SPHERE = re.compile(r"sphere:(?:(?P<of>[rd])=)?(?P<mm>[^:]+)")


def _radius(run: Run, touches: Sequence[Mapping[str, object]]) -> float:
    found = [_SPHERE.fullmatch(name) for name in {str(event["indentor"]) for event in touches}]
    if len(found) != 1 or found[0] is None:
        raise BadInputError(
            f"run folder {run.folder.path} has no touches by a single sphere; give a run of the protocol find_finger",
            "not_one_sphere",
        )
    return float(found[0]["mm"]) / (2 if found[0]["of"] == "d" else 1)


def _full(found: Array, free: list[int]) -> Array:
    every = np.zeros(len(NAMES))
    every[free] = found
    return every


def _by_differences(off_mm, walk: Array):  # type: ignore[no-untyped-def]
    """Return the Jacobian by central differences, with steps wide enough for a skin of points."""

    def jacobian(found: Array) -> Array:
        steps = np.diag(walk)
        return np.array([(off_mm(found + s) - off_mm(found - s)) / (2 * s.max()) for s in steps]).T

    return jacobian


def _lie(found: Array, jacobian: Array, off_mm: Array, free: list[int], config: Config) -> FittedFrame:
    """Return the frame with covariance s² (JᵀJ)⁻¹ and Student's factor, so that ± 2 sd covers 95 %."""
    spare = len(off_mm) - len(free)
    sd_mm = max(float(np.sqrt((off_mm**2).sum() / spare)), _LEAST_SD_MM)
    covariance = sd_mm**2 * np.linalg.inv(jacobian.T @ jacobian)
    sd = np.sqrt(np.diag(covariance))
    frame, change = config.frame, _full(found, free)
    was = (frame.pad_centre_x_mm, frame.apex_z_mm, frame.pad_y_mm, 0.0, 0.0)
    return FittedFrame(
        value={NAMES[i]: float(was[i] + change[i]) for i in free},
        sd={NAMES[i]: float(s * stdtrit(spare, 0.975) / 2) for i, s in zip(free, sd, strict=True)},
        correlation=covariance / np.outer(sd, sd),
        residual_mm=float(np.sqrt((off_mm**2).mean())),
        touches=len(off_mm),
    )
