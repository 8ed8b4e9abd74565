"""Figures of stimuli: response profiles, populations, correlation and pressure maps, strain maps."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from rig.compare.comparison import Comparison, Overlay
from rig.compare.fit import FEWEST_POSITIONS
from rig.compare.profile_shape_test import THRESHOLD, shape_test
from rig.compare.stimuli import MAPPED, StimulusMap, StimulusRow
from rig.report.measure_colors import color_of
from rig.report.recording_sections import frame
from rig.report.style import DOTTED, GREY, Plot, Room, label, shade_of, signed, some_of, unit
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


def ssrps(stimulus: StimulusRow, measures: Sequence[str]) -> Plot:
    """Plot a panel per measure: the stacked SSRPs of all receptors, with their shape-test results."""
    size = (3.4 * len(measures), min(1.2 + 0.42 * len(stimulus.receptor_mm), _HIGHEST_IN))
    return Plot(size, lambda figure: _ssrps(figure, stimulus, measures), layout=None)


def populations(stimulus: StimulusRow, measures: Sequence[str]) -> Plot:
    """Plot measures at all receptors for each indentor position: lines if there are few, else images."""
    if are_few(stimulus):
        return Plot((0.8 + 2.4 * len(measures), 2.6), lambda figure: _lines(figure, stimulus, measures))
    return Plot((0.5 + 2.5 * len(measures), 2.9), lambda figure: _images(figure, stimulus, measures), layout=None)


def _ssrps(figure: Figure, stimulus: StimulusRow, measures: Sequence[str]) -> None:
    panels = _PROFILES.panels(figure, 1, len(measures), sharex=True, sharey=True)[0]
    for axes, measure in zip(panels, measures, strict=True):
        values = stimulus.measures[MEASURES.index(measure)]
        size = float(np.ptp(values)) or 1.0
        for k in range(len(stimulus.receptor_mm)):
            _one_ssrp(axes, stimulus, values[:, k] / size, k, color_of(measure))
        axes.set_title(f"{label(measure)}, one step up = {_STEP_UP * size:.3g} {unit(measure)}", fontsize=8)
        axes.set_xlabel("indentor x (mm)")
        levels = _STEP_UP * np.arange(len(stimulus.receptor_mm))
        written = some_of(len(levels), _MOST_LEVELS)
        axes.set_yticks(levels[written], [signed(x) for x in stimulus.receptor_mm[written]])
    panels[0].set_ylabel("receptor x (mm)")


def _one_ssrp(axes: Axes, stimulus: StimulusRow, profile: Array, k: int, of_measure: str) -> None:
    """Plot a profile on its own baseline; the bar at its right end is as long as the smallest passing dip."""
    verdict = shape_test(stimulus.indentor, stimulus.x_mm, profile)
    base = 0.5 * float(profile[0] + profile[-1])
    passed = verdict is not None and verdict.passed
    colour = of_measure if passed or verdict is None else GREY
    level = _STEP_UP * k
    axes.plot(stimulus.x_mm, profile - base + level, "-o", ms=1.8, lw=1.6 if passed else 0.8, color=colour)
    axes.axhline(level, color=GREY, lw=0.8, ls=DOTTED)
    axes.plot([stimulus.receptor_mm[k]], [level], marker="|", ms=7, color="black")
    if verdict is None:
        return
    end = float(stimulus.x_mm[-1]) + 0.04 * float(np.ptp(stimulus.x_mm))
    least = THRESHOLD * max(verdict.judged_by.get("peak", verdict.judged_by.get("range", 0.0)), 0.0)
    axes.plot([end, end], [level - least, level], color="black", lw=4, solid_capstyle="butt")
    mark = "pass" if passed else "–"
    axes.annotate(mark, (end, level), (4, 0), textcoords="offset points", fontsize=7, color=colour, va="center")


def are_few(stimulus: StimulusRow) -> bool:
    """Return whether the positions are few enough for a line each."""
    return len(stimulus.x_mm) <= len(_MARKERS)


def _lines(figure: Figure, stimulus: StimulusRow, measures: Sequence[str]) -> None:
    panels = figure.subplots(1, len(measures), squeeze=False)[0]
    positions = [float(x) for x in stimulus.x_mm]
    for axes, measure in zip(panels, measures, strict=True):
        rows = stimulus.measures[MEASURES.index(measure)]
        for k, (x, row) in enumerate(zip(positions, rows, strict=True)):
            style = {"marker": _MARKERS[k], "ms": 6 - 0.7 * k}  # shrinking markers keep coincident points visible
            colour = shade_of(x, positions)
            axes.plot(stimulus.receptor_mm, row, ls="-", lw=0.9, color=colour, label=signed(x), **style)
        axes.set(xlabel="receptor x (mm)", ylabel=f"{label(measure)} ({unit(measure)})")
    handles, names = panels[0].get_legend_handles_labels()
    style = {"fontsize": 8, "title_fontsize": 8}
    figure.legend(handles, names, loc="outside right upper", title="indentor x (mm)", **style)


def _images(figure: Figure, stimulus: StimulusRow, measures: Sequence[str]) -> None:
    panels = _IMAGES.panels(figure, 1, len(measures), sharey=True)[0]
    for axes, measure in zip(panels, measures, strict=True):
        image = _image(axes, stimulus, stimulus.measures[MEASURES.index(measure)])
        axes.set_title(f"{label(measure)} ({unit(measure)})", fontsize=8)
        axes.set_xlabel("receptor x (mm)", fontsize=8)
        axes.tick_params(labelsize=8)
        bar = figure.colorbar(image, cax=_below(figure, axes), orientation="horizontal")
        bar.locator = MaxNLocator(_TICKS_OF_A_SCALE)
        bar.ax.tick_params(labelsize=7)
    panels[0].set_ylabel("indentor x (mm)", fontsize=8)


def _below(figure: Figure, axes: Axes) -> Axes:
    """Return axes for a color scale below a panel's label."""
    _, height = figure.get_size_inches()
    place = axes.get_position()
    return figure.add_axes((place.x0, _SCALE_IN[0] / height, place.width, _SCALE_IN[1] / height))


def _image(axes: Axes, stimulus: StimulusRow, values: Array) -> QuadMesh:
    """Plot values (n, receptors); if they have both signs, zero is mid-scale and gets a contour."""
    at, of = stimulus.receptor_mm, stimulus.x_mm
    top = float(np.abs(values).max()) or 1.0
    both = float(values.min()) < -_BOTH_SIGNS * top and float(values.max()) > _BOTH_SIGNS * top
    scale = {"cmap": "PuOr_r", "vmin": -top, "vmax": top} if both else {"cmap": "viridis"}
    image = axes.pcolormesh(at, of, values, shading="nearest", rasterized=True, **scale)
    if both and min(values.shape) > 1:
        axes.contour(at, of, values, [0.0], colors="black", linewidths=0.8)
    seen = (of >= at.min()) & (of <= at.max())
    axes.plot(of[seen], of[seen], ls=DOTTED, lw=1.0, color="white", path_effects=_OUTLINED)
    return image


CORRELATIONS_A_PAGE, PRESSURES_A_PAGE = 8, 9
_MOST_RECEPTORS = 12
_DARK = 0.5  # |r| beyond which black is illegible on the color map


def correlations(comparison: Comparison, judged: Sequence[StimulusRow]) -> Plot:
    """Plot Pearson's r of 18 measures × receptors for each stimulus, with a dot where the shape test is passed."""
    rows, columns = _grid(len(judged), 4)
    size = (1.2 + 2.35 * columns, 0.5 + 2.85 * rows)
    return Plot(size, lambda figure: _correlations(figure, comparison, judged, rows, columns))


def pressure_maps(stimuli: Sequence[StimulusRow]) -> Plot:
    """Plot pressure in the receptor plane for each position of each schedule, with the ends of contact regions."""
    rows, columns = _grid(len(stimuli), 3)
    size = (0.6 + 3.2 * columns, 0.45 + 1.95 * rows)
    return Plot(size, lambda figure: _pressure_maps(figure, stimuli, rows, columns))


def _grid(panels: int, widest: int) -> tuple[int, int]:
    """Return numbers of rows and columns that leave few cells empty."""
    rows = -(-panels // widest)
    return rows, -(-panels // rows)


def _correlations(
    figure: Figure, comparison: Comparison, judged: Sequence[StimulusRow], rows: int, columns: int
) -> None:
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
    recorded = {overlay.stimulus: overlay for overlay in comparison.overlays}
    image = None
    for axes in panels[len(judged) :]:
        axes.set_visible(False)
    for axes, stimulus in zip(panels, judged, strict=False):
        drawn = _heat_map(axes, stimulus, recorded.get(stimulus), comparison.passes(stimulus))
        image = drawn if stimulus in recorded else image
    figure.supxlabel("receptor x (mm)", fontsize=8)
    if image is not None:
        figure.colorbar(image, ax=panels.tolist(), label="Pearson's r (1)", shrink=0.6)
        figure.suptitle(frame(comparison.overlays), fontsize=7, color=GREY)


def _heat_map(
    axes: Axes, stimulus: StimulusRow, overlay: Overlay | None, passed: NDArray[np.bool_] | None
) -> AxesImage:
    """Plot r at receptors with enough positions, and the number of positions beside each location."""
    n = len(stimulus.receptor_mm)
    used = np.zeros(n, dtype=int) if overlay is None else overlay.used
    shown = (
        np.full((len(MEASURES), n), np.nan)
        if overlay is None
        else np.where(used < FEWEST_POSITIONS, np.nan, overlay.r)
    )
    image = axes.imshow(shown, cmap="PuOr_r", vmin=-1, vmax=1, aspect="auto", interpolation="nearest")
    if overlay is not None:
        axes.set_facecolor("#b0b0b0")  # white is r = 0
    _mark_negative(axes, shown)
    if passed is not None:
        measure, receptor = np.nonzero(passed)
        axes.plot(receptor, measure, "o", ms=4, mfc="black", mec="white", mew=0.6)
    written = some_of(n, _MOST_RECEPTORS)
    names = [
        signed(stimulus.receptor_mm[k]) if overlay is None else f"{signed(stimulus.receptor_mm[k])} ({used[k]})"
        for k in written
    ]
    axes.set_xticks(written, names, fontsize=6.5, rotation=90)
    axes.set_yticks(range(len(MEASURES)), [label(m) for m in MEASURES], fontsize=7)
    axes.set_xticks(np.arange(n - 1) + 0.5, minor=True)
    axes.set_yticks(np.arange(len(MEASURES) - 1) + 0.5, minor=True)
    axes.grid(which="minor", color="#dddddd", lw=0.4)
    axes.tick_params(which="minor", length=0)
    about = stimulus.title + ("" if passed is not None else "\nno shape test")
    axes.set_title(title_lines(about, 1.9, 8), fontsize=8)
    for side in axes.spines.values():
        side.set_visible(True)
    return image


def _mark_negative(axes: Axes, r: Array) -> None:
    """Mark negative cells with a dash, since both ends of the color map look alike in gray."""
    for colour, chosen in (("black", (r < 0) & (r > -_DARK)), ("white", r <= -_DARK)):
        measure, receptor = np.nonzero(chosen)
        axes.plot(receptor, measure, "_", ms=10, mew=0.6, color=colour)


def _pressure_maps(figure: Figure, stimuli: Sequence[StimulusRow], rows: int, columns: int) -> None:
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(stimuli) :]:
        axes.set_visible(False)
    for axes, stimulus in zip(panels, stimuli, strict=False):
        image = _pressure_map(axes, stimulus)
        bar = figure.colorbar(image, ax=axes)
        bar.set_label("pressure (kPa)", fontsize=8)
        bar.ax.tick_params(labelsize=7)
    figure.supxlabel("skin, undeformed x (mm)", fontsize=9)
    figure.supylabel("indentor x (mm)", fontsize=9)


def _pressure_map(axes: Axes, stimulus: StimulusRow) -> QuadMesh:
    at, of, pressure = stimulus.skin_mm, stimulus.x_mm, stimulus.pressure
    image = axes.pcolormesh(at, of, pressure, cmap="viridis", shading="nearest", rasterized=True, vmin=0)
    ends = [
        (end, x)
        for position, x in enumerate(stimulus.x_mm)
        for region in stimulus.contact_regions_mm(position)
        for end in region
    ]
    outline = [withStroke(linewidth=2.2, foreground="black")]
    marks = np.array(ends).reshape(-1, 2).T
    axes.plot(*marks, "|", ms=4.5, mew=1.0, color="white", path_effects=outline)
    axes.set_title(title_lines(stimulus.title, 2.3, 8), fontsize=8)
    axes.tick_params(labelsize=7)
    return image


_ABOUT_MM = ((1.4, 1.4), (1.15, 1.5))
"""Distances around receptors and skin above them that a map shows: left and right, below and above."""
_TOP_QUANTILE = 0.97
_ROOM = Room(left=0.5, right=1.0, bottom=0.48, top=0.28, columns=0.12, rows=0.15)


def strain_maps(maps: Sequence[StimulusMap]) -> Plot:
    """Plot maps of one stimulus: measures down, positions across, one color scale per measure."""
    size = (1.2 + 3.0 * len(maps), 0.56 + 1.55 * len(MAPPED))
    return Plot(size, lambda figure: _strain_maps(figure, maps), layout=None)


def _strain_maps(figure: Figure, maps: Sequence[StimulusMap]) -> None:
    panels = _ROOM.panels(figure, len(MAPPED), len(maps), sharex=True, sharey=True)
    across, up = seen = _seen_mm(maps)
    panels[0, 0].set(xlim=across, ylim=up)
    for row, measure in zip(panels, MAPPED, strict=True):
        top = max(_top(one, measure, seen) for one in maps)
        drawn = [_map(axes, one, measure, top) for axes, one in zip(row, maps, strict=True)]
        name = f"{label(measure)} ({unit(measure)})"
        figure.colorbar(drawn[-1], cax=_beside(figure, row[-1]), label=name, extend="max")
        row[0].set_ylabel("y (mm)")
    for axes, one in zip(panels[0], maps, strict=True):
        axes.set_title(f"indentor at x = {signed(one.x_mm)} mm", fontsize=8)
    for axes in panels[-1]:
        axes.set_xlabel("x (mm)")


def _beside(figure: Figure, axes: Axes) -> Axes:
    """Return axes for a color scale to the right of a row."""
    width, _ = figure.get_size_inches()
    place = axes.get_position()
    return figure.add_axes((place.x1 + 0.15 / width, place.y0, 0.12 / width, place.height))


def _map(axes: Axes, one: StimulusMap, measure: str, top: float) -> QuadMesh:
    x, y = np.moveaxis(one.corner_mm, -1, 0)
    image = axes.pcolormesh(
        x, y, one.values[measure], cmap="viridis", shading="flat", vmin=0, vmax=top, rasterized=True
    )
    axes.plot(x[:, 0], y[:, 0], color="black", lw=0.7)
    axes.plot(*one.receptor_mm.T, "o", ms=3, mfc="white", mec="black", mew=0.6)
    axes.set_aspect("equal")
    return image


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
