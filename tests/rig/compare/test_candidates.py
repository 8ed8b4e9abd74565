"""Candidates on one finger and on a design of fingers: fits, discrepancy, prediction and imitation."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.compare.candidate_measures import DISCREPANCY, OF_THE_MESH, Candidates
from rig.compare.likelihood import Form, Observed, maximum_likelihood, observed
from rig.compare.model_confidence_set import imitated, predicted_left_out
from rig.compare.recordings.recording import recording

Array = NDArray[np.float64]
X = np.linspace(-2, 2, 20)


def bump(centre: float, width: float = 0.8) -> Array:
    return np.exp(-(((X - centre) / width) ** 2))


def of(*rates: Array, sd: float = np.nan, window_s: float | None = None) -> Observed:
    """One stimulus for each row of rates."""
    rows = [[(float(n), float(r), sd) for n, r in enumerate(row)] for row in rates]
    known = np.ones(sum(map(len, rows)), dtype=bool)
    return observed([recording("x", row, window_s) for row in rows], known)


def test_on_one_finger_the_fit_is_the_likeliest_and_nothing_is_allowed_for() -> None:
    eps, given = np.stack([bump(0), bump(1)]), of(60 * bump(0.1))
    one = Candidates(eps[None], Form())
    fit = one.fitted(given)
    np.testing.assert_allclose(fit.found.k, maximum_likelihood(eps, given, Form()).k, rtol=1e-12)
    np.testing.assert_array_equal(one.discrepancy(fit), np.zeros((2, 20)))
    assert (one.free, one.parameters, fit.place.shape) == (0, 2, (2, 0))


def design() -> Array:
    """(3, 2, 20): the bump moves with the finger; the other candidate does not."""
    return np.stack([np.stack([bump(c), bump(-1, 0.4)]) for c in (-0.4, 0.0, 0.4)])


def test_on_a_design_the_place_of_the_finger_is_fitted_too() -> None:
    on_all = Candidates(design(), Form())
    between = np.array([0.375, 0.75, -0.125]) @ design()[:, 0]  # Lagrange's weights at −0.5
    fit = on_all.fitted(of(50 * np.maximum(between - 0.2, 0)))
    assert (on_all.free, on_all.parameters) == (1, 3)
    assert float(fit.place[0, 0]) == pytest.approx(-0.5, abs=0.02)
    assert float(fit.found.k[0]) == pytest.approx(50, rel=0.02)
    assert fit.found.total[0] < 1


def test_a_part_of_the_positions_is_fitted_and_all_are_predicted() -> None:
    given, at = of(60 * bump(0.1)), np.arange(20) % 2 == 0
    fit = Candidates(design(), Form()).fitted(given, at)
    assert fit.found.mean.shape == (2, 10)
    assert fit.eps.shape == (2, 20)
    np.testing.assert_allclose(fit.found.rates(fit.eps[:, at]), fit.found.mean, atol=1e-9)


def test_the_discrepancy_is_a_share_of_what_fingers_differ_by_and_of_the_largest_rate() -> None:
    """ε of the second candidate is the same on all fingers but for a factor, which k follows."""
    eps = design()
    eps[:, 1] = np.array([0.5, 1.0, 2.0])[:, None] * bump(0)
    on_all = Candidates(eps, Form())
    fit = on_all.fitted(of(60 * bump(0.0) + 1))
    allowed = on_all.discrepancy(fit)
    mesh = (OF_THE_MESH * fit.found.mean.max(axis=1)) ** 2
    np.testing.assert_allclose(allowed[1], mesh[1], rtol=1e-6)
    left = []
    for finger in eps[:, 0]:
        slope, level = np.polyfit(fit.eps[0], finger, 1)
        left.append(finger - slope * fit.eps[0] - level)
    expected = mesh[0] + (DISCREPANCY * fit.found.k[0]) ** 2 * np.mean(np.square(left), axis=0)
    np.testing.assert_allclose(allowed[0], np.where(fit.found.mean[0] > 0, expected, 0), rtol=1e-6)


def test_a_test_on_fingers_counts_their_parameters_and_allows_for_them() -> None:
    given = of(60 * bump(0.1), sd=3.0)
    on_all = Candidates(design(), Form())
    fit = on_all.fitted(given)
    ratio, _ = on_all.tested(given, fit)
    variance = 9.0 + on_all.discrepancy(fit)
    expected = ((given.rate - fit.found.mean) ** 2 / variance).sum(axis=1) / (20 - 3)
    np.testing.assert_allclose(ratio, expected)


def test_each_stimulus_is_predicted_from_the_others() -> None:
    """The first candidate has one k for both stimuli, the second has not."""
    eps = np.stack([np.concatenate([bump(0), bump(0.5)]), np.concatenate([bump(0), 3 * bump(0.5)])])
    given = of(40 * bump(0), 40 * bump(0.5))
    found = predicted_left_out(Candidates(eps[None], Form()), given)
    first = given.stimulus == 0
    np.testing.assert_allclose(found.share(), [1, found.share()[1]], atol=1e-9)
    assert found.share()[1] < 0.5
    np.testing.assert_allclose(found.deviance[1, first], (40 / 3 * bump(0) - 40 * bump(0)) ** 2, atol=1e-6)
    np.testing.assert_allclose(found.of_mean[first], (given.rate[~first].mean() - given.rate[first]) ** 2)
    assert found.share(first)[1] == pytest.approx(
        1 - (26.666667**2) * (bump(0) ** 2).sum() / found.of_mean[first].sum()
    )


def test_blocks_are_predicted_from_the_rest_of_one_stimulus() -> None:
    """A step in one block only cannot be known from the others."""
    rates = np.where(np.arange(20) < 4, 50.0, 10.0)
    eps = np.stack([np.where(np.arange(20) < 4, 1.0, 0.0), np.zeros(20)])
    found = predicted_left_out(Candidates(eps[None], Form()), of(rates))
    np.testing.assert_allclose(found.deviance[0, :4], 1600)
    assert found.share()[0] == pytest.approx(1 - 4 * 1600 / (4 * 1600 + 16 * 100))


def test_what_imitates_a_truth_best_and_how_surely_it_is_rejected() -> None:
    truth = 40 + 60 * bump(0)
    eps = np.stack([bump(1.5), bump(0.15), bump(-1)])[None]
    given = of(truth, sd=6.0)
    who, power = imitated(Candidates(eps, Form()), given, truth)
    assert who == 1
    rng = np.random.default_rng(0)
    one = Candidates(eps[:, 1:2], Form())
    rejected = []
    for _ in range(400):
        noisy = replace(given, rate=np.maximum(truth + 6 * rng.normal(size=20), 0))
        rejected.append(one.tested(noisy, one.fitted(noisy))[1][0] < 0.05)
    assert power == pytest.approx(np.mean(rejected), abs=0.08)
    assert 0.1 < power < 0.999
    assert imitated(Candidates(bump(0)[None, None], Form()), given, truth)[1] == pytest.approx(0.05, abs=0.001)
