"""Figures of encoding and decoding."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from rig.report.measure_colors import color_of
from rig.report.plot import Plot, Series, Subplot, entry, guide, handles, in_grid, rows_of
from rig.report.style import BLUE, GREEN, GREY, ORANGE
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
    place, order = drawn.place_mm, np.argsort(drawn.receptor_mm, kind="stable")
    receptor, reading, explained = (v[order] for v in (drawn.receptor_mm, drawn.reading, drawn.explained))
    skin = [Series("plot", place, drawn.pressure, ls="-", marker=".", color=BLUE, label="found",
                   rows=rows_of("decoded", "place_mm", "pressure"))]  # fmt: skip
    if drawn.band is not None:
        skin.insert(0, Series("fill_between", place, *drawn.band, color=BLUE, alpha=0.25, lw=0, label="90 % band",
                              rows=rows_of("decoded", "place_mm", "lowest", "highest")))  # fmt: skip
    if drawn.true is not None:
        skin.append(Series("plot", place, drawn.true, color="black", ls="--", marker="x", ms=4, label="true",
                           rows=rows_of("decoded", "place_mm", "true")))  # fmt: skip
    energy = [
        Series("plot", receptor, reading, ls="", marker=".", color=color_of("sed"), label="readings",
               rows=rows_of("decoded", "receptor_mm", "reading")),
        Series("plot", receptor, explained, color=GREY, lw=1, label="explained",
               rows=rows_of("decoded", "receptor_mm", "explained")),
    ]  # fmt: skip
    panels = [Subplot(_PLACE, _PRESSURE, skin, printed="y"), Subplot(_PLACE, _SED, energy)]
    return Plot((6.0, 5.4), panels, arrange=in_grid(2, sharex=True), finish=_with_legends)


_PLACE, _PRESSURE, _SED = "position on the skin (mm)", "pressure (pseudo-units)", "SED (pseudo-units)"


def _with_legends(figure: Figure, axes: list[Axes]) -> None:
    for one in axes:
        if one.get_legend_handles_labels()[1]:
            one.legend()


class EncodingPlot(NamedTuple):
    """Encoded pressures, and the finite-element result of the same press if available."""

    operator: ForwardOperator
    pressure: Array
    encoded: Encoded
    true: tuple[Array, Array] | None  # positions in mm and SED
    receptor: bool = False  # whether the rates are those of a receptor; else they repeat the SED


def encoding_figure(drawn: EncodingPlot) -> Plot:
    """Plot pressure, SED and, with a receptor, its rate against the position on the skin."""
    operator, encoded = drawn.operator, drawn.encoded
    ends = np.flatnonzero(np.diff(operator.place_mm) < 0) + 1  # lateral pressures come after the normal ones
    kinds = zip(np.split(operator.place_mm, ends), np.split(drawn.pressure, ends), strict=True)
    skin = [
        Series("plot", place, pressure, ls="-", marker=".", color=colour, label=name,
               rows=rows_of("encoded", "place_mm", name))
        for (place, pressure), name, colour in zip(kinds, ("normal", "lateral"), (BLUE, ORANGE), strict=False)
    ]  # fmt: skip
    energy = [Series("plot", operator.receptor_mm, encoded.sed, color=color_of("sed"), label=operator.name,
                     rows=rows_of("encoded", "receptor_mm", "sed"))]  # fmt: skip
    if drawn.true is not None:
        energy.append(Series("plot", *drawn.true, color=GREY, ls="--", label="finite elements",
                             rows=rows_of("encoded", "true_mm", "true_sed")))  # fmt: skip
    panels = [
        Subplot(_PLACE, _PRESSURE, [*skin, guide("axhline", 0, color=GREY, lw=0.6)], printed="y"),
        Subplot(_PLACE, f"SED, {operator.energy} (pseudo-units)", energy, printed="y" if drawn.receptor else "xy"),
    ]
    if drawn.receptor:
        rates = Series("plot", operator.receptor_mm, encoded.rate, ls="-", marker=".", color=GREEN,
                       rows=rows_of("encoded", "receptor_mm", "rate"))  # fmt: skip
        panels.append(Subplot(_PLACE, f"rate ({RATE_UNIT})", [rates]))

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for one in axes[2:]:
            top = max(one.get_ylim()[1], _LEAST_RATE)
            one.set_ylim(bottom=-0.05 * top, top=top)
        _with_legends(figure, axes)

    arrange = in_grid(len(panels), sharex=True)
    return Plot((6.0, 7.2 if drawn.receptor else 5.4), panels, arrange=arrange, finish=finish)


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
    columns = [_impulse_panels(name, one, "xy" if k == 0 else "x") for k, (name, one) in enumerate(drawn.items())]

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for row in axes[:: len(drawn)]:
            row.legend()

    panels = [panel for row in zip(*columns, strict=True) for panel in row]
    arrange = in_grid(len(panels), len(drawn), sharey="row")
    return Plot((4.6 * len(drawn), 9.0), panels, arrange=arrange, finish=finish)


def _impulse_panels(axes: str, drawn: ImpulsePlot, printed: str) -> tuple[Subplot, Subplot, Subplot]:
    responses, errors = drawn.responses, drawn.errors
    place, (frequency, amplitude) = responses.sampling.place_mm, responses.spectra()
    response = [
        Series("plot", place, values, color=colour, label=f"{name} ({means})",
               rows=rows_of("impulse", "place_mm", name, axes=axes))
        for name, means, colour, values in zip(NAMES, _MEANS, _IMPULSE_COLOURS, responses.strain, strict=True)
    ]  # fmt: skip
    response.append(Series("plot", place, -responses.strain[1], color=GREY, lw=0.8, ls="--", label="−g",
                           rows=rows_of("impulse", "place_mm", "-g", axes=axes)))  # fmt: skip
    spectrum = [
        Series("plot", frequency, values / values.max(), color=colour, label=name,
               rows=rows_of("impulse", "frequency", f"spectrum of {name}", axes=axes))
        for name, colour, values in zip(NAMES, _IMPULSE_COLOURS, amplitude, strict=True)
    ]  # fmt: skip
    error = [
        Series("plot", errors.place_mm, 100 * values, color=colour, label=means,
               rows=rows_of("impulse", "load_mm", f"error of {means}", axes=axes))
        for means, colour, values in zip(
            (*_MEANS, "SED"), (*_IMPULSE_COLOURS, color_of("sed")), (*errors.strain, errors.sed), strict=True
        )
    ]  # fmt: skip
    return (
        Subplot(_PLACE, "strain by load on one sample (1/pseudo-unit)", response, f"{axes} axes", printed),
        Subplot("spatial frequency (cycles/mm)", "amplitude over its maximum (1)", spectrum, printed=printed),
        Subplot("position of the load (mm)", "relative L2 error of shifting (%)", error, printed=printed),
    )


_LARGEST_MM = 0.5  # drawn displacement under the load


class PointSpreadPlot(NamedTuple):
    """Section through a receptor site, and the spread of SED under a point load."""

    deformed: Deformed
    judged: Judged


def point_spread_figure(drawn: PointSpreadPlot) -> Plot:
    """Plot the deformed mesh, SED over the skin, and SED against distance."""
    section, spread, load = drawn.deformed, drawn.judged.spread, drawn.judged.spread.load_mm
    times = _LARGEST_MM / np.linalg.norm(section.moved_mm, axis=-1).max()
    before, after = (
        np.concatenate([nodes, nodes[:1]]) for nodes in (section.at_mm, section.at_mm + times * section.moved_mm)
    )
    x, y = np.moveaxis(after, -1, 0)
    mesh = [
        Series("plot", *before[:, 0].T, color=GREY, lw=0.8, ls="--",
               rows=rows_of("deformed", "skin_x_mm", "skin_y_mm")),
        Series("plot", x, y, color=BLUE, lw=0.3, rows=rows_of("deformed", "x_mm", "y_mm")),
        Series("plot", x.T, y.T, color=BLUE, lw=0.3, rows=rows_of("deformed", "x_mm across", "y_mm across")),
    ]  # fmt: skip
    skin_x, _, skin_z = spread.sheet.skin_mm.T
    over = [
        Series("tricontourf", skin_x, skin_z, spread.sed, levels=12, cmap="viridis",
               rows=rows_of("point spread", "x_mm", "z_mm", "sed")),
        Series("plot", *load[[0, 2]], ls="", marker="+", color="white",
               rows=rows_of("point spread", "load_x", "load_z")),
    ]  # fmt: skip
    distance, laws = spread.distance_mm, (drawn.judged.linear, drawn.judged.logarithmic)
    r = np.linspace(distance.min(), distance.max(), 60)
    fall = [
        Series("loglog", distance, spread.sed, ls="", marker=".", ms=2, color=GREY, label="receptors",
               rows=rows_of("point spread", "distance_mm", "sed")),
        *(
            Series("loglog", r, law.at(r), color=colour, label=rf"{name}: $r^{{-{law.m:.2f}}}$",
                   rows=rows_of("point spread", "distance", name))
            for law, name, colour in zip(laws, ("linear", "logarithmic"), (BLUE, ORANGE), strict=True)
        ),
    ]  # fmt: skip

    def finish(figure: Figure, axes: list[Axes]) -> None:
        left, middle, right = axes
        x, y = load[:2].tolist()
        left.annotate("", (x, y), (x, y + 0.8), arrowprops={"arrowstyle": "->", "color": ORANGE})
        left.set_ylim(top=y + 1.0)
        left.set(aspect="equal")
        figure.colorbar(middle.collections[0], ax=middle, label=_SED)
        middle.set(aspect="equal")
        right.legend()
        right.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        _print_plain_numbers(right)

    panels = [
        Subplot("x (mm)", "y (mm)", mesh, f"displacements × {times:.3g}"),
        Subplot("x (mm)", "z (mm)", over, f"site {spread.site.number}", color=_SED),
        Subplot("distance from the load (mm)", _SED, fall),
    ]
    return Plot((10.2, 3.6), panels, arrange=in_grid(3, 3), finish=finish)


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
_MOST_TICKS = 8


def _print_plain_numbers(axes: Axes) -> None:
    """Print the ticks of logarithmic axes as numbers, not as powers of ten."""
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


class ErrorSurface(NamedTuple):
    """Squared error as a function of two pressures."""

    first: Array  # (k,) values of the first, ascending
    second: Array  # (l,)
    error: Array  # (k, l)


def search_figure(surfaces: Mapping[str, ErrorSurface], paths: Mapping[str, Array], true: Array | None) -> Plot:
    """Plot a panel per surface with the (moves + 1, 2) paths over it, and the error of each move below."""
    away = f"distance from\n{('the end' if true is None else 'the true pressures')} (pseudo-units)"
    ends = [entry(name, ls="", marker=marker, **style) for marker, name, style in _ENDS][
        : None if true is not None else -1
    ]

    def arrange(figure: Figure) -> list[Axes]:
        rows: Any = [list(surfaces), ["left"] * len(surfaces)]
        return list(figure.subplot_mosaic(rows, height_ratios=[1.6, 1]).values())

    def finish(figure: Figure, axes: list[Axes]) -> None:
        *maps, left = axes
        for one, surface in zip(maps, surfaces.values(), strict=True):
            one.xaxis.set_major_locator(MaxNLocator(4))
            one.set(xlim=surface.first[[0, -1]], ylim=surface.second[[0, -1]])
        left.set(xscale="log", yscale="log")
        for axis in (left.xaxis, left.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=_MOST_TICKS))
        _print_plain_numbers(left)
        left.legend(handles=[*left.get_legend_handles_labels()[0], *handles(ends)])

    panels = [
        Subplot("first pressure (pseudo-units)", "second pressure (pseudo-units)",
              [*_surface(title, surface), *_ways(paths, true)], title, printed="x" if k else "xy", is_part=True)
        for k, (title, surface) in enumerate(surfaces.items())
    ]  # fmt: skip
    panels.append(Subplot("position along the trajectory (1)", away, _what_is_left(paths, true)))
    return Plot((3.6 * len(surfaces), 6.4), panels, arrange=arrange, finish=finish, legend=ends)


def extents(path: Array) -> dict[str, tuple[Array, Array]]:
    """Return (2,) lowest and highest pressures by title: after the first move, and over the first few moves."""
    return {"valley": _about(path[1:]), "first moves": _about(path[1:_FIRST_MOVES])}


def _about(places: Array) -> tuple[Array, Array]:
    low, high = places.min(axis=0), places.max(axis=0)
    room = _MARGIN * max(float((high - low).max()), 1e-3 * float(np.abs(high).max()))
    return low - room, high + room


def _surface(title: str, surface: ErrorSurface) -> list[Series]:
    decades = np.log10(np.maximum(surface.error / surface.error.max(), 10 ** _DECADES[0])).T
    at = surface.first, surface.second
    rows = rows_of("error surface", "first", "second", "decades", surface=title)
    return [
        Series("contourf", *at, decades, levels=_DECADES, cmap="Greys_r", rows=rows),
        guide("contour", *at, decades, levels=_DECADES, colors="white", linewidths=0.3),
    ]


def _ways(paths: Mapping[str, Array], true: Array | None) -> list[Series]:
    series = []
    for (name, path), colour in zip(paths.items(), _COLOURS, strict=False):
        rows = rows_of("paths", "first", "second", path=name)
        series += [
            Series("plot", *path.T, ls="-", marker=".", color=colour, lw=0.9, ms=3, label=name, rows=rows),
            guide("plot", *path[0], ls="", marker="o", color="white", mec=colour),
            guide("plot", *path[-1], ls="", marker="s", color=colour, ms=5),
        ]
    return [
        *series,
        *([] if true is None else [guide("plot", *true, ls="", marker="*", color="white", mec="black", ms=11)]),
    ]


def _what_is_left(paths: Mapping[str, Array], true: Array | None) -> list[Series]:
    series = []
    for (name, path), colour in zip(paths.items(), _COLOURS, strict=False):
        away = np.linalg.norm(path - (path[-1] if true is None else true), axis=1)
        seen = np.where(away > _LOWEST, away, np.nan)
        rows = rows_of("paths", "move", "away", path=name)
        series.append(Series("plot", np.arange(1, len(path) + 1), seen, color=colour, label=name, rows=rows))
    return series


class SheetPlot(NamedTuple):
    """Decoded pressures on a sheet of skin; pseudo-units."""

    x_mm: Array  # (n_x,)
    z_mm: Array  # (n_z,)
    pressure: Array  # (n_x, n_z)
    sd: Array  # (n_x, n_z)
    receptor_mm: Array  # (m, 2) x and z


def sheet_figure(drawn: SheetPlot) -> Plot:
    """Plot pressures and their standard deviation on one color scale, with the receptors."""
    highest = max(float(drawn.pressure.max()), float(drawn.sd.max()))
    panels = [
        Subplot(
            "z (mm)",
            "x (mm)",
            [
                Series("pcolormesh", drawn.z_mm, drawn.x_mm, values, vmin=0.0, vmax=highest, cmap="viridis",
                       rows=rows_of("sheet", "z_mm", "x_mm", title)),
                Series("plot", *drawn.receptor_mm[:, ::-1].T, ls="", marker=".", color="white", ms=2,
                       rows=rows_of("sheet", "receptor_z_mm", "receptor_x_mm")),
            ],
            title, color=f"{title} (pseudo-units)",
        )
        for values, title in ((drawn.pressure, "pressure"), (drawn.sd, "standard deviation"))
    ]  # fmt: skip

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for one, panel in zip(axes, panels, strict=True):
            one.set(aspect="equal")
            figure.colorbar(one.collections[0], ax=one, label=panel.color)

    return Plot((9.6, 4.2), panels, arrange=in_grid(2, 2, sharey=True), finish=finish)
