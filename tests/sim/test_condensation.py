"""Condensation against a direct solution."""

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.typing import NDArray

from sim.fem import dissection
from sim.fem.dissection import DissectionFactor, IndefiniteError, inverse_spd
from sim.fem.elements import symmetric
from sim.models.condensed import FiniteElements, factorise
from tests.error_codes import raises
from tests.sim.whole_solve import superlu


def block_tridiagonal() -> tuple[sp.csr_array, NDArray[np.int64], NDArray[np.int64]]:
    """A well-conditioned SPD matrix with unequal slabs, one of them empty; kept unknowns; the slab of each."""
    rng = np.random.default_rng(3)
    sizes = [4, 7, 0, 5, 9, 3]
    slab = np.repeat(np.arange(6), sizes)
    order = np.cumsum(np.array(sizes) > 0)[slab]  # the empty slab does not part its neighbours
    band = np.abs(order[:, None] - order[None]) <= 1
    lower = np.tril(rng.normal(size=(28, 28)) * band)
    a = lower + lower.T
    a += np.diag(np.abs(a).sum(axis=1))
    kept = np.sort(rng.choice(28, 9, replace=False))
    return sp.csr_array(np.triu(a)), kept, slab[:, None]


def against_direct(factor: DissectionFactor, upper: sp.csr_array, kept: NDArray[np.int64], rtol: float) -> None:
    """Against SuperLU of the whole matrix, which knows nothing of condensation."""
    n = upper.shape[0]
    direct = superlu(symmetric(upper))
    unit = np.zeros((n, len(kept)))
    unit[kept, np.arange(len(kept))] = 1.0
    compliance = direct.solve(unit)[kept]
    np.testing.assert_allclose(factor.compliance, compliance, rtol=0, atol=rtol * np.abs(compliance).max())
    np.testing.assert_array_equal(factor.compliance, factor.compliance.T)
    loads = np.random.default_rng(5).normal(size=(4, n))
    exact = direct.solve(loads.T).T
    np.testing.assert_allclose(factor.solve(loads), exact, rtol=0, atol=rtol * np.abs(exact).max())
    some = np.array([kept[0], n - 1, 2])
    np.testing.assert_array_equal(factor.solve(loads, some), factor.solve(loads)[:, some])
    single = factor.solve(loads[:1])
    np.testing.assert_allclose(single, exact[:1], rtol=0, atol=rtol * np.abs(exact).max())


def test_condensation_of_a_small_matrix_is_exact() -> None:
    # Diagonally dominant, condition < 1e2: round-off 1e-14; 1e-12 leaves room for the order of sums.
    upper, kept, places = block_tridiagonal()
    against_direct(DissectionFactor(upper, kept, places), upper, kept, 1e-12)


def test_condensation_of_a_finger_is_exact(coarse_problem: FiniteElements) -> None:
    # The condition of the coarse finger is 8e4: a direct solution itself is good to ~1e-11.
    against_direct(factorise(coarse_problem), coarse_problem.upper, coarse_problem.kept, 1e-10)


@pytest.mark.parametrize("leaf", [1, 2, 5])
@pytest.mark.parametrize("axes", [1, 2])
def test_condensation_is_exact_with_leaves_of_any_size(monkeypatch: pytest.MonkeyPatch, leaf: int, axes: int) -> None:
    # 1e-12 as above; along the second axis, of places drawn by lot, what parts the halves may be most of one.
    monkeypatch.setattr(dissection, "_LEAF_PLACES", leaf)
    upper, kept, slab = block_tridiagonal()
    drawn = np.random.default_rng(13).permutation(28)[:, None]
    against_direct(DissectionFactor(upper, kept, np.hstack([slab, drawn])[:, :axes]), upper, kept, 1e-12)


def test_condensation_refuses_an_indefinite_matrix() -> None:
    upper, kept, places = block_tridiagonal()
    bad = upper.toarray()
    interior = np.setdiff1d(np.arange(28), kept)[3]
    bad[interior, interior] *= -1
    with raises(IndefiniteError, "not_positive_definite"):
        DissectionFactor(sp.csr_array(bad), kept, places)


def test_the_inverse_of_a_definite_matrix_is_symmetric_and_exact() -> None:
    # 700 > one tile of the mirrored triangle. Condition ~ 10, so round-off stays below 1e-13.
    rng = np.random.default_rng(11)
    m = rng.normal(size=(700, 700)) / np.sqrt(700)
    a = m @ m.T + np.eye(700)
    kept = a.copy()
    inverse = inverse_spd(a)
    np.testing.assert_allclose(inverse @ a, np.eye(700), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(inverse, inverse.T)
    np.testing.assert_array_equal(a, kept)


@pytest.mark.parametrize(("diagonal", "minor"), [([1.0, -1.0, 1.0], 2), ([1.0, 1.0, 0.0], 3)])
def test_inverting_an_indefinite_matrix_is_refused(diagonal: list[float], minor: int) -> None:
    with raises(IndefiniteError, "not_positive_definite", minor=minor):
        inverse_spd(np.diag(diagonal))
