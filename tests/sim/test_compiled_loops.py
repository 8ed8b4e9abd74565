"""Compiled loops against what they are by definition; as machine code, and as Python reads the same lines."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.contact.compiled import factors, planes_and_residual, points_between_nodes

Array = NDArray[np.float64]
Loops = Callable[..., Any]


def both_ways(loops: Loops) -> list[Any]:
    """Compiled, and uncompiled where nothing is called that only machine code can call."""
    return [pytest.param(loops, id="compiled"), pytest.param(loops.py_func, id="python")]  # type: ignore[attr-defined]


# --- planes and residuals ---


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
def test_the_compiled_residual_equals_its_definition(
    missed: Loops, changed: dict[str, object], worst: float, depth: float
) -> None:
    found = missed_by(missed, **changed)
    assert found[0] == pytest.approx(worst, rel=1e-12)
    assert found[1] == pytest.approx(depth, rel=1e-12)


# --- segments ---


@pytest.mark.parametrize("others", [[], [2], [1, 2, 7, 9], [0, 3, 8], [9, 11]])
@pytest.mark.parametrize("numbers", [[], [2], [2, 3, 7, 9]])
def test_the_compiled_merge_of_ascending_numbers_equals_its_definition(numbers: list[int], others: list[int]) -> None:
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
def test_the_compiled_factor_solves_its_matrix(n: int) -> None:
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


def test_the_compiled_factor_refuses_an_indefinite_matrix() -> None:
    assert not factors.factor_in_place(np.array([[1.0, 2.0], [2.0, 1.0]]))
