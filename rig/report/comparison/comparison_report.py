"""The report of a comparison: one self-contained HTML file, the same bytes for the same input."""

from collections.abc import Sequence
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rig.compare.answers.answer import Answer
from rig.compare.comparison import Comparison, Overlay
from rig.compare.recordings.inputs import sha256
from rig.compare.stimulus_maps import StimulusMap
from rig.data import Run
from rig.data.folder import replace_bytes, replace_text
from rig.report.comparison.answer_sections import answer_sections
from rig.report.comparison.comparison_figures import shape_figures, shown_measures, simulation_figures
from rig.report.comparison.fit_figures import frame
from rig.report.comparison.measures_section import measures_section
from rig.report.comparison.shape_section import shape_sections
from rig.report.comparison.source_section import source_sections
from rig.report.html import Section, alone, as_png, render
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
    answers: Sequence[Answer] = (),
) -> None:
    """Write the report as HTML, and as PDF where asked for, dated by the newest run.

    `answers` are what the recordings say; `extra` sections come after them; `command` makes the report again.
    """
    shown = shown_measures(comparison, answers)
    page = partial(
        render,
        "comparison.html.j2",
        title=title,
        sections=[
            *answer_sections(answers, frame(comparison.overlays), recorded=bool(comparison.overlays)),
            *extra,
            *simulation_sections(comparison, shown, maps),
            measures_section(comparison, finger.e_epidermis_mpa),
            *source_sections(comparison),
        ],
        **_provenance(comparison, runs, finger, command),
    )
    replace_text(path, page())
    if pdf is not None:
        from rig.report.pdf import as_pdf  # most comparisons do without

        newest = datetime.fromtimestamp(max(int(run.start["unix_s"]) for run in runs), UTC)
        replace_bytes(pdf, as_pdf(page(picture=as_png), newest))


def simulation_sections(comparison: Comparison, shown: Sequence[str], maps: Sequence[StimulusMap]) -> list[Section]:
    """What the simulation says, whatever was recorded, of the measures that are shown."""
    figures = simulation_figures(comparison, shown, maps)
    return [*shape_sections(comparison, shape_figures(comparison, shown)), *map(alone, figures)]


def _provenance(comparison: Comparison, runs: Sequence[Run], finger: Fingertip, command: str) -> dict[str, Any]:
    return {
        "comparison": comparison,
        "finger": finger,
        "small_strain": comparison.small_strain.note,
        "runs": [(run, sha256(run.folder.events), sha256(run.folder.path / "config.toml")) for run in runs],
        "recordings": list(dict.fromkeys(map(_recording, comparison.overlays))),
        "command": command,
        "versions": {name: version(name) for name in ("indentation-rig", "numpy", "scipy", "matplotlib")},
    }


def _recording(overlay: Overlay) -> tuple[str, str, str, str]:
    """Its file, the shape, what was done to its numbers, and SHA-256; laid over several conditions it is one."""
    found = overlay.recording
    return found.name, overlay.stimulus.shape, ", ".join(found.changes), found.sha256
