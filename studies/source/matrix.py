"""The first page of the study: every figure and table with its verdict, and one figure of them all."""

from collections import Counter
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from rig.report.page_parts import PageFigure, Section
from rig.report.style import BLUE, GREY, ORANGE, PURPLE, Plot
from studies.source.printed.entry import VERDICTS, CheckedClaim, MatrixRow

HEADER = (
    "number",
    "what it shows",
    "claim farthest from it",
    "the source",
    "here",
    "difference",
    "verdict",
    "made by",
)
VERDICT_COLUMN = HEADER.index("verdict")
_LOOK = {"agrees": (BLUE, "o"), "partly": (ORANGE, "^"), "differs": (PURPLE, "X")}


def matrix(rows: Sequence[MatrixRow]) -> Section:
    """One row a figure or table."""
    counts = Counter(row.verdict for row in rows)
    claims: Counter[str] = Counter(one.word for row in rows if row.verdict in VERDICTS[:3] for one in row.found)
    told = ", ".join(f"{counts[word]} {_said(word, counts[word])}" for word in VERDICTS if counts[word])
    of_claims = ", ".join(f"{claims[word]} {_said(word, claims[word])}" for word in VERDICTS[:3] if claims[word])
    text = (
        f"{len(rows)} figures and tables: {told}. Of {sum(claims.values())} single claims {of_claims}. Where the "
        "printed number of a figure is not known here, its chapter stands for it. Nothing was tuned to any of "
        "these; the bounds of the verdicts stand in each table and were set knowing the numbers."
    )
    return Section("All figures and tables", text, HEADER, tuple(cells(row) for row in rows), (summary(rows),))


def _said(verdict: str, how_many: int) -> str:
    """Of so many: one agrees, two agree."""
    of_several = {"agrees": "agree", "partly": "agree in part", "differs": "differ"}
    of_one = {"partly": "agrees in part"}
    return (of_one if how_many == 1 else of_several).get(verdict, verdict)


def cells(row: MatrixRow) -> tuple[str, ...]:
    """A row of the matrix."""
    entry, one = row.entry, row.headline
    if one is None:
        measured: tuple[str, ...] = ("–", "–", why(row), "–")
    else:
        says, source, ours, difference, *_ = one.row
        measured = (says, source, "; ".join(filter(None, (ours, why(row)))), difference)
    return entry.number, entry.shows, *measured, row.told, entry.command


def why(row: MatrixRow) -> str:
    """Return why an entry has no verdict, or an empty string."""
    entry = row.entry
    return (
        entry.outside or (entry.missing and f"needs {entry.missing}") or (entry.elsewhere and f"in {entry.elsewhere}")
    )


def summary(rows: Sequence[MatrixRow]) -> PageFigure:
    """Every claim with its verdict, and ours over each printed number."""
    shown = [row for row in rows if row.verdict in VERDICTS[:3]]
    numbers = [(row.entry.number, one) for row in shown for one in row.found if one.ratio is not None]
    caption = (
        "Left: every claim in the order of its table; circle: agrees, triangle: partly, cross: differs. Right: "
        "ours over the printed number, where one is printed; the line is equality, the band a quarter."
    )
    height = 0.9 + 0.27 * max(len(shown), len(numbers))
    return PageFigure("Ours beside the source's", Plot((10.2, height), lambda c: _draw(c, shown, numbers)), caption)


def _draw(canvas: Canvas, rows: Sequence[MatrixRow], numbers: Sequence[tuple[str, CheckedClaim]]) -> None:
    left, *others = canvas.subplots(1, 2 if numbers else 1, squeeze=False)[0]
    for k, row in enumerate(rows):
        for n, one in enumerate(row.found):
            colour, marker = _LOOK[one.word]
            left.plot(n + 1, k, marker, ms=7, color=colour)
    _names(left, [row.entry.number for row in rows])
    left.set_xlabel("claims of each figure or table (1)")
    for axes in others:
        _ratios(axes, numbers)


def _ratios(axes: Axes, numbers: Sequence[tuple[str, CheckedClaim]]) -> None:
    for k, (_, one) in enumerate(numbers):
        colour, marker = _LOOK[one.word]
        axes.plot(float(one.ratio or 0.0), k, marker, ms=7, color=colour)
    axes.axvline(1, color="black", lw=0.8)
    axes.axvspan(0.75, 1.25, color=GREY, alpha=0.15, lw=0)
    axes.set(xscale="log", xlabel="ours over the source's (1)", xlim=(0.2, 2.5))
    axes.set_xticks([0.25, 0.5, 1, 2], ["1/4", "1/2", "1", "2"])
    axes.minorticks_off()
    _names(axes, [f"{number}: {_short(one.row[0])}" for number, one in numbers])


def _names(axes: Axes, names: Sequence[str]) -> None:
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.set_ylim(max(len(names), 1) - 0.5, -0.5)
    axes.grid(axis="y", lw=0.3)


def _short(says: str, most: int = 46) -> str:
    return says if len(says) <= most else says[: most - 1].rstrip() + "…"
