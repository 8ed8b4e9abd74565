"""What of a scene says how wrong a model will be in it, and how much of the skin it needs; nothing is solved."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.config.fingertip_config import FingertipConfig, Geometry, MeshSpec
from sim.contact.indentor import ACROSS, ALONG, BOTH, Indentor
from sim.contact.patch import X, Z
from sim.contact.touch import Touch, first_touch
from sim.finger.surface import FingertipSurface
from sim.models.pressing import refuse_beside_the_finger, refuse_meaningless
from sim.models.tops import keep_tops
from sim.speed_and_error.candidates import SHARES

Array = NDArray[np.float64]

_AXES = {ALONG: "along", ACROSS: "across", BOTH: "both"}
_GRID_MM = 0.1
_TOUCHED = 0.9  # contact goes so far of how far the indentor would lie below the undeformed skin
_MARGIN_MM = (0.3, 0.5)  # a row of nodes and a half, across and along


def family_of(indentor: Indentor) -> str:
    """The shapes that an indentor is measured with."""
    return _family(indentor.axes, sharp=indentor.sharp)


def _family(axes: tuple[int, ...], *, sharp: bool) -> str:
    return f"{_AXES[axes]}, {'sharp' if sharp else 'smooth'}"


FAMILIES = tuple(_family(axes, sharp=sharp) for axes in _AXES for sharp in (False, True))


@dataclass(frozen=True)
class Situation:
    """A shape over a place, and how deep."""

    shape: str
    axes: tuple[int, ...]
    sharp: bool
    place_mm: float  # of first touch, from the pad's centre
    depth_mm: float | None  # past first touch; None: a force, and nobody knows yet
    reach_mm: tuple[float, float] | None  # half-widths of the skin that may be touched; None with the depth

    @classmethod
    def of(
        cls,
        indentor: Indentor,
        x_mm: float,
        z_mm: float | None,
        doi_mm: float | None,
        config: FingertipConfig,
        reference: Literal["contact", "apex"] = "contact",
    ) -> "Situation":
        """By the undeformed skin alone. Raises ModelRangeError for a place that an indentor cannot have."""
        refuse_beside_the_finger(config, x_mm, z_mm)
        refuse_meaningless(indentor, x_mm, z_mm)
        skin = _skin(config.geometry)
        centre = np.array([0.0, config.receptor_plane_mm])
        at = {X: x_mm, Z: centre[1] if z_mm is None else z_mm}
        place = tuple(float(at[axis]) for axis in indentor.axes)
        touch = first_touch(indentor, place, skin)
        middle = [{X: 0.0, Z: centre[1]}[axis] for axis in indentor.axes]
        zero_mm = touch.height_mm
        if reference == "apex":
            zero_mm = float(np.nanmax(skin.ridge(skin.ridge.x)))
        depth = None if doi_mm is None else doi_mm - (zero_mm - touch.height_mm)
        reach = None if depth is None else _reach(indentor, place, touch, depth, skin, centre)
        away = float(np.hypot.reduce(np.array(touch.at_mm) - middle))
        return cls(indentor.name, indentor.axes, indentor.sharp, away, depth, reach)

    @property
    def family(self) -> str:
        """The shapes that it is measured with."""
        return _family(self.axes, sharp=self.sharp)

    @property
    def share(self) -> float:
        """The smallest of SHARES whose patch holds the skin that may be touched; the whole where none is known to."""
        if self.reach_mm is None:
            return SHARES[-1]
        own = MeshSpec()
        sides = (own.round_patch_mm,) * 2 if self.axes == BOTH else (own.patch_x_mm, own.patch_z_mm)
        needed = max(reach / side for reach, side in zip(self.reach_mm, sides, strict=True))
        return next((share for share in SHARES if needed <= share), SHARES[-1])


@lru_cache(maxsize=2)
def _skin(geometry: Geometry) -> FingertipSurface:
    skin = FingertipSurface.fit(geometry)
    keep_tops(skin)
    return skin


def _reach(
    indentor: Indentor, place: tuple[float, ...], touch: Touch, depth_mm: float, skin: FingertipSurface, centre: Array
) -> tuple[float, float]:
    """How far from the pad's centre, along x and z, the indentor may touch."""
    (x0, x1), (z0, z1) = skin.ridge.x[[0, -1]], skin.crest.x[[0, -1]]
    x, z = np.meshgrid(np.arange(x0, x1, _GRID_MM), np.arange(z0, z1, _GRID_MM))
    where = np.stack([x.ravel(), z.ravel()])
    offset = np.stack([{X: where[0], Z: where[1]}[axis] for axis in indentor.axes]) - np.array(place)[:, None]
    below = indentor.evaluate(offset).height_mm + touch.height_mm - depth_mm < skin.height(*where)
    if not below.any():
        return 0.0, 0.0
    far = _TOUCHED * np.abs(where[:, below] - centre[:, None]).max(axis=1) + _MARGIN_MM
    return float(far[0]), float(far[1])
