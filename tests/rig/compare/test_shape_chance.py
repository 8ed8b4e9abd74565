"""What passes the shape test by chance, and how smooth that chance is."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.compare.profile_shape_test import (
    ShapePositions,
    chance_rows,
    passed_by_chance,
    shape_flags,
    shape_test,
    smooth_over_mm,
    smooth_profiles,
)
from rig.compare.stimuli import StimulusRow

Array = NDArray[np.float64]

X = np.linspace(-3, 3, 25)
STEP, BAR = ShapePositions("step:1", X), ShapePositions("bar:3.0", X)


def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.mark.parametrize("over_mm", [0.4, 1.0])
def test_profiles_are_as_correlated_as_they_should_be(over_mm: float) -> None:
    """exp(−d²/2ℓ²) between all positions; of 4000 draws an entry is off by 0.016, 625 of them by 0.06 at most."""
    found = smooth_profiles(X, over_mm, 4000, rng())
    expected = np.exp(-0.5 * (np.subtract.outer(X, X) / over_mm) ** 2)
    np.testing.assert_allclose(found.T @ found / len(found), expected, atol=0.08)
    assert found.shape == (4000, 25)


@pytest.mark.parametrize("over_mm", [0.2, 1.0, 4.0])
@pytest.mark.parametrize("x_mm", [X, np.array([-3.7, -3.2, -2.3, *np.arange(-2, 0.2, 0.17), 0.5, 1.0, 1.5, 2.0])])
def test_how_smooth_profiles_are_is_found_again(x_mm: Array, over_mm: float) -> None:
    """Whatever their size and offset; the median of 500 has a standard error of some 3 %, and so has the scale."""
    profiles = 20 * smooth_profiles(x_mm, over_mm, 500, rng()) + 100
    assert smooth_over_mm(x_mm, profiles) == pytest.approx(over_mm, rel=0.15)


def test_flat_profiles_are_as_smooth_as_nothing() -> None:
    assert np.isnan(smooth_over_mm(X, np.ones((3, 25))))
    varied = np.concatenate([np.ones((30, 25)), smooth_profiles(X, 1.0, 500, rng())])
    assert smooth_over_mm(X, varied) == pytest.approx(1.0, rel=0.12)


def test_many_profiles_are_judged_as_one_is() -> None:
    for shape in ("step:1", "bar:3.0"):
        profiles = smooth_profiles(X, 0.6, 60, rng()).reshape(3, 20, 25)
        flags = shape_flags(shape, X, profiles)
        assert flags is not None
        one_by_one = [[shape_test(shape, X, profile) for profile in row] for row in profiles]
        assert flags.tolist() == [[verdict is not None and verdict.passed for verdict in row] for row in one_by_one]
        assert 0 < flags.sum() < 60
    assert shape_flags("cylinder:9", X, profiles) is None


def test_passed_by_chance() -> None:
    share = passed_by_chance(STEP, 0.5)
    assert share == passed_by_chance(STEP, 0.5)  # a fixed seed
    assert share == pytest.approx(0.25, abs=0.08)
    strict = passed_by_chance(STEP, 0.5, threshold=0.9)
    assert share is not None
    assert strict is not None
    assert strict < share / 3
    assert passed_by_chance(ShapePositions("cylinder:9", X), 0.5) is None


def test_the_rows_of_a_comparison(make_stimulus: Callable[..., StimulusRow]) -> None:
    profile = smooth_profiles(X, 0.8, 1, rng())[0][:, None]
    step = make_stimulus("step:1", X, np.array([0.0]), {"ep1": profile})
    flat = make_stimulus("bar:3.0", X, np.array([0.0]), {})
    other = make_stimulus("cylinder:9", X, np.array([0.0]), {"ep1": profile})
    row, none = chance_rows([step, flat, other])
    assert {name: row[name] for name in ("shape", "condition", "positions", "draws")} == {
        "shape": "step:1", "condition": "2.33 gwt", "positions": 25, "draws": 1000,
    }  # fmt: skip
    assert row["smooth_over_mm"] == round(smooth_over_mm(X, profile.T), 3)
    assert row["passes_by_chance"] == pytest.approx(passed_by_chance(STEP, row["smooth_over_mm"]), abs=0.02)
    assert (none["shape"], none["smooth_over_mm"], none["passes_by_chance"]) == ("bar:3.0", None, None)
