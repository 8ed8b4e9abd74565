"""The skin's deflection under a line load, and what was measured over it."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.deflection import read_skin_deflection
from rig.data import Run
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.report.recording_sections import read_deflections, simulated
from rig.session.session import NewRun, Session, dry_run
from sim.models.fingertip import Fingertip
from tests.error_codes import raises
from tests.program import Program, text_of_page


@pytest.fixture(scope="module")
def line_run(finger: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The shipped protocol, its first depth only."""
    script, config = load_script("line", ["deepest_mm=0.5"]), Config()
    plan = make_plan(script, config, finger)
    folder = tmp_path_factory.mktemp("line")
    return dry_run(Session(script, config, finger, plan, NewRun(folder))).run


def test_the_model_deflects_most_under_the_line(line_run: Run, bar_run: Run, finger: Fingertip) -> None:
    assert simulated(bar_run, finger) == []  # a bar lies along the finger
    (found,) = simulated(line_run, finger)
    assert found.doi_mm == pytest.approx(0.5, abs=0.02)
    deepest = int(np.argmax(found.deflection_mm))
    assert found.z_mm[deepest] == pytest.approx(finger.config.receptor_plane_mm, abs=0.2)
    assert found.deflection_mm[deepest] == pytest.approx(found.doi_mm, abs=0.03)  # the apex lies elsewhere in z
    assert (np.diff(found.deflection_mm[: deepest + 1]) > 0).all()  # it falls to both sides
    assert found.deflection_mm[0] < 0.1 * found.doi_mm


def test_measured_deflections_by_depth(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("z_mm,deflection_mm,doi_mm\n6,0.3,1.0\n7,0.9,1.0\n6,0.1,0.5\n9,0.2,\n", encoding="utf-8")
    found = read_deflections(path)
    assert [one.doi_mm for one in found[:2]] == [0.5, 1.0]
    assert math.isnan(found[2].doi_mm)
    np.testing.assert_array_equal(found[1].z_mm, [6, 7])
    np.testing.assert_array_equal(found[1].deflection_mm, [0.3, 0.9])


def test_semicolons_and_decimal_commas(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("z_mm;deflection_mm;doi_mm\n7;0,25;1\n", encoding="utf-8")
    (found,) = read_deflections(path)
    assert (found.doi_mm, found.z_mm.tolist(), found.deflection_mm.tolist()) == (1.0, [7.0], [0.25])


@pytest.mark.parametrize("read", [read_deflections, read_skin_deflection])
@pytest.mark.parametrize("total", ["mean", "sum"])
def test_a_row_of_totals_in_a_table_of_deflections_is_refused(
    read: Callable[[Path], object], total: str, tmp_path: Path
) -> None:
    """As `concat([df, df.agg([total])])` of pandas gives it."""
    z_mm, down_mm = np.array([5.0, 6.0, 7.0, 8.0, 9.0]), np.array([0.1, 0.3, 0.5, 0.4, 0.15])
    of = {"mean": np.mean, "sum": np.sum}[total]
    rows = [*zip(z_mm.tolist(), down_mm.tolist(), strict=True), (float(of(z_mm)), float(of(down_mm)))]
    path = tmp_path / "mine.csv"
    path.write_text("z_mm,deflection_mm\n" + "".join(f"{z!r},{down!r}\n" for z, down in rows), encoding="utf-8")
    with raises(RecordingError, "totals", row=7, column="deflection_mm"):
        read(path)
    path.write_text(path.read_text(encoding="utf-8").rpartition("\n")[0].rpartition("\n")[0] + "\n", encoding="utf-8")
    read(path)


POINTS = ["5,0.1216", "6,0.2882", "7,0.5819", "8,0.2217", "9,0.0554"]
UNNAMED = {
    "the mean at 0": ["0,0.2538"], "the mean at the next place": ["10,0.2538"], "the mean above": [],
    "the sum at the next place": ["10,1.2689"],
}  # fmt: skip


@pytest.mark.parametrize("read", [read_deflections, read_skin_deflection])
@pytest.mark.parametrize("name", UNNAMED)
def test_an_unnamed_row_of_totals_among_points_is_refused(
    name: str, read: Callable[[Path], object], tmp_path: Path
) -> None:
    path = tmp_path / "mine.csv"
    above = [] if UNNAMED[name] else ["7,0.2538"]
    rows = ["z_mm,deflection_mm", *above, *POINTS, *UNNAMED[name]]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    with raises(RecordingError, "totals", column="deflection_mm"):
        read(path)


def test_a_mean_below_the_points_of_each_depth_is_refused(tmp_path: Path) -> None:
    down_mm, path = np.array([0.0008, 0.1216, 0.2882, 0.2217, 0.0554]), tmp_path / "mine.csv"
    rows = [(z, d * doi, doi) for doi in (1, 2) for z, d in [*enumerate(down_mm, 5), (7, down_mm.mean())]]
    text = "z_mm,deflection_mm,doi_mm\n" + "".join(f"{z},{d:.4f},{doi}\n" for z, d, doi in rows)
    path.write_text(text, encoding="utf-8")
    with raises(RecordingError, "totals", row=7, column="deflection_mm"):
        read_deflections(path)


def test_page_terminal_and_json_state_what_was_read_of_a_deflection(
    line_run: Run, program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.cli.compare.stimulus_maps", lambda *_: [])
    path, page = tmp_path / "mine.csv", tmp_path / "page.html"
    path.write_text("z_mm,deflection_mm,doi_mm\n5,0.1216,0.5\n6,0.2882,0.5\n7,0.58,0.5\n", encoding="utf-8")
    words = ("compare", line_run.folder.path, "--deflection", path, "--out", page)
    said = "DOI 0.5 mm: 3 points from z = 5 to 7 mm, 0.1216 to 0.58 mm downward, most at z = 7 mm."
    assert f"deflection  {said}" in program(*words).out
    assert said in text_of_page(page.read_text(encoding="utf-8"))
    assert program(*words, "--json").json["deflection_text"] == said


@pytest.mark.parametrize("read", [read_deflections, read_skin_deflection])
def test_points_before_the_proximal_edge_are_refused(read: Callable[[Path], object], tmp_path: Path) -> None:
    path = tmp_path / "from_the_middle.csv"
    path.write_text("z_mm,deflection_mm\n-4,0.1\n0,0.5\n4,0.1\n", encoding="utf-8")
    with raises(RecordingError, "no_number", row=2, column="z_mm"):
        read(path)
