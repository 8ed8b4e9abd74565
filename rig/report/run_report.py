"""The report of a run: one self-contained HTML file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rig.data import Run
from rig.data.choices import WHY_ENDED, verdict_of
from rig.data.deviation import deviations, warning_of
from rig.data.folder import replace_text
from rig.data.run import read_provenance
from rig.data.spike_files import SpikeRecord, read_spikes
from rig.plan.config import load_config
from rig.plan.finger_file import TISSUE, Draw
from rig.plan.finger_model import PredictedHold, by_group, responses
from rig.plan.finger_update import learned
from rig.plan.plan import PredictionCheck, found
from rig.records import grouped
from rig.report import run_figures, run_tables
from rig.report.choice_figure import choice_figures, choice_rows
from rig.report.nerve_figures import nerve_figures, no_spikes_drawn
from rig.report.page_parts import figures_of, render
from rig.report.page_source import indentors_in_words
from rig.report.plot import Plot
from rig.report.run_figures import (
    PICTURES_A_PAGE,
    contact_panels,
    contacts_from_below,
    is_relief,
    population_responses,
    ssrps,
)
from rig.report.run_tables import Condition, by_target, conditions, numbers_missing, write_numbers
from rig.report.style import signed
from rig_shared.plural import number_of
from rig_shared.user_files import read_text
from sim.models.fingertip import Fingertip

AFTER = "finger_after.toml"
Row = tuple[str, str, str]


@dataclass(frozen=True)
class FingerSection:
    """Section on an identified finger: predicted and measured presses, and parameters before and after the run."""

    sentence: str
    found: list[PredictionCheck]
    learned: list[Row]


def finger_section(run: Run, finger: Fingertip) -> FingerSection | None:
    """Return the section, or None without an identified finger; write `finger_after.toml` after reference presses."""
    pairs = found(run)
    if not pairs:
        return None
    identified = load_config(run.folder.config).identified
    assert identified is not None
    after = learned(run, finger)
    if after is not None:
        replace_text(run.folder.path / AFTER, after.as_toml())
    inside = sum(one.kept for one in pairs)
    sentence = (
        f"Identified on {identified.date[:10]} in {number_of(identified.presses, 'presses')}. {inside} of "
        f"{number_of(len(pairs), 'presses')} in this run lie within the predicted band, whose nominal coverage is "
        f"{100 * identified.band.coverage:.0f} %."
    )
    return FingerSection(sentence, pairs, [] if after is None else _rows(identified.draw, after.identified.draw))


def _rows(before: Sequence[Draw], after: Sequence[Draw]) -> list[Row]:
    return [(name, _mean_and_sd(before, name), _mean_and_sd(after, name)) for name in TISSUE]


def _mean_and_sd(draws: Sequence[Draw], name: str) -> str:
    values = np.array([getattr(draw, name) for draw in draws])
    return f"{values.mean():.3g} ± {values.std(ddof=1):.2g}"


def write_report(
    run: Run,
    finger: Fingertip,
    wall_s: float | None = None,
    ending: Mapping[str, str] | None = None,
    further: Sequence[Plot] = (),
) -> Path:
    """Write report.html and the model's numbers into the run's folder.

    A run without a finished indentation gets its tables only. `ending` describes, by topic, how a run ended early.
    `further` figures come last, such as the strain under the deepest press, which takes longer than all else.
    """
    found = responses(run, finger)
    if found:
        write_numbers(run, found)
    return _write_page(run, finger, found, wall_s, ending, further)


def write_missing(run: Run, finger: Fingertip) -> None:
    """Write the missing parts of report and data; existing files stay unchanged."""
    found = responses(run, finger)
    if found:
        write_numbers(run, found, again=False)
    if not run.folder.report.exists():
        _write_page(run, finger, found, None, None)


def lacks_report(run: Run) -> bool:
    """Return whether the report, or data behind its figures, are missing."""
    return not run.folder.report.exists() or (bool(run.done) and numbers_missing(run))


def _write_page(
    run: Run,
    finger: Fingertip,
    found: list[PredictedHold],
    wall_s: float | None,
    ending: Mapping[str, str] | None,
    further: Sequence[Plot] = (),
) -> Path:
    provenance, spikes = read_provenance(run.folder, "devices"), read_spikes(run.folder)
    text = render(
        "run.html.j2",
        run=run,
        indentors=indentors_in_words([run]),
        message=run_tables.message(run, run_tables.delivered(run)),
        found=run_tables.one_by_one(run, found),
        scheduled=run_tables.scheduled(run),
        conditions=grouped(run_tables.condition_rows(run, found), key=lambda row: row.group),
        figures=[*run_page_figures(run, found, spikes), *further],
        no_spikes_drawn=no_spikes_drawn(run, spikes),
        choices=choice_rows(run),
        verdict=verdict_of(run),
        why_ended=WHY_ENDED,
        small_strain=_small_strain(found),
        deviating=warning_of(beside := deviations(run)),
        beside={one.index: one for one in beside},
        phases=run_tables.phases(run),
        why_approach=run_tables.why_approach(run),
        identified=finger_section(run, finger),
        limits=run_tables.limits(run),
        devices=run_tables.devices(run, provenance),
        provenance=provenance,
        checksums=_checksums(run),
        finger=finger,
        wall_s=wall_s,
        ending=ending,
    )
    replace_text(run.folder.report, text)
    return run.folder.report


def run_page_figures(run: Run, found: list[PredictedHold], spikes: SpikeRecord | None) -> list[Plot]:
    """Return the figures of the page, in its order; spikes: those beside the run."""
    pressed, groups = run_tables.delivered(run), list(by_target(conditions(run)).items())
    over_time = [
        *([run_figures.delivered_presses(pressed, run_tables.message(run, pressed))] if pressed else []),
        *choice_figures(run),
        *([run_figures.force_time(run)] if any(run.stream(stream) for stream in run_tables.SAMPLES) else []),
    ]
    if not found:
        return over_time
    return [
        *over_time,
        *figures_of(groups, run_figures.GROUPS_A_PAGE, lambda part: run_figures.presses(run, dict(part))),
        *figures_of(groups, run_figures.GROUPS_A_PAGE, lambda part: run_figures.force_depth(run, dict(part))),
        *_contact_figures(run, found),
        *_population_figures(found),
        *(nerve_figures(run, spikes) if spikes else ()),
    ]


def _small_strain(found: Sequence[PredictedHold]) -> str:
    """Return the note on small strain for the deepest result; empty without a result."""
    deepest = max((response.result for response in found), key=lambda result: result.doi_mm, default=None)
    return "" if deepest is None else deepest.small_strain.note


def _contact_figures(run: Run, found: list[PredictedHold]) -> list[Plot]:
    last = [response for response in found if response.last]
    top, reliefs = run_figures.highest_pressure(last), [one for one in last if is_relief(one.result.indentor)]
    return [
        *(
            figure
            for name, members in by_target(conditions(run)).items()
            for figure in figures_of(
                _repeats(members, last), run_figures.CONTACTS_A_PAGE, partial(contact_panels, top=top, group=name)
            )
        ),
        *figures_of(
            reliefs,
            PICTURES_A_PAGE,
            lambda part: contacts_from_below([one.result for one in part], [*map(_title, part)]),
        ),
    ]


def _population_figures(found: list[PredictedHold]) -> list[Plot]:
    groups = list(by_group(found).values())
    moved = run_figures.has_moved(found)

    def responses_of(part: Sequence[list[PredictedHold]]) -> Plot:
        return population_responses([one for members in part for one in members], moved=moved)

    populations = figures_of(groups, run_figures.GROUPS_A_PAGE if moved else len(groups), responses_of)
    if not any(len(members) > 1 for members in groups):
        return populations
    return [*populations, ssrps(found, "ep1"), ssrps(found, "sed")]


def _repeats(members: Sequence[Condition], last: Sequence[PredictedHold]) -> list[list[PredictedHold]]:
    """Return the responses to each condition's repeats."""
    by_index = {response.index: response for response in last}
    return [[by_index[index] for index in condition.indices] for condition in members]


def _title(response: PredictedHold) -> str:
    result = response.result
    return f"x = {signed(result.x_mm)} mm, {result.force_gwt:.2f} gwt, DOI {result.doi_mm:.3f} mm"


def _checksums(run: Run) -> list[tuple[str, str]]:
    path: Any = run.folder.path / "SHA256SUMS"
    if not path.exists():
        return []
    pairs = [line.split("  ", 1) for line in read_text(path).splitlines()]
    return [(name, digest) for digest, name in pairs if name != "report.html"]
