"""A letter from a picture on a virtual rig: planned, pressed, its file kept, its contact drawn."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from rig.cli import main
from rig.data import RunFolder, read_run
from rig.errors import BadInputError
from rig.plan.config import Config, config_from, load_config
from rig.plan.finger_model import copy_name, from_copy, named_file, responses, with_stored_file
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.study.exceptions import StudyError
from rig.study.parameter_study import read_study
from sim.config import FingertipConfig
from sim.contact.shapes import ShapeError, with_file_beside
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from tests.error_codes import raises
from tests.sim.coarse_mesh import as_toml, coarse_mesh

MESH = coarse_mesh(0.3, 0.3, patch_x_mm=2.0, patch_z_mm=2.0, round_patch_mm=2.0)
COARSE = as_toml(MESH)
SHAPE = "heightmap:parts/letter.png,width_mm=2,height_mm=0.4,turn_deg=20"
SCRIPT = f"""\
def run(rig):
    rig.mount("{SHAPE}")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=-0.3)
    rig.indent(doi_mm=0.4, hold_s=0.1)
    rig.mount("bar:3,across")
    rig.move_to(x_mm=0.0)
    rig.indent(doi_mm=0.2, hold_s=0.1)
"""


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Any]:
    """Run the program with --json beside a script and the picture it names."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "letter.py").write_text(SCRIPT, encoding="utf-8")
    (tmp_path / "coarse.toml").write_text(COARSE, encoding="utf-8")
    (tmp_path / "parts").mkdir()
    ell(tmp_path / "parts" / "letter.png")

    def run(*arguments: str) -> dict[str, Any]:
        monkeypatch.setattr(sys, "argv", ["rig", *arguments, "--json"])
        with pytest.raises(SystemExit) as caught:
            main()
        printed = capsys.readouterr()
        return {"code": int(caught.value.code or 0), "err": printed.err, **json.loads(printed.out or "{}")}

    return run


def ell(path: Path) -> None:
    """An L, dark on white."""
    pixels = np.full((60, 60), 255, np.uint8)
    pixels[10:50, 15:27] = pixels[38:50, 15:45] = 0
    Image.fromarray(pixels).save(path)


def test_a_run_presses_a_letter_from_a_picture_and_keeps_the_picture(
    rig: Callable[..., Any], empty_figures: None, tmp_path: Path
) -> None:
    found = rig("dry-run", "letter.py", "--config", "coarse.toml")
    assert found["code"] == 0, found["err"]
    run = read_run(Path(found["run"]))
    copy = copy_name("parts/letter.png")
    assert (run.folder.path / copy).read_bytes() == (tmp_path / "parts" / "letter.png").read_bytes()
    assert f"  {copy}\n" in (run.folder.path / "SHA256SUMS").read_text(encoding="utf-8")
    assert RunFolder(run.folder.path).changed() == []
    holds = run.stream("hold_end")
    assert [e["doi_mm"] for e in holds] == pytest.approx([0.4, 0.2], abs=0.03)
    assert all(e["force_gwt"] > 0.1 for e in holds)
    report = run.folder.report.read_text(encoding="utf-8")
    assert "Contact from below" in report
    # gone or edited, the original changes nothing
    Image.new("L", (60, 60), 0).save(tmp_path / "parts" / "letter.png")
    answers = responses(run, load("finger", run_config(), cached=True))
    assert [r.result.force_gwt for r in answers] == pytest.approx([e["force_gwt"] for e in holds], rel=0.1)


def run_config() -> Any:
    return load_config(Path("coarse.toml")).finger


# --------------------------------------------------------------------------------- every shape that names a file

NAMING = [
    "profile:{}.csv",
    "profile:{}.csv,linear",
    "profile:{}.csv,across",
    "profile:{}.csv,linear,turn_deg=30",
    "heightmap:{}.png,width_mm=3,height_mm=0.5",
    "heightmap:{}.npy,spacing_mm=0.1,edge_mm=0.2,raised=low,turn_deg=-20",
    "heightmap:{}.csv,raised=high",
    "heightmap:{}.csv,across,edge_mm=0.1,raised=low",
    "heightmap:{}.png,width_mm=3,height_mm=0.5,raised=light",
]


@pytest.mark.parametrize("file", ["a/b/mine", "a,b", "linear", "x=1,y", "ünï"])
def test_every_shape_given_by_a_file_is_read_from_the_copy_in_the_run(tmp_path: Path, file: str) -> None:
    for n, shape in enumerate(NAMING):
        text, run = shape.format(file), tmp_path / str(n)
        run.mkdir()
        name = named_file(text)
        assert name is not None, shape
        assert name.startswith(file), shape
        assert name.removeprefix(file) in (".csv", ".png", ".npy"), shape
        assert from_copy(run, text) == text, "there is none yet"
        (run / copy_name(name)).write_bytes(b"kept")
        assert from_copy(run, text) == text.replace(name, str(run / copy_name(name)))


@pytest.mark.parametrize("there", ["beside", "here", "both", "neither"])
def test_a_shape_file_is_searched_beside_the_script_first_and_an_error_names_both_places(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: str
) -> None:
    """The script's own folder comes first: what a script means does not depend on the shell."""
    for folder in ("beside", "here"):
        (tmp_path / folder).mkdir()
        if there in (folder, "both"):
            (tmp_path / folder / "a.csv").write_text("x_mm,height_mm\n-1,0\n1,0\n", encoding="utf-8")
    (tmp_path / "beside" / "study.toml").write_text("[[press]]\nshape = 'profile:a.csv'\ndoi_mm = 0.1\n", "utf-8")
    monkeypatch.chdir(tmp_path / "here")
    place = tmp_path / ("here" if there == "here" else "beside")
    if there == "neither":
        with raises(ShapeError, "shape_file_missing", file="a.csv") as caught:
            with_file_beside(tmp_path / "beside", "profile:a.csv")
        assert f"{tmp_path / 'beside'} or {tmp_path / 'here'}" in str(caught.value)
        with pytest.raises(StudyError, match=r"there is no file a\.csv in"):
            read_study(tmp_path / "beside" / "study.toml")
        return
    assert with_file_beside(tmp_path / "beside", "profile:a.csv") == f"profile:{place / 'a.csv'}"
    assert read_study(tmp_path / "beside" / "study.toml")[0].shape == f"profile:{place / 'a.csv'}"
    settings = config_from("x", {"virtual": {"indentor": "profile:a.csv"}}, tmp_path / "beside")
    assert settings.virtual.indentor == f"profile:{place / 'a.csv'}"


@pytest.mark.parametrize("now", ["edited", "gone"])
def test_a_run_keeps_its_first_copy_of_a_shape_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, now: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    original, copy = tmp_path / "parts.csv", tmp_path / "run" / copy_name("parts.csv")
    original.write_text("first", encoding="utf-8")
    kept = with_stored_file(tmp_path / "run", "profile:parts.csv")
    if now == "edited":
        original.write_text("second", encoding="utf-8")
    else:
        original.unlink()
    assert with_stored_file(tmp_path / "run", "profile:parts.csv") == kept == f"profile:{copy}"
    assert copy.read_text(encoding="utf-8") == "first"


def test_a_missing_shape_file_is_named_with_the_line_of_the_script(tmp_path: Path, halfspace: Fingertip) -> None:
    script = tmp_path / "mine.py"
    script.write_text("def run(rig):\n    rig.mount('profile:nowhere.csv')\n", encoding="utf-8")
    with pytest.raises(BadInputError, match=r"mine\.py, line 2: .*nowhere\.csv"):
        make_plan(load_script(str(script)), Config(), halfspace)
    assert list(tmp_path.iterdir()) == [script]


# ------------------------------------------------------------------------------------------------------- pictures


@pytest.fixture(scope="module")
def halfspace() -> Fingertip:
    """Enough to be drawn."""
    return load("halfspace", FingertipConfig(mesh=MESH))
