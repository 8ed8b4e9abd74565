"""Where an indentor would lie below a skin that did not give: how wide a press is, whatever the tissue."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.contact.indentor import Indentor
from sim.contact.patch import X, Z
from sim.contact.touch import Touch
from sim.finger.surface import FingertipSurface

Array = NDArray[np.float64]

_AROUND, _ALONG = 81, 121
_BESIDE_MM = 1e-6
_SEEN_MM = 0.1  # a shallower overlap covers too few places to have a form; it is that of a paraboloid anyway
_NONE_MM3 = 1e-9  # so that what is finer than places are apart is a paraboloid
_ABOUT = np.linspace(-1, 1, 43)[1::2]  # middles of parts, over a place's depth below the skin
_MOST_STRAIN = 0.9  # deeper than any finger is pressed
_SIDE_RAD = 0.05  # of a section's widest places; the pulp is what lies above them


@dataclass(frozen=True)
class Overlap:
    """Places of the skin: gaps (n,) at first touch in mm, vertical; across and along (2, n) mm; areas (n,) in mm²."""

    gap_mm: Array
    at_mm: Array
    area_mm2: Array

    def volume_mm3(self, past_touch_mm: float) -> float:
        """Between indentor and undeformed skin, so far past first touch."""
        return float(self._moments(past_touch_mm)[0])

    def long_radius_mm(self, past_touch_mm: float) -> float:
        """Of the paraboloid that reaches as far along the longer way: ⟨r²⟩ = R d / 3 over its volume."""
        deep_mm = max(past_touch_mm, _SEEN_MM)
        volume, *others = self._moments(deep_mm)
        x, z, xx, xz, zz = (other / (volume + _NONE_MM3) for other in others)
        across, both, along = xx - x * x, xz - x * z, zz - z * z
        longest_mm2 = 0.5 * (across + along) + np.hypot(0.5 * (across - along), both)
        return float(3 * (longest_mm2 + self.area_mm2.mean() / 12) / deep_mm)  # a place has an extent of its own

    def power(self, past_touch_mm: float) -> float:
        """By which the volume grows with depth: a paraboloid's 2, less where an edge ends the overlap."""
        deep_mm = max(past_touch_mm, _SEEN_MM)
        whole, half = self.volume_mm3(deep_mm), self.volume_mm3(0.5 * deep_mm)
        return float(np.log2((whole + _NONE_MM3) / (half + _NONE_MM3 / 4)))

    def _moments(self, past_touch_mm: float) -> Array:
        """(6,) of the volume: itself, and weighted with x, z, x², xz, z²."""
        gap, flat, above = self._by_gap
        k = int(np.searchsorted(gap, past_touch_mm))
        return np.asarray(past_touch_mm * flat[k] - above[k])

    @cached_property
    def _by_gap(self) -> tuple[Array, Array, Array]:
        """(m,) gaps in order, and sums of areas' and areas times gaps' (m + 1, 6) moments over all that are less."""
        order = np.argsort(self.gap_mm)[: np.isfinite(self.gap_mm).sum()]
        gap, (x, z) = self.gap_mm[order], self.at_mm[:, order]
        moments = np.stack([np.ones_like(x), x, z, x * x, x * z, z * z], axis=1) * self.area_mm2[order, None]
        none = np.zeros((1, 6))
        flat, above = (np.concatenate([none, np.cumsum(m, axis=0)]) for m in (moments, moments * gap[:, None]))
        return gap, flat, above


def overlap(
    indentor: Indentor, place: tuple[float, ...], touch: Touch, surface: FingertipSurface, length_mm: float
) -> Overlap:
    """Of an indentor at a place along its axes, over a pulp of some length."""
    phi = np.linspace(_SIDE_RAD, np.pi - _SIDE_RAD, _AROUND)
    z = np.linspace(0.0, length_mm, _ALONG)
    x, y = surface.section(phi, z[:, None])
    at = {X: x, Z: np.broadcast_to(z[:, None], x.shape)}
    area = np.abs(np.gradient(x, axis=1)) * (z[1] - z[0])
    at_mm = np.stack([at[X].ravel(), at[Z].ravel()])
    return Overlap(_gap_mm(indentor, place, touch, at, y).ravel(), at_mm, area.ravel())


@dataclass(frozen=True)
class Squeezed:
    """Places in the tissue, mm: (n, m) gaps from the skin above to the indentor about it, (n,) from skin to bone.

    weight: (m,) of what is about a place, with sum 1.
    """

    gap_mm: Array
    weight: Array
    thickness_mm: Array

    def strain(self, past_touch_mm: float) -> Array:
        """(n,) how far the indentor comes into the tissue there, over its thickness."""
        strain = np.maximum(past_touch_mm - self.gap_mm, 0.0) @ self.weight / self.thickness_mm
        return np.asarray(np.minimum(strain, _MOST_STRAIN))


def squeezed(
    indentor: Indentor,
    place: tuple[float, ...],
    touch: Touch,
    at_mm: Array,
    surface: FingertipSurface,
    bone_fraction: float,
) -> Squeezed:
    """At (n, 3) places of the tissue, straight up and down; beside the bone it ends level with its axis.

    A place feels what comes down beside it as far away as it lies below the skin, the less the farther.
    """
    about = np.stack(np.meshgrid(*[_ABOUT] * len(indentor.axes))).reshape(len(indentor.axes), -1)
    weight = np.prod(1 - np.abs(about), axis=0)
    weight /= weight.sum()
    if not len(at_mm):
        return Squeezed(np.zeros((0, len(weight))), weight, np.ones(0))
    x, deep, z = at_mm.T
    _, y = surface.section(surface.angle_at(x, z), z)
    beside_mm = dict(zip(indentor.axes, (y - deep)[:, None] * about[:, None], strict=True))
    felt = {axis: mm[:, None] + beside_mm.get(axis, 0.0) for axis, mm in ((X, x), (Z, z))}
    gap = _gap_mm(indentor, place, touch, felt, y[:, None])
    bone_x, bone_y = surface.section(surface.angle_at(x / bone_fraction, z), z)
    beside = np.abs(bone_x - x / bone_fraction) > _BESIDE_MM
    return Squeezed(gap, weight, y - np.where(beside, 0.0, bone_fraction * bone_y))


def _gap_mm(
    indentor: Indentor, place: tuple[float, ...], touch: Touch, at_mm: dict[int, Array], y_mm: Array
) -> Array:
    """From the skin at some places, of any form, up to the indentor at first touch."""
    offset = np.stack([at_mm[axis] - mm for axis, mm in zip(indentor.axes, place, strict=True)])
    height_mm = indentor.evaluate(offset.reshape(len(offset), -1)).height_mm.reshape(offset.shape[1:])
    return np.asarray(touch.height_mm + height_mm - y_mm)
