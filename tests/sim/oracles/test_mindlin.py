"""A sphere pressed on a half-space, then moved along it, beside Cattaneo's and Mindlin's solution.

As in the closed form (Johnson, *Contact Mechanics*, 1985, Eq. 7.40-7.43) pressure and shear do not interact, as
between two bodies of one material, and Poisson's ratio is 0, so that no skin moves across the shear.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.contact.friction import FrictionState, at_rest, solve_increment
from sim.contact.indentor import BOTH
from sim.contact.patch import Patch, Y
from sim.contact.planes import Gathered
from sim.contact.points import ContactPose
from sim.contact.shapes import parse_shape
from sim.models.halfspace import surface_compliance

Array = NDArray[np.float64]

RADIUS_MM, DEPTH_MM, FRICTION = 10.0, 0.05, 0.3
SHEAR_MPA, POISSON = 1.0, 0.0
ACROSS, PRESSED_IN = 15, 12
"""Numbers of nodes across the patch, whose half-width is 1.2 contact radii, and of increments of the press."""

PARTS_OF_SLIDING = (0.2, 0.4, 0.6, 0.8)


@dataclass(frozen=True)
class Row:
    """Forces after a tangential displacement, and the closed form's."""

    of_sliding: float  # displacement relative to that at which the whole contact slides
    force: float  # N
    tangential: float  # N
    closed_force: float
    closed_tangential: float
    residual: float


def rows() -> Iterator[Row]:
    """Press in increments over which the contact's radius grows evenly, then slide."""
    radius = np.sqrt(RADIUS_MM * DEPTH_MM)
    patch = _half_space(1.2 * radius)
    gathered = Gathered(patch)
    sphere = parse_shape(f"sphere:{RADIUS_MM}")
    closed = 16 / 3 * SHEAR_MPA / (2 * (1 - POISSON)) * np.sqrt(RADIUS_MM) * DEPTH_MM**1.5
    # 1 − ν for a rigid indentor: F = 8/3 G / (1 − ν) √R d^1.5
    sliding_mm = 3 * FRICTION * closed * (2 - POISSON) / (16 * radius * SHEAR_MPA)
    state = at_rest(patch, ContactPose(sphere, (0.0, 0.0), 0.0, DEPTH_MM), FRICTION)
    for k in range(1, PRESSED_IN + 1):
        pose = ContactPose(sphere, (0.0, 0.0), -DEPTH_MM * (k / PRESSED_IN) ** 2, DEPTH_MM)
        state = solve_increment(patch, pose, state, between_nodes=False, gathered=gathered)
    for part in PARTS_OF_SLIDING:  # shear that only grows: increments make no difference
        pose = _pose(sphere, part * sliding_mm)
        state = solve_increment(patch, pose, state, between_nodes=False, gathered=gathered)
        yield _row(state, part, closed)


def _row(state: FrictionState, part: float, closed: float) -> Row:
    tangential = FRICTION * closed * (1 - (1 - part) ** 1.5)
    return Row(
        part,
        state.normal_force,
        float(state.force[0].sum()),
        closed,
        tangential,
        state.residual,
    )


def _pose(sphere: object, x_mm: float) -> ContactPose:
    return ContactPose(sphere, (x_mm, 0.0), -DEPTH_MM, DEPTH_MM)  # type: ignore[arg-type]


def _half_space(half_mm: float) -> Patch:
    """Return a flat patch of nodes, each at the center of an evenly loaded square."""
    line = np.linspace(-half_mm, half_mm, ACROSS)
    z, x = (values.ravel() for values in np.meshgrid(line, line, indexing="ij"))
    half = np.full((len(x), 2), 0.5 * (line[1] - line[0]))
    compliance = surface_compliance(np.stack([x, z], axis=1), half, (*BOTH, Y), SHEAR_MPA, POISSON)
    n = len(x)
    compliance[: 2 * n, 2 * n :] = compliance[2 * n :, : 2 * n] = 0.0
    position = np.stack([x, np.zeros_like(x), z], axis=1)
    return Patch(position, 4 * half.prod(axis=1), (ACROSS, ACROSS), (*BOTH, Y), compliance=compliance)


def test_a_sphere_moved_sideways_agrees_with_cattaneo_and_mindlin() -> None:
    found = list(rows())
    assert len(found) == len(PARTS_OF_SLIDING)
    for row in found:
        assert row.residual < 1e-8
        assert row.force == pytest.approx(row.closed_force, rel=0.01)
        assert row.tangential == pytest.approx(row.closed_tangential, rel=0.02)
