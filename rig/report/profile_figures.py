"""Figures of stimuli: SSRPs with their shape tests, and population responses."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from rig.compare.shape_test import THRESHOLD, shape_test
from rig.compare.stimuli import Stimulus
from rig.report.labels import label, unit
from rig.report.style import BLUE, GREY, ORANGE, Plot, Room, shade_of, signed, some_of
from sim.measures.measures import MEASURES

Array = NDArray[np.float64]

_STEP_UP = 0.8  # from one profile to the next, of the range
_HIGHEST_IN, _MOST_LEVELS = 5.6, 20
_MARKERS = "osD^vP"
"""For positions few enough to tell by marker; more are rows of an image."""
_BOTH_SIGNS = 0.05  # of the largest magnitude: a measure has both signs from here on
_TICKS_OF_A_SCALE = 4
_PROFILES = Room(left=0.75, right=0.4, bottom=0.45, top=0.3, columns=0.45)
_IMAGES = Room(left=0.6, right=0.2, bottom=0.85, top=0.28, columns=0.12)
_SCALE_IN = (0.25, 0.1)  # above the figure's foot, high
_OUTLINED = [withStroke(linewidth=2.0, foreground="black")]


def ssrps(stimulus: Stimulus, measures: Sequence[str]) -> Plot:
    """One panel a measure: the SSRPs of all receptors above each other, and how each did in the shape test."""
    size = (3.4 * len(measures), min(1.2 + 0.42 * len(stimulus.receptor_mm), _HIGHEST_IN))
    return Plot(size, lambda figure: _ssrps(figure, stimulus, measures), layout=None)


def populations(stimulus: Stimulus, measures: Sequence[str]) -> Plot:
    """The measures at all receptors for each indentor position: lines where these are few, images else."""
    if _few(stimulus):
        return Plot((0.8 + 2.4 * len(measures), 2.6), lambda figure: _lines(figure, stimulus, measures))
    return Plot((0.5 + 2.5 * len(measures), 2.9), lambda figure: _images(figure, stimulus, measures), layout=None)


def _ssrps(figure: Figure, stimulus: Stimulus, measures: Sequence[str]) -> None:
    panels = _PROFILES.panels(figure, 1, len(measures), sharex=True, sharey=True)[0]
    for axes, measure in zip(panels, measures, strict=True):
        values = stimulus.measures[MEASURES.index(measure)]
        size = float(np.ptp(values)) or 1.0
        for k in range(len(stimulus.receptor_mm)):
            _one_ssrp(axes, stimulus, values[:, k] / size, k)
        axes.set_title(f"{label(measure)}, one step up = {_STEP_UP * size:.3g} {unit(measure)}", fontsize=8)
        axes.set_xlabel("indentor x (mm)")
        levels = _STEP_UP * np.arange(len(stimulus.receptor_mm))
        written = some_of(len(levels), _MOST_LEVELS)
        axes.set_yticks(levels[written], [signed(x) for x in stimulus.receptor_mm[written]])
    panels[0].set_ylabel("receptor x (mm)")


def _one_ssrp(axes: Axes, stimulus: Stimulus, profile: Array, k: int) -> None:
    """A profile on its own baseline; the bar at its right end is as long as the dip must at least be."""
    verdict = shape_test(stimulus.indentor, stimulus.x_mm, profile)
    base = 0.5 * float(profile[0] + profile[-1])
    passed = verdict is not None and verdict.passed
    colour = BLUE if passed else GREY
    level = _STEP_UP * k
    axes.plot(stimulus.x_mm, profile - base + level, "-o", ms=1.8, lw=1.6 if passed else 0.8, color=colour)
    axes.axhline(level, color=GREY, lw=0.4, ls=":")
    axes.plot([stimulus.receptor_mm[k]], [level], marker="|", ms=7, color="black")
    if verdict is None:
        return
    end = float(stimulus.x_mm[-1]) + 0.04 * float(np.ptp(stimulus.x_mm))
    least = THRESHOLD * max(verdict.judged_by.get("peak", verdict.judged_by.get("range", 0.0)), 0.0)
    axes.plot([end, end], [level - least, level], color=ORANGE, lw=2)
    mark = "pass" if passed else "–"
    axes.annotate(mark, (end, level), (4, 0), textcoords="offset points", fontsize=7, color=colour, va="center")


def _few(stimulus: Stimulus) -> bool:
    return len(stimulus.x_mm) <= len(_MARKERS)


def _lines(figure: Figure, stimulus: Stimulus, measures: Sequence[str]) -> None:
    panels = figure.subplots(1, len(measures), squeeze=False)[0]
    positions = [float(x) for x in stimulus.x_mm]
    for axes, measure in zip(panels, measures, strict=True):
        rows = stimulus.measures[MEASURES.index(measure)]
        for k, (x, row) in enumerate(zip(positions, rows, strict=True)):
            style = {"marker": _MARKERS[k], "ms": 6 - 0.7 * k}  # what coincides stays visible
            colour = shade_of(x, positions)
            axes.plot(stimulus.receptor_mm, row, ls="-", lw=0.9, color=colour, label=signed(x), **style)
        axes.set(xlabel="receptor x (mm)", ylabel=f"{label(measure)} ({unit(measure)})")
    handles, names = panels[0].get_legend_handles_labels()
    style = {"fontsize": 8, "title_fontsize": 8}
    figure.legend(handles, names, loc="outside right upper", title="indentor x (mm)", **style)


def _images(figure: Figure, stimulus: Stimulus, measures: Sequence[str]) -> None:
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
    """Room for a scale under a panel's own label."""
    _, height = figure.get_size_inches()
    place = axes.get_position()
    return figure.add_axes((place.x0, _SCALE_IN[0] / height, place.width, _SCALE_IN[1] / height))


def _image(axes: Axes, stimulus: Stimulus, values: Array) -> QuadMesh:
    """Values (n, receptors); of both signs, zero is in the middle of the colours, and drawn as a line."""
    at, of = stimulus.receptor_mm, stimulus.x_mm
    top = float(np.abs(values).max()) or 1.0
    both = float(values.min()) < -_BOTH_SIGNS * top and float(values.max()) > _BOTH_SIGNS * top
    scale = {"cmap": "PuOr_r", "vmin": -top, "vmax": top} if both else {"cmap": "viridis"}
    image = axes.pcolormesh(at, of, values, shading="nearest", rasterized=True, **scale)
    if both:
        axes.contour(at, of, values, [0.0], colors="black", linewidths=0.8)
    seen = (of >= at.min()) & (of <= at.max())
    axes.plot(of[seen], of[seen], ls=(0, (2, 3)), lw=1.0, color="white", path_effects=_OUTLINED)
    return image
