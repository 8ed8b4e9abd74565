"""How much more tissue bears at finite strain than its linear twin: low-order functions, fitted to references.

Every layer is Yeoh's, w = ½ μ (i + a i²) with i = Ī₁ − 3 (Yeoh 1993), a its stiffening. A factor's logarithm is what
finite strain alone makes of it, and a multiple of ln(1 + a × a strain). `python -m studies.stiffening.fitted` prints
the numbers; how near: `docs/meet.md`; what was tried: `docs/decisions/0030-tissue-that-stiffens.md`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Press(NamedTuple):
    """A press as numbers without unit; each may be an array."""

    depth: float | Array  # past first touch, over the tissue's thickness
    width: float | Array  # mean area of overlap with the undeformed skin, over the thickness squared
    length: float | Array  # radius of the overlap along its longer way, over the thickness
    confined: float | Array  # by what the overlap's volume grows less than by the square of depth, as powers: edges
    bend: float | Array  # depth past first touch times the skin's mean curvature
    roof: float | Array  # stiffness of the epidermis, stretched, over that of what lies below it, squeezed


class Force(NamedTuple):
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

    def geometric(self, press: Press) -> Array:
        """Logarithm of the factor of tissue that does not stiffen."""
        lost = self.arch * press.roof**self.arch_roof * press.length**self.arch_length
        squeeze = self.squeeze * press.depth**self.squeeze_depth * press.width**self.squeeze_width
        return np.asarray(squeeze - lost * np.tanh(self.arch_slope * press.bend / lost))

    def strained(self, press: Press) -> Array:
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

    def geometric(self, press: Press, felt: Felt) -> Array:
        """(n,) energy over half the shear modulus of tissue that does not stiffen."""
        share = felt.squeeze / press.depth
        moved = np.exp(press.depth * (self.gather * share - self.leave))
        layers = felt.soft**self.squeeze_soft * press.roof**self.squeeze_roof
        return np.asarray(felt.linear * moved + self.squeeze * layers * share * _beyond_small(felt.squeeze))

    def strained(self, press: Press, felt: Felt) -> Array:
        """(n,) by what times the stiffening, and 1, the law multiplies."""
        invariant = 4 * felt.squeeze**2 + _beyond_small(felt.squeeze)
        return np.asarray(self.strain * invariant * np.exp(FORCE.strain_confined * press.confined))


def _beyond_small(squeeze: Array) -> Array:
    """(n,) by what Ī₁ − 3 of tissue squeezed between plates, (λ − 1/λ)², is more than 4 (1 − λ)²."""
    stretch = 1 - squeeze
    return np.asarray((stretch - 1 / stretch) ** 2 - 4 * squeeze**2)


FORCE = Force(0.2121, 1.845, 0.8738, -0.6237, 1.012, 1.341, 0.2931, 0.5755, 12.26, 2.71, 0.9846)
ENERGY = Energy(2.56, 1.94, 0.4056, 0.9115, 0.3392, 2.281)

FORCE_ERROR, SED_ERROR = 0.1, 0.22
"""None was larger, relative, against references to 2 mm, those at other moduli too; SED the highest receptor's."""

_NONE = 1e-12


def log_force(numbers: Force, stiffening: float | Array, press: Press) -> Array:
    """Logarithm of force over that of the linear twin."""
    return numbers.log(numbers.geometric(press), numbers.strained(press), stiffening)


def log_energy(numbers: Energy, stiffening: float | Array, press: Press, felt: Felt) -> Array:
    """(n,) logarithm of energy over the linear twin's."""
    law = 0.5 * np.log1p(stiffening * numbers.strained(press, felt))
    return np.asarray(np.log(_over_linear(numbers, press, felt)) + law)


def _over_linear(numbers: Energy, press: Press, felt: Felt) -> Array:
    return np.asarray(numbers.geometric(press, felt) / np.maximum(felt.linear, _NONE))


def force_factor(stiffening: float, press: Press) -> float:
    """Force over that of the linear twin at the same depth."""
    return float(np.exp(log_force(FORCE, stiffening, press)))


def strain_and_stress(stiffening: float, press: Press, felt: Felt) -> tuple[Array, Array]:
    """(n,) each over the linear twin's; energy has both: the law is all stress, of the rest each has the root."""
    strain = np.sqrt(_over_linear(ENERGY, press, felt))
    return strain, strain * np.sqrt(1 + stiffening * ENERGY.strained(press, felt))
