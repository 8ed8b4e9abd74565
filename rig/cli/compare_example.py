"""`rig compare --example`: a recorded afferent against a rehearsal on the simulated finger, without a run."""

import json
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from rig.cli.options import HTML, checked_file
from rig.cli.output import THE_FINGER, busy, out, print_json, writes_json
from rig.compare.comparison_rows import PhaseCandidateJson, PhaseJson
from rig.compare.comparison_rows import as_json as comparison_as_json
from rig.compare.example import (
    PHASES,
    PhaseCandidate,
    PhaseVerdict,
    judge_phase,
    positions,
    recorded,
    rehearse,
    static_comparison,
)
from rig.compare.make_verdict import answers
from rig.compare.verdict import six_digits
from rig.data.folder import replace_text
from rig.report.comparison_report import write_comparison
from rig.report.example_page import example_sections, lead_sentences, read_levels
from sim.models.fingertip import Fingertip

EXAMPLES = ("bar3",)
_TITLE = "Which measure explains a recorded afferent under a bar?"


def compare_example(report: Path, made_by: str) -> None:
    """Rehearse the protocol on the default finger, compare both phases, write the page."""
    began = time.perf_counter()
    checked_file("--out", report, *HTML)
    with busy(THE_FINGER):
        finger = Fingertip.load()
    x_mm = positions()
    with busy("positions of the bar on the simulated finger", total=len(x_mm)) as activity:
        rehearsal = rehearse(finger.keeping_ways(), x_mm, on_position=activity.at)
    with busy("comparing every measure with the recording …"):
        verdicts = [judge_phase(rehearsal, recorded(phase), phase) for phase in PHASES]
        comparison = static_comparison(rehearsal)
        static = answers(comparison)
    with busy("writing the report …"):
        write_comparison(
            report,
            comparison,
            [],
            finger,
            made_by,
            title=_TITLE,
            answers=static,
            lead=example_sections(rehearsal, verdicts),
        )
    write_sidecar(report, time.perf_counter() - began)
    if writes_json():
        result = comparison_as_json(comparison, str(report), static)
        result["left_out"], result["phases"] = [], phases_as_json(verdicts)
        print_json(result)
        return
    for name, line in zip(("verdict", "open", "depends"), lead_sentences(verdicts, read_levels()), strict=True):
        out.print(f"{name:12s}{line}")
    out.print(f"report      {report}")


def write_sidecar(report: Path, seconds: float) -> None:
    """Write dates and times in a file beside the report, whose own bytes depend only on the input."""
    made = {"made_utc": datetime.now(UTC).isoformat(timespec="seconds"), "seconds": round(seconds, 3)}
    replace_text(report.with_name(report.name + ".made.json"), json.dumps(made) + "\n")


def phases_as_json(verdicts: Sequence[PhaseVerdict]) -> list[PhaseJson]:
    """Return both phases with all candidates, best prediction first."""
    return [
        {
            "phase": one.phase,
            "positions": one.positions,
            "positions_recorded": one.recorded,
            "sed_r": six_digits(one.sed_r),
            "monotone_bound": six_digits(one.bound),
            "rows": [_row(row) for row in one.rows],
        }
        for one in verdicts
    ]


def _row(row: PhaseCandidate) -> PhaseCandidateJson:
    return {
        "candidate": row.name,
        "receptor_mm": row.receptor_mm,
        "control": row.control,
        "r": six_digits(row.r),
        "held_out": six_digits(row.held_out),
        "p_fit": six_digits(row.p_fit),
        "p_set": six_digits(row.p_set),
        "held_out_interval": [six_digits(limit) for limit in row.interval],
        "in_set": row.in_set,
    }
