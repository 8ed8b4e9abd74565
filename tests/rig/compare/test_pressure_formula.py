"""The pressure formula of Raju (1998), Eq. 4.1 and 4.2: exact where it holds, and what the finger gives."""

import numpy as np
import pytest

from rig.compare.pressure_formula import (
    FROM_EDGE_MM,
    Constants,
    Places,
    finger_curvature,
    fit,
    places,
    predicted,
    recover_curvature,
    residual,
    together,
)
from sim.models.fingertip import Fingertip

TRUE = Constants(600.0, 900.0, 250.0)


def parabola(doi_mm: float, curvature: float, x_mm: np.ndarray) -> Places:
    """A round object pressed at 0: the skin follows it."""
    d = doi_mm - 0.5 * curvature * x_mm**2
    d0 = doi_mm * (1 - TRUE.k1 / TRUE.k2)
    pressure = TRUE.k2 * (d - d0) + TRUE.k3 * curvature  # Eq. 4.1, 4.2 as they are written
    n = np.ones_like(x_mm)
    return Places(doi_mm * n, d, curvature * n, pressure, n, n)


def test_constants_come_back_exactly() -> None:
    x = np.linspace(-0.5, 0.5, 9)
    at = together([parabola(doi, c, x) for doi in (0.3, 0.7, 1.0) for c in (0.3, 0.5, 0.9)])
    # exact input: what is lost is round-off times the condition of a 81 × 3 system, far below 1e-9
    np.testing.assert_allclose(fit(at), TRUE, rtol=1e-9)
    np.testing.assert_allclose(predicted(TRUE, at), at.pressure, rtol=1e-12)


def test_one_depth_and_one_curvature_do_not_determine_the_constants() -> None:
    assert np.isnan(fit(parabola(0.5, 0.4, np.linspace(-0.4, 0.4, 9)))).all()


@pytest.mark.parametrize("curvature", [0.3, 0.9, -0.2])
def test_curvature_comes_back_from_the_profile(curvature: float) -> None:
    x = np.linspace(-0.6, 0.6, 8)
    found = recover_curvature(x + 0.31, parabola(0.8, curvature, x).pressure, 0.8, TRUE)
    assert found == pytest.approx(curvature, rel=1e-9)


def test_the_residual_is_of_the_pressure() -> None:
    at = together([parabola(doi, 0.5, np.linspace(-0.5, 0.5, 9)) for doi in (0.3, 1.0)])
    assert residual(TRUE, at)[0] < 1e-9
    assert residual(TRUE, at)[1] == pytest.approx(1.0)
    rms, explained = residual(TRUE._replace(k1=TRUE.k1 + 10), at)
    assert rms == pytest.approx(10 * np.sqrt(0.5 * (0.3**2 + 1.0**2)))
    assert explained < 1
    assert explained == pytest.approx(1 - rms**2 / np.var(at.pressure))


def test_the_fingers_curvature_at_the_apex(finger: Fingertip) -> None:
    # the surface knows its own lateral radius at the apex from the parametrisation
    apex = finger.surface.apex
    x, _, z = apex.position_mm
    curvature = finger_curvature(finger.surface, np.array([x]), z)
    np.testing.assert_allclose(1 / curvature, apex.lateral_radius_mm, rtol=1e-9)


def test_what_is_sampled_under_a_cylinder(finger: Fingertip) -> None:
    result = finger.indent("cylinder:9", 0.0, doi_mm=1.0)
    at = places(result, finger.surface)
    touching = result.pressure_profile[1] > 0
    np.testing.assert_array_equal(at.pressure, result.pressure_profile[1][touching])
    # the skin never sinks below the indentor's lowest point, and reaches it to a node's spacing
    assert at.displacement_mm.max() <= 1.0 + 1e-6
    assert at.displacement_mm.max() > 0.98
    # 1/4.5 of the cylinder and 1/3.7 of the finger at its apex
    assert at.curvature_per_mm.mean() == pytest.approx(1 / 4.5 + 1 / 3.66, rel=0.05)
    own = finger_curvature(finger.surface, result.pressure_profile[0][touching], result.z_mm)
    np.testing.assert_allclose(at.curvature_per_mm - own, 1 / 4.5, rtol=1e-9)  # of a circle, however it slopes
    assert (at.inside.from_end_mm >= FROM_EDGE_MM).all()
    assert 0 < len(at.inside.pressure) < len(at.pressure)


CENTRED = {"cylinder:9": (0.33, 1.0, 1.33), "cylinder:3": (1.0, 1.33), "bar:3.0": (0.33, 0.67, 1.0, 1.33)}


def sampled(finger: Fingertip) -> Places:
    scenes = [(shape, doi) for shape, dois in CENTRED.items() for doi in dois]
    return together([places(finger.indent(shape, 0.0, doi_mm=doi), finger.surface) for shape, doi in scenes])


def test_depth_and_curvature_carry_the_pressure_away_from_edges(finger: Fingertip) -> None:
    """Raju (1998, ch. 4): good away from edges; at smooth edges the formula does not go to 0."""
    everywhere = sampled(finger)
    constants = fit(everywhere.inside)
    assert constants.k1 > 0
    assert constants.k3 > 0
    inside, _ = residual(constants, everywhere.inside)
    assert inside < 0.15 * everywhere.inside.pressure.mean()  # a tenth or so; the formula is a straight line in C
    ends, _ = residual(constants, everywhere.where(everywhere.from_end_mm < 0.1))
    assert ends > 3 * inside


def test_a_stiff_epidermis_turns_k2_around(finger: Fingertip) -> None:
    """The source has K2 > 0. Here pressure rises towards the ends of the contact, as under a bent plate."""
    result = finger.indent("cylinder:9", 0.0, doi_mm=1.0)
    at = places(result, finger.surface).inside
    deepest, shallowest = at.pressure[np.argmax(at.displacement_mm)], at.pressure[np.argmin(at.displacement_mm)]
    assert shallowest > 1.05 * deepest
    assert fit(sampled(finger).inside).k2 < 0
