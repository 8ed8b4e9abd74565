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


class Secant(NamedTuple):
    """Numbers of the secant modulus at a receptor.

    The load gathers where tissue is squeezed most and leaves what lies beside it, the more the stiffer the skin is
    over what lies below. A receptor's share is depth over thickness there, over that of the press.
    """

    gather: float
    gather_depth: float
    gather_share: float
    gather_width: float
    leave: float
    roof: float
    bend: float
    strain: float
    strain_depth: float
    strain_share: float
    strain_roof: float
    strain_confined: float

    def geometric(self, press: Press, share: Array) -> Array:
        """(n,) logarithm of the modulus of tissue that does not stiffen, of receptors' (n,) shares."""
        gather = self.gather * press.depth**self.gather_depth * share**self.gather_share
        moved = gather * press.width**self.gather_width - self.leave * press.depth
        return np.asarray(press.roof**self.roof * moved + self.bend * press.bend)

    def strained(self, press: Press, share: Array) -> Array:
        """(n,) by what times the stiffening, and 1, the law multiplies."""
        shape = press.roof**self.strain_roof * np.exp(self.strain_confined * press.confined)
        return np.asarray(self.strain * press.depth**self.strain_depth * share**self.strain_share * shape)


FORCE = Force(0.2121, 1.845, 0.8738, -0.6237, 1.012, 1.341, 0.2931, 0.5755, 12.26, 2.71, 0.9846)
SECANT = Secant(1.553, 0.9756, 2.567, 0.3795, 0.9106, 0.8271, 0.5301, 13.63, 2.488, 8.068, -0.5168, 1.311)

FORCE_ERROR, SED_ERROR = 0.08, 0.3
"""None was larger, relative, against references to 2 mm, those at other moduli too; SED the highest receptor's."""


def log_force(numbers: Force, stiffening: float | Array, press: Press) -> Array:
    """Logarithm of force over that of the linear twin."""
    return numbers.log(numbers.geometric(press), numbers.strained(press), stiffening)


def log_secant(numbers: Secant, stiffening: float | Array, press: Press, share: Array) -> Array:
    """(n,) logarithm of stress and energy over the linear twin's."""
    return np.asarray(numbers.geometric(press, share) + np.log1p(stiffening * numbers.strained(press, share)))


def force_factor(stiffening: float, press: Press) -> float:
    """Force over that of the linear twin at the same depth."""
    return float(np.exp(log_force(FORCE, stiffening, press)))


def secant(stiffening: float, press: Press, share: Array) -> Array:
    """(n,) stress and energy over the linear twin's at receptors' (n,) shares of a press."""
    return np.asarray(np.exp(log_secant(SECANT, stiffening, press, share)))
