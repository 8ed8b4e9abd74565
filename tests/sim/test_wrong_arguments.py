"""Numbers and files that the library takes: what is no number has one line, not the error of a package."""

from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from sim import Aim, Fingertip, HeightMap, MeasuredProfile, ShapeError, choose, indent_many, load, parse_shape
from sim.coding.encoding import Noise
from sim.coding.task import EncodeTask, encode_task
from sim.contact.shapes import shape_size
from sim.errors import ArgumentError
from sim.nerve.population import sensitivity_of
from sim.nerve.stimulus import Stimulus, Vibration
from tests.error_codes import raises


class Quantity(np.ndarray):
    """Array with a unit, made here; as of `quantities` or `astropy`, float() and asarray pass over the unit."""

    units = "um"
    dimensionality = "length"


def quantity(values: Any) -> Quantity:
    """Return numbers in micrometers."""
    return np.asarray(values, dtype=float).view(Quantity)


class Pint:
    """Number with a unit that is no array, made here; as of `pint`."""

    units = dimensionality = "um"

    def __init__(self, value: Any = 0.2) -> None:
        self.value = value

    def __float__(self) -> float:
        return float(self.value)

    def __array__(self, *_: Any, **__: Any) -> Any:
        return np.asarray(self.value, dtype=float)


class FloatWithUnit(float):
    unit = "um"


DOME = -0.1 * np.linspace(-1.0, 1.0, 5) ** 2 * np.ones((5, 1))
GRID = np.linspace(-1.0, 1.0, 5)

ONE_NUMBER: list[tuple[str, Callable[[Fingertip, Any], Any]]] = [
    ("doi_mm", lambda one, value: one.indent("bar:3.0", 0.0, doi_mm=value)),
    ("force_gwt", lambda one, value: one.indent("bar:3.0", 0.0, force_gwt=value)),
    ("x_mm", lambda one, value: one.indent("bar:3.0", value, doi_mm=0.2)),
    ("z_mm", lambda one, value: one.indent("sphere:4", z_mm=value, doi_mm=0.2)),
    ("friction", lambda one, value: one.indent("sphere:4", doi_mm=0.2, friction=value)),
    ("increment_mm", lambda one, value: one.indent("sphere:4", doi_mm=0.2, increment_mm=value)),
    ("target", lambda one, value: one.indent("sphere:4", doi_mm=0.2, target=value)),
    ("friction", lambda one, value: one.with_friction(value)),
    ("doi_mm", lambda one, value: one.with_friction(0.5).drag("sphere:4", [0.0, 0.1], value)),
    ("increment_mm", lambda one, value: one.with_friction(0.5).drag("sphere:4", [0.0, 0.1], 0.2, value)),
    ("x_mm", lambda one, value: one.point_load(value, 1.0)),
    ("force_gwt", lambda one, value: one.point_load(0.0, value)),
    ("z_mm", lambda one, value: one.point_load(0.0, 1.0, z_mm=value)),
    ("x_mm", lambda one, value: one.touch_height_mm("sphere:4", value)),
    ("z_mm", lambda one, value: one.touch_height_mm("sphere:4", z_mm=value, x_mm=0.0)),
    ("cores", lambda one, value: indent_many(one, "sphere:4", doi_mm=0.2, cores=value)),
    ("friction", lambda one, value: indent_many(one, "sphere:4", doi_mm=0.2, friction=value)),
    ("x_mm", lambda _, value: choose("bar:3.0", value, doi_mm=0.2)),
    ("z_mm", lambda _, value: choose("sphere:4", z_mm=value, doi_mm=0.2)),
    ("doi_mm", lambda _, value: choose("bar:3.0", doi_mm=value)),
    ("force_gwt", lambda _, value: choose("bar:3.0", force_gwt=value)),
    ("tolerance", lambda _, value: Aim(("force",), value)),
    ("turn_deg", lambda _, value: parse_shape("bar:3.0").turned(value)),
    ("turn_deg", lambda _, value: HeightMap.from_arrays(GRID, GRID, DOME, raised="high", turn_deg=value)),
    ("turn_deg", lambda _, value: HeightMap.from_arrays(GRID, GRID, DOME, raised="high").turned(value)),
    ("corner_s", lambda _, value: Stimulus([0.0], [0.1], corner_s=value)),
    ("amplitude_um", lambda _, value: Stimulus([0.0], [0.1], vibrations=[Vibration(10.0, value, 0.0, 1.0)])),
    ("doi_mm", lambda _, value: Stimulus.ramp(value, 1.0, 1.0)),
    ("speed_mm_s", lambda _, value: Stimulus.ramp(0.1, value, 1.0)),
    ("snr_db", lambda _, value: Noise(value)),
    ("seed", lambda _, value: Noise(20.0, seed=value)),
]
"""Every argument of the library that is one number."""

NO_NUMBER = {
    "true": True,
    "numpy's true": np.True_,
    "text": "0.2",
    "a decimal": Decimal("0.2"),
    "a fraction": Fraction(1, 5),
    "a complex number": 0.2 + 0j,
    "a duration": np.timedelta64(1, "s"),
    "an array": np.array(0.2),
    "an array of one": np.array([0.2]),
    "a masked value": np.ma.masked,
    "a quantity": quantity(0.2),
    "a quantity that is no array": Pint(),
    "a float with a unit": FloatWithUnit(0.2),
}


@pytest.mark.parametrize("what", NO_NUMBER)
@pytest.mark.parametrize(("name", "call"), ONE_NUMBER)
def test_a_numeric_argument_refuses_booleans_texts_and_quantities(
    halfspace: Fingertip, name: str, call: Callable[[Fingertip, Any], Any], what: str
) -> None:
    """True is 1 to Python, and a quantity in µm was pressed as mm."""
    with raises(ArgumentError, "not_a_number", name=name):
        call(halfspace, NO_NUMBER[what])


@pytest.mark.parametrize("value", [np.float32(0.25), np.float64(0.25), np.int64(1)])
def test_a_numeric_argument_accepts_numpy_scalars(halfspace: Fingertip, value: Any) -> None:
    expected = halfspace.indent("sphere:4", doi_mm=float(value)).force_gwt
    assert halfspace.indent("sphere:4", doi_mm=value).force_gwt == pytest.approx(expected, rel=1e-5)


ARRAY: list[tuple[str, Callable[[Fingertip, Any], Any]]] = [
    ("receptor_x_mm", lambda _, value: load("halfspace", receptor_x_mm=value)),
    ("receptor_depth_mm", lambda _, value: load("halfspace", receptor_depth_mm=value)),
    ("receptor_z_mm", lambda _, value: load("halfspace", receptor_z_mm=value)),
    ("receptor_x_mm", lambda _, value: Fingertip.load(receptor_x_mm=value)),
    ("x_mm", lambda one, value: indent_many(one, "sphere:4", value, doi_mm=0.2)),
    ("z_mm", lambda one, value: indent_many(one, "sphere:4", z_mm=value, doi_mm=0.2)),
    ("doi_mm", lambda one, value: indent_many(one, "sphere:4", doi_mm=value)),
    ("force_gwt", lambda one, value: indent_many(one, "sphere:4", force_gwt=value)),
    ("x_mm", lambda one, value: one.with_friction(0.5).drag("sphere:4", value, 0.2)),
    ("points_mm", lambda one, value: one.fields(one.indent("sphere:4", doi_mm=0.2), value)),
    ("x_mm", lambda one, value: one.points_below(value, 0.7)),
    ("depth_mm", lambda one, value: one.points_below(0.0, value)),
    ("z_mm", lambda one, value: one.points_below(0.0, 0.7, value)),
    ("x_mm", lambda _, value: HeightMap.from_arrays(value, [0, 1], [0, 1], raised="up")),
    ("z_mm", lambda _, value: HeightMap.from_arrays([0, 1], value, [0, 1], raised="up")),
    ("height_mm", lambda _, value: HeightMap.from_arrays([0, 1], [0, 1], value, raised="up")),
    ("x_mm", lambda _, value: MeasuredProfile.from_arrays(value, [0, 1])),
    ("height_mm", lambda _, value: MeasuredProfile.from_arrays([0, 1], value)),
    ("times_s", lambda _, value: Stimulus(value, [0.0, 0.1])),
    ("depths_mm", lambda _, value: Stimulus([0.0, 0.1], value)),
    ("pressure", lambda _, value: encode_task(EncodeTask(value))),
    ("normal", lambda _, value: sensitivity_of("SA1", value)),
]
"""Every argument of the library that is an array of numbers."""

NO_NUMBERS = {
    "true": True,
    "true in a list": [0.0, True],
    "flags": np.array([True, False]),
    "text": "0,1",
    "texts": ["0", "1"],
    "texts of numpy": np.array(["0", "1"]),
    "lists of unequal length": [[0.0], [0.0, 1.0]],
    "decimals": [Decimal("0.1"), Decimal("0.2")],
    "a fraction": [0.0, Fraction(1, 5)],
    "complex numbers": np.array([0.1 + 0j, 0.2]),
    "times of day": np.array(["2026-01-01", "2026-01-02"], dtype="datetime64[s]"),
    "masked values": np.ma.array([0.1, 0.2], mask=[0, 1]),
    "a list with a masked value": [0.1, np.ma.masked],
    "quantities": quantity([0.1, 0.2]),
    "a list of quantities": [quantity(0.1), quantity(0.2)],
    "quantities that are no array": Pint([0.1, 0.2]),
    "a list of these": [0.1, Pint()],
    "floats with a unit": [FloatWithUnit(0.1), 0.2],
    "a dictionary": {0.1: 0.2},
}


@pytest.mark.parametrize("what", NO_NUMBERS)
@pytest.mark.parametrize(("name", "call"), ARRAY)
def test_an_array_argument_refuses_masked_values_and_quantities(
    halfspace: Fingertip, name: str, call: Callable[[Fingertip, Any], Any], what: str
) -> None:
    """Masked values were answered as what lies under the mask, and quantities in µm as mm."""
    with raises(ArgumentError, "not_numbers", name=name):
        call(halfspace, NO_NUMBERS[what])


@pytest.mark.parametrize(
    "values",
    [(0.0, 0.1), range(2), np.array([0.0, 0.1], dtype=np.float32), np.ma.array([0.0, 0.1]), [0.0, np.array(0.1)],
     np.array(0.1), np.array([0, 1], dtype=object), [0, None]],
)  # fmt: skip
def test_an_array_argument_accepts_every_sequence_of_numbers(halfspace: Fingertip, values: Any) -> None:
    plain = np.atleast_1d(np.asarray([0.0 if one is None else float(one) for one in np.atleast_1d(values)]))
    found = indent_many(halfspace, "sphere:4", values, doi_mm=0.2)
    assert [one if one is None else one.force_gwt for one in found] == [
        None if one is None else halfspace.indent("sphere:4", x, doi_mm=0.2).force_gwt
        for one, x in zip(found, plain.tolist(), strict=True)
    ]


@pytest.mark.parametrize(
    "call",
    [
        lambda one: indent_many(one, "sphere:4", [0.0, 0.1, 0.2], doi_mm=[0.1, 0.2]),
        lambda one: one.points_below([0.0, 0.1, 0.2], [0.7, 0.8]),
    ],
)
def test_array_arguments_of_unequal_lengths_are_refused_with_their_lengths(
    halfspace: Fingertip, call: Callable[[Fingertip], Any]
) -> None:
    with raises(ArgumentError, "unequal_lengths") as caught:
        call(halfspace)
    assert all(words in str(caught.value) for words in ("x_mm 3", "_mm 2"))


@pytest.mark.parametrize("text", ["x_mm;z_mm;height_mm\n0;0;0,5\n", "0,5;0,7\n0,5;0,6\n", "0.5\t0.7\n0.5\t0.6\n"])
@pytest.mark.parametrize("options", ["", ",spacing_mm=0.1"])
def test_a_height_map_with_other_separators_is_refused_with_the_expected_ones(
    tmp_path: Path, text: str, options: str
) -> None:
    path = tmp_path / "map.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ShapeError, match="by commas, and write decimal points"):
        parse_shape(f"heightmap:{path}{options},raised=high")


@pytest.mark.parametrize(("white", "relief_mm"), [(40000, 0.244), (65535, 0.4)])
def test_a_picture_shallower_than_its_stated_height_is_reported(tmp_path: Path, white: int, relief_mm: float) -> None:
    path = tmp_path / "dots.png"
    grays = np.full((40, 40), white, dtype=np.uint16)
    grays[10:30, 10:30] = 0
    Image.fromarray(grays).save(path)
    assert shape_size(f"heightmap:{path},width_mm=4,height_mm=0.4") == (
        f"dark is raised, 40 × 40 points over 3.9 × 3.9 mm, relief {relief_mm:g} mm of height_mm = 0.4 mm: "
        f"gray levels 0 to {white} of 65535"
    )


def test_the_size_of_a_shape_from_a_file_states_its_points_and_relief(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("x_mm,height_mm\n-1,0.25\n0,0\n0.5,0.1\n", encoding="utf-8")
    profile = "the lowest touches first, 3 points, x -1 to 0.5 mm, relief 0.25 mm"
    for turn in ("", ",across", ",turn_deg=30"):
        assert shape_size(f"profile:{tmp_path / 'p.csv'}{turn}") == profile
    np.save(tmp_path / "h.npy", 0.1 * np.arange(5) + np.zeros((6, 1)))
    shape = f"heightmap:{tmp_path / 'h.npy'},spacing_mm=0.5,raised=high"
    numbers = "the highest touches first, 5 × 6 points over 2 × 2.5 mm, relief 0.4 mm"
    assert shape_size(shape) == shape_size(f"{shape},turn_deg=30") == numbers
    assert shape_size(f"profile:{tmp_path / 'gone.csv'}") == "the lowest touches first"
