"""Strain energy and axial stress beneath steps: ch. 4, Fig. 4-7; and at two forces: Fig. 5-3."""

import numpy as np
from scipy.signal import find_peaks

from rig.report.page_parts import PageFigure
from rig.report.style import signed
from studies.source.printed.answers import HIGH_GWT, LOW_GWT, FingerAnswers, PrintedPress, deep, forced
from studies.source.printed.drawing import beneath, maxima, second
from studies.source.printed.steps import LONG_X_MM, TABLE_X_MM

DEEP, LIGHT = deep("step:1", 0.73, TABLE_X_MM), forced("step:1", LOW_GWT, TABLE_X_MM)
LONG = [forced("step:5", force, LONG_X_MM) for force in (LOW_GWT, HIGH_GWT)]
PAIRED_X_MM = (2.0, TABLE_X_MM, -2.25, -3.69)
PAIRED = {x: [forced("step:1", force, x) for force in (LOW_GWT, HIGH_GWT)] for x in PAIRED_X_MM}
TWO = PAIRED[-2.25]

BOTH = [LIGHT, LONG[0]]
DRAWN: dict[str, tuple[list[tuple[str, list[PrintedPress]]], tuple[str, ...]]] = {
    "Under step 1 at −1.63": ([("two depths", [DEEP, LIGHT])], ("sed", "s33")),
    "Under step 5 at −3.13": ([("two forces", LONG)], ("sed", "s33")),
    "Step 1 at −2.25 at two forces": ([("x = −2.25", TWO)], ("sed", "ep1")),
    "Step 1 at four places and two forces": (
        [(f"x = {signed(x)}", pair) for x, pair in PAIRED.items()],
        ("sed", "ep1"),
    ),
    "Under both steps": ([("low force", BOTH)], ("sed", "ep1")),
}
"""Title of a figure, its rows of presses, its measures."""


def figures(answers: FingerAnswers, title: str) -> tuple[PageFigure, ...]:
    """One of `DRAWN`."""
    rows, measures = DRAWN[title]
    return (beneath(answers, rows, measures, title),)


def count(answers: FingerAnswers, scene: PrintedPress, measure: str) -> str:
    """Maxima of a measure."""
    return f"{maxima(answers.beneath(scene, measure)[1])}"


def second_maximum(answers: FingerAnswers, scene: PrintedPress, measure: str) -> float:
    """How far the second maximum stands out, of the range."""
    return second(answers.beneath(scene, measure)[1])


def stands_out(answers: FingerAnswers, scene: PrintedPress, measure: str) -> str:
    """The same in words."""
    return f"second stands out by {second_maximum(answers, scene, measure):.1%}"


def two_highest(answers: FingerAnswers, scene: PrintedPress) -> float:
    """The second highest maximum of SED over the highest; 0 without one."""
    _, sed = answers.beneath(scene, "sed")
    tops = np.sort(sed[find_peaks(sed)[0]])[::-1]
    return float(tops[1] / tops[0]) if len(tops) > 1 else 0.0


def growth(answers: FingerAnswers, measure: str) -> list[float]:
    """Of the population's highest value from the low to the high force, at each place."""
    highest = [[np.abs(answers.beneath(scene, measure)[1]).max() for scene in pair] for pair in PAIRED.values()]
    return [float(high / low) for low, high in highest]


def nearest_growth(answers: FingerAnswers) -> float:
    """That of SED or ep1, at the place where it is largest."""
    return max(growth(answers, "sed") + growth(answers, "ep1"))


def growths(answers: FingerAnswers) -> str:
    """Of both measures, in words."""
    return ", ".join(
        f"{name} {min(found):.1f}…{max(found):.1f}"
        for name, found in ((m if m == "ep1" else "SED", growth(answers, m)) for m in ("sed", "ep1"))
    )


def alike(answers: FingerAnswers, x_mm: float) -> float:
    """Correlation of ep1's population responses at both forces."""
    low, high = (answers.beneath(scene, "ep1")[1] for scene in PAIRED[x_mm])
    return float(np.corrcoef(low, high)[0, 1])


def widths(answers: FingerAnswers) -> tuple[float, float]:
    """Of SED at half its height under step 1 at −1.63 and step 5 at −3.13, low force; mm."""
    one, five = (_width(answers, scene) for scene in (LIGHT, LONG[0]))
    return one, five


def _width(answers: FingerAnswers, scene: PrintedPress) -> float:
    x, sed = answers.beneath(scene, "sed")
    fine = np.linspace(x[0], x[-1], 2001)
    above = fine[np.interp(fine, x, sed) >= 0.5 * sed.max()]
    return float(above[-1] - above[0])


def width_ratio(answers: FingerAnswers) -> float:
    """The first width over the second."""
    one, five = widths(answers)
    return one / five


def widths_said(answers: FingerAnswers) -> str:
    """Both widths, in words."""
    return "{:.2f} and {:.2f} mm".format(*widths(answers))
