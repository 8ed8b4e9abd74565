"""The part of a patch that takes part in a contact, and the skin as an indentor sees it; against definitions."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.contact.first_contact import first_touch
from sim.contact.indentor import Indentor
from sim.contact.patch import Patch, X, Y, Z
from sim.contact.planes import ContactRegion, FrozenPlanes, Gathered
from sim.contact.points import PARTS, ContactPoints, ContactPose, Survey
from sim.contact.profiles import Bar, SinusoidalStep
from sim.contact.shapes import parse_shape
from sim.contact.solver import PassedState, solve_contact
from sim.models.fingertip import Fingertip
from sim.models.pressing import PlacedIndentor

Array = NDArray[np.float64]

ROWS, COLUMNS = 4, 6
NODES = ContactPoints(np.array([1, 7, 8, 13, 20]), np.zeros(0, np.int64))
MIXED = ContactPoints(np.array([1, 7, 8, 13, 20]), np.array([3, 4, 17, 40]))
EVERY_NODE = ContactPoints(np.arange(ROWS * COLUMNS), np.zeros(0, np.int64))


def make_patch(axes: tuple[int, ...]) -> Patch:
    """A grid of nodes whose compliance is any symmetric positive definite matrix."""
    n = ROWS * COLUMNS
    z, x = np.meshgrid(np.arange(ROWS) * 0.3, np.arange(COLUMNS) * 0.17, indexing="ij")
    position = np.stack([x.ravel(), -0.05 * (x.ravel() - 0.4) ** 2, z.ravel()], axis=1)
    half = np.random.default_rng(0).normal(size=(len(axes) * n, len(axes) * n))
    compliance = half @ half.T
    return Patch(position, np.ones(n), (ROWS, COLUMNS), axes, compliance=0.5 * (compliance + compliance.T))


@pytest.fixture(scope="module", params=[(X, Y), (X, Z, Y)], ids=["x", "x and z"])
def patch(request: pytest.FixtureRequest) -> Patch:
    return make_patch(request.param)


def shares(points: ContactPoints, patch: Patch) -> Array:
    """(k, n) of the nodes in the points."""
    found = np.zeros((len(points), len(patch)))
    found[np.arange(len(points.nodes)), points.nodes] = 1
    between = zip(*np.divmod(points.between, PARTS - 1), strict=True)
    for row, (segment, place) in enumerate(between, len(points.nodes)):
        along = (place + 1) / PARTS
        first, second = patch.segments[segment]
        found[row, first], found[row, second] = 1 - along, along
    return found


def by_definition(points: ContactPoints, patch: Patch) -> Array:
    """(m, k, m, k) mm/N among points."""
    m, n, p = len(patch.axes), len(patch), shares(points, patch)
    return np.einsum("ki,aibj,lj->akbl", p, patch.compliance.reshape(m, n, m, n), p)


@pytest.mark.parametrize("points", [NODES, MIXED, EVERY_NODE], ids=["nodes", "mixed", "all nodes"])
def test_points_move_one_another_as_their_nodes_do(patch: Patch, points: ContactPoints) -> None:
    region, whole = ContactRegion(Gathered(patch), points), by_definition(points, patch)
    m, k = len(patch.axes), len(points)
    scale, rng = np.abs(whole).max(), np.random.default_rng(1)
    for some in ([0, 2], [2, 3, k - 1], list(range(k)), [1]):
        force = rng.normal(size=(m, len(some))) * (rng.random((m, len(some))) < 0.7)
        moved = np.einsum("akbl,bl->ak", whole[:, :, :, some], force)
        np.testing.assert_allclose(region.moved_by(force, np.array(some)), moved, atol=1e-12 * scale, rtol=0)


def test_planes_are_as_compliant_as_their_normals_say(patch: Patch) -> None:
    shape = "sphere:1" if len(patch.axes) == 3 else "step:1"
    pose = ContactPose(parse_shape(shape), (0.3,) * (len(patch.axes) - 1), -0.1, 0.1)
    planes = FrozenPlanes(pose, ContactRegion(Gathered(patch), MIXED), np.zeros((len(patch.axes), len(MIXED))), False)
    assert (planes.slope != 0).any()
    whole = by_definition(MIXED, patch)
    along = np.einsum("ak,akbl,bl->kl", planes.normal, whole, planes.normal)
    solution = planes.solve(np.ones(len(MIXED), dtype=bool))
    assert solution is not None
    slack = planes.gap_mm + along @ solution.multipliers
    scale = np.abs(planes.gap_mm).max()
    assert len(solution.active)
    np.testing.assert_allclose(slack[solution.active], 0.0, atol=1e-9 * scale)
    assert slack.min() > -1e-9 * scale
    moved = np.einsum("akbl,bl->ak", whole, planes.normal * solution.multipliers)
    np.testing.assert_allclose(solution.u, moved, atol=1e-12 * np.abs(moved).max(), rtol=0)


@pytest.mark.parametrize("lower_mm", [0.0, 0.05, 0.2, 0.5])
@pytest.mark.parametrize("profile", [Bar(0.4), SinusoidalStep("1")])
def test_a_survey_holds_for_other_heights(profile: Bar | SinusoidalStep, lower_mm: float) -> None:
    # Beyond 0.3 mm what was not looked at may be touched: then it looks again.
    patch = make_patch((X, Y))
    u = 0.01 * np.random.default_rng(2).normal(size=(2, len(patch)))
    pose = ContactPose(Indentor.along(profile), (0.4,), -0.02, 0.1)
    lower = replace(pose, height_mm=pose.height_mm - lower_mm)
    kept = Survey.of(pose, patch, u, between=True).near(lower, 0.03)
    anew = Survey.of(lower, patch, u, between=True).near(lower, 0.03)
    assert np.array_equal(kept.nodes, anew.nodes)
    assert np.array_equal(kept.between, anew.between)
    assert len(anew.between) or not lower_mm


# --- on the finger ---


@pytest.fixture(scope="module")
def placed(finger: Fingertip) -> PlacedIndentor:
    indentor = parse_shape("bar:1.5")
    touch = first_touch(indentor, (0.0,), finger.surface)
    return PlacedIndentor(indentor, (0.0,), touch.height_mm, touch, finger.model)


def test_a_state_on_the_way_is_the_same_contact(placed: PlacedIndentor) -> None:
    patch, pose = placed.model.patch, placed.pose(0.1)
    passed = solve_contact(patch, pose, between_nodes=True, target=1e-4, on_the_way=True)
    whole = solve_contact(patch, pose, between_nodes=True, target=1e-4)
    assert isinstance(passed, PassedState)
    assert not isinstance(whole, PassedState)
    assert passed.passes == whole.passes
    np.testing.assert_allclose(passed.displacement, whole.displacement, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(passed.gap, whole.gap)
    assert passed.residual == pytest.approx(whole.residual, rel=0.5)  # looked at over fewer points
    assert passed.residual <= whole.residual * (1 + 1e-9)
    deeper = placed.pose(0.15)
    onward = [solve_contact(patch, deeper, start, between_nodes=True) for start in (passed, whole)]
    assert onward[0].passes == onward[1].passes
    np.testing.assert_allclose(onward[0].force, onward[1].force, rtol=0, atol=1e-14)
