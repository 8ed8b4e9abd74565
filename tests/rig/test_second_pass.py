"""What a script does when it is carried out need not be what it did when it was checked."""

from pathlib import Path

import pytest

from rig.data import read_run
from rig.engine import ScriptError, TripError
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import FinishedRun, NewRun, Session, dry_run
from sim.models.fingertip import Fingertip

READY = "rig.mount('bar:3.0'); rig.home(); rig.zero(); rig.move_to(x_mm=0.0)"


def carried_out(folder: Path, finger: Fingertip, live: str, **tables: object) -> FinishedRun:
    """A script that indents once when checked and does something else when carried out."""
    path = folder / "sly.py"
    path.write_text(
        f"import sys; passes = []\ndef run(rig):\n    passes.append(1); {READY}\n    if len(passes) > 1:\n"
        f"        {live}\n"
        "    else:\n        rig.indent(doi_mm=0.2)\n",
        encoding="utf-8",
    )
    script, config = load_script(str(path)), Config.model_validate(tables)
    plan = make_plan(script, config, finger)
    return dry_run(Session(script, config, finger, plan, NewRun(folder / "runs")))


@pytest.mark.parametrize(
    ("live", "complaint"),
    [
        ("rig.indent(doi_mm=0.2, speed_mm_s=1000)", "speed_mm_s = 1000: expected 0.017 … 5 mm/s"),
        ("rig.indent(doi_mm=0.2, increments=0)", "increments = 0: expected a whole number"),
        ("rig.indent(doi_mm=1.9)", "beyond limits.max_doi_mm = 1.5"),
        ("rig.indent(force_gwt=float('nan'))", "force_gwt = nan: expected a positive number"),
        ("rig.move_to(x_mm=50)", "x_mm = 50 is outside limits.x_mm"),
        ("sys.exit(0)", "SystemExit: 0"),
        ("1 / 0", "ZeroDivisionError"),
    ],
)
def test_every_verb_is_checked_again(tmp_path: Path, finger: Fingertip, live: str, complaint: str) -> None:
    done = carried_out(tmp_path, finger, live)
    assert isinstance(done.problem, ScriptError)
    assert complaint in str(done.problem)
    assert "sly.py, line 5" in str(done.problem)
    run = read_run(done.folder.path)
    assert run.stop is not None
    assert run.stop["status"] == "failed"
    assert run.stream("indentation_start") == []
    assert done.folder.data.exists()


def test_a_swallowed_trip_does_not_end_well(tmp_path: Path, finger: Fingertip) -> None:
    """The finger lies 1 mm lower than the rig believes: no contact where it is expected."""
    live = "\n        ".join(["try:", "    rig.indent(doi_mm=0.2)", "except Exception:", "    pass"])
    done = carried_out(tmp_path, finger, live, virtual={"finger_z_offset_mm": -1.0})
    assert isinstance(done.problem, TripError)
    run = read_run(done.folder.path)
    assert run.stop is not None
    assert run.stop["status"] == "tripped"
    assert not done.complete
