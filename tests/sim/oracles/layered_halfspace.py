"""Strain in a half-space under an elastic layer, below a concentrated normal force of 1 N: Hankel's integrals.

Sources: Sneddon (1951), *Fourier Transforms*, ch. 9–10; the state (u, v, s22, s12) of each wave number, through the
layer as in `layer.py`, into the two solutions that decay in the half-space. Our y points up.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, null_space
from scipy.special import j0, j1, jv

from sim.fem.elements import lame
from sim.measures.measures import Elastic
from studies.verification.box import Box, BoxBody, graded
from studies.verification.layer import Layer, rate

Array = NDArray[np.float64]

SKIN = Layer(0.4, 1.0, 2)
BELOW = 0.1
"""E of the half-space over that of the layer, as dermis and fat over epidermis."""

_DECAYS = 20.0  # wave numbers times depth, beyond which nothing arrives: e⁻²⁰
_WAVES = 400


def strain_below(r: Array, depth_mm: float, layer: Layer, below: Elastic) -> Array:
    """(n, 4) radial, hoop and vertical strain and engineering shear at distances from the axis, below the layer."""
    k, weight = np.polynomial.legendre.leggauss(_WAVES)
    k, weight = (k + 1) * _DECAYS / depth_mm / 2, weight * _DECAYS / depth_mm / 2
    states = np.array([_state(one, depth_mm, layer, below) for one in k])
    slopes = np.array([rate(one, below.young, below.poisson) @ state for one, state in zip(k, states, strict=True)])
    shear = below.young / (2 * (1 + below.poisson))
    weight, kr = weight * k / (2 * np.pi), np.outer(r, k)
    both = j0(kr) @ (weight * k * states[:, 0])  # radial and hoop together
    apart = -jv(2, kr) @ (weight * k * states[:, 0])
    vertical, sheared = j0(kr) @ (weight * slopes[:, 1]), j1(kr) @ (weight * states[:, 3]) / shear
    return np.stack([(both + apart) / 2, (both - apart) / 2, vertical, sheared], axis=-1)


def _state(k: float, depth_mm: float, layer: Layer, below: Elastic) -> Array:
    """(4,) displacements and stresses at a depth, under a pressure of 1 at the top."""
    through = rate(k, below.young, below.poisson)
    decaying = null_space((through - k * np.eye(4)) @ (through - k * np.eye(4)), rcond=1e-9)
    at_top = expm(rate(k, layer.young, below.poisson) * layer.thickness_mm) @ decaying
    mixed = np.linalg.solve(at_top[2:], [-1.0, 0.0])
    return np.asarray(expm(through * (layer.thickness_mm - depth_mm)) @ (decaying @ mixed))


def energy_density(strain: Array, material: Elastic) -> Array:
    """(n,) SED of (n, 4) strains."""
    radial, hoop, vertical, sheared = strain.T
    mu, kappa = (float(v) for v in lame(np.array(material.young), material.poisson))
    volume = radial + hoop + vertical
    squares = radial**2 + hoop**2 + vertical**2 + sheared**2 / 2
    return np.asarray((kappa - 2 * mu / 3) / 2 * volume**2 + mu * squares)


def on_elements(spacing_mm: float, size_mm: float, poisson: float) -> tuple[Array, Array, Array, float]:
    """x, z and (n, 6) strains at the centroids of the row above 0.8 mm, in a quarter of a box, and that row's depth.

    As on the finger: two elements in the layer, rows of 0.2 mm below it; finer in proportion to the spacing.
    """
    rows = np.arange(0.0, 1.2 + 1e-9, 0.2 * spacing_mm / 0.17)
    rows = np.linspace(0.0, 1.2, max(7, len(rows)) // 3 * 3 + 1)
    deep = 1.2 + graded(0.2, rows[1], size_mm - 1.2, growth=1.25)[1:]
    y = -np.append(rows, deep)[::-1]
    x = graded(1.7, spacing_mm, size_mm, growth=1.25)
    box = Box(x, y, x)
    young = np.where(box.centroids[:, 1] > -SKIN.thickness_mm, SKIN.young, BELOW)
    body = BoxBody(box, young, poisson)
    load = np.zeros((1, len(box.nodes), 3))
    load[0, box.number[0, -1, 0], 1] = -0.25
    depth = -box.centroids[:, 1]
    row = depth[depth < 0.8].max()
    here = np.flatnonzero(np.isclose(depth, row) & (box.centroids[:, [0, 2]].max(axis=1) < 1.5))
    strain = body.strain(body.solve(load)[0], here)
    return box.centroids[here, 0], box.centroids[here, 2], strain, float(row)
