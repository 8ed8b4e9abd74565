"""Imagined pressures, the table of their SED, and what it makes of readings: by itself, and beside a search."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from sim.coding import bayes
from sim.coding import model_averaging as imagining
from sim.coding import model_averaging as tables
from sim.coding.bayes import decode_profile
from sim.coding.decoder_results import decoding_errors
from sim.coding.encoding import noise_sd
from sim.coding.model_averaging import Mixture, ProfileTable, Weighed, imagined, pooled, table_of
from sim.coding.operators import ForwardOperator, centred
from sim.coding.pressure import Frictionless, frictionless
from sim.coding.receptor_readings import Readings
from sim.coding.section import Sampling, sampled_section
from sim.config import FingertipConfig

Array = NDArray[np.float64]

PLACES = centred(39, 0.17)


@pytest.fixture(scope="module")
def operator() -> Frictionless:
    """39 samples 170 µm apart."""
    return frictionless(sampled_section(FingertipConfig(), Sampling()), centred(40, 0.17), "finite")


def _said(operator: ForwardOperator, true: Array, snr_db: float, seed: int) -> Readings:
    sed = operator.sed(true)
    sd = noise_sd(sed, snr_db)
    return Readings.of_sed(sed + sd * np.random.default_rng(seed).normal(size=len(sed)), sd)


# --- imagined pressures ---


def _contacts(pressure: Array) -> Array:
    """How many runs of samples above 0 each has."""
    on = np.concatenate([np.zeros((len(pressure), 1)), pressure > 0], axis=1)
    return np.asarray((np.diff(on, axis=1) > 0).sum(axis=1))


def test_imagined_pressures_are_of_a_few_contacts_and_never_negative() -> None:
    drawn = imagined(4000, 39)
    assert drawn.shape == (4000, 39)
    assert (drawn >= 0).all()
    assert (drawn.max(axis=1) > 0).all()
    assert set(_contacts(drawn)) == {1, 2, 3}
    assert (imagined(50, 39) == imagined(50, 39)).all()
    assert (imagined(50, 39, seed=1) != imagined(50, 39)).any()


def test_how_many_contacts_there_are_is_as_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imagining, "HOW_MANY", (0.0, 1.0, 0.0))
    assert (_contacts(imagined(300, 200)) == 2).mean() > 0.9  # the others touch
    monkeypatch.setattr(imagining, "HOW_MANY", (1.0,))
    assert (_contacts(imagined(300, 39)) == 1).all()


def test_a_contact_without_sharp_ends_varies_slowly_about_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imagining, "SHARP", 0.0)
    first, last = np.full(3000, 2.25), np.full(3000, 20.5)
    drawn = imagining._contact(first, last, 30, np.random.default_rng(0))
    inside = drawn[:, 3:20]
    assert inside.mean() == pytest.approx(1.0, abs=0.02)
    assert inside.std() == pytest.approx(0.2, abs=0.01)
    assert drawn[:, 2].mean() == pytest.approx(0.75, abs=0.02)
    assert drawn[:, 20].mean() == pytest.approx(0.5, abs=0.02)
    assert not drawn[:, :2].any()
    assert not drawn[:, 21:].any()
    r = np.sqrt(5) * np.arange(1, 8) / 4.0  # Matérn 5/2
    along = [np.corrcoef(inside[:, 4], inside[:, 4 + k])[0, 1] for k in range(1, 8)]
    assert_allclose(along, (1 + r + r * r / 3) * np.exp(-r), atol=0.06)


def test_a_sharp_end_rises_as_one_over_the_root_of_the_distance(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imagining, "_SLOW", 0.0)
    monkeypatch.setattr(imagining, "_PEAK_SD", 0.0)
    monkeypatch.setattr(imagining, "SHARP", 1.0)
    (drawn,) = imagining._contact(np.array([4.0]), np.array([12.0]), 16, np.random.default_rng(0))
    height = np.exp(1.3)
    peaks = [height * 2 * (np.sqrt(k + 1) - np.sqrt(k)) * np.exp(-k) for k in range(8)]
    assert_allclose(drawn[4:12], 1 + np.array(peaks) + np.array(peaks)[::-1])
    assert not drawn[:4].any()
    assert not drawn[12:].any()


@pytest.mark.parametrize(("alike", "both"), [(1.0, 0.6), (0.0, 0.36)])
def test_ends_are_sharp_as_often_as_told_and_alike(
    monkeypatch: pytest.MonkeyPatch, alike: float, both: float
) -> None:
    monkeypatch.setattr(imagining, "ALIKE", alike)
    drawn = imagining._contact(np.full(4000, 4.0), np.full(4000, 16.0), 20, np.random.default_rng(0))
    sharp = drawn[:, [4, 15]] > drawn[:, [7, 12]] + 0.6
    assert sharp[:, 0].mean() == pytest.approx(0.6, abs=0.05)
    assert sharp.all(axis=1).mean() == pytest.approx(both, abs=0.06)


# --- the table ---


def _table(*sed: list[float]) -> ProfileTable:
    """Of entries whose pressure k is their number and whose SED is told."""
    rows = np.array(sed)
    rows = (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)
    return ProfileTable(np.eye(len(rows), dtype=np.float32), rows, rows**2)


THREE = ([1.0, 2, 3, 2, 1], [3.0, 1, 0, 1, 3], [0.0, 0, 1, 4, 4])


def test_the_entry_that_explains_readings_is_found_with_its_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "ENOUGH", 1.0)
    said = 400 * np.array(THREE[1])
    found, power = _table(*THREE).weighed(said, np.full(5, 1.0), float(np.linalg.norm(said)))
    assert power == 1.0
    mean, _ = found.moments()
    assert_allclose(mean, [0, np.sqrt(np.linalg.norm(said)), 0], rtol=0.02)
    half, _ = _table(*THREE).weighed(said, np.full(5, 1.0), 4 * float(np.linalg.norm(said)))
    assert_allclose(half.moments()[0], mean, rtol=0.11)  # steps of size are 20 % apart; the one told only begins
    assert_allclose(found.sd, 0.1 * found.mean)


def test_a_readings_own_variance_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "ENOUGH", 1.0)
    said, deaf = np.array([3.0, 1, 0, 4, 4]), np.array([1e-4, 1e-4, 1e-4, 1e6, 1e6])
    found, _ = _table(*THREE).weighed(said, deaf, 5.0)
    assert found.moments()[0].argmax() == 1
    found, _ = _table(*THREE).weighed(np.array([9.0, 9, 1, 4, 4]), deaf[::-1], 5.0)
    assert found.moments()[0].argmax() == 2


def test_where_too_few_entries_explain_readings_their_likelihood_is_weakened(monkeypatch: pytest.MonkeyPatch) -> None:
    said, size = 400 * np.array(THREE[1]), 400 * float(np.linalg.norm(THREE[1]))
    loud = _table(*THREE).weighed(said, np.full(5, 1e9), size)
    assert loud.power == 1.0
    assert_allclose(loud.mixture.moments()[0].min() / loud.mixture.moments()[0].max(), 1.0, atol=0.2)
    quiet = _table(*THREE).weighed(said, np.full(5, 1.0), size)  # 1.5 of 3 entries are asked for
    assert 0 < quiet.power < 1e-3
    assert np.log(quiet.power) / np.log(0.8) == pytest.approx(round(np.log(quiet.power) / np.log(0.8)))
    weight = (quiet.mixture.mean > 0).mean(axis=0)
    assert 1.4 < 1 / (weight**2).sum() < 2.1


def test_unlikely_entries_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "ENOUGH", 1.0)
    near, far = (_at(np.array([0.0, least])) for least in (-7.9, -8.1))
    assert len(near) == 2
    assert len(far) == 1


def _at(best: Array) -> NDArray[np.intp]:
    along = np.sqrt(2 * (best + 10.0))
    return tables._until_enough(tables._Likelihood(along, np.ones(2)))[0]


def test_a_table_is_made_once_for_an_operator(operator: Frictionless, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "ENTRIES", 500)
    small = replace(operator, parts=operator.parts[:, ::2].copy(), lateral=operator.lateral[:, ::2].copy())
    table = table_of(small)
    assert table_of(replace(small)) is table
    assert table_of(replace(small, parts=small.parts.copy())) is not table
    upright = operator.leaning(np.zeros(39)).parts[:, ::2]
    said = ((upright @ table.pressure[7]) ** 2).sum(axis=0)
    assert_allclose(table.sed[7], said, rtol=1e-4, atol=1e-5)
    assert_allclose(np.linalg.norm(table.sed, axis=1), 1.0, rtol=1e-5)
    assert_allclose(table.squared, table.sed**2)
    assert table.pressure.shape == (500, 39)
    assert tables._drawn(500, 39) is tables._drawn(500, 39)
    assert tables._drawn(500, 38).shape == (500, 38)


# --- beside a search ---


def test_two_mixtures_share_the_probability() -> None:
    one = Mixture(np.array([-700.0]), np.array([[2.0, 0.0]]), np.array([[1.0, 0.0]]))
    two = Mixture(np.log([3.0, 1.0]), np.array([[4.0, 4.0], [8.0, 0.0]]), np.ones((2, 2)))
    both = pooled(one, two, 0.2)
    assert_allclose(both.weight, [0.2, 0.6, 0.2])
    assert_allclose(both.moments()[0], [0.4 + 2.4 + 1.6, 2.4])
    assert_allclose(pooled(one, two, 0.0).weight, [0.0, 0.75, 0.25], atol=1e-200)


@pytest.fixture
def flat() -> Array:
    """Contact of 2 mm."""
    return np.where(np.abs(PLACES) < 1, 300.0, 0.0)


def test_where_noise_is_loud_the_table_is_the_answer(
    operator: Frictionless, flat: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bayes, "_by_search", None)
    found = decode_profile(operator, _said(operator, flat, 0.0, 0))
    assert found.converged
    assert found.mixture is not None
    assert len(found.mixture.mean) == 400


def test_without_the_table_the_search_alone_is_the_answer(
    operator: Frictionless, flat: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = Mixture(np.zeros(1), np.full((1, 39), 100.0), np.zeros((1, 39)))
    monkeypatch.setattr(bayes, "_by_table", None)
    monkeypatch.setattr(bayes, "_by_search", lambda *_: (one, False))
    found = decode_profile(operator, _said(operator, flat, 0.0, 0), table=False)
    assert found.mixture is one
    assert not found.converged


@pytest.mark.parametrize(("power", "share"), [(0.1, 0.2), (0.375, 0.75), (0.5, 1.0), (0.9, 1.0)])
def test_the_tables_share_falls_with_what_it_takes_in(
    operator: Frictionless, flat: Array, monkeypatch: pytest.MonkeyPatch, power: float, share: float
) -> None:
    one, other = (Mixture(np.zeros(1), np.full((1, 39), mean), np.zeros((1, 39))) for mean in (100.0, 0.0))
    monkeypatch.setattr(bayes, "_by_table", lambda *_: Weighed(one, power))
    monkeypatch.setattr(bayes, "_by_search", lambda *_: (other, False))
    found = decode_profile(operator, _said(operator, flat, 30.0, 0))
    assert_allclose(found.pressure, 100.0 * share)
    assert found.converged is (share == 1.0)


def test_the_band_always_holds_the_pressure(operator: Frictionless, flat: Array) -> None:
    """Though the mean of a mixture can lie outside its quantiles: where one model in a hundred has a contact."""
    rare = Mixture(np.log([0.99, 0.01]), np.array([[0.0], [500.0]]), np.array([[0.0], [1.0]]))
    mean, sd = rare.moments()
    assert rare.quantile(0.95)[0] < mean[0]
    found = decode_profile(operator, _said(operator, flat, 20.0, 0))
    said = replace(found, pressure=mean, sd=sd, mixture=rare)
    assert_allclose(said.band(), [[0.0], [5.0]], atol=1e-9)
    for one in (found, decode_profile(operator, _said(operator, flat, 5.0, 0))):
        low, high = one.band()
        assert (low <= one.pressure).all()
        assert (one.pressure <= high).all()


@pytest.mark.parametrize("snr_db", [0.0, 10.0])
@pytest.mark.parametrize("peak", [0.0, 900.0])
def test_bands_hold_in_loud_noise_with_and_without_corners(
    operator: Frictionless, flat: Array, snr_db: float, peak: float
) -> None:
    """90 % told; over six draws three quarters are asked for."""
    edges = np.flatnonzero(flat)[[0, -1]]
    true = flat.copy()
    true[edges] += peak
    found = [decode_profile(operator, _said(operator, true, snr_db, seed)) for seed in range(6)]
    held = [(low <= true) & (true <= high) for low, high in (one.band() for one in found)]
    assert np.mean(np.array(held)[:, flat > 0]) > 0.75
    assert np.mean([decoding_errors(true, one.pressure).relative_l2 for one in found]) < 0.85


def test_the_models_error_is_noise_to_the_table(operator: Frictionless, flat: Array) -> None:
    readings, start = _said(operator, flat, 40.0, 0), flat + 10.0
    exact, wrong = (bayes._by_table(operator, readings, bayes.ModelError(share), start) for share in (0.0, 0.3))
    assert wrong.power > 3 * exact.power
