"""How much more tissue bears at finite strain than its linear twin: low-order functions, fitted to references.

Every layer is Yeoh's, w = ½ μ (i + a i²) with i = Ī₁ − 3 (Yeoh 1993), a its stiffening. A stiff skin is an arch that
flattens (softer, by its curvature, the less the wider), tissue is squeezed against the bone (stiffer, by depth and
width), and the law adds its own. `python -m studies.stiffening.fitted` prints the numbers; how near: `docs/meet.md`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Press(NamedTuple):
    """A press as numbers without unit."""

    depth: float  # past first touch, over the tissue's thickness
    width: float  # mean area of overlap with the undeformed skin, over the thickness squared
    bend: float  # depth past first touch times the skin's mean curvature


class Numbers(NamedTuple):
    """Of a factor: what the arch takes, what the squeeze gives, what the law gives, and what depth alone does."""

    arch: float
    arch_bend: float
    arch_width: float
    squeeze: float
    squeeze_depth: float
    squeeze_width: float
    law: float
    law_strain: float
    law_depth: float
    law_width: float
    depth: float


FORCE = Numbers(0.3925, 0.3754, -0.37, 1.2531, 1.4354, 0.2135, 1.0, 3.3017, 2.1185, 0.187, 0.0)
SECANT = Numbers(-0.3808, 0.1005, 0.3166, 4.9048, 1.4677, 0.0845, 0.9791, 8.8083, 2.0, 0.0, -2.9131)

FORCE_ERROR, SED_ERROR = 0.08, 0.43
"""None was larger, relative, against references to 2 mm, those at other moduli too; SED the highest receptor's."""


def force_factor(stiffening: float, press: Press) -> float:
    """Force over that of the linear twin at the same depth."""
    return float(np.exp(log_factor(FORCE, stiffening, press, np.array(press.depth))))


def secant(stiffening: float, press: Press, local: Array) -> Array:
    """(n,) stress and energy over the linear twin's at places where the tissue is squeezed by (n,) shares."""
    return np.asarray(np.exp(log_factor(SECANT, stiffening, press, local)))


def log_factor(numbers: Numbers, stiffening: float, press: Press, squeezed: Array) -> Array:
    """(…) logarithm of a factor where depth over the thickness of what is squeezed is (…)."""
    n = numbers
    arch = n.arch * np.tanh(press.bend / n.arch_bend) * press.width**n.arch_width
    squeeze = n.squeeze * squeezed**n.squeeze_depth * press.width**n.squeeze_width
    strain = n.law_strain * squeezed**n.law_depth * press.width**n.law_width
    return np.asarray(squeeze - arch + n.law * np.log1p(stiffening * strain) + n.depth * press.depth)
