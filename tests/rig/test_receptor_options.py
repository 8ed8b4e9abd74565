"""`rig indent` with receptors at other places: lists and ranges, several depths and z, and what does not exist."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.cli.options import numbers
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


def test_indent_places_receptors_at_every_combination_of_x_depth_and_z(indent: Any) -> None:
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


def test_a_point_load_on_the_section_model_is_a_line_load_per_millimeter(program: Program, tmp_path: Path) -> None:
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
def test_a_list_of_numbers_may_mix_values_and_ranges(text: str, expected: tuple[float, ...]) -> None:
    assert numbers("--n", text) == expected
