"""Newton's method for the rest of a pressed body: the energy falls at every step.

A rigid convex profile makes the penalty's energy concave in the slip along its curve. Where that makes the tangent
indefinite the term is left out: what remains majorises the energy of the contact, so that its step still descends.
"""

import numpy as np
from numpy.typing import NDArray

from studies.finite_strain.solver.body import Body
from studies.finite_strain.solver.factor import NotPositiveDefiniteError
from studies.finite_strain.solver.rigid import PENALTY_MPA_PER_MM, Rigid, Skin, Touching, clearance, energy, touching

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

TOLERANCE = 1e-6
"""Largest unbalanced nodal force over the sum of the contact's."""

_MOST_STEPS, _SHORTEST = 60, 1e-4
_ASIDE = 4  # steps for which the curvature is left out where it made the tangent indefinite
_SHIFTS = (0.0, 1e-4, 1e-2, 1.0)
_ROUND_OFF = 1e-13


class NotFoundError(RuntimeError):
    """No equilibrium within the steps allowed."""


def rest(body: Body, skin: Skin, rigid: Rigid, start: Array) -> tuple[Array, Touching]:
    """Unknowns at rest under an indentor, from unknowns near them, and what bears. Raises NotFoundError."""
    a = start
    now = body.energy(a) + energy(skin, rigid, a)
    exact_from = 0
    for k in range(_MOST_STEPS):
        force, stiffness = body.tangent(a)
        touched = touching(skin, rigid, a)
        unbalanced = force + _push(skin, touched, body.size)
        if np.abs(unbalanced).max() <= TOLERANCE * max(touched.load_n.sum(), 1e-9):
            return a, touched
        curves = k >= exact_from
        step, curved = _descent(body, stiffness, skin, touched, unbalanced, curves)
        exact_from = k + _ASIDE if curves and not curved else exact_from
        a, now = _along(body, skin, rigid, (a, now), step, float(step @ unbalanced))
    raise NotFoundError(f"no equilibrium within {_MOST_STEPS} steps")


def followed(body: Body, skin: Skin, rigid: Rigid, start: Array, nodes: Ints) -> Array:
    """Unknowns from which to look for rest: nodes that bore go with an indentor that moved, even where they pull."""
    found = clearance(skin, rigid, start)
    load = -PENALTY_MPA_PER_MM * skin.area_mm2[nodes] * found.mm[nodes]
    bound = Touching(nodes, load, found.gradient[nodes], found.hessian[nodes])
    force, stiffness = body.tangent(start)
    return start + _descent(body, stiffness, skin, bound, force + _push(skin, bound, body.size), curves=False)[0]


def _along(
    body: Body, skin: Skin, rigid: Rigid, at: tuple[Array, float], step: Array, slope: float
) -> tuple[Array, float]:
    a, now = at
    length = 1.0
    while length > _SHORTEST:
        there = a + length * step
        found = body.energy(there) + energy(skin, rigid, there)
        if found <= now + 1e-4 * length * slope + _ROUND_OFF * abs(now):
            return there, found
        length *= 0.5
    raise NotFoundError("the energy falls no more")


def _push(skin: Skin, touched: Touching, size: int) -> Array:
    """(size,) the gradient of the penalty's energy: minus the forces on the nodes."""
    dof = skin.unknown[touched.nodes]
    values = -touched.load_n[:, None] * touched.normal
    free = dof >= 0
    return np.asarray(np.bincount(dof[free], values[free], size), float)


def _descent(
    body: Body, stiffness: Array, skin: Skin, touched: Touching, unbalanced: Array, curves: bool
) -> tuple[Array, bool]:
    """A step that descends, and whether it knows of the profile's curvature."""
    outer = PENALTY_MPA_PER_MM * skin.area_mm2[touched.nodes, None, None]
    outer = outer * touched.normal[:, :, None] * touched.normal[:, None]
    bent = touched.load_n[:, None, None] * touched.curvature
    attempts = [(outer - bent, 0.0)] if curves else []
    for blocks, shift in [*attempts, *((outer, shift) for shift in _SHIFTS)]:
        values = _with(body, stiffness, skin.unknown[touched.nodes], blocks, shift)
        try:
            return -body.factor.solve(values, unbalanced), blocks is not outer
        except NotPositiveDefiniteError:
            continue
    raise NotFoundError("the tangent is indefinite")


def _with(body: Body, stiffness: Array, unknown: Ints, blocks: Array, shift: float) -> Array:
    """The stiffness's values with (n, 3, 3) nodal blocks and a part of its diagonal added."""
    values = stiffness.copy()
    row, column = np.broadcast_arrays(unknown[:, :, None], unknown[:, None, :])
    upper = (row >= 0) & (column >= row)
    np.add.at(values, body.pattern.at(row[upper], column[upper]), blocks[upper])
    values[body.pattern.diagonal] += shift * np.abs(stiffness[body.pattern.diagonal])
    return values
