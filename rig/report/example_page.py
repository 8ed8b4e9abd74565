"""Sections of the example's page: verdict on both phases, candidates, profiles, and sensitivity."""

import csv
from collections.abc import Sequence
from importlib.resources import files
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rig.compare.example import (
    PHASES,
    RELAXATION,
    PhaseCandidate,
    PhaseVerdict,
    Rehearsal,
    judge_phase,
    positions,
    recorded,
    rehearse,
)
from rig.compare.fit import fit_rates, predicted
from rig.compare.verdict_text import percent, probability
from rig.report.measure_colors import color_of
from rig.report.page_parts import Section
from rig.report.plot import Plot, Series, Subplot, guide, in_grid, rows_of
from rig.report.style import GREY, as_number
from sim.models.fingertip import Fingertip

HEADER = (
    "candidate", "r", "held-out deviance predicted [95 %]", "p of the fit", "p in the set", "in the set",
)  # fmt: skip
_ROWS, _NAMED = 12, 6
DRY_RUN = "rig dry-run bars --set increments=1 from_mm=5.1 to_mm=-5.05"
"""Command that presses the range of the rehearsal on the virtual bench."""

SENSITIVITY = files("rig.compare") / "data" / "bar3_sensitivity.csv"
"""Sensitivity of both phases to the assumptions, as the study `bar3-sensitivity` measured it."""


class Level(NamedTuple):
    """Row of the table of sensitivity: a level of an axis, and the leading measure there."""

    axis: str
    level: str
    phase: str
    leader: str
    held_out: str
    second: str
    second_held_out: str
    sed_r: str


def read_levels() -> list[Level]:
    """Return the stored levels; none if the study was never run."""
    if not SENSITIVITY.is_file():
        return []
    lines = SENSITIVITY.read_text(encoding="utf-8").splitlines()
    return [Level(*row) for row in list(csv.reader(lines))[1:]]


def moved_axes(levels: Sequence[Level], phase: str) -> list[str]:
    """Return the axes on which another measure leads than with the defaults."""
    mine = [one for one in levels if one.phase == phase]
    usual = next((measure(one.leader) for one in mine if one.axis == "defaults"), None)
    return list(dict.fromkeys(one.axis for one in mine if measure(one.leader) != usual))


def measure(candidate: str) -> str:
    """Return the name of a candidate without its receptor."""
    return candidate.partition(" at ")[0]


def lead_sentences(verdicts: Sequence[PhaseVerdict], levels: Sequence[Level]) -> tuple[str, str, str]:
    """Return the verdict, the measures that cannot be distinguished, and the assumptions that matter."""
    first, second = ("; ".join(map(said, verdicts)) for said in (_verdict, _together))
    return f"{first[0].upper()}{first[1:]}.", f"{second[0].upper()}{second[1:]}.", _depends(levels)


def _verdict(one: PhaseVerdict) -> str:
    best = one.best
    share = f"{percent(best.held_out)} [{percent(best.interval[0])}, {percent(best.interval[1])}]"
    if best.in_set:
        kept = [titled(row) for row in undecided(one) if not row.control]
        return (
            f"the {one.phase} response is explained by {' or '.join(kept)}, of which {kept[0]} predicts {share} of "
            "the held-out deviance"
            if len(kept) > 1
            else f"{kept[0]} explains the {one.phase} response and predicts {share} of its held-out deviance"
        )
    return (
        f"no candidate explains the {one.phase} response within its noise: {titled(best)} predicts {share} of the "
        f"held-out deviance, but its fit is rejected ({probability(best.p_fit)})"
    )


def titled(row: PhaseCandidate) -> str:
    """Return the title with the abbreviation of SED in capitals."""
    return row.title.replace("sed", "SED")


def undecided(one: PhaseVerdict) -> list[PhaseCandidate]:
    """Return the best receptor of each candidate that the recording does not separate from the best one."""
    rows: dict[str, PhaseCandidate] = {}
    for row in one.rows:
        together = row.in_set if one.best.in_set else row.held_out >= one.best.interval[0]
        if together:
            rows.setdefault(row.name, row)
    return list(rows.values())


def _together(one: PhaseVerdict) -> str:
    rows = undecided(one)
    if len(rows) < 2:
        return f"in the {one.phase} phase, no other candidate is as good"
    names = [titled(row) + " (a control)" * row.control for row in rows]
    if len(names) > _NAMED + 1:
        names = [*names[:_NAMED], f"{len(names) - _NAMED} more"]
    return f"in the {one.phase} phase, {', '.join(names[:-1])} and {names[-1]} cannot be distinguished"


def _depends(levels: Sequence[Level]) -> str:
    if not levels:
        return "What it depends on was not measured."
    said = []
    for phase in dict.fromkeys(one.phase for one in levels):
        axes = moved_axes(levels, phase)
        usual = next(measure(one.leader) for one in levels if one.phase == phase and one.axis == "defaults")
        usual = usual.replace("sed", "SED")
        if axes:
            said.append(f"{usual} is not settled for the {phase} phase: another measure leads with {', '.join(axes)}")
        else:
            said.append(f"{usual} leads the {phase} phase at every level that was varied")
    return f"It depends on what the simulation assumes: {'; '.join(said)}."


def example_sections(rehearsal: Rehearsal, verdicts: Sequence[PhaseVerdict]) -> list[Section]:
    """Return the sections that open the page."""
    levels = read_levels()
    first, undecided, depends = lead_sentences(verdicts, levels)
    return [
        Section("The recording under the 3 mm bar", first, figures=(profiles(rehearsal, verdicts),)),
        Section("What is open, and what it depends on", f"{undecided} {depends}", points=_about(rehearsal, verdicts)),
        *(_phase(one) for one in verdicts),
        *_sensitivity(levels),
    ]


def _about(rehearsal: Rehearsal, verdicts: Sequence[PhaseVerdict]) -> tuple[str, ...]:
    static, dynamic = verdicts
    series = ", ".join(f"{share:g} with {tau:g} s" for share, tau in RELAXATION)
    x = rehearsal.stimulus.x_mm
    return (
        f"SED at receptor 0 correlates r = {as_number(static.sed_r, 2)} with the static and r = "
        f"{as_number(dynamic.sed_r, 2)} with the dynamic rates, over all {static.recorded} positions.",
        f"{static.recorded - static.positions} of {static.recorded} positions are left out of the verdict, because "
        f"receptors at ± 2 mm would need the bar beyond {as_number(float(x.max()))} and {as_number(float(x.min()))} "
        "mm, where contact reaches the edge of the finger model's patch; the recorded rates there are 0.",
        "The recording has one value per position and no repeats, so its noise ceiling is unknown. The best monotone "
        f"function of any candidate predicts {percent(static.bound)} (static) and {percent(dynamic.bound)} "
        "(dynamic) of the held-out variance.",
        f"Dynamic phase: one continuous ramp to 1 mm at {rehearsal.speed_mm_s:g} mm/s (the source of the numbers "
        f"states no speed), in tissue that relaxes ({series}). A press made of 0.05 mm increments, as a stage makes "
        "it, is another stimulus.",
        "One typical afferent of a monkey, read from a printed figure (0.05 mm, 3 impulses/s). Nothing was tuned to "
        "these numbers: finger, receptors, rate model and relaxation are the defaults of this program.",
        f"`{DRY_RUN}` presses the same range through the virtual devices; `rig compare` takes that run.",
    )


def _phase(one: PhaseVerdict) -> Section:
    best: dict[str, PhaseCandidate] = {}
    for row in one.rows:
        best.setdefault(row.name, row)
    what = (
        "Candidates are the 18 measures at the end of the ramp."
        if one.phase == "static"
        else "Candidates are the 18 measures, and the mean magnitude and the peak of their rates of change."
    )
    return Section(
        f"Candidates, {one.phase} phase",
        f"{what} Each is at the receptor where it predicts most, most first, over {one.positions} positions. "
        "Intervals: 95 % over draws of blocks of three neighboring positions.",
        HEADER,
        tuple(_cells(row) for row in list(best.values())[:_ROWS]),
    )


def _cells(row: PhaseCandidate) -> tuple[str, ...]:
    low, high = (percent(share) for share in row.interval)
    return (
        f"{row.title} (control)" if row.control else row.title,
        as_number(row.r if np.isfinite(row.r) else None, 2),
        f"{percent(row.held_out)} [{low}, {high}]",
        *(probability(p).removeprefix("p ").removeprefix("= ") for p in (row.p_fit, row.p_set)),
        "yes" if row.in_set else "no",
    )


def _sensitivity(levels: Sequence[Level]) -> list[Section]:
    if not levels:
        return []
    settled = {phase: not moved_axes(levels, phase) for phase in dict.fromkeys(one.phase for one in levels)}
    rows = [tuple(one) for one in levels]
    said = ", ".join(f"{phase}: {'yes' if yes else 'no'}" for phase, yes in settled.items())
    return [
        Section(
            "Sensitivity of the verdict",
            "The measure that predicts most of the held-out deviance, and the second, at each level of each axis. A "
            f"measure is settled only if it leads at every level of every axis. Settled: {said}. A bar that slides "
            "from position to position has no ramp and is judged in the static phase alone. Values are stored; "
            "the study `bar3-sensitivity` measured them.",
            ("axis", "level", "phase", "leads", "predicts", "second", "predicts", "r of SED at 0"),
            tuple(rows),
        )
    ]


def profiles(rehearsal: Rehearsal, verdicts: Sequence[PhaseVerdict]) -> Plot:
    """Plot recorded and predicted rates of both phases."""

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for one in axes:
            low, high = one.get_ylim()
            one.set_ylim(low, high + 0.45 * (high - low))
            one.legend(fontsize=7.5, frameon=False, loc="upper center")

    return Plot(
        (8.4, 3.3),
        [
            Subplot(
                "position of the bar from the field center (mm)",
                "discharge rate (impulses/s)",
                _rates(rehearsal, one),
                f"{one.phase} phase", printed="xy" if one is verdicts[0] else "x",
            )
            for one in verdicts
        ],
        "Recorded and predicted rates under the 3 mm bar",
        "Dots: recorded rates of one SA-I afferent (Phillips and Johnson 1981). Lines: the candidate that predicts "
        "most of the held-out deviance, that of another measure, and that of a control, each with its own k and ε₀ "
        "and with the share that it predicts. The verdict below ranks by likelihood instead.",
        arrange=in_grid(len(verdicts), len(verdicts)), finish=finish, titles={"fontsize": 9}, labels={"fontsize": 8},
        ticks={"labelsize": 8},
    )  # fmt: skip


def plot_example(figure: Figure) -> None:
    """Plot the rates of both phases, recorded and predicted on the default finger."""
    rehearsal = rehearse(Fingertip.load().keeping_ways(), positions())
    profiles(rehearsal, [judge_phase(rehearsal, recorded(phase), phase) for phase in PHASES]).draw(figure)


def _of(row: PhaseCandidate) -> str:
    """Return the measure of a candidate, which may be its rate of change."""
    return row.name.rpartition(" rate of ")[2]


def _rates(rehearsal: Rehearsal, one: PhaseVerdict) -> list[Series]:
    recording = recorded(one.phase)
    others = next((row for row in one.rows if not row.control and _of(row) != _of(one.best)), None)
    control = next((row for row in one.rows if row.control), None)
    fine = np.linspace(recording.position_mm[0], recording.position_mm[-1], 281)
    series = []
    for row, style in ((control, ":"), (others, "--"), (one.best, "-")):
        if row is None:
            continue
        names, at = rehearsal.at(recording.position_mm)
        _, between = rehearsal.at(fine)
        receptor = int(np.argmin(np.abs(rehearsal.stimulus.receptor_mm - (row.receptor_mm or 0.0))))
        eps, known = (values[names.index(row.name), :, receptor] for values in (at, between))
        here = np.isfinite(eps)
        fit = fit_rates(eps[here], recording.rate[here])
        about = f"{titled(row)}{' (control)' * row.control}: {percent(row.held_out)}"
        shown = rows_of("example", "position_mm", "predicted", phase=one.phase, row=row)
        line = predicted(fit, known)
        series.append(Series("plot", fine, line, rows=shown, ls=style, color=color_of(row.name), lw=1.5, label=about))
    shown = rows_of("example", "position_mm", "rate", phase=one.phase)
    dots = {"ls": "", "marker": "o", "ms": 3.5, "color": "black", "label": "recorded"}
    points = Series("plot", recording.position_mm, recording.rate, rows=shown, **dots)
    return [*series, points, guide("axhline", 0, color=GREY, lw=0.5)]
