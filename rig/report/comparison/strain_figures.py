"""Strain maps of the receptor plane, as figures."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from rig.compare.stimulus_maps import MAPPED, StimulusMap
from rig.report.labels import label, unit
from rig.report.style import Plot, Room, signed

_SHOWN_MM = ((-3.4, 3.4), (2.0, 5.2))
_TOP_QUANTILE = 0.97
_ROOM = Room(left=0.5, right=1.0, bottom=0.42, top=0.28, columns=0.12, rows=0.15)


def strain_maps(maps: Sequence[StimulusMap]) -> Plot:
    """One stimulus: measures down, positions across; one scale a measure."""
    size = (1.2 + 3.0 * len(maps), 0.5 + 1.55 * len(MAPPED))
    return Plot(size, lambda figure: _strain_maps(figure, maps), layout=None)


def _strain_maps(figure: Figure, maps: Sequence[StimulusMap]) -> None:
    panels = _ROOM.panels(figure, len(MAPPED), len(maps), sharex=True, sharey=True)
    for row, measure in zip(panels, MAPPED, strict=True):
        top = max(_top(one, measure) for one in maps)
        drawn = [_map(axes, one, measure, top) for axes, one in zip(row, maps, strict=True)]
        name = f"{label(measure)} ({unit(measure)})"
        figure.colorbar(drawn[-1], cax=_beside(figure, row[-1]), label=name, extend="max")
        row[0].set_ylabel("y (mm)")
    for axes, one in zip(panels[0], maps, strict=True):
        axes.set_title(f"indentor at x = {signed(one.x_mm)} mm", fontsize=8)
    for axes in panels[-1]:
        axes.set_xlabel("x (mm)")


def _beside(figure: Figure, axes: Axes) -> Axes:
    """Room for a scale at the right of a row."""
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
    axes.set(xlim=_SHOWN_MM[0], ylim=_SHOWN_MM[1], aspect="equal")
    return image


def _top(one: StimulusMap, measure: str) -> float:
    """The top of the colour scale: the epidermis under an edge would take all of it."""
    (left, right), (low, high) = _SHOWN_MM
    x, y = np.moveaxis(one.corner_mm[:-1, :-1], -1, 0)
    seen = (x > left) & (x < right) & (y > low) & (y < high)
    return float(np.quantile(one.values[measure][seen], _TOP_QUANTILE))
