"""Controls: the half-space against closed forms, and all of them on a real press."""

import numpy as np
import pytest

from rig.compare.stimuli import CONTROLS, controls, half_space_strain, stimuli
from rig.data import Run
from sim.measures.measures import Elastic, measures_from_strain
from sim.models.fingertip import Fingertip


def test_a_uniform_pressure_on_a_half_space_is_one_dimensional() -> None:
    """Wide against its depth: σyy = σxx = −p (Johnson 1985, Eq. 2.30), so e = −(1 + ν)(1 − 2ν) p / E in both."""
    x = np.linspace(-400, 400, 40001)
    found = half_space_strain(x, np.full_like(x, 500.0), np.array([0.0]), np.array([0.2]))
    assert found[0] == pytest.approx(1.48 * 0.04 * 500 / 10_000, rel=0.01)


def test_under_a_line_load_stress_is_radial() -> None:
    """σr = −2P cos θ / πr (Johnson 1985, Eq. 2.15), nothing across; the strain is that of Hooke's law."""
    x = np.arange(-3, 3.01, 0.01)
    pressure = np.where(np.abs(x) < 1e-9, 700.0, 0.0)
    at, depth = np.array([0.0, 0.6, -0.6]), np.array([0.76, 0.8, 0.8])
    r = np.hypot(at, depth)
    radial = -2 * 7.0 / np.pi / r * depth / r
    expected = -(1 + 0.48) / 10_000 * (1 - 0.48) * radial
    np.testing.assert_allclose(half_space_strain(x, pressure, at, depth), expected, rtol=1e-3)
    strains = np.zeros((3, 6))
    strains[:, 0], strains[:, 1] = 1.48 / 1e4 * (1 - 0.48) * radial, -1.48 / 1e4 * 0.48 * radial
    np.testing.assert_allclose(-measures_from_strain(strains, Elastic(1e4, 0.48))["ep1"], expected, rtol=1e-9)


def test_of_a_press(finger: Fingertip) -> None:
    """A bar at DOI 0.5 mm: under it the skin goes down by as much, it is flat, and at its edges it turns a corner."""
    result = finger.indent("bar:3.0", 0.0, doi_mm=0.5)
    pressure, down, curvature, strain = controls(result)
    x = result.model.receptors.position_mm[:, 0].tolist()
    middle, edge = (int(np.argmin(np.abs(np.array(x) - place))) for place in (0.0, 1.5))
    skin_x, skin = result.pressure_profile_kpa
    assert pressure[middle] == pytest.approx(np.interp(x[middle], skin_x, skin))
    assert down[middle] == pytest.approx(0.5, abs=0.06)
    assert (down > 0).all()
    assert (down < 0.55).all()
    assert curvature[middle] == 0
    assert curvature[edge] == pytest.approx(np.pi / 2 / 0.17, rel=0.05)
    assert (strain > 0).all()
    assert strain[middle] > strain[0]
    turned = controls(finger.indent("cylinder:3", 0.0, doi_mm=0.2))[2]
    assert turned[middle] == pytest.approx(1 / 1.5, rel=0.01)


def test_a_stimulus_has_them(bar_run: Run, finger: Fingertip) -> None:
    (stimulus,) = stimuli(bar_run, finger)
    assert stimulus.controls is not None
    assert stimulus.controls.shape == (len(CONTROLS), len(stimulus.x_mm), len(stimulus.receptor_mm))
    here = stimulus.controls_at(np.array([0.1]))
    k = stimulus.receptor_mm.tolist().index(0.0)
    place = int(np.argmin(np.abs(stimulus.x_mm - 0.1)))
    np.testing.assert_allclose(here[:, 0, k], stimulus.controls[:, place, k], rtol=0.05, atol=1e-3)
