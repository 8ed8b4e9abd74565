"""`rig indent` with receptors at other places: lists and ranges, several depths and z, and what does not exist."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.cli.options import numbers
from rig.errors import BadInputError
from sim.config import FingertipConfig
from sim.models.fingertip import Fingertip
from tests.program import Program
from tests.sim.coarse_mesh import as_toml, coarse_mesh

COARSE = coarse_mesh(0.5, 0.5, patch_x_mm=1.5, patch_z_mm=1.5)
PRESS = ("--shape", "bar:1.5", "--x-mm", "0", "--doi-mm", "0.2")


@pytest.fixture
def indent(program: Program, tmp_path: Path) -> Any:
    """`rig indent` on a coarse finger."""
    (tmp_path / "coarse.toml").write_text(as_toml(COARSE), encoding="utf-8")
    return lambda *more: program("indent", "--config", tmp_path / "coarse.toml", *PRESS, *more)


def test_every_x_at_every_depth_and_z(indent: Any) -> None:
    places = ("--receptor-x-mm=-0.5:0.5:0.5", "--receptor-depth-mm", "0.5,0.8", "--receptor-z-mm", "6.5,7")
    ended = indent(*places, "--json")
    assert (ended.code, ended.err) == (0, "")
    receptors = ended.json["receptors"]
    assert receptors["x_mm"] == pytest.approx([-0.5, 0.0, 0.5] * 4)
    assert receptors["depth_mm"] == [*[0.5] * 3, *[0.8] * 3] * 2
    assert receptors["z_mm"] == pytest.approx([6.5] * 6 + [7.0] * 6)
    finger = Fingertip.load(
        FingertipConfig(mesh=COARSE),
        receptor_x_mm=[-0.5, 0, 0.5],
        receptor_depth_mm=[0.5, 0.8],
        receptor_z_mm=[6.5, 7],
    )
    expected = finger.indent("bar:1.5", doi_mm=0.2).receptor_measures
    assert receptors["sed"] == pytest.approx(expected["sed"].tolist(), rel=1e-9)
    assert len(np.unique(np.round(receptors["sed"], 9))) == 12

    lines = indent(*places).out.splitlines()
    assert [line.split()[:3] for line in lines[-9:-5]] == [
        ["-0.50", "0.80", "6.50"], ["0.00", "0.80", "6.50"], ["0.50", "0.80", "6.50"], ["-0.50", "0.50", "7.00"],
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("more", "depth", "z"),
    [((), False, False), (("--receptor-depth-mm", "0.5"), False, False), (("--receptor-z-mm", "7"), False, True)],
)
def test_only_what_is_unusual_is_said(indent: Any, more: Any, depth: bool, z: bool) -> None:
    out = indent(*more).out
    assert ("depth (mm)" in out, "z (mm)" in out) == (depth, z)


def test_a_point_load_has_them_too(program: Program, indent: Any, tmp_path: Path) -> None:
    ended = program(
        "indent", "--config", tmp_path / "coarse.toml", "--shape", "point", "--x-mm", "0", "--force-gwt", "2",
        "--receptor-x-mm", "0.25", "--receptor-z-mm", "6.5,7", "--json",
    )  # fmt: skip
    assert ended.json["receptors"]["x_mm"] == pytest.approx([0.25, 0.25])
    assert ended.json["receptors"]["z_mm"] == pytest.approx([6.5, 7.0])
    assert ended.json["receptors"]["depth_mm"] == [0.76, 0.76]


def test_a_point_load_on_the_section_is_a_line_load_per_millimetre(program: Program, tmp_path: Path) -> None:
    (tmp_path / "coarse.toml").write_text(as_toml(coarse_mesh(0.5, 0.5)), encoding="utf-8")
    line = (
        "indent", "--config", tmp_path / "coarse.toml", "--model", "section", "--shape", "point", "--x-mm", "0.2",
        "--receptor-x-mm", "0,0.5", "--length-mm", 4,
    )  # fmt: skip
    found = program(*line, "--force-gwt", 2, "--json").json
    assert found["solver"]["model"] == "section"
    assert (found["force_gwt"], found["effective_length_mm"]) == (pytest.approx(2.0), 4.0)
    assert found["force_n_per_mm"] == pytest.approx(2 * 9.80665e-3 / 4)
    assert found["doi_mm"] is None
    twice = program(*line, "--force-gwt", 4, "--json").json
    assert twice["receptors"]["e11"] == pytest.approx([2 * v for v in found["receptors"]["e11"]])
    assert (
        "line load of 0.00490 N/mm, over 4 mm 0.01961 N = 2.0000 gwt at x = 0.2 mm"
        in program(*line, "--force-gwt", 2).out
    )
    assert "a section contains the receptor plane only" in program(*line, "--force-gwt", 2, "--z-mm", 5).complaint
    assert program(*line[:-2], "--force-gwt", 2).complaint.startswith("--force-gwt requires --length-mm")
    assert "takes no depth" in program(*line, "--doi-mm", 0.2).complaint


@pytest.mark.parametrize(
    ("more", "complaint"),
    [
        (
            "--receptor-x-mm 9",
            "no receptor at x = 9 mm, 0.76 mm below the skin; choose x from -4.46 to 4.39 mm",
        ),
        (
            "--receptor-x-mm nan",
            "--receptor-x-mm 'nan': must be numbers separated by commas, or FROM:TO:STEP with at most 1000 values",
        ),
        ("--receptor-x-mm 2 --receptor-depth-mm 0.5,2.9", "2.9 mm below the skin; choose depths from 0 to 2.38 mm"),
        ("--receptor-depth-mm 0.5,0.05", "--receptor-depth-mm 0.05: must be 0.1 to 3.0 mm"),
        ("--receptor-depth-mm nan", "--receptor-depth-mm 'nan': must be numbers separated by commas"),
        (
            "--receptor-depth-mm deep",
            "--receptor-depth-mm 'deep': must be numbers separated by commas, or FROM:TO:STEP",
        ),
        ("--receptor-z-mm 14", "no receptor at z = 14 mm: z must be 1.97 to 10.26 mm"),
        ("--receptor-z-mm 6,x", "--receptor-z-mm '6,x': must be numbers separated by commas"),
        (
            "--receptor-z-mm 6.5 --model section",
            "a section contains the receptor plane only; receptors at",
        ),
        ("--receptor-x-mm=-1:1:0.01 --receptor-depth-mm 0.5:1:0.1", "1206 receptors; must be 1 to 1000"),
    ],
)
def test_places_that_are_none(indent: Any, more: str, complaint: str) -> None:
    ended = indent(*more.split())
    assert ended.code == 2
    assert complaint in ended.complaint
    assert ended.out == ""


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1", (1.0,)),
        ("1,-2.5", (1.0, -2.5)),
        ("0:1:0.25", (0.0, 0.25, 0.5, 0.75, 1.0)),
        ("0:1:0.3", (0.0, 0.3, 0.6, 0.9)),
        ("-2:-1.9:0.1,5", (-2.0, -1.9, 5.0)),
        ("0:0.3:0.1", (0.0, 0.1, 0.2, 0.3)),
        ("1:1:0.5", (1.0,)),
    ],
)
def test_numbers(text: str, expected: tuple[float, ...]) -> None:
    assert numbers("--n", text) == expected


def test_a_range_has_up_to_a_thousand_numbers() -> None:
    assert len(numbers("--n", "0:999:1")) == 1000
    with pytest.raises(BadInputError, match=r"^--n '0:1000:1': .* 1000 values$"):
        numbers("--n", "0:1000:1")


@pytest.mark.parametrize(
    "text",
    ["", "a", "1,", "0:1", "0:1:2:3", "1:0:0.1", "0:1:0", "0:1:-1", "0:inf:1", "inf:inf:1", "0:1:nan", "nan:1:1"],
)
def test_what_is_no_number(text: str) -> None:
    with pytest.raises(BadInputError, match="must be numbers separated by commas"):
        numbers("--n", text)
