"""How much more tissue bears at finite strain than its linear twin: low-order functions, fitted to references.

Every layer is Yeoh's, w = ½ μ (i + a i²) with i = Ī₁ − 3 (Yeoh 1993), a its stiffening. A factor's logarithm is what
finite strain alone makes of it, and a multiple of ln(1 + a × a strain). `python -m studies.stiffening.fitted` prints
the numbers; how near: `docs/validation/stiffening.md`; what was tried: `docs/decisions/0030-tissue-that-stiffens.md`.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig, Tissue
from sim.contact.indentor import Indentor
from sim.contact.patch import X, Z
from sim.contact.touch import FirstTouch
from sim.errors import ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.measures.measures import STRAINS, STRESSES
from sim.units import PSEUDO_E_EPIDERMIS

Array = NDArray[np.float64]


class DimensionlessPress(NamedTuple):
    """A press as numbers without unit; each may be an array."""

    depth: float | Array  # past first touch, over the tissue's thickness
    width: float | Array  # mean area of overlap with the undeformed skin, over the thickness squared
    length: float | Array  # radius of the overlap along its longer way, over the thickness
    confined: float | Array  # by what the overlap's volume grows less than by the square of depth, as powers: edges
    bend: float | Array  # depth past first touch times the skin's mean curvature
    roof: float | Array  # stiffness of the epidermis, stretched, over that of what lies below it, squeezed


Press = DimensionlessPress  # so named in pickles of 0.1


class ForceFactor(NamedTuple):
    """Numbers of the force's factor.

    A stiff skin is an arch that flattens, at first by its curvature alone; the stiffer it is, and the shorter the
    press, the more it loses. Tissue is squeezed against the bone. The law's strain grows where edges confine it.
    """

    arch: float
    arch_slope: float
    arch_roof: float
    arch_length: float
    squeeze: float
    squeeze_depth: float
    squeeze_width: float
    law: float
    strain: float
    strain_depth: float
    strain_confined: float

    def geometric(self, press: DimensionlessPress) -> Array:
        """Logarithm of the factor of tissue that does not stiffen."""
        lost = self.arch * press.roof**self.arch_roof * press.length**self.arch_length
        squeeze = self.squeeze * press.depth**self.squeeze_depth * press.width**self.squeeze_width
        return np.asarray(squeeze - lost * np.tanh(self.arch_slope * press.bend / lost))

    def strained(self, press: DimensionlessPress) -> Array:
        """By what times the stiffening, and 1, the law multiplies."""
        confined = np.exp(self.strain_confined * press.confined)
        return np.asarray(self.strain * press.depth**self.strain_depth * confined)

    def log(self, geometric: Array, strained: Array, stiffening: float | Array) -> Array:
        """Logarithm of the factor, of its two parts."""
        return np.asarray(geometric + self.law * np.log1p(stiffening * strained))


class Felt(NamedTuple):
    """What receptors feel of a press, as numbers without unit; each (n,)."""

    squeeze: Array  # how far the indentor comes into the tissue there, over its thickness
    soft: Array  # stiffness of all below the epidermis, over that of the receptor's layer
    linear: Array  # energy of the linear twin, over half the shear modulus: Ī₁ − 3 where strain is small


class Energy(NamedTuple):
    """Numbers of the energy at a receptor.

    What linear tissue has there gathers where the press is deepest and leaves what lies beside it. What squeezed
    tissue has at finite strain beyond small strain comes on top: linear tissue knows nothing of that. The law's
    strain is the squeezed tissue's, and grows where edges confine it as the force's does.
    """

    gather: float
    leave: float
    squeeze: float
    squeeze_soft: float
    squeeze_roof: float
    strain: float

    def geometric(self, press: DimensionlessPress, felt: Felt) -> Array:
        """(n,) energy over half the shear modulus of tissue that does not stiffen."""
        share = felt.squeeze / press.depth
        moved = np.exp(press.depth * (self.gather * share - self.leave))
        layers = felt.soft**self.squeeze_soft * press.roof**self.squeeze_roof
        return np.asarray(felt.linear * moved + self.squeeze * layers * share * _beyond_small(felt.squeeze))

    def strained(self, press: DimensionlessPress, felt: Felt) -> Array:
        """(n,) by what times the stiffening, and 1, the law multiplies."""
        invariant = 4 * felt.squeeze**2 + _beyond_small(felt.squeeze)
        return np.asarray(self.strain * invariant * np.exp(FORCE.strain_confined * press.confined))


def _beyond_small(squeeze: Array) -> Array:
    """(n,) by what Ī₁ − 3 of tissue squeezed between plates, (λ − 1/λ)², is more than 4 (1 − λ)²."""
    stretch = 1 - squeeze
    return np.asarray((stretch - 1 / stretch) ** 2 - 4 * squeeze**2)


FORCE = ForceFactor(0.2121, 1.845, 0.8738, -0.6237, 1.012, 1.341, 0.2931, 0.5755, 12.26, 2.71, 0.9846)
ENERGY = Energy(2.56, 1.94, 0.4056, 0.9115, 0.3392, 2.281)

FORCE_ERROR, SED_ERROR = 0.1, 0.22
"""Largest relative errors against references to 2 mm, at other moduli too; SED is that of the highest receptor."""

_NONE = 1e-12


def log_force(numbers: ForceFactor, stiffening: float | Array, press: DimensionlessPress) -> Array:
    """Logarithm of force over that of the linear twin."""
    return numbers.log(numbers.geometric(press), numbers.strained(press), stiffening)


def log_energy(numbers: Energy, stiffening: float | Array, press: DimensionlessPress, felt: Felt) -> Array:
    """(n,) logarithm of energy over the linear twin's."""
    law = 0.5 * np.log1p(stiffening * numbers.strained(press, felt))
    return np.asarray(np.log(_over_linear(numbers, press, felt)) + law)


def _over_linear(numbers: Energy, press: DimensionlessPress, felt: Felt) -> Array:
    return np.asarray(numbers.geometric(press, felt) / np.maximum(felt.linear, _NONE))


def force_factor(stiffening: float, press: DimensionlessPress) -> float:
    """Force over that of the linear twin at the same depth."""
    return float(np.exp(log_force(FORCE, stiffening, press)))


def strain_and_stress(stiffening: float, press: DimensionlessPress, felt: Felt) -> tuple[Array, Array]:
    """(n,) each over the linear twin's; energy has both: the law is all stress, of the rest each has the root."""
    strain = np.sqrt(_over_linear(ENERGY, press, felt))
    return strain, strain * np.sqrt(1 + stiffening * ENERGY.strained(press, felt))


# --- overlap ---
#
# Where an indentor would lie below a skin that did not give: how wide a press is, whatever the tissue.

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
    indentor: Indentor, place: tuple[float, ...], touch: FirstTouch, surface: FingertipSurface, length_mm: float
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
    touch: FirstTouch,
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
    indentor: Indentor, place: tuple[float, ...], touch: FirstTouch, at_mm: dict[int, Array], y_mm: Array
) -> Array:
    """From the skin at some places, of any form, up to the indentor at first touch."""
    offset = np.stack([at_mm[axis] - mm for axis, mm in zip(indentor.axes, place, strict=True)])
    height_mm = indentor.evaluate(offset.reshape(len(offset), -1)).height_mm.reshape(offset.shape[1:])
    return np.asarray(touch.height_mm + height_mm - y_mm)


# --- stiffened ---
#
# A press of tissue that stiffens, as its linear twin is corrected: force by a factor, receptors by local ones.
#
# The factors hang on shape, place, depth and layers alone, so that force at a depth costs what a linear one does.

_ENERGY, _CUBED = "sed", "third"


class Stiffened(NamedTuple):
    """Of a press: the tissue's law, the press as numbers without unit, and how receptors (n,) are squeezed.

    below: Young's modulus of all below the epidermis, over the epidermis'. force: over the linear twin's at the same
    depth; exactly 1 where tissue is linear.
    """

    stiffening: float
    press: DimensionlessPress
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


LINEAR_TISSUE = Stiffened(0.0, DimensionlessPress(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), np.zeros(0), 1.0, 1.0)

ROOFS = (0.35, 4.5)
"""Range of the prior of layers; values beyond it count as its end. The compared fingers had 0.55 to 2.3."""


@dataclass(frozen=True)
class Under:
    """An indentor at a place along its axes, over tissue."""

    config: FingertipConfig
    surface: FingertipSurface
    indentor: Indentor
    place: tuple[float, ...]
    touch: FirstTouch
    _seen: dict[bytes, Squeezed] = field(default_factory=dict)

    def at(self, past_touch_mm: float, receptor_mm: Array) -> Stiffened:
        """So far past first touch, seen by receptors at (n, 3) places."""
        stiffening = self.config.tissue.stiffening
        if stiffening == 0 or past_touch_mm <= 0:
            return LINEAR_TISSUE
        thick = thickness_mm(self.config, self.surface)
        press = DimensionlessPress(
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


# --- linear alone ---
#
# What is only known of linear tissue.


def refuse_stiffening(tissue: Tissue, what: str) -> None:
    """Raises ModelRangeError where tissue stiffens."""
    if tissue.stiffening > 0:
        raise ModelRangeError(
            "finger.tissue.stiffening = {stiffening:g}: must be 0, since {what} is linear",
            code="linear_alone",
            stiffening=tissue.stiffening,
            what=what,
        )
