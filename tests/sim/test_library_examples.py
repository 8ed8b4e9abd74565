"""The twelve examples of the library: they run, on a coarse finger; their types hold; the page shows them."""

import csv
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest

from sim import MEASURES, Fingertip, FingertipConfig
from tests.sim.coarse import coarse_mesh
from tests.sim.test_door import checked

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "library_tasks.md"
EXAMPLES = sorted((ROOT / "examples" / "library").glob("*.py"))
COARSE = coarse_mesh(0.4, 0.6)


@pytest.fixture(scope="module")
def coarse() -> Fingertip:
    """A finger for examples: the default's patch, few nodes."""
    return Fingertip.load(FingertipConfig(mesh=COARSE))


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    matplotlib.use("agg")


def _main(name: str, *arguments: Any, **options: Any) -> Any:
    (path,) = (path for path in EXAMPLES if path.stem == name)
    return runpy.run_path(str(path))["main"](*arguments, **options)


def test_press_and_plot(coarse: Fingertip, tmp_path: Path) -> None:
    result = _main("01_press_and_plot", coarse, doi_mm=0.5)
    assert result.doi_mm == 0.5
    assert "</svg>" in (tmp_path / "press.svg").read_text(encoding="utf-8")


def test_sweep(coarse: Fingertip, capsys: pytest.CaptureFixture[str]) -> None:
    found = _main("02_sweep", coarse, positions=5, cores=1)
    assert found.problems == [""] * 5
    assert found.table()["force_gwt"] == pytest.approx(2.33, rel=1e-6)
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 5
    assert said[0].startswith(f"x =  2.00 mm: {found[0].peak_pressure_pseudo:5.0f} pseudo-units, ")


def test_own_indentor(coarse: Fingertip) -> None:
    result = _main("03_own_indentor", coarse)
    assert result.indentor.name == "profile:rippled dome"
    assert result.force_gwt == pytest.approx(2.0, rel=1e-6)


def test_own_layers() -> None:
    force_gwt = _main("04_own_layers", COARSE)
    assert force_gwt["thin and soft"] < 0.8 * force_gwt["default"]


def test_own_finger() -> None:
    finger = _main("05_own_finger", COARSE)
    assert finger.config.receptor_plane_mm == pytest.approx(7.6)
    assert finger.apex_height_mm == pytest.approx(5.2, abs=0.2)


def test_strain_anywhere(coarse: Fingertip) -> None:
    sed = _main("06_strain_anywhere", coarse, depths_mm=(0.6, 1.0))
    assert sed.shape == (2, 17)
    assert sed[0].max() > 1.2 * sed[1].max()
    assert sed.min() > 0


def test_ssrp(coarse: Fingertip, tmp_path: Path) -> None:
    found = _main("07_ssrp", coarse, positions=6, cores=1)
    assert tuple(found) == MEASURES
    alone = coarse.indent("step:1", -0.28, force_gwt=2.33).receptor_measures  # the third of six
    assert found["sed"][2] == pytest.approx(alone["sed"][3], rel=1e-6)
    assert found["ep1"][2] == pytest.approx(-alone["ep1"][3], rel=1e-6)
    assert (tmp_path / "ssrp.svg").exists()


def test_fit_to_rates(coarse: Fingertip) -> None:
    k, eps0 = _main("08_fit_to_rates", coarse, positions=7, cores=1)
    alone = coarse.indent("bar:1.5", 0.0, doi_mm=0.4).receptor_measures["sed"][5]
    assert 0 < eps0 < alone
    assert 0 < k < 80 / (0.5 * alone)


def test_a_thousand_poses(coarse: Fingertip, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = _main("09_a_thousand_poses", coarse, poses=12, cores=1)
    assert len(found) == 12
    assert found.problems == [""] * 12
    said = capsys.readouterr().out
    assert "\r12 of 12\n<12 indentations, 0 with a problem>\n" in said
    assert said.count("mm deep on average") == len(set(found.table()["shape"]))
    assert len((tmp_path / "presses.csv").read_text(encoding="utf-8").splitlines()) == 13
    assert len((tmp_path / "receptors.csv").read_text(encoding="utf-8").splitlines()) == 121


def test_parameter_study(tmp_path: Path) -> None:
    assert _main("10_parameter_study", COARSE, epidermis_mm=(0.4, 0.5), bone_fraction=(0.32,)) == 4
    with (tmp_path / "study.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["shape"] for row in rows] == ["bar:1.5", "cylinder:9"] * 2
    assert [float(row["epidermis_mm"]) for row in rows] == [0.4, 0.4, 0.5, 0.5]
    assert float(rows[2]["force_gwt"]) > float(rows[0]["force_gwt"])


def test_encode(capsys: pytest.CaptureFixture[str]) -> None:
    felt, by_convolution = _main("11_encode", FingertipConfig(mesh=COARSE), half_length=16)
    assert felt.samples == len(by_convolution) == 33
    assert np.linalg.norm(by_convolution - felt.sed) < 0.5 * np.linalg.norm(felt.sed)
    silent = int((felt.rate == 0).sum())
    assert 0 < silent < 33
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("M = 33 receptors, noise ")
    assert said[0].endswith(f" of the peak, {silent} silent")
    assert len(said) == 34


def test_decode(capsys: pytest.CaptureFixture[str]) -> None:
    found, errors = _main("12_decode", FingertipConfig(mesh=COARSE), receptors=24)
    assert found.converged
    assert errors.relative_l2 < 0.5
    said = capsys.readouterr().out.splitlines()
    assert said[0] == f"converged, relative L2 {errors.relative_l2:.0%}"
    assert len(said) == 26
    assert said[-1].startswith("from rates, 30 ± 4 each: the band is wider by ")


# --- all of them ---


def test_there_are_twelve_and_each_is_tried() -> None:
    assert [path.stem[:3] for path in EXAMPLES] == [f"{n:02}_" for n in range(1, 13)]
    tried = {name.removeprefix("test_") for name in globals() if name.startswith("test_")}
    assert {path.stem[3:] for path in EXAMPLES} <= tried


def test_their_types_hold_without_plugins(tmp_path: Path) -> None:
    said = checked(EXAMPLES, tmp_path)
    assert said.startswith("Success: no issues found in 12 source files"), said


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_page_shows_it(path: Path) -> None:
    file = f"examples/library/{path.name}"
    shown = f"`{file}`\n\n```{{literalinclude}} ../{file}\n:language: python\n```\n"
    assert shown in PAGE.read_text(encoding="utf-8"), f"{PAGE} is to hold:\n{shown}"


def test_one_runs_as_a_script_beside_processes(tmp_path: Path) -> None:
    """As a user begins it, without arguments: what is imported again in a process does not begin anew."""
    script = tmp_path / "sweep.py"
    text = (ROOT / "examples" / "library" / "02_sweep.py").read_text(encoding="utf-8")
    script.write_text(text.replace("main(Fingertip.load())", "main(Fingertip.load(), positions=3, cores=2)"))
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert np.array(done.stdout.splitlines()).shape == (3,)
