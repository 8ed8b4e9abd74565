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
from sim.coding.pressure import Frictionless, SectionSkin, contact_pressure, frictionless
from sim.coding.receptor_readings import Readings
from sim.coding.section import SampledSection, Sampling, sampled_section
from sim.coding.shape_class import classify_shape, edges_mm
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


# --- class and size of an indentor from the skin on it ---

ENDS = centred(40, 0.17)


def _lying_on(height: Array, noise_mm: float = 0.0) -> SectionSkin:
    """A skin whose samples' ends are at these heights whatever bears on it."""
    up = height + noise_mm * np.random.default_rng(0).normal(size=40)
    return SectionSkin(np.stack([ENDS, up]), np.zeros((2, 40, 78)), np.tile([0.0, 1.0], (39, 1)))


def _within(low: float, high: float) -> Array:
    return np.where((low < PLACES) & (high > PLACES), 100.0, 0.0)


@pytest.mark.parametrize("diameter", [3.0, 9.0, 15.0])
def test_round_profile_skin_is_classified_as_a_cylinder_of_its_diameter(diameter: float) -> None:
    radius = diameter / 2
    on = np.sqrt(np.maximum(1e-9, radius**2 - (ENDS - 0.2) ** 2))
    found = classify_shape(_lying_on(7.0 - on, 1e-4), _within(-0.9, 1.2))
    assert found.name == "cylinder"
    assert found.size_mm == pytest.approx(diameter, rel=0.03)


def test_flat_skin_is_classified_as_a_bar_as_wide_as_its_pressure_peaks() -> None:
    pressure = _within(-1.0, 1.0)
    pressure[[14, 24]] = 900.0  # 0.85 mm to each side
    found = classify_shape(_lying_on(np.full(40, 5.0), 1e-3), pressure)
    assert found.name == "bar"
    assert found.size_mm == pytest.approx(1.70 + 0.17)
    assert_allclose(edges_mm(_lying_on(np.full(40, 5.0)), pressure), [-0.85 - 0.085, 0.85 + 0.085])
    pressure[13] = 500.0  # of a peak between two samples, by what each bears over the rest: 400 and 800
    assert edges_mm(_lying_on(np.full(40, 5.0)), pressure)[0] == pytest.approx(-0.85 - 0.085 - 0.17 / 3)


@pytest.mark.parametrize("half_wave", [1.3, 2.5])
def test_skin_on_a_flank_between_two_levels_is_classified_as_a_step(half_wave: float) -> None:
    s = np.clip((ENDS + 1.2) / half_wave, 0.0, 1.0)
    found = classify_shape(_lying_on(5.0 + 0.25 * (1 - np.cos(np.pi * s)), 1e-4), _within(-2.0, 2.0))
    assert found.name == "step"
    assert found.size_mm == pytest.approx(half_wave, rel=0.1)


@pytest.mark.parametrize(
    ("shape", "x_mm", "doi_mm", "name", "size", "within"),
    [
        ("cylinder:9", 0.4, 1.0, "cylinder", 9.0, 0.1),
        ("cylinder:3", 0.0, 0.67, "cylinder", 3.0, 0.1),
        ("bar:2.0", 0.0, 0.9, "bar", 2.0, 0.1),
        ("bar:1.5", -0.3, 0.8, "bar", 1.5, 0.1),
        ("step:3", -1.2, 0.8, "step", 1.3, 0.35),
    ],
)
def test_the_pressures_of_a_press_identify_the_indentor(
    section: SampledSection,
    shape: str,
    x_mm: float,
    doi_mm: float,
    name: str,
    size: float,
    within: float,
) -> None:
    true = contact_pressure(section, section.finger.indent(shape, x_mm, doi_mm=doi_mm)).means(PLACES)
    found = classify_shape(frictionless(section, ENDS, "finite").skin, true)
    assert found.name == name
    assert_allclose(found.size_mm, size, rtol=within)
