"""Linear complementarity: q + Wλ ≥ 0 ⟂ λ ≥ 0."""

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sim.contact.compiled.skin_compliance import SkinCompliance
from sim.contact.lcp import LcpSolution, solve_lcp

Array = NDArray[np.float64]


def solve(w: Array, q: Array, start: NDArray[np.bool_]) -> LcpSolution | None:
    n = len(q)
    nodes = SkinCompliance(np.ascontiguousarray(w)[None, :, None], n, np.stack([np.arange(n)] * 4), np.zeros((2, n)))
    return solve_lcp(q, nodes, np.ones((1, n)), start)


def raised(w: Array) -> Array:
    """W as the solver takes it: its diagonal raised by 1e-11, so that equal rows can be told apart."""
    return w + 1e-11 * np.diag(np.diag(w))


def check(w: Array, q: Array, solution: LcpSolution | None) -> None:
    """The three conditions; 1e-10 of their scale is round-off times the condition of W (≤ 1e4 here)."""
    assert solution is not None
    w = raised(w)
    x = solution.multipliers
    slack = q + w @ x
    scale = np.abs(q).max() + 1e-300
    assert (x >= 0).all()
    assert slack.min() >= -1e-10 * scale
    assert np.abs(x * slack).max() <= 1e-10 * scale * max(x.max(), 1e-300)
    active = np.zeros(len(q), dtype=bool)
    active[solution.active] = True
    assert (x[~active] == 0).all()
    lower = np.tril(solution.factor)
    np.testing.assert_allclose(
        lower @ lower.T, w[np.ix_(solution.active, solution.active)], rtol=0, atol=1e-12 * np.abs(w).max()
    )


@settings(max_examples=80, deadline=None)
@given(st.integers(1, 30), st.integers(0, 2**32 - 1), st.floats(0.01, 1.0), st.booleans())
def test_the_lcp_solver_solves_random_definite_problems(n: int, seed: int, shift: float, warm: bool) -> None:
    rng = np.random.default_rng(seed)
    m = rng.normal(size=(n, n))
    w = m @ m.T / n + shift * np.eye(n)
    q = rng.normal(size=n)
    check(w, q, solve(w, q, rng.random(n) < 0.5 if warm else q < 0))


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 7), st.integers(0, 2**32 - 1))
def test_the_lcp_solution_equals_that_of_a_search_over_all_active_sets(n: int, seed: int) -> None:
    # A definite W has exactly one solution: found here by trying all 2ⁿ sets.
    rng = np.random.default_rng(seed)
    m = rng.normal(size=(n, n))
    w, q = raised(m @ m.T + 0.1 * np.eye(n)), rng.normal(size=n)
    found = []
    for mask in itertools.product([False, True], repeat=n):
        a = np.array(mask)
        x = np.zeros(n)
        if a.any():
            x[a] = np.linalg.solve(w[np.ix_(a, a)], -q[a])
        if (x >= 0).all() and ((q + w @ x)[~a] >= 0).all():
            found.append(x)
    solution = solve(w, q, q < 0)
    assert len(found) == 1
    assert solution is not None
    np.testing.assert_allclose(solution.multipliers, found[0], rtol=0, atol=1e-9 * max(np.abs(found[0]).max(), 1e-9))


def test_the_lcp_solver_finds_one_symmetric_contact_on_a_smooth_kernel() -> None:
    # A membrane's compliance, off-diagonals of one sign and slow decay, as in a contact: 300 nodes under a sphere.
    s = np.linspace(-1, 1, 300)
    w = np.exp(-np.abs(s[:, None] - s[None]) / 0.3) + 1e-3 * np.eye(300)
    q = 0.5 * s**2 - 0.05
    solution = solve(w, q, q < 0)
    check(w, q, solution)
    assert solution is not None
    np.testing.assert_allclose(solution.multipliers, solution.multipliers[::-1], rtol=0, atol=1e-9)
    assert np.ptp(np.flatnonzero(solution.multipliers)) + 1 == len(solution.active)  # one run


def test_the_lcp_solver_shares_a_load_among_dependent_points() -> None:
    # The middle of a straight, stiff segment and its two ends: the third row is the mean of the others.
    ends = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 0.5]])
    w, q = ends @ np.array([[2.0, 0.5], [0.5, 2.0]]) @ ends.T, ends @ np.array([-1.0, -1.0])
    for start in itertools.product([False, True], repeat=3):
        solution = solve(w, q, np.array(start))
        check(w, q, solution)
        assert solution is not None
        # forces on the two ends are unique: (2 + 0.5) f = 1
        np.testing.assert_allclose(ends.T @ solution.multipliers, [0.4, 0.4], rtol=0, atol=1e-9)


def test_the_lcp_solver_handles_more_points_than_degrees_of_freedom() -> None:
    # 60 points on a chain of 11 nodes under an arc: exchanging all at once cycles, one by one it ends.
    along = np.linspace(0, 10, 60)
    hat = np.maximum(0.0, 1 - np.abs(along[:, None] - np.arange(11)))
    stiff = np.exp(-np.abs(np.subtract.outer(np.arange(11), np.arange(11))) / 2.0)
    w, q = hat @ stiff @ hat.T, 0.02 * (along - 4.3) ** 2 - 0.2
    solution = solve(w, q, q < 0)
    check(w, q, solution)
    assert solution is not None
    assert len(solution.active) <= 11


def test_the_lcp_solver_returns_nothing_for_an_indefinite_matrix() -> None:
    w = np.array([[1.0, 2.0], [2.0, 1.0]])
    assert solve(w, np.array([-1.0, -1.0]), np.array([True, True])) is None
