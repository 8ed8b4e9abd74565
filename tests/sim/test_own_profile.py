"""A profile from arrays is the profile from a file, and what cannot be one is refused in one line."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.contact.measured_profile import MeasuredProfile, ProfileError, read_profile
from sim.models.fingertip import Fingertip
from tests.error_codes import raises

NAN, IS_NAN = math.nan, pytest.approx(math.nan, nan_ok=True)
X, HEIGHT = [-2.0, -0.5, 0.0, 0.7, 2.0], [1.0, 0.3, 0.2, 0.3, 1.2]


@pytest.mark.parametrize("linear", [False, True])
def test_arrays_are_a_file(linear: bool, tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text("x_mm,height_mm\n" + "".join(f"{x},{h}\n" for x, h in zip(X, HEIGHT, strict=True)))
    own = MeasuredProfile.from_arrays(np.array(X), HEIGHT, name=str(path), linear=linear)
    assert own == read_profile(str(path), linear=linear)
    assert hash(own) == hash(read_profile(str(path), linear=linear))
    assert own.height_mm[2] == 0.0
    assert own.x_mm == tuple(X)


def test_a_wide_profile_is_pressed(finger: Fingertip) -> None:
    """Its edges are sharp, although the skin reaches none."""
    wide = MeasuredProfile.from_arrays(np.linspace(-90, 90, 181), np.zeros(181))
    assert finger.indent(wide, doi_mm=0.2).force_gwt > 0


@pytest.mark.parametrize(
    ("x", "height", "code", "fields"),
    [
        (X, HEIGHT[:-1], "heights_unlike_x", {"heights": (4,), "x": (5,)}),
        ([0.0, 1.0, NAN], [0.0, np.inf, 1.0], "point_of_no_numbers", {"point": 1, "x_mm": 1.0, "height_mm": np.inf}),
        ([0.0, 1.0, 1.0], [0.0, 1.0, 2.0], "x_not_rising", {"x_mm": 1.0}),
        ([-4000.0, 0.0, 4000.0], [0.0, 1.0, 2.0], "too_wide", {"width_mm": 8000.0}),
    ],
)
def test_what_is_no_profile_is_refused(
    x: list[float], height: list[float], code: str, fields: dict[str, Any]
) -> None:
    with raises(ProfileError, code, name="own", **fields):
        MeasuredProfile.from_arrays(x, height)
