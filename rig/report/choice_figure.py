"""Figure of an adaptive run: probabilities of the candidates after each count."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rig.data import Run
from rig.data.choices import BY_PLAN, LEVEL, ChoiceVerdict, probabilities_of, verdict_of
from rig.report.measure_colors import color_of
from rig.report.plot import Plot, Series, Subplot, guide, rows_of
from rig.report.style import DOTTED, GREY, label

_COLORED = 5


@dataclass(frozen=True)
class ChoiceRow:
    """A choice in words: the press, why, the count before it, expected information (bits), the best candidate."""

    index: int
    press: str
    reason: str
    count: str
    information: str
    best: str


def choice_rows(run: Run) -> list[ChoiceRow]:
    """Return the choices of a run in order, for its table."""
    rows = []
    for one in run.stream("choice"):
        ranked = sorted(probabilities_of(one).items(), key=lambda found: -found[1])
        name, p = ranked[0]
        bits, count = one.get("information_bits"), one.get("count")
        rows.append(
            ChoiceRow(
                int(one["index"]),
                "–" if one.get("possible") is None else _press(one),
                str(one["reason"]).replace("_", " "),
                "–" if count is None else f"{count:g}",
                "–" if bits is None else f"{bits:.2f}",
                f"{name} {100 * p:.1f} %",
            )
        )
    return rows


def _press(one: dict[str, object]) -> str:
    unit = {"doi_mm": "mm", "force_gwt": "gwt"}[str(one["target"])]
    return f"{one['indentor']} at {one['x_mm']:+.2f} mm to {one['value']:g} {unit}"


def choice_figures(run: Run) -> list[Plot]:
    """Return the figure of the probabilities; none for a run without choices."""
    verdict = verdict_of(run)
    return [] if verdict is None else [probabilities(run, verdict)]


def probabilities(run: Run, verdict: ChoiceVerdict) -> Plot:
    """Plot the probability of each candidate against the number of counts."""
    counted = [probabilities_of(one) for one in run.stream("choice") if one["reason"] != BY_PLAN]
    steps = np.arange(len(counted))
    lines = [
        Series(
            "plot", steps, [one[name] for one in counted],
            color=color_of(name) if colored else GREY, lw=1.8 if colored else 0.8,
            ls="--" if name == verdict.truth else "-", marker="o", ms=3.5 if colored else 2,
            label=label(name) if colored else None, rows=rows_of("choice.csv", "number", name),
        )
        for name, colored in ((name, k < _COLORED) for k, name in enumerate(verdict.probability))
    ]  # fmt: skip

    def finish(figure: Figure, panels: list[Axes]) -> None:
        (axes,) = panels
        axes.set(ylim=(-0.02, 1.02))
        axes.set_xticks(steps[:: max(1, -(-len(steps) // 12))])
        lines, names = axes.get_legend_handles_labels()
        axes.legend(lines[::-1], names[::-1], loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)

    level = guide("axhline", LEVEL, color="black", lw=0.9, ls=DOTTED)
    truth = "" if verdict.truth is None else f" Dashed: {label(verdict.truth)}, the truth of the virtual nerve."
    others = " Thin gray: all others." if len(verdict.probability) > _COLORED else ""
    plan = "" if verdict.planned_from is None else " From there on counts are missing, and the run follows the plan."
    return Plot(
        (9.6, 4.2), [Subplot("number of counts (1)", "probability (1)", [*reversed(lines), level])],
        "Probabilities",
        "Probability of each candidate against the number of counts. "
        f"Dotted: {100 * LEVEL:g} %, from which a candidate can end the presses.{truth}{others}{plan}",
        finish=finish,
    )  # fmt: skip
