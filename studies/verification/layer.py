"""Layers bonded to each other and to a rigid base under a sinusoidal normal pressure, in plane strain.

Sources: Johnson, *Contact Mechanics* (1985), §5.8, and Bentall & Johnson (1968), "An elastic strip in plane rolling
contact", Int. J. Mech. Sci. 10, 637–663, for one layer; any number of layers by the propagator matrix of the state
(u, v, s22, s12) through each (Gilbert & Backus 1966, Geophysics 31, 326–332).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from sim.fem.elements import Element, lame
from studies.verification.box import SLAB, Box, BoxBody, tributary

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Layer:
    """One layer, named from the skin downwards."""

    thickness_mm: float
    young: float
    rows: int  # elements through it

    def refined(self, by: int) -> "Layer":
        """The same with more rows."""
        return Layer(self.thickness_mm, self.young, self.rows * by)


TISSUE = (Layer(0.4, 1.0, 1), Layer(0.8, 0.1, 2), Layer(1.8, 0.1, 4))
"""Epidermis, dermis and fat of the finger, on bone, in rows of about 0.4 mm: to be refined."""


def one_layer_compliance(k: float, layer: Layer, poisson: float) -> float:
    """Surface displacement per pressure, mm/MPa, at k rad/mm, in closed form."""
    depth = k * layer.thickness_mm
    plane = layer.young / (1 - poisson**2)
    above = (3 - 4 * poisson) * np.sinh(2 * depth) - 2 * depth
    below = (3 - 4 * poisson) * np.cosh(2 * depth) + 2 * depth**2 + 5 - 12 * poisson + 8 * poisson**2
    return float(2 / (plane * k) * above / below)


def layers_compliance(k: float, layers: tuple[Layer, ...], poisson: float) -> float:
    """The same for any layers: from the base, where u = v = 0, to the surface, where s12 = 0 and s22 = −1.

    With u, s12 ∝ sin kx and v, s22 ∝ cos kx, d/dy of the state is constant within a layer.
    """
    propagator = np.eye(4)
    for layer in reversed(layers):
        propagator = expm(rate(k, layer.young, poisson) * layer.thickness_mm) @ propagator
    at_base = np.linalg.solve(propagator[2:, 2:], [-1.0, 0.0])
    return float(-propagator[1, 2:] @ at_base)


def rate(k: float, young: float, poisson: float) -> Array:
    """(4, 4) d/dy of the state (u, v, s22, s12) over the state, 1/mm."""
    mu, kappa = (float(v) for v in lame(np.array(young), poisson))
    first = kappa - 2 * mu / 3
    side = first + 2 * mu
    return np.array(
        [
            [0, k, 0, 1 / mu],
            [-first * k / side, 0, 1 / side, 0],
            [0, 0, 0, -k],
            [k * k * (side - first**2 / side), 0, k * first / side, 0],
        ]
    )


def compliance(
    k: float, layers: tuple[Layer, ...], poisson: float, spacing_mm: float, element: Element = "bbar"
) -> float:
    """The same on our elements: half a wavelength between planes of symmetry."""
    half = np.pi / k
    x = np.linspace(0, half, max(2, round(half / spacing_mm)) + 1)
    steps = np.concatenate([np.full(c.rows, c.thickness_mm / c.rows) for c in layers])
    box = Box(x, np.append(0, -np.cumsum(steps))[::-1], SLAB)
    young = np.repeat([c.young for c in layers], [c.rows for c in layers])[::-1]
    body = BoxBody(box, np.tile(young, len(x) - 1), poisson, element)
    push = np.cos(k * x) * tributary(x) * np.sinc(0.5 * k * x[1] / np.pi) ** 2  # ∫ cos kx N dx
    load = np.zeros((1, len(box.nodes), 3))
    load[0, box.number[:, -1, 0], 1] = -push
    v = body.solve(load)[0, box.number[:, -1, 0], 1]
    return float(-(push @ v) / (0.5 * half))
