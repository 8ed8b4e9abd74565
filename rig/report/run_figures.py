"""Figures of a run: force, contact, and receptor responses according to the finger model."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, MaxNLocator
from numpy.typing import NDArray

from rig.data import Run
from rig.data.tables import Span, spans
from rig.plan.finger_model import PredictedHold, by_group, measured
from rig.records import SAME_DECIMALS
from rig.report.page_parts import ZoomBand, ZoomChart, ZoomLine
from rig.report.run_tables import Condition, DeliveredPress, conditions, loading, past_touch
from rig.report.style import (
    BLUE,
    DOTTED,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    YELLOW,
    Plot,
    Room,
    label,
    position_scale,
    row_title,
    shade,
    shade_of,
    signed,
    unit,
    wrapped,
)
from sim.contact.indentor import BOTH, Indentor, Revolved
from sim.contact.patch import X, Z
from sim.measures.measures import shown
from sim.models.result import IndentationResult
from sim.units import GWT_N

Array = NDArray[np.float64]

CONTACTS_A_PAGE = 12
_CONTACT_COLUMNS = 4
_LEFT_IN, _WIDE_IN, _GAP_IN = 0.75, 2.25, 0.12
_TITLE_IN, _SKIN_IN, _PRESSURE_IN, _AXIS_IN = 0.36, 0.9, 0.7, 0.5
_CONTACT_ROW_IN = _TITLE_IN + _SKIN_IN + _PRESSURE_IN
_DRAWN = 361
_ROOM_MM = 0.2
"""Margin between the contact and the edges of its panel (mm)."""
_HIGHEST_MM = 1.3
"""Height above the lowest point (mm) up to which an indentor is plotted."""


def contact_panels(found: Sequence[Sequence[PredictedHold]], top: float) -> Plot:
    """Plot a panel per condition with its repeats superimposed; all pressure axes reach `top` (kPa)."""
    rows = -(-len(found) // _CONTACT_COLUMNS)
    columns = min(len(found), _CONTACT_COLUMNS)
    size = (_LEFT_IN + columns * (_WIDE_IN + _GAP_IN), rows * _CONTACT_ROW_IN + _AXIS_IN)
    return Plot(size, lambda figure: _contact_panels(figure, found, top), layout=None)


def highest_pressure(found: Sequence[PredictedHold]) -> float:
    """Return the highest pressure in the receptor plane (kPa)."""
    return max((float(r.result.pressure_profile_kpa[1].max()) for r in found), default=0.0) or 1.0


def lateral_mm(found: Sequence[IndentationResult]) -> tuple[float, float]:
    """Return the left and right end of panels that hold all skin, indentors from above at its places (mm)."""
    x = np.concatenate([part for result in found for part in (result.skin_profile[0], result.pressure_profile[0])])
    return float(x.min()) - _ROOM_MM, float(x.max()) + _ROOM_MM


def heights_mm(found: Sequence[IndentationResult]) -> tuple[float, float]:
    """Return the bottom and top of panels that hold all skin and the lower part of the indentors (mm)."""
    lowest = [min(float(r.skin_profile[1].min()), _lowest_mm(r)) for r in found]
    highest = [max(float(r.skin_profile[1].max()), _lowest_mm(r) + _HIGHEST_MM) for r in found]
    return min(lowest) - _ROOM_MM, max(highest) + _ROOM_MM


def _lowest_mm(result: IndentationResult) -> float:
    return result.touch_height_mm - result.doi_mm


def _contact_panels(figure: Figure, found: Sequence[Sequence[PredictedHold]], top: float) -> None:
    scale = [tick for tick in MaxNLocator(3).tick_values(0, top) if 0 <= tick <= 1.02 * top]
    results = [one.result for repeats in found for one in repeats]
    across, heights = lateral_mm(results), heights_mm(results)
    for k, repeats in enumerate(found):
        above = _axes(figure, k, _TITLE_IN + _SKIN_IN, _SKIN_IN)
        below = _axes(figure, k, _CONTACT_ROW_IN, _PRESSURE_IN)
        _skin(above, repeats, across)
        _pressures(below, repeats)
        below.hlines(scale, *across, color=GREY, lw=0.3, alpha=0.5)
        above.set(xlim=across, ylim=heights, xticks=())
        below.set(xlim=across, ylim=(0, 1.08 * top))
        _scales(above, below, scale, first=k % _CONTACT_COLUMNS == 0, lowest=k + _CONTACT_COLUMNS >= len(found))


def _scales(above: Axes, below: Axes, scale: Sequence[float], *, first: bool, lowest: bool) -> None:
    """Label the outer panels only, since ticks are slow to plot."""
    above.set_yticks(_inside(above.get_ylim()) if first else ())
    below.set_yticks(scale if first else ())
    below.set_xticks(_inside(below.get_xlim()) if lowest else ())
    for axes, name in ((above, "height (mm)"), (below, "pressure\n(kPa)")):
        axes.set_ylabel(name if first else "", fontsize=8)
        axes.tick_params(labelsize=7, length=2)
    below.set_xlabel("lateral x (mm)" if lowest else "", fontsize=8)


def _inside(limits: tuple[float, float]) -> list[float]:
    """Return a few round ticks within limits."""
    return [tick for tick in MaxNLocator(4).tick_values(*limits) if limits[0] <= tick <= limits[1]]


def _axes(figure: Figure, k: int, below_in: float, high_in: float) -> Axes:
    """Return axes in panel k, `high_in` high, with their lower edge `below_in` below the row's upper edge."""
    width, height = figure.get_size_inches()
    row, column = divmod(k, _CONTACT_COLUMNS)
    left, bottom = _LEFT_IN + column * (_WIDE_IN + _GAP_IN), height - row * _CONTACT_ROW_IN - below_in
    return figure.add_axes((left / width, bottom / height, _WIDE_IN / width, high_in / height))


def _skin(axes: Axes, repeats: Sequence[PredictedHold], across: tuple[float, float]) -> None:
    """Plot the skin of all repeats, and the first one's indentor and contact."""
    for response in repeats:
        axes.plot(*response.result.skin_profile, color=GREY, lw=1)
    result = repeats[0].result
    (x, y), (undeformed, _) = result.skin_profile, result.pressure_profile
    s = np.linspace(*across, _DRAWN)
    offset = {X: s - result.x_mm, Z: np.full_like(s, result.model.plane_mm - result.z_mm)}
    h = result.indentor.evaluate(np.stack([offset[axis] for axis in result.indentor.axes])).height_mm
    height = _lowest_mm(result) + np.minimum(h, _HIGHEST_MM)
    low = np.r_[False, h < _HIGHEST_MM, False]
    seen = low[1:-1] | low[:-2] | low[2:]  # with the next point, so that both of its sides are drawn
    axes.plot(s, np.where(seen, height, np.nan), color="black", lw=1.2)
    for low, high in result.contact_regions_mm:  # ends of regions lie between nodes
        at = np.r_[low, undeformed[(undeformed > low) & (undeformed < high)], high]
        touching = (np.interp(at, undeformed, x), np.interp(at, undeformed, y))
        axes.plot(*touching, color=ORANGE, lw=4, solid_capstyle="butt", alpha=0.8)
    axes.set_title(_title(repeats), fontsize=7.5, y=1.02, pad=0)


def _pressures(axes: Axes, repeats: Sequence[PredictedHold]) -> None:
    for response in repeats:
        axes.plot(*response.result.pressure_profile_kpa, color=BLUE, lw=0.8)
    undeformed, pressure = repeats[0].result.pressure_profile_kpa
    for low, high in repeats[0].result.contact_regions_mm:  # nodes beyond it share the force of a point between nodes
        x = np.r_[low, undeformed[(undeformed > low) & (undeformed < high)], high]
        axes.fill_between(x, np.interp(x, undeformed, pressure), color=BLUE, alpha=0.25, lw=0)


def _title(repeats: Sequence[PredictedHold]) -> str:
    force, doi = ([r.hold[key] for r in repeats] for key in ("force_gwt", "doi_mm"))
    times = f"{len(repeats)} times, " if len(repeats) > 1 else ""
    return f"x = {signed(repeats[0].hold['x_mm'])} mm\n{times}{np.mean(force):.2f} gwt, DOI {np.mean(doi):.3f} mm"


PICTURES_A_PAGE = 6
_PICTURE_COLUMNS = 3
_CONTOURS_MM = (0.02, 0.1, 0.2, 0.3, 0.4)  # height above the lowest point that the skin can still reach
_RELIEF_STEPS = 181
_TITLE_WIDTH = 46


def is_relief(indentor: Indentor) -> bool:
    """Return whether a shape is neither round nor prismatic, so that one section cannot show it."""
    return indentor.axes == BOTH and not isinstance(indentor, Revolved)


def contacts_from_below(found: Sequence[IndentationResult], titles: Sequence[str]) -> Plot:
    """Plot each contact from below, with the fingertip upwards."""
    rows, columns = -(-len(found) // _PICTURE_COLUMNS), min(len(found), _PICTURE_COLUMNS)
    return Plot((0.4 + 3.2 * columns, 0.3 + 3.0 * rows), lambda figure: _draw(figure, found, titles))


def _draw(figure: Figure, found: Sequence[IndentationResult], titles: Sequence[str]) -> None:
    columns = min(len(found), _PICTURE_COLUMNS)
    panels = figure.subplots(-(-len(found) // columns), columns, squeeze=False)
    top = max(result.peak_pressure_kpa for result in found) or 1.0
    for axes in panels.ravel()[len(found) :]:
        axes.set_visible(False)
    for axes, result, title in zip(panels.ravel(), found, titles, strict=False):
        drawn = _panel(axes, result, top)
        axes.set_title(wrapped(title, _TITLE_WIDTH), fontsize=8)
    for axes in panels[:, 0]:
        axes.set_ylabel("along the finger, z (mm)")
    for axes in panels.ravel()[: len(found)]:
        axes.set_xlabel("lateral x (mm)")
    figure.colorbar(drawn, ax=panels, label="pressure (kPa)", shrink=0.8)


def _panel(axes: Axes, result: IndentationResult, top: float) -> QuadMesh:
    patch = result.model.patch
    x, z = (patch.position_mm[:, axis].reshape(patch.shape) for axis in (X, Z))
    pressure = result.kpa_per_pseudo * result.nodal_pressure_pseudo.reshape(patch.shape)
    drawn = axes.pcolormesh(x, z, pressure, shading="gouraud", cmap="Blues", vmin=0, vmax=top, rasterized=True)
    _relief(axes, result)
    at = result.state.held.on(patch).interpolate(patch.position_mm.T)
    axes.plot(at[X], at[Z], ".", ms=2, color=ORANGE)
    plane_mm = result.model.plane_mm
    axes.axhline(plane_mm, color=BLUE, lw=0.8, ls=DOTTED)
    axes.set(xlim=(x.min(), x.max()), ylim=(z.min(), z.max()), aspect="equal")
    return drawn


def _relief(axes: Axes, result: IndentationResult) -> None:
    """Plot height contours of the indentor."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    x, z = np.meshgrid(np.linspace(left, right, _RELIEF_STEPS), np.linspace(low, high, _RELIEF_STEPS))
    offset = {X: x.ravel() - result.x_mm, Z: z.ravel() - result.z_mm}
    height = result.indentor.evaluate(np.stack([offset[axis] for axis in result.indentor.axes])).height_mm
    if height.max() > _CONTOURS_MM[0]:
        axes.contour(x, z, height.reshape(x.shape), levels=_CONTOURS_MM, colors=GREY, linewidths=0.6)


PHASES = {
    "approach": YELLOW,
    "touch-off": PURPLE,
    "press and seek": ORANGE,
    "hold": BLUE,
    "lift": GREEN,
}
"""Phases with a color of their own in the strip; all others are white."""

GROUPS_A_PAGE = 2

SAMPLES = ("sample", "precondition_sample", "reference_sample", "find_sample")
_MINUTES_FROM_S = 600.0
_LONG_GAP = 0.1
"""Time between the parts of a run, relative to its duration, from which the axis is cut."""
_GAP_WIDTH, _TICKS = 0.07, 8
"""Width of each cut relative to the duration of the run, and number of ticks."""
_WIDTH_IN = 9.6
_ROW_IN = 2.4
_TITLES_IN = 0.45
"""Height of a title of two lines above the first row."""
_LEAST_RELATIVE = 0.1
"""Half-height of the panel of relative forces: less would magnify the steps of the readings."""
_LEAST_SD_GWT = 0.05
"""Least height of the panel of standard deviations: less would magnify the steps of the readings."""

_NEAR = 2.5  # multiple of the readings; a higher trip limit would flatten their plot


def force_time(run: Run) -> Plot:
    """Plot force over the whole run, above a strip of its phases."""
    return Plot((_WIDTH_IN, 3.2), lambda figure: _force_time(figure, run), layout=None)


def delivered_presses(found: Sequence[DeliveredPress]) -> Plot:
    """Plot the delivered and commanded quantity of each press, above their difference and its tolerance."""
    columns = len({one.key for one in found})
    return Plot((_WIDTH_IN, 3.4), lambda figure: _delivered(figure, found, columns), layout=None)


Groups = Mapping[str, list[Condition]]
"""Conditions under the label that they share."""


def presses(run: Run, groups: Groups) -> Plot:
    """Plot force from the start of each press, and force in its holds relative to their start."""
    height = 0.5 + _ROW_IN * len(groups)
    return Plot((_WIDTH_IN, height), lambda figure: _presses(figure, groups, run), layout=None)


def force_depth(run: Run, groups: Groups) -> Plot:
    """Plot the mean force of each condition against depth, and the spread of its repeats if there are any."""
    height, spread = 0.5 + _ROW_IN * len(groups), has_repeats(run)
    width = _WIDTH_IN if spread else 0.55 * _WIDTH_IN
    return Plot((width, height), lambda figure: _force_depth(figure, groups, run, spread), layout=None)


def has_repeats(run: Run) -> bool:
    """Return whether a condition was pressed more than once, so that repeats have a spread."""
    return any(len(condition.indices) > 1 for condition in conditions(run))


_NAMES = {"force_gwt": ("force", "gwt"), "doi_mm": ("DOI", "mm")}
_MANY = 60
"""Number of presses above which markers are small."""


_MOST_POINTS_OF_A_CHART = 100_000
_TIME_DECIMALS, _FORCE_DECIMALS = 3, 4


def force_charts(run: Run) -> tuple[ZoomChart, ...]:
    """Return force against time with the phases, a chart for each part of the run."""
    charts = (_force_chart(run, *part) for part in run.parts or [(run.start["t_s"], run.end_s)])
    return tuple(one for one in charts if one is not None)


def _force_chart(run: Run, begin_s: float, end_s: float) -> ZoomChart | None:
    colors = {"data": BLUE, "presses that are not data": GREY}
    readings: dict[str, list[dict[str, Any]]] = {name: [] for name in colors}
    for stream in SAMPLES:
        name = "data" if stream == "sample" else "presses that are not data"
        readings[name] += [one for one in run.stream(stream) if begin_s <= one["t_s"] <= end_s]
    read = {name: sorted(found, key=lambda one: one["t_s"]) for name, found in readings.items() if found}
    if not read:
        return None
    curves = {name: _gapless(*broken(found, run, _MOST_POINTS_OF_A_CHART)) for name, found in read.items()}
    t = np.concatenate([curve[0] for curve in curves.values()])
    order, first = np.argsort(t, kind="stable"), 0
    lines = []
    for name, (_, force) in curves.items():
        y = np.full(len(t), np.nan)
        y[first : first + len(force)] = force
        first += len(force)
        lines.append(ZoomLine(name, colors[name], _or_none(y[order], _FORCE_DECIMALS)))
    there = [one for one in spans(run) if begin_s <= one.begin_s < one.end_s <= end_s]
    bands = [
        ZoomBand(what, color, [(one.begin_s, one.end_s) for one in there if one.what == what])
        for what, color in PHASES.items()
    ]
    x = t[order].round(_TIME_DECIMALS).tolist()
    return ZoomChart("time since the start of the run (s)", "force (gwt)", x, tuple(lines), tuple(bands))


def _gapless(t: Array, force: Array) -> tuple[Array, Array]:
    """Return times without gaps: a gap is at the time of the reading after it."""
    missing = np.flatnonzero(np.isnan(t))
    t = t.copy()
    t[missing] = t[missing + 1]
    return t, force


def _or_none(values: Array, decimals: int) -> list[float | None]:
    return [None if math.isnan(value) else value for value in values.round(decimals).tolist()]


def _delivered(figure: Figure, found: Sequence[DeliveredPress], columns: int) -> None:
    room = Room(left=0.9, bottom=0.85, top=0.1, columns=0.9, rows=0.12)
    panels = room.panels(figure, 2, columns, sharex="col", height_ratios=(3, 2))
    kinds = [key for key in _NAMES if any(one.key == key for one in found)]
    handles: dict[str, Artist] = {}
    for key, (above, below) in zip(kinds, panels.T, strict=True):
        mine, (name, unit_) = [one for one in found if one.key == key], _NAMES[key]
        index, asked, got, sd, allowed = (
            np.array([getattr(one, field) for one in mine], dtype=float)
            for field in ("index", "asked", "delivered", "sd", "tolerance")
        )
        size, within = (3 if len(mine) < _MANY else 1.5), np.array([one.is_within for one in mine])
        ends = np.column_stack([index - 0.45, index + 0.45, np.full(len(index), np.nan)]).ravel()
        above.plot(ends, np.repeat(asked, 3), color="black", lw=1.2, label="asked")
        edges, widths = np.column_stack([index - 0.5, index + 0.5]).ravel(), np.repeat(allowed, 2)
        below.fill_between(edges, -widths, widths, color=GREEN, alpha=0.3, lw=0, label="tolerance")
        below.axhline(0.0, color="black", lw=0.8)
        for kept, color, words in ((within, BLUE, "delivered"), (~within, ORANGE, "delivered outside the tolerance")):
            if kept.any():
                above.plot(index[kept], got[kept], "o", ms=size, color=color, label=words)
                below.errorbar(index[kept], (got - asked)[kept], sd[kept], fmt="o", ms=size, lw=0.8, color=color)
        above.set(ylabel=f"{name} ({unit_})", ylim=(0, 1.1 * max(asked.max(), got.max())))
        reach = 1.15 * max(np.abs(got - asked + sd).max(), np.abs(got - asked - sd).max(), allowed.max(), 1e-9)
        below.set(ylabel=f"difference ({unit_})", xlabel="press, by index (1)", ylim=(-reach, reach))
        below.set_xlim(index.min() - 0.6, index.max() + 0.6)
        below.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        for axes in (above, below):
            handles |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    figure.legend(list(handles.values()), list(handles), loc="lower center", ncols=_NAMES_A_LINE, fontsize=8)


def _force_time(figure: Figure, run: Run) -> None:
    room = Room(bottom=0.8, top=0.1, rows=0.06)
    above, below = room.panels(figure, 2, 1, sharex=True, height_ratios=(8, 1)).ravel()
    per, unit = (60.0, "min") if run.duration_s > _MINUTES_FROM_S else (1.0, "s")
    for stream in SAMPLES:
        read = run.stream(stream)
        if read:
            t, force = broken(read, run)
            above.plot(t / per, force, lw=0.9, color=BLUE if stream == "sample" else GREY)
    _trip(above, run)
    above.set(ylabel="force (gwt)", xlim=(run.start["t_s"] / per, run.end_s / per))
    _strip(below, spans(run), per)
    _cut(above, below, run, per)
    below.set(xlabel=f"time since the start of the run ({unit})", yticks=[], ylim=(0, 1))
    handles = [Patch(color=color) for color in PHASES.values()]
    figure.legend(handles, list(PHASES), loc="lower center", ncols=len(PHASES), fontsize=8)


def _cut(above: Axes, below: Axes, run: Run, per: float) -> None:
    """Compress the time between the parts of a run, if it is long, and label it with its duration."""
    if run.end_s - run.start["t_s"] < (1 + _LONG_GAP) * run.duration_s:
        return
    edges_s = np.array(run.parts).ravel()
    widths = np.diff(edges_s)
    widths[1::2] = _GAP_WIDTH * run.duration_s
    edges, shown_at = edges_s / per, np.concatenate([[0.0], np.cumsum(widths)]) / per

    def position(time: Array) -> Array:
        return np.interp(time, edges, shown_at)

    def time(position: Array) -> Array:
        return np.interp(position, shown_at, edges)

    below.set_xscale("function", functions=(position, time))
    ticks: list[float] = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        steps = MaxNLocator(max(round(_TICKS * (end - begin) * per / run.duration_s), 1)).tick_values(begin, end)
        ticks += [tick for tick in steps if begin <= tick <= end]
    for axes in (above, below):
        axes.xaxis.set_major_locator(FixedLocator(ticks))
        axes.xaxis.set_major_formatter(lambda tick, _: f"{tick:.10g}")
        for end, begin in zip(edges[1:-1:2], edges[2::2], strict=True):
            axes.axvspan(end, begin, facecolor="none", edgecolor=GREY, hatch="////", lw=0)
    for end, begin in zip(edges[1:-1:2], edges[2::2], strict=True):
        above.text(
            0.5 * (end + begin), 0.5, shown_duration((begin - end) * per), rotation=90, ha="center", va="center",
            fontsize=8, transform=above.get_xaxis_transform(), bbox={"fc": "white", "ec": "none", "pad": 1},
        )  # fmt: skip


def shown_duration(seconds: float) -> str:
    """Return a duration in its two largest units, such as "1 d 3 h"."""
    left, parts = round(seconds), []
    for unit_s, name in ((86400, "d"), (3600, "h"), (60, "min"), (1, "s")):
        number, left = divmod(left, unit_s)
        parts += [f"{number} {name}"] if number else []
    return " ".join(parts[:2]) or "0 s"


def _trip(axes: Axes, run: Run) -> None:
    trip_gwt = run.start["soft_trip_n"] / GWT_N if "soft_trip_n" in run.start else math.inf
    if trip_gwt < _NEAR * axes.get_ylim()[1]:
        axes.axhline(trip_gwt, color=GREY, lw=0.8, ls="--")
        axes.text(
            1.0,
            trip_gwt,
            f"soft trip {trip_gwt:.2f} gwt",
            transform=axes.get_yaxis_transform(),
            ha="right",
            va="bottom",
            fontsize=8,
        )


def _strip(axes: Axes, found: Sequence[Span], per: float) -> None:
    merged: dict[str, list[tuple[float, float]]] = {what: [] for what in PHASES}
    for span in (one for one in found if one.what in merged and one.end_s > one.begin_s):
        mine = merged[span.what]
        begin_s = mine.pop()[0] if mine and mine[-1][1] == span.begin_s else span.begin_s  # seams would be lighter
        mine.append((begin_s, span.end_s))
    for what, color in PHASES.items():
        bars = [(begin_s / per, (end_s - begin_s) / per) for begin_s, end_s in merged[what]]
        axes.broken_barh(bars, (0, 1), color=color, lw=0)


_MOST_POINTS = 20_000
"""Points of a line, several for each dot of a printed page."""


def broken(samples: Iterable[dict[str, Any]], run: Run, most: int = _MOST_POINTS) -> tuple[Array, Array]:
    """Return times and forces with a gap between indentations, and where the run was resumed."""
    rows = ((sample["index"], sample["t_s"], _force_gwt(sample)) for sample in samples)
    index, t, force = np.fromiter(rows, dtype=np.dtype((float, 3))).reshape(-1, 3).T
    part = np.searchsorted([begin_s for begin_s, _ in run.parts[1:]], t, side="right")
    at = np.flatnonzero((np.diff(index) != 0) | (np.diff(part) != 0)) + 1
    return _thinned(np.insert(t, at, np.nan), np.insert(force, at, np.nan), most)


def _force_gwt(sample: dict[str, Any]) -> float:
    return math.nan if sample["force_gwt"] is None else float(sample["force_gwt"])


def _thinned(t: Array, y: Array, most: int = _MOST_POINTS) -> tuple[Array, Array]:
    """Return the gaps of a long line, and the lowest and highest point of each of many equal pieces."""
    each = -(-2 * len(t) // most)
    if each <= 2:
        return t, y
    begins = np.arange(0, len(t), each)
    pieces = np.append(y, np.full(-len(y) % each, np.nan)).reshape(-1, each)
    low, high = (np.argmin(np.where(np.isnan(pieces), np.inf, sign * pieces), axis=1) for sign in (1, -1))
    kept = np.unique(np.concatenate([begins + low, begins + high, np.flatnonzero(np.isnan(y))]))
    return t[kept], y[kept]


def _presses(figure: Figure, groups: Groups, run: Run) -> None:
    panels = _panels(figure, len(groups))
    for (name, members), (left, right) in zip(groups.items(), panels, strict=True):
        xs = [condition.x_mm for condition in members]
        for condition in members:
            for index in condition.indices:
                color, readings = shade_of(condition.x_mm, xs), run.readings_of(index)
                left.plot(*_thinned(*_since_press(readings)), lw=0.8, color=color)
                for t, ratio in _in_holds(readings):
                    right.plot(*_thinned(t, ratio), lw=0.8, color=color)
        left.set(ylabel="force (gwt)", xlabel="time since the start of the press (s)")
        row_title(left, name)
        low, high = right.get_ylim()
        right.set_ylim(min(low, 1 - _LEAST_RELATIVE), max(high, 1 + _LEAST_RELATIVE))
        right.set(ylabel="force relative to first (1)", xlabel="time in the hold (s)")
        position_scale(right, xs)


def _since_press(samples: Sequence[dict[str, Any]]) -> tuple[Array, Array]:
    mine = past_touch(samples)
    t = np.array([s["t_s"] for s in mine], dtype=float)
    return t - t[:1], np.array([s["force_gwt"] for s in mine], dtype=float)


def _in_holds(samples: Sequence[dict[str, Any]]) -> list[tuple[Array, Array]]:
    """Return, for each hold, times from its first reading and forces relative to it."""
    held = np.array([s["phase"] == "hold" for s in samples], dtype=bool)
    t, force = (np.array([s[key] for s in samples], dtype=float) for key in ("t_s", "force_gwt"))
    edges = np.flatnonzero(np.diff(np.r_[False, held, False].astype(int)))
    parts = zip(edges[::2], edges[1::2], strict=True)
    return [(t[a:b] - t[a], force[a:b] / force[a]) for a, b in parts if force[a] > 0]


def _force_depth(figure: Figure, groups: Groups, run: Run, spread: bool) -> None:
    panels = _panels(figure, len(groups), 2 if spread else 1)
    for (name, members), (left, *right) in zip(groups.items(), panels, strict=True):
        xs = [condition.x_mm for condition in members]
        for condition in members:
            found, color = loading(condition, run), shade_of(condition.x_mm, xs)
            if found is not None:
                left.plot(found.doi_mm, found.mean_gwt, lw=1, color=color)
                for axes in right:
                    axes.plot(found.doi_mm, found.sd_gwt, lw=1, color=color)
        left.set(ylabel="mean force (gwt)", xlabel="depth of indentation (mm)")
        row_title(left, name)
        for axes in right:
            axes.set(ylabel="sd over repeats (gwt)", xlabel="depth of indentation (mm)")
            axes.set_ylim(-0.05 * _LEAST_SD_GWT, max(axes.get_ylim()[1], _LEAST_SD_GWT))
            if all(len(condition.indices) == 1 for condition in members):
                axes.text(0.5, 0.5, "no repeats, hence no spread", transform=axes.transAxes, ha="center", color=GREY)
                axes.set(xticks=(), yticks=())
        position_scale([left, *right][-1], xs)


def _panels(figure: Figure, rows: int, columns: int = 2) -> Any:
    """Return (rows, columns) axes with room for a scale of positions beside them."""
    return Room(right=1.0, top=_TITLES_IN, columns=0.8, rows=0.85).panels(figure, rows, columns)


_LEGEND_IN = 0.2  # height of one line of a legend
_NAMES_A_LINE = 4
_HANDLE_IN, _CHARACTER_IN = 0.6, 0.07
"""Width of a line of a legend beside its name, and of a character of the name."""


def population_responses(found: list[PredictedHold]) -> Plot:
    """Plot ep1 and SED at all receptors, one line for each indentor position; a row for each depth or force."""
    height = 0.3 + 2.9 * len(by_group(found)) if has_moved(found) else 3.6
    return Plot((9.6, height), lambda figure: _population(figure, found), layout=None)


def has_moved(found: Sequence[PredictedHold]) -> bool:
    """Return whether the indentor pressed at several positions."""
    return len({response.hold["x_mm"] for response in found}) > 1


def ssrps(found: list[PredictedHold], measure: str) -> Plot:
    """Plot the measure at each receptor against the indentor's position."""
    return Plot((10.2, 4.8), lambda figure: _ssrps(figure, found, measure), layout=None)


def _population(figure: Figure, found: list[PredictedHold]) -> None:
    """Plot lines colored by position if the indentor moved, else by commanded depth or force."""
    groups = by_group(found)
    if has_moved(found):
        room = Room(left=0.75, right=0.9, top=_TITLES_IN, columns=0.9, rows=0.85)
        panels = room.panels(figure, len(groups), 2)
        for row, (name, members) in zip(panels, groups.items(), strict=True):
            _population_row(row, [(response.hold["x_mm"], response) for response in members])
            row_title(row[0], name)
            position_scale(row[-1], [response.hold["x_mm"] for response in members])
        return
    lines = [(k, members[0]) for k, members in enumerate(groups.values())]
    (row,) = Room(0.75, bottom=0.6 + _legend_in(list(groups)), columns=0.9).panels(figure, 1, 2)
    _population_row(row, lines)
    _legend(figure, *row[0].get_legend_handles_labels())


def _population_row(panels: Sequence[Axes], lines: Sequence[tuple[float, PredictedHold]]) -> None:
    receptor_x, shades = lines[0][1].result.model.receptors.position_mm[:, 0], [value for value, _ in lines]
    for axes, measure in zip(panels, ("ep1", "sed"), strict=True):
        for value, response in lines:
            row = shown(measure, measured([response], measure)[1][0])
            axes.plot(receptor_x, row, "-o", ms=2.5, lw=1, color=shade_of(value, shades), label=response.group)
        axes.set(xlabel="receptor x (mm)", ylabel=f"{label(measure)} ({unit(measure)})")


def _ssrps(figure: Figure, found: list[PredictedHold], measure: str) -> None:
    """Plot one line for each indentor and commanded depth or force over its positions."""
    receptor_x = found[0].result.model.receptors.position_mm[:, 0]
    groups = {name: members for name, members in by_group(found).items() if len(members) > 1}
    columns = -(-len(receptor_x) // 2)
    room = Room(0.75, bottom=0.6 + _legend_in(list(groups)), columns=0.12, rows=0.35)
    panels = room.panels(figure, 2, columns, sharex=True, sharey=True)
    for k, (name, members) in enumerate(groups.items()):
        positions, values = _over_repeats(*measured(members, measure))
        for axes, column in zip(panels.ravel(), shown(measure, values).T, strict=False):
            axes.plot(positions, column, "-o", ms=2, lw=1, color=shade(k, len(groups)), label=name)
    for axes, x in zip(panels.ravel(), receptor_x, strict=False):
        axes.axvline(x, color=GREY, lw=0.8, ls=DOTTED)
        axes.set_title(f"receptor at {signed(x)} mm", fontsize=8)
    for axes in panels[-1]:
        axes.set_xlabel("indentor x (mm)")
    for axes in panels[:, 0]:
        axes.set_ylabel(f"{label(measure)} ({unit(measure)})")
    _legend(figure, *panels[0, 0].get_legend_handles_labels())


def _over_repeats(x_mm: Array, values: Array) -> tuple[Array, Array]:
    """Return each position once (n,), with the mean of its repeats (n, receptors)."""
    places, back = np.unique(x_mm.round(SAME_DECIMALS), return_inverse=True)
    return places, np.stack([values[back == k].mean(axis=0) for k in range(len(places))])


def _legend_in(names: Sequence[str]) -> float:
    """Return the height of a legend (in)."""
    return _LEGEND_IN * -(-len(names) // _columns(names))


def _columns(names: Sequence[str]) -> int:
    """Return the number of names that fit in one line of a legend."""
    widest_in = _HANDLE_IN + _CHARACTER_IN * max(len(name) for name in names)
    return min(max(int(_WIDTH_IN / widest_in), 1), _NAMES_A_LINE)


def _legend(figure: Figure, handles: list[Artist], labels: list[str]) -> None:
    figure.legend(handles, labels, loc="lower center", ncols=_columns(labels), fontsize=8)
