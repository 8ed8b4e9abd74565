"""A press of tissue that stiffens, as its linear twin is corrected: force by a factor, receptors by local ones.

The factors hang on shape, place, depth and layers alone, so that force at a depth costs what a linear one does.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.config.fingertip_config import FingertipConfig, Tissue
from sim.config.units import PSEUDO_E_EPIDERMIS
from sim.contact.indentor import Indentor
from sim.contact.touch import Touch
from sim.finger.surface import FingertipSurface
from sim.measures.measures import STRAINS, STRESSES
from sim.models.stiffening.at_finite_strain import Felt, Press, force_factor, strain_and_stress
from sim.models.stiffening.overlap import Overlap, Squeezed, overlap, squeezed

Array = NDArray[np.float64]

_ENERGY, _CUBED = "sed", "third"


class Stiffened(NamedTuple):
    """Of a press: the tissue's law, the press as numbers without unit, and how receptors (n,) are squeezed.

    below: Young's modulus of all below the epidermis, over the epidermis'. force: over the linear twin's at the same
    depth; exactly 1 where tissue is linear.
    """

    stiffening: float
    press: Press
    squeeze: Array
    below: float
    force: float

    def measures(self, linear: dict[str, Array], young_ratio: Array, poisson: float) -> dict[str, Array]:
        """The 18 measures (n,) from a linear twin's: strains, stresses and energy have a factor each at a receptor.

        young_ratio: (n,) E / E(epidermis) at the receptors.
        """
        if self.stiffening == 0:
            return linear
        felt = self.felt(linear[_ENERGY], young_ratio, poisson)
        strain, stress = strain_and_stress(self.stiffening, self.press, felt)
        factor = dict.fromkeys(STRAINS, strain) | dict.fromkeys(STRESSES, stress)
        factor |= {_ENERGY: strain * stress, _CUBED: stress**3}
        return {name: linear[name] * factor[name] for name in linear}

    def felt(self, sed: Array, young_ratio: Array, poisson: float) -> Felt:
        """By receptors, of the linear twin's SED in pseudo-units."""
        half_shear_modulus = PSEUDO_E_EPIDERMIS * young_ratio / (4 * (1 + poisson))
        return Felt(self.squeeze, self.below / young_ratio, sed / half_shear_modulus)


LINEAR_TISSUE = Stiffened(0.0, Press(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), np.zeros(0), 1.0, 1.0)

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
        squeeze = self._squeezed(receptor_mm).strain(past_touch_mm)
        below = young_below(self.config.tissue, thick)
        return Stiffened(stiffening, press, squeeze, below, force_factor(stiffening, press))

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


def young_below(tissue: Tissue, thick_mm: float) -> float:
    """Young's modulus of all below the epidermis, in series, over the epidermis'."""
    below_mm = thick_mm - tissue.epidermis_mm
    dermis_mm = min(tissue.dermis_mm, below_mm)
    return below_mm / (dermis_mm / tissue.e_dermis + (below_mm - dermis_mm) / tissue.e_fat)


def roof(tissue: Tissue, thick_mm: float) -> float:
    """Modulus times thickness of the epidermis, over that of all below it, times that of the tissue."""
    return tissue.epidermis_mm / (thick_mm * young_below(tissue, thick_mm))
