"""Profile-likelihood limits: against the deviance by brute force, their signs, their ends and their coverage."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from rig.compare.candidate_measures import Candidates
from rig.compare.intervals import ConfidenceLimits, limits
from rig.compare.likelihood import Form, Observed, observed
from rig.compare.recordings.recording import recording

Array = NDArray[np.float64]
EPS = np.linspace(0, 1, 24)


def counted(rates: Array, window_s: float | None = 1.0) -> Observed:
    rows = [(float(n), float(rate), np.nan) for n, row in enumerate(rates) for rate in row]
    return observed([recording("x", rows, window_s)], np.ones(len(rates), dtype=bool))


def of(eps: Array, given: Observed, form: Form = Form(), ratio: float = 1.0) -> ConfidenceLimits:  # noqa: B008
    candidates = Candidates(eps[None, None], form)
    return limits(candidates, given, candidates.fitted(given), 0, ratio)


def drawn(k: float, eps0: float, seed: int, presses: int = 5) -> Observed:
    mean = np.maximum(k * (EPS - eps0), 0)
    return counted(np.random.default_rng(seed).poisson(mean, size=(presses, 24)).T * 1.0)


def test_limits_are_where_the_deviance_has_risen_by_f() -> None:
    given = drawn(60, 0.3, 0)
    k, eps0 = np.meshgrid(np.linspace(40, 90, 401), np.linspace(0.15, 0.45, 301), indexing="ij")
    mean = np.maximum(k[..., None] * (EPS - eps0[..., None]), 0)
    deviance = given.deviance(mean).sum(axis=-1)
    above = stats.f.ppf(0.95, 1, given.noise.freedom) * given.noise.dispersion
    inside = deviance <= deviance.min() + above
    found = of(EPS, given)
    np.testing.assert_allclose(found.k, [k[inside].min(), k[inside].max()], atol=0.8)
    np.testing.assert_allclose(found.eps0, [eps0[inside].min(), eps0[inside].max()], atol=0.004)


def test_misfit_widens_them_as_noise_does() -> None:
    given = drawn(60, 0.3, 1)
    plain, wide, less = (of(EPS, given, ratio=ratio) for ratio in (1.0, 4.0, 0.5))
    assert np.ptp(wide.k) == pytest.approx(2 * np.ptp(plain.k), rel=0.3)
    assert less == plain


def test_a_falling_candidate_has_the_mirrored_limits() -> None:
    given = drawn(60, 0.3, 2)
    up, down = of(EPS, given), of(-EPS, given)
    np.testing.assert_allclose(down.k, (-up.k[1], -up.k[0]), rtol=1e-9)
    np.testing.assert_allclose(down.eps0, (-up.eps0[1], -up.eps0[0]), rtol=1e-9)


def test_without_a_fit_there_are_none() -> None:
    assert np.isnan(of(np.zeros(24), drawn(60, 0.3, 3))).all()


def test_a_slope_that_is_hardly_there_has_no_lower_threshold() -> None:
    """A rate that does not depend on ε leaves ε₀ open to −∞, and k small."""
    rates = np.random.default_rng(4).poisson(30, size=(24, 5)) * 1.0
    found = of(EPS, counted(rates + 2 * EPS[:, None]))
    assert found.eps0[0] == -np.inf
    assert found.k[0] < 3


def test_silent_at_rest_ends_at_zero() -> None:
    found = of(EPS, drawn(60, 0.0, 5), Form(silent_at_rest=True))
    assert found.eps0[0] == 0.0
    assert 0 < found.eps0[1] < 0.1


def test_a_rate_that_levels_off_has_limits_of_its_drive() -> None:
    drive = np.maximum(80 * (EPS - 0.2), 0)
    mean = drive / (1 + drive / 60)
    rates = np.random.default_rng(6).poisson(mean, size=(8, 24)).T * 1.0
    found = of(EPS, counted(rates), Form(saturating=True))
    assert found.k[0] < 85
    assert found.k[1] > 60
    assert found.eps0[0] < 0.2 < found.eps0[1]


def test_limits_hold_the_truth_in_19_of_20() -> None:
    """200 draws; 95 % has a standard error of 1.5 %, 0.9 is three of them below."""
    held = np.zeros(2)
    for seed in range(200):
        found = of(EPS, drawn(40, 0.4, seed, presses=3))
        held += [found.k[0] <= 40 <= found.k[1], found.eps0[0] <= 0.4 <= found.eps0[1]]
    assert (held / 200 > 0.9).all()


def test_over_fingers_limits_are_those_of_any_that_is_likely() -> None:
    """ε is 1.5 times as large at the upper end of the range, and nothing tells where the finger is: k neither."""
    design = np.stack([0.5 * EPS, EPS, 1.5 * EPS])[:, None]
    given = drawn(60, 0.3, 7)
    candidates = Candidates(design, Form())
    fit = candidates.fitted(given)
    found = limits(candidates, given, fit, 0, 1.0)
    alone = of(EPS, given)
    assert found.k[0] == pytest.approx(alone.k[0] / 1.5, rel=0.05)
    assert found.k[1] == pytest.approx(alone.k[1] / 0.5, rel=0.05)
