"""Evidence and information against closed forms and quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import gamma, nbinom, poisson

from rig.design.counts import CountModel, draw_counts, no_counts, with_counts
from rig.design.fibers import FiberDraws, Unknowns
from rig.design.information import count_bins
from rig.design.posterior import CandidatePosterior, in_set


def a_fiber(n: int = 1, drift: float = 0.0) -> FiberDraws:
    """n fibers that differ in nothing."""
    zero = np.zeros(n)
    number = np.zeros(n, dtype=np.int64)
    place = np.ones((n, 1), dtype=np.float32)
    return FiberDraws(zero, place, place, zero + drift, number, zero + 1, np.zeros((n, 6)))


def entropy(p: np.ndarray) -> float:
    return float(-(p[p > 0] * np.log2(p[p > 0])).sum())


@pytest.mark.parametrize(("rates", "window_s"), [((0.2, 0.6), 1.0), ((0.5, 0.7), 0.2), ((0.05, 1.0), 1.0)])
def test_information_of_two_poisson_candidates(rates: tuple[float, float], window_s: float) -> None:
    """By summation over all counts; bins of counts lose at most a twentieth."""
    model = CountModel(window_s, Unknowns((50.0, 50.0), dispersion=(1.0, 1.0)))
    log_rate = np.log(np.array(rates, dtype=np.float32)).reshape(2, 1, 1)
    now = CandidatePosterior.before(model, a_fiber(), log_rate)
    found = now.information_bits(4000, np.random.default_rng(0))[0]
    counts = np.arange(200)
    each = np.array([poisson.pmf(counts, 50 * window_s * rate) for rate in rates])
    exact = entropy(each.mean(axis=0)) - np.mean([entropy(one) for one in each])
    assert 0.95 * exact - 0.002 < found < 1.01 * exact + 0.002


def test_information_after_a_count() -> None:
    """Of the probabilities that the first count leaves."""
    model = CountModel(1.0, Unknowns((50.0, 50.0), dispersion=(1.0, 1.0)))
    rates = np.array([0.4, 0.6])
    now = CandidatePosterior.before(model, a_fiber(), np.log(rates, dtype=np.float32).reshape(2, 1, 1))
    now = now.updated(0, np.array([27.0]))
    first = poisson.pmf(27, 50 * rates)
    p = first / first.sum()
    assert now.probabilities[0] == pytest.approx(p, abs=0.01)
    each = poisson.pmf(np.arange(200)[:, None], 50 * rates)
    exact = entropy(each @ p) - float(p @ [entropy(one) for one in each.T])
    assert now.information_bits(4000, np.random.default_rng(0))[0] == pytest.approx(exact, rel=0.07)


def test_candidates_that_predict_the_same_leave_nothing_to_learn() -> None:
    """Although their particles are drawn apart."""
    chance = np.random.default_rng(1)
    model = CountModel(1.0, Unknowns((10.0, 100.0)))
    same = np.log(chance.random((1, 64, 5), dtype=np.float32) + 0.01)
    now = CandidatePosterior.before(model, a_fiber(64), np.concatenate([same, same]))
    assert np.abs(now.information_bits(512, chance)).max() < 0.01


def test_the_gain_is_integrated_out() -> None:
    """Against quadrature over the gain, for Poisson counts under two presses."""
    unknowns = Unknowns((20.0, 100.0), dispersion=(1.0, 1.0))
    model = CountModel(0.5, unknowns)
    rates = np.array([[0.3, 0.8], [0.6, 0.5]])
    counts = np.array([4.0, 13.0])
    now = CandidatePosterior.before(model, a_fiber(), np.log(rates, dtype=np.float32).reshape(2, 1, 2))
    for press, count in enumerate(counts):
        now = now.updated(press, np.array([count]))
    shape, mean = unknowns.gain_shape, unknowns.gain_mean_per_s
    prior = gamma(shape, scale=mean / shape)
    exact = [quad(lambda k, g=g: prior.pdf(k) * poisson.pmf(counts, 0.5 * k * g).prod(), 0, 400)[0] for g in rates]
    evidence = now.log_evidence[0]
    assert evidence[0] - evidence[1] == pytest.approx(np.log(exact[0] / exact[1]), abs=1e-4)


def test_drift_is_part_of_the_likelihood() -> None:
    """A rate that grows is likelier on a fiber that drifts."""
    model = CountModel(1.0, Unknowns((20.0, 100.0), dispersion=(1.0, 1.0)))
    log_rate = np.zeros((1, 1), dtype=np.float32)
    still, drifting = (
        float(model.log_likelihood(_growing(), log_rate, a_fiber(drift=drift))[0, 0]) for drift in (0.0, 0.5)
    )
    assert drifting > still + 3


def _growing():  # type: ignore[no-untyped-def]
    sums = no_counts(1, 1, 20.0)
    for tau, count in zip(np.linspace(-0.95, 0.95, 20), np.linspace(25, 65, 20).round(), strict=True):
        sums = with_counts(sums, 0, np.array([count]), float(tau))
    return sums


@pytest.mark.parametrize("dispersion", [0.4, 1.0, 1.5, 3.0])
def test_counts_scatter_as_stated(dispersion: float) -> None:
    counts = draw_counts(np.full(40_000, 20.0), dispersion, np.random.default_rng(2))
    assert counts.mean() == pytest.approx(20.0, rel=0.01)
    assert counts.var() / counts.mean() == pytest.approx(dispersion, rel=0.05)
    assert (counts == counts.round()).all()


@pytest.mark.parametrize("dispersion", [1.0, 1.5])
def test_bins_are_those_of_the_counts(dispersion: float) -> None:
    """Every level's bins have probability 1, and the first holds no spike."""
    bins = count_bins(CountModel(1.0, Unknowns(dispersion=(dispersion, dispersion))))
    assert bins.chance.sum(axis=1) == pytest.approx(1.0, abs=1e-5)
    mean = (80 / 8) ** 2
    wide = mean / (dispersion - 1 or 1)
    none = nbinom.pmf(0, wide, 1 / dispersion) if dispersion > 1 else poisson.pmf(0, mean)
    assert bins.chance[80, 0] == pytest.approx(none, abs=1e-6)


def test_the_set_is_the_smallest() -> None:
    probability = np.array([[0.96, 0.03, 0.01], [0.5, 0.1, 0.4], [0.6, 0.36, 0.04]])
    assert in_set(probability).tolist() == [[True, False, False], [True, True, True], [True, True, False]]
