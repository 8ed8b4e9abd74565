"""Figures and page of `rig bench`: errors against time and memory."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from rig.report.page_parts import render
from rig.report.page_source import source_line
from rig.report.plot import Plot, Series, Subplot, in_grid, rows_of
from rig.report.style import BLUE, GREEN, GREY, ORANGE, PURPLE, YELLOW
from rig_shared.plural import number_of

_GOOD = 0.05
"""Relative error of a force that counts as small."""

Row = Mapping[str, Any]
Line = tuple[str, str]  # model and element

_LOOK = {
    ("finger", "bbar"): (BLUE, "o"),
    ("finger", "full"): (ORANGE, "s"),
    ("finger", "incompatible"): (PURPLE, "v"),
    ("finger", "quadratic"): (YELLOW, "P"),
    ("section", "bbar"): (GREEN, "^"),
    ("halfspace", "analytic"): (GREY, "D"),
}
_TITLES = {"force": "force", "width": "contact width", "sed": "SED at the receptors", "ep1": "ep1 at the receptors"}
_FAMILIES = {"smooth": "smooth", "bar": "bars", "step": "step 1"}


def page(rows: Sequence[Row], **about: Any) -> str:
    """Return the self-contained HTML page."""
    source = source_line([], "no run: models against a stored reference of virtual presses")
    return render(
        "speed.html.j2",
        source=source,
        message=message(rows),
        figures=figures(rows),
        table=_table(rows),
        families=_FAMILIES,
        titles=_TITLES,
        **about,
    )


def message(rows: Sequence[Row]) -> str:
    """Return the fastest model whose forces are good enough, in one sentence."""
    forces = [row for row in rows if row["quantity"] == "force"]
    found = [mine for candidates in _lines(forces).values() for mine in candidates if _largest(mine) <= _GOOD]
    if not found:
        return f"No candidate has all forces within {100 * _GOOD:.0f} % of the reference."
    best = min(found, key=lambda mine: _median(mine, "total_s"))
    of_scenes = len({row["scene"] for row in best})
    return (
        f"The fastest candidate with all forces of {number_of(of_scenes, 'scenes')} within {100 * _GOOD:.0f} % of "
        f"the reference is {best[0]['model']} {best[0]['element']}, {best[0]['refinement']}: "
        f"{_median(best, 'total_s'):.2g} s without a cache, and {100 * _largest(best):.1f} % off at most."
    )


_COSTS = {"total_s": "time without cache (s)", "memory_mb": "peak memory (MB)", "contact_s": "contact (s)"}


def pareto(rows: Sequence[Row], against: str = "total_s", title: str = "", caption: str = "") -> Plot:
    """Plot the largest error of each family and quantity on log-log axes, a line per model and element."""
    quantities = [q for q in _TITLES if any(row["quantity"] == q for row in rows)]

    def lines(family: str, quantity: str) -> list[Series]:
        chosen = [r for r in rows if r["family"] == family and r["quantity"] == quantity]
        series = []
        for line, points in _lines(chosen).items():
            cost, error = np.array([(_median(p, against), _largest(p)) for p in points]).T
            where = {"line": line, "family": family, "quantity": quantity}
            shown = rows_of("bench", against, "error", **where)
            series.append(Series("loglog", cost, 100 * error, rows=shown, label=" ".join(line), **_style(line)))
        return series

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for one in axes:
            _plain(one)
        found = max((one.get_legend_handles_labels() for one in axes), key=lambda found: len(found[1]))
        figure.legend(*found, loc="outside lower center", ncols=4)

    return Plot(
        (10.2, 5.6),
        [
            Subplot(
                _COSTS[against],
                "largest error (%)", lines(family, quantity),
                f"{_TITLES[quantity]}, {name}",
                printed="x" * (family == [*_FAMILIES][-1]) + "y" * (quantity == quantities[0]),
            )
            for family, name in _FAMILIES.items()
            for quantity in quantities
        ],
        title, caption, arrange=in_grid(len(_FAMILIES) * len(quantities), len(quantities), sharex=True, sharey="col"),
        finish=finish, titles={"fontsize": 9},
    )  # fmt: skip


def cost_against_nodes(rows: Sequence[Row]) -> Plot:
    """Plot cold-start time and memory against the number of nodes, with the exponents of fitted power laws."""

    def lines(key: str) -> list[Series]:
        series = []
        for line, points in _lines(rows).items():
            nodes, cost = np.array(sorted((p[0]["nodes"], _median(p, key)) for p in points)).T
            shown = rows_of("bench", "nodes", key, line=line)
            name = _with_exponent(line, nodes, cost)
            series.append(Series("loglog", nodes, cost, rows=shown, label=name, **_style(line)))
        return series

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for one in axes:
            _plain(one)
            one.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2)

    return Plot(
        (10.2, 4.4), [Subplot("number of nodes (1)", _COSTS[key], lines(key)) for key in ("total_s", "memory_mb")],
        "Cost against size",
        "Straight lines are fitted to the logarithms; the nodes of a half-space are those of its patch.",
        arrange=in_grid(2, 2), finish=finish,
    )  # fmt: skip


def _style(line: Line) -> dict[str, Any]:
    color, marker = _LOOK[line]
    return {"marker": marker, "ls": "-", "color": color, "ms": 4, "lw": 1}


def _plain(axes: Axes) -> None:
    """Label ticks at 1, 2 and 5 of each decade with plain numbers."""
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.3, lw=0.4)


def exponent(nodes: np.ndarray, cost: np.ndarray) -> float:
    """Return the slope of log cost against log nodes."""
    return float(np.polyfit(np.log(nodes), np.log(cost), 1)[0])


def _with_exponent(line: Line, nodes: np.ndarray, cost: np.ndarray) -> str:
    several = len(np.unique(nodes)) > 1
    return f"{' '.join(line)}: nodes^{exponent(nodes, cost):.2f}".replace("-", "−") if several else " ".join(line)


def _lines(rows: Iterable[Row]) -> dict[Line, list[list[Row]]]:
    """Group rows by model and element, ordered by refinement from cheap to expensive."""
    found: dict[Line, dict[str, list[Row]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        found[row["model"], row["element"]][row["refinement"]].append(row)
    return {line: sorted(by.values(), key=lambda p: _median(p, "total_s")) for line, by in found.items()}


def _median(rows: Iterable[Row], key: str) -> float:
    return float(np.median([row[key] for row in rows]))


def _largest(rows: Iterable[Row]) -> float:
    return max(float(row["error"]) for row in rows)


def _table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return a row per candidate: costs, and the largest error by family and quantity."""
    return [
        {
            "line": " ".join(line),
            "refinement": mine[0]["refinement"],
            "nodes": mine[0]["nodes"],
            "errors": _errors(mine),
            **{key: _median(mine, key) for key in ("total_s", "contact_s", "memory_mb")},
        }
        for line, candidates in _lines(rows).items()
        for mine in candidates
    ]


def _errors(rows: Sequence[Row]) -> dict[tuple[str, str], float | None]:
    """Return the largest error by family and quantity; None if there is none."""
    by: dict[tuple[str, str], list[Row]] = {(family, q): [] for family in _FAMILIES for q in _TITLES}
    for row in rows:
        by[row["family"], row["quantity"]].append(row)
    return {key: _largest(found) if found else None for key, found in by.items()}


def figures(rows: Sequence[Row]) -> list[Plot]:
    return [
        pareto(
            rows,
            title="Error against time",
            caption="The largest error over the scenes of a family, against the time to one result without a cache. "
            "SED and ep1: the largest deviation at any receptor relative to the largest value at any "
            "receptor. A section has no force to compare, since its force is per millimeter.",
        ),
        pareto(
            rows,
            "memory_mb",
            "Error against memory",
            "The largest error against the peak memory of the process.",
        ),
        cost_against_nodes(rows),
    ]
