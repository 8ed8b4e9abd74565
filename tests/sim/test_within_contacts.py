"""Pressures within contacts: their prior, evidence, climb and mixtures, each against what it must equal."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.stats import multivariate_normal, norm, truncnorm

from sim.coding.contact_search import (
    KINDS,
    MOST_CONTACTS,
    Climb,
    ContactInterval,
    ContactPrior,
    Model,
    PressureLikelihood,
    PressurePosterior,
    Sort,
    alone,
    climbed,
    linearised,
    neighbours,
    runs,
    sort_of,
    table_of_contacts,
)
from sim.coding.evidence import explained
from sim.coding.model_averaging import Mixture, cut_off, mixed, together

Array = NDArray[np.float64]

BLUNT, SHARP = KINDS.index(ContactPrior(0.7, 0.2, 0.2)), KINDS.index(ContactPrior(0.7, 0.2, 2.0))
TWO: Model = (ContactInterval(0, 2, BLUNT), ContactInterval(4, 7, SHARP))


@pytest.fixture
def seven() -> PressureLikelihood:
    """Five readings of seven samples whose true pressures lie within samples 2 … 4."""
    rng = np.random.default_rng(2)
    slope = rng.normal(size=(5, 7))
    true = 40.0 * np.array([0, 0, 0.5, 1.0, 0.6, 0, 0])
    return linearised(slope, slope @ true + rng.normal(size=5), np.eye(5), 40.0)


# --- one contact ---


def test_kinds_are_all_levels_with_all_ends_and_their_probabilities_sum_to_1() -> None:
    assert len(set(KINDS)) == len(KINDS) == 12
    assert {kind.level for kind in KINDS} == {0.3, 0.7, 1.6}
    assert sum(np.exp(ContactInterval(0, 3, kind).log_prior) for kind in range(12)) == pytest.approx(1.0)
    ends = ((0.2, 0.2), (0.2, 2.0), (2.0, 0.2), (2.0, 2.0))
    each = np.exp([ContactInterval(0, 3, KINDS.index(ContactPrior(0.7, *end))).log_prior for end in ends])
    # the last end is told to be as the first with 0.4, else drawn anew; sharp with 0.5
    assert_allclose(3 * each, [0.5 * (0.4 + 0.6 * 0.5), 0.5 * 0.6 * 0.5, 0.5 * 0.6 * 0.5, 0.5 * (0.4 + 0.6 * 0.5)])
    assert [kind.sharp for kind in KINDS] == 3 * [False, True, True, True]


def test_a_contact_has_its_level_inside_and_half_of_it_at_its_ends() -> None:
    assert_allclose(ContactInterval(3, 7, BLUNT).mean, 0.7 * np.array([0.5, 1, 1, 0.5]))
    assert_allclose(ContactInterval(3, 4, BLUNT).mean, [0.35])
    assert ContactInterval(3, 7, BLUNT).samples == slice(3, 7)


def test_a_sharp_end_lets_its_two_samples_stand_out() -> None:
    sd = np.sqrt(np.diag(ContactInterval(0, 8, SHARP).covariance)) / 0.7
    inside = 0.5**2 + 0.2**2 + 0.02**2
    assert_allclose(sd[2:6] ** 2, inside)
    assert_allclose(sd[[1, 6]] ** 2, [inside + 0.2**2, inside + 2.0**2])
    outermost = (0.5**2 + 0.2**2) / 4 + 0.02**2 + 0.3**2
    assert_allclose(sd[[0, 7]] ** 2, [outermost + 0.2**2, outermost + 2.0**2])


def test_pressures_inside_go_together_the_more_the_nearer() -> None:
    covariance = ContactInterval(0, 20, BLUNT).covariance / 0.7**2
    slow = covariance[8, 8:18] - 0.5**2
    assert slow[0] == pytest.approx(0.2**2 + 0.02**2)
    r = np.sqrt(5) * np.arange(1, 10) / 4.0  # Matérn 5/2
    assert_allclose(slow[1:], 0.2**2 * (1 + r + r * r / 3) * np.exp(-r))
    assert np.linalg.eigvalsh(covariance)[0] >= 0.02**2 * 0.99


# --- evidence and posterior ---


def test_evidence_is_the_density_of_the_readings_under_the_prior() -> None:
    """Against scipy, in the readings' own space: but for the constant of the normal density, nothing is left out."""
    rng = np.random.default_rng(0)
    slope, value, root = rng.normal(size=(9, 7)), 30 * rng.normal(size=9), rng.normal(size=(9, 9))
    noise, typical = root @ root.T + np.eye(9), 25.0
    models: list[Model] = [
        (ContactInterval(1, 4, 3),),
        TWO,
        (ContactInterval(0, 1, 0), ContactInterval(2, 3, 1), ContactInterval(5, 6, 11)),
    ]
    found = linearised(slope, value, noise, typical).log_evidence(models)
    for model, evidence in zip(models, found, strict=True):
        mean, prior = _of(model)
        density = multivariate_normal(slope @ mean * typical, noise + typical**2 * slope @ prior @ slope.T)
        places = sum(contact.log_prior - np.log(28) for contact in model)  # 28 places of a contact in 7 samples
        assert evidence == pytest.approx(density.logpdf(value) + 4.5 * np.log(2 * np.pi) + places)


def test_loops_of_the_evidence_say_the_same_uncompiled_and_of_any_number_of_models(seven: PressureLikelihood) -> None:
    models: list[Model] = [TWO, (ContactInterval(0, 7, 2),), (ContactInterval(3, 4, 11),), *alone(7)]
    together = seven.log_evidence(models)
    assert_allclose([seven.log_evidence([model])[0] for model in models], together, rtol=1e-12)
    at = np.array([[TWO[0], TWO[1]], [(0, 7, 2), (0, 0, 0)]])
    mean, root, _ = table_of_contacts(7)
    plain = explained.py_func(at, np.array([2, 1]), mean, root, seven.precision, seven.towards)  # type: ignore[attr-defined]
    prior = [sum(contact.log_prior - np.log(28) for contact in model) for model in models[:2]]
    assert_allclose(plain + seven.nothing + prior, together[:2], rtol=1e-12)


def test_the_table_of_contacts_has_each_with_nothing_beyond_it() -> None:
    mean, root, log_prior = table_of_contacts(5)
    assert mean.shape == (12, 5, 5)
    for kind in range(12):
        for k in range(5):
            contact = ContactInterval(0, k + 1, kind)
            assert_allclose(mean[kind, k], np.pad(contact.mean, (0, 4 - k)))
            assert_allclose(root[kind, k] @ root[kind, k].T, np.pad(contact.covariance, (0, 4 - k)), atol=1e-12)
        assert log_prior[kind] == contact.log_prior


def test_the_posterior_is_that_of_linear_readings(seven: PressureLikelihood) -> None:
    models: list[Model] = [(ContactInterval(2, 5, BLUNT),), TWO]
    found = seven.posterior(models)
    means, variances = found.over(7)
    for k, model in enumerate(models):
        before, prior = _of(model)
        on = np.diag(prior) > 0
        inside, size = np.ix_(on, on), int(on.sum())
        covariance = np.linalg.inv(np.linalg.inv(prior[inside]) + seven.precision[inside])
        assert_allclose(found.covariance[k, :size, :size], covariance, atol=1e-9)
        left = seven.towards - seven.precision @ before
        assert_allclose(means[k, on], before[on] + covariance @ left[on])
        assert_allclose(variances[k, on], np.diag(covariance))
        assert not means[k, ~on].any()
        assert not variances[k, ~on].any()


def _of(model: Model) -> tuple[Array, Array]:
    mean, prior = np.zeros(7), np.zeros((7, 7))
    for contact in model:
        mean[contact.samples] = contact.mean
        prior[contact.samples, contact.samples] = contact.covariance
    return mean, prior


# --- the climb ---


def test_neighbours_are_models_that_can_be() -> None:
    for model in (
        TWO,
        (ContactInterval(0, 7, 2),),
        (ContactInterval(0, 1, 0), ContactInterval(2, 3, 0), ContactInterval(5, 7, 4)),
    ):
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
    assert (ContactInterval(0, 7, BLUNT),) in around
    assert (first, ContactInterval(4, 5, SHARP), ContactInterval(6, 7, SHARP)) in around
    assert (first, second, ContactInterval(10, 12, BLUNT)) in around
    alike = set(neighbours(TWO, 12, Sort(2, sharp=True)))
    assert alike < around
    assert {len(model) for model in alike} == {2}
    assert (first, second._replace(stop=9)) in alike
    assert {sort_of(model) for model in alike} == {Sort(2, sharp=True)}
    assert (first._replace(kind=7), second) in alike
    assert (first, second._replace(kind=BLUNT)) not in alike  # the only sharp one
    blunt = (first, second._replace(kind=BLUNT))
    assert {sort_of(model) for model in neighbours(blunt, 12, Sort(2, sharp=False))} == {Sort(2, sharp=False)}


def test_what_lies_above_a_share_of_the_peak_is_a_contact() -> None:
    pressure = np.array([0.0, 3, 100, 30, 0, 0, 8, 0])
    spans = [[(c.first, c.stop) for c in model] for model in runs(pressure)]
    assert spans == [[(0, 8)], [(1, 4), (6, 7)], [(2, 4), (6, 7)], [(2, 4)], [(2, 4)], [(2, 3)]]
    comb = np.array([1.0, 0, 1, 0, 1, 0, 1])
    assert len(runs(comb)) == 1  # four contacts are more than are looked for


def test_single_contacts_begin_and_end_at_every_other_sample() -> None:
    assert [(c.first, c.stop) for (c,) in alone(5)] == [(0, 2), (0, 4), (2, 4)]


def test_the_climb_ends_on_top_and_keeps_to_its_sort(seven: PressureLikelihood) -> None:
    climb = climbed(seven, alone(7), 3)
    assert climb.at_top
    (top,) = climb.best(1)
    evidence = climb.known[top]
    assert evidence == max(climb.known.values())
    assert evidence >= seven.log_evidence(list(neighbours(top, 7))).max()
    assert (top[0].first, top[0].stop) == (2, 5)
    blunt = climbed(
        seven, [(ContactInterval(0, 2, BLUNT),), (ContactInterval(0, 2, SHARP),)], sort=Sort(1, sharp=False)
    )
    assert {sort_of(model) for model in blunt.known} == {Sort(1, sharp=False)}
    assert blunt.at_top


def test_the_best_of_each_sort_unless_far_below() -> None:
    one, two, other = (
        (ContactInterval(0, 2, BLUNT),),
        (ContactInterval(0, 2, SHARP),),
        (ContactInterval(0, 3, BLUNT),),
    )
    climb = Climb({one: -3.0, two: -9.0, other: -4.0, TWO: -20.0}, at_top=True)
    assert climb.best(2) == [one, other]
    assert climb.best_of_sorts(10.0) == {Sort(1, sharp=False): one, Sort(1, sharp=True): two}
    assert sort_of(TWO) == Sort(2, sharp=True)


def test_a_climb_that_is_cut_off_says_so(seven: PressureLikelihood, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.coding.contact_search._MOST_STEPS", 1)
    assert not climbed(seven, [(ContactInterval(0, 1, BLUNT),)]).at_top


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


def test_models_are_weighed_by_evidence_and_by_how_surely_they_are_positive(seven: PressureLikelihood) -> None:
    good, bad, far = (ContactInterval(2, 5, BLUNT),), (ContactInterval(0, 2, BLUNT),), (ContactInterval(5, 7, BLUNT),)
    mixture = mixed(seven, {good: -1.0, bad: -2.0, far: -90.0})
    assert len(mixture.log_weight) == 2
    found = seven.posterior([good, bad])
    inside, covariances, above = cut_off(found.mean, found.covariance)
    means, variances = PressurePosterior(found.at, inside, covariances).over(7)
    assert_allclose(mixture.log_weight, np.array([-1.0, -2.0]) + above)
    assert_allclose(mixture.mean, 40.0 * means)
    assert_allclose(mixture.sd**2, 1600.0 * variances, atol=1e-9)
    both = together([mixture, mixture])
    assert_allclose(both.moments()[0], mixture.moments()[0])
    assert both.mean.shape == (4, 7)
