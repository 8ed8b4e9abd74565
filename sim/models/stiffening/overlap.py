"""Where an indentor would lie below a skin that did not give: how wide a press is, whatever the tissue."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.contact.indentor import Indentor
from sim.contact.patch import X, Z
from sim.contact.touch import Touch
from sim.finger.surface import FingertipSurface

Array = NDArray[np.float64]

_AROUND, _ALONG = 81, 121
_BESIDE_MM = 1e-6
_SIDE_RAD = 0.05  # of a section's widest places; the pulp is what lies above them


@dataclass(frozen=True)
class Overlap:
    """Places of the skin: gaps (n,) at first touch in mm, vertical, and areas (n,) in mm², seen from above."""

    gap_mm: Array
    area_mm2: Array

    def volume_mm3(self, past_touch_mm: float) -> float:
        """Between indentor and undeformed skin, so far past first touch."""
        return float((self.area_mm2 * np.maximum(past_touch_mm - self.gap_mm, 0.0)).sum())


def overlap(
    indentor: Indentor, place: tuple[float, ...], touch: Touch, surface: FingertipSurface, length_mm: float
) -> Overlap:
    """Of an indentor at a place along its axes, over a pulp of some length."""
    phi = np.linspace(_SIDE_RAD, np.pi - _SIDE_RAD, _AROUND)
    z = np.linspace(0.0, length_mm, _ALONG)
    x, y = surface.section(phi, z[:, None])
    at = {X: x, Z: np.broadcast_to(z[:, None], x.shape)}
    area = np.abs(np.gradient(x, axis=1)) * (z[1] - z[0])
    return Overlap(_gap_mm(indentor, place, touch, at, y), area.ravel())


@dataclass(frozen=True)
class Squeezed:
    """Places in the tissue: (n,) gaps from the skin above to the indentor, and from skin to bone, mm."""

    gap_mm: Array
    thickness_mm: Array

    def share(self, past_touch_mm: float) -> Array:
        """(n,) how far the indentor would come into the tissue there, over its thickness."""
        return np.asarray(np.maximum(past_touch_mm - self.gap_mm, 0.0) / self.thickness_mm)


def squeezed(
    indentor: Indentor,
    place: tuple[float, ...],
    touch: Touch,
    at_mm: Array,
    surface: FingertipSurface,
    bone_fraction: float,
) -> Squeezed:
    """At (n, 3) places of the tissue, straight up and down; beside the bone it ends level with its axis."""
    if not len(at_mm):
        return Squeezed(np.zeros(0), np.ones(0))
    x, _, z = at_mm.T
    _, y = surface.section(surface.angle_at(x, z), z)
    gap = _gap_mm(indentor, place, touch, {X: x, Z: z}, y)
    bone_x, bone_y = surface.section(surface.angle_at(x / bone_fraction, z), z)
    beside = np.abs(bone_x - x / bone_fraction) > _BESIDE_MM
    return Squeezed(gap, y - np.where(beside, 0.0, bone_fraction * bone_y))


def _gap_mm(
    indentor: Indentor, place: tuple[float, ...], touch: Touch, at_mm: dict[int, Array], y_mm: Array
) -> Array:
    """(n,) from the skin up to the indentor at first touch."""
    offset = np.stack([at_mm[axis].ravel() - mm for axis, mm in zip(indentor.axes, place, strict=True)])
    return np.asarray(touch.height_mm + indentor.evaluate(offset).height_mm - y_mm.ravel())
