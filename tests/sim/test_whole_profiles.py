"""Whole pressure profiles: forces that lean as the skin does, and pressures of presses on a finer mesh read back."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from sim.coding import bayes
from sim.coding.bayes import Profile, decode_profile
from sim.coding.decoder_results import DecodingError, decoding_errors
from sim.coding.encoding import Receptor, noise_sd
from sim.coding.operators import at_receptors, centred
from sim.coding.pressure import Frictionless, contact_pressure, frictionless
from sim.coding.receptor_readings import Readings
from sim.coding.section import SampledSection, Sampling, sampled_section
from sim.config import FingertipConfig, MeshSpec
from sim.errors import ModelRangeError
from tests.error_codes import raises

Array = NDArray[np.float64]

PLACES = centred(39, 0.17)


@pytest.fixture(scope="module")
def finer() -> SampledSection:
    """What is pressed."""
    return sampled_section(FingertipConfig(mesh=MeshSpec(level="fine")), Sampling())


def _pressed(section: SampledSection, shape: str, x_mm: float = 0.0, doi_mm: float = 0.67) -> tuple[Array, Array]:
    press = section.finger.indent(shape, x_mm, doi_mm=doi_mm)
    return contact_pressure(section, press).means(PLACES), press.receptor_measures["sed"]


def _said(sed: Array, snr_db: float, seed: int) -> Readings:
    sd = noise_sd(sed, snr_db)
    return Readings.of_sed(sed + sd * np.random.default_rng(seed).normal(size=len(sed)), sd)


# --- forces that lean ---


@pytest.mark.parametrize(("shape", "most"), [("cylinder:9", 0.01), ("cylinder:3", 0.01), ("bar:3.0", 0.008)])
def test_profile_pressures_normal_to_the_pressed_skin_give_the_sed_of_a_press(
    section: SampledSection, operator: Frictionless, shape: str, most: float
) -> None:
    """SED of a press from its normal pressures: to 1 %, where upright ones miss 3 to 8 %."""
    true, sed = _pressed(section, shape)
    missed = np.linalg.norm(operator.sed(true) - sed) / np.linalg.norm(sed)
    upright = operator.leaning(np.zeros(39))
    assert missed < most
    assert np.linalg.norm(upright.sed(true) - sed) / np.linalg.norm(sed) > 2.5 * most


def test_the_pressed_skin_of_a_profile_lies_on_the_indentor(section: SampledSection, operator: Frictionless) -> None:
    press = section.finger.indent("bar:3.0", 0.0, doi_mm=0.67)
    borne = contact_pressure(section, press)
    true = borne.means(PLACES)
    x, y = operator.skin.pressed(true, operator.skin.lean(true) * true)
    inside = np.abs(x) < 1.2
    assert np.ptp(y[inside]) < 0.02  # flat
    assert y[inside].mean() == pytest.approx(operator.skin.at_rest_mm[1].max() - 0.67, abs=0.03)
    assert_allclose(operator.skin.pressed(0 * true, 0 * true), operator.skin.at_rest_mm)


# --- read back ---


@pytest.mark.parametrize(
    ("shape", "x_mm", "most"),
    [("cylinder:9", 0.0, 0.13), ("cylinder:3", 0.0, 0.12), ("bar:3.0", 0.0, 0.12), ("step:1", -1.63, 0.33)],
)
def test_a_press_on_a_finer_mesh_is_decoded_within_its_band(
    operator: Frictionless, finer: SampledSection, shape: str, x_mm: float, most: float
) -> None:
    """At 30 dB, two draws a shape; docs/validation/coding.md has means over 200."""
    true, sed = _pressed(finer, shape, x_mm)
    found = [decode_profile(operator, _said(sed, 30.0, seed)) for seed in (7, 8)]
    assert all(profile.converged for profile in found)
    assert np.mean([decoding_errors(true, profile.pressure).relative_l2 for profile in found]) < most
    held = [(low <= true) & (true <= high) for low, high in (profile.band() for profile in found)]
    assert np.mean(np.array(held)[:, true > 0.02 * true.max()]) > 0.7
    assert all((profile.pressure >= 0).all() for profile in found)


@pytest.fixture(scope="module")
def bar(operator: Frictionless) -> tuple[Array, Readings, Profile]:
    """A made-up bar, its readings at 30 dB, and what they are read back as."""
    true = np.where(np.abs(PLACES) < 1, 300.0, 0.0)
    readings = _said(operator.sed(true), 30.0, 3)
    return true, readings, decode_profile(operator, readings)


def test_decoding_accepts_fewer_readings_than_pressures_down_to_a_limit(
    section: SampledSection, operator: Frictionless
) -> None:
    with raises(ModelRangeError, "samples_beside_patch", from_mm=-4.25, to_mm=4.25):
        frictionless(section, centred(51, 0.17), "finite")
    true = np.where(np.abs(PLACES) < 1, 300.0, 0.0)
    sparse = at_receptors(operator, slice(0, None, 6))
    found = decode_profile(sparse, _said(sparse.sed(true), 30.0, 0))
    assert found.converged
    assert decoding_errors(true, found.pressure).relative_l2 < 0.5
    four = at_receptors(operator, slice(20, 24))
    with raises(DecodingError, "too_few", readings=4, pressures=39, fewest=5):
        decode_profile(four, _said(four.sed(true), 30.0, 0))
    with raises(DecodingError, "fewer_than_pressures", readings=9, pressures=39):
        decode_profile(sparse, _said(sparse.sed(true), 30.0, 0), prior="smooth")


def test_decoding_uses_silent_receptors(operator: Frictionless) -> None:
    true = np.where(np.abs(PLACES) < 1, 300.0, 0.0)
    sed = operator.sed(true)
    receptor = Receptor(2.0, 0.3 * float(sed.max()))
    sd = noise_sd(sed, 30.0)
    rate = receptor.rate(sed + sd * np.random.default_rng(0).normal(size=49))
    assert (rate == 0).sum() > 20
    found = decode_profile(operator, Readings.of_rates(rate, receptor, sd))
    assert found.converged
    assert decoding_errors(true, found.pressure).relative_l2 < 0.4


def test_a_bayes_decoding_that_is_cut_off_is_not_converged(
    operator: Frictionless, bar: tuple[Array, Readings, Profile], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, readings, whole = bar
    assert whole.converged
    monkeypatch.setattr(bayes, "_MOST_ROUNDS", 1)
    assert not decode_profile(operator, readings).converged
