"""The report of a comparison: one self-contained HTML file, the same bytes for the same input."""

from collections.abc import Sequence
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rig.compare.comparison import Comparison, Joint
from rig.compare.recordings.inputs import sha256
from rig.compare.stimulus_maps import StimulusMap
from rig.compare.tables import best_receptor, indistinguishable_rows, joint_row
from rig.data import Run
from rig.data.folder import replace_bytes, replace_text
from rig.report.comparison.comparison_figures import recorded_figures, shape_figures, simulation_figures
from rig.report.comparison.measures_section import measures_section
from rig.report.comparison.shape_section import shape_sections
from rig.report.comparison.source_section import source_section, table_5_1
from rig.report.html import Section, alone, as_png, render
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
        sections=_sections(comparison, finger, extra, maps),
        **_fits(comparison),
        **_provenance(comparison, runs, finger, command),
        **_WRITTEN,
    )
    replace_text(path, page())
    if pdf is not None:
        from rig.report.pdf import as_pdf  # most comparisons do without

        newest = datetime.fromtimestamp(max(int(run.start["unix_s"]) for run in runs), UTC)
        replace_bytes(pdf, as_pdf(page(picture=as_png), newest))


def _sections(
    comparison: Comparison, finger: Fingertip, extra: Sequence[Section], maps: Sequence[StimulusMap]
) -> list[Section]:
    """In the order of the page: recordings, what was asked for besides, the simulation, what words mean."""
    return [
        *map(alone, recorded_figures(comparison)),
        *extra,
        *shape_sections(comparison, shape_figures(comparison)),
        *map(alone, simulation_figures(comparison, maps)),
        measures_section(comparison, finger.e_epidermis_mpa),
        source_section(comparison),
        *([table] if (table := table_5_1(comparison)).rows else []),
    ]


def _fits(comparison: Comparison) -> dict[str, Any]:
    return {
        "comparison": comparison,
        "verdicts": verdict_rows(comparison),
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
    """One row a measure: its best receptor in each joint fit."""
    return [
        {"measure": measure, "fits": [_best(joint, m) for joint in comparison.joints]}
        for m, measure in enumerate(MEASURES)
    ]


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
