"""Several afferents: the likelihood of a measure in common, checked on afferents whose truth is known."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad

from rig.compare.comparison import compare
from rig.compare.group import Ranked, group_verdict, ranked, surfaces
from rig.compare.likelihood import Form
from rig.compare.make_verdict import CandidatePool, answers, candidate_pool
from rig.compare.recordings.recording import Recording, recording
from rig.compare.stimuli import StimulusRow
from sim.measures.measures import MEASURES

Array = NDArray[np.float64]
Make = Callable[..., StimulusRow]

X = np.linspace(-4, 4, 81)
RECEPTORS = np.array([-1.0, 0.0, 1.0])
POSITIONS = np.linspace(-2, 2, 17)
WIDTHS = {"ep1": 0.6, "sed": 1.0, "e22": 1.6}
"""Bumps of unit height; the other measures are flat."""


@pytest.fixture
def stimulus(make_stimulus: Make) -> StimulusRow:
    profiles = {
        name: np.stack([np.exp(-(((X - at) / width) ** 2)) for at in RECEPTORS], axis=1)
        for name, width in WIDTHS.items()
    }
    return make_stimulus("bar:3", X, RECEPTORS, profiles)


def pools(
    stimulus: StimulusRow, truth: str, number: int, rng: np.random.Generator, presses: int = 5
) -> list[CandidatePool]:
    found = []
    for _ in range(number):
        receptor, k, eps0 = int(rng.integers(3)), 60 * np.exp(0.3 * rng.normal()), 0.3 + 0.1 * rng.normal()
        eps = stimulus.at(POSITIONS)[MEASURES.index(truth), :, receptor]
        counts = rng.poisson(np.maximum(0.0, k * (eps - eps0)), size=(presses, len(POSITIONS)))
        found.append(pool(stimulus, counts))
    return found


def as_recording(counts: Array) -> Recording:
    return recording(
        "synthetic",
        [(float(x), float(n), np.nan) for row in counts for x, n in zip(POSITIONS, row, strict=True)],
        1.0,
    )


def pool(stimulus: StimulusRow, counts: Array) -> CandidatePool:
    found = candidate_pool(compare([stimulus], {"bar:3": as_recording(counts)}).overlays, Form())
    assert found is not None
    return found


def row(rows: list[Ranked], name: str) -> Ranked:
    return next(one for one in rows if one.name == name)


@pytest.mark.quick(rows=lambda number: number == 3)
@pytest.mark.parametrize("number", [2, 3, 6])
def test_the_truth_leads_and_its_population_is_found(stimulus: StimulusRow, number: int) -> None:
    """Seeded sample of studies/answers/group_coverage.py."""
    rng = np.random.default_rng(38)
    draws, inside, wrong, gain, threshold = 20, 0, 0, 0, 0
    for n in range(draws):
        truth = list(WIDTHS)[n % 3]
        rows = ranked(pools(stimulus, truth, number, rng))
        chosen = [one.name for one in rows if one.in_set]
        inside += truth in chosen
        wrong += chosen != [truth] and len(chosen) == 1
        of = row(rows, truth).fit.population
        gain += of.gain_limits[0] <= 60 <= of.gain_limits[1]
        threshold += of.threshold_limits[0] <= 0.3 <= of.threshold_limits[1]
        assert sum(one.probability for one in rows) == pytest.approx(1.0)
    assert inside >= 18
    assert wrong <= 1
    assert gain >= 16
    assert threshold >= 16


def test_more_afferents_separate_what_one_cannot(stimulus: StimulusRow) -> None:
    found = pools(stimulus, "sed", 8, np.random.default_rng(5), presses=1)
    few, many = row(ranked(found[:2]), "sed"), row(ranked(found), "sed")
    assert many.probability > 0.95 > few.probability


def test_order_and_unit_of_a_measure_do_not_matter(stimulus: StimulusRow) -> None:
    rng = np.random.default_rng(3)
    found = pools(stimulus, "ep1", 4, rng)
    forward, backward = ranked(found), ranked(found[::-1])
    assert [one.name for one in forward] == [one.name for one in backward]
    np.testing.assert_allclose(row(forward, "ep1").fit.by_afferent, row(backward, "ep1").fit.by_afferent[::-1])
    scaled = [one._replace(candidates=replace(one.candidates, eps=1e-4 * one.candidates.eps)) for one in found]
    for one in ranked(scaled):
        before = row(forward, one.name)
        assert one.probability == pytest.approx(before.probability, rel=1e-3, abs=1e-9)
        if before.probability > 1e-3:
            assert one.fit.population.gain == pytest.approx(1e4 * before.fit.population.gain, rel=1e-3)
            assert one.fit.population.threshold == pytest.approx(1e-4 * before.fit.population.threshold, rel=1e-3)


def test_a_surface_is_the_integral_of_the_likelihood(stimulus: StimulusRow) -> None:
    """Over log|k| by Laplace and over ε₀ by quadrature, against adaptive quadrature of both."""
    (one,) = pools(stimulus, "sed", 1, np.random.default_rng(8))
    data, found = one.observed, surfaces(one)["sed"]
    n = next(n for n, name in enumerate(one.named) if name.name == "sed" and name.receptor_mm == 0.0)
    fit, eps = one.candidates.fitted(data).found, one.candidates.eps[0][n]
    size = float(data.share(data.smooth).sum())
    dispersion = data.noise.dispersion * max(fit.total.min() / data.noise.dispersion / (size - 2), 1.0)

    def likelihood(log_k: float, eps0: float) -> float:
        deviance = float(data.deviance(np.maximum(0.0, np.exp(log_k) * (eps - eps0))).sum())
        freedom = data.noise.freedom
        base = np.log1p(deviance / (freedom * dispersion)) - np.log1p(fit.total[n] / (freedom * dispersion))
        return float(np.exp(-(freedom + size) / 2 * base))

    def over_k(eps0: float) -> float:
        log_k = np.linspace(-0.8, 0.8, 161) + np.log(fit.k[n])
        return float(np.trapezoid([likelihood(one, eps0) for one in log_k], log_k))

    mass = quad(over_k, fit.eps0[n] - 0.3, fit.eps0[n] + 0.3, limit=60, epsrel=1e-3)[0]
    mean = quad(lambda at: at * over_k(at), fit.eps0[n] - 0.3, fit.eps0[n] + 0.3, limit=60, epsrel=1e-3)[0] / mass
    which = [name.receptor_mm for name in one.named if name.name == "sed"].index(0.0)
    if len(found.log_mass) == 3:
        assert found.mean[which, 1] == pytest.approx(mean, abs=0.01)
    sd = np.sqrt(found.covariance[:, 1, 1])
    assert np.all(sd > 0)
    others = surfaces(one)["ep1"]
    assert np.all(np.isfinite(others.log_mass))


def test_a_measure_without_a_line_counts_as_a_constant(stimulus: StimulusRow) -> None:
    rows = ranked(pools(stimulus, "sed", 3, np.random.default_rng(1)))
    flat = row(rows, "s11")
    assert flat.probability < 1e-6
    assert np.isnan(flat.fit.population.gain)


@pytest.mark.parametrize(
    ("what", "outcome"),
    [("one measure", "one measure"), ("noise", "several measures"), ("another shape", "nothing")],
)
def test_the_outcome(stimulus: StimulusRow, what: str, outcome: str) -> None:
    rng = np.random.default_rng(2)
    judged = {}
    for n in range(4):
        if what == "one measure":
            mean = 80 * np.maximum(0.0, stimulus.at(POSITIONS)[MEASURES.index("sed"), :, n % 3] - 0.2)
        elif what == "noise":
            mean = np.full(len(POSITIONS), 5.0)
        else:
            mean = 60.0 * (np.arange(len(POSITIONS)) % 3 == 0)
        counts = rng.poisson(mean, size=(5, len(POSITIONS)))
        comparison = compare([stimulus], {"bar:3": as_recording(counts)})
        (verdict,), candidates = answers(comparison), candidate_pool(comparison.overlays, Form())
        assert candidates is not None
        judged[f"a{n}"] = candidates, verdict
    group = group_verdict(judged)
    assert group is not None
    assert group.outcome == outcome
    assert sum(one.wins for one in group.rows) == 4
    assert (group.leader is None) == (what != "one measure") or what == "another shape"
    assert group.best.by_afferent.shape == (4,)
    assert group_verdict(dict(list(judged.items())[:1])) is None
