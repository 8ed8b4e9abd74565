"""Pressures within contacts: their prior, evidence, climb and mixtures, each against what it must equal."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.stats import multivariate_normal, norm, truncnorm

from sim.coding.profiles import seen as seeing
from sim.coding.profiles.climb import (
    MOST_CONTACTS,
    Climb,
    Sort,
    alone,
    climbed,
    neighbours,
    runs,
    sort_of,
)
from sim.coding.profiles.contact import KINDS, Contact, Kind
from sim.coding.profiles.mixture import Mixture, cut_off, mixed, together
from sim.coding.profiles.seen import Model, Seen, linearised

Array = NDArray[np.float64]

BLUNT, SHARP = KINDS.index(Kind(0.7, 0.15, 0.15)), KINDS.index(Kind(0.7, 0.15, 2.0))
TWO: Model = (Contact(0, 2, BLUNT), Contact(4, 7, SHARP))


@pytest.fixture
def seven() -> Seen:
    """Five readings of seven samples whose true pressures lie within samples 2 … 4."""
    rng = np.random.default_rng(2)
    slope = rng.normal(size=(5, 7))
    true = 40.0 * np.array([0, 0, 0.5, 1.0, 0.6, 0, 0])
    return linearised(slope, slope @ true + rng.normal(size=5), np.eye(5), 40.0)


# --- one contact ---


def test_kinds_are_all_levels_with_all_ends_and_their_probabilities_sum_to_1() -> None:
    assert len(set(KINDS)) == len(KINDS) == 12
    assert {kind.level for kind in KINDS} == {0.3, 0.7, 1.6}
    assert sum(np.exp(Contact(0, 3, kind).log_prior) for kind in range(12)) == pytest.approx(1.0)
    blunt, sharp, both = (Contact(0, 3, KINDS.index(Kind(0.7, *e))) for e in ((0.15, 0.15), (0.15, 2.0), (2.0, 2.0)))
    assert sharp.log_prior - blunt.log_prior == pytest.approx(np.log(0.3 / 0.7))
    assert both.log_prior - blunt.log_prior == pytest.approx(2 * np.log(0.3 / 0.7))


def test_a_contact_has_its_level_inside_and_half_of_it_at_its_ends() -> None:
    assert_allclose(Contact(3, 7, BLUNT).mean, 0.7 * np.array([0.5, 1, 1, 0.5]))
    assert_allclose(Contact(3, 4, BLUNT).mean, [0.35])
    assert Contact(3, 7, BLUNT).samples == slice(3, 7)


def test_a_sharp_end_lets_its_two_samples_stand_out() -> None:
    sd = np.sqrt(np.diag(Contact(0, 8, SHARP).covariance)) / 0.7
    inside = 0.5**2 + 0.2**2 + 0.02**2
    assert_allclose(sd[2:6] ** 2, inside)
    assert_allclose(sd[[1, 6]] ** 2, [inside + 0.15**2, inside + 2.0**2])
    outermost = (0.5**2 + 0.2**2) / 4 + 0.02**2 + 0.3**2
    assert_allclose(sd[[0, 7]] ** 2, [outermost + 0.15**2, outermost + 2.0**2])


def test_pressures_inside_go_together_the_more_the_nearer() -> None:
    covariance = Contact(0, 20, BLUNT).covariance / 0.7**2
    slow = covariance[8, 8:18] - 0.5**2
    assert slow[0] == pytest.approx(0.2**2 + 0.02**2)
    r = np.sqrt(5) * np.arange(1, 10) / 4.0  # Matérn 5/2
    assert_allclose(slow[1:], 0.2**2 * (1 + r + r * r / 3) * np.exp(-r))
    assert np.linalg.eigvalsh(covariance)[0] >= 0.02**2 * 0.99


# --- evidence and posterior ---


def test_evidence_is_the_density_of_the_readings_under_the_prior(monkeypatch: pytest.MonkeyPatch) -> None:
    """Against scipy, in the readings' own space: but for the constant of the normal density, nothing is left out."""
    monkeypatch.setattr(seeing, "VISIBLE", 0.0)
    rng = np.random.default_rng(0)
    slope, value, root = rng.normal(size=(9, 7)), 30 * rng.normal(size=9), rng.normal(size=(9, 9))
    noise, typical = root @ root.T + np.eye(9), 25.0
    models: list[Model] = [(Contact(1, 4, 3),), TWO, (Contact(0, 1, 0), Contact(2, 3, 1), Contact(5, 6, 11))]
    found = linearised(slope, value, noise, typical).log_evidence(models)
    for model, evidence in zip(models, found, strict=True):
        mean, prior = _of(model)
        density = multivariate_normal(slope @ mean * typical, noise + typical**2 * slope @ prior @ slope.T)
        places = sum(contact.log_prior - np.log(28) for contact in model)  # 28 places of a contact in 7 samples
        assert evidence == pytest.approx(density.logpdf(value) + 4.5 * np.log(2 * np.pi) + places)


def test_what_cannot_be_seen_is_dropped_and_changes_next_to_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    slope = np.diag([1.0, 0.3, 0.019 / 5, 0.021, 1e-3, 0.0, 0.0])
    value, models = np.array([8.0, 2, 0.1, 0, 0.3, 0, 0.2]), [TWO, alone(7)[3]]
    cut = linearised(slope, value, np.eye(7), 10.0)
    assert cut.matrix.shape == (3, 7)
    monkeypatch.setattr(seeing, "VISIBLE", 0.0)
    assert_allclose(
        cut.log_evidence(models), linearised(slope, value, np.eye(7), 10.0).log_evidence(models), atol=0.1
    )


def test_the_posterior_is_that_of_linear_readings(seven: Seen) -> None:
    means, covariances = seven.posterior([(Contact(2, 5, BLUNT),), TWO])
    for model, mean, covariance in zip([(Contact(2, 5, BLUNT),), TWO], means, covariances, strict=True):
        before, prior = _of(model)
        on = np.diag(prior) > 0
        inside = np.ix_(on, on)
        precision = np.linalg.inv(prior[inside]) + seven.matrix[:, on].T @ seven.matrix[:, on]
        assert_allclose(covariance[inside], np.linalg.inv(precision), atol=1e-9)
        left = seven.value - seven.matrix @ before
        assert_allclose(mean[on], before[on] + np.linalg.solve(precision, seven.matrix[:, on].T @ left))
        assert not mean[~on].any()
        assert not covariance[~on].any()


def _of(model: Model) -> tuple[Array, Array]:
    mean, prior = np.zeros(7), np.zeros((7, 7))
    for contact in model:
        mean[contact.samples] = contact.mean
        prior[contact.samples, contact.samples] = contact.covariance
    return mean, prior


# --- the climb ---


def test_neighbours_are_models_that_can_be() -> None:
    for model in (TWO, (Contact(0, 7, 2),), (Contact(0, 1, 0), Contact(2, 3, 0), Contact(5, 7, 4))):
        around = list(neighbours(model, 7))
        assert len(around) > 20
        for other in around:
            assert 0 < len(other) <= MOST_CONTACTS
            assert other[0].first >= 0
            assert other[-1].stop <= 7
            assert all(contact.first < contact.stop for contact in other)
            assert all(a.stop < b.first for a, b in pairwise(other))


def test_neighbours_move_ends_change_kinds_split_join_leave_out_and_add() -> None:
    around = set(neighbours(TWO, 12))
    first, second = TWO
    assert (first, second._replace(stop=9)) in around
    assert (first, second._replace(first=3, stop=6)) in around
    assert (first, second._replace(first=2)) not in around  # no free sample between
    assert (first._replace(kind=7), second) in around
    assert (first,) in around
    assert (second,) in around
    assert (Contact(0, 7, BLUNT),) in around
    assert (first, Contact(4, 5, SHARP), Contact(6, 7, SHARP)) in around
    assert (first, second, Contact(10, 12, BLUNT)) in around
    alike = set(neighbours(TWO, 12, alike=True))
    assert alike < around
    assert {len(model) for model in alike} == {2}
    assert (first, second._replace(stop=9)) in alike


def test_what_lies_above_a_share_of_the_peak_is_a_contact() -> None:
    pressure = np.array([0.0, 3, 100, 30, 0, 0, 8, 0])
    spans = [[(c.first, c.stop) for c in model] for model in runs(pressure)]
    assert spans == [[(0, 8)], [(1, 4), (6, 7)], [(2, 4), (6, 7)], [(2, 4)], [(2, 4)], [(2, 3)]]
    comb = np.array([1.0, 0, 1, 0, 1, 0, 1])
    assert len(runs(comb)) == 1  # four contacts are more than are looked for


def test_single_contacts_begin_and_end_at_every_other_sample() -> None:
    assert [(c.first, c.stop) for (c,) in alone(5)] == [(0, 2), (0, 4), (2, 4)]


def test_the_climb_ends_on_top_and_keeps_to_its_sort(seven: Seen) -> None:
    climb = climbed(seven, alone(7), 3)
    assert climb.at_top
    (top,) = climb.best(1)
    evidence = climb.known[top]
    assert evidence == max(climb.known.values())
    assert evidence >= seven.log_evidence(list(neighbours(top, 7))).max()
    assert (top[0].first, top[0].stop) == (2, 5)
    blunt = climbed(seven, [(Contact(0, 2, BLUNT),), (Contact(0, 2, SHARP),)], sort=Sort(1, sharp=False))
    assert {sort_of(model) for model in blunt.known} == {Sort(1, sharp=False)}
    assert blunt.at_top


def test_the_best_of_each_sort_unless_far_below() -> None:
    one, two, other = (Contact(0, 2, BLUNT),), (Contact(0, 2, SHARP),), (Contact(0, 3, BLUNT),)
    climb = Climb({one: -3.0, two: -9.0, other: -4.0, TWO: -20.0}, at_top=True)
    assert climb.best(2) == [one, other]
    assert climb.best_of_sorts(10.0) == {Sort(1, sharp=False): one, Sort(1, sharp=True): two}
    assert sort_of(TWO) == Sort(2, sharp=True)


def test_a_climb_that_is_cut_off_says_so(seven: Seen, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.coding.profiles.climb._MOST_STEPS", 1)
    assert not climbed(seven, [(Contact(0, 1, BLUNT),)]).at_top


# --- what is not negative ---


def test_one_pressure_is_cut_off_as_the_normal_distribution() -> None:
    mean, covariance, above = cut_off(np.array([[-1.0, 9.0]]), np.array([np.diag([4.0, 1.0])]))
    exact = truncnorm(0.5, np.inf, -1.0, 2.0)
    assert_allclose(mean, [[exact.mean(), 9.0]])
    assert_allclose(covariance, [np.diag([exact.var(), 1.0])], atol=1e-12)
    assert above[0] == pytest.approx(norm.logcdf(-0.5))


def test_pressures_that_go_together_give_way_together() -> None:
    """Against samples: two pressures of which one is mostly negative and pulls the other with it.

    Each is cut off once, so that what the second cut does to the first is missed: some 10 % of an sd.
    """
    mean, covariance = np.array([-0.5, 2.0, 5.0]), np.array([[1.0, -0.9, 0.0], [-0.9, 1.5, 0.0], [0.0, 0.0, 0.01]])
    drawn = np.random.default_rng(1).multivariate_normal(mean, covariance, 200_000)
    kept = drawn[(drawn >= 0).all(axis=1)]
    found, spread, above = cut_off(mean[None], covariance[None])
    assert_allclose(found[0], kept.mean(axis=0), atol=0.08)
    assert_allclose(np.sqrt(np.diag(spread[0])), kept.std(axis=0), atol=0.07)
    assert above[0] == pytest.approx(np.log(len(kept) / len(drawn)), abs=0.05)


def test_a_sample_outside_all_contacts_is_left_alone() -> None:
    mean, covariance, above = cut_off(np.array([[0.0, 3.0]]), np.array([np.diag([0.0, 0.01])]))
    assert_allclose(mean, [[0.0, 3.0]])
    assert_allclose(covariance[0], np.diag([0.0, 0.01]))
    assert above[0] == 0.0


# --- mixtures ---


def test_a_mixtures_moments_and_quantiles() -> None:
    mixture = Mixture(
        np.log([3.0, 1.0]) - 500.0, np.array([[2.0, 0.0], [6.0, 5.0]]), np.array([[1.0, 0.0], [1.0, 2.0]])
    )
    assert_allclose(mixture.weight, [0.75, 0.25])
    mean, sd = mixture.moments()
    assert_allclose(mean, [3.0, 1.25])
    assert_allclose(sd**2, [1 + 0.75 * 1 + 0.25 * 9, 0.25 * 4 + 0.75 * 1.25**2 + 0.25 * 3.75**2])
    for share in (0.1, 0.6, 0.9):
        at = mixture.quantile(share)[0]
        assert 0.75 * norm.cdf(at - 2) + 0.25 * norm.cdf(at - 6) == pytest.approx(share)
    assert mixture.quantile(0.7)[1] == pytest.approx(0.0, abs=1e-9)  # three quarters lie outside all contacts
    assert norm.cdf((mixture.quantile(0.9)[1] - 5) / 2) == pytest.approx(0.6)


def test_models_are_weighed_by_evidence_and_by_how_surely_they_are_positive(seven: Seen) -> None:
    good, bad, far = (Contact(2, 5, BLUNT),), (Contact(0, 2, BLUNT),), (Contact(5, 7, BLUNT),)
    mixture = mixed(seven, {good: -1.0, bad: -2.0, far: -90.0})
    assert len(mixture.log_weight) == 2
    means, covariances, above = cut_off(*seven.posterior([good, bad]))
    assert_allclose(mixture.log_weight, np.array([-1.0, -2.0]) + above)
    assert_allclose(mixture.mean, 40.0 * means)
    assert_allclose(mixture.sd**2, 1600.0 * np.diagonal(covariances, axis1=1, axis2=2), atol=1e-9)
    both = together([mixture, mixture])
    assert_allclose(both.moments()[0], mixture.moments()[0])
    assert both.mean.shape == (4, 7)
