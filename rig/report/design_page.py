"""Page of a design: expected confusion against minutes beside usual designs, and the gain of each press."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

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
from rig.report.page_parts import Section, alone, render
from rig.report.page_source import shapes_in_words, source_line
from rig.report.plot import Plot, Series, Subplot, guide, in_grid, rows_of
from rig.report.style import BLUE, DOTTED, GREEN, GREY, ORANGE, PURPLE, as_number, shade, signed
from rig.report.title_lines import title_lines
from rig_shared.plural import number_of

_COLORS = (BLUE, ORANGE, GREEN, PURPLE)
_MAPS_ACROSS, _ONCE_PT = 3, 8.0
_RIM = "#8a8a8a"  # seen on light and on dark pages, since the colors of a scale are the same on both
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
        Section("The design", headline(found), figures=(press_map(found),)),
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
    pressed = shapes_in_words((one, one) for one in request.shapes)
    source = source_line([], f"no run: experiments simulated on a virtual finger with {pressed}")
    replace_text(path, render("identification.html.j2", title=title, about=source, sections=sections))


def figure_sections(page: DesignPage) -> list[Section]:
    """Return the figures with their headings."""
    found = page.design
    against_minutes = [curves(found)] if len(found.durations) > 1 else []
    return [alone(one) for one in (*against_minutes, confusion(found.outcome), growth(found))]


def press_map(found: Design) -> Plot:
    """Plot position against depth or force of the presses of each block, with their repeats."""
    presses, order = found.table.presses, found.made.order.tolist()
    shapes = list(dict.fromkeys(presses[k].shape for k in order))
    columns = min(len(shapes), _MAPS_ACROSS)
    down = -(-len(shapes) // columns)
    scale = Normalize(1, max(len(order), 2))
    repeats: list[list[tuple[tuple[float, float], int]]] = []
    panels = []
    for number, shape in enumerate(shapes, 1):
        mine = [k for k in order if presses[k].shape == shape]
        rest = [p for k, p in enumerate(presses) if p.shape == shape and k not in set(mine)]
        times = {k: mine.count(k) for k in mine}
        at = [(presses[k].x_mm, presses[k].target) for k in times]
        when = [float(np.mean([n for n, one in enumerate(order, 1) if one == k])) for k in times]
        repeats.append(list(zip(at, times.values(), strict=True)))
        series = [
            Series("plot", [p.x_mm for p in rest], [p.target for p in rest], ls="", marker=".", color=GREY, ms=3,
                   rows=rows_of("not chosen", "x_mm", "target", shape=shape)),
            Series("scatter", *np.transpose(at), _ONCE_PT**2 * np.array(list(times.values())), when, cmap=_SESSION,
                   norm=scale, edgecolors=_RIM, linewidths=0.8, zorder=2,
                   rows=rows_of("session", "x_mm", "target", "area", "number", shape=shape)),
        ]  # fmt: skip
        about = f"{number}. {shape}: {number_of(len(mine), 'presses')}"
        title, printed = title_lines(about, 9.0 / columns - 0.4, 9), "xy" if number % columns == 1 % columns else "x"
        panels.append(Subplot(_X, _target(found), series, title, printed, color="number in the session (1)"))

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for one, mine in zip(axes, repeats, strict=True):
            for place, count in mine:
                if count > 1:
                    one.annotate(f"{count}", place, ha="center", va="center", fontsize=7, color="white")
        if presses[0].kind == "doi_mm":
            axes[0].invert_yaxis()
        figure.colorbar(axes[-1].collections[0], ax=figure.axes, label=panels[0].color, pad=0.02)

    unused = [one for one in found.request.shapes if one not in {press.shape for press in found.presses}]
    left_out = f" Not used: {', '.join(unused)}." if unused else ""
    return Plot(
        (10.2 if columns > 1 else 6.4, 0.3 + 3.0 * down), panels,
        "The design",
        "Where each indentor is pressed, one panel per block, in the order of the session. Color: when in the "
        "session, the mean over repeats. The area of a circle and the number in it: repeats. Small dots: possible "
        f"presses that were not chosen.{left_out}",
        headline(found), arrange=in_grid(len(panels), columns, sharex=True, sharey=True), finish=finish,
        titles={"fontsize": 9},
    )  # fmt: skip


_X = "indentor x (mm)"


def curves(found: Design) -> Plot:
    """Plot failures and coverage of every design against minutes."""

    def lines(kind: str) -> list[Series]:
        series = []
        for color, name in zip(_COLORS, found.names, strict=False):
            mine = [found.at(name, minutes) for minutes in found.durations if _has(found, name, minutes)]
            share, error = np.array([share_and_error(getattr(one, kind)) for one in mine]).T
            series.append(
                Series("errorbar", [one.minutes for one in mine], 100 * share, 100 * error, color=color, marker="o",
                       ms=4, lw=1, label=name, rows=rows_of("outcomes", "minutes", kind, f"{kind} sd", design=name))
            )  # fmt: skip
        return series

    def finish(figure: Figure, axes: list[Axes]) -> None:
        left, right = axes
        right.set_ylim(None, 101)
        left.set_ylim(-1, None)
        for one in axes:
            one.set_xscale("log")
            one.set_xticks(found.durations, [f"{m:g}" for m in found.durations])
            one.minorticks_off()
        left.legend()

    level = guide("axhline", 90, color=GREY, lw=0.8, ls=DOTTED)
    return Plot(
        (10.2, 3.6),
        [
            Subplot("session (min)", "failures (%)", lines("failed")),
            Subplot("session (min)", "truth in the set (%)", [*lines("kept"), level]),
        ],
        "Failures against minutes",
        "Share of simulated experiments that fail, and that have the truth in their set, with one standard error of "
        "the simulation. Dotted: 90 %.",
        arrange=in_grid(2, 2), finish=finish,
    )  # fmt: skip


def _has(found: Design, name: str, minutes: float) -> bool:
    return any(one.name == name and one.minutes == minutes for one in found.outcomes)


def confusion(outcome: Confusion) -> Plot:
    """Plot the confusion matrix."""
    names, n = outcome.candidates, len(outcome.candidates)
    side = max(3.2, 0.32 * n + 1.4)
    image = Series("imshow", 100 * outcome.matrix, vmin=0, vmax=100, cmap="Blues", rows=rows_of("confusion", "share"))
    panel = Subplot(
        "most probable candidate (1)", "true candidate (1)", [image], x_names=names, y_names=names, color=_SHARE
    )

    def finish(figure: Figure, panels: list[Axes]) -> None:
        (axes,) = panels
        axes.set_xticks(range(n), names, rotation=60, ha="right")
        axes.set_yticks(range(n), names)
        for row, column in np.argwhere(100 * outcome.matrix >= 0.5).tolist():
            share, error = 100 * outcome.matrix[row, column], 100 * outcome.error[row, column]
            if n <= _MOST_NAMED or row != column:
                text = f"{share:.0f}" + (f" ± {error:.0f}" if n <= _MOST_NAMED else "")
                color = "white" if share > 60 else "black"
                axes.text(column, row, text, ha="center", va="center", fontsize=7, color=color)
        figure.colorbar(axes.images[0], ax=axes, label=_SHARE, shrink=0.8)

    return Plot(
        (side + 1.4, side), [panel],
        "Expected confusion",
        "Share of experiments in which the column is the most probable candidate, when the row is true. Every row "
        "has as many experiments. Empty cells: less than 0.5 %.",
        finish=finish,
    )  # fmt: skip


_SHARE = "experiments (%)"


def growth(found: Design) -> Plot:
    """Plot information against the number of presses, as the design grew."""
    number = np.cumsum([0, *(len(step.presses) for step in found.chosen.steps)])
    bits = [0.0, *(step.bits for step in found.chosen.steps)]
    line = Series(
        "plot", number, bits, ls="-", marker="o", color=BLUE, ms=3, lw=1, rows=rows_of("steps", "presses", "bits")
    )
    complete = guide("axhline", np.log2(len(found.request.candidates)), color=GREY, lw=0.8, ls="--")
    return Plot(
        (6.4, 3.2), [Subplot("number of presses (1)", "information (bits)", [line, complete])],
        "What each group of presses adds",
        "Information about the candidate as the design grew, before presses were exchanged, on the simulated data "
        "that it was chosen with. The dashed line is complete knowledge. It may fall by the error of its simulation.",
        finish=lambda figure, axes: axes[0].set_ylim(0, None),
    )  # fmt: skip


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
