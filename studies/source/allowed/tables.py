"""Tables and figure of the fingers that the source allows."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.report.style import BLUE, GREY, ORANGE, Plot
from studies.source.allowed.implausible import CUT_OFF, measured, worst
from studies.source.allowed.pins import pins
from studies.source.allowed.ranges import DEFAULT, RANGES, Range
from studies.source.allowed.study import CHOOSES, TARGETS, AllowedStudy, score
from studies.source.allowed.waves import RemainingPlaces

Array = NDArray[np.float64]
Row = tuple[str, ...]

_COLUMNS, _BINS = 5, 16
_MINUS = re.compile(r"(?<![\w-])-(?=\d)")


def parameters(left: RemainingPlaces) -> Iterator[Row]:
    """What is left of each range."""
    yield ("parameter", "range", "default", "left", "middle 90 % of it", "over the range's", "", "why the range")
    for pin in pins(left):
        cells = (
            f"`{pin.one.name}`",
            f"{pin.one.low:g} … {pin.one.high:g}",
            f"{pin.one.default:g}",
            f"{pin.least:.3g} … {pin.most:.3g}",
            f"{pin.low:.3g} … {pin.high:.3g}",
            f"{pin.part:.2f}",
            "pinned" if pin.pinned else "not pinned",
            pin.one.why,
        )
        yield tuple(_MINUS.sub("−", cell) for cell in cells)


def halves(study: AllowedStudy) -> Iterator[Row]:
    """Facts within 1 and within the cut-off, and the rms: of the default finger, also at the best one's low force."""
    yield ("half", "facts", "default finger", "at the best one's low force", "best finger")
    row = best_row(study)
    three = np.stack([study.default, study.alike.facts[row], study.best.facts[row]])
    off = measured(TARGETS, three)
    for name, half in (("choose", CHOOSES), ("check", ~CHOOSES)):
        counts = [(one[half] <= limit).sum() for one in off for limit in (1.0, CUT_OFF)]
        rms = [score(facts, half)[1] for facts in three]
        cells = (f"{counts[2 * k]}, {counts[2 * k + 1]}, {rms[k]:.2f}" for k in range(3))
        yield (name, f"{int(half.sum())}", *cells)


def best_row(study: AllowedStudy) -> int:
    """The row of the finger that the choosing half likes best, on the default mesh: fewest ruled out, then rms."""
    scores = [score(facts, CHOOSES) for facts in study.best.facts]
    return min(range(len(scores)), key=lambda k: scores[k])


def drawn(study: AllowedStudy, path: Path) -> None:
    """One panel a parameter: what part of its slice is left, and the least worst implausibility there."""
    path.write_bytes(Plot((10.2, 6.4), lambda canvas: _draw(canvas, study)).png)


def _draw(canvas: Figure, study: AllowedStudy) -> None:
    last = study.last
    away = worst(last.judges, last.places, last.inflation)
    panels = canvas.subplots(-(-len(RANGES) // _COLUMNS), _COLUMNS, sharey=True).ravel()
    for axes, one, units in zip(panels, RANGES, last.places.T, strict=False):
        _panel(axes, one, units, away)
    for axes in panels[len(RANGES) :]:
        axes.set_visible(False)
    canvas.supylabel("least implausibility (blue); share left, largest = cut-off (orange)", fontsize=9)


def _panel(axes: Axes, one: Range, units: Array, away: Array) -> None:
    bin_of = np.minimum((units * _BINS).astype(int), _BINS - 1)
    edges = [one.at(k / _BINS) for k in range(_BINS + 1)]
    least = [float(away[bin_of == k].min()) for k in range(_BINS)]
    share = np.array([np.mean(away[bin_of == k] <= CUT_OFF) for k in range(_BINS)])
    axes.stairs(CUT_OFF * share / (share.max() or 1.0), edges, fill=True, color=ORANGE, alpha=0.35)
    axes.stairs(least, edges, color=BLUE, baseline=None)
    axes.axhline(CUT_OFF, color=GREY, lw=0.8, ls=":")
    axes.axvline(DEFAULT[one.name], color="black", lw=0.8)
    axes.set_title(one.name.rpartition(".")[2], fontsize=8)
    axes.set(xlim=(one.low, one.high), ylim=(0, 2 * CUT_OFF), xscale="log" if one.log else "linear")
    if one.log:
        axes.set_xticks(ticks := [one.low, one.at(0.5), one.high], [f"{tick:.2g}" for tick in ticks], minor=False)
        axes.minorticks_off()
