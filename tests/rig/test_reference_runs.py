"""A reference run on each kind of stage moves, presses and is reported as before.

REFERENCE=write pytest -n 0 tests/rig/test_reference_runs.py    # writes the tables anew: look at the difference
"""

import csv
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from rig.data import Run, read_run
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import NewRun, Session, dry_run
from sim.models.fingertip import Fingertip

TABLES = Path(__file__).parents[1] / "data" / "reference_runs"
SCRIPT = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.4)
    rig.precondition(presses=1, doi_mm=0.3, hold_s=0.1)
    rig.indent(force_gwt=2.0, increments=2, hold_s=0.2)
    rig.move_to(x_mm=-0.4)
    rig.ramp(doi_mm=0.5, speed_mm_s=0.3, hold_s=0.2)
    rig.reference(x_mm=0.4, doi_mm=0.3, increments=1, hold_s=0.1)
"""
BENCHES: Mapping[str, Mapping[str, Any]] = {
    "grbl": {"stage": {"kind": "grbl"}, "force": {"kind": "mtsics"}},
    "leadshine": {"stage": {"kind": "leadshine"}, "force": {"kind": "laumas", "baud": 115200}},
    "zaber": {"stage": {"kind": "zaber"}, "force": {"kind": "mtsics"}},
    "standa": {"stage": {"kind": "standa"}, "force": {"kind": "text_cell"}},
    "tmcl": {"stage": {"kind": "tmcl"}, "force": {"kind": "net_ft"}},
}
COLUMNS = ("stream", "t_s", "index", "phase", "x_mm", "height_mm", "doi_mm", "force_gwt", "contact_height_mm")
ALIKE = 2e-6  # s, mm and gwt: the journal has six decimals, and processors differ in the last bits


@pytest.mark.parametrize("kind", BENCHES)
def test_the_reference_run_of_each_stage_moves_presses_and_reports_as_recorded(
    kind: str, finger: Fingertip, tmp_path: Path
) -> None:
    (tmp_path / "reference.py").write_text(SCRIPT, encoding="utf-8")
    script = load_script(str(tmp_path / "reference.py"), [])
    config = Config.model_validate(BENCHES[kind])
    plan = make_plan(script, config, finger)
    done = dry_run(Session(script, config, finger, plan, NewRun(tmp_path)))
    assert done.complete, done.problem
    found = [list(COLUMNS), *_rows(read_run(done.folder.path))]
    table = TABLES / f"{kind}.csv"
    if os.environ.get("REFERENCE") == "write":
        TABLES.mkdir(parents=True, exist_ok=True)
        with table.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(found)
    with table.open(encoding="utf-8", newline="") as file:
        known = list(csv.reader(file))
    assert len(found) == len(known)
    for number, (row, before) in enumerate(zip(found, known, strict=True)):
        assert all(map(_alike, row, before)), f"row {number}: {row}, before {before}"


def _rows(run: Run) -> Iterator[list[str]]:
    for stream, event in run.in_order:
        if any(key in event for key in COLUMNS[4:]):
            values = {"stream": stream, **event}
            yield [_text(values.get(key)) for key in COLUMNS]


def _text(value: object) -> str:
    return "" if value is None else f"{value:.6f}" if isinstance(value, float) else str(value)


def _alike(found: str, before: str) -> bool:
    try:
        return found == before or math.isclose(float(found), float(before), abs_tol=ALIKE)
    except ValueError:
        return False
