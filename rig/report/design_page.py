"""Page of a design: expected confusion against minutes beside usual designs, and the gain of each press."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure as Canvas

from rig.data.folder import replace_text
from rig.design.confusion import Confusion, share_and_error
from rig.design.design import BOUND_MIN, Design
from rig.design.design_text import (
    FAILS,
    about_the_design,
    bound_name,
    headline,
    history_line,
    percent,
    quick_line,
    separation_line,
)
from rig.design.power import PowerRow
from rig.report.page_parts import PageFigure, Section, alone, render
from rig.report.page_source import source_line
from rig.report.style import BLUE, DOTTED, GREEN, GREY, ORANGE, PURPLE, Plot, as_number, shade, signed
from rig.report.title_lines import title_lines
from rig_shared.plural import number_of

_COLORS = (BLUE, ORANGE, GREEN, PURPLE)
_MAPS_ACROSS, _ONCE_PT = 3, 8.0
_SESSION = ListedColormap([shade(k, 64) for k in range(64)])
_MOST_NAMED = 9  # candidates whose cells have numbers


@dataclass(frozen=True)
class DesignPage:
    """Content of the page: the design, its script and rehearsed duration, sample sizes, and the command."""

    design: Design
    script: str
    duration_s: float
    power: Sequence[PowerRow]
    command: str


def write_design_page(path: Path, page: DesignPage) -> None:
    """Write one self-contained page. Raises OSError."""
    found = page.design
    request = found.request
    sections = [
        Section("The design", headline(found), figures=(_map(found),)),
        Section(
            "The presses",
            f"{about_the_design(found)} Each row is one of the presses that differ. The session takes "
            f"{page.duration_s:.0f} s, {request.change_s:g} s for each change of indentor included. An experiment "
            f"fails if {FAILS}.",
            ("shape", "x (mm)", _target(found), "repeats", "one more would add (bits)"),
            _press_rows(found),
        ),
        *([Section("What a quick design gives up", quick_line(found) or "")] if request.quick else []),
        *figure_sections(page),
        Section(
            "Beside other designs",
            "Failures, and how often the truth is in the set, with the Monte Carlo error of the simulation. The last "
            f"row has {bound_name(found)} in {BOUND_MIN:g} minutes: no design of this bench can do much better.",
            ("design", "minutes", "presses", "failures", "truth in the set", "most probable is the truth"),
            (*map(_outcome_row, found.outcomes), (bound_name(found), *_outcome_row(found.bound)[1:])),
        ),
        _pairs(found),
        *([_power(page.power)] if page.power else []),
        Section("Order and history", history_line(found)),
        _assumptions(found, page.command),
    ]
    title = f"Presses to distinguish {len(request.candidates)} candidates"
    source = source_line([], "no run: experiments simulated on a virtual finger")
    replace_text(path, render("identification.html.j2", title=title, about=source, sections=sections))


def figure_sections(page: DesignPage) -> list[Section]:
    """Return the figures with their headings."""
    found = page.design
    figures = [PageFigure("Expected confusion", confusion(found.outcome), _CONFUSION)]
    if len(found.durations) > 1:
        figures.insert(0, PageFigure("Failures against minutes", curves(found), _CURVES))
    figures.append(PageFigure("What each group of presses adds", growth(found), _GROWTH))
    return [alone(one) for one in figures]


def _map(found: Design) -> PageFigure:
    made = found.presses
    unused = [one for one in found.request.shapes if one not in {press.shape for press in made}]
    left_out = f" Not used: {', '.join(unused)}." if unused else ""
    return PageFigure(
        "The design",
        press_map(found),
        "Where each indentor is pressed, one panel per block, in the order of the session. Color: when in the "
        "session, the mean over repeats. The area of a circle and the number in it: repeats. Small dots: possible "
        f"presses that were not chosen.{left_out}",
        message=headline(found),
    )


def press_map(found: Design) -> Plot:
    """Plot position against depth or force of the presses of each block, with their repeats."""
    presses, order = found.table.presses, found.made.order.tolist()
    shapes = list(dict.fromkeys(presses[k].shape for k in order))
    columns = min(len(shapes), _MAPS_ACROSS)
    down = -(-len(shapes) // columns)

    def draw(figure: Canvas) -> None:
        grid = figure.subplots(down, columns, squeeze=False, sharex=True, sharey=True)
        scale = Normalize(1, max(len(order), 2))
        for axes in list(grid.flat)[len(shapes) :]:
            axes.set_axis_off()
        for number, (axes, shape) in enumerate(zip(grid.flat, shapes, strict=False), 1):
            mine = [k for k in order if presses[k].shape == shape]
            rest = [p for k, p in enumerate(presses) if p.shape == shape and k not in set(mine)]
            axes.plot([p.x_mm for p in rest], [p.target for p in rest], ".", color=GREY, ms=3)
            different = list(dict.fromkeys(mine))
            times = [mine.count(k) for k in different]
            at = [(presses[k].x_mm, presses[k].target) for k in different]
            when = [float(np.mean([n for n, one in enumerate(order, 1) if one == k])) for k in different]
            shown = axes.scatter(
                *np.transpose(at), s=_ONCE_PT**2 * np.array(times), c=when, cmap=_SESSION, norm=scale,
                edgecolors=GREY, linewidths=0.5, zorder=2,
            )  # fmt: skip
            for place, count in zip(at, times, strict=True):
                if count > 1:
                    axes.annotate(f"{count}", place, ha="center", va="center", fontsize=7, color="white")
            about = f"{number}. {shape}: {number_of(len(mine), 'presses')}"
            axes.set_title(title_lines(about, 9.0 / columns - 0.4, 9), fontsize=9)
            axes.set_xlabel("indentor x (mm)")
        if presses[0].kind == "doi_mm":
            grid[0, 0].invert_yaxis()
        for axes in grid[:, 0]:
            axes.set_ylabel(_target(found))
        figure.colorbar(shown, ax=grid.ravel().tolist(), label="number in the session (1)", pad=0.02)

    return Plot((10.2 if columns > 1 else 6.4, 0.3 + 3.0 * down), draw)


_CURVES = (
    "Share of simulated experiments that fail, and that have the truth in their set, with one standard error of the "
    "simulation. Dotted: 90 %."
)
_CONFUSION = (
    "Share of experiments in which the column is the most probable candidate, when the row is true. Every row has as "
    "many experiments. Empty cells: less than 0.5 %."
)
_GROWTH = (
    "Information about the candidate as the design grew, before presses were exchanged, on the simulated data that "
    "it was chosen with. The dashed line is complete knowledge. It may fall by the error of its simulation."
)


def curves(found: Design) -> Plot:
    """Plot failures and coverage of every design against minutes."""

    def draw(figure: Canvas) -> None:
        left, right = figure.subplots(1, 2)
        for color, name in zip(_COLORS, found.names, strict=False):
            mine = [found.at(name, minutes) for minutes in found.durations if _has(found, name, minutes)]
            minutes = [one.minutes for one in mine]
            for axes, kind in ((left, "failed"), (right, "kept")):
                share, error = np.array([share_and_error(getattr(one, kind)) for one in mine]).T
                axes.errorbar(minutes, 100 * share, 100 * error, color=color, marker="o", ms=4, lw=1, label=name)
        left.set_ylabel("failures (%)")
        right.set_ylabel("truth in the set (%)")
        right.axhline(90, color=GREY, lw=0.8, ls=DOTTED)
        right.set_ylim(None, 101)
        left.set_ylim(-1, None)
        for axes in (left, right):
            axes.set_xscale("log")
            axes.set_xticks(found.durations, [f"{m:g}" for m in found.durations])
            axes.minorticks_off()
            axes.set_xlabel("session (min)")
        left.legend()

    return Plot((10.2, 3.6), draw)


def _has(found: Design, name: str, minutes: float) -> bool:
    return any(one.name == name and one.minutes == minutes for one in found.outcomes)


def confusion(outcome: Confusion) -> Plot:
    """Plot the confusion matrix."""
    n = len(outcome.candidates)
    side = max(3.2, 0.32 * n + 1.4)

    def draw(figure: Canvas) -> None:
        axes = figure.subplots()
        shown = axes.imshow(100 * outcome.matrix, vmin=0, vmax=100, cmap="Blues")
        axes.set_xticks(range(n), outcome.candidates, rotation=60, ha="right")
        axes.set_yticks(range(n), outcome.candidates)
        axes.set_xlabel("most probable candidate (1)")
        axes.set_ylabel("true candidate (1)")
        for row in range(n):
            for column in range(n):
                share = 100 * outcome.matrix[row, column]
                if share >= 0.5 and (n <= _MOST_NAMED or row != column):
                    text = f"{share:.0f}" + (f" ± {100 * outcome.error[row, column]:.0f}" if n <= _MOST_NAMED else "")
                    axes.text(
                        column,
                        row,
                        text,
                        ha="center",
                        va="center",
                        fontsize=7,
                        color="white" if share > 60 else "black",
                    )
        figure.colorbar(shown, ax=axes, label="experiments (%)", shrink=0.8)

    return Plot((side + 1.4, side), draw)


def growth(found: Design) -> Plot:
    """Plot information against the number of presses, as the design grew."""
    steps = found.chosen.steps
    number = np.cumsum([len(step.presses) for step in steps])

    def draw(figure: Canvas) -> None:
        axes = figure.subplots()
        axes.plot([0, *number], [0.0, *(step.bits for step in steps)], "o-", color=BLUE, ms=3, lw=1)
        axes.axhline(np.log2(len(found.request.candidates)), color=GREY, lw=0.8, ls="--")
        axes.set_xlabel("number of presses (1)")
        axes.set_ylabel("information (bits)")
        axes.set_ylim(0, None)

    return Plot((6.4, 3.2), draw)


def _target(found: Design) -> str:
    return {"doi_mm": "depth (mm)", "force_gwt": "force (gwt)"}[found.table.presses[0].kind]


def _press_rows(found: Design) -> tuple[tuple[str, ...], ...]:
    rows = []
    made = found.made.order.tolist()
    shapes = list(dict.fromkeys(found.table.presses[k].shape for k in made))
    for k in sorted(
        set(made), key=lambda one: (shapes.index(found.table.presses[one].shape), found.table.presses[one])
    ):
        press = found.table.presses[k]
        rows.append(
            (
                press.shape,
                signed(press.x_mm),
                as_number(press.target),
                str(made.count(k)),
                as_number(max(float(found.chosen.added_bits[k]), 0.0), 2),
            )
        )
    return tuple(rows)


def _outcome_row(one: Confusion) -> tuple[str, ...]:
    shares = (percent(*share_and_error(flags)) for flags in (one.failed, one.kept, one.right))
    return (one.name, f"{one.minutes:g}", str(one.presses), *shares)


def _pairs(found: Design) -> Section:
    rows = tuple((a, b, f"{100 * share:.0f} %") for a, b, share in found.bound.not_separated())
    return Section(
        "Pairs that this bench cannot separate",
        f"{separation_line(found)} A pair is separated if the choice between the two is right in 80 % of "
        "experiments.",
        ("one", "other", "right choices"),
        rows,
    )


def _power(rows: Sequence[PowerRow]) -> Section:
    return Section(
        "Sample sizes",
        "Share of experiments whose 95 % set has the truth and at most one other candidate, and the truth alone. The "
        "fibers of an experiment share the candidate and nothing else. Repeats are the mean number of times "
        "that a press is made.",
        ("minutes per fiber", "presses per fiber", "repeats", "fibers", "truth and at most one other", "truth alone"),
        tuple(
            (
                f"{row.minutes:g}",
                str(row.presses),
                f"{row.repeats:.1f}",
                str(row.fibers),
                percent(row.few, row.few_error),
                percent(row.one, row.one_error),
            )
            for row in rows
        ),
    )


def _assumptions(found: Design, command: str) -> Section:
    u = found.request.unknowns
    least = np.quantile(found.outcome.effective, 0.1)
    points = (
        "A fiber fires at R = max(0, k(ε − ε₀)). Its rate at the strongest press on this bench is "
        f"{_between(u.rate_per_s)} spikes/s, and ε₀ is {_between(u.threshold)} of ε there.",
        f"The receptor lies at x = {_between(u.x_mm)} mm from the center of the pad, {_between(u.below_mm)} mm below "
        "the epidermis, in the receptor plane.",
        f"Counts in {found.request.hold_s:g} s have {_between(u.dispersion)} times the variance of Poisson's. The "
        f"gain drifts by a standard deviation of {100 * u.drift:.0f} % in ten minutes.",
        f"{number_of(found.fingers, 'fingers')}: "
        + (
            "interpolated quadratically between them." if found.fingers > 1 else "the configured one is the true one."
        ),
        "Shear strains may have either sign. The rate rises with every other measure, in the sign of its plots.",
        "All candidates are equally probable beforehand, and one of them is true.",
        f"The evidence of a candidate is a mean over draws of fibers, of which {as_number(float(least), 2)} count "
        "effectively in nine of ten experiments. Where too few did, they were refined.",
    )
    return Section("Assumptions", f"This command makes the same design: `{command}`", points=points)


def _between(ends: tuple[float, float]) -> str:
    low, high = (as_number(one) for one in ends)
    return low if low == high else f"{low} to {high}"
