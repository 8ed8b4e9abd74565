"""`rig design` from its options to a script that checks and rehearses, and what it refuses."""

from pathlib import Path

import pytest

from rig.data import read_run
from rig.design import design as designs
from rig.design.response_table import ResponseTable
from tests.program import Program
from tests.rig.identify.finger_file import MESH, SERIES, identified_file
from tests.sim.coarse_mesh import as_toml

REQUEST = ("--candidates", "ep1,sed,e22", "--shapes", "bar:1.5,bar:3.0", "--depths-mm", "0.25,0.5,1", "--quick")
ON_COARSE = ("--config", "coarse.toml")


@pytest.fixture
def here(table: ResponseTable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, empty_figures: None) -> Path:
    """Return a folder with a finger of few nodes; the table of responses is that of bumps."""
    monkeypatch.chdir(tmp_path)
    Path("coarse.toml").write_text(as_toml(MESH), encoding="utf-8")
    some = table.only(range(0, len(table.presses), 3))
    monkeypatch.setattr(designs, "response_table", lambda *_: some)
    monkeypatch.setattr(ResponseTable, "predictions", {})  # the finger's own, which the bumps know nothing of
    return tmp_path


def test_a_script_that_checks_and_rehearses(here: Path, program: Program) -> None:
    """Its presses are those of the design, in order, within the minutes; the page is one file."""
    made = program("design", *REQUEST, *ON_COARSE, "--minutes", "2", "--power", "--json")
    assert made.code == 0, made.err
    found = made.json
    assert found["duration_s"] <= 120
    assert Path(found["report"]).read_text(encoding="utf-8").count("<html") == 1
    assert {row["fibers"] for row in found["power"]} >= {1, 12}
    assert found["outcomes"][-1]["design"] == "all presses"
    checked = program("check", "designed.py", *ON_COARSE, "--json").json
    assert [(s["indentor"], s["x_mm"], s["value"]) for s in checked["steps"]] == [
        (p["shape"], p["x_mm"], p["value"]) for p in found["presses"]
    ]
    assert checked["duration_s"] + 60 * (len(found["shapes"]) - 1) == pytest.approx(found["duration_s"], rel=0.1)
    ended = program("dry-run", "designed.py", *ON_COARSE, "--json")
    assert ended.code == 0, ended.err
    rows = [f"{p['shape']},{p['x_mm']},{p['value']},{n}" for n, p in enumerate(found["presses"])]
    Path("counts.csv").write_text("\n".join(["shape,x_mm,doi_mm,count", *rows]), encoding="utf-8")
    judged = program("design", *REQUEST, *ON_COARSE, "--counts", "counts.csv", "--json").json
    assert {row["name"] for row in judged["candidates"]} == set(found["candidates"])
    different = {(p["shape"], p["x_mm"], p["value"]) for p in found["presses"]}
    assert (judged["presses"], judged["different_presses"]) == (len(found["presses"]), len(different))
    run = read_run(Path(ended.json["run"]))
    assert len(list(run.stream("indentation_end"))) == len(found["presses"])


@pytest.mark.study  # rig/identify/test_identified_finger_in_a_run.py
def test_an_identified_finger(here: Path, program: Program) -> None:
    """It relaxes, so presses carry over; the script is checked within its bands."""
    Path("finger.toml").write_text(identified_file(relaxation=SERIES).as_toml(), encoding="utf-8")
    finger = ("--finger", "finger.toml")
    made = program("design", *REQUEST, "--minutes", "2", *finger, "--json")
    assert made.code == 0, made.err
    found = made.json
    assert found["carried_over"] > 0
    checked = program("check", "designed.py", *finger, "--json").json
    assert [(s["indentor"], s["x_mm"], s["value"]) for s in checked["steps"]] == [
        (p["shape"], p["x_mm"], p["value"]) for p in found["presses"]
    ]
    assert all(low < high for low, high in (step["force_band_gwt"] for step in checked["steps"]))


def test_bands_that_the_planner_refuses(here: Path, program: Program) -> None:
    """Presses are chosen without bands; those of a finger so badly known end the command, and nothing is written."""
    Path("finger.toml").write_text(identified_file(spread=0.3).as_toml(), encoding="utf-8")
    ended = program("design", *REQUEST, "--minutes", "2", "--finger", "finger.toml", "--json")
    assert ended.code == 2
    assert ended.json["code"] == "too_fast_for_sensor"
    assert not Path("designed.py").exists()
