"""A press of tissue that stiffens, as its linear twin is corrected: force by a factor, receptors by secant moduli.

The factors hang on shape, place, depth and layers alone, so that force at a depth costs what a linear one does.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.config.fingertip_config import FingertipConfig, Tissue
from sim.contact.indentor import Indentor
from sim.contact.touch import Touch
from sim.finger.surface import FingertipSurface
from sim.measures.measures import STRESSES
from sim.models.stiffening.at_finite_strain import Press, force_factor, secant
from sim.models.stiffening.overlap import Overlap, Squeezed, overlap, squeezed

Array = NDArray[np.float64]

_CUBED = "third"


class Stiffened(NamedTuple):
    """Of a press: the tissue's law, the press as numbers without unit, and receptors' (n,) shares of its depth.

    force: over the linear twin's at the same depth; exactly 1 where tissue is linear.
    """

    stiffening: float
    press: Press
    share: Array
    force: float

    def measures(self, linear: dict[str, Array]) -> dict[str, Array]:
        """The 18 measures (n,) from a linear twin's: strains stay, stresses and energy follow local secant moduli."""
        if self.stiffening == 0:
            return linear
        stiffer = secant(self.stiffening, self.press, self.share)
        return linear | {name: linear[name] * stiffer ** (3 if name == _CUBED else 1) for name in STRESSES}


LINEAR_TISSUE = Stiffened(0.0, Press(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), np.zeros(0), 1.0)

ROOFS = (0.35, 4.5)
"""What a prior of layers holds; beyond it counts as its end, of the fingers compared it was 0.55 to 2.3."""


@dataclass(frozen=True)
class Under:
    """An indentor at a place along its axes, over tissue."""

    config: FingertipConfig
    surface: FingertipSurface
    indentor: Indentor
    place: tuple[float, ...]
    touch: Touch
    _seen: dict[bytes, Squeezed] = field(default_factory=dict)

    def at(self, past_touch_mm: float, receptor_mm: Array) -> Stiffened:
        """So far past first touch, seen by receptors at (n, 3) places."""
        stiffening = self.config.tissue.stiffening
        if stiffening == 0 or past_touch_mm <= 0:
            return LINEAR_TISSUE
        thick = thickness_mm(self.config, self.surface)
        press = Press(
            depth=past_touch_mm / thick,
            width=self._overlap.volume_mm3(past_touch_mm) / (past_touch_mm * thick**2),
            length=self._overlap.long_radius_mm(past_touch_mm) / thick,
            confined=2.0 - self._overlap.power(past_touch_mm),
            bend=past_touch_mm * self._curvature_per_mm,
            roof=float(np.clip(roof(self.config.tissue, thick), *ROOFS)),
        )
        share = self._squeezed(receptor_mm).share(past_touch_mm) / press.depth
        return Stiffened(stiffening, press, share, force_factor(stiffening, press))

    @cached_property
    def _curvature_per_mm(self) -> float:
        """Mean of the skin's at the apex."""
        apex = self.surface.apex
        return 0.5 * (1 / apex.lateral_radius_mm + 1 / apex.axial_radius_mm)

    @cached_property
    def _overlap(self) -> Overlap:
        return overlap(self.indentor, self.place, self.touch, self.surface, self.config.geometry.length_mm)

    def _squeezed(self, receptor_mm: Array) -> Squeezed:
        name = receptor_mm.tobytes()
        if name not in self._seen:
            self._seen[name] = squeezed(
                self.indentor, self.place, self.touch, receptor_mm, self.surface, self.config.tissue.bone_fraction
            )
        return self._seen[name]


def thickness_mm(config: FingertipConfig, surface: FingertipSurface) -> float:
    """Of the tissue between skin and bone in the receptor plane, where the pulp is highest there."""
    _, height_mm, _ = surface.parameters(config.receptor_plane_mm)
    return float(height_mm) * (1 - config.tissue.bone_fraction)


def roof(tissue: Tissue, thick_mm: float) -> float:
    """Modulus times thickness of the epidermis, over that of all below it, in series, times that of the tissue."""
    below_mm = thick_mm - tissue.epidermis_mm
    dermis_mm = min(tissue.dermis_mm, below_mm)
    e_below = below_mm / (dermis_mm / tissue.e_dermis + (below_mm - dermis_mm) / tissue.e_fat)
    return tissue.epidermis_mm / (thick_mm * e_below)
