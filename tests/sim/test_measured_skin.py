"""Points and sections from a user's files: what is kept, what is fitted, what is refused. All data are synthetic."""

import errno
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from sim.config import FingertipConfig, Geometry
from sim.finger.surface import FingertipSurface, SurfaceError, published_points
from sim.models.cache import content_key
from sim.tables import TableError, read_columns
from tests.error_codes import printed, raises

EXAMPLES = Path(__file__).parents[2] / "examples" / "own_finger"
PUBLISHED = published_points()[1]
SECTIONS = [
    [0.0, 3.4, 2.6, 0.0],
    [3.0, 4.0, 4.0, 0.1],
    [6.0, 4.4, 4.6, 0.2],
    [9.0, 4.2, 4.4, 0.1],
    [12.75, 1.0, 1.0, 0.0],
]

Write = Callable[[str], str]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write a CSV file, give its path."""

    def to(text: str) -> str:
        path = tmp_path / "mine.csv"
        path.write_text(text, encoding="utf-8")
        return str(path)

    return to


@pytest.mark.parametrize(
    ("name", "columns"),
    [("points", "x_mm,y_mm,z_mm"), ("sections", "z_mm,half_width_mm,height_mm,lean_mm")],
)
def test_a_column_that_rejects_rows_is_refused(write: Write, name: str, columns: str) -> None:
    """The fit would count the rejected points, and move the skin by half its radius."""
    row = ",".join("1" for _ in columns.split(","))
    problem = complaint(**{name: write(f"{columns},exclude\n{row},1\n")})
    assert "the column 'exclude' may say which rows do not count" in problem


def complaint(**geometry: object) -> str:
    with pytest.raises(ValidationError) as caught:
        Geometry.model_validate(geometry)
    (problem,) = caught.value.errors()
    return problem["msg"].removeprefix("Value error, ")


# --- reading ---


def test_a_csv_file_may_have_comments_empty_lines_and_a_byte_order_mark(write: Write) -> None:
    path = write("\ufeff# mine\n\nb , a\n 2.5 ,1\n\n# more\n-3e-1,4\n")
    assert read_columns(Path(path), ("a", "b")) == ((1.0, 2.5), (4.0, -0.3))


@pytest.mark.parametrize(
    ("text", "code", "fields"),
    [
        ("", "no_table", {"columns": "a,b"}),
        ("a,c\n1,2\n", "column_count", {"line": 1, "count": 0, "column": "b", "columns": "a,b"}),
        ("a,b\n1,2\n1,two\n", "not_a_number", {"line": 3, "column": "b", "cell": "two"}),
        # decimal commas
        ("#\na,b\n1,2\n1,5,2,5\n", "row_length", {"line": 4, "cells": 4, "expected": 2, "header_line": 2}),
        ("a,b\n1,2\n\nnan,2\n", "not_a_number", {"line": 4, "column": "a", "cell": "nan"}),
        ("#\na,b\n\n", "no_rows", {"line": 2}),
        ("# a,b\na,b\n1,2\n# more\n#3,4\n", "comment_row", {"line": 5}),
        ("a,b,exclude\n1,2,0\n3,4,1\n", "extra_column", {"line": 1, "column": "exclude"}),
        ("#\nvalid point;b;a\n1;2;0\n", "extra_column", {"line": 2, "column": "valid point"}),
    ],
)
def test_a_bad_table_is_refused_by_file_line_and_column(
    write: Write, text: str, code: str, fields: dict[str, Any]
) -> None:
    path = write(text)
    with raises(TableError, code, path=path, **fields) as caught:
        read_columns(Path(path), ("a", "b"))
    assert "\n" not in str(caught.value)


def test_columns_of_a_csv_file_that_are_not_read_are_logged(write: Write, caplog: pytest.LogCaptureFixture) -> None:
    path = write("site,a,comment,b\n1,2,x,3\n")
    assert read_columns(Path(path), ("a", "b")) == ((2.0, 3.0),)
    assert [record.getMessage() for record in caplog.records] == [f"{path}: columns that are not read: site, comment"]
    caplog.clear()
    read_columns(Path(write("a,b\n2,3\n")), ("a", "b"))
    assert not caplog.records


def test_a_missing_binary_or_folder_path_is_refused_as_a_csv_file(tmp_path: Path) -> None:
    none, binary = tmp_path / "none.csv", tmp_path / "binary.csv"
    with raises(TableError, "unreadable", path=str(none), problem=os.strerror(errno.ENOENT)):
        read_columns(none, ("a",))
    with raises(TableError, "unreadable", path=str(tmp_path), problem=os.strerror(errno.EISDIR)):
        read_columns(tmp_path, ("a",))
    binary.write_bytes(b"\xff\xfe\x00\x81")
    with raises(TableError, "not_csv", path=str(binary)):
        read_columns(binary, ("a",))


# --- what will do ---


NO_PULP = [
    (PUBLISHED[:11], "11 points"),
    (np.tile(PUBLISHED, (500, 1)), "12000 points"),
    (PUBLISHED / 1000, "the points span 0.00445 × 0.00286 × 0.00744 mm"),
    (PUBLISHED - [0, 0, -3], "z spans 7.07 to 14.51 mm"),
    (PUBLISHED[:18], "z spans 4.07 to 9.00 mm"),
    (np.tile(PUBLISHED[np.abs(PUBLISHED[:, 2] - 7.5) > 2.2], (2, 1)), "no points from z = 5.21 to 9.75 mm"),
    (PUBLISHED - [-3, 0, 0], "x spans 0.47 to 4.92 mm"),
    (PUBLISHED - [0, 4.839, 0], "highest y = 0.00 mm"),
]
NO_FINGER = [
    (SECTIONS[:4], "4 sections"),
    ([[z, 2 * half, height, lean] for z, half, height, lean in SECTIONS], "half_width_mm is 2.00 times"),
    ([[z, 1.82 * height, height, lean] for z, _, height, lean in SECTIONS], "half_width_mm is 1.82 times"),
    ([*SECTIONS[:2], *SECTIONS[1:]], "z_mm = 3 after 3"),
    ((np.array(SECTIONS) / 1000).tolist(), "z_mm ends at 0.01275 mm"),
    ([*SECTIONS, [13.0, 0.9, 0.9, 0.0]], "z_mm spans 0 to 13 mm"),
    ([*SECTIONS[:4], [12.75, 0.0, 1.0, 0.0]], "half_width_mm = 0 at z_mm = 12.75"),
]


@pytest.mark.parametrize(("points", "expected"), NO_PULP)
def test_points_that_cannot_hold_a_pulp_are_refused(points: np.ndarray, expected: str) -> None:
    assert complaint(points=points.tolist()).startswith(expected)


@pytest.mark.parametrize(("sections", "expected"), NO_FINGER)
def test_sections_that_are_no_finger_are_refused(sections: list[list[float]], expected: str) -> None:
    assert complaint(sections=sections).startswith(expected)


def test_points_and_sections_exclude_each_other() -> None:
    assert complaint(points=PUBLISHED.tolist(), sections=SECTIONS).startswith("points and sections")


@pytest.mark.parametrize(
    ("row", "number", "sign"),
    [
        ([6.0, 4.4, 4.6, 30.0], "lean ", 1),
        ([6.0, 60.0, 4.6, 0.0], "half-width ", -1),  # its spline swings below zero
    ],
)
def test_a_skin_that_crosses_the_bone_is_refused_with_its_place(row: list[float], number: str, sign: int) -> None:
    with raises(SurfaceError, "crosses_axis") as caught:
        FingertipSurface.fit(Geometry(sections=[*SECTIONS[:2], row, *SECTIONS[3:]]))
    assert sign * printed(caught.value, number) > 0


# --- what is made of them ---


def test_the_published_points_as_a_user_file_give_the_default_finger() -> None:
    path = EXAMPLES.parents[1] / "sim" / "data" / "fingertip_surface_points.csv"
    ours, default = Geometry(points=str(path)), Geometry()
    z = np.linspace(0, 12.75, 50)
    np.testing.assert_array_equal(
        FingertipSurface.fit(ours).parameters(z), FingertipSurface.fit(default).parameters(z)
    )


def test_fitting_noisy_points_recovers_their_surface(skin: FingertipSurface) -> None:
    # 3 000 points over the whole pulp with noise of 0.05 mm: the fit may err by noise · √(27 coefficients / n), 5 µm,
    # rms where there are points; its residuals are the noise's component along the normal.
    generator = np.random.default_rng(8)
    phi, z = generator.uniform(0.3, np.pi - 0.3, 3000), generator.uniform(1.0, 12.0, 3000)
    xyz = np.stack([*skin.section(phi, z), z], -1)
    xyz[:, :2] += generator.normal(0, 0.05, (3000, 2))
    fitted = FingertipSurface.fit(Geometry(points=xyz.tolist()))
    residual = fitted.residuals_mm()
    assert np.sqrt((residual**2).mean()) == pytest.approx(0.05, rel=0.05)
    at = np.linspace(2, 11, 50)
    error = fitted.height(np.array([-2.0, -1.0, 0.0, 1.0, 2.0])[:, None], at) - skin.height(
        np.array([-2.0, -1.0, 0.0, 1.0, 2.0])[:, None], at
    )
    assert np.abs(error).max() < 0.02
    assert np.sqrt((error**2).mean()) < 0.007


def test_the_skin_passes_smoothly_through_measured_sections() -> None:
    surface = FingertipSurface.fit(Geometry(sections=SECTIONS))
    z, *parameters = np.array(SECTIONS).T
    np.testing.assert_allclose(surface.parameters(z), parameters, rtol=0, atol=1e-13)
    h = 1e-4
    for station in z[1:-1]:  # C²: the second difference from either side; third derivatives ≤ 0.5 mm⁻²
        left, right = (surface.parameters(station + s * h * np.arange(3)) @ [1, -2, 1] / h**2 for s in (-1, 1))
        np.testing.assert_allclose(left, right, rtol=0, atol=2 * h * 0.5 + 1e-6)


def test_apex_and_radii_of_the_skin_agree_with_finite_differences(skin: FingertipSurface) -> None:
    # Central differences at 1e-3 mm: round-off 1e-15 / h² = 1e-9, truncation h² times a fourth derivative ≤ 1.
    (x, y, z), h = skin.apex.position_mm, 1e-3
    across = np.diff(skin.height(x + h * np.array([-1, 0, 1]), z), 2)[0] / h**2
    along = np.diff(skin.height(x, z + h * np.array([-1, 0, 1])), 2)[0] / h**2
    assert skin.apex.lateral_radius_mm == pytest.approx(-1 / across, rel=1e-5)
    assert skin.apex.axial_radius_mm == pytest.approx(-1 / along, rel=1e-5)
    highest = skin.height(np.linspace(-1, 1, 201)[:, None], np.linspace(2.1, 10.9, 881)).max()
    assert y == pytest.approx(highest, abs=1e-4)
    assert y >= highest
    assert skin.apex.inside


def test_a_finger_that_rises_to_its_proximal_end_has_no_inner_apex() -> None:
    rows = [[z, 4.4, 5.0 - 0.2 * z, 0.0] for z in np.linspace(0, 12.75, 6)]
    surface = FingertipSurface.fit(Geometry(sections=rows))
    assert not surface.apex.inside
    # What can be touched ends at z = 2: there is its highest skin, at every x.
    for x in (-3.0, 0.0, 2.0):
        assert float(surface.ridge(x)) == pytest.approx(float(surface.height(x, 2.0)), abs=1e-6)


# --- the key of the cached model ---


def test_the_cache_key_of_a_user_finger_depends_on_its_numbers_not_its_path(tmp_path: Path) -> None:
    def key(name: str, rows: np.ndarray) -> str:
        path = tmp_path / name
        path.write_text("x_mm,y_mm,z_mm\n" + "".join(f"{x},{y},{z}\n" for x, y, z in rows), encoding="utf-8")
        config = FingertipConfig.model_validate({"geometry": {"points": str(path)}})
        assert str(tmp_path) not in json.dumps(config.model_dump(mode="json"))
        return content_key(config.model_dump(mode="json"))

    edited = PUBLISHED.copy()
    edited[3, 1] += 0.001
    assert key("one.csv", PUBLISHED) == key("other.csv", PUBLISHED)
    assert key("one.csv", edited) == key("other.csv", edited) != key("third.csv", PUBLISHED)


# --- the shipped example ---


def test_the_shipped_example_files_hold_the_scaled_synthetic_finger(skin: FingertipSurface) -> None:
    phi, z = np.meshgrid(np.radians(np.arange(30, 151, 15)), np.arange(4.0, 11.51, 0.75))
    points = 1.2 * np.stack([*skin.section(phi, z), z], -1).reshape(-1, 3)
    shipped = EXAMPLES / "synthetic_larger_finger_points.csv"
    assert "SYNTHETIC" in shipped.read_text(encoding="utf-8").splitlines()[0]
    np.testing.assert_allclose(read_columns(shipped, ("x_mm", "y_mm", "z_mm")), points, rtol=0, atol=6e-4)
    stations = np.linspace(0, 12.75, 16)
    table = 1.2 * np.stack([stations, *skin.parameters(stations)], -1)
    shipped = EXAMPLES / "synthetic_larger_finger_sections.csv"
    assert "SYNTHETIC" in shipped.read_text(encoding="utf-8").splitlines()[0]
    columns = ("z_mm", "half_width_mm", "height_mm", "lean_mm")
    np.testing.assert_allclose(read_columns(shipped, columns), table, rtol=0, atol=6e-4)


@pytest.mark.parametrize(
    ("name", "radius"),
    [
        # 1.2 times the default's 3.590 and 3.394 mm. Points: rounded to 0.001 mm and a little stiffness of the fit.
        # Sections every 1.02 mm: the cubic's second derivative errs by h²/12 times a fourth derivative, measured 3 %.
        ("points", 0.005),
        ("sections", 0.05),
    ],
)
def test_fitting_the_shipped_example_gives_the_default_finger_times_1_2(
    skin: FingertipSurface, name: str, radius: float
) -> None:
    path = str(EXAMPLES / f"synthetic_larger_finger_{name}.csv")
    surface = FingertipSurface.fit(Geometry.model_validate({"length_mm": 15.3, name: path}))
    apex, default = surface.apex, skin.apex
    np.testing.assert_allclose(apex.position_mm, 1.2 * np.array(default.position_mm), rtol=0, atol=0.02)
    assert apex.lateral_radius_mm == pytest.approx(1.2 * default.lateral_radius_mm, rel=radius)
    assert apex.axial_radius_mm == pytest.approx(1.2 * default.axial_radius_mm, rel=radius)
    x = np.linspace(-3, 3, 31)
    np.testing.assert_allclose(surface.ridge(1.2 * x), 1.2 * skin.ridge(x), rtol=0, atol=0.005)
    assert len(surface.points_mm) == (99 if name == "points" else 0)
    if name == "points":
        assert surface.residuals_mm().max() < 0.003
