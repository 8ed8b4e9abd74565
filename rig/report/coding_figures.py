"""Two pressures searched for: the error surface with its narrow valley, the ways over it, and where grids stick."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.report.style import BLUE, GREEN, GREY, ORANGE, Plot

Array = NDArray[np.float64]

_COLOURS = (ORANGE, BLUE, GREEN)
_DECADES = np.linspace(-4.5, 0.0, 19)  # of the error that are told apart, below its highest
_FIRST_MOVES = 14
_MARGIN = 0.15  # about a way, of its extent
_LOWEST = 1e-12


class Surface(NamedTuple):
    """Squared errors of two pressures."""

    first: Array  # (k,) values of the first, ascending
    second: Array  # (l,)
    error: Array  # (k, l)


def search_figure(surfaces: Mapping[str, Surface], paths: Mapping[str, Array], true: Array | None) -> Plot:
    """A panel for each surface, by title, with (moves + 1, 2) ways over it, by name; below, how far off moves are."""
    return Plot((3.6 * len(surfaces), 6.4), lambda figure: _draw(figure, surfaces, paths, true))


def extents(path: Array) -> dict[str, tuple[Array, Array]]:
    """(2,) lowest and highest pressures by title: of a way after its first move, and of its first few moves alone."""
    return {"its valley": _about(path[1:]), "the first moves": _about(path[1:_FIRST_MOVES])}


def _about(places: Array) -> tuple[Array, Array]:
    low, high = places.min(axis=0), places.max(axis=0)
    room = _MARGIN * max(float((high - low).max()), 1e-3 * float(np.abs(high).max()))
    return low - room, high + room


def _draw(figure: Figure, surfaces: Mapping[str, Surface], paths: Mapping[str, Array], true: Array | None) -> None:
    panels = figure.subplot_mosaic([list(surfaces), ["left"] * len(surfaces)], height_ratios=[1.6, 1])
    for title, surface in surfaces.items():
        _surface(panels[title], surface)
        _ways(panels[title], paths, true)
        panels[title].set(title=title, xlim=surface.first[[0, -1]], ylim=surface.second[[0, -1]])
        panels[title].set_xlabel("first pressure (pseudo-units)")
    next(iter(panels.values())).set_ylabel("second pressure (pseudo-units)")
    _what_is_left(panels["left"], paths, true)


def _surface(axes: Axes, surface: Surface) -> None:
    decades = np.log10(np.maximum(surface.error / surface.error.max(), 10 ** _DECADES[0]))
    axes.contourf(surface.first, surface.second, decades.T, levels=_DECADES, cmap="Greys_r")
    axes.contour(surface.first, surface.second, decades.T, levels=_DECADES, colors="white", linewidths=0.3)


def _ways(axes: Axes, paths: Mapping[str, Array], true: Array | None) -> None:
    for (name, path), colour in zip(paths.items(), _COLOURS, strict=False):
        axes.plot(*path.T, ".-", color=colour, lw=0.9, ms=3, label=name)
        axes.plot(*path[0], "o", color="white", mec=colour)
        axes.plot(*path[-1], "s", color=colour, ms=5)
    if true is not None:
        axes.plot(*true, "*", color="white", mec="black", ms=11)


def _what_is_left(axes: Axes, paths: Mapping[str, Array], true: Array | None) -> None:
    for (name, path), colour in zip(paths.items(), _COLOURS, strict=False):
        away = np.linalg.norm(path - (path[-1] if true is None else true), axis=1)
        axes.plot(np.arange(1, len(path) + 1), np.where(away > _LOWEST, away, np.nan), color=colour, label=name)
    axes.set(xscale="log", yscale="log", xlabel="place on the way")
    axes.set_ylabel(f"away from {'the end' if true is None else 'the truth'}")
    axes.legend()


def grid_figure(step: Array, error: Array, converged: float) -> Plot:
    """Eq. 6.8 of the source's search on (k,) grid steps, beside that of the search that needs no grid."""
    return Plot((5.2, 3.4), lambda figure: _draw_grid(figure.subplots(), step, error, converged))


def _draw_grid(axes: Axes, step: Array, error: Array, converged: float) -> None:
    axes.plot(step, error, "o-", color=BLUE, label="grid")
    axes.plot([], [], color=ORANGE, ls="--", label=f"exact along each coordinate: {converged:.1g}")
    if converged > error.min() / 10:
        axes.axhline(converged, color=ORANGE, ls="--")
    axes.axhline(0.1, color=GREY, lw=0.8, ls=":", label="10 %")
    axes.set(xscale="log", yscale="log", xlabel="grid step (pseudo-units)", ylabel="Σ(x − x̂)² / Σx² (Eq. 6.8)")
    axes.legend()
