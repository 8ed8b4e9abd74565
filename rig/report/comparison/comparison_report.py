"""The report of a comparison: one self-contained HTML file, the same bytes for the same input."""

from collections.abc import Sequence
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rig.compare.comparison import COLLINEAR, Comparison, Joint
from rig.compare.recordings.inputs import sha256
from rig.compare.shape_test import THRESHOLD
from rig.compare.stimulus_maps import StimulusMap
from rig.compare.tables import best_receptor, indistinguishable_rows, joint_row, threshold_rows
from rig.data import Run
from rig.data.folder import replace_bytes, replace_text
from rig.report.comparison.comparison_figures import comparison_figures
from rig.report.html import Section, as_png, render
from rig.report.labels import as_limits, as_number, as_positions, unit
from sim.measures.measures import MEASURES
from sim.models.fingertip import Fingertip


def write_comparison(
    path: Path,
    comparison: Comparison,
    runs: Sequence[Run],
    finger: Fingertip,
    command: str,
    extra: Sequence[Section] = (),
    title: str = "Which measure explains the response?",
    maps: Sequence[StimulusMap] = (),
    pdf: Path | None = None,
) -> None:
    """Write the report as HTML, and as PDF where asked for, dated by the newest run.

    `extra` sections come after the verdicts; `command` is what makes the report again.
    """
    page = partial(
        render,
        "comparison.html.j2",
        title=title,
        extra=extra,
        figures=comparison_figures(comparison, maps),
        **_verdicts(comparison),
        **_provenance(comparison, runs, finger, command),
        **_WRITTEN,
    )
    replace_text(path, page())
    if pdf is not None:
        from rig.report.pdf import as_pdf  # most comparisons do without

        newest = datetime.fromtimestamp(max(int(run.start["unix_s"]) for run in runs), UTC)
        replace_bytes(pdf, as_pdf(page(picture=as_png), newest))


def _verdicts(comparison: Comparison) -> dict[str, Any]:
    return {
        "comparison": comparison,
        "verdicts": verdict_rows(comparison),
        "thresholds": threshold_rows(comparison),
        "threshold": THRESHOLD,
        "collinear": [(name, groups) for name, groups in comparison.collinear() if groups],
        "collinear_from": COLLINEAR,
        "conditions": comparison.candidates_by_condition(),
        "judged": [s.title for s in comparison.stimuli if comparison.passes(s) is not None],
        "sets": [(joint.title, indistinguishable_rows(joint)) for joint in comparison.joints],
    }


def _provenance(comparison: Comparison, runs: Sequence[Run], finger: Fingertip, command: str) -> dict[str, Any]:
    return {
        "finger": finger,
        "runs": [(run, sha256(run.folder.events), sha256(run.folder.path / "config.toml")) for run in runs],
        "recordings": {p.stimulus.shape: p.recording for p in comparison.overlays},
        "command": command,
        "versions": {name: version(name) for name in ("indentation-rig", "numpy", "scipy", "matplotlib")},
    }


def verdict_rows(comparison: Comparison) -> list[dict[str, Any]]:
    """One row a measure: where it passes under each stimulus, and its best receptor in each joint fit."""
    candidates = comparison.candidates()
    passed = [(stimulus, comparison.passes(stimulus)) for stimulus in comparison.stimuli]
    rows = []
    for m, measure in enumerate(MEASURES):
        rows.append(
            {
                "measure": measure,
                "candidate": measure in candidates,
                "passes": [s.receptor_mm[flags[m]].tolist() for s, flags in passed if flags is not None],
                "fits": [_best(joint, m) for joint in comparison.joints],
            }
        )
    return rows


def _best(joint: Joint, measure: int) -> dict[str, Any] | None:
    receptor = best_receptor(joint, measure)
    return None if receptor is None else joint_row(joint, (measure, receptor))


_WRITTEN: dict[str, Any] = {
    "num": as_number,
    "mm": as_positions,
    "limits": as_limits,
    "units": {name: unit(name) for name in MEASURES},
}
"""How the template writes numbers, positions, intervals and units."""
