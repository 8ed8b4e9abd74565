"""The page of the fingers that the source allows: tables as Markdown, and one figure."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.report.style import BLUE, GREY, ORANGE, Plot
from studies.source.allowed.implausible import CUT_OFF, worst
from studies.source.allowed.pins import Pin, pins
from studies.source.allowed.ranges import DEFAULT, RANGES, Range
from studies.source.allowed.sentences import sentences
from studies.source.allowed.study import CHOOSES, AllowedStudy, better, score
from studies.source.allowed.summary import FactLine, best_row, lines, met

Array = NDArray[np.float64]

_COLUMNS, _BINS = 5, 16
_MINUS = re.compile(r"(?<![\w-])-(?=\d)")


def markdown(study: AllowedStudy) -> str:
    """All tables."""
    words = "\n".join(f"- {one}" for one in sentences(study))
    parts = [words, waves(study), parameters(pins(study.last)), halves(study), facts(lines(study)), fingers(study)]
    return "\n\n".join(["# Which fingers the source allows", *parts]) + "\n"


def waves(study: AllowedStudy) -> str:
    """What each left."""
    rows = [
        (f"{k}", f"{one.fingers}", f"{one.inflation:g}", f"{one.share:.2%}") for k, one in enumerate(study.lefts, 1)
    ]
    table = _table(("wave", "fingers so far", "inflation", "left of all ranges"), rows)
    both = np.mean(study.checks.allowed[study.last.allowed])
    return f"{table}\n\nOf what is left the checking half allows {both:.0%}, of all ranges {study.checks.share:.0%}."


def parameters(found: Sequence[Pin]) -> str:
    """What is left of each range."""
    rows = [
        (
            f"`{pin.one.name}`",
            f"{pin.one.low:g} … {pin.one.high:g}",
            f"{pin.one.default:g}",
            f"{pin.least:.3g} … {pin.most:.3g}",
            f"{pin.low:.3g} … {pin.high:.3g}",
            f"{pin.part:.2f}",
            "pinned" if pin.pinned else "not pinned",
            pin.one.why,
        )
        for pin in found
    ]
    header = ("parameter", "range", "default", "left", "middle 90 % of it", "over the range's", "", "why the range")
    return _table(header, rows)


def halves(study: AllowedStudy) -> str:
    """Facts met before and after: by the default finger, by it at the best one's low force, by the best."""
    found, row = lines(study), best_row(study)
    three = (study.default, study.alike.facts[row], study.best.facts[row])
    rows = []
    for name, chooses in (("choose", True), ("check", False)):
        flags = CHOOSES if chooses else ~CHOOSES
        rms = [score(one, flags)[1] for one in three]
        counts = [met(found, chooses, limit) for limit in (1.0, CUT_OFF)]
        cells = (f"{near}, {within}, {off:.2f}" for near, within, off in zip(*counts, rms, strict=True))
        rows.append((name, f"{int(flags.sum())}", *cells))
    header = ("half", "facts", "default finger", "at the best one's low force", "best finger")
    told = f"Facts within 1, within {CUT_OFF:g}, and the rms implausibility, on the default mesh:"
    return f"{told}\n\n{_table(header, rows)}"


def facts(found: Sequence[FactLine]) -> str:
    """Each fact."""
    return _table(
        (
            "figure",
            "half",
            "fact",
            "target",
            "± read, model",
            "default (off)",
            "best (off)",
            "mesh",
            "held back",
            "nearest",
        ),
        [_fact(line) for line in found],
    )


def _fact(line: FactLine) -> tuple[str, ...]:
    fact, judge = line.fact, line.judge
    return (
        fact.figure,
        "choose" if line.chooses else "check",
        fact.says,
        _target(fact.low, fact.high),
        f"{fact.reading:g}, {fact.model:g}",
        f"{line.default.value:.3g} ({line.default.off:.1f})",
        f"{line.best.value:.3g} ({line.best.off:.1f})",
        "–" if judge is None else f"{judge.mesh.shift:+.2g} ± {judge.mesh.deviation:.2g}",
        "–" if judge is None else f"{judge.relative_error:.0%}",
        f"{line.nearest:.1f}" + (" (out of reach)" if line.out_of_reach else ""),
    )


def _target(low: float, high: float) -> str:
    if low == high:
        return f"{low:g}"
    if np.isinf(low):
        return f"≤ {high:.3g}"
    return f"≥ {low:.3g}" if np.isinf(high) else f"{low:.3g} … {high:.3g}"


def fingers(study: AllowedStudy) -> str:
    """The best of what is left, and whether one may become the default."""
    rows = []
    best = study.best
    for number, values, found, own in zip(best.numbers, best.values, best.facts, study.alike.facts, strict=True):
        told = ", ".join(f"{one.name.rpartition('.')[2]} {v:.3g}" for one, v in zip(RANGES, values, strict=True))
        cells = (f"{_scored(one, CHOOSES)}; {_scored(one, ~CHOOSES)}" for one in (found, own))
        rows.append((f"{number}", told, *cells, "yes" if better(found, own) else "no"))
    told = "Each of the best, and the default finger at its low force: facts ruled out and rms, choose; check."
    header = ("finger", "values", "its own", "default finger", "check improves, choose no worse")
    return f"{told}\n\n{_table(header, rows)}"


def _scored(facts_: Array, flags: NDArray[np.bool_]) -> str:
    out, rms = score(facts_, flags)
    return f"{out}, {rms:.2f}"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines_ = [header, ["---"] * len(header), *rows]
    return _MINUS.sub("−", "\n".join(f"| {' | '.join(cells)} |" for cells in lines_))


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
