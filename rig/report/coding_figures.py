"""Figures of encoding and decoding."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from rig.report.measure_colors import color_of
from rig.report.style import BLUE, GREEN, GREY, ORANGE, Plot
from sim.coding.encoding import RATE_UNIT, Encoded
from sim.coding.operators import NAMES, ForwardOperator, ImpulseResponses, ShiftErrors
from sim.coding.point_spread import Judged
from sim.coding.raju_table_6_1 import Deformed

Array = NDArray[np.float64]


class DecodingPlot(NamedTuple):
    """Decoded pressures and the readings behind them; pseudo-units."""

    place_mm: Array  # (n,)
    pressure: Array  # (n,)
    band: tuple[Array, Array] | None  # (n,) lower and upper
    true: Array | None  # (n,)
    receptor_mm: Array  # (m,) in any order
    reading: Array  # (m,) as SED
    explained: Array  # (m,) SED under the decoded pressures


def decoded_figure(drawn: DecodingPlot) -> Plot:
    """Plot pressures above readings, against the position on the skin."""
    return Plot((6.0, 5.4), lambda figure: _draw_decoded(figure, drawn))


def _draw_decoded(figure: Figure, drawn: DecodingPlot) -> None:
    skin, energy = figure.subplots(2, sharex=True)
    if drawn.band is not None:
        skin.fill_between(drawn.place_mm, *drawn.band, color=BLUE, alpha=0.25, lw=0, label="90 % band")
    skin.plot(drawn.place_mm, drawn.pressure, ".-", color=BLUE, label="found")
    if drawn.true is not None:
        skin.plot(drawn.place_mm, drawn.true, color="black", ls="--", marker="x", ms=4, label="true")
    order = np.argsort(drawn.receptor_mm, kind="stable")
    energy.plot(drawn.receptor_mm[order], drawn.reading[order], ".", color=color_of("sed"), label="readings")
    energy.plot(drawn.receptor_mm[order], drawn.explained[order], color=GREY, lw=1, label="explained")
    skin.set_ylabel("pressure (pseudo-units)")
    energy.set(ylabel="SED (pseudo-units)", xlabel="position on the skin (mm)")
    skin.legend()
    energy.legend()


class EncodingPlot(NamedTuple):
    """Encoded pressures, and the finite-element result of the same press if available."""

    operator: ForwardOperator
    pressure: Array
    encoded: Encoded
    true: tuple[Array, Array] | None  # positions in mm and SED
    receptor: bool = False  # whether the rates are those of a receptor; else they repeat the SED


def encoding_figure(drawn: EncodingPlot) -> Plot:
    """Plot pressure, SED and, with a receptor, its rate against the position on the skin."""
    return Plot((6.0, 7.2 if drawn.receptor else 5.4), lambda figure: _draw_encoding(figure, drawn))


def _draw_encoding(figure: Figure, drawn: EncodingPlot) -> None:
    operator, encoded = drawn.operator, drawn.encoded
    panels = figure.subplots(3 if drawn.receptor else 2, sharex=True)
    skin, energy = panels[:2]
    ends = np.flatnonzero(np.diff(operator.place_mm) < 0) + 1  # lateral pressures come after the normal ones
    kinds = zip(np.split(operator.place_mm, ends), np.split(drawn.pressure, ends), strict=True)
    for (place, pressure), name, colour in zip(kinds, ("normal", "lateral"), (BLUE, ORANGE), strict=False):
        skin.plot(place, pressure, ".-", color=colour, label=name)
    skin.axhline(0, color=GREY, lw=0.6)
    energy.plot(operator.receptor_mm, encoded.sed, color=color_of("sed"), label=operator.name)
    if drawn.true is not None:
        energy.plot(*drawn.true, color=GREY, ls="--", label="finite elements")
    skin.set_ylabel("pressure (pseudo-units)")
    energy.set_ylabel(f"SED, {operator.energy} (pseudo-units)")
    for rates in panels[2:]:
        rates.plot(operator.receptor_mm, encoded.rate, ".-", color=GREEN)
        rates.set_ylabel(f"rate ({RATE_UNIT})")
        rates.set_ylim(
            bottom=-0.05 * max(rates.get_ylim()[1], _LEAST_RATE), top=max(rates.get_ylim()[1], _LEAST_RATE)
        )
    panels[-1].set_xlabel("position on the skin (mm)")
    skin.legend()
    energy.legend()


_LEAST_RATE = 1.0
"""Least height of a panel of rates: silent receptors have no negative rates."""

_MEANS = ("e11", "e22", "e12")
_IMPULSE_COLOURS = tuple(map(color_of, _MEANS))


class ImpulsePlot(NamedTuple):
    """Impulse responses in one kind of axes."""

    responses: ImpulseResponses
    errors: ShiftErrors


def impulse_figure(drawn: Mapping[str, ImpulsePlot]) -> Plot:
    """Plot one column for each kind of axes, by its name."""
    return Plot((4.6 * len(drawn), 8.4), lambda figure: _draw_impulse(figure, drawn))


def _draw_impulse(figure: Figure, drawn: Mapping[str, ImpulsePlot]) -> None:
    panels = figure.subplots(3, len(drawn), squeeze=False, sharey="row")
    for (response, spectrum, error), (name, (responses, errors)) in zip(panels.T, drawn.items(), strict=True):
        response.set_title(f"{name} axes")
        _responses(response, responses)
        _spectra(spectrum, responses)
        _errors(error, errors)
    panels[0, 0].set_ylabel("strain by load on one sample (1/pseudo-unit)")
    panels[1, 0].set_ylabel("amplitude over its maximum (1)")
    panels[2, 0].set_ylabel("relative L2 error of shifting (%)")
    for row in panels[:, 0]:
        row.legend()


def _responses(axes: Axes, responses: ImpulseResponses) -> None:
    for name, means, colour, values in zip(NAMES, _MEANS, _IMPULSE_COLOURS, responses.strain, strict=True):
        axes.plot(responses.sampling.place_mm, values, color=colour, label=f"{name} ({means})")
    axes.plot(responses.sampling.place_mm, -responses.strain[1], color=GREY, lw=0.8, ls="--", label="−g")
    axes.set_xlabel("position on the skin (mm)")


def _spectra(axes: Axes, responses: ImpulseResponses) -> None:
    frequency, amplitude = responses.spectra()
    for name, colour, values in zip(NAMES, _IMPULSE_COLOURS, amplitude, strict=True):
        axes.plot(frequency, values / values.max(), color=colour, label=name)
    axes.set_xlabel("spatial frequency (cycles/mm)")


def _errors(axes: Axes, errors: ShiftErrors) -> None:
    for means, colour, values in zip(_MEANS, _IMPULSE_COLOURS, errors.strain, strict=True):
        axes.plot(errors.place_mm, 100 * values, color=colour, label=means)
    axes.plot(errors.place_mm, 100 * errors.sed, color=color_of("sed"), label="SED")
    axes.set_xlabel("position of the load (mm)")


_LARGEST_MM = 0.5  # drawn displacement under the load


class PointSpreadPlot(NamedTuple):
    """Section through a receptor site, and the spread of SED under a point load."""

    deformed: Deformed
    judged: Judged


def point_spread_figure(drawn: PointSpreadPlot) -> Plot:
    """Plot the deformed mesh, SED over the skin, and SED against distance."""
    return Plot((10.2, 3.6), lambda figure: _draw_point_spread(figure, drawn))


def _draw_point_spread(figure: Figure, drawn: PointSpreadPlot) -> None:
    mesh, spread, fall = figure.subplots(1, 3)
    _mesh(mesh, drawn.deformed, drawn.judged.spread.load_mm)
    _spread(figure, spread, drawn.judged)
    _fall(fall, drawn.judged)


def _mesh(axes: Axes, section: Deformed, load_mm: Array) -> None:
    times = _LARGEST_MM / np.linalg.norm(section.moved_mm, axis=-1).max()
    closed = [
        np.concatenate([nodes, nodes[:1]]) for nodes in (section.at_mm, section.at_mm + times * section.moved_mm)
    ]
    axes.plot(*closed[0][:, 0].T, color=GREY, lw=0.8, ls="--")
    axes.add_collection(LineCollection([*closed[1].swapaxes(0, 1), *closed[1]], colors=BLUE, linewidths=0.3))
    x, y = load_mm[:2].tolist()
    axes.annotate("", (x, y), (x, y + 0.8), arrowprops={"arrowstyle": "->", "color": ORANGE})
    axes.set_ylim(top=y + 1.0)
    axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal", title=f"displacements × {times:.3g}")


def _spread(figure: Figure, axes: Axes, judged: Judged) -> None:
    x, _, z = judged.spread.sheet.skin_mm.T
    shown = axes.tricontourf(x, z, judged.spread.sed, levels=12, cmap="viridis")
    axes.plot(*judged.spread.load_mm[[0, 2]], "+", color="white")
    figure.colorbar(shown, ax=axes, label="SED (pseudo-units)")
    axes.set(xlabel="x (mm)", ylabel="z (mm)", aspect="equal", title=f"site {judged.spread.site.number}")


def _fall(axes: Axes, judged: Judged) -> None:
    distance = judged.spread.distance_mm
    axes.loglog(distance, judged.spread.sed, ".", ms=2, color=GREY, label="receptors")
    r = np.linspace(distance.min(), distance.max(), 60)
    for law, name, colour in ((judged.linear, "linear", BLUE), (judged.logarithmic, "logarithmic", ORANGE)):
        axes.loglog(r, law.at(r), color=colour, label=rf"{name}: $r^{{-{law.m:.2f}}}$")
    axes.set(xlabel="distance from the load (mm)", ylabel="SED (pseudo-units)")
    axes.legend()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


_COLOURS = (ORANGE, BLUE, GREEN)
_DECADES = np.linspace(-4.5, 0.0, 19)  # decades of error below the highest that get a contour
_ENDS = (
    ("o", "start", {"mfc": "white", "mec": GREY}),
    ("s", "end", {"mfc": GREY, "mec": GREY}),
    ("*", "true pressures", {"mfc": "white", "mec": "black", "ms": 11}),
)
_FIRST_MOVES = 14
_MARGIN = 0.15  # margin around a path, relative to its extent
_LOWEST = 1e-12


class ErrorSurface(NamedTuple):
    """Squared error as a function of two pressures."""

    first: Array  # (k,) values of the first, ascending
    second: Array  # (l,)
    error: Array  # (k, l)


def search_figure(surfaces: Mapping[str, ErrorSurface], paths: Mapping[str, Array], true: Array | None) -> Plot:
    """Plot a panel per surface with the (moves + 1, 2) paths over it, and the error of each move below."""
    return Plot((3.6 * len(surfaces), 6.4), lambda figure: _draw_search(figure, surfaces, paths, true))


def extents(path: Array) -> dict[str, tuple[Array, Array]]:
    """Return (2,) lowest and highest pressures by title: after the first move, and over the first few moves."""
    return {"valley": _about(path[1:]), "first moves": _about(path[1:_FIRST_MOVES])}


def _about(places: Array) -> tuple[Array, Array]:
    low, high = places.min(axis=0), places.max(axis=0)
    room = _MARGIN * max(float((high - low).max()), 1e-3 * float(np.abs(high).max()))
    return low - room, high + room


def _draw_search(
    figure: Figure, surfaces: Mapping[str, ErrorSurface], paths: Mapping[str, Array], true: Array | None
) -> None:
    panels = figure.subplot_mosaic([list(surfaces), ["left"] * len(surfaces)], height_ratios=[1.6, 1])
    for title, surface in surfaces.items():
        _surface(panels[title], surface)
        _ways(panels[title], paths, true)
        panels[title].set(title=title, xlim=surface.first[[0, -1]], ylim=surface.second[[0, -1]])
        panels[title].set_xlabel("first pressure (pseudo-units)")
    next(iter(panels.values())).set_ylabel("second pressure (pseudo-units)")
    _what_is_left(panels["left"], paths, true)


def _surface(axes: Axes, surface: ErrorSurface) -> None:
    decades = np.log10(np.maximum(surface.error / surface.error.max(), 10 ** _DECADES[0]))
    axes.contourf(surface.first, surface.second, decades.T, levels=_DECADES, cmap="Greys_r")
    axes.contour(surface.first, surface.second, decades.T, levels=_DECADES, colors="white", linewidths=0.3)


def _ways(axes: Axes, paths: Mapping[str, Array], true: Array | None) -> None:
    for (name, path), colour in zip(paths.items(), _COLOURS, strict=False):
        axes.plot(*path.T, ".-", color=colour, lw=0.9, ms=3, label=name)
        axes.plot(*path[0], "o", color="white", mec=colour)
        axes.plot(*path[-1], "s", color=colour, ms=5)
    axes.xaxis.set_major_locator(MaxNLocator(4))
    if true is not None:
        axes.plot(*true, "*", color="white", mec="black", ms=11)


def _what_is_left(axes: Axes, paths: Mapping[str, Array], true: Array | None) -> None:
    for (name, path), colour in zip(paths.items(), _COLOURS, strict=False):
        away = np.linalg.norm(path - (path[-1] if true is None else true), axis=1)
        axes.plot(np.arange(1, len(path) + 1), np.where(away > _LOWEST, away, np.nan), color=colour, label=name)
    axes.set(xscale="log", yscale="log", xlabel="position along the trajectory (1)")
    axes.set_ylabel(f"distance from {('the end' if true is None else 'the true pressures')} (pseudo-units)")
    handles, _ = axes.get_legend_handles_labels()
    handles += [Line2D([], [], ls="", marker=marker, label=name, **style) for marker, name, style in _ENDS]
    axes.legend(handles=handles if true is not None else handles[:-1])


class SheetPlot(NamedTuple):
    """Decoded pressures on a sheet of skin; pseudo-units."""

    x_mm: Array  # (n_x,)
    z_mm: Array  # (n_z,)
    pressure: Array  # (n_x, n_z)
    sd: Array  # (n_x, n_z)
    receptor_mm: Array  # (m, 2) x and z


def sheet_figure(drawn: SheetPlot) -> Plot:
    """Plot pressures and their standard deviation on one color scale, with the receptors."""
    return Plot((9.6, 4.2), lambda figure: _draw_sheet(figure, drawn))


def _draw_sheet(figure: Figure, drawn: SheetPlot) -> None:
    highest = max(float(drawn.pressure.max()), float(drawn.sd.max()))
    for axes, values, title in zip(
        figure.subplots(1, 2, sharey=True),
        (drawn.pressure, drawn.sd),
        ("pressure", "standard deviation"),
        strict=True,
    ):
        shown = axes.pcolormesh(drawn.z_mm, drawn.x_mm, values, vmin=0.0, vmax=highest, cmap="viridis")
        axes.plot(drawn.receptor_mm[:, 1], drawn.receptor_mm[:, 0], ".", color="white", ms=2)
        axes.set(title=title, xlabel="z (mm)", ylabel="x (mm)", aspect="equal")
        figure.colorbar(shown, ax=axes, label=f"{title} (pseudo-units)")
