"""How sharp a profile is: measured on it, not believed."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.contact.indentor import RADIUS_TOLERANCE, SHARP_RADIUS_MM, Indentor, Revolved, ShapeWarning
from sim.contact.measured_profile import MeasuredProfile
from sim.contact.profiles import (
    Bar,
    Cylinder,
    Grating,
    IndentorProfile,
    SinusoidalStep,
    Wedge,
    measured_radius_mm,
)
from sim.models.fingertip import Fingertip
from tests.error_codes import has_code

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
def test_it_is_what_every_shape_of_ours_says(profile: IndentorProfile) -> None:
    assert measured_radius_mm(profile) == pytest.approx(profile.sharpest_radius_mm, rel=0.01)
    assert Indentor.along(profile).sharp == (profile.sharpest_radius_mm < SHARP_RADIUS_MM)  # and no warning


@pytest.mark.parametrize("linear", [False, True])
def test_a_profile_from_points_ends_in_edges(linear: bool) -> None:
    smooth = MeasuredProfile.from_arrays(np.linspace(-2, 2, 41), 0.1 * np.linspace(-2, 2, 41) ** 2, linear=linear)
    assert measured_radius_mm(smooth) == smooth.sharpest_radius_mm == 0.0
    assert Indentor.along(smooth).sharp


@pytest.mark.parametrize(("said", "truly"), [(np.inf, 0.05), (3.0, 0.05), (0.5, 0.05), (0.6, 0.4)])
@pytest.mark.parametrize("kind", [Indentor.along, lambda profile: Revolved(profile.name, profile)])
def test_a_profile_that_says_otherwise_is_taken_as_measured_with_a_line(
    said: float, truly: float, kind: object
) -> None:
    indentor = kind(Said(Bar(3.0, truly), said))  # type: ignore[operator]
    with pytest.warns(ShapeWarning) as told:
        assert indentor.sharp
    (line,) = told
    assert isinstance(line.message, ShapeWarning)
    has_code(line.message, "other_radius", name="said", said_mm=said, measured_mm=pytest.approx(truly, rel=5e-3))
    assert indentor.sharp  # told once


def test_nor_is_a_smooth_one_believed_to_be_sharp() -> None:
    indentor = Indentor.along(Said(Cylinder(9.0), 0.1))
    with pytest.warns(ShapeWarning) as told:
        assert not indentor.sharp
    (line,) = told
    assert isinstance(line.message, ShapeWarning)
    has_code(line.message, "other_radius", said_mm=0.1, measured_mm=pytest.approx(4.5, rel=5e-3))


@pytest.mark.parametrize("said", [0.05 * (1 - 0.9 * RADIUS_TOLERANCE), 0.05 * (1 + 0.9 * RADIUS_TOLERANCE)])
def test_within_a_tenth_it_is_believed(said: float) -> None:
    assert RADIUS_TOLERANCE == 0.1
    assert Indentor.along(Said(Bar(3.0), said)).sharp
    assert not Indentor.along(Said(Cylinder(0.96), 0.5)).sharp  # 0.48 mm, said to be 0.5


@pytest.mark.filterwarnings("ignore::sim.contact.indentor.ShapeWarning")
def test_a_wrong_word_does_not_change_the_force(coarse_finger: Fingertip) -> None:
    """Believed to be smooth, a bar was solved at its nodes only and at once: by up to 4.7 % wrong."""
    exact, said = (coarse_finger.indent(shape, 0.25, doi_mm=0.6) for shape in (Bar(1.5), Said(Bar(1.5), np.inf)))
    assert said.force_n == pytest.approx(exact.force_n, rel=1e-12)
    assert said.contact_regions_mm == exact.contact_regions_mm
