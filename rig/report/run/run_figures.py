"""Figures of what the finger model says that receptors feel."""

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.plan.responses import Response, by_group, measured
from rig.report.labels import label, unit
from rig.report.style import GREY, Plot, Room, position_scale, shade, shade_of, signed
from sim.measures.measures import shown

Array = NDArray[np.float64]

_LEGEND_IN = 0.2  # a line of one
_NAMES_A_LINE = 4


def population_responses(found: list[Response]) -> Plot:
    """ep1 and SED at all receptors, one line for each indentor position."""
    return Plot((9.6, 3.6), lambda figure: _population(figure, found), layout=None)


def ssrps(found: list[Response], measure: str) -> Plot:
    """The measure at each receptor against the indentor's position."""
    return Plot((10.2, 4.8), lambda figure: _ssrps(figure, found, measure), layout=None)


def _population(figure: Figure, found: list[Response]) -> None:
    """Coloured by position where one thing was moved, by what was commanded where one place was pressed."""
    receptor_x = found[0].result.model.receptors.position_mm[:, 0]
    groups = by_group(found)
    moved = len({response.hold["x_mm"] for response in found}) > 1
    name, chosen = list(groups.items())[-1]
    lines = [(r.hold["x_mm"], r) for r in chosen] if moved else [(k, m[0]) for k, m in enumerate(groups.values())]
    shades = [value for value, _ in lines]
    room = (
        Room(left=0.75, right=0.9, columns=0.9)
        if moved
        else Room(0.75, bottom=0.6 + _legend_in(len(lines)), columns=0.9)
    )
    panels = room.panels(figure, 1, 2).ravel()
    for axes, measure in zip(panels, ("ep1", "sed"), strict=True):
        for value, response in lines:
            row = shown(measure, measured([response], measure)[1][0])
            axes.plot(receptor_x, row, "-o", ms=2.5, lw=1, color=shade_of(value, shades), label=response.group)
        axes.set(xlabel="receptor x (mm)", ylabel=f"{label(measure)} ({unit(measure)})", title=name if moved else "")
    if moved:
        position_scale(panels[-1], shades)
    else:
        _legend(figure, *panels[0].get_legend_handles_labels())


def _ssrps(figure: Figure, found: list[Response], measure: str) -> None:
    """One line for each thing that was moved: the same indentor pressed to the same depth or force."""
    receptor_x = found[0].result.model.receptors.position_mm[:, 0]
    groups = {name: members for name, members in by_group(found).items() if len(members) > 1}
    columns = -(-len(receptor_x) // 2)
    room = Room(0.75, bottom=0.6 + _legend_in(len(groups)), columns=0.12, rows=0.35)
    panels = room.panels(figure, 2, columns, sharex=True, sharey=True)
    for k, (name, members) in enumerate(groups.items()):
        positions, values = _over_repeats(*measured(members, measure))
        for axes, column in zip(panels.ravel(), shown(measure, values).T, strict=False):
            axes.plot(positions, column, "-o", ms=2, lw=1, color=shade(k, len(groups)), label=name)
    for axes, x in zip(panels.ravel(), receptor_x, strict=False):
        axes.axvline(x, color=GREY, lw=0.6, ls=":")
        axes.set_title(f"receptor at {signed(x)} mm", fontsize=8)
    for axes in panels[-1]:
        axes.set_xlabel("indentor x (mm)")
    for axes in panels[:, 0]:
        axes.set_ylabel(f"{label(measure)} ({unit(measure)})")
    _legend(figure, *panels[0, 0].get_legend_handles_labels())


def _over_repeats(x_mm: Array, values: Array) -> tuple[Array, Array]:
    """Each place once (n,), with the mean of its repeats (n, receptors)."""
    places, back = np.unique(x_mm, return_inverse=True)
    return places, np.stack([values[back == k].mean(axis=0) for k in range(len(places))])


def _legend_in(names: int) -> float:
    return _LEGEND_IN * -(-names // _NAMES_A_LINE)


def _legend(figure: Figure, handles: list[Artist], labels: list[str]) -> None:
    figure.legend(handles, labels, loc="lower center", ncols=_NAMES_A_LINE, fontsize=8)
