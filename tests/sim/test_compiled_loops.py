"""Compiled loops against what they are by definition; as machine code, and as Python reads the same lines."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.contact.compiled import factors, planes_and_residual, points_between_nodes, profile_curves, skin_compliance
from sim.contact.profiles import STEEPEST_SLOPE

Array = NDArray[np.float64]
Loops = Callable[..., Any]

POINTS, NODES, ROOM = 7, 5, 6


def both_ways(loops: Loops) -> list[Any]:
    """Compiled, and uncompiled where nothing is called that only machine code can call."""
    return [pytest.param(loops, id="compiled"), pytest.param(loops.py_func, id="python")]  # type: ignore[attr-defined]


def some_skin(m: int) -> skin_compliance.SkinCompliance:
    rng = np.random.default_rng(m)
    half = rng.normal(size=(m * ROOM, m * ROOM))
    carriers = np.array([[0, 3, 4, 1, 2, 0, 3], [0, 3, 4, 2, 3, 1, 4]])
    share = np.array([0, 0, 0, 0.25, 0.5, 0.75, 0.25])
    return skin_compliance.SkinCompliance((half @ half.T).reshape(m, ROOM, m, ROOM), NODES, carriers, share)


def shares(skin: skin_compliance.SkinCompliance) -> Array:
    """(k, N) of the nodes in the points."""
    found = np.zeros((POINTS, ROOM))
    for p in range(POINTS):
        found[p, skin.carriers[0, p]] += 1 - skin.share[p]
        found[p, skin.carriers[1, p]] += skin.share[p]
    return found


def among_points(skin: skin_compliance.SkinCompliance) -> Array:
    """(m, k, m, k) mm/N."""
    at = shares(skin)
    return np.einsum("ki,aibj,lj->akbl", at, skin.store, at)


@pytest.mark.parametrize("m", [1, 2, 3])
@pytest.mark.parametrize("worked", both_ways(skin_compliance.worked))
def test_work_of_forces_along_motions(worked: Loops, m: int) -> None:
    skin, rng = some_skin(m), np.random.default_rng(0)
    rows, columns = np.array([4, 0, 6]), np.array([6, 1, 3, 5])
    f, g = rng.normal(size=(m, 3)), rng.normal(size=(m, 4))
    f[0, 1] = g[0, 2] = 0.0
    whole = np.einsum("ar,arbc,bc->rc", f, among_points(skin)[:, rows][:, :, :, columns], g)
    np.testing.assert_allclose(worked(skin, rows, f, columns, g, 4), whole, rtol=1e-12, atol=1e-12)
    for width in (1, 2):
        np.testing.assert_allclose(
            worked(skin, rows, f, columns, g, width), np.tril(whole, width - 1), rtol=1e-12, atol=1e-12
        )


@pytest.mark.parametrize("m", [1, 2, 3])
@pytest.mark.parametrize("moved", both_ways(skin_compliance.moved))
def test_motion_by_forces(moved: Loops, m: int) -> None:
    skin, loaded = some_skin(m), np.array([5, 0, 2])
    force = np.random.default_rng(1).normal(size=(m, 3))
    force[-1, 1] = 0.0
    expected = np.einsum("akbl,bl->ak", among_points(skin)[:, :, :, loaded], force)
    np.testing.assert_allclose(moved(skin, loaded, force), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("m", [1, 2])
@pytest.mark.parametrize("moved_by_turns", both_ways(skin_compliance.moved_by_turns))
def test_motion_by_forces_that_turn(moved_by_turns: Loops, m: int) -> None:
    skin, rng = some_skin(m + 1), np.random.default_rng(4)
    turn, multipliers = rng.normal(size=(m, POINTS)), rng.random(POINTS)
    turn[:, [1, 4]] = multipliers[6] = 0.0
    force = np.concatenate([turn * multipliers, np.zeros((1, POINTS))])
    expected = np.einsum("akbl,bl->ak", among_points(skin), force)
    np.testing.assert_allclose(moved_by_turns(skin, turn, multipliers), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("m", [1, 2])
@pytest.mark.parametrize("before", [0, 2, 4])
@pytest.mark.parametrize("gather", both_ways(skin_compliance.gather))
def test_compliance_between_some_nodes(gather: Loops, before: int, m: int) -> None:
    n, nodes = 6, np.array([4, 1, 5, 2])
    compliance = np.random.default_rng(m).normal(size=(m * n, m * n))
    compliance += compliance.T
    of_nodes = compliance.reshape(m, n, m, n)[:, nodes][:, :, :, nodes]
    store = np.full((m, 5, m, 5), np.nan)
    store[:, :before, :, :before] = of_nodes[:, :before, :, :before]
    gather(compliance, nodes, before, store)
    np.testing.assert_array_equal(store[:, :4, :, :4], of_nodes)
    assert np.isnan(store[:, 4]).all()
    assert np.isnan(store[:, :, :, 4]).all()


@pytest.mark.parametrize("displaced", both_ways(skin_compliance.displaced))
def test_displacements_by_few_forces(displaced: Loops) -> None:
    compliance = some_skin(2).store.reshape(12, 12).copy()
    force = np.zeros((2, 6))
    force[0, 2], force[1, 5] = 0.3, -2.0
    np.testing.assert_allclose(displaced(compliance, force), (compliance @ force.ravel()).reshape(2, 6), rtol=1e-13)


# --- planes and residuals ---


@pytest.mark.parametrize("m", [1, 2])
@pytest.mark.parametrize("planes", both_ways(planes_and_residual.planes))
def test_planes_through_displaced_points(planes: Loops, m: int) -> None:
    rng = np.random.default_rng(2)
    height, slope, at = rng.normal(size=4), rng.normal(size=(m, 4)), rng.normal(size=(m + 1, 4))
    curvature = np.zeros((m, m, 4))
    curvature[m - 1, 0, 2] = -0.1
    normal, gap, curved = planes(height, slope, curvature, at)
    np.testing.assert_array_equal(normal, [*slope, -np.ones(4)])
    np.testing.assert_allclose(gap, height - (normal * at).sum(axis=0), rtol=1e-14)
    assert curved.tolist() == [False, False, True, False]


def missed_by(missed: Loops, **changed: object) -> tuple[float, float]:
    """Of two points of which the first bears and the second is 3 mm away, or as changed."""
    given: dict[str, object] = {
        "mismatch": np.zeros((2, 3)), "height": np.array([0.0, 3.0]), "slope": np.array([[0.0, 0.75]]),
        "multipliers": np.array([2.0, 0.0]), "scale_mm": 0.5,
    }  # fmt: skip
    found: tuple[float, float] = missed(*(given | changed).values())
    return found


@pytest.mark.parametrize(
    ("changed", "worst", "depth"),
    [
        ({}, 0.0, 0.0),
        ({"mismatch": np.array([[0, 0, 0], [0, 0, -0.1]])}, 0.2, 0.0),  # also of more nodes than there are points
        ({"height": np.array([0.0, -0.01])}, 0.016, 0.008),  # along the normal, which is 1.25 long
        ({"height": np.array([0.02, 3.0])}, 0.04, 0.0),  # bears without touching
        ({"multipliers": np.array([2.0, 0.4])}, 0.25, 0.0),  # 0.4 · 1.25 of 2
        ({"multipliers": np.array([2.0, -0.4])}, 0.25, 0.0),
        ({"multipliers": np.array([0.0, -0.4])}, 0.5, 0.0),  # no peak to be held against
        ({"height": np.array([np.nan, 3.0])}, np.inf, 0.0),
        ({"multipliers": np.array([2.0, np.nan])}, np.inf, 0.0),
        ({"mismatch": np.array([[np.nan, 0.0], [0.0, 0.0]])}, np.inf, 0.0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("missed", both_ways(planes_and_residual.missed))
def test_by_how_much_equilibrium_is_missed(
    missed: Loops, changed: dict[str, object], worst: float, depth: float
) -> None:
    found = missed_by(missed, **changed)
    assert found[0] == pytest.approx(worst, rel=1e-12)
    assert found[1] == pytest.approx(depth, rel=1e-12)


# --- profiles ---


def derivatives(height: Callable[[Array], Array], s: Array) -> tuple[Array, Array]:
    step = 1e-4
    low, mid, high = (height(s + d) for d in (-step, 0.0, step))
    return (high - low) / (2 * step), (high - 2 * mid + low) / step**2


@pytest.mark.parametrize("arc", both_ways(profile_curves.arc))
def test_an_arc_with_its_flank(arc: Loops) -> None:
    t = np.array([-0.3, -0.01, 0.01, 0.2, 0.4])
    height, slope, curvature = arc(t, 0.5, np.array([1.0, 1.0, 1.0, -1.0, 1.0]), 1000.0)
    np.testing.assert_allclose(height, 0.5 - np.sqrt(0.25 - np.maximum(t, 0) ** 2), rtol=1e-14)
    first, second = derivatives(lambda at: arc(at, 0.5, np.ones(5), 1000.0)[0], t)
    np.testing.assert_allclose(slope, first * [1, 1, 1, -1, 1], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(curvature, second, rtol=1e-5, atol=1e-6)
    beyond = arc(np.array([0.6]), 0.5, np.array([-1.0]), 2.0)  # the arc ends at 2 / √5 of its radius
    assert beyond[0][0] == pytest.approx(0.5 - 0.5 / np.sqrt(5) + 2 * (0.6 - 1 / np.sqrt(5)), rel=1e-13)
    assert (beyond[1][0], beyond[2][0]) == (-2.0, 0.0)
    edge = arc(np.array([-0.1, 0.0, 0.1]), 0.0, np.ones(3), 1000.0)
    np.testing.assert_allclose(edge, [[0, 0, 100], [0, 0, 1000], [0, 0, 0]])


@pytest.mark.parametrize("lean", both_ways(profile_curves.lean))
def test_a_flank_leans_to_what_is_closest(lean: Loops) -> None:
    # Below an arc's centre the tangent's foot lies where the centre sees the node; above it, it is the flank itself.
    t, y = np.array([0.1, 0.5, 0.5]), np.array([-0.05, -0.15, 0.3])
    height, slope = np.full(3, 7.0), np.full(3, 7.0)
    lean(height, slope, t, y, 0.2, np.array([1.0, -1.0, 1.0]), STEEPEST_SLOPE)
    steep = 0.5 / (0.2 + 0.15)
    np.testing.assert_allclose(height, [7.0, 0.2 - 0.2 * np.hypot(1, steep) + steep * 0.5, 0.2 - 0.2 * np.hypot(
        1, STEEPEST_SLOPE) + STEEPEST_SLOPE * 0.5], rtol=1e-13)  # fmt: skip
    np.testing.assert_allclose(slope, [7.0, -steep, STEEPEST_SLOPE], rtol=1e-13)


@pytest.mark.parametrize("flank", both_ways(profile_curves.flank))
def test_a_flank_between_levels(flank: Loops) -> None:
    k, s = np.pi / 0.45, np.array([-0.2, 0.1, 0.3, 0.44, 0.6])
    height, slope, curvature = flank(s, 0.25, k)
    np.testing.assert_allclose(height, 0.25 * (1 - np.cos(k * np.clip(s, 0, 0.45))), rtol=1e-13)
    first, second = derivatives(lambda at: flank(at, 0.25, k)[0], s)
    np.testing.assert_allclose(slope, first, atol=1e-5)
    np.testing.assert_allclose(curvature, second, atol=1e-5)
    assert (slope[0], curvature[0], slope[-1], curvature[-1]) == (0, 0, 0, 0)
    level = flank(np.array([0.0, 0.45]), 0.25, k)
    np.testing.assert_allclose(level[0], [0.0, 0.5], atol=1e-15)
    np.testing.assert_allclose(level[2], [0.25 * k * k, -0.25 * k * k])  # its ends are its own


@pytest.mark.parametrize("joined", both_ways(profile_curves.joined))
def test_polynomials_joined_at_knots(joined: Loops) -> None:
    knots, powers = np.array([0.0, 1.0, 3.0]), np.array([[2.0, -1.0], [0.5, 0.0], [1.0, 3.0], [-1.0, 4.0]])
    s = np.array([-0.5, 0.0, 0.7, 1.0, 2.5, 3.5])
    cells = [0, 0, 0, 1, 1, 1]
    for order, found in enumerate(joined(s, knots, powers)):
        expected = [
            np.polyval(np.polyder(powers[:, i], order), at - knots[i]) for at, i in zip(s, cells, strict=True)
        ]
        np.testing.assert_allclose(found, expected, rtol=1e-14)
    height, slope, curvature = joined(np.array([2.0]), np.array([1.0, 3.0]), np.array([[5.0], [2.0]]))
    assert (height[0], slope[0], curvature[0]) == (7.0, 5.0, 0.0)


# --- segments ---

SEGMENTS = np.array([[0, 1], [1, 2], [2, 3]])
TANGENTIAL, Y = np.array([[0.0, 1.0, 2.5, 3.0], [0.0, 0.0, 1.0, 1.0]]), np.array([0.2, -0.4, -0.3, 0.5])


@pytest.mark.parametrize("measured", both_ways(profile_curves.measured))
def test_a_measured_profile_has_flanks(measured: Loops) -> None:
    knots, powers = np.array([-1.0, 0.0, 2.0]), np.array([[0.5, -0.25], [0.1, 0.3], [0.0, 0.6]])
    s = np.array([-1.5, -1.0, -0.3, 0.0, 1.2, 2.0, 2.25])
    height, slope, curvature = measured(s, knots, powers, -1.0, 2.0, 1000.0)
    inside = profile_curves.joined(s[1:-1], knots, powers)
    np.testing.assert_array_equal([height[1:-1], slope[1:-1], curvature[1:-1]], inside)
    assert [height[0], height[-1]] == [inside[0][0] + 500.0, inside[0][-1] + 250.0]
    assert [slope[0], slope[-1], curvature[0], curvature[-1]] == [-1000.0, 1000.0, 0.0, 0.0]


@pytest.mark.parametrize("arm", both_ways(profile_curves.arm))
@pytest.mark.parametrize("revolved", both_ways(profile_curves.revolved))
def test_a_profile_turned_about_the_vertical(arm: Loops, revolved: Loops) -> None:
    offset = np.array([[0.0, 0.3, -0.4, 0.0], [0.0, 0.4, 0.2, -0.7]])
    s, direction = arm(offset)
    np.testing.assert_allclose(s, np.hypot(*offset), rtol=1e-15)
    np.testing.assert_allclose(s * direction, offset, rtol=1e-15)
    assert direction[:, 0].tolist() == [1.0, 0.0]
    slope, bend = revolved(s, direction, 3 * s**2, 6 * s)  # of h = s³
    np.testing.assert_allclose(slope, 3 * s * offset, rtol=1e-14)
    by_definition = 3 * (np.eye(2)[:, :, None] * s + offset[:, None] * offset / np.where(s > 0, s, 1.0))
    np.testing.assert_allclose(bend, by_definition, rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("spread", both_ways(points_between_nodes.spread))
def test_inner_points_of_segments_that_reach_high_enough(spread: Loops) -> None:
    which, at, at_y = spread(TANGENTIAL, Y, SEGMENTS, -0.3, 4)  # −0.3 itself does not
    assert which.tolist() == [0, 2]
    np.testing.assert_allclose(at, [[0.25, 0.5, 0.75, 2.625, 2.75, 2.875], [0, 0, 0, 1, 1, 1]])
    np.testing.assert_allclose(at_y, [0.05, -0.1, -0.25, -0.1, 0.1, 0.3])


@pytest.mark.parametrize("below_chord", both_ways(points_between_nodes.below_chord))
def test_what_bends_below_its_chord(below_chord: Loops) -> None:
    height = np.array([0.0, 1.0, 5.0, 1.0])
    gap = np.array([[0.2, 0.5, 0.75], [4.0, 2.8, 2.1]])
    found = below_chord(height, SEGMENTS, np.array([0, 2]), gap, 0.01)
    assert found.tolist() == [[True, False, False], [False, True, False]]
    edge = np.array([[0.24, 0.49, 0.74]])
    assert below_chord(height, SEGMENTS, np.array([0]), edge, 0.0099).all()
    assert not below_chord(height, SEGMENTS, np.array([0]), edge, 0.0101).any()


@pytest.mark.parametrize("closer", both_ways(points_between_nodes.closer))
def test_what_is_close(closer: Loops) -> None:
    height = np.array([0.5, 0.12, 0.09, -0.3])
    gap = np.array([[0.0, 0.2, 0.05], [0.0, 0.0, 0.0], [0.3, 0.12, 0.09]])
    below = np.array([[True, False, False], [False] * 3, [False, True, False]])
    nodes, points = closer(height, gap, below, np.array([4, 5, 9]), 0.02, 0.08)
    assert nodes.tolist() == [2, 3]
    assert points.tolist() == [12, 14, 29]


@pytest.mark.parametrize("carried", both_ways(points_between_nodes.carried))
def test_nodes_around_points(carried: Loops) -> None:
    carriers, share = carried(np.array([3, 1]), np.array([0, 4, 8]), SEGMENTS, 4)
    assert carriers.tolist() == [[3, 1, 0, 1, 2], [3, 1, 1, 2, 3]]
    assert share.tolist() == [0, 0, 0.25, 0.5, 0.75]


CARRIERS, SHARE = np.array([[3, 0, 1], [3, 1, 2]]), np.array([0.0, 0.25, 0.5])


@pytest.mark.parametrize("interpolated", both_ways(points_between_nodes.interpolated))
def test_values_at_points(interpolated: Loops) -> None:
    np.testing.assert_allclose(interpolated(np.array([[1.0, 5.0, 9.0, 4.0]]), CARRIERS, SHARE), [[4.0, 2.0, 7.0]])


@pytest.mark.parametrize("shared_out", both_ways(points_between_nodes.shared_out))
def test_forces_at_nodes(shared_out: Loops) -> None:
    found = shared_out(np.array([[1.0, 4.0, 2.0], [0.0, 0.0, 8.0]]), CARRIERS, SHARE, 5)
    np.testing.assert_allclose(found, [[3.0, 2.0, 1.0, 1.0, 0.0], [0.0, 4.0, 4.0, 0.0, 0.0]])


@pytest.mark.parametrize("others", [[], [2], [1, 2, 7, 9], [0, 3, 8], [9, 11]])
@pytest.mark.parametrize("numbers", [[], [2], [2, 3, 7, 9]])
def test_numbers_that_ascend(numbers: list[int], others: list[int]) -> None:
    one, other = np.array(numbers, dtype=np.int64), np.array(others, dtype=np.int64)
    for which_of, merged in (
        (points_between_nodes.which_of, points_between_nodes.merged),
        (points_between_nodes.which_of.py_func, points_between_nodes.merged.py_func),
    ):  # type: ignore[attr-defined]
        assert which_of(one, other).tolist() == [n in others for n in numbers]
        assert merged(one, other).tolist() == sorted({*numbers, *others})


# --- factors ---


def definite(n: int) -> Array:
    half = np.random.default_rng(n).normal(size=(n, n))
    return half @ half.T + 0.1 * np.eye(n)


@pytest.mark.parametrize("n", [0, 1, 2, 30])
def test_what_a_factor_solves(n: int) -> None:
    matrix, rng = definite(n), np.random.default_rng(3)
    factor = np.tril(matrix)  # the upper triangle is not looked at
    assert factors.factor_in_place(factor)
    lower = np.tril(factor)
    np.testing.assert_allclose(lower @ lower.T, matrix, atol=1e-12)
    b, rows = rng.normal(size=n), rng.normal(size=(3, n))
    solved, forth, back = b.copy(), rows.copy(), b.copy()
    factors.solve_in_place(factor, solved)
    factors.forth_in_place(factor, forth)
    factors.back_in_place(factor, back)
    np.testing.assert_allclose(matrix @ solved, b, atol=1e-9)
    np.testing.assert_allclose(lower @ forth.T, rows.T, atol=1e-10)
    np.testing.assert_allclose(lower.T @ back, b, atol=1e-10)


def test_what_is_not_definite() -> None:
    assert not factors.factor_in_place(np.array([[1.0, 2.0], [2.0, 1.0]]))


def test_products_are_added_to_the_lower_triangle() -> None:
    rows, matrix = np.array([[1.0, 2.0, 3.0], [0.0, 1.0, -1.0]]), np.array([[1.0, 9.0], [5.0, 2.0]])
    factors.add_products(matrix, rows)
    np.testing.assert_allclose(np.tril(matrix), [[15.0, 0.0], [4.0, 4.0]])
    factors.add_products(np.zeros((0, 0)), np.zeros((0, 3)))


def test_the_inverses_norm() -> None:
    matrix = np.diag([4.0, 0.5, 2.0])
    factor = np.sqrt(matrix)
    assert factors.one_over_inverse(factor) == pytest.approx(0.5)


def test_eigenvalues_ascend_beside_their_vectors() -> None:
    matrix = definite(6)
    vectors = np.tril(matrix)
    values = factors.eigen_in_place(vectors)
    assert (np.diff(values) > 0).all()
    np.testing.assert_allclose(matrix @ vectors.T, vectors.T * values, atol=1e-12)
