"""Figures of what the force sensor read: over the run, in each press, and against depth."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.data import Run
from rig.data.bench_time import Span, spans
from rig.report.run.conditions import Condition, Samples, by_target, conditions, loading, samples_of
from rig.report.style import BLUE, GREEN, GREY, ORANGE, PURPLE, YELLOW, Plot, Room, position_scale, shade_of
from sim.units import GWT_N

Array = NDArray[np.float64]

PHASES = {
    "approach": YELLOW,
    "touch-off": PURPLE,
    "press and seek": ORANGE,
    "hold": BLUE,
    "lift": GREEN,
}
"""Those that have a colour of their own in the strip; what is neither is white."""

SAMPLES = ("sample", "precondition_sample", "reference_sample", "find_sample")
_MINUTES_FROM_S = 600.0
_WIDTH_IN = 9.6
_COLUMNS = 2
_ROW_IN = 2.3
_NEAR = 2.5  # a trip further above the readings would only flatten them


def force_time(run: Run) -> Plot:
    """Force over the whole run, what its time went to below."""
    return Plot((_WIDTH_IN, 3.2), lambda figure: _force_time(figure, run), layout=None)


def presses(run: Run) -> Plot:
    """Force from the beginning of each press, and in its holds over what it was when they began."""
    groups = by_target(conditions(run))
    height = 0.5 + _ROW_IN * len(groups)
    return Plot((_WIDTH_IN, height), lambda figure: _presses(figure, groups, run), layout=None)


def force_depth(run: Run) -> Plot:
    """Mean force of each condition against depth, and the spread of its repeats."""
    groups = by_target(conditions(run))
    height = 0.5 + _ROW_IN * len(groups)
    return Plot((_WIDTH_IN, height), lambda figure: _force_depth(figure, groups, samples_of(run)), layout=None)


def _force_time(figure: Figure, run: Run) -> None:
    room = Room(bottom=0.8, top=0.1, rows=0.06)
    above, below = room.panels(figure, 2, 1, sharex=True, height_ratios=(8, 1)).ravel()
    per, unit = (60.0, "min") if run.end_s > _MINUTES_FROM_S else (1.0, "s")
    for stream in SAMPLES:
        read = run.stream(stream)
        if read:
            t, force = _broken(read)
            above.plot(t / per, force, lw=0.9, color=BLUE if stream == "sample" else GREY)
    _trip(above, run)
    above.set(ylabel="force (gwt)", xlim=(run.start["t_s"] / per, run.end_s / per))
    _strip(below, spans(run), per)
    below.set(xlabel=f"time on the run's clock ({unit})", yticks=[], ylim=(0, 1))
    handles = [above.plot([], [], lw=5, color=color)[0] for color in PHASES.values()]
    figure.legend(handles, list(PHASES), loc="lower center", ncols=len(PHASES), fontsize=8)


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
    for what, color in PHASES.items():
        mine = [(s.begin_s / per, (s.end_s - s.begin_s) / per) for s in found if s.what == what]
        axes.broken_barh(mine, (0, 1), color=color, lw=0)


def _broken(samples: Sequence[dict[str, Any]]) -> tuple[Array, Array]:
    """Times and forces with a gap between one indentation and the next."""
    index = np.array([sample["index"] for sample in samples])
    at = np.flatnonzero(np.diff(index)) + 1
    t = np.insert(np.array([sample["t_s"] for sample in samples], dtype=float), at, np.nan)
    return t, np.insert(np.array([sample["force_gwt"] for sample in samples], dtype=float), at, np.nan)


def _presses(figure: Figure, groups: dict[str, list[Condition]], run: Run) -> None:
    panels = _panels(figure, len(groups))
    samples = samples_of(run)
    for (name, members), (left, right) in zip(groups.items(), panels, strict=True):
        xs = [condition.x_mm for condition in members]
        for condition in members:
            for index in condition.indices:
                color = shade_of(condition.x_mm, xs)
                left.plot(*_since_press(samples[index]), lw=0.8, color=color)
                for t, ratio in _in_holds(samples[index]):
                    right.plot(t, ratio, lw=0.8, color=color)
        left.set(title=name, ylabel="force (gwt)", xlabel="time since the press began (s)")
        right.set(title=name, ylabel="force over the hold's first", xlabel="time in the hold (s)")
        position_scale(right, xs)


def _since_press(samples: Sequence[dict[str, Any]]) -> tuple[Array, Array]:
    mine = [s for s in samples if s["phase"] in ("press", "hold")]
    t = np.array([s["t_s"] for s in mine], dtype=float)
    return t - t[:1], np.array([s["force_gwt"] for s in mine], dtype=float)


def _in_holds(samples: Sequence[dict[str, Any]]) -> list[tuple[Array, Array]]:
    """Of each stretch of readings in a hold: times from its first and forces over its first."""
    held = np.array([s["phase"] == "hold" for s in samples], dtype=bool)
    t, force = (np.array([s[key] for s in samples], dtype=float) for key in ("t_s", "force_gwt"))
    edges = np.flatnonzero(np.diff(np.r_[False, held, False].astype(int)))
    parts = zip(edges[::2], edges[1::2], strict=True)
    return [(t[a:b] - t[a], force[a:b] / force[a]) for a, b in parts if force[a] > 0]


def _force_depth(figure: Figure, groups: dict[str, list[Condition]], samples: Samples) -> None:
    for (name, members), (left, right) in zip(groups.items(), _panels(figure, len(groups)), strict=True):
        xs = [condition.x_mm for condition in members]
        for condition in members:
            found, color = loading(condition, samples), shade_of(condition.x_mm, xs)
            if found is not None:
                left.plot(found.doi_mm, found.mean_gwt, lw=1, color=color)
                right.plot(found.doi_mm, found.sd_gwt, lw=1, color=color)
        left.set(title=name, ylabel="mean force (gwt)", xlabel="depth of indentation (mm)")
        right.set(title=name, ylabel="sd over repeats (gwt)", xlabel="depth of indentation (mm)")
        if all(len(condition.indices) == 1 for condition in members):
            right.text(0.5, 0.5, "each condition once: no spread", transform=right.transAxes, ha="center", color=GREY)
        position_scale(right, xs)


def _panels(figure: Figure, rows: int) -> Any:
    """(rows, 2) axes with room for a scale of positions beside them."""
    return Room(right=1.0, columns=0.8, rows=0.85).panels(figure, rows, _COLUMNS)
