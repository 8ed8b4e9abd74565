"""Figures of the verdict on one afferent: recorded and predicted rates, residuals, and the misfit of each pair."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter
from numpy.typing import NDArray

from rig.compare.stimuli import CONTROL_UNITS
from rig.compare.verdict import AfferentVerdict, LeftOut, PairRow
from rig.compare.verdict_text import percent, sentence
from rig.report.measure_colors import color_of
from rig.report.plot import Plot, Room, Series, Subplot, entry, guide, handles, in_grid, rows_of
from rig.report.style import DOTTED, GREY, as_number, in_unit, label, rate_label, shade, signed, some_of
from rig.report.title_lines import title_lines
from sim.measures.measures import MEASURES

Array = NDArray[np.float64]
Places = NDArray[np.int64]

STIMULI_FIRST, STIMULI_ACROSS = 4, 3
_WIDE_IN, _PROFILES_IN, _LEAST_MAP_IN = 7.8, 2.55, 2.7
_RANKED, _CONTROLS_RANKED = 7, 3
_POSITION = "position from field center (mm)"
_MISFIT = "misfit over noise, lack-of-fit F (1)"
_RESIDUAL = "recorded − predicted\n(standard deviations)"
_LINES: tuple[tuple[str, float], ...] = (("-", 1.6), ("--", 1.3), (":", 1.5))
"""Dashes and widths of the superimposed pairs, in their order; the color is that of the measure."""
_MOST_RECEPTORS = 14
_CURVE_POINTS = 101
_LONG = 24  # characters of a name in a legend of several columns
_FRAME_POINTS = 7
_LINE_IN = 0.12
_ROOM = Room(left=0.75, right=0.1, bottom=0.42, top=0.55, columns=0.12, rows=0.42)
USUAL = 2.0  # standard deviations
_MARKERS = "os^DvP"


def plotted_pairs(answer: AfferentVerdict) -> list[PairRow]:
    """Return the maximum-likelihood pair, and those of another measure and of a control."""
    first = answer.headline or answer.closest
    found = (first, rival(answer), next(iter(answer.controls), None))
    return [row for row in found if row is not None]


def rival(answer: AfferentVerdict) -> PairRow | None:
    """Return the maximum-likelihood pair of another measure than the first, from the set if possible."""
    first = answer.headline or answer.closest
    others = [row for row in answer.measures if row.name != first.name]
    return next((row for row in others if row.in_set), next(iter(others), None))


def apart(answer: AfferentVerdict) -> Array | None:
    """Return (p,) differences in rate of the best pair and its rival, in standard errors; None without a rival."""
    first, other = answer.headline or answer.closest, rival(answer)
    if other is None:
        return None
    return np.abs(first.predicted - other.predicted) / answer.places.error


def _rate(answer: AfferentVerdict) -> str:
    return rate_label(answer.rate_unit).replace(" (", "\n(")


def most_telling(answer: AfferentVerdict) -> list[int]:
    """Return the stimuli that fit into a figure, in order: those for which rivals differ most."""
    numbers = list(range(len(answer.stimuli)))
    found = apart(answer)
    if found is None or len(numbers) <= STIMULI_FIRST:
        return numbers
    separation = [float(np.nansum(found[of_stimulus(answer, number)] ** 2)) for number in numbers]
    return sorted(sorted(numbers, key=lambda number: -separation[number])[:STIMULI_FIRST])


def the_answer(answer: AfferentVerdict, shown: Sequence[int], frame: str, of: str = "") -> Plot:
    """Plot recorded rates of some stimuli with the predictions, above the misfit of the best pairs."""
    pairs, ranked = list(zip(plotted_pairs(answer), _LINES, strict=False)), ranking(answer)
    styles = [(row, {"color": color_of(row.name), "ls": dashes, "lw": width}) for row, (dashes, width) in pairs]
    heights = (_PROFILES_IN, 0.95 + 0.19 * len(ranked))
    panels = [
        Subplot(_POSITION, _rate(answer),
              [*_recorded(answer, number), *(_predicted(answer, number, row, **style) for row, style in styles)],
              title_lines(answer.stimuli[number], (_WIDE_IN - 1) / len(shown), 8), printed="" if k else "y")
        for k, number in enumerate(shown)
    ]  # fmt: skip
    recorded = entry("recorded, ± standard error", color="black", marker="o", ms=3, ls="")
    above = [recorded, *(entry(f"{named(row)}: {_fate(row)}", **style) for row, style in styles)]

    def arrange(figure: Figure) -> list[Axes]:
        parts: Any = figure.subfigures(2, 1, height_ratios=heights)
        return [*parts[0].subplots(1, len(shown), squeeze=False, sharey=True)[0], parts[1].subplots()]

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for one in axes[:-1]:
            one.tick_params(labelsize=7.5)
        part: Any = axes[0].figure
        part.supxlabel(_POSITION, fontsize=8)
        names = [one.name for one in above]
        part.legend(handles(above), names, loc="outside upper center", ncols=2, fontsize=7.5)
        figure.suptitle(frame, fontsize=_FRAME_POINTS, color=GREY)
        _finish_ranking(axes[-1], ranked)

    crosses = "; gray crosses: positions left out" * any(_left_out(answer, number) for number in shown)
    some = f"The {len(shown)} of {len(answer.stimuli)} most informative stimuli. "
    return Plot(
        (_WIDE_IN, sum(heights)), [*panels, _ranking(ranked)],
        f"Verdicts{of}",
        f"{some * (len(shown) < len(answer.stimuli))}Above: recorded rates, and the predictions of the "
        "maximum-likelihood pair of a measure and a receptor, of that of another measure, and of that of a control, "
        f"with the share of the held-out deviance that they predict{crosses}. Below: "
        "measures and controls, each at its maximum-likelihood receptor, with the p of its fit. Dotted: noise alone "
        "gives about 1.",
        sentence(answer), arrange=arrange, finish=finish, legend=[*above, *_FATES], titles={"fontsize": 8},
        labels={"fontsize": 8},
    )  # fmt: skip


def ranking(answer: AfferentVerdict) -> list[PairRow]:
    """Return the best receptor of each of the best measures and controls, best first."""
    best: dict[str, PairRow] = {}
    for row in answer.rows:
        best.setdefault(row.name, row)
    measures = [row for row in best.values() if not row.control][:_RANKED]
    controls = [row for row in best.values() if row.control][:_CONTROLS_RANKED]
    return sorted((*measures, *controls), key=lambda row: row.deviance)


def profiles(answer: AfferentVerdict, shown: Sequence[int], frame: str, of: str = "") -> Plot:
    """Plot recorded over predicted rates: pairs down and stimuli across; for one stimulus, pairs across."""

    def series(number: int, row: PairRow) -> list[Series]:
        return [*_recorded(answer, number), _predicted(answer, number, row, color=color_of(row.name), lw=1.4)]

    gaps = (
        " and stop where positions are left out. Crosses: recorded positions that are left out, since the simulation "
        "does not cover them at every receptor"
    ) * any(_left_out(answer, number) for number in shown)
    plot = _grid(answer, shown, series, _rate(answer), frame)
    return replace(
        plot,
        title=f"Recorded over predicted{of}",
        caption=f"One k and ε₀ for all stimuli. Bars: one standard error of the mean. Lines join the predictions at "
        f"the recorded positions{gaps}. Data: {', '.join(answer.recordings)}.",
    )


def residuals(answer: AfferentVerdict, shown: Sequence[int], frame: str, of: str = "") -> Plot:
    """Plot residuals in standard deviations of the noise, arranged like `profiles`."""

    def series(number: int, row: PairRow) -> list[Series]:
        mine, color = of_stimulus(answer, number), color_of(row.name)
        x, size = answer.places.position_mm[mine], row.residual[mine]
        rows = rows_of("pairs", "position_mm", "residual", pair=row.title, stimulus=number)
        return [
            guide("axhspan", -USUAL, USUAL, color=GREY, alpha=0.15, lw=0), guide("axhline", 0, color=GREY, lw=0.6),
            guide("vlines", x, 0, size, color=color, lw=1.2),
            Series("plot", x, size, ls="", marker="o", ms=2.5, color=color, rows=rows),
        ]  # fmt: skip

    caption = "Shaded: two standard deviations of the noise."
    plot = _grid(answer, shown, series, _RESIDUAL, frame)
    return replace(plot, title=f"Residuals by position{of}", caption=caption)


def _grid(
    answer: AfferentVerdict,
    shown: Sequence[int],
    series: Callable[[int, PairRow], Sequence[Series]],
    quantity: str,
    frame: str,
) -> Plot:
    """Plot panels of pairs and stimuli, with the labels of their axes along the whole figure."""
    titles = [
        (row, number, title_lines(f"{answer.stimuli[number]}\n{named(row)}", 2.3, 7))
        for row in plotted_pairs(answer)
        for number in shown
    ]
    rows, columns = (len(titles) // len(shown), len(shown)) if len(shown) > 1 else (1, len(titles))
    more_in = _LINE_IN * (max(title.count("\n") for _, _, title in titles) - 1)
    room = replace(_ROOM, top=_ROOM.top + more_in, rows=_ROOM.rows + more_in)

    def finish(figure: Figure, axes: list[Axes]) -> None:
        width, height = figure.get_size_inches()
        figure.text(0.5, 1 - 0.08 / height, frame, fontsize=_FRAME_POINTS, color=GREY, ha="center", va="top")
        figure.text(0.5, 0.05 / height, _POSITION, fontsize=8, ha="center", va="bottom")
        figure.text(0.05 / width, 0.5, quantity, fontsize=8, rotation=90, va="center", ha="left")

    return Plot(
        (room.left + 2.3 * columns, room.top + room.bottom + (1.03 + room.rows) * rows),
        [Subplot(_POSITION, quantity, series(number, row), title, printed="") for row, number, title in titles],
        arrange=in_grid(len(titles), columns, room, sharex="col" if rows > 1 else True, sharey=True), finish=finish,
        titles={"fontsize": 7}, ticks={"labelsize": 7.5}, layout=None,
    )  # fmt: skip


def scatter(answer: AfferentVerdict, frame: str, of: str = "") -> Plot:
    """Plot recorded rate against each pair's measure, with the fit."""
    pairs = [row for row in plotted_pairs(answer) if np.isfinite(row.eps).any()]
    styles = stimulus_styles(len(answer.stimuli))
    legend = [
        entry(title, ls="", marker=marker, mfc="none", mec=colour)
        for title, (colour, marker) in zip(answer.stimuli, styles, strict=True)
    ]

    def points(row: PairRow, number: int, colour: Any, marker: str) -> Series:
        mine = of_stimulus(answer, number)
        rows = rows_of("pairs", "eps", "rate", pair=row.title, stimulus=number)
        style = {"ls": "", "marker": marker, "ms": 4, "mfc": "none", "mec": colour}
        return Series("plot", row.eps[mine], answer.places.rate[mine], rows=rows, **style)

    def fit(row: PairRow) -> Series:
        rows = rows_of("pairs", "eps", "fit", pair=row.title)
        return Series("plot", *_curve(row), rows=rows, color=color_of(row.name), lw=1.4)

    def finish(figure: Figure, axes: list[Axes]) -> None:
        figure.suptitle(frame, fontsize=_FRAME_POINTS, color=GREY)
        columns = _columns(answer.stimuli)
        figure.legend(handles=handles(legend), loc="outside lower center", ncols=columns, fontsize=7.5)

    return Plot(
        (0.6 + 2.4 * len(pairs), 3.0),
        [
            Subplot(
                measured_in(row.name), _rate(answer),
                [*(points(row, number, *style) for number, style in enumerate(styles)), fit(row)],
                f"{named(row)}\nk = {as_number(row.k)}, ε₀ = {as_number(row.eps0)}",
                printed="x" if k else "xy",
            )
            for k, row in enumerate(pairs)
        ],
        f"Rate against measure{of}",
        "Each point is a recorded position; the measure is interpolated linearly in the SSRP. Line: the fit.",
        arrange=in_grid(len(pairs), len(pairs), sharey=True), finish=finish, legend=legend, titles={"fontsize": 8},
        labels={"fontsize": 8}, ticks={"labelsize": 7.5},
    )  # fmt: skip


def every_pair(answer: AfferentVerdict, of: str = "") -> Plot:
    """Plot the misfit of each measure and control at each receptor, and mark those in the set."""
    names = list(dict.fromkeys(row.name for row in sorted(answer.rows, key=lambda row: row.control)))
    receptors = sorted({row.receptor_mm for row in answer.rows if row.receptor_mm is not None})
    misfit = np.full((len(names), len(receptors)), np.nan)
    marks = []
    for row in answer.rows:
        line = names.index(row.name)
        across = range(len(receptors)) if row.receptor_mm is None else [receptors.index(row.receptor_mm)]
        misfit[line, list(across)] = row.lack_of_fit
        if row.fits:
            filled, rows = "black" if row.in_set else "none", rows_of("pairs", "receptor", "line", pair=row.title)
            style = {"ls": "", "marker": "o", "ms": 5, "mfc": filled, "mec": "black", "mew": 1.0}
            marks.append(Series("plot", across, [line] * len(across), rows=rows, **style))
    scale = LogNorm(1.0, max(float(np.nanmax(misfit)), 2.0))
    image = Series("imshow", misfit, cmap="cividis_r", norm=scale, aspect="auto", interpolation="nearest",
                   rows=rows_of("pairs", "misfit"))  # fmt: skip
    controls = {row.name for row in answer.controls}
    written = some_of(len(receptors), _MOST_RECEPTORS)
    panel = Subplot(
        "receptor x (mm)",
        "",
        [*marks, image, guide("axhline", len(names) - len(controls) - 0.5, color="white", lw=2)], printed="x",
        x_names=[signed(receptors[k]) for k in written],
        y_names=[name if name in controls else label(name) for name in names], color=_MISFIT,
    )  # fmt: skip

    def finish(figure: Figure, panels: list[Axes]) -> None:
        (axes,) = panels
        axes.set_xticks(written, panel.x_names, fontsize=7.5)
        axes.set_yticks(range(len(names)), panel.y_names, fontsize=7.5)
        bar = figure.colorbar(axes.images[0], ax=axes, pad=0.02, extend="min" if np.nanmin(misfit) < 1 else "neither")
        bar.locator = LogLocator(subs=(1, 2, 5))
        bar.formatter = StrMethodFormatter("{x:g}")
        bar.minorticks_off()
        bar.set_label(_MISFIT, fontsize=8)
        bar.ax.tick_params(labelsize=7.5)

    return Plot(
        (_WIDE_IN, max(0.9 + 0.2 * len(names), _LEAST_MAP_IN)), [panel],
        f"Every pair of measure and receptor{of}",
        "Color: lack-of-fit F of each measure and control at each receptor; noise alone gives about 1, and "
        "values below share its color. Filled: in the set; ring: not rejected, but worse; none: rejected by its "
        "own fit. Blank: no fit.",
        finish=finish, labels={"fontsize": 8},
    )  # fmt: skip


def named(row: PairRow) -> str:
    """Return the name of a pair in the sign in which it is plotted."""
    name = f"{row.name} (control)" if row.control else label(row.name)
    return name if row.receptor_mm is None else f"{name} at {signed(row.receptor_mm)} mm"


def of_stimulus(answer: AfferentVerdict, number: int) -> Places:
    """Return which positions belong to one stimulus, sorted."""
    mine = np.flatnonzero(answer.places.stimulus == number)
    return mine[np.argsort(answer.places.position_mm[mine])]


def _recorded(answer: AfferentVerdict, number: int) -> list[Series]:
    mine, places = of_stimulus(answer, number), answer.places
    return [
        Series(
            "errorbar", places.position_mm[mine], places.rate[mine], places.error[mine], fmt="o", ms=3, color="black",
            elinewidth=0.7, rows=rows_of("recorded", "position_mm", "rate", "error", stimulus=number),
        ),
        *(
            Series("plot", one.position_mm[: len(one.rate)], one.rate, ls="", marker="x", ms=4, color=GREY,
                   rows=rows_of("left out", "position_mm", "rate", stimulus=number))
            for one in _left_out(answer, number)
        ),
    ]  # fmt: skip


def _predicted(answer: AfferentVerdict, number: int, row: PairRow, **style: Any) -> Series:
    """Return a line through the predictions, interrupted where positions are left out."""
    mine = of_stimulus(answer, number)
    gaps = [x for one in _left_out(answer, number) for x in one.position_mm]
    at = np.concatenate([answer.places.position_mm[mine], gaps])
    rate = np.concatenate([row.predicted[mine], np.full(len(gaps), np.nan)])
    order = np.argsort(at, kind="stable")
    rows = rows_of("pairs", "position_mm", "predicted", pair=row.title, stimulus=number)
    return Series("plot", at[order], rate[order], rows=rows, **style)


def _left_out(answer: AfferentVerdict, number: int) -> list[LeftOut]:
    return [one for one in answer.left_out if one.stimulus == answer.stimuli[number]]


def _ranking(ranked: Sequence[PairRow]) -> Subplot:
    series = []
    for height, row in enumerate(ranked):
        style = {"marker": "o" if row.fits else "x", "ms": 6, "mec": color_of(row.name)}
        mfc, rows = color_of(row.name) if row.in_set else "white", rows_of("pairs", "lack_of_fit", pair=row.title)
        series.append(Series("plot", row.lack_of_fit, height, rows=rows, mfc=mfc, **style))
    noise = guide("axvline", 1.0, color=GREY, lw=0.8, ls=DOTTED)
    return Subplot(_MISFIT, "", [*series, noise], printed="x", y_names=[named(row) for row in ranked])


def _finish_ranking(axes: Axes, ranked: Sequence[PairRow]) -> None:
    for height, row in enumerate(ranked):
        p = f"p = {row.p_fit:.2g}" if row.p_fit >= 1e-4 else "p < 0.0001"
        axes.annotate(p, (1.0, height), (4, 0), xycoords=("axes fraction", "data"), textcoords="offset points",
                      fontsize=7, va="center", annotation_clip=False)  # fmt: skip
    axes.set_yticks(range(len(ranked)), [named(row) for row in ranked], fontsize=7.5)
    axes.set_ylim(len(ranked) - 0.4, -0.6)
    if any(row.lack_of_fit > 0 for row in ranked):  # none is, if every rate is the same
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.xaxis.set_minor_locator(NullLocator())
    axes.tick_params(axis="x", labelsize=7.5, which="both")
    axes.grid(axis="y", color="#e4e4e4", lw=0.5)
    part: Any = axes.figure
    part.legend(handles=handles(_FATES), loc="outside lower center", ncols=4, fontsize=7.5)


def _fate(row: PairRow) -> str:
    status = "in the set" if row.in_set else "not rejected, but worse" if row.fits else "rejected by its fit"
    return f"{status}, predicts {percent(row.left_out)}"


_FATES = (
    entry("in the set", ls="", marker="o", mfc="black", mec="black"),
    entry("not rejected, but worse", ls="", marker="o", mfc="white", mec="black"),
    entry("rejected by its fit", ls="", marker="x", mec="black"),
)


def _columns(names: Sequence[str]) -> int:
    """Return how many columns of a legend fit into its figure."""
    return 1 if max(map(len, names)) > _LONG else min(len(names), 4)


def stimulus_styles(n: int) -> list[tuple[Any, str]]:
    """Return colors and markers of n stimuli: shades, since hues are those of the measures."""
    return [("black" if n == 1 else shade(k, n), _MARKERS[k % len(_MARKERS)]) for k in range(n)]


def _curve(row: PairRow) -> tuple[Array, Array]:
    """Return the fit (n,) on a fine grid between the smallest and the largest measure."""
    known = row.eps[np.isfinite(row.eps)]
    corner = [row.eps0] if known.min() < row.eps0 < known.max() else []
    eps = np.unique(np.concatenate([np.linspace(known.min(), known.max(), _CURVE_POINTS), corner]))
    if np.isnan(row.k):  # a constant
        return eps, np.full_like(eps, row.predicted[0])
    drive = np.maximum(row.k * (eps - row.eps0), 0.0)
    return eps, drive / (1 + row.saturation * drive)


def measured_in(name: str) -> str:
    """Return the label of an axis of a measure or control."""
    return in_unit(name) if name in MEASURES else f"{name} ({CONTROL_UNITS.get(name, '1')})"
