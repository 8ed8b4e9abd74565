"""Force and energy at finite strain relative to linear tissue: low-order functions, fitted to references.

Every layer follows Yeoh's law, w = ½ μ (i + a i²) with i = Ī₁ − 3 (Yeoh 1993) and stiffening a. A factor's logarithm
is the effect of finite strain alone plus a multiple of ln(1 + a × a strain). Errors:
`docs/validation/tissue.md`; alternatives: `docs/decisions/0030-tissue-that-stiffens.md`.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig, Tissue
from sim.contact.patch import X, Z
from sim.errors import ModelRangeError
from sim.measures.measures import BY_NAME
from sim.units import PSEUDO_E_EPIDERMIS

if TYPE_CHECKING:
    from sim.contact.first_contact import FirstTouch
    from sim.contact.indentor import Indentor
    from sim.finger.surface import FingertipSurface

Array = NDArray[np.float64]


class DimensionlessPress(NamedTuple):
    """Press as dimensionless numbers; each may be an array."""

    depth: float | Array  # depth past first touch / thickness of the tissue
    width: float | Array  # mean area of overlap with the undeformed skin / thickness²
    length: float | Array  # radius of the overlap along its longer axis / thickness
    confined: float | Array  # 2 − the power with which the overlap's volume grows with depth; positive at edges
    bend: float | Array  # depth past first touch times the skin's mean curvature
    roof: float | Array  # stiffness of the stretched epidermis / that of the compressed tissue below it


class ForceFactor(NamedTuple):
    """Coefficients of the force factor.

    A stiff skin is an arch that flattens, at first by its curvature alone; the stiffer it is, and the shorter the
    press, the more force it loses. Tissue is squeezed against the bone. The law's strain grows where edges confine
    it.
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
        """Return the logarithm of the factor for tissue that does not stiffen."""
        lost = self.arch * press.roof**self.arch_roof * press.length**self.arch_length
        squeeze = self.squeeze * press.depth**self.squeeze_depth * press.width**self.squeeze_width
        return np.asarray(squeeze - lost * np.tanh(self.arch_slope * press.bend / lost))

    def strained(self, press: DimensionlessPress) -> Array:
        """Return the strain by which the stiffening is multiplied in the law."""
        confined = np.exp(self.strain_confined * press.confined)
        return np.asarray(self.strain * press.depth**self.strain_depth * confined)

    def log(self, geometric: Array, strained: Array, stiffening: float | Array) -> Array:
        """Return the logarithm of the factor from its two parts."""
        return np.asarray(geometric + self.law * np.log1p(stiffening * strained))


class ReceptorPress(NamedTuple):
    """Press at the receptors as dimensionless numbers, each (n,)."""

    squeeze: Array  # penetration of the indentor into the tissue above and below / its thickness
    soft: Array  # stiffness of all below the epidermis / that of the receptor's layer
    linear: Array  # energy in linear tissue / half the shear modulus: Ī₁ − 3 where strain is small


class Energy(NamedTuple):
    """Coefficients of the energy at a receptor.

    Energy of linear tissue gathers where the press is deepest and decreases beside it. The energy of squeezed tissue
    at finite strain beyond small strain, which linear tissue lacks, is added. The law's strain is that of the
    squeezed tissue, and grows where edges confine it, as in the force.
    """

    gather: float
    leave: float
    squeeze: float
    squeeze_soft: float
    squeeze_roof: float
    strain: float

    def geometric(self, press: DimensionlessPress, receptors: ReceptorPress) -> Array:
        """Return (n,) energy over half the shear modulus for tissue that does not stiffen."""
        share = receptors.squeeze / press.depth
        moved = np.exp(press.depth * (self.gather * share - self.leave))
        layers = receptors.soft**self.squeeze_soft * press.roof**self.squeeze_roof
        return np.asarray(receptors.linear * moved + self.squeeze * layers * share * _beyond_small(receptors.squeeze))

    def strained(self, press: DimensionlessPress, receptors: ReceptorPress) -> Array:
        """Return (n,) strain by which the stiffening is multiplied in the law."""
        invariant = 4 * receptors.squeeze**2 + _beyond_small(receptors.squeeze)
        return np.asarray(self.strain * invariant * np.exp(FORCE.strain_confined * press.confined))


def _beyond_small(squeeze: Array) -> Array:
    """Return (n,) the excess of Ī₁ − 3 of tissue squeezed between plates, (λ − 1/λ)², over 4 (1 − λ)²."""
    stretch = 1 - squeeze
    return np.asarray((stretch - 1 / stretch) ** 2 - 4 * squeeze**2)


FORCE = ForceFactor(0.2121, 1.845, 0.8738, -0.6237, 1.012, 1.341, 0.2931, 0.5755, 12.26, 2.71, 0.9846)
ENERGY = Energy(2.56, 1.94, 0.4056, 0.9115, 0.3392, 2.281)

FORCE_ERROR, SED_ERROR = 0.1, 0.22
"""Largest relative errors against references to 2 mm, at other moduli too; SED is that of the highest receptor."""

_NONE = 1e-12


def log_force(numbers: ForceFactor, stiffening: float | Array, press: DimensionlessPress) -> Array:
    """Return the logarithm of force / force of linear tissue."""
    return numbers.log(numbers.geometric(press), numbers.strained(press), stiffening)


def force_factor(stiffening: float, press: DimensionlessPress) -> float:
    """Return force / force of linear tissue at the same depth."""
    return float(np.exp(log_force(FORCE, stiffening, press)))


def strain_and_stress(stiffening: float, press: DimensionlessPress, receptors: ReceptorPress) -> tuple[Array, Array]:
    """Return (n,) strain and stress relative to linear tissue: the law acts on stress alone, the rest on both."""
    strain = np.sqrt(ENERGY.geometric(press, receptors) / np.maximum(receptors.linear, _NONE))
    return strain, strain * np.sqrt(1 + stiffening * ENERGY.strained(press, receptors))


# --- overlap ---
#
# The volume in which the indentor overlaps the undeformed skin measures the width of a press, whatever the tissue.

_AROUND, _ALONG = 81, 121
_BESIDE_MM = 1e-6
_LEAST_DEPTH_MM = 0.1  # a shallower overlap covers too few points to have a form, and is a paraboloid anyway
_NONE_MM3 = 1e-9  # so that an overlap finer than the points' spacing counts as a paraboloid
_ABOUT = np.linspace(-1, 1, 43)[1::2]  # midpoints of intervals / depth below the skin
_MOST_STRAIN = 0.9  # more than in any allowed press
_SIDE_RAD = 0.05  # beyond a section's widest points; the pulp lies above them


@dataclass(frozen=True)
class Overlap:
    """Skin points: vertical gaps (n,) at first touch, positions across and along (2, n), in mm; areas (n,) in mm²."""

    gap_mm: Array
    at_mm: Array
    area_mm2: Array

    def volume_mm3(self, past_touch_mm: float) -> float:
        """Return the volume between indentor and undeformed skin at a depth past first touch."""
        return float(self._moments(past_touch_mm)[0])

    def long_radius_mm(self, past_touch_mm: float) -> float:
        """Return the radius of the paraboloid of the same extent along the longer axis: ⟨r²⟩ = R d / 3."""
        deep_mm = max(past_touch_mm, _LEAST_DEPTH_MM)
        volume, *others = self._moments(deep_mm)
        x, z, xx, xz, zz = (other / (volume + _NONE_MM3) for other in others)
        across, both, along = xx - x * x, xz - x * z, zz - z * z
        longest_mm2 = 0.5 * (across + along) + np.hypot(0.5 * (across - along), both)
        return float(3 * (longest_mm2 + self.area_mm2.mean() / 12) / deep_mm)  # adds the extent of one cell

    def power(self, past_touch_mm: float) -> float:
        """Return the power with which the volume grows with depth: 2 for a paraboloid, less where an edge ends it."""
        deep_mm = max(past_touch_mm, _LEAST_DEPTH_MM)
        whole, half = self.volume_mm3(deep_mm), self.volume_mm3(0.5 * deep_mm)
        return float(np.log2((whole + _NONE_MM3) / (half + _NONE_MM3 / 4)))

    def _moments(self, past_touch_mm: float) -> Array:
        """Return (6,) the volume, and its moments x, z, x², xz, z²."""
        gap, flat, above = self._by_gap
        k = int(np.searchsorted(gap, past_touch_mm))
        return np.asarray(past_touch_mm * flat[k] - above[k])

    @cached_property
    def _by_gap(self) -> tuple[Array, Array, Array]:
        """(m,) ascending gaps, and cumulative moments (m + 1, 6) of areas and of areas × gaps."""
        order = np.argsort(self.gap_mm)[: np.isfinite(self.gap_mm).sum()]
        gap, (x, z) = self.gap_mm[order], self.at_mm[:, order]
        moments = np.stack([np.ones_like(x), x, z, x * x, x * z, z * z], axis=1) * self.area_mm2[order, None]
        none = np.zeros((1, 6))
        flat, above = (np.concatenate([none, np.cumsum(m, axis=0)]) for m in (moments, moments * gap[:, None]))
        return gap, flat, above


def overlap(
    indentor: "Indentor",
    reference_mm: tuple[float, ...],
    touch: "FirstTouch",
    surface: "FingertipSurface",
    length_mm: float,
) -> Overlap:
    """Return the overlap of an indentor at a position along its axes, over a pulp of some length."""
    phi = np.linspace(_SIDE_RAD, np.pi - _SIDE_RAD, _AROUND)
    z = np.linspace(0.0, length_mm, _ALONG)
    x, y = surface.section(phi, z[:, None])
    at = {X: x, Z: np.broadcast_to(z[:, None], x.shape)}
    area = np.abs(np.gradient(x, axis=1)) * (z[1] - z[0])
    at_mm = np.stack([at[X].ravel(), at[Z].ravel()])
    return Overlap(_gap_mm(indentor, reference_mm, touch, at, y).ravel(), at_mm, area.ravel())


@dataclass(frozen=True)
class Squeezed:
    """Points in the tissue: gaps (n, m) from surrounding skin to the indentor, skin-to-bone thickness (n,), in mm.

    weight: (m,) weights of the surrounding skin points, with sum 1.
    """

    gap_mm: Array
    weight: Array
    thickness_mm: Array

    def strain(self, past_touch_mm: float) -> Array:
        """Return (n,) the indentor's penetration into the tissue at each point / its thickness."""
        strain = np.maximum(past_touch_mm - self.gap_mm, 0.0) @ self.weight / self.thickness_mm
        return np.asarray(np.minimum(strain, _MOST_STRAIN))


def squeezed(
    indentor: "Indentor",
    reference_mm: tuple[float, ...],
    touch: "FirstTouch",
    at_mm: Array,
    surface: "FingertipSurface",
    bone_fraction: float,
) -> Squeezed:
    """Return the vertical compression at (n, 3) points of the tissue, which ends level with the axis beside the bone.

    A point averages the skin within its own depth on either side, with weights that fall with distance.
    """
    about = np.stack(np.meshgrid(*[_ABOUT] * len(indentor.axes))).reshape(len(indentor.axes), -1)
    weight = np.prod(1 - np.abs(about), axis=0)
    weight /= weight.sum()
    if not len(at_mm):
        return Squeezed(np.zeros((0, len(weight))), weight, np.ones(0))
    x, deep, z = at_mm.T
    _, y = surface.section(surface.angle_at(x, z), z)
    beside_mm = dict(zip(indentor.axes, (y - deep)[:, None] * about[:, None], strict=True))
    sampled = {axis: mm[:, None] + beside_mm.get(axis, 0.0) for axis, mm in ((X, x), (Z, z))}
    gap = _gap_mm(indentor, reference_mm, touch, sampled, y[:, None])
    bone_x, bone_y = surface.section(surface.angle_at(x / bone_fraction, z), z)
    beside = np.abs(bone_x - x / bone_fraction) > _BESIDE_MM
    return Squeezed(gap, weight, y - np.where(beside, 0.0, bone_fraction * bone_y))


def _gap_mm(
    indentor: "Indentor", reference_mm: tuple[float, ...], touch: "FirstTouch", at_mm: dict[int, Array], y_mm: Array
) -> Array:
    """Return the gaps from skin points, of any shape, up to the indentor at first touch (mm)."""
    offset = np.stack([at_mm[axis] - mm for axis, mm in zip(indentor.axes, reference_mm, strict=True)])
    height_mm = indentor.evaluate(offset.reshape(len(offset), -1)).height_mm.reshape(offset.shape[1:])
    return np.asarray(touch.height_mm + height_mm - y_mm)


# --- stiffened ---
#
# The factors depend on shape, position, depth and layers alone, so that force at a depth costs what a linear one
# does.


class Stiffened(NamedTuple):
    """Corrections of a linear press for tissue that stiffens: force by a factor, receptors by local ones.

    squeeze: compression at the receptors (n,). below: Young's modulus of all below the epidermis over the epidermis'.
    force: over linear tissue's at the same depth; exactly 1 where tissue is linear.
    """

    stiffening: float
    press: DimensionlessPress
    squeeze: Array
    below: float
    force: float

    @property
    def linear(self) -> bool:
        """Whether nothing is corrected."""
        return not self.press.depth

    def measures(self, linear: dict[str, Array], young_ratio: Array, poisson: float) -> dict[str, Array]:
        """Return the 18 measures (n,) from those of linear tissue, by factors of strain and stress.

        young_ratio: (n,) E / E(epidermis) at the receptors.
        """
        if self.linear:
            return linear
        receptors = self.at_receptors(linear["sed"], young_ratio, poisson)
        strain, stress = strain_and_stress(self.stiffening, self.press, receptors)
        return {
            name: value * (strain ** BY_NAME[name].kind.strain_power * stress ** BY_NAME[name].kind.stress_power)
            for name, value in linear.items()
        }

    def at_receptors(self, sed: Array, young_ratio: Array, poisson: float) -> ReceptorPress:
        """Return the press at the receptors from the SED of linear tissue in pseudo-units."""
        half_shear_modulus = PSEUDO_E_EPIDERMIS * young_ratio / (4 * (1 + poisson))
        return ReceptorPress(self.squeeze, self.below / young_ratio, sed / half_shear_modulus)


LINEAR_TISSUE = Stiffened(0.0, DimensionlessPress(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), np.zeros(0), 1.0, 1.0)

ROOFS = (0.35, 4.5)
"""Range in the prior of layers; values beyond it count as its end. The compared fingers had 0.55 to 2.3."""


@dataclass(frozen=True)
class Under:
    """Indentor over tissue, with its reference point at a position along its axes."""

    config: FingertipConfig
    surface: "FingertipSurface"
    indentor: "Indentor"
    place: tuple[float, ...]
    touch: "FirstTouch"
    _cached: dict[bytes, Squeezed] = field(default_factory=dict)

    def at(self, past_touch_mm: float, receptor_mm: Array) -> Stiffened:
        """Return the correction at a depth past first touch, with receptors at (n, 3) points."""
        stiffening = self.config.tissue.finite_stiffening
        if stiffening is None or past_touch_mm <= 0:
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
        """Mean curvature of the skin at the apex (1/mm)."""
        apex = self.surface.apex
        return 0.5 * (1 / apex.lateral_radius_mm + 1 / apex.axial_radius_mm)

    @cached_property
    def _overlap(self) -> Overlap:
        return overlap(self.indentor, self.place, self.touch, self.surface, self.config.geometry.length_mm)

    def _squeezed(self, receptor_mm: Array) -> Squeezed:
        name = receptor_mm.tobytes()
        if name not in self._cached:
            self._cached[name] = squeezed(
                self.indentor, self.place, self.touch, receptor_mm, self.surface, self.config.tissue.bone_fraction
            )
        return self._cached[name]


def thickness_mm(config: FingertipConfig, surface: "FingertipSurface") -> float:
    """Return the thickness of tissue between skin and bone at the pulp's apex in the receptor plane (mm)."""
    _, height_mm, _ = surface.parameters(config.receptor_plane_mm)
    return float(height_mm) * (1 - config.tissue.bone_fraction)


def young_below(tissue: Tissue, thick_mm: float) -> float:
    """Return Young's modulus of all below the epidermis, in series, over the epidermis'."""
    below_mm = thick_mm - tissue.epidermis_mm
    dermis_mm = min(tissue.dermis_mm, below_mm)
    return below_mm / (dermis_mm / tissue.e_dermis + (below_mm - dermis_mm) / tissue.e_fat)


def roof(tissue: Tissue, thick_mm: float) -> float:
    """Return modulus × thickness of the epidermis over (modulus of all below it × thickness of the tissue)."""
    return tissue.epidermis_mm / (thick_mm * young_below(tissue, thick_mm))


# --- linear tissue only ---


def refuse_stiffening(tissue: Tissue, what: str) -> None:
    """Raise ModelRangeError at finite strain."""
    if tissue.finite_stiffening is not None:
        raise ModelRangeError(
            f'finger.tissue.strain = "finite" (stiffening = {tissue.stiffening:g}): must be "small" without '
            f"stiffening, since {what} is linear",
            "linear_alone",
        )
