"""The report of a comparison: one self-contained HTML file, the same bytes for the same input."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from rig.compare import comparison_figures as figures
from rig.compare.comparison import COLLINEAR, Comparison, Joint
from rig.compare.cross_sections import CrossSection
from rig.compare.html import Figure, as_png, render
from rig.compare.inputs import sha256
from rig.compare.section_figures import strain_maps
from rig.compare.shape_test import THRESHOLD
from rig.compare.stimuli import Stimulus
from rig.compare.tables import best_pairs, best_receptor, indistinguishable_rows, joint_row, threshold_rows
from rig.data import Run
from rig.data.folder import replace_bytes, replace_text
from sim.fingertip import Fingertip
from sim.measures.measures import MEASURES

_SHOWN_FIRST = ("ep1", "ep3", "sed")  # the source's survivors
_MOST_SHOWN = 3


@dataclass(frozen=True)
class Section:
    """A further table of a report, with figures below it."""

    title: str
    text: str
    header: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    figures: tuple[Figure, ...] = ()


def write_comparison(
    path: Path,
    comparison: Comparison,
    runs: Sequence[Run],
    finger: Fingertip,
    command: str,
    extra: Sequence[Section] = (),
    title: str = "Which measure explains the response?",
    sections: Sequence[CrossSection] = (),
    pdf: Path | None = None,
) -> None:
    """Write the report as HTML, and as PDF where asked for, dated by the newest run.

    `extra` sections come after the verdicts; `command` is what makes the report again.
    """
    page = partial(
        render,
        "comparison.html.j2",
        comparison=comparison,
        verdicts=verdict_rows(comparison),
        thresholds=threshold_rows(comparison),
        collinear=[(name, groups) for name, groups in comparison.collinear() if groups],
        collinear_from=COLLINEAR,
        conditions=comparison.candidates_by_condition(),
        judged=[s.title for s in comparison.stimuli if comparison.passes(s) is not None],
        sets=[(joint.title, indistinguishable_rows(joint)) for joint in comparison.joints],
        figures=[*_figures(comparison), *_strain_maps(sections)],
        title=title,
        extra=extra,
        finger=finger,
        runs=[(run, sha256(run.folder.events), sha256(run.folder.path / "config.toml")) for run in runs],
        recordings={p.stimulus.shape: p.recording for p in comparison.pairings},
        command=command,
        versions={name: version(name) for name in ("indentation-rig", "numpy", "scipy", "matplotlib")},
        threshold=THRESHOLD,
        num=as_number,
        mm=as_positions,
        limits=as_limits,
        labels={name: figures.label(name) for name in MEASURES},
        units={name: figures.unit(name) for name in MEASURES},
    )
    replace_text(path, page())
    if pdf is not None:
        from rig.compare.pdf import as_pdf  # most comparisons do without

        newest = datetime.fromtimestamp(max(int(run.start["unix_s"]) for run in runs), UTC)
        replace_bytes(pdf, as_pdf(page(picture=as_png), newest))


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


def _figures(comparison: Comparison) -> list[Figure]:
    measures = _shown(comparison)
    moved = tuple(stimulus for stimulus in comparison.stimuli if len(stimulus.x_mm) > 1)
    found = [figure for joint in comparison.joints for figure in _fits(joint, measures)]
    found += [_heat_map(comparison)] if comparison.judged else []
    found += [_profiles(s, measures, tested=comparison.passes(s) is not None) for s in moved]
    found += [_population(stimulus, measures) for stimulus in comparison.stimuli]
    return [*found, _pressures(moved)] if moved else found


def _shown(comparison: Comparison) -> list[str]:
    """The measures in the figures: candidates before others, then what explains most, then the source's order."""
    candidates = comparison.candidates()
    explained = np.zeros(len(MEASURES))
    for joint in comparison.joints:
        explained += np.nan_to_num(np.nanmax(np.where(joint.in_play, joint.explained, -np.inf), axis=1), neginf=0.0)
    order = [*_SHOWN_FIRST, *(name for name in MEASURES if name not in _SHOWN_FIRST)]
    order.sort(key=lambda name: (name not in candidates, -explained[MEASURES.index(name)]))
    return order[:_MOST_SHOWN]


def _fits(joint: Joint, measures: list[str]) -> list[Figure]:
    pairs = best_pairs(joint, measures)
    if not pairs:
        return []
    files = "; ".join(f"{p.stimulus.indentor}: {p.recording.name}" for p in joint.pairings)
    return [
        Figure(
            f"Recorded over predicted: {joint.title}",
            figures.overlays(joint, pairs),
            "R = max(0, k(ε − ε₀)) with one k and ε₀ for all shapes of a row, over the recorded rates. For each "
            f"measure the receptor that explains most. {files}.",
        ),
        Figure(
            f"Rate against measure: {joint.title}",
            figures.scatter(joint, pairs),
            "Each point is a recorded position; the measure is interpolated linearly in the SSRP. Black: the joint "
            "line. A negative ε₀ with a positive k says that the unloaded receptor fires.",
        ),
    ]


def _heat_map(comparison: Comparison) -> Figure:
    return Figure(
        "Correlation and shape test, 18 measures × receptors",
        figures.correlations(comparison),
        "Colour: Pearson's correlation between the recorded rates and the SSRP at the recorded positions (white: "
        "nothing recorded, or too few positions covered). Dots: the SSRP passes the shape test. Compressive measures "
        "have their sign changed (−).",
    )


def _profiles(stimulus: Stimulus, measures: list[str], *, tested: bool) -> Figure:
    caption = (
        "One profile a receptor, shifted upwards. Dotted: the mean of the two ends; black tick: the receptor's own x."
    )
    test = (
        f" Blue profiles pass the shape test. Orange: the least dip (steps) or prominence (bars) that counts, "
        f"{100 * THRESHOLD:g} % of the peak or of the range."
    )
    drawn = figures.ssrps(stimulus, measures)
    if tested:
        return Figure(f"SSRPs and shape test: {stimulus.title}", drawn, caption + test)
    return Figure(f"SSRPs: {stimulus.title}", drawn, caption)


def _population(stimulus: Stimulus, measures: list[str]) -> Figure:
    return Figure(
        f"Population responses: {stimulus.title}",
        figures.populations(stimulus, measures),
        "The measures at all receptors, one line for each position of the indentor.",
    )


def _pressures(moved: tuple[Stimulus, ...]) -> Figure:
    return Figure(
        "Pressure and contact regions along the schedules",
        figures.pressure_maps(moved),
        "Nodal pressure in the receptor plane, unfiltered, one row for each position of the indentor. White: the "
        "ends of the contact regions.",
    )


def _strain_maps(sections: Sequence[CrossSection]) -> list[Figure]:
    return [
        Figure(
            f"Strain under the skin: {title}",
            strain_maps(list(members)),
            "The receptor plane, deformed, at up to three positions of the schedule: one value an element, not "
            "smoothed. The epidermis is ten times as stiff as what lies below. White circles: receptors. The highest "
            "3 % of the elements share the top colour.",
        )
        for title, members in groupby(sections, key=lambda section: section.stimulus.title)
    ]


def as_number(value: float | None, digits: int = 3) -> str:
    """A number for a table with a typographic minus; a dash where there is none."""
    if value is None:
        return "–"
    plain = f"{float(f'{value:.{digits}g}'):.12g}" if abs(value) < _WIDEST_PLAIN else f"{value:.{digits}g}"
    return plain.replace("-", "−")


_WIDEST_PLAIN = 1e5


def as_positions(values: Iterable[float]) -> str:
    """Places in mm for a table; a dash where there are none."""
    return " ".join(as_number(round(float(v), 3) + 0.0, 4) for v in values) or "–"


def as_limits(values: Sequence[float | None] | None) -> str:
    """An interval for a table; nothing where there is none."""
    return f"[{as_number(values[0])}, {as_number(values[1])}]" if values else ""
