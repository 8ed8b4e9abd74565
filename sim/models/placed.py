"""An indentor at a place over a model's patch: where its depth is zero, and what it may not touch."""

from dataclasses import dataclass

import numpy as np

from sim.contact.control import TooDeepError
from sim.contact.indentor import SHARP_RADIUS_MM, Indentor
from sim.contact.patch import X, Y, Z
from sim.contact.points import Pose
from sim.contact.solver import ContactState
from sim.contact.touch import Touch
from sim.models.condensed import CondensedModel
from sim.models.errors import ModelRangeError

_CORNER_REACH_MM = 0.1
_LEAST_SCALE_MM = 1e-3
_AXIS_NAMES = {X: "x", Z: "z"}


class _RimError(ModelRangeError, TooDeepError):
    """The indentor would touch skin that the patch does not hold."""


@dataclass(frozen=True)
class PlacedIndentor:
    """An indentor with its reference point at a place, along its axes; mm."""

    indentor: Indentor
    place: tuple[float, ...]
    zero_mm: float  # height of the indentor's lowest point where DOI is zero
    touch: Touch
    model: CondensedModel

    def pose(self, doi_mm: float) -> Pose:
        """Where the indentor is at a depth."""
        return Pose(self.indentor, self.place, self.zero_mm - doi_mm, max(doi_mm, _LEAST_SCALE_MM))

    @property
    def first_mm(self) -> float:
        """DOI at first touch: 0, unless counted from the apex."""
        return self.zero_mm - self.touch.height_mm

    def bears_on_corner(self, state: ContactState) -> bool:
        """Whether a place that bears lies where the profile turns within less than a node's spacing."""
        patch = self.model.patch
        at = state.held.on(patch).interpolate(patch.tangential_mm + state.displacement[:-1])
        turning = self.indentor.turning(at - np.array(self.place)[:, None], _CORNER_REACH_MM)
        return bool((turning > 2 * _CORNER_REACH_MM / SHARP_RADIUS_MM).any())

    def refuse_touch_outside(self) -> None:
        """Refuse a scene in which the indentor first touches skin beside the patch."""
        for axis, at, nodes in zip(self.indentor.axes, self.touch.at_mm, self.model.patch.tangential_mm, strict=True):
            if not nodes.min() < at < nodes.max():
                self._refuse(f"touches the skin at {_AXIS_NAMES[axis]} = {at:.2f} mm, outside the patch")

    def refuse_rim(self, pose: Pose, state: ContactState) -> None:
        """Refuse an answer when the indentor touches skin that the patch does not hold."""
        patch, beside = self.model.patch, self.model.outside_mm
        at_rim = np.flatnonzero(state.active & patch.rim)
        y = beside[:, Y] + state.displacement[-1][self.model.outside_neighbour]
        gap = pose.gap(beside[:, list(self.indentor.axes)].T, y).height_mm
        if len(at_rim) or (gap < 0).any():
            x, _, z = patch.position_mm[at_rim[0]] if len(at_rim) else beside[np.argmin(gap)]
            self._refuse(f"contact reaches the patch's rim at x = {x:.2f}, z = {z:.2f} mm")

    def _refuse(self, what: str) -> None:
        names = [_AXIS_NAMES[axis] for axis in self.indentor.axes]
        where = ", ".join(f"{name} = {at:g}" for name, at in zip(names, self.place, strict=True))
        size = "mesh.round_patch_mm" if len(names) > 1 else "mesh.patch_x_mm / patch_z_mm"
        raise _RimError(
            f"{self.indentor.name} at {where} mm: {what}; expected a smaller depth, a position nearer the pad's "
            f"centre, or a wider {size}"
        )
