"""Figures of a run: force, contact, and receptor responses according to the finger model."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, MaxNLocator
from numpy.typing import NDArray

from rig.data import Run
from rig.data.tables import Span, spans
from rig.plan.finger_model import PredictedHold, by_group, measured
from rig.records import SAME_DECIMALS
from rig.report.plot import (
    POSITIONS,
    Plot,
    Room,
    Series,
    Subplot,
    ZoomBand,
    ZoomChart,
    ZoomLine,
    guide,
    in_grid,
    position_scale,
    row_title,
    rows_of,
)
from rig.report.run_tables import SAMPLES, Condition, DeliveredPress, conditions, loading, past_touch
from rig.report.style import (
    BLUE,
    DOTTED,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    YELLOW,
    in_unit,
    label,
    shade,
    shade_of,
    signed,
    wrapped,
)
from sim.contact.indentor import BOTH, Indentor, Revolved
from sim.contact.patch import X, Z
from sim.measures.measures import BY_NAME, shown
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


def contact_panels(found: Sequence[Sequence[PredictedHold]], top: float, group: str = "") -> Plot:
    """Plot two panels per condition with its repeats superimposed; all pressure axes reach `top` (kPa)."""
    columns = min(len(found), _CONTACT_COLUMNS)
    results = [one.result for repeats in found for one in repeats]
    across, heights = lateral_mm(results), heights_mm(results)
    scale = [tick for tick in MaxNLocator(3).tick_values(0, top) if 0 <= tick <= 1.02 * top]
    panels = []
    for k, repeats in enumerate(found):
        y, x = ("y" if k % _CONTACT_COLUMNS == 0 else ""), ("x" if k + _CONTACT_COLUMNS >= len(found) else "")
        lines = guide("hlines", scale, *across, color=GREY, lw=0.3, alpha=0.5)
        panels += [
            Subplot(_LATERAL, "height (mm)", _skin(repeats, across), _title(repeats), printed=y),
            Subplot(_LATERAL, "pressure\n(kPa)", [*_pressures(repeats), lines], printed=x + y),
        ]

    def arrange(figure: Figure) -> Iterator[Axes]:
        for k in range(len(found)):
            yield _axes(figure, k, _TITLE_IN + _SKIN_IN, _SKIN_IN)
            yield _axes(figure, k, _CONTACT_ROW_IN, _PRESSURE_IN)

    def finish(figure: Figure, axes: list[Axes]) -> None:
        """Label ticks of the outer panels only, since they are slow to plot."""
        for above, below, panel in zip(axes[::2], axes[1::2], panels[1::2], strict=True):
            above.set(xlim=across, ylim=heights, xticks=())
            below.set(xlim=across, ylim=(0, 1.08 * top))
            above.set_yticks(_inside(above.get_ylim()) if "y" in panel.printed else ())
            below.set_yticks(scale if "y" in panel.printed else ())
            below.set_xticks(_inside(below.get_xlim()) if "x" in panel.printed else ())

    return Plot(
        (_LEFT_IN + columns * (_WIDE_IN + _GAP_IN), -(-len(found) // _CONTACT_COLUMNS) * _CONTACT_ROW_IN + _AXIS_IN),
        panels,
        f"Contact, {group}",
        "Black: the indentor. Gray: the deformed skin in the receptor plane. Orange: contact regions. Blue: nodal "
        "pressure against undeformed x, unfiltered, filled where the skin touches; a node beside a contact shares "
        "the force of its edge. Repeats are superimposed. The last hold of each indentation.",
        arrange=arrange, finish=finish, titles={"fontsize": 7.5, "y": 1.02, "pad": 0}, labels={"fontsize": 8},
        ticks={"labelsize": 7, "length": 2}, layout=None,
    )  # fmt: skip


_LATERAL = "lateral x (mm)"


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


def _inside(limits: tuple[float, float]) -> list[float]:
    """Return a few round ticks within limits."""
    return [tick for tick in MaxNLocator(4).tick_values(*limits) if limits[0] <= tick <= limits[1]]


def _axes(figure: Figure, k: int, below_in: float, high_in: float) -> Axes:
    """Return axes in panel k, `high_in` high, with their lower edge `below_in` below the row's upper edge."""
    width, height = figure.get_size_inches()
    row, column = divmod(k, _CONTACT_COLUMNS)
    left, bottom = _LEFT_IN + column * (_WIDE_IN + _GAP_IN), height - row * _CONTACT_ROW_IN - below_in
    return figure.add_axes((left / width, bottom / height, _WIDE_IN / width, high_in / height))


def _skin(repeats: Sequence[PredictedHold], across: tuple[float, float]) -> list[Series]:
    """Return the skin of all repeats, and the first one's indentor and contact."""
    result, first = repeats[0].result, _hold(repeats[0])
    (x, y), (undeformed, _) = result.skin_profile, result.pressure_profile
    s = np.linspace(*across, _DRAWN)
    offset = {X: s - result.x_mm, Z: np.full_like(s, result.model.plane_mm - result.z_mm)}
    h = result.indentor.evaluate(np.stack([offset[axis] for axis in result.indentor.axes])).height_mm
    height = _lowest_mm(result) + np.minimum(h, _HIGHEST_MM)
    low = np.r_[False, h < _HIGHEST_MM, False]
    seen = low[1:-1] | low[:-2] | low[2:]  # with the next point, so that both of its sides are drawn
    touching = [
        Series("plot", np.interp(at, undeformed, x), np.interp(at, undeformed, y),
               rows=rows_of("model_contact.csv", "skin_x_mm", "skin_y_mm", region=number, **first),
               color=ORANGE, lw=4, solid_capstyle="butt", alpha=0.8)
        for number, at in enumerate(_touching(result), 1)
    ]  # fmt: skip
    return [
        *(
            Series("plot", *one.result.skin_profile, color=GREY, lw=1,
                   rows=rows_of("model_pressure.csv", "skin_x_mm", "skin_y_mm", **_hold(one)))
            for one in repeats
        ),
        Series("plot", s, np.where(seen, height, np.nan), color="black", lw=1.2,
               rows=rows_of("indentor", "x_mm", "height_mm", **first)),
        *touching,
    ]  # fmt: skip


def _hold(response: PredictedHold) -> dict[str, int]:
    return {"index": response.index, "hold": response.hold["hold"]}


def _touching(result: IndentationResult) -> list[Array]:
    """Return undeformed x in each contact region, whose ends lie between nodes."""
    x = result.pressure_profile[0]
    return [np.r_[low, x[(x > low) & (x < high)], high] for low, high in result.contact_regions_mm]


def _pressures(repeats: Sequence[PredictedHold]) -> list[Series]:
    """Return pressures, filled in contact, since nodes beyond it share the force of a point between nodes."""
    undeformed, pressure = repeats[0].result.pressure_profile_kpa
    return [
        *(
            Series("plot", *one.result.pressure_profile_kpa, color=BLUE, lw=0.8,
                   rows=rows_of("model_pressure.csv", "undeformed_x_mm", "pressure_kpa", **_hold(one)))
            for one in repeats
        ),
        *(
            Series(
                "fill_between", x, np.interp(x, undeformed, pressure), color=BLUE, alpha=0.25, lw=0,
                rows=rows_of("model_contact.csv", "undeformed_x_mm", "pressure_kpa", region=n, **_hold(repeats[0])),
            )
            for n, x in enumerate(_touching(repeats[0].result), 1)
        ),
    ]  # fmt: skip


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
    columns, top = min(len(found), _PICTURE_COLUMNS), max(result.peak_pressure_kpa for result in found) or 1.0

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for one, panel in zip(axes, panels, strict=True):
            x, z, _ = panel.series[0].data
            one.set(xlim=(x.min(), x.max()), ylim=(z.min(), z.max()), aspect="equal")
        figure.colorbar(axes[-1].collections[0], ax=figure.axes, label="pressure (kPa)", shrink=0.8)

    panels = [
        Subplot(_LATERAL, "along the finger, z (mm)", _from_below(result, top, number), wrapped(title, _TITLE_WIDTH),
              printed="x" if number % columns else "xy", color="pressure (kPa)", is_part=True)
        for number, (result, title) in enumerate(zip(found, titles, strict=True))
    ]  # fmt: skip
    return Plot(
        (0.4 + 3.2 * columns, 0.3 + 3.0 * -(-len(found) // columns)), panels,
        "Contact from below",
        "Nodal pressure over x and z, fingertip up. Gray: contours of the indentor's height. Orange: contact. "
        "Dotted: the receptor plane. The last hold of each indentation.",
        arrange=in_grid(len(found), columns), finish=finish, titles={"fontsize": 8},
    )  # fmt: skip


def _from_below(result: IndentationResult, top: float, number: int) -> list[Series]:
    patch = result.model.patch
    x, z = (patch.position_mm[:, axis].reshape(patch.shape) for axis in (X, Z))
    pressure = result.kpa_per_pseudo * result.nodal_pressure_pseudo.reshape(patch.shape)
    at = result.state.held.on(patch).interpolate(patch.position_mm.T)
    return [
        Series("pcolormesh", x, z, pressure, shading="gouraud", cmap="Blues", vmin=0, vmax=top, rasterized=True,
               rows=rows_of("from below", "x_mm", "z_mm", "pressure_kpa", number=number)),
        *_relief(result, (float(x.min()), float(x.max())), (float(z.min()), float(z.max()))),
        Series("plot", at[X], at[Z], ls="", marker=".", ms=2, color=ORANGE,
               rows=rows_of("from below", "held_x_mm", "held_z_mm", number=number)),
        guide("axhline", result.model.plane_mm, color=BLUE, lw=0.8, ls=DOTTED),
    ]  # fmt: skip


def _relief(result: IndentationResult, across: tuple[float, float], along: tuple[float, float]) -> list[Series]:
    """Return height contours of the indentor."""
    x, z = np.meshgrid(np.linspace(*across, _RELIEF_STEPS), np.linspace(*along, _RELIEF_STEPS))
    offset = {X: x.ravel() - result.x_mm, Z: z.ravel() - result.z_mm}
    height = result.indentor.evaluate(np.stack([offset[axis] for axis in result.indentor.axes])).height_mm
    if height.max() <= _CONTOURS_MM[0]:
        return []
    return [guide("contour", x, z, height.reshape(x.shape), levels=_CONTOURS_MM, colors=GREY, linewidths=0.6)]


PHASES = {
    "approach": YELLOW,
    "touch-off": PURPLE,
    "press and seek": ORANGE,
    "hold": BLUE,
    "lift": GREEN,
}
"""Phases with a color of their own in the strip; all others are white."""

GROUPS_A_PAGE = 2

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

Groups = Mapping[str, list[Condition]]
"""Conditions under the label that they share."""


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


def delivered_presses(found: Sequence[DeliveredPress], message: str = "") -> Plot:
    """Plot the delivered and commanded quantity of each press, above their difference and its tolerance."""
    keys = [key for key in _NAMES if any(one.key == key for one in found)]
    pairs = [_delivered(key, [one for one in found if one.key == key]) for key in keys]

    def arrange(figure: Figure) -> list[Axes]:
        room = Room(left=0.9, bottom=0.85, top=0.1, columns=0.9, rows=0.12)
        panels = room.panels(figure, 2, len(keys), sharex="col", height_ratios=(3, 2))
        return list(panels.T.ravel())

    def finish(figure: Figure, axes: list[Axes]) -> None:
        names: dict[str, Artist] = {}
        for above, below, key in zip(axes[::2], axes[1::2], keys, strict=True):
            index, asked, got, sd, allowed = _columns_of([one for one in found if one.key == key])
            above.set(ylim=(0, 1.1 * max(asked.max(), got.max())))
            reach = 1.15 * max(np.abs(got - asked + sd).max(), np.abs(got - asked - sd).max(), allowed.max(), 1e-9)
            below.set(ylim=(-reach, reach), xlim=(index.min() - 0.6, index.max() + 0.6))
            below.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
            for one in (above, below):
                names |= dict(zip(*reversed(one.get_legend_handles_labels()), strict=True))
        figure.legend(list(names.values()), list(names), loc="lower center", ncols=_NAMES_A_LINE, fontsize=8)

    return Plot(
        (_WIDTH_IN, 3.4), [panel for pair in pairs for panel in pair],
        "Delivered against asked",
        "Mean of the last hold of each press. Above: delivered and asked. Below: delivered minus asked; bars: "
        "the standard deviation of the readings in the hold; green: the tolerance. A finger relaxes, so the "
        "mean of a hold may be lower than the force at its start.",
        message, arrange=arrange, finish=finish, layout=None,
    )  # fmt: skip


def _columns_of(found: Sequence[DeliveredPress]) -> list[Array]:
    """Return index, asked, delivered, sd and tolerance, (n,) each."""
    fields = ("index", "asked", "delivered", "sd", "tolerance")
    return [np.array([getattr(one, field) for one in found], dtype=float) for field in fields]


def _delivered(key: str, mine: Sequence[DeliveredPress]) -> tuple[Subplot, Subplot]:
    """Return the panels of one quantity: delivered and asked, and their difference."""
    name, unit_ = _NAMES[key]
    index, asked, got, sd, allowed = _columns_of(mine)
    size, within = (3 if len(mine) < _MANY else 1.5), np.array([one.is_within for one in mine])
    ends = np.column_stack([index - 0.45, index + 0.45, np.full(len(index), np.nan)]).ravel()
    edges, widths = np.column_stack([index - 0.5, index + 0.5]).ravel(), np.repeat(allowed, 2)
    above = [
        Series("plot", ends, np.repeat(asked, 3), color="black", lw=1.2, label="asked",
               rows=rows_of("hold_end.csv", "ends of a line", "asked at its ends", key=key))
    ]  # fmt: skip
    below = [
        Series("fill_between", edges, -widths, widths, color=GREEN, alpha=0.3, lw=0, label="tolerance",
               rows=rows_of("hold_end.csv", "edges", "-tolerance at edges", "tolerance at edges", key=key)),
        guide("axhline", 0.0, color="black", lw=0.8),
    ]  # fmt: skip
    for is_within, color, words in ((True, BLUE, "delivered"), (False, ORANGE, "delivered outside the tolerance")):
        kept, where = within == is_within, {"key": key, "within": is_within}
        if kept.any():
            above.append(Series("plot", index[kept], got[kept], ls="", marker="o", ms=size, color=color, label=words,
                                rows=rows_of("hold_end.csv", "index", "delivered", **where)))  # fmt: skip
            below.append(Series(
                "errorbar", index[kept], (got - asked)[kept], sd[kept], fmt="o", ms=size, lw=0.8, color=color,
                rows=rows_of("hold_end.csv", "index", "difference", "sd", **where),
            ))  # fmt: skip
    x = "press, by index (1)"
    return Subplot(x, f"{name} ({unit_})", above, printed="y"), Subplot(x, f"difference ({unit_})", below)


def force_time(run: Run) -> Plot:
    """Plot force over the whole run, above a strip of its phases."""
    per, unit_ = (60.0, "min") if run.duration_s > _MINUTES_FROM_S else (1.0, "s")
    readings, strip = _readings(run, per, unit_), _strip(spans(run), per, unit_)
    is_cut = run.end_s - run.start["t_s"] >= (1 + _LONG_GAP) * run.duration_s
    edges = np.array(run.parts).ravel() / per
    gaps = list(zip(edges[1:-1:2], edges[2::2], strict=True)) if is_cut else []
    hatched = [guide("axvspan", *gap, facecolor="none", edgecolor=GREY, hatch="////", lw=0) for gap in gaps]

    def finish(figure: Figure, axes: list[Axes]) -> None:
        above, below = axes
        _trip(above, run)
        above.set(xlim=(run.start["t_s"] / per, run.end_s / per))
        below.set(yticks=[], ylim=(0, 1))
        if gaps:
            _cut(above, below, edges, run.duration_s / per)
        for end, begin in gaps:
            above.text(
                0.5 * (end + begin), 0.5, shown_duration((begin - end) * per), rotation=90, ha="center", va="center",
                fontsize=8, transform=above.get_xaxis_transform(), bbox={"fc": "white", "ec": "none", "pad": 1},
            )  # fmt: skip
        colors = [Patch(color=color) for color in PHASES.values()]
        figure.legend(colors, list(PHASES), loc="lower center", ncols=len(PHASES), fontsize=8)

    x = f"time since the start of the run ({unit_})"
    others = "; gray: presses that are not data" if any(map(run.stream, SAMPLES[1:])) else ""
    cut = " Hatched: the time between the parts of the run, not to scale." if len(run.parts) > 1 else ""
    return Plot(
        (_WIDTH_IN, 3.2),
        [
            Subplot(x, "force (gwt)", [*readings, *hatched], printed="y"),
            Subplot(x, "", [*strip, *hatched], printed="x"),
        ],
        "Force against time",
        f"All readings of the run{others}. Below: the phases of the run; white: "
        f"lateral moves, rests, zeroing and waits.{cut}",
        arrange=in_grid(2, room=Room(bottom=0.8, top=0.1, rows=0.06), sharex=True, height_ratios=(8, 1)),
        finish=finish, layout=None, charts=force_charts(run),
    )  # fmt: skip


def _readings(run: Run, per: float, unit_: str) -> list[Series]:
    found = [(stream, run.stream(stream)) for stream in SAMPLES]
    lines = [(stream, *broken(read, run)) for stream, read in found if read]
    return [
        Series("plot", t / per, force, lw=0.9, color=BLUE if stream == "sample" else GREY,
               rows=rows_of(f"{stream}.csv", f"t_{unit_}", "force_gwt"))
        for stream, t, force in lines
    ]  # fmt: skip


def _cut(above: Axes, below: Axes, edges: Array, duration: float) -> None:
    """Compress the time between the parts of a run."""
    widths = np.diff(edges)
    widths[1::2] = _GAP_WIDTH * duration
    shown_at = np.concatenate([[0.0], np.cumsum(widths)])

    def position(time: Array) -> Array:
        return np.interp(time, edges, shown_at)

    def time(position: Array) -> Array:
        return np.interp(position, shown_at, edges)

    below.set_xscale("function", functions=(position, time))
    ticks: list[float] = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        steps = MaxNLocator(max(round(_TICKS * (end - begin) / duration), 1)).tick_values(begin, end)
        ticks += [tick for tick in steps if begin <= tick <= end]
    for axes in (above, below):
        axes.xaxis.set_major_locator(FixedLocator(ticks))
        axes.xaxis.set_major_formatter(lambda tick, _: f"{tick:.10g}")


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


def _strip(found: Sequence[Span], per: float, unit_: str) -> list[Series]:
    merged: dict[str, list[tuple[float, float]]] = {what: [] for what in PHASES}
    for span in (one for one in found if one.what in merged and one.end_s > one.begin_s):
        mine = merged[span.what]
        begin_s = mine.pop()[0] if mine and mine[-1][1] == span.begin_s else span.begin_s  # seams would be lighter
        mine.append((begin_s, span.end_s))
    return [
        Series("broken_barh", [(begin_s / per, (end_s - begin_s) / per) for begin_s, end_s in merged[what]], (0, 1),
               color=color, lw=0, label=what, rows=rows_of("phases", f"begin_{unit_}", f"lasts_{unit_}", phase=what))
        for what, color in PHASES.items()
    ]  # fmt: skip


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


def presses(run: Run, groups: Groups) -> Plot:
    """Plot force from the start of each press, and force in its holds relative to their start."""
    panels = [panel for name, members in groups.items() for panel in _press_panels(run, name, members)]

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for left, right, (name, members) in zip(axes[::2], axes[1::2], groups.items(), strict=True):
            row_title(left, _row_name(name, [condition.x_mm for condition in members]))
            low, high = right.get_ylim()
            right.set_ylim(min(low, 1 - _LEAST_RELATIVE), max(high, 1 + _LEAST_RELATIVE))
            position_scale(right, [condition.x_mm for condition in members])

    return Plot(
        (_WIDTH_IN, 0.5 + _ROW_IN * len(groups)), panels,
        "Press, hold and relaxation",
        "Left: force from the start of each press, all repeats. Right: force in each hold relative to "
        f"its first reading.{_color_key(groups)}",
        arrange=in_grid(len(panels), 2, _BESIDE_A_SCALE), finish=finish, titles=None, layout=None,
    )  # fmt: skip


def _scale(positions_mm: Sequence[float]) -> str:
    """Return the label of the scale of positions; "" if all are one."""
    return POSITIONS if len(set(positions_mm)) > 1 else ""


def _row_name(name: str, positions_mm: Sequence[float]) -> str:
    """Return the title of a row, with the position where all its lines share one and no scale shows it."""
    return name if _scale(positions_mm) else f"{name}, x = {signed(positions_mm[0])} mm"


def _color_key(groups: Groups) -> str:
    """Return the sentence on colors, if lines of a row differ in position."""
    several = any(_scale([condition.x_mm for condition in members]) for members in groups.values())
    return " Color: position of the indentor." * several


def _press_panels(run: Run, name: str, members: Sequence[Condition]) -> tuple[Subplot, Subplot]:
    xs, force, relative = [condition.x_mm for condition in members], [], []
    for condition in members:
        for index in condition.indices:
            style, readings = {"lw": 0.8, "color": shade_of(condition.x_mm, xs)}, run.readings_of(index)
            rows = rows_of("sample.csv", "since touch_s", "force_gwt", index=index)
            force.append(Series("plot", *_thinned(*_since_press(readings)), rows=rows, **style))
            for number, (t, ratio) in enumerate(_in_holds(readings), 1):
                rows = rows_of("sample.csv", "in hold_s", "relative", index=index, hold=number)
                relative.append(Series("plot", *_thinned(t, ratio), rows=rows, **style))
    return (
        Subplot("time since the start of the press (s)", "force (gwt)", force, name),
        Subplot("time in the hold (s)", "force relative to first (1)", relative, color=_scale(xs)),
    )


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


def force_depth(run: Run, groups: Groups) -> Plot:
    """Plot the mean force of each condition against depth, and the spread of its repeats if there are any."""
    columns = 2 if has_repeats(run) else 1
    panels = [panel for name, members in groups.items() for panel in _loadings(run, name, members)[:columns]]

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for k, (name, members) in enumerate(groups.items()):
            left, *right = axes[columns * k : columns * (k + 1)]
            row_title(left, name)
            for one in right:
                one.set_ylim(-0.05 * _LEAST_SD_GWT, max(one.get_ylim()[1], _LEAST_SD_GWT))
                if all(len(condition.indices) == 1 for condition in members):
                    one.text(
                        0.5, 0.5, "no repeats, hence no spread", transform=one.transAxes, ha="center", color=GREY
                    )
                    one.set(xticks=(), yticks=())
            position_scale([left, *right][-1], [condition.x_mm for condition in members])

    spread = (
        "Left: the mean over repeats of each condition, at depths that all repeats reached. Right: their standard "
        "deviation."
        if columns > 1
        else "No condition was repeated."
    )
    return Plot(
        (_WIDTH_IN if columns > 1 else 0.55 * _WIDTH_IN, 0.5 + _ROW_IN * len(groups)), panels,
        "Force against depth",
        "Force while pressing, against the depth from the contact fitted at each touch-off. "
        f"{spread}{_color_key(groups)}",
        arrange=in_grid(len(panels), columns, _BESIDE_A_SCALE), finish=finish, titles=None, layout=None,
    )  # fmt: skip


def _loadings(run: Run, name: str, members: Sequence[Condition]) -> tuple[Subplot, Subplot]:
    xs = [condition.x_mm for condition in members]
    found = [(condition, loading(condition, run)) for condition in members]
    mean, sd = (
        [
            Series("plot", one.doi_mm, getattr(one, column), lw=1, color=shade_of(condition.x_mm, xs),
                   rows=rows_of("sample.csv", "doi_mm", column, indices=condition.indices))
            for condition, one in found if one is not None
        ]
        for column in ("mean_gwt", "sd_gwt")
    )  # fmt: skip
    depth = "depth of indentation (mm)"
    return (
        Subplot(depth, "mean force (gwt)", mean, name, color=_scale(xs)),
        Subplot(depth, "sd over repeats (gwt)", sd, color=_scale(xs)),
    )


_BESIDE_A_SCALE = Room(right=1.0, top=_TITLES_IN, columns=0.8, rows=0.85)
_LEGEND_IN = 0.2  # height of one line of a legend
_NAMES_A_LINE = 4
_HANDLE_IN, _CHARACTER_IN = 0.6, 0.07
"""Width of a line of a legend beside its name, and of a character of the name."""


def has_moved(found: Sequence[PredictedHold]) -> bool:
    """Return whether the indentor pressed at several positions."""
    return len({response.hold["x_mm"] for response in found}) > 1


def population_responses(found: list[PredictedHold], *, moved: bool) -> Plot:
    """Plot ep1 and SED at all receptors: lines colored by position in a row for each depth or force, or by depth."""
    groups = by_group(found)
    if moved:
        rows = [(name, [(one.hold["x_mm"], one) for one in members]) for name, members in groups.items()]
        room, height = Room(left=0.75, right=0.9, top=_TITLES_IN, columns=0.9, rows=0.85), 0.3 + 2.9 * len(groups)
    else:
        rows = [("", [(k, members[0]) for k, members in enumerate(groups.values())])]
        room, height = Room(0.75, bottom=0.6 + _legend_in(list(groups)), columns=0.9), 3.6

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for left, right, (name, lines) in zip(axes[::2], axes[1::2], rows, strict=True):
            if moved:
                row_title(left, _row_name(name, [x for x, _ in lines]))
                position_scale(right, [x for x, _ in lines])
            else:
                _legend(figure, *left.get_legend_handles_labels())

    scales = any(_scale([x for x, _ in lines]) for _, lines in rows)
    lines = (
        f"One line per hold{'; color: position' * scales}."
        if moved
        else "One line per depth or force (first repeat)."
    )
    return Plot(
        (9.6, height), [panel for name, lines in rows for panel in _population_row(name, lines, moved=moved)],
        "Population responses",
        "−ep1 (compression is positive) and strain energy density at the receptors, "
        f"{found[0].result.model.receptors.depth_mm:g} mm below the skin. {lines}",
        arrange=in_grid(2 * len(rows), 2, room), finish=finish, titles=None, layout=None,
    )  # fmt: skip


def _population_row(name: str, lines: Sequence[tuple[float, PredictedHold]], *, moved: bool) -> list[Subplot]:
    receptor_x, shades = lines[0][1].result.model.receptors.position_mm[:, 0], [value for value, _ in lines]
    return [
        Subplot(
            "receptor x (mm)", in_unit(measure),
            [
                Series("plot", receptor_x, shown(measure, measured([one], measure)[1][0]), ls="-", marker="o", ms=2.5,
                       lw=1, color=shade_of(value, shades), label=None if moved else one.group,
                       rows=rows_of("model_measures.csv", "receptor_x_mm", _column(measure), **_hold(one)))
                for value, one in lines
            ],
            name if measure == "ep1" else "", color=_scale(shades) if moved else "",
        )
        for measure in ("ep1", "sed")
    ]  # fmt: skip


def _column(measure: str) -> str:
    """Return the column of a measure in the sign in which it is plotted."""
    return f"-{measure}" if BY_NAME[measure].as_magnitude else measure


def ssrps(found: list[PredictedHold], measure: str) -> Plot:
    """Plot the measure at each receptor against the position: one line for each indentor and depth or force."""
    receptor_x = found[0].result.model.receptors.position_mm[:, 0]
    groups = {name: members for name, members in by_group(found).items() if len(members) > 1}
    columns = -(-len(receptor_x) // 2)
    profiles = {name: _over_repeats(*measured(members, measure)) for name, members in groups.items()}
    panels = [
        Subplot(
            "indentor x (mm)", in_unit(measure),
            [
                *(
                    Series(
                        "plot", positions, shown(measure, values[:, k]), ls="-", marker="o", ms=2, lw=1,
                        color=shade(number, len(groups)), label=name,
                        rows=rows_of("model_measures.csv", "x_mm", f"mean {_column(measure)}", group=name, at=k),
                    )
                    for number, (name, (positions, values)) in enumerate(profiles.items())
                ),
                guide("axvline", x, color=GREY, lw=0.8, ls=DOTTED),
            ],
            f"receptor at {signed(x)} mm",
            printed=("x" if k + columns >= len(receptor_x) else "") + ("" if k % columns else "y"),
        )
        for k, x in enumerate(receptor_x)
    ]  # fmt: skip
    room = Room(0.75, bottom=0.6 + _legend_in(list(groups)), columns=0.12, rows=0.35)
    return Plot(
        (10.2, 4.8), panels,
        f"SSRP of {measure.replace('sed', 'strain energy density')}",
        f"Simulated spatial response profiles: {label(measure)} at one receptor against the position of the "
        "indentor, mean of repeats, one line per depth or force. Dotted: x of the receptor.",
        arrange=in_grid(len(panels), columns, room, sharex=True, sharey=True),
        finish=lambda figure, axes: _legend(figure, *axes[0].get_legend_handles_labels()), titles={"fontsize": 8},
        layout=None,
    )  # fmt: skip


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
