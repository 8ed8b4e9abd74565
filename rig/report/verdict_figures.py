"""Figures of the verdict on one afferent: recorded and predicted rates, residuals, and the misfit of each pair."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter
from numpy.typing import NDArray

from rig.compare.stimuli import CONTROL_UNITS
from rig.compare.verdict import AfferentVerdict, LeftOut, PairRow
from rig.compare.verdict_text import percent
from rig.report.measure_colors import color_of
from rig.report.style import (
    DOTTED,
    GREY,
    Plot,
    Room,
    as_number,
    label,
    shade,
    signed,
    some_of,
    unit,
)
from rig.report.title_lines import title_lines
from sim.measures.measures import MEASURES

Array = NDArray[np.float64]
Places = NDArray[np.int64]

STIMULI_FIRST, STIMULI_ACROSS = 4, 3
_WIDE_IN, _PROFILES_IN, _LEAST_MAP_IN = 7.8, 2.55, 2.7
_RANKED, _CONTROLS_RANKED = 7, 3
_RATE = "discharge rate\n(unit of the recording)"
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


def most_telling(answer: AfferentVerdict) -> list[int]:
    """Return the stimuli that fit into a figure, in order: those for which rivals differ most."""
    numbers = list(range(len(answer.stimuli)))
    found = apart(answer)
    if found is None or len(numbers) <= STIMULI_FIRST:
        return numbers
    separation = [float(np.nansum(found[of_stimulus(answer, number)] ** 2)) for number in numbers]
    return sorted(sorted(numbers, key=lambda number: -separation[number])[:STIMULI_FIRST])


def the_answer(answer: AfferentVerdict, shown: Sequence[int], frame: str) -> Plot:
    """Plot recorded rates of some stimuli with the predictions, above the misfit of the best pairs."""
    size = (_WIDE_IN, _PROFILES_IN + _ranking_in(answer))
    return Plot(size, lambda figure: _the_answer(figure, answer, shown, frame))


def ranking(answer: AfferentVerdict) -> list[PairRow]:
    """Return the best receptor of each of the best measures and controls, best first."""
    best: dict[str, PairRow] = {}
    for row in answer.rows:
        best.setdefault(row.name, row)
    measures = [row for row in best.values() if not row.control][:_RANKED]
    controls = [row for row in best.values() if row.control][:_CONTROLS_RANKED]
    return sorted((*measures, *controls), key=lambda row: row.deviance)


def profiles(answer: AfferentVerdict, shown: Sequence[int], frame: str) -> Plot:
    """Plot recorded over predicted rates: pairs down and stimuli across; for one stimulus, pairs across."""
    return _grid(answer, shown, _profile, (_RATE, frame))


def residuals(answer: AfferentVerdict, shown: Sequence[int], frame: str) -> Plot:
    """Plot residuals in standard deviations of the noise, arranged like `profiles`."""
    return _grid(answer, shown, _residual, (_RESIDUAL, frame))


def scatter(answer: AfferentVerdict, frame: str) -> Plot:
    """Plot recorded rate against each pair's measure, with the fit."""
    rows = [row for row in plotted_pairs(answer) if np.isfinite(row.eps).any()]
    return Plot((0.6 + 2.4 * len(rows), 3.0), lambda figure: _scatter(figure, answer, rows, frame))


def every_pair(answer: AfferentVerdict) -> Plot:
    """Plot the misfit of each measure and control at each receptor, and mark those in the set."""
    names = list(dict.fromkeys(row.name for row in sorted(answer.rows, key=lambda row: row.control)))
    return Plot(
        (_WIDE_IN, max(0.9 + 0.2 * len(names), _LEAST_MAP_IN)), lambda figure: _every_pair(figure, answer, names)
    )


def named(row: PairRow) -> str:
    """Return the name of a pair in the sign in which it is plotted."""
    name = f"{row.name} (control)" if row.control else label(row.name)
    return name if row.receptor_mm is None else f"{name} at {signed(row.receptor_mm)} mm"


def of_stimulus(answer: AfferentVerdict, number: int) -> Places:
    """Return which positions belong to one stimulus, sorted."""
    mine = np.flatnonzero(answer.places.stimulus == number)
    return mine[np.argsort(answer.places.position_mm[mine])]


def _ranking_in(answer: AfferentVerdict) -> float:
    return 0.95 + 0.19 * len(ranking(answer))


def _the_answer(figure: Figure, answer: AfferentVerdict, shown: Sequence[int], frame: str) -> None:
    parts: Any = figure.subfigures(2, 1, height_ratios=(_PROFILES_IN, _ranking_in(answer)))
    above, below = parts
    panels = above.subplots(1, len(shown), squeeze=False, sharey=True)[0]
    pairs = plotted_pairs(answer)
    for axes, number in zip(panels, shown, strict=True):
        _recorded(axes, answer, number)
        for row, (style, width) in zip(pairs, _LINES, strict=False):
            _predicted(axes, answer, number, row, color=color_of(row.name), ls=style, lw=width)
        axes.set_title(title_lines(answer.stimuli[number], (_WIDE_IN - 1) / len(shown), 8), fontsize=8)
    panels[0].set_ylabel(_RATE, fontsize=8)
    above.supxlabel("position from field center (mm)", fontsize=8)
    lines = [
        Line2D([], [], color=color_of(row.name), ls=style, lw=width)
        for row, (style, width) in zip(pairs, _LINES, strict=False)
    ]
    handles = [Line2D([], [], color="black", marker="o", ms=3, ls=""), *lines]
    names = ["recorded, ± standard error", *(f"{named(row)}: {_fate(row)}" for row in pairs)]
    above.legend(handles, names, loc="outside upper center", ncols=2, fontsize=7.5)
    figure.suptitle(frame, fontsize=_FRAME_POINTS, color=GREY)
    _ranking(below, ranking(answer))


def _recorded(axes: Axes, answer: AfferentVerdict, number: int) -> None:
    mine, places = of_stimulus(answer, number), answer.places
    bars = places.error[mine]
    axes.errorbar(places.position_mm[mine], places.rate[mine], bars, fmt="o", ms=3, color="black", elinewidth=0.7)
    for one in _left_out(answer, number):
        axes.plot(one.position_mm[: len(one.rate)], one.rate, "x", ms=4, color=GREY)
    axes.tick_params(labelsize=7.5)


def _predicted(axes: Axes, answer: AfferentVerdict, number: int, row: PairRow, **style: Any) -> None:
    """Plot a line through the predictions, interrupted where positions are left out."""
    mine = of_stimulus(answer, number)
    gaps = [x for one in _left_out(answer, number) for x in one.position_mm]
    at = np.concatenate([answer.places.position_mm[mine], gaps])
    rate = np.concatenate([row.predicted[mine], np.full(len(gaps), np.nan)])
    order = np.argsort(at, kind="stable")
    axes.plot(at[order], rate[order], **style)


def _left_out(answer: AfferentVerdict, number: int) -> list[LeftOut]:
    return [one for one in answer.left_out if one.stimulus == answer.stimuli[number]]


def _ranking(below: SubFigure, ranked: Sequence[PairRow]) -> None:
    axes = below.subplots()
    for height, row in enumerate(ranked):
        axes.plot(row.lack_of_fit, height, **_marker(row))
        label = f"p = {row.p_fit:.2g}" if row.p_fit >= 1e-4 else "p < 0.0001"
        axes.annotate(label, (1.0, height), (4, 0), xycoords=("axes fraction", "data"), textcoords="offset points",
                      fontsize=7, va="center", annotation_clip=False)  # fmt: skip
    axes.set_yticks(range(len(ranked)), [named(row) for row in ranked], fontsize=7.5)
    axes.set_ylim(len(ranked) - 0.4, -0.6)
    if any(row.lack_of_fit > 0 for row in ranked):  # none is, if every rate is the same
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.xaxis.set_minor_locator(NullLocator())
    axes.axvline(1.0, color=GREY, lw=0.8, ls=DOTTED)
    axes.set_xlabel("misfit over noise, lack-of-fit F (1)", fontsize=8)
    axes.tick_params(axis="x", labelsize=7.5, which="both")
    axes.grid(axis="y", color="#e4e4e4", lw=0.5)
    below.legend(handles=_legend(), loc="outside lower center", ncols=4, fontsize=7.5)


def _fate(row: PairRow) -> str:
    status = "in the set" if row.in_set else "not rejected, but worse" if row.fits else "rejected by its fit"
    return f"{status}, predicts {percent(row.left_out)}"


def _marker(row: PairRow) -> dict[str, Any]:
    color = color_of(row.name)
    return {"marker": "o" if row.fits else "x", "ms": 6, "mfc": color if row.in_set else "white", "mec": color}


def _legend() -> list[Line2D]:
    return [
        Line2D([], [], ls="", marker="o", mfc="black", mec="black", label="in the set"),
        Line2D([], [], ls="", marker="o", mfc="white", mec="black", label="not rejected, but worse"),
        Line2D([], [], ls="", marker="x", mec="black", label="rejected by its fit"),
    ]


Draw = Callable[[Axes, AfferentVerdict, int, PairRow], None]


def _grid(answer: AfferentVerdict, shown: Sequence[int], draw: Draw, labels: tuple[str, str]) -> Plot:
    """Plot panels of pairs and stimuli; `labels` are those of the vertical axis and of the whole figure."""
    pairs = len(plotted_pairs(answer))
    rows, columns = (pairs, len(shown)) if len(shown) > 1 else (1, pairs)
    room = _room(answer, shown)
    size = (room.left + 2.3 * columns, room.top + room.bottom + (1.03 + room.rows) * rows)
    return Plot(size, lambda figure: _draw_grid(figure, answer, shown, draw, labels), layout=None)


def _room(answer: AfferentVerdict, shown: Sequence[int]) -> Room:
    """Return the margins, with room for the titles."""
    lines = max(_title(answer, number, row).count("\n") for number in shown for row in plotted_pairs(answer)) - 1
    return replace(_ROOM, top=_ROOM.top + _LINE_IN * lines, rows=_ROOM.rows + _LINE_IN * lines)


def _title(answer: AfferentVerdict, number: int, row: PairRow) -> str:
    return title_lines(f"{answer.stimuli[number]}\n{named(row)}", 2.3, 7)


def _draw_grid(
    figure: Figure, answer: AfferentVerdict, shown: Sequence[int], draw: Draw, labels: tuple[str, str]
) -> None:
    pairs, (quantity, frame) = plotted_pairs(answer), labels
    rows, columns = (len(pairs), len(shown)) if len(shown) > 1 else (1, len(pairs))
    panels = _room(answer, shown).panels(figure, rows, columns, sharex="col" if rows > 1 else True, sharey=True)
    drawn = ((row, number) for row in pairs for number in shown)
    for axes, (row, number) in zip(panels.ravel(), drawn, strict=True):
        draw(axes, answer, number, row)
        axes.set_title(_title(answer, number, row), fontsize=7)
        axes.tick_params(labelsize=7.5)
    width, height = figure.get_size_inches()
    figure.text(0.5, 1 - 0.08 / height, frame, fontsize=_FRAME_POINTS, color=GREY, ha="center", va="top")
    figure.text(0.5, 0.05 / height, "position from field center (mm)", fontsize=8, ha="center", va="bottom")
    figure.text(0.05 / width, 0.5, quantity, fontsize=8, rotation=90, va="center", ha="left")


def _profile(axes: Axes, answer: AfferentVerdict, number: int, row: PairRow) -> None:
    _recorded(axes, answer, number)
    _predicted(axes, answer, number, row, color=color_of(row.name), lw=1.4)


def _residual(axes: Axes, answer: AfferentVerdict, number: int, row: PairRow) -> None:
    mine = of_stimulus(answer, number)
    x, size = answer.places.position_mm[mine], row.residual[mine]
    axes.axhspan(-USUAL, USUAL, color=GREY, alpha=0.15, lw=0)
    axes.axhline(0, color=GREY, lw=0.6)
    axes.vlines(x, 0, size, color=color_of(row.name), lw=1.2)
    axes.plot(x, size, "o", ms=2.5, color=color_of(row.name))


def _scatter(figure: Figure, answer: AfferentVerdict, rows: Sequence[PairRow], frame: str) -> None:
    figure.suptitle(frame, fontsize=_FRAME_POINTS, color=GREY)
    panels = figure.subplots(1, len(rows), squeeze=False, sharey=True)[0]
    styles = stimulus_styles(len(answer.stimuli))
    for axes, row in zip(panels, rows, strict=True):
        for number, (colour, marker) in enumerate(styles):
            mine = of_stimulus(answer, number)
            axes.plot(row.eps[mine], answer.places.rate[mine], marker, ms=4, mfc="none", mec=colour)
        axes.plot(*_curve(row), color=color_of(row.name), lw=1.4)
        axes.set_title(f"{named(row)}\nk = {as_number(row.k)}, ε₀ = {as_number(row.eps0)}", fontsize=8)
        axes.set_xlabel(measured_in(row.name), fontsize=8)
        axes.tick_params(labelsize=7.5)
    panels[0].set_ylabel(_RATE, fontsize=8)
    handles = [
        Line2D([], [], ls="", marker=marker, mfc="none", mec=colour, label=title)
        for title, (colour, marker) in zip(answer.stimuli, styles, strict=True)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=_columns(answer.stimuli), fontsize=7.5)


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
    if name in MEASURES:
        return f"{label(name)} ({unit(name)})"
    return f"{name} ({CONTROL_UNITS.get(name, '1')})"


def _every_pair(figure: Figure, answer: AfferentVerdict, names: Sequence[str]) -> None:
    receptors = sorted({row.receptor_mm for row in answer.rows if row.receptor_mm is not None})
    misfit = np.full((len(names), len(receptors)), np.nan)
    axes = figure.subplots()
    for row in answer.rows:
        line = names.index(row.name)
        across = range(len(receptors)) if row.receptor_mm is None else [receptors.index(row.receptor_mm)]
        misfit[line, list(across)] = row.lack_of_fit
        if row.fits:
            filled = "black" if row.in_set else "none"
            axes.plot(across, [line] * len(across), "o", ms=5, mfc=filled, mec="black", mew=1.0)
    scale = LogNorm(1.0, max(float(np.nanmax(misfit)), 2.0))
    image = axes.imshow(misfit, cmap="cividis_r", norm=scale, aspect="auto", interpolation="nearest")
    controls = {row.name for row in answer.controls}
    written = some_of(len(receptors), _MOST_RECEPTORS)
    axes.set_xticks(written, [signed(receptors[k]) for k in written], fontsize=7.5)
    axes.set_yticks(range(len(names)), [n if n in controls else label(n) for n in names], fontsize=7.5)
    axes.set_xlabel("receptor x (mm)", fontsize=8)
    axes.axhline(len(names) - len(controls) - 0.5, color="white", lw=2)
    bar = figure.colorbar(image, ax=axes, pad=0.02, extend="min" if np.nanmin(misfit) < 1 else "neither")
    bar.locator = LogLocator(subs=(1, 2, 5))
    bar.formatter = StrMethodFormatter("{x:g}")
    bar.minorticks_off()
    bar.set_label("misfit over noise, lack-of-fit F (1)", fontsize=8)
    bar.ax.tick_params(labelsize=7.5)
