"""Imagined pressures, the table of their SED, and what it makes of readings: by itself, and beside a search."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from sim.coding import model_averaging as tables
from sim.coding.bayes import decode_profile
from sim.coding.decoder_results import decoding_errors
from sim.coding.encoding import noise_sd
from sim.coding.model_averaging import Mixture, ProfileTable, imagined, pooled
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
