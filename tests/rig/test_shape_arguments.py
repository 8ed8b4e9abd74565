"""What an argument cannot mean for a shape is refused, wherever a shape is given; never passed over."""

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.bench.served import ServedBench
from rig.cli import main
from rig.plan.config import Config
from rig.plan.finger_model import FingerModel
from rig.records import Target
from rig.study.exceptions import StudyError
from rig.study.parameter_study import read_study
from sim.carriage import Pose
from sim.contact.shapes import ShapeError, parse_shape, shape_filter, shape_name, shape_size, with_size
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.plant import PressedFinger

# Options that a shape does not take.
MEANINGLESS = (
    *("bar:3,linear", "bar:3,edge_mm=0.1", "line:3", "sphere:2,across", "flat,turn_deg=30", "across"),
    *("bar:3,across,turn_deg=30", "bar:3,turn_deg=nan", "bar:3,turn_deg=361", "bar:3,ACROSS", "heightmap:"),
)

# A radius or a diameter, by name or bare: (names, their shape, radius and width in mm).
ROUND = (
    (("sphere:5", "sphere:r=5", "sphere:d=10"), "sphere:5", (5, 10)),
    (("cylinder:9", "cylinder:d=9", "cylinder:r=4.5"), "cylinder:9", (4.5, 9)),
    (("cylinder:9,across", "cylinder:r=4.5,across"), "cylinder:9,across", (4.5, 9)),
    (("flat:1.5", "flat:r=1.5", "flat:d=3"), "flat:1.5", (1.5, 3)),
)
NO_SIZE = (
    "sphere:r=",
    "cylinder:r=0.2",
    "bar:r=3",
    "cone:r=60",
    "sphere:r=d=5",
)

# Places that mean nothing to a shape: (shape, x_mm, z_mm).
MISPLACED = (
    ("bar:3", 0.0, 6.0),
    ("bar:3,turn_deg=180", 0.0, 6.0),
    ("line", 0.5, None),
    ("bar:3,across", 0.5, None),
    ("flat", 0.5, None),
    ("flat", 0.0, 6.0),
)


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Callable[..., Any]:
    """Run the program; its exit code and what it said."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["rig", *arguments])
        with pytest.raises(SystemExit) as caught:
            main()
        said = capsys.readouterr()
        return int(caught.value.code or 0), said.err

    return run


def study(folder: Path, shape: str, place: str = "") -> Path:
    path = folder / "study.toml"
    path.write_text(f"[[press]]\nshape = {shape!r}\n{place}\ndoi_mm = 0.5\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("shape", MEANINGLESS)
def test_meaningless_shape_options_are_refused_wherever_a_shape_is_given(
    finger: Fingertip, tmp_path: Path, shape: str
) -> None:
    config = Config.model_validate({"virtual": {"indentor": shape}})
    for given in (
        lambda: parse_shape(shape),
        lambda: finger.indent(shape, doi_mm=0.5),
        lambda: finger.touch_height_mm(shape, 0.0),
        lambda: FingerModel(finger, {}).refuse_shape(shape),
        lambda: PressedFinger(finger, shape),
        lambda: ServedBench(config, stage="grbl", force="mtsics", tcp=0),
    ):
        with pytest.raises(ShapeError) as caught:
            given()
        assert "\n" not in str(caught.value)
    with pytest.raises(StudyError):
        read_study(study(tmp_path, shape))


@pytest.mark.parametrize(("shape", "x_mm", "z_mm"), MISPLACED)
def test_a_place_that_a_shape_cannot_have_is_refused_everywhere(
    finger: Fingertip, tmp_path: Path, shape: str, x_mm: float, z_mm: float | None
) -> None:
    for given in (
        lambda: finger.indent(shape, x_mm, z_mm=z_mm, doi_mm=0.3),
        lambda: finger.touch_height_mm(shape, x_mm, z_mm=z_mm),
    ):
        with pytest.raises(ModelRangeError, match=rf"{parse_shape(shape).name}: [xz]_mm = .* does not apply"):
            given()
    model = FingerModel(finger, {})
    along_mm = 0.0 if z_mm is None else z_mm - finger.config.receptor_plane_mm
    if x_mm or along_mm:
        name = f"x_mm = {x_mm:g}" if x_mm else f"along_mm = {along_mm:g}"
        with pytest.raises(ModelRangeError, match=f"{re.escape(name)} does not apply"):
            model.touch_height_mm(shape, x_mm, along_mm)
    if x_mm and shape != "step:1":
        with pytest.raises(ModelRangeError, match="does not apply"):
            model.press(shape, x_mm, Target("doi_mm", 0.3))
        with pytest.raises(StudyError, match=r"has no position along x; remove x_mm"):
            read_study(study(tmp_path, shape, f"x_mm = [{x_mm}]"))
    assert read_study(study(tmp_path, shape))


@pytest.mark.parametrize(("shape", "x_mm"), [("line", 0.4), ("bar:3,across", -0.7), ("flat", 1.0)])
def test_a_virtual_rig_presses_an_x_independent_shape_alike_at_every_x(
    finger: Fingertip, shape: str, x_mm: float
) -> None:
    """A virtual rig's true x is never quite what was asked for."""
    there, here = (PressedFinger(finger, shape).force_n(Pose(x, -0.3)) for x in (x_mm, 0.0))
    assert there == pytest.approx(here, rel=1e-12)
    assert there > 0
    assert parse_shape(shape).lateral_mm(x_mm) == 0.0
    assert parse_shape("bar:3").lateral_mm(x_mm) == x_mm
    assert parse_shape("sphere:2").lateral_mm(x_mm) == x_mm


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("bar:3.0,across", "bar:3,across"),
        ("bar:3,turn_deg=90", "bar:3,across"),
        ("bar:3.0,turn_deg=0", "bar:3"),
        ("bar:3,turn_deg=360", "bar:3"),
        ("grating:0.5,1.2,turn_deg=30.0", "grating:0.5,1.2,turn_deg=30"),
        ("step:1,turn_deg=270", "step:1,turn_deg=-90"),
        ("step:5,turn_deg=-180", "step:5,turn_deg=180"),
        ("flat", "flat"),
        ("flat:1.0", "flat:1"),
        ("heightmap:nowhere.png,width_mm=3", "heightmap:nowhere.png,width_mm=3"),
        ("profile:nowhere.csv,linear,across", "profile:nowhere.csv,linear,across"),
    ],
)
def test_shape_names_are_canonical(text: str, name: str) -> None:
    assert shape_name(text) == name


@pytest.mark.parametrize(("names", "shape", "size"), ROUND)
def test_round_shapes_are_named_by_radius_or_diameter(
    names: tuple[str, ...], shape: str, size: tuple[float, float]
) -> None:
    """Nobody has to know which of the two a bare number is."""
    radius_mm, wide_mm = size
    assert {shape_name(name) for name in names} == {shape}
    assert all(shape_filter(name)(other) for name in (*names, shape.partition(":")[0]) for other in names)
    assert not shape_filter(shape)(f"{shape}5")
    for name in names:
        assert {f"{radius_mm:g}", f"{wide_mm:g}"} == set(re.findall(r"[\d.]+", shape_size(name)))
        assert with_size(name).startswith(name)
        written = parse_shape(name).name  # in errors and results too: never a number by another measure
        assert written == name


@pytest.mark.parametrize("shape", NO_SIZE)
def test_a_radius_or_diameter_that_a_shape_cannot_have_is_refused(shape: str) -> None:
    with pytest.raises(ShapeError) as caught:
        parse_shape(shape)
    assert caught.value.code in ("no_dimension", "dimension_out_of_range")
