"""Figures of stimuli: response profiles, populations, correlation and pressure maps, strain maps."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from rig.compare.comparison import Comparison, Overlay
from rig.compare.fit import FEWEST_POSITIONS
from rig.compare.profile_shape_test import THRESHOLD, shape_test
from rig.compare.stimuli import MAPPED, StimulusMap, StimulusRow
from rig.report.measure_colors import color_of
from rig.report.plot import POSITIONS, Plot, Room, Series, Subplot, guide, in_grid, rows_of
from rig.report.recording_sections import frame
from rig.report.style import DOTTED, GREY, in_unit, label, shade_of, signed, some_of, unit
from rig.report.title_lines import title_lines
from sim.measures.measures import MEASURES

Array = NDArray[np.float64]
Limits = tuple[tuple[float, float], tuple[float, float]]

_STEP_UP = 0.8  # offset between profiles, relative to the range
_HIGHEST_IN, _MOST_LEVELS = 5.6, 20
_MARKERS = "osD^vP"
"""Markers for up to six positions; more positions are rows of an image."""
_BOTH_SIGNS = 0.05  # share of the largest magnitude from which a measure counts as having both signs
_TICKS_OF_A_SCALE = 4
_PROFILES = Room(left=0.75, right=0.4, bottom=0.45, top=0.3, columns=0.45)
_IMAGES = Room(left=0.6, right=0.2, bottom=0.85, top=0.28, columns=0.12)
_SCALE_IN = (0.25, 0.1)  # height above the figure's lower edge, and thickness
_OUTLINED = [withStroke(linewidth=2.0, foreground="black")]


def ssrps(stimulus: StimulusRow, measures: Sequence[str], *, tested: bool) -> Plot:
    """Plot a panel per measure: the stacked SSRPs of all receptors, with their shape-test results."""
    levels = _STEP_UP * np.arange(len(stimulus.receptor_mm))
    marks: list[tuple[int, int, str, str]] = []
    panels = []
    for n, measure in enumerate(measures):
        values = stimulus.measures[MEASURES.index(measure)]
        size = float(np.ptp(values)) or 1.0
        series = []
        for k, profile in enumerate((values / size).T):
            found, colour, mark = _one_ssrp(stimulus, measure, profile, k)
            series += found
            marks += [(n, k, colour, mark)] if mark else []
        title = f"{label(measure)}, one step up = {_STEP_UP * size:.3g} {unit(measure)}"
        panels.append(Subplot("indentor x (mm)", "receptor x (mm)", series, title, printed="x" if n else "xy"))

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for n, k, color, mark in marks:
            axes[n].annotate(mark, (_end_mm(stimulus), levels[k]), (4, 0), textcoords="offset points", fontsize=7,
                             color=color, va="center")  # fmt: skip
        written = some_of(len(levels), _MOST_LEVELS)
        for one in axes:
            one.set_yticks(levels[written], [signed(x) for x in stimulus.receptor_mm[written]])

    caption = (
        "One profile per receptor, shifted upwards. Dotted: the mean of the two ends; black tick: x of the receptor."
    )
    test = (
        " Colored profiles pass the shape test, gray ones do not. Black bars: the smallest dip (steps) or "
        f"prominence (bars) that counts, {100 * THRESHOLD:g} % of the peak or of the range."
    )
    return Plot(
        (3.4 * len(measures), min(1.2 + 0.42 * len(levels), _HIGHEST_IN)), panels,
        f"SSRPs{' and shape test' * tested}: {stimulus.title}",
        caption + test * tested, arrange=in_grid(len(panels), len(panels), _PROFILES, sharex=True, sharey=True),
        finish=finish, titles={"fontsize": 8}, layout=None,
    )  # fmt: skip


def _end_mm(stimulus: StimulusRow) -> float:
    """Return where the bars of the shape test stand, right of the profiles (mm)."""
    return float(stimulus.x_mm[-1]) + 0.04 * float(np.ptp(stimulus.x_mm))


def _one_ssrp(stimulus: StimulusRow, measure: str, profile: Array, k: int) -> tuple[list[Series], str, str]:
    """Return a profile on its own baseline, its color and mark; its bar is as long as the smallest passing dip."""
    verdict = shape_test(stimulus.indentor, stimulus.x_mm, profile)
    base = 0.5 * float(profile[0] + profile[-1])
    passed = verdict is not None and verdict.passed
    colour = color_of(measure) if passed or verdict is None else GREY
    level = _STEP_UP * k
    found = [
        Series("plot", stimulus.x_mm, profile - base + level, ls="-", marker="o", ms=1.8, lw=1.6 if passed else 0.8,
               color=colour, rows=rows_of("stacked", "x_mm", measure, stimulus=stimulus, receptor=k)),
        guide("axhline", level, color=GREY, lw=0.8, ls=DOTTED),
        guide("plot", [stimulus.receptor_mm[k]], [level], marker="|", ms=7, color="black"),
    ]  # fmt: skip
    if verdict is None:
        return found, colour, ""
    end = _end_mm(stimulus)
    least = THRESHOLD * max(verdict.judged_by.get("peak", verdict.judged_by.get("range", 0.0)), 0.0)
    found.append(guide("plot", [end, end], [level - least, level], color="black", lw=4, solid_capstyle="butt"))
    return found, colour, "pass" if passed else "–"


def are_few(stimulus: StimulusRow) -> bool:
    """Return whether the positions are few enough for a line each."""
    return len(stimulus.x_mm) <= len(_MARKERS)


def populations(stimulus: StimulusRow, measures: Sequence[str]) -> Plot:
    """Plot measures at all receptors for each indentor position: lines if there are few, else images."""
    return (_lines if are_few(stimulus) else _images)(stimulus, measures)


def _lines(stimulus: StimulusRow, measures: Sequence[str]) -> Plot:
    positions = [float(x) for x in stimulus.x_mm]

    def line(measure: str, k: int, x: float) -> Series:
        row = stimulus.measures[MEASURES.index(measure)][k]
        rows = rows_of("population", "receptor_x_mm", measure, stimulus=stimulus, position=k)
        style = {"marker": _MARKERS[k], "ms": 6 - 0.7 * k}  # shrinking markers keep coincident points visible
        color = shade_of(x, positions)
        return Series(
            "plot", stimulus.receptor_mm, row, rows=rows, ls="-", lw=0.9, color=color, label=signed(x), **style
        )

    def finish(figure: Figure, axes: list[Axes]) -> None:
        lines, names = axes[0].get_legend_handles_labels()
        figure.legend(lines, names, loc="outside right upper", title=POSITIONS, fontsize=8, title_fontsize=8)

    return Plot(
        (0.8 + 2.4 * len(measures), 2.6),
        [
            Subplot("receptor x (mm)", in_unit(measure), [line(measure, k, x) for k, x in enumerate(positions)])
            for measure in measures
        ],
        f"Population responses: {stimulus.title}",
        "The measures at all receptors, a line for each position of the indentor.",
        arrange=in_grid(len(measures), len(measures)), finish=finish,
    )  # fmt: skip


def _images(stimulus: StimulusRow, measures: Sequence[str]) -> Plot:
    panels = [
        Subplot("receptor x (mm)", "indentor x (mm)", _image(stimulus, measure), in_unit(measure),
              printed="x" if k else "xy", color=in_unit(measure))
        for k, measure in enumerate(measures)
    ]  # fmt: skip

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for one in axes:
            bar = figure.colorbar(one.collections[0], cax=_below(figure, one), orientation="horizontal")
            bar.locator = MaxNLocator(_TICKS_OF_A_SCALE)
            bar.ax.tick_params(labelsize=7)

    return Plot(
        (0.5 + 2.5 * len(measures), 2.9), panels,
        f"Population responses: {stimulus.title}",
        "The measures at all receptors. Each row is a position of the indentor. Dotted: the indentor's "
        "reference point is over the receptor. Black: zero, where a measure has both signs.",
        arrange=in_grid(len(panels), len(panels), _IMAGES, sharey=True), finish=finish, titles={"fontsize": 8},
        labels={"fontsize": 8}, ticks={"labelsize": 8}, layout=None,
    )  # fmt: skip


def _below(figure: Figure, axes: Axes) -> Axes:
    """Return axes for a color scale below a panel's label."""
    _, height = figure.get_size_inches()
    place = axes.get_position()
    return figure.add_axes((place.x0, _SCALE_IN[0] / height, place.width, _SCALE_IN[1] / height))


def _image(stimulus: StimulusRow, measure: str) -> list[Series]:
    """Return values (n, receptors); if they have both signs, zero is mid-scale and gets a contour."""
    at, of, values = stimulus.receptor_mm, stimulus.x_mm, stimulus.measures[MEASURES.index(measure)]
    top = float(np.abs(values).max()) or 1.0
    both = float(values.min()) < -_BOTH_SIGNS * top and float(values.max()) > _BOTH_SIGNS * top
    scale = {"cmap": "PuOr_r", "vmin": -top, "vmax": top} if both else {"cmap": "viridis"}
    zero = [guide("contour", at, of, values, [0.0], colors="black", linewidths=0.8)]
    seen = of[(of >= at.min()) & (of <= at.max())]
    return [
        Series("pcolormesh", at, of, values, shading="nearest", rasterized=True, **scale,
               rows=rows_of("population", "receptor_x_mm", "x_mm", measure, stimulus=stimulus)),
        *(zero if both and min(values.shape) > 1 else []),
        guide("plot", seen, seen, ls=DOTTED, lw=1.0, color="white", path_effects=_OUTLINED),
    ]  # fmt: skip


CORRELATIONS_A_PAGE, PRESSURES_A_PAGE = 8, 9
_MOST_RECEPTORS = 12
_DARK = 0.5  # |r| beyond which black is illegible on the color map


def _grid(panels: int, widest: int) -> tuple[int, int]:
    """Return numbers of rows and columns that leave few cells empty."""
    rows = -(-panels // widest)
    return rows, -(-panels // rows)


def correlations(comparison: Comparison, judged: Sequence[StimulusRow]) -> Plot:
    """Plot Pearson's r of 18 measures × receptors for each stimulus, with a dot where the shape test is passed."""
    rows, columns = _grid(len(judged), 4)
    recorded = {overlay.stimulus: overlay for overlay in comparison.overlays}
    panels = [_heat_map(one, recorded.get(one), comparison.passes(one)) for one in judged]

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for one, stimulus, panel in zip(axes, judged, panels, strict=True):
            n = len(stimulus.receptor_mm)
            if stimulus in recorded:
                one.set_facecolor("#b0b0b0")  # white is r = 0
            one.set_xticks(some_of(n, _MOST_RECEPTORS), panel.x_names, fontsize=6.5, rotation=90)
            one.set_yticks(range(len(MEASURES)), panel.y_names, fontsize=7)
            one.set_xticks(np.arange(n - 1) + 0.5, minor=True)
            one.set_yticks(np.arange(len(MEASURES) - 1) + 0.5, minor=True)
            one.grid(which="minor", color="#dddddd", lw=0.4)
            one.tick_params(which="minor", length=0)
            for side in one.spines.values():
                side.set_visible(True)
        figure.supxlabel(panels[0].x, fontsize=8)
        images = [one.images[0] for one, stimulus in zip(axes, judged, strict=True) if stimulus in recorded]
        if images:
            figure.colorbar(images[-1], ax=figure.axes, label=_R, shrink=0.6)
            figure.suptitle(frame(comparison.overlays), fontsize=7, color=GREY)

    title, about = f"Shape test, {len(MEASURES)} measures × receptors", ""
    if comparison.overlays:
        title = f"Correlation and {title[0].lower()}{title[1:]}"
        about = (
            "Color: Pearson's correlation between the recorded rates and the SSRP at the recorded positions; "
            f"dash: negative; gray: nothing recorded, or fewer than {FEWEST_POSITIONS} positions covered. In "
            "brackets: how many recorded positions the run covers at the receptor. "
        )
    return Plot(
        (1.2 + 2.35 * columns, 0.5 + 2.85 * rows), panels, title,
        f"Dots: the SSRP passes the shape test. {about}Compressive measures are plotted with their sign changed (−).",
        arrange=in_grid(len(judged), columns, sharey=True), finish=finish, titles={"fontsize": 8},
    )  # fmt: skip


_R = "Pearson's r (1)"


def _heat_map(stimulus: StimulusRow, overlay: Overlay | None, passed: NDArray[np.bool_] | None) -> Subplot:
    """Return r at receptors with enough positions; the number of positions stands beside each location."""
    n = len(stimulus.receptor_mm)
    used = np.zeros(n, dtype=int) if overlay is None else overlay.used
    shown = np.full((len(MEASURES), n), np.nan)
    if overlay is not None:
        shown = np.where(used < FEWEST_POSITIONS, np.nan, overlay.r)
    series = [
        Series("imshow", shown, cmap="PuOr_r", vmin=-1, vmax=1, aspect="auto", interpolation="nearest",
               rows=rows_of("correlations", "r", stimulus=stimulus)),
        *_negative(shown),
    ]  # fmt: skip
    if passed is not None:
        measure, receptor = np.nonzero(passed)
        series.append(
            Series("plot", receptor, measure, ls="", marker="o", ms=4, mfc="black", mec="white", mew=0.6,
                   rows=rows_of("shape test", "receptor", "measure", stimulus=stimulus))
        )  # fmt: skip
    names = [
        signed(stimulus.receptor_mm[k]) if overlay is None else f"{signed(stimulus.receptor_mm[k])} ({used[k]})"
        for k in some_of(n, _MOST_RECEPTORS)
    ]
    about = stimulus.title + ("" if passed is not None else "\nno shape test")
    return Subplot(
        "receptor x (mm)", "", series, title_lines(about, 1.9, 8), printed="", x_names=names,
        y_names=[label(one) for one in MEASURES], color="" if overlay is None else _R,
    )  # fmt: skip


def _negative(r: Array) -> list[Series]:
    """Return a dash on each negative cell, since both ends of the color map look alike in gray."""
    marks = [("black", (r < 0) & (r > -_DARK)), ("white", r <= -_DARK)]
    return [
        guide("plot", *np.nonzero(chosen)[::-1], ls="", marker="_", ms=10, mew=0.6, color=color)
        for color, chosen in marks
    ]


def pressure_maps(stimuli: Sequence[StimulusRow]) -> Plot:
    """Plot pressure in the receptor plane for each position of each schedule, with the ends of contact regions."""
    rows, columns = _grid(len(stimuli), 3)
    panels = [_pressure_map(one) for one in stimuli]

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for one, panel in zip(axes, panels, strict=True):
            bar = figure.colorbar(one.collections[0], ax=one)
            bar.set_label(panel.color, fontsize=8)
            bar.ax.tick_params(labelsize=7)
        figure.supxlabel(panels[0].x, fontsize=9)
        figure.supylabel(panels[0].y, fontsize=9)

    return Plot(
        (0.6 + 3.2 * columns, 0.45 + 1.95 * rows), panels,
        "Pressure and contact regions along the schedules",
        "Nodal pressure in the receptor plane, unfiltered; each panel has its own scale. Each row is a "
        "position of the indentor and extends halfway to the next. White: the ends of the contact regions.",
        arrange=in_grid(len(panels), columns), finish=finish, titles={"fontsize": 8}, ticks={"labelsize": 7},
    )  # fmt: skip


def _pressure_map(stimulus: StimulusRow) -> Subplot:
    ends = [
        (end, x)
        for position, x in enumerate(stimulus.x_mm)
        for region in stimulus.contact_regions_mm(position)
        for end in region
    ]
    outline = [withStroke(linewidth=2.2, foreground="black")]
    series = [
        Series(
            "pcolormesh", stimulus.skin_mm, stimulus.x_mm, stimulus.pressure, cmap="viridis", shading="nearest",
            rasterized=True, vmin=0, rows=rows_of("pressure", "skin_x_mm", "x_mm", "pressure_kpa", stimulus=stimulus),
        ),
        Series("plot", *np.array(ends).reshape(-1, 2).T, ls="", marker="|", ms=4.5, mew=1.0, color="white",
               path_effects=outline, rows=rows_of("pressure", "contact_end_mm", "at_x_mm", stimulus=stimulus)),
    ]  # fmt: skip
    title = title_lines(stimulus.title, 2.3, 8)
    return Subplot("skin, undeformed x (mm)", "indentor x (mm)", series, title, printed="", color="pressure (kPa)")


_ABOUT_MM = ((1.4, 1.4), (1.15, 1.5))
"""Distances around receptors and skin above them that a map shows: left and right, below and above."""
_TOP_QUANTILE = 0.97
_ROOM = Room(left=0.5, right=1.0, bottom=0.48, top=0.28, columns=0.12, rows=0.15)


def strain_maps(maps: Sequence[StimulusMap], title: str, where: str) -> Plot:
    """Plot maps of one stimulus: measures down, positions across, one color scale per measure."""
    across, up = seen = _seen_mm(maps)
    panels = [
        Subplot("x (mm)", "y (mm)", _map(one, measure, max(_top(other, measure, seen) for other in maps)),
              f"indentor at x = {signed(one.x_mm)} mm" if measure == MAPPED[0] else "",
              printed="x" * (measure == MAPPED[-1]) + "y" * (k == 0), color=in_unit(measure), is_part=True)
        for measure in MAPPED
        for k, one in enumerate(maps)
    ]  # fmt: skip

    def finish(figure: Figure, axes: list[Axes]) -> None:
        axes[0].set(xlim=across, ylim=up)
        for one in axes:
            one.set_aspect("equal")
        last = len(maps) - 1
        for one, panel in zip(axes[last :: len(maps)], panels[last :: len(maps)], strict=True):
            scale = _beside(figure, one)
            figure.colorbar(one.collections[0], cax=scale, label=panel.color, extend="max")

    return Plot(
        (1.2 + 3.0 * len(maps), 0.56 + 1.55 * len(MAPPED)), panels, title,
        f"The deformed receptor plane{where} White circles: receptors. The highest 3 % of the elements share the "
        "top color.",
        arrange=in_grid(len(panels), len(maps), _ROOM, sharex=True, sharey=True), finish=finish,
        titles={"fontsize": 8}, layout=None,
    )  # fmt: skip


def _beside(figure: Figure, axes: Axes) -> Axes:
    """Return axes for a color scale to the right of a row."""
    width, _ = figure.get_size_inches()
    place = axes.get_position()
    return figure.add_axes((place.x1 + 0.15 / width, place.y0, 0.12 / width, place.height))


def _map(one: StimulusMap, measure: str, top: float) -> list[Series]:
    x, y = np.moveaxis(one.corner_mm, -1, 0)
    where = {"stimulus": one.stimulus, "x": one.x_mm}
    return [
        Series("pcolormesh", x, y, one.values[measure], cmap="viridis", shading="flat", vmin=0, vmax=top,
               rasterized=True, rows=rows_of("strain", "corner_x_mm", "corner_y_mm", measure, **where)),
        guide("plot", x[:, 0], y[:, 0], color="black", lw=0.7),
        Series("plot", *one.receptor_mm.T, ls="", marker="o", ms=3, mfc="white", mec="black", mew=0.6,
               rows=rows_of("strain", "receptor_x_mm", "receptor_y_mm", **where)),
    ]  # fmt: skip


def _seen_mm(maps: Sequence[StimulusMap]) -> Limits:
    """Return the limits of the maps, across and up (mm)."""
    (x, y), (across, up) = np.concatenate([one.receptor_mm for one in maps]).T, _ABOUT_MM
    return (float(x.min()) - across[0], float(x.max()) + across[1]), (float(y.min()) - up[0], float(y.max()) + up[1])


def _top(one: StimulusMap, measure: str, seen: Limits) -> float:
    """Return the top of the color scale, a quantile because the epidermis under an edge would dominate it."""
    (left, right), (low, high) = seen
    x, y = np.moveaxis(one.corner_mm[:-1, :-1], -1, 0)
    inside = (x > left) & (x < right) & (y > low) & (y < high)
    return float(np.quantile(one.values[measure][inside], _TOP_QUANTILE))
