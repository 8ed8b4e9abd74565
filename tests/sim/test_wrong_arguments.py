"""Numbers and files that the library takes: what is no number has one line, not the error of a package."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from sim import Fingertip, HeightMap, MeasuredProfile, ShapeError, choose, indent_many, load, parse_shape
from sim.contact.shapes import shape_size
from sim.errors import ArgumentError
from tests.error_codes import raises


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("doi_mm", lambda one: one.indent("bar:3.0", 0.0, doi_mm=True)),
        ("doi_mm", lambda one: one.indent("bar:3.0", 0.0, doi_mm=np.True_)),
        ("force_gwt", lambda one: one.indent("bar:3.0", 0.0, force_gwt=True)),
        ("x_mm", lambda one: one.indent("bar:3.0", True, doi_mm=0.2)),
        ("z_mm", lambda one: one.indent("sphere:4", z_mm=True, doi_mm=0.2)),
        ("doi_mm", lambda _: choose("bar:3.0", doi_mm=True)),
        ("friction", lambda one: one.indent("sphere:4", doi_mm=0.2, friction=True)),
        ("friction", lambda one: one.with_friction(True)),
        ("friction", lambda one: one.with_friction("0.5")),
        ("increment_mm", lambda one: one.indent("sphere:4", doi_mm=0.2, increment_mm=True)),
        ("target", lambda one: one.indent("sphere:4", doi_mm=0.2, target=True)),
        ("doi_mm", lambda one: one.with_friction(0.5).drag("sphere:4", [0.0, 0.1], True)),
        ("x_mm", lambda one: one.with_friction(0.5).drag("sphere:4", [0.0, True], 0.2)),
        ("x_mm", lambda one: one.point_load(True, 1.0)),
        ("force_gwt", lambda one: one.point_load(0.0, True)),
        ("x_mm", lambda one: one.touch_height_mm("sphere:4", True)),
        ("cores", lambda one: indent_many(one, "sphere:4", doi_mm=0.2, cores=True)),
    ],
)
def test_true_is_no_number(halfspace: Fingertip, name: str, call: Callable[[Fingertip], Any]) -> None:
    """True is 1 to Python, so a flag at the place of a depth was pressed at 1 mm."""
    with raises(ArgumentError, "not_a_number", name=name):
        call(halfspace)


@pytest.mark.parametrize(
    "value", [True, [0.0, True], np.array([True, False]), "0,1", ["0", "1"], [[0.0], [0.0, 1.0]]]
)
@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("receptor_x_mm", lambda _, value: load("halfspace", receptor_x_mm=value)),
        ("receptor_depth_mm", lambda _, value: load("halfspace", receptor_depth_mm=value)),
        ("x_mm", lambda one, value: indent_many(one, "sphere:4", value, doi_mm=0.2)),
        ("doi_mm", lambda one, value: indent_many(one, "sphere:4", doi_mm=value)),
        ("force_gwt", lambda one, value: indent_many(one, "sphere:4", force_gwt=value)),
        ("points_mm", lambda one, value: one.fields(one.indent("sphere:4", doi_mm=0.2), value)),
        ("depth_mm", lambda one, value: one.points_below(0.0, value)),
        ("height_mm", lambda _, value: HeightMap.from_arrays([0, 1], [0, 1], value, raised="up")),
        ("height_mm", lambda _, value: MeasuredProfile.from_arrays([0, 1], value)),
    ],
)
def test_an_array_has_numbers(
    halfspace: Fingertip, name: str, call: Callable[[Fingertip, Any], Any], value: Any
) -> None:
    with raises(ArgumentError, "not_numbers", name=name):
        call(halfspace, value)


@pytest.mark.parametrize(
    "call",
    [
        lambda one: indent_many(one, "sphere:4", [0.0, 0.1, 0.2], doi_mm=[0.1, 0.2]),
        lambda one: one.points_below([0.0, 0.1, 0.2], [0.7, 0.8]),
    ],
)
def test_arrays_of_unequal_lengths_are_named_with_their_lengths(
    halfspace: Fingertip, call: Callable[[Fingertip], Any]
) -> None:
    with raises(ArgumentError, "unequal_lengths") as caught:
        call(halfspace)
    assert all(words in str(caught.value) for words in ("x_mm 3", "_mm 2"))


@pytest.mark.parametrize("text", ["x_mm;z_mm;height_mm\n0;0;0,5\n", "0,5;0,7\n0,5;0,6\n", "0.5\t0.7\n0.5\t0.6\n"])
@pytest.mark.parametrize("options", ["", ",spacing_mm=0.1"])
def test_a_height_map_says_how_numbers_are_separated(tmp_path: Path, text: str, options: str) -> None:
    path = tmp_path / "map.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ShapeError, match="by commas, and write decimal points"):
        parse_shape(f"heightmap:{path}{options},raised=high")


@pytest.mark.parametrize(("white", "says"), [(4095, "its relief is 0.025 mm, not 0.4 mm"), (65535, "")])
def test_a_picture_that_is_shallower_than_stated_says_so(tmp_path: Path, white: int, says: str) -> None:
    """12 bits in a file of 16: its white is nearly black."""
    path = tmp_path / "dots.png"
    grays = np.full((40, 40), white, dtype=np.uint16)
    grays[10:30, 10:30] = 0
    Image.fromarray(grays).save(path)
    size = shape_size(f"heightmap:{path},width_mm=4,height_mm=0.4")
    assert size.startswith("dark is raised")
    assert says in size
    assert ("relief" in size) == bool(says)
