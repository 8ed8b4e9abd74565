"""The pressure formula of Raju (1998), Eq. 4.1 and 4.2: exact where it holds, and what the finger gives."""

from dataclasses import replace

import numpy as np
import pytest

from rig.compare.pressure_formula import (
    FROM_EDGE_MM,
    Constants,
    ContactSamples,
    edges_mm,
    finger_curvature,
    fit,
    places,
    predicted,
    refitted,
    together,
)
from sim.contact.shapes import parse_shape
from sim.models.fingertip import Fingertip

TRUE = Constants(600.0, 900.0, 250.0)


def parabola(doi_mm: float, curvature: float, x_mm: np.ndarray) -> ContactSamples:
    """A round object pressed at 0: the skin follows it."""
    d = doi_mm - 0.5 * curvature * x_mm**2
    d0 = doi_mm * (1 - TRUE.k1 / TRUE.k2)
    pressure = TRUE.k2 * (d - d0) + TRUE.k3 * curvature  # Eq. 4.1, 4.2 as they are written
    n = np.ones_like(x_mm)
    return ContactSamples(doi_mm * n, d, curvature * n, pressure, n, n)


def test_constants_come_back_exactly() -> None:
    x = np.linspace(-0.5, 0.5, 9)
    at = together([parabola(doi, c, x) for doi in (0.3, 0.7, 1.0) for c in (0.3, 0.5, 0.9)])
    # exact input: what is lost is round-off times the condition of a 81 × 3 system, far below 1e-9
    np.testing.assert_allclose(fit(at), TRUE, rtol=1e-9)
    np.testing.assert_allclose(predicted(TRUE, at), at.pressure, rtol=1e-12)


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


# --- over the whole patch, away from the indentor's edges ---


@pytest.mark.parametrize(
    ("shape", "edges"),
    [("bar:3.0", [-1.5, 1.5]), ("bar:1.5", [-0.75, 0.75]), ("step:1", [0.0]), ("step:3", []), ("cylinder:3", [])],
)
def test_where_an_indentor_has_edges(shape: str, edges: list[float]) -> None:
    found = edges_mm(parse_shape(shape))
    assert all(np.abs(found - edge).min() < 0.02 for edge in edges)
    assert all(np.abs(np.array(edges) - one).min() < 0.07 for one in found)  # an edge is as wide as its radius


def test_refitting_exact_places_gives_the_same_constants() -> None:
    x = np.linspace(-0.5, 0.5, 9)
    spread = refitted([parabola(doi, c, x) for doi in (0.3, 0.7, 1.0) for c in (0.3, 0.5, 0.9)], resamples=50)
    assert spread.of.shape == (50, 3)
    np.testing.assert_allclose(spread.of, np.tile(TRUE, (50, 1)), rtol=1e-6)
    np.testing.assert_allclose(spread.intervals, [(k, k) for k in TRUE], rtol=1e-6)
    np.testing.assert_allclose(spread.k2_over_k1, (300, 300), rtol=1e-6)


def test_intervals_are_over_indentations() -> None:
    """Two indentations that disagree are drawn as wholes: many nodes of one do not make it more certain."""
    x = np.linspace(-0.5, 0.5, 9)
    parts = [parabola(doi, c, x) for doi in (0.3, 0.7, 1.0) for c in (0.3, 0.5, 0.9)]
    off = [replace(part, pressure=part.pressure + 50 * (-1) ** k) for k, part in enumerate(parts)]
    many = [together([part] * 20) for part in off]
    few, more = refitted(off, resamples=200), refitted(many, resamples=200)
    np.testing.assert_allclose(few.of, more.of, rtol=1e-6)
    low, high = few.intervals[0]
    assert low < TRUE.k1 < high
    assert high - low > 20


def test_over_the_patch_the_constants_are_as_the_source_has_them(finger: Fingertip) -> None:
    """Raju (1998, ch. 4): all positive, K2 above K1; one row alone, without contacts' ends, turns K2 around."""
    scenes = [(shape, doi) for shape, dois in CENTRED.items() for doi in dois]
    parts = [places(finger.indent(s, 0.0, doi_mm=d), finger.surface, "patch").off_edges for s, d in scenes]
    k1, k2, k3 = fit(together(parts))
    assert min(k1, k2, k3) > 0
    assert k2 > 1.1 * k1
    assert refitted(parts, resamples=300).k2_over_k1[0] > 0
