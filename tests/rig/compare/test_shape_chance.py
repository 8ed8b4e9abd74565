"""What passes the shape test by chance, and how smooth that chance is."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.compare.profile_shape_test import (
    ShapePositions,
    candidates_by_chance,
    chance_rows,
    moved_response,
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


@pytest.mark.parametrize("over_mm", [0.2, 0.5, 1.0, 2.0, 4.0])
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


def test_a_response_that_moves_is_seen_shifted() -> None:
    """The receptor at 0.25 sees at x what that at 0 sees at x − 0.25: the next position."""
    found = moved_response(STEP, np.array([0.0, 0.25]), 0.7, 40, rng())
    assert found.shape == (40, 2, 25)
    np.testing.assert_allclose(found[:, 1, 1:], found[:, 0, :-1], atol=1e-9)
    assert np.abs(found[:, 1] - found[:, 0]).max() > 0.1


def test_candidates_by_chance() -> None:
    receptors = np.array([-1.0, 0.0, 1.0])
    one = passed_by_chance(STEP, 0.5)
    some = candidates_by_chance([STEP], receptors, 0.5)
    both = candidates_by_chance([STEP, STEP], receptors, 0.5)
    mixed = candidates_by_chance([STEP, BAR], receptors, 0.5)
    assert one is not None
    assert some is not None
    assert both is not None
    assert mixed is not None
    assert one < some < 3 * one  # of three receptors, each sees the same response elsewhere
    assert both < some
    assert mixed < some
    assert candidates_by_chance([STEP, ShapePositions("cylinder:9", X)], receptors, 0.5) is not None
    assert candidates_by_chance([ShapePositions("cylinder:9", X)], receptors, 0.5) is None


def test_under_bars_only_receptors_near_the_centre_count() -> None:
    far, near = (candidates_by_chance([BAR], np.array([x]), 0.5) for x in (0.26, 0.25))
    assert far == 0.0
    assert near is not None
    assert near > 0.3


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
