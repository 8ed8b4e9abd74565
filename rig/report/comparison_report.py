"""The report of a comparison: one self-contained HTML file, the same bytes for the same input."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from rig.compare.comparison import COLLINEAR, Comparison, Overlay
from rig.compare.comparison_rows import threshold_rows
from rig.compare.place_grid import PlaceRow, ReceptorLocation, in_mm, within
from rig.compare.profile_shape_test import DRAWS, THRESHOLD, chance_rows
from rig.compare.recordings.reading import sha256
from rig.compare.stimuli import StimulusMap, StimulusRow
from rig.compare.verdict import AfferentVerdict
from rig.compare.verdict_text import probability
from rig.data import Run
from rig.data.folder import replace_text
from rig.report import profile_figures
from rig.report.page_parts import Section, alone, figures_of, render
from rig.report.page_source import source_line
from rig.report.plot import Plot
from rig.report.profile_figures import strain_maps
from rig.report.recording_sections import SURVIVORS, frame, source_sections
from rig.report.style import as_number, as_positions, label, unit
from rig.report.verdict_section import answer_sections
from sim.measures.measures import BY_NAME, MEASURES
from sim.models.fingertip import Fingertip
from sim.models.interpolation import HOW_MADE
from sim.units import PSEUDO_E_EPIDERMIS

_MOST_SHOWN = 3


def shape_figures(comparison: Comparison, shown: Sequence[str]) -> list[Plot]:
    """Return figures of profiles and shape tests, none larger than a printed page."""
    draw = partial(profile_figures.correlations, comparison)
    return [
        *figures_of(comparison.judged, profile_figures.CORRELATIONS_A_PAGE, draw),
        *(_profiles(comparison, stimulus, shown) for stimulus in _moved(comparison)),
    ]


def _profiles(comparison: Comparison, stimulus: StimulusRow, shown: Sequence[str]) -> Plot:
    return profile_figures.ssrps(stimulus, shown, tested=comparison.passes(stimulus) is not None)


def simulation_figures(comparison: Comparison, shown: Sequence[str], maps: Sequence[StimulusMap]) -> list[Plot]:
    """Return the figures of the simulation, in the order of the page."""
    return [
        *(profile_figures.populations(stimulus, shown) for stimulus in comparison.stimuli),
        *figures_of(_moved(comparison), profile_figures.PRESSURES_A_PAGE, profile_figures.pressure_maps),
        *(
            strain_maps(list(members), f"Strain under the skin: {title}", _STRAIN)
            for title, members in groupby(maps, key=lambda one: one.stimulus.title)
        ),
    ]


_STRAIN = (
    ", at up to three positions of the schedule, with one value per element and no smoothing. The epidermis is ten "
    "times as stiff as the layers below it."
)


def shown_measures(comparison: Comparison, answers: Sequence[AfferentVerdict]) -> list[str]:
    """Return the measures to plot: maximum-likelihood measures, then candidates, then the source's."""
    likeliest = (row.name for answer in answers for row in answer.measures)
    passed = comparison.candidates()
    candidates = [name for name in (*SURVIVORS, *MEASURES) if name in passed]
    return list(dict.fromkeys((*likeliest, *candidates, *SURVIVORS)))[:_MOST_SHOWN]


def _moved(comparison: Comparison) -> list[StimulusRow]:
    return [stimulus for stimulus in comparison.stimuli if len(stimulus.x_mm) > 1]


_HEADER = ("measure", "definition", "unit", "plotted as", "range as plotted", "share with the other sign")


def measures_section(comparison: Comparison, young_mpa: float) -> Section:
    """Return the table of measures: unit, sign, and range over all receptors and positions."""
    pseudo_unit = as_number(young_mpa / PSEUDO_E_EPIDERMIS)
    return Section(
        "Definition of the measures",
        "Each measure is evaluated at a receptor in the receptor plane: x across the finger, y out of the "
        "pulp, z along the finger, at small strain. Raw values are positive in tension and extension. "
        "Measures that are compressive at almost every receptor are plotted with their sign changed, so that "
        "a larger value means more compression; values of the other sign stay negative. k and ε₀ have the "
        "sign and the unit of the plot. Stresses and energy are in pseudo-units, in which E of the epidermis "
        f"is 10 000; one pseudo-unit is {pseudo_unit} MPa here.",
        _HEADER,
        tuple(_row(comparison, m, name) for m, name in enumerate(MEASURES)),
    )


def _row(comparison: Comparison, number: int, name: str) -> tuple[str, ...]:
    values = np.concatenate([stimulus.measures[number].ravel() for stimulus in comparison.stimuli])
    turned = BY_NAME[name].as_magnitude
    return (
        name,
        BY_NAME[name].meaning,
        unit(name),
        f"{label(name)}, as magnitude" if turned else f"{label(name)}, unchanged",
        f"{as_number(float(values.min()))} … {as_number(float(values.max()))}",
        f"{100 * np.mean(values < 0):.0f} %" if turned else "",
    )


_ONLY_SIMULATED = (
    "The shape test is a property of the simulation. It checks whether simulated profiles have the shape of "
    "the source's recordings (for steps a peak above its dip, for bars two peaks) and does not use the "
    "recordings given here."
)


def shape_sections(comparison: Comparison, figures: list[Plot]) -> list[Section]:
    """Return the shape-test verdicts with `figures`, their dependence on the threshold, and collinear measures."""
    judged = [stimulus for stimulus in comparison.stimuli if comparison.passes(stimulus) is not None]
    title = "The shape test: a property of the simulation"
    if not judged:
        none = (
            "No test is defined for these indentors or schedules; it requires steps or bars at five or "
            "more positions."
        )
        return [
            Section(title, f"{_ONLY_SIMULATED}\n\n{none}", figures=tuple(figures)),
            *_collinear(comparison),
        ]
    return [
        Section(
            title,
            f"{_ONLY_SIMULATED}\n\n{_candidates(comparison)} The table lists the receptors (x in mm) at which each "
            f"measure passes, at a threshold of {100 * THRESHOLD:g} %. {_by_chance(comparison)}",
            ("measure", "candidate", *(stimulus.title for stimulus in judged)),
            _rows(comparison, judged),
            tuple(figures),
            points=_by_condition(comparison),
        ),
        _thresholds(comparison, judged),
        *_collinear(comparison),
    ]


def _candidates(comparison: Comparison) -> str:
    names = ", ".join(comparison.candidates()) or "none"
    return (
        f"Candidates: {names}. A candidate passes at the same receptor under every step at every force, and "
        "near x = 0 under every bar."
    )


def _by_chance(comparison: Comparison) -> str:
    """Return the share of random profiles that pass the shape test, as a sentence."""
    rows = [(row, row["passes_by_chance"]) for row in chance_rows(comparison.stimuli)]
    shares = [f"{row['shape']} at {row['condition']} {100 * one:.0f} %" for row, one in rows if one is not None]
    return (
        f"Of {DRAWS} random profiles as smooth as the stimulus's own, these shares pass: {', '.join(shares)}."
        if shares
        else ""
    )


def _by_condition(comparison: Comparison) -> tuple[str, ...]:
    found = comparison.candidates_by_condition()
    return tuple(f"{name}: {', '.join(names) or 'none'}" for name, names in found) if len(found) > 1 else ()


def _rows(comparison: Comparison, judged: list[StimulusRow]) -> tuple[tuple[str, ...], ...]:
    candidates = comparison.candidates()
    passed = [(s.receptor_mm, comparison.passes(s)) for s in judged]
    return tuple(
        (
            name,
            "yes" if name in candidates else "no",
            *(as_positions(x[flags[measure]]) for x, flags in passed if flags is not None),
        )
        for measure, name in enumerate(MEASURES)
    )


def _thresholds(comparison: Comparison, judged: list[StimulusRow]) -> Section:
    receptors = len(comparison.stimuli[0].receptor_mm)
    return Section(
        "Dependence of the shape test on its threshold",
        f"Number of passing profiles of {len(MEASURES)} measures × {receptors} receptors, and the candidates.",
        ("threshold", *(stimulus.title for stimulus in judged), "candidates"),
        tuple(
            (f"{100 * row['threshold']:g} %", *map(str, row["counts"]), ", ".join(row["candidates"]) or "none")
            for row in threshold_rows(comparison)
        ),
    )


def _collinear(comparison: Comparison) -> list[Section]:
    found = [(name, groups) for name, groups in comparison.collinear() if groups]
    if not found:
        return []
    return [
        Section(
            "Nearly collinear measures",
            "Recordings with these stimuli can hardly distinguish these measures, whatever the rates (|r| ≥ "
            f"{COLLINEAR:g} over all positions and receptors).",
            points=tuple(f"{name}: {'; '.join(' = '.join(names) for names in groups)}" for name, groups in found),
        )
    ]


def write_comparison(
    path: Path,
    comparison: Comparison,
    runs: Sequence[Run],
    finger: Fingertip,
    command: str,
    extra: Sequence[Section] = (),
    title: str = "",
    maps: Sequence[StimulusMap] = (),
    answers: Sequence[AfferentVerdict] = (),
    lead: Sequence[Section] = (),
) -> None:
    """Write the report.

    `answers` are the verdicts on the recordings, after `lead` and before `extra` sections; `command` reproduces the
    report. Without recordings, a measured deflection comes first, or else the simulated profiles.
    """
    shown = shown_measures(comparison, answers)
    instead = () if answers else (_overview(comparison, shown),)
    first = [] if comparison.overlays else [one for one in extra if one.rows]
    extra = [one for one in extra if one not in first]
    of_recordings = "Which measure explains the response?" if comparison.overlays else "Simulated responses"
    page = render(
        "comparison.html.j2",
        title=title or of_recordings,
        source=source_line(runs, "no run: a rehearsal on the virtual finger"),
        sections=[
            *lead,
            *(part for one in first for part in _figure_before_table(one)),
            *answer_sections(
                answers, frame(comparison.overlays), recorded=bool(comparison.overlays), instead=instead
            ),
            *extra,
            *simulation_sections(comparison, shown, maps, {figure.title for figure in instead}),
            measures_section(comparison, finger.e_epidermis_mpa),
            *source_sections(comparison),
        ],
        **_provenance(comparison, runs, finger, command),
    )
    replace_text(path, page)


def _figure_before_table(section: Section) -> list[Section]:
    """Return a section that opens a page with its first paragraph, and the rest with its table as another one."""
    message, _, rest = section.text.partition("\n\n")
    table = replace(section, title=f"{section.title}, in numbers", text=rest, figures=())
    return [replace(section, text=message, header=(), rows=()), table]


def _overview(comparison: Comparison, shown: Sequence[str]) -> Plot:
    """Return the figure that opens a page without a verdict: simulated profiles."""
    moved = _moved(comparison)
    if not moved:
        return profile_figures.populations(comparison.stimuli[0], shown)
    return _profiles(comparison, moved[0], shown)


def simulation_sections(
    comparison: Comparison, shown: Sequence[str], maps: Sequence[StimulusMap], above: Collection[str] = ()
) -> list[Section]:
    """Return the sections on the simulation, which do not depend on recordings, without figures titled `above`."""
    tested = [one for one in shape_figures(comparison, shown) if one.title not in above]
    figures = [one for one in simulation_figures(comparison, shown, maps) if one.title not in above]
    return [*shape_sections(comparison, tested), *map(alone, figures)]


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
    """Return the file, shape, processing and SHA-256 of a recording; one row if it belongs to several conditions."""
    found = overlay.recording
    return found.name, overlay.stimulus.shape, ", ".join(found.changes), found.sha256


def fingers_sections(comparison: Comparison) -> list[Section]:
    """Return the section on plausible fingers, if ranges and recordings are available."""
    plausible = comparison.plausible
    if plausible is None or not comparison.overlays:
        return []
    made = (
        f" The responses were {HOW_MADE}; `--exact` builds a full model of each finger."
        if comparison.interpolated
        else ""
    )
    return [
        Section(
            "Plausible fingers",
            (
                f"The ranges come from a file with SHA-256 {plausible.sha256}. {3 ** len(plausible.free)} fingers "
                "of these ranges were simulated, and each pair was fitted with its maximum-likelihood finger "
                "among them. The set and its intervals hold for every finger within the ranges, and for no other."
            )
            + made,
            ("parameter", "lowest", "highest"),
            tuple((name, f"{low:g}", f"{high:g}") for name, (low, high) in plausible.ranges.items()),
        )
    ]


HEADER = ("measure", "x (mm)", "depth (mm)", "offset (mm)", "k", "ε₀", "deviance over the noise", "fit",
          "at a limit")  # fmt: skip


def place_section(found: ReceptorLocation) -> Section:
    """Return the table of every measure at its maximum-likelihood location, best first."""
    x, depth = (f"{in_mm(low)} to {in_mm(high)} mm" for low, high in found.where[:2])
    return Section(
        f"Receptor location: {', '.join(found.stimuli)}",
        "The maximum-likelihood location of each measure, with 95 % limits by profile likelihood. The search "
        f"covered x from {x} and depth from {depth}; {found.frame}. All locations were compared over the same "
        f"{found.positions} of {found.recorded} recorded positions. An interval at a limit of the search may "
        "extend beyond it. The intervals assume this finger model. All other sections use the receptors of "
        "the command, without an offset.",
        HEADER,
        tuple(_cells(row, found) for row in found.rows),
    )


def _cells(row: PlaceRow, found: ReceptorLocation) -> tuple[str, ...]:
    offset = within(row.offset_mm, row.offset_interval) if found.with_offset else "not fitted"
    fit = "not rejected" if row.fits else "rejected"
    return (
        row.measure,
        within(row.x_mm, row.x_interval),
        within(row.depth_mm, row.depth_interval),
        offset,
        as_number(row.k),
        as_number(row.eps0),
        f"{row.deviance:.1f}",
        f"{fit} ({probability(row.p_fit)})",
        ", ".join(row.at_bounds) or "–",
    )
