"""Profiles of the indentors: heights of the source, derivatives, sharpness; profiles from files and arrays."""

import errno
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.contact.indentor import SHARP_RADIUS_MM, Indentor, Revolved, ShapeWarning
from sim.contact.measured_profile import MeasuredProfile, ProfileError, read_profile
from sim.contact.profiles import (
    BAR_EDGE_RADIUS_MM,
    STEEPEST_SLOPE,
    Bar,
    Cylinder,
    Grating,
    IndentorProfile,
    SinusoidalStep,
    Wedge,
    measured_radius_mm,
)
from sim.contact.shapes import EXPECTED, ShapeError, parse_shape
from sim.models.fingertip import Fingertip
from tests.error_codes import has_code, raises

WIDTHS = {"dimension": "width", "unit": "mm", "low": 0.2, "high": 20.0}
SHAPES = ("bar:3.0", "bar:1.5", "cylinder:3", "cylinder:9", "step:1", "step:3", "step:5", "wedge:60")


def height(shape: str, s: float) -> float:
    return float(parse_shape(shape).profile.evaluate(np.array([s]))[0][0])


@pytest.mark.parametrize(
    ("shape", "s", "expected"),
    [
        # Raju (1998, ch. 4): step 0.5 mm high, half a cosine of 0.450 mm (step 1) and 3.134 mm (step 5)
        ("step:1", 0.225, 0.25),
        ("step:1", 0.15, 0.25 * (1 - np.cos(np.pi / 3))),
        ("step:1", 0.450, 0.5),
        ("step:5", 1.0, 0.25 * (1 - np.cos(np.pi / 3.134))),
        # bars 3.0 and 1.5 mm wide, flat, the edge's quarter circle (ours: radius 0.05 mm) ends at the half-width
        ("bar:3.0", 0.0, 0.0),
        ("bar:3.0", -1.48, 0.05 - np.sqrt(0.05**2 - 0.03**2)),
        ("bar:1.5", 0.74, 0.05 - np.sqrt(0.05**2 - 0.04**2)),
        # cylinders by diameter
        ("cylinder:3", 1.0, 1.5 - np.sqrt(1.5**2 - 1)),
        # a wedge of half-angle 45° from its axis rises 1 mm a millimetre; the circle at its tip (0.05 mm) takes
        # away r (√2 − 1) from where the flanks would meet
        ("wedge:45", 0.0, 0.0),
        ("wedge:45", 1.0, 1.0 - 0.05 * (np.sqrt(2) - 1)),
        # grating: ridges 0.5 mm wide, 1.2 mm apart, grooves 0.5 mm deep, edges as a bar's
        ("grating:0.5,1.2", 0.0, 0.0),
        ("grating:0.5,1.2", 0.23, 0.05 - np.sqrt(0.05**2 - 0.03**2)),
        ("grating:0.5,1.2", 0.6, 0.5),
        ("grating:0.5,1.2", 12.0 - 0.23, 0.05 - np.sqrt(0.05**2 - 0.03**2)),
    ],
)
def test_indentor_profiles_have_the_heights_of_the_source(shape: str, s: float, expected: float) -> None:
    assert height(shape, s) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_profile_derivatives_agree_with_finite_differences(shape: str) -> None:
    # Central differences, away from the joints of arcs, flats and flanks. h = 1e-5 mm: truncation h² h'''' / 6 stays
    # below 1e-6 of slopes and curvatures on the bar's 0.05 mm edge to 60°, round-off of h'' is 2e-16 / h² = 2e-6.
    profile = parse_shape(shape).profile
    h = 1e-5
    if isinstance(profile, Bar):
        edge = 0.5 * profile.width_mm - BAR_EDGE_RADIUS_MM
        s = np.concatenate(
            [np.linspace(0.01, edge - 0.01, 9), edge + BAR_EDGE_RADIUS_MM * np.linspace(0.05, 0.86, 15)]
        )
    else:
        s = np.linspace(0.013, 0.437, 21)
    s = np.concatenate([-s[::-1], s])
    low, mid, high = (profile.evaluate(s + d)[0] for d in (-h, 0.0, h))
    _, slope, curvature = profile.evaluate(s)
    np.testing.assert_allclose((high - low) / (2 * h), slope, rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose((high - 2 * mid + low) / h**2, curvature, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("shape", ["bar:3.0", "cylinder:3"])
def test_bar_and_cylinder_profiles_are_symmetric_with_steep_sides(shape: str) -> None:
    profile = parse_shape(shape).profile
    s = np.linspace(0, 1.6, 400)
    right, left = profile.evaluate(s), profile.evaluate(-s)
    np.testing.assert_array_equal(right[0], left[0])
    np.testing.assert_array_equal(right[1], -left[1])
    assert height(shape, 1.51) > 5.0  # beyond the side nothing claims a node
    assert abs(float(profile.evaluate(np.array([1.51]))[1][0])) == STEEPEST_SLOPE


@pytest.mark.parametrize("shape", ["bar:1.5", "cylinder:3"])
def test_tangents_past_the_edge_touch_the_profile(shape: str) -> None:
    # A node beside the edge and below the circle's centre gets the tangent plane at the closest point of the circle:
    # its distance to the plane is its distance to the circle.
    profile = parse_shape(shape).profile
    r = profile.edge_radius_mm if isinstance(profile, Bar) else 1.5
    half = 0.5 * profile.width_mm if isinstance(profile, Bar) else 1.5
    for out, y in ((0.01, 0.2 * r), (0.1, -0.1), (0.3, -0.5)):
        s = half + out
        h, slope, _ = profile.tangent(np.array([s]), np.array([y]))
        distance = float((h[0] - y) / np.hypot(1, slope[0]))
        assert distance == pytest.approx(np.hypot(s - (half - r), y - r) - r, rel=1e-9)
        left = profile.tangent(np.array([-s]), np.array([y]))
        assert left[0][0] == h[0]
        assert left[1][0] == -slope[0]


@pytest.mark.parametrize(
    ("text", "code", "fields"),
    [
        ("", "no_such", {"expected": EXPECTED}),
        ("point", "point_load", {"expected": EXPECTED}),
        ("bar", "no_dimension", {"dimension": "width", "unit": "mm"}),
        ("bar:0", "dimension_out_of_range", WIDTHS | {"value": 0.0}),
        ("bar:nan", "dimension_out_of_range", WIDTHS | {"value": "nan"}),
        ("step:2", "no_such_step", {}),
    ],
)
def test_a_malformed_shape_is_refused_with_what_was_expected(text: str, code: str, fields: dict[str, Any]) -> None:
    with raises(ShapeError, code, shape=text, **fields) as error:
        parse_shape(text)
    assert isinstance(error.value, ValueError)


@pytest.mark.parametrize(
    ("shape", "low", "high"),
    [
        ("bar:{}", 0.2, 20.0),
        ("cylinder:{}", 0.5, 50.0),
        ("wedge:{}", 5.0, 89.0),
        ("grating:{},15", 0.15, 10.0),
        ("grating:1,{}", 1.05, 20.0),
        ("sphere:{}", 0.25, 25.0),
        ("flat:{}", 0.1, 10.0),
        ("cone:{}", 5.0, 89.0),
    ],
)
def test_every_dimension_of_a_shape_has_bounds(shape: str, low: float, high: float) -> None:
    """Both of them are allowed, a thousandth beyond is not."""
    for value in (low, high):
        assert parse_shape(shape.format(value)).name == shape.format(f"{value:g}")
    for value in (0.999 * low, 1.001 * high, float("nan")):
        with raises(ShapeError, "dimension_out_of_range", low=low, high=high):
            parse_shape(shape.format(value))


@pytest.mark.parametrize("shape", ["sphere:3", "cone:60", "flat:1.5"])
def test_round_shapes_revolve_their_profile(shape: str) -> None:
    # Central differences of the height give slope and curvature in both directions; h = 1e-5 mm as above. Off the
    # axis by a few hundredths and more: a cone's tip is round to 0.05 mm.
    indentor = parse_shape(shape)
    rng = np.random.default_rng(3)
    at = rng.uniform(0.1, 0.9, size=(2, 40)) * rng.choice([-1, 1], size=(2, 40))
    height_mm, slope, curvature = indentor.evaluate(at)
    np.testing.assert_allclose(height_mm, indentor.profile.evaluate(np.hypot(*at))[0])
    h = 1e-5
    for axis in (0, 1):
        step = h * np.eye(2)[:, axis : axis + 1]
        low, high = indentor.evaluate(at - step), indentor.evaluate(at + step)
        np.testing.assert_allclose((high.height_mm - low.height_mm) / (2 * h), slope[axis], rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose((high.slope - low.slope) / (2 * h), curvature[:, axis], rtol=1e-5, atol=1e-8)


def write(path: Path, *lines: str) -> str:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


def test_a_measured_profile_passes_through_its_points_without_overshoot(tmp_path: Path) -> None:
    file = write(tmp_path / "mine.csv", "x_mm,height_mm", "-1,0.7", "0,0.2", "0.5,0.3", "2,1.2")
    profile = parse_shape(f"profile:{file}").profile
    h, slope, _ = profile.evaluate(np.array([-1.0, 0.0, 0.5, 2.0]))
    np.testing.assert_allclose(h, [0.5, 0.0, 0.1, 1.0], atol=1e-15)  # above the lowest point
    assert slope[1] == 0.0  # PCHIP: no overshoot below the lowest point
    s = np.linspace(-0.99, 1.99, 300)
    low, high = profile.evaluate(s - 1e-6)[0], profile.evaluate(s + 1e-6)[0]
    np.testing.assert_allclose((high - low) / 2e-6, profile.evaluate(s)[1], atol=2e-5)
    assert (profile.evaluate(s)[0] >= 0).all()


def test_a_linear_profile_has_small_fillets_at_its_points(tmp_path: Path) -> None:
    # A fillet of ± w about a kink lies w |Δm| / 4 inside it at most: w = 0.02 mm, slopes −1 and 0.5.
    file = write(tmp_path / "mine.csv", "x_mm,height_mm", "-1,1", "0,0", "2,1")
    profile = parse_shape(f"profile:{file},linear").profile
    h, slope, _ = profile.evaluate(np.array([-0.5, -0.02, 0.0, 0.02, 1.0]))
    np.testing.assert_allclose(h, [0.5, 0.02, 0.02 * 1.5 / 4, 0.01, 0.5], rtol=0, atol=1e-12)
    np.testing.assert_allclose(slope, [-1, -1, -0.25, 0.5, 0.5], rtol=0, atol=1e-12)


def test_beyond_its_ends_a_measured_profile_is_a_steep_wall(tmp_path: Path) -> None:
    file = write(tmp_path / "mine.csv", "x_mm,height_mm", "-1,0", "1,0.2")
    profile = parse_shape(f"profile:{file}").profile
    assert profile.evaluate(np.array([1.01]))[0][0] == pytest.approx(0.2 + 0.01 * STEEPEST_SLOPE)
    # below the end and beside it: the plane through the end point, square to the way there
    h, slope, _ = profile.tangent(np.array([1.3]), np.array([0.2 - 0.4]))
    assert slope[0] == pytest.approx(0.75)
    assert (h[0] + 0.2) / np.hypot(1, slope[0]) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("lines", "code", "fields"),
    [
        (("x_mm,height_mm", "0,0", "1,high"), "not_a_number", {"line": 3, "column": "height_mm", "cell": "high"}),
        (("x_mm,height_mm", "0,0", "1"), "row_length", {"line": 3, "cells": 1, "expected": 2}),
        (("x_mm,height_mm", "0,0", "1,1", "0.5,2"), "x_not_rising", {"x_mm": 1.0}),
        (("x_mm,height_mm", "0,0"), "too_few_points", {"points": 1}),
        (("x,h", "0,0", "1,1"), "column_count", {"line": 1, "columns": "x_mm,height_mm"}),
        ((), "unreadable", {"problem": os.strerror(errno.ENOENT)}),
    ],
)
def test_a_malformed_profile_file_is_refused_with_its_line(
    tmp_path: Path, lines: tuple[str, ...], code: str, fields: dict[str, Any]
) -> None:
    file = tmp_path / "mine.csv"
    if lines:
        write(file, *lines)
    with raises(ShapeError, code, name=str(file), **fields):
        parse_shape(f"profile:{file}")


@pytest.mark.parametrize(("x_mm", "z_mm", "radius_mm"), [(-3.2, 4.093, 0.5), (-3.1, 4.4, 2.0), (0.5, 7.0, 2.0)])
def test_the_touch_height_of_a_sphere_agrees_with_a_dense_sampling_of_the_skin(
    finger: Fingertip, x_mm: float, z_mm: float, radius_mm: float
) -> None:
    """Against the highest of 640 000 points of the parametrised skin, 12 µm apart: 0.05 µm below the touch.

    Where a section is narrower than the sphere's reach there is no skin; it was touched there, up to 0.31 mm high.
    """
    surface = finger.surface
    phi, z = np.meshgrid(np.linspace(0.05, np.pi - 0.05, 800), np.linspace(z_mm - radius_mm, z_mm + radius_mm, 800))
    inside = (z > surface.crest.x[0]) & (z < surface.crest.x[-1])
    x, y = surface.section(phi[inside], z[inside])
    across2 = (x - x_mm) ** 2 + (z[inside] - z_mm) ** 2
    under = across2 < radius_mm**2
    highest = (y[under] + np.sqrt(radius_mm**2 - across2[under])).max() - radius_mm
    assert finger.touch_height_mm(f"sphere:{radius_mm:g}", x_mm, z_mm=z_mm) == pytest.approx(highest, abs=5e-5)


# --- profiles from arrays ---

NAN, IS_NAN = math.nan, pytest.approx(math.nan, nan_ok=True)
OWN_X, OWN_HEIGHT = [-2.0, -0.5, 0.0, 0.7, 2.0], [1.0, 0.3, 0.2, 0.3, 1.2]


@pytest.mark.parametrize("linear", [False, True])
def test_a_profile_from_arrays_equals_the_one_from_a_file(linear: bool, tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text("x_mm,height_mm\n" + "".join(f"{x},{h}\n" for x, h in zip(OWN_X, OWN_HEIGHT, strict=True)))
    own = MeasuredProfile.from_arrays(np.array(OWN_X), OWN_HEIGHT, name=str(path), linear=linear)
    assert own == read_profile(str(path), linear=linear)
    assert hash(own) == hash(read_profile(str(path), linear=linear))
    assert own.height_mm[2] == 0.0
    assert own.x_mm == tuple(OWN_X)


def test_a_profile_wider_than_the_finger_can_be_pressed(finger: Fingertip) -> None:
    """Its edges are sharp, although the skin reaches none."""
    wide = MeasuredProfile.from_arrays(np.linspace(-90, 90, 181), np.zeros(181))
    assert finger.indent(wide, doi_mm=0.2).force_gwt > 0


@pytest.mark.parametrize(
    ("x", "height", "code", "fields"),
    [
        (OWN_X, OWN_HEIGHT[:-1], "heights_unlike_x", {"heights": (4,), "x": (5,)}),
        ([0.0, 1.0, NAN], [0.0, np.inf, 1.0], "point_of_no_numbers", {"point": 1, "x_mm": 1.0, "height_mm": np.inf}),
        ([0.0, 1.0, 1.0], [0.0, 1.0, 2.0], "x_not_rising", {"x_mm": 1.0}),
        ([-4000.0, 0.0, 4000.0], [0.0, 1.0, 2.0], "too_wide", {"width_mm": 8000.0, "unit": "micrometers"}),
        ([-0.002, 0.0, 0.002], [0.002, 0.0, 0.002], "too_narrow", {"width_mm": 0.004, "unit": "multiply meters"}),
        ([-2.0, 0.0, 2.0], [0.0005, 0.0, 0.0005], "too_flat", {"relief_mm": 0.0005, "unit": "multiply meters"}),
        ([-2.0, 0.0, 2.0], [500.0, 0.0, 500.0], "too_tall", {"relief_mm": 500.0, "unit": "divide micrometers"}),
    ],
)
def test_arrays_that_make_no_profile_are_refused(
    x: list[float], height: list[float], code: str, fields: dict[str, Any]
) -> None:
    with raises(ProfileError, code, name="own", **fields):
        MeasuredProfile.from_arrays(x, height)


# --- how sharp a profile is: measured on it, not believed ---

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Said:
    """A profile that says another radius of itself."""

    inner: IndentorProfile
    sharpest_radius_mm: float
    name: str = "said"

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        return self.inner.evaluate(s_mm)

    def tangent(self, s_mm: Array, y_mm: Array) -> tuple[Array, Array, Array]:
        return self.inner.tangent(s_mm, y_mm)


@pytest.mark.parametrize(
    "profile",
    [
        *(Bar(width, radius) for width in (0.2, 20.0) for radius in (0.001, 0.1)),
        *(Cylinder(d) for d in (0.5, 0.99, 1.01, 50.0)),
        *(SinusoidalStep(n) for n in "135"),
        *(Wedge(angle) for angle in (5.0, 60.0, 89.0)),
        *(Wedge(angle, 1.0) for angle in (60.0,)),
        *(Grating(*sizes) for sizes in ((0.5, 1.2), (0.15, 0.2), (10.0, 20.0))),
        Grating(1.0, 3.0, 0.2),
    ],
)
def test_the_measured_edge_radius_of_a_profile_equals_the_stated_one(profile: IndentorProfile) -> None:
    assert measured_radius_mm(profile) == pytest.approx(profile.sharpest_radius_mm, rel=0.01)
    assert Indentor.along(profile).sharp == (profile.sharpest_radius_mm < SHARP_RADIUS_MM)  # and no warning


@pytest.mark.parametrize("linear", [False, True])
def test_a_profile_from_points_has_sharp_ends(linear: bool) -> None:
    smooth = MeasuredProfile.from_arrays(np.linspace(-2, 2, 41), 0.1 * np.linspace(-2, 2, 41) ** 2, linear=linear)
    assert measured_radius_mm(smooth) == smooth.sharpest_radius_mm == 0.0
    assert Indentor.along(smooth).sharp


@pytest.mark.parametrize(("said", "truly"), [(np.inf, 0.05), (0.6, 0.4)])
@pytest.mark.parametrize("kind", [Indentor.along, lambda profile: Revolved(profile.name, profile)])
def test_a_profile_that_states_a_wrong_radius_is_treated_as_measured_with_a_warning(
    said: float, truly: float, kind: object
) -> None:
    indentor = kind(Said(Bar(3.0, truly), said))  # type: ignore[operator]
    with pytest.warns(ShapeWarning) as told:
        assert indentor.sharp
    (line,) = told
    assert isinstance(line.message, ShapeWarning)
    has_code(line.message, "other_radius", name="said", said_mm=said, measured_mm=pytest.approx(truly, rel=5e-3))
    assert indentor.sharp  # told once


@pytest.mark.filterwarnings("ignore::sim.contact.indentor.ShapeWarning")
def test_a_wrongly_stated_edge_radius_does_not_change_the_force(coarse_finger: Fingertip) -> None:
    """Believed to be smooth, a bar was solved at its nodes only and at once: by up to 4.7 % wrong."""
    exact, said = (coarse_finger.indent(shape, 0.25, doi_mm=0.6) for shape in (Bar(1.5), Said(Bar(1.5), np.inf)))
    assert said.force_n == pytest.approx(exact.force_n, rel=1e-12)
    assert said.contact_regions_mm == exact.contact_regions_mm
