"""Class and size of an indentor from the skin on it: made-up outlines, then pressures of presses."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from sim.coding.operators import centred
from sim.coding.pressure import SectionSkin, contact_pressure, frictionless
from sim.coding.section import SampledSection, Sampling, sampled_section
from sim.coding.shape_class import classify_shape, edges_mm
from sim.config import FingertipConfig

Array = NDArray[np.float64]

ENDS = centred(40, 0.17)
PLACES = centred(39, 0.17)


def _lying_on(height: Array, noise_mm: float = 0.0) -> SectionSkin:
    """A skin whose samples' ends are at these heights whatever bears on it."""
    up = height + noise_mm * np.random.default_rng(0).normal(size=40)
    return SectionSkin(np.stack([ENDS, up]), np.zeros((2, 40, 78)), np.tile([0.0, 1.0], (39, 1)))


def _within(low: float, high: float) -> Array:
    return np.where((low < PLACES) & (high > PLACES), 100.0, 0.0)


@pytest.mark.parametrize("diameter", [3.0, 9.0, 15.0])
def test_round_skin_is_a_cylinder_of_that_diameter(diameter: float) -> None:
    radius = diameter / 2
    on = np.sqrt(np.maximum(1e-9, radius**2 - (ENDS - 0.2) ** 2))
    found = classify_shape(_lying_on(7.0 - on, 1e-4), _within(-0.9, 1.2))
    assert found.name == "cylinder"
    assert found.size_mm == pytest.approx(diameter, rel=0.03)


def test_flat_skin_is_a_bar_as_wide_as_its_peaks_lie_apart() -> None:
    pressure = _within(-1.0, 1.0)
    pressure[[14, 24]] = 900.0  # 0.85 mm to each side
    found = classify_shape(_lying_on(np.full(40, 5.0), 1e-3), pressure)
    assert found.name == "bar"
    assert found.size_mm == pytest.approx(1.70 + 0.17)
    assert_allclose(edges_mm(_lying_on(np.full(40, 5.0)), pressure), [-0.85 - 0.085, 0.85 + 0.085])
    pressure[13] = 500.0  # of a peak between two samples, by what each bears over the rest: 400 and 800
    assert edges_mm(_lying_on(np.full(40, 5.0)), pressure)[0] == pytest.approx(-0.85 - 0.085 - 0.17 / 3)


@pytest.mark.parametrize("half_wave", [1.3, 2.5])
def test_skin_on_a_flank_between_two_levels_is_a_step(half_wave: float) -> None:
    s = np.clip((ENDS + 1.2) / half_wave, 0.0, 1.0)
    found = classify_shape(_lying_on(5.0 + 0.25 * (1 - np.cos(np.pi * s)), 1e-4), _within(-2.0, 2.0))
    assert found.name == "step"
    assert found.size_mm == pytest.approx(half_wave, rel=0.1)


@pytest.fixture(scope="module")
def section() -> SampledSection:
    """What is pressed and what decodes."""
    return sampled_section(FingertipConfig(), Sampling())


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
def test_the_pressures_of_a_press_tell_what_pressed(
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
