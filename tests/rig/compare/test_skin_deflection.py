"""The skin's deflection beside an indentor: read, interpolated between nodes, and laid beside the model."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rig.cli import main
from rig.compare.exceptions import RecordingError
from rig.compare.recordings.deflection import (
    SkinDeflection,
    compared_deflection,
    deflection_at,
    read_skin_deflection,
)
from rig.report.recording_sections import read_deflections
from sim.models.fingertip import Fingertip
from tests.error_codes import raises


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.csv"
    path.write_text(text, encoding="utf-8")
    return path


# --- reading ---


@pytest.mark.parametrize("read", [read_skin_deflection, read_deflections])
def test_deflections_that_all_point_upward_are_questioned(read: Callable[[Path], object], tmp_path: Path) -> None:
    with raises(RecordingError, "none_downward"):
        read(written(tmp_path, "z_mm,deflection_mm\n6.5,-0.3\n7,-0.2\n"))
    read(written(tmp_path, "z_mm,deflection_mm\n6.5,0.3\n9,-0.02\n"))  # a bulge beside the press


def test_what_is_not_given_is_the_receptor_plane_or_the_centre_line(tmp_path: Path) -> None:
    across = read_skin_deflection(written(tmp_path, "x_mm,deflection_mm\n1,0.1\n"))
    assert (across.x_mm.tolist(), np.isnan(across.z_mm).tolist()) == ([1.0], [True])
    along = read_skin_deflection(written(tmp_path, "z_mm,deflection_mm\n5,0.1\n"))
    assert (along.x_mm.tolist(), along.z_mm.tolist()) == ([0.0], [5.0])


# --- the model's ---


def test_at_nodes_it_is_theirs_and_between_them_linear(finger: Fingertip) -> None:
    result = finger.indent("cylinder:9", 0.0, doi_mm=0.67)
    patch, down = result.model.patch, -result.state.displacement[-1]
    nodes = np.array([0, 100, 613, len(patch) - 1])
    x, z = patch.x[nodes], patch.position_mm[nodes, 2]
    np.testing.assert_allclose(deflection_at(result, x, z), down[nodes], atol=1e-12)
    two = result.model.across[20:22]
    middle = deflection_at(result, patch.x[two].mean(keepdims=True), np.array([result.z_mm]))
    np.testing.assert_allclose(middle, down[two].mean(), atol=1e-12)


@pytest.mark.parametrize("shape", ["cylinder:3,across", "sphere:3", "step:1"])
def test_any_shape_presses_the_skin_down(finger: Fingertip, shape: str) -> None:
    at = {"z_mm": finger.config.receptor_plane_mm} if shape != "step:1" else {}
    result = finger.indent(shape, 0.0, doi_mm=0.5, **at)
    below, beside, far = deflection_at(result, np.array([0.0, 1.5, 99.0]), np.full(3, result.z_mm))
    assert below == pytest.approx(0.5 if shape != "step:1" else below, abs=0.05)
    assert 0 < beside < below
    assert np.isnan(far)


# --- laid beside ---


def test_measured_less_the_model(finger: Fingertip) -> None:
    result = finger.indent("cylinder:9", 0.0, doi_mm=0.67)
    x, z = np.array([0.0, 1.0, 50.0]), np.array([np.nan, 6.0, 6.0])
    model = deflection_at(result, x, np.array([result.z_mm, 6.0, 6.0]))
    found = compared_deflection(result, SkinDeflection(x, z, model + np.array([0.1, -0.3, 0.0]), np.full(3, np.nan)))
    assert (found["points"], found["beside_the_patch"]) == (3, 1)
    assert found["mean_mm"] == pytest.approx(-0.1)
    assert found["rms_mm"] == pytest.approx(np.sqrt((0.01 + 0.09) / 2))
    assert found["model_mm"][2] is None
    assert found["z_mm"] == [result.z_mm, 6.0, 6.0]


@pytest.fixture
def rig(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Callable[..., tuple[int, str, str]]:
    """Run the program; its exit code and what it said on both streams."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["rig", *arguments])
        with pytest.raises(SystemExit) as caught:
            main()
        said = capsys.readouterr()
        return int(caught.value.code or 0), said.out, said.err

    return run


def test_the_command(rig: Callable[..., tuple[int, str, str]], tmp_path: Path) -> None:
    path = written(tmp_path, "x_mm,deflection_mm\n0,0.5\n1.5,0.2\n")
    asked = ("indent", "--shape", "cylinder:9", "--x-mm", "0", "--doi-mm", "0.5", "--deflection", str(path))
    code, said, _ = rig(*asked)
    assert code == 0
    assert "deflection     measured − model" in said
    code, said, _ = rig(*asked, "--json")
    assert json.loads(said)["deflection"]["measured_mm"] == [0.5, 0.2]
    code, out, err = rig(*asked[:-1], "nowhere.csv", "--json")
    told = json.loads(out)
    assert (code, told["code"]) == (2, "unreadable")
    assert err == f"rig: {told['error_text']}\n"
