"""Lack of fit, its power, the ceiling and blocks of positions."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from rig.compare.candidate_measures import blocks, by_monotone, by_repeats, detectable, lack_of_fit, rejected, tail
from rig.compare.likelihood import Observed, observed
from rig.compare.recordings.recording import recording

Array = NDArray[np.float64]


def seen(rates: Array, window_s: float | None = None, sd: float = np.nan) -> Observed:
    """(p, presses)."""
    rows = [(float(n), float(rate), sd) for n, row in enumerate(rates) for rate in row]
    return observed([recording("x", rows, window_s)], np.ones(len(rates), dtype=bool))


def test_lack_of_fit_against_pure_error_is_the_text_book_s() -> None:
    """Rates alone: squares of the means off the model over p − 2, over squares within; evenly noisy."""
    rng = np.random.default_rng(0)
    rates = 20 + rng.normal(size=(12, 6))
    given, mean = seen(rates), np.linspace(19, 21, 12)
    ratio, p = lack_of_fit(given, mean[None], given.deviance(mean[None]), 2, np.zeros((1, 12)))
    lof = 6 * ((rates.mean(axis=1) - mean) ** 2).sum() / 10
    pure = ((rates - rates.mean(axis=1, keepdims=True)) ** 2).sum() / 60
    assert ratio[0] == pytest.approx(lof / pure)
    assert p[0] == pytest.approx(stats.f.sf(lof / pure, 10 * given.evenness, 60 * given.evenness))


def test_a_given_sd_is_judged_by_chi_squared() -> None:
    given = seen(np.full((8, 1), 10.0), sd=2.0)
    mean = np.full((1, 8), 11.0)
    ratio, p = lack_of_fit(given, mean, given.deviance(mean), 2, np.zeros((1, 8)))
    assert ratio[0] == pytest.approx(8 / 4 / 6)
    assert p[0] == pytest.approx(stats.chi2.sf(2.0, 6))


def test_a_discrepancy_adds_to_the_noise() -> None:
    given = seen(np.full((8, 1), 10.0), sd=2.0)
    mean = np.full((1, 8), 16.0)
    ratio, _ = lack_of_fit(given, mean, given.deviance(mean), 2, np.full((1, 8), 5.0))
    assert ratio[0] == pytest.approx(8 * 36 / (4 + 5) / 6)


def test_positions_where_silence_is_expected_are_no_degrees_of_freedom() -> None:
    given = seen(np.array([[0.0, 0.0]] * 6 + [[30.0, 34.0]] * 6), 1.0)
    mean = np.where(np.arange(12) < 6, 0.0, 32.0)[None]
    off = mean * 1.1
    ratio, _ = lack_of_fit(given, off, given.deviance(off), 2, np.zeros((1, 12)))
    worth = 6 * 35.2 / (35.2 + 0.25)
    assert ratio[0] == pytest.approx(given.deviance(off).sum() / given.noise.dispersion / (worth - 2))


def test_the_right_model_is_rejected_in_five_percent() -> None:
    """400 draws of counts with a dispersion of 3, a third of the positions silent; 3 standard errors of 1.1 %."""
    rng = np.random.default_rng(1)
    mean = np.maximum(np.linspace(-10, 30, 24), 0)
    shape = np.maximum(mean, 1e-9) / 2
    rejections = 0
    for _ in range(400):
        given = seen(rng.negative_binomial(shape, 1 / 3, size=(4, 24)).T * (mean > 0)[:, None] * 1.0, 1.0)
        rejections += lack_of_fit(given, mean[None], given.deviance(mean[None]), 0, np.zeros((1, 24)))[1][0] < 0.05
    assert 0.018 < rejections / 400 < 0.083


def test_tails_and_powers_are_those_of_f() -> None:
    assert tail(np.array([2.0]), np.array([5.0]), 20.0)[0] == pytest.approx(stats.f.sf(2.0, 5, 20))
    assert tail(np.array([2.0]), np.array([5.0]), np.inf)[0] == pytest.approx(stats.chi2.sf(10.0, 5))
    limit = stats.f.ppf(0.95, 6, 30)
    assert rejected(np.array(12.0), 6.0, 30.0) == pytest.approx(stats.ncf.sf(limit, 6, 30, 12.0), rel=1e-6)
    assert rejected(np.array(0.0), 6.0, 30.0) == pytest.approx(0.05)
    known = stats.ncx2.sf(stats.chi2.ppf(0.95, 6), 6, 12.0)
    assert rejected(np.array(12.0), 6.0, np.inf) == pytest.approx(known, rel=1e-4)


def test_a_misfit_beyond_all_doubt_is_rejected_for_sure() -> None:
    """At 2140 with 42.7 and 68.7 degrees of freedom scipy's distribution has no value."""
    found = rejected(np.array([2140.57, 1e9, 0.0]), 42.7343128, 68.7236183)
    np.testing.assert_allclose(found, [1, 1, 0.05])
    assert rejected(np.array(11.9 * 6 * stats.f.ppf(0.95, 6, 1)), 6.0, 1.0) < 1


def test_a_detectable_misfit_is_rejected_in_four_of_five() -> None:
    """White misfit of that size, on top of a given sd: 2000 draws, 4 standard errors of 0.9 %."""
    given = seen(np.linspace(5, 50, 20)[:, None], sd=3.0)
    size = detectable(given, 2) * 50
    rng = np.random.default_rng(2)
    shape = rng.normal(size=20)
    shape *= size / np.sqrt((shape**2).mean())
    off = ((shape + 3 * rng.normal(size=(2000, 20))) ** 2).sum(axis=1) / 9
    assert np.mean(off > stats.chi2.ppf(0.95, 20)) == pytest.approx(0.8, abs=0.06)


def test_more_presses_see_less() -> None:
    rng = np.random.default_rng(3)
    few, many = (seen(rng.poisson(20, size=(20, n)) * 1.0, 1.0) for n in (3, 12))
    assert detectable(few, 2) == pytest.approx(2 * detectable(many, 2), rel=0.35)


def test_the_ceiling_by_repeats_is_that_of_split_halves() -> None:
    """Against all splits of four presses in two and two, stepped up by Spearman and Brown."""
    rng = np.random.default_rng(4)
    rates = np.linspace(10, 40, 30)[:, None] + 6 * rng.normal(size=(30, 4))
    halves = [np.corrcoef(rates[:, a].mean(axis=1), rates[:, b].mean(axis=1))[0, 1]
              for a, b in (([0, 1], [2, 3]), ([0, 2], [1, 3]), ([0, 3], [1, 2]))]  # fmt: skip
    stepped = np.mean([2 * r / (1 + r) for r in halves])
    assert by_repeats(seen(rates)) == pytest.approx(stepped, abs=0.02)
    assert by_repeats(seen(np.full((5, 3), 7.0))) == 0


def test_the_ceiling_without_repeats_is_a_monotone_function_s() -> None:
    rng = np.random.default_rng(5)
    eps = rng.random(60)
    given = seen((np.tanh(3 * eps) * 40)[:, None])
    bad = rng.random(60)
    assert by_monotone(np.stack([bad, eps]), given) > 0.95
    assert by_monotone(np.stack([-eps]), given) > 0.95  # falling, too
    assert by_monotone(np.stack([bad]), given) < 0.3
    assert by_monotone(np.stack([eps]), seen(np.full((60, 1), 3.0))) == 0


def test_blocks_are_neighbours_of_one_stimulus() -> None:
    rows = [(float(n), 1.0, np.nan) for n in range(10)]
    given = observed([recording("x", rows), recording("y", rows[:3])], np.ones(13, dtype=bool))
    np.testing.assert_array_equal(blocks(given, 5), [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 6, 7])
