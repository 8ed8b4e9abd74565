"""Strain energy and axial stress beneath steps: ch. 4, Fig. 4-7; and at two forces: Fig. 5-3."""

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.signal import find_peaks

from rig.report.page import PageFigure
from rig.report.style import signed
from studies.source.printed.answers import HIGH_GWT, LOW_GWT, FingerAnswers, PrintedPress, deep, forced
from studies.source.printed.drawing import PROMINENT, beneath, maxima, second
from studies.source.printed.entry import Claim, Entry
from studies.source.printed.rules import Above, Below, Near, Same
from studies.source.printed.steps import LONG_X_MM, TABLE_X_MM

DEEP, LIGHT = deep("step:1", 0.73, TABLE_X_MM), forced("step:1", LOW_GWT, TABLE_X_MM)
LONG = [forced("step:5", force, LONG_X_MM) for force in (LOW_GWT, HIGH_GWT)]
PAIRED_X_MM = (2.0, TABLE_X_MM, -2.25, -3.69)
PAIRED = {x: [forced("step:1", force, x) for force in (LOW_GWT, HIGH_GWT)] for x in PAIRED_X_MM}
TWO = PAIRED[-2.25]


def _count(answers: FingerAnswers, scene: PrintedPress, measure: str) -> str:
    return f"{maxima(answers.beneath(scene, measure)[1])}"


def _second(answers: FingerAnswers, scene: PrintedPress, measure: str) -> float:
    return second(answers.beneath(scene, measure)[1])


def _stands_out(answers: FingerAnswers, scene: PrintedPress, measure: str) -> str:
    return f"second stands out by {_second(answers, scene, measure):.1%}"


def _counted(scene: PrintedPress, measure: str, source: str, partly: str, when: str) -> Claim:
    told = partial(_stands_out, scene=scene, measure=measure)
    name = {"sed": "SED", "s33": "−s33"}[measure]
    counted = partial(_count, scene=scene, measure=measure)
    return Claim(f"{name} maxima, {when}", source, Same((source,), (partly,)), counted, beside=told)


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


def _growths(answers: FingerAnswers) -> str:
    return ", ".join(
        f"{name} {min(found):.1f}…{max(found):.1f}"
        for name, found in ((m if m == "ep1" else "SED", growth(answers, m)) for m in ("sed", "ep1"))
    )


def alike(answers: FingerAnswers, x_mm: float) -> float:
    """Correlation of ep1's population responses at both forces."""
    low, high = (answers.beneath(scene, "ep1")[1] for scene in PAIRED[x_mm])
    return float(np.corrcoef(low, high)[0, 1])


def _figure(
    title: str, rows: list[tuple[str, list[PrintedPress]]], *measures: str
) -> Callable[[FingerAnswers], tuple[PageFigure, ...]]:
    return lambda answers: (beneath(answers, rows, measures, title),)


def widths(answers: FingerAnswers) -> tuple[float, float]:
    """Of SED at half its height under step 1 at −1.63 and step 5 at −3.13, low force; mm."""
    one, five = (_width(answers, scene) for scene in (LIGHT, LONG[0]))
    return one, five


def _width(answers: FingerAnswers, scene: PrintedPress) -> float:
    x, sed = answers.beneath(scene, "sed")
    fine = np.linspace(x[0], x[-1], 2001)
    above = fine[np.interp(fine, x, sed) >= 0.5 * sed.max()]
    return float(above[-1] - above[0])


def _width_ratio(answers: FingerAnswers) -> float:
    one, five = widths(answers)
    return one / five


ENTRIES = (
    Entry(
        "ch. 4, SED under step 1",
        "SED and s33 0.75 mm under step 1 at −1.63: SED has two peaks at DOI 0.73 and one at the low force, s33 one.",
        (
            _counted(DEEP, "sed", "2", "3", "DOI 0.73"),
            _counted(LIGHT, "sed", "1", "2", f"{LOW_GWT} gwt"),
            _counted(DEEP, "s33", "1", "2", "DOI 0.73"),
            _counted(LIGHT, "s33", "1", "2", f"{LOW_GWT} gwt"),
        ),
        (DEEP, LIGHT),
        _figure("Under step 1 at −1.63", [("two depths", [DEEP, LIGHT])], "sed", "s33"),
        reading=f"A maximum counts from {100 * PROMINENT:g} % of the range, on a row of points 0.17 mm apart. At "
        "the source's ten receptors, the second one at 2.33 gwt is just below that (docs/model.md).",
    ),
    Entry(
        "4-7",
        "SED under step 5 has mostly a single peak.",
        (
            Claim(
                f"second maximum at x = {LONG_X_MM}, {HIGH_GWT:g} gwt, of the range",
                "not two distinct peaks",
                Below(PROMINENT, 0.25),
                partial(_second, scene=LONG[1], measure="sed"),
                "{:.1%}",
            ),
            Claim(
                f"the same, {LOW_GWT} gwt",
                "not two distinct peaks",
                Below(PROMINENT, 0.25),
                partial(_second, scene=LONG[0], measure="sed"),
                "{:.1%}",
            ),
        ),
        tuple(LONG),
        _figure("Under step 5 at −3.13", [("two forces", LONG)], "sed", "s33"),
    ),
    Entry(
        "5-3",
        "Step 1 at −2.25 at two forces: two near-equal SED peaks at 8 gwt, a smaller second one at 2.33; fivefold "
        "growth.",
        (
            Claim(
                "second SED maximum over the first, 8 gwt",
                "nearly equal",
                Above(0.85, 0.5),
                partial(two_highest, scene=TWO[1]),
            ),
            Claim("the same, 2.33 gwt", "smaller", Below(0.7, 0.9), partial(two_highest, scene=TWO[0])),
            Claim(
                "growth of the population's peak, largest of SED and ep1 over four places",
                "about 5, of an unnamed measure",
                Near(5.0, 0.2, 0.4),
                nearest_growth,
                "{:.1f}",
                _growths,
            ),
        ),
        tuple(TWO),
        _figure("Step 1 at −2.25 at two forces", [("x = −2.25", TWO)], "sed", "ep1"),
        reading="Force grows 3.4 times, and the contact grows with it. A contact of constant size would not raise "
        "a strain fivefold.",
    ),
    Entry(
        "ch. 5, two forces",
        "Step 1 at four places at 2.33 and 8 gwt: the same shapes of the population response.",
        tuple(
            Claim(
                f"correlation of ep1 at both forces, x = {x:g}",
                "the same shape",
                Above(0.95, 0.8),
                partial(alike, x_mm=x),
            )
            for x in PAIRED_X_MM
        ),
        tuple(scene for pair in PAIRED.values() for scene in pair),
        _figure(
            "Step 1 at four places and two forces",
            [(f"x = {signed(x)}", pair) for x, pair in PAIRED.items()],
            "sed",
            "ep1",
        ),
        reading="The population widens with the contact, and the two sides of the flat separate; both lower the "
        "correlation.",
    ),
    Entry(
        "ch. 5, widths",
        "Steps 1 and 5 give equally wide profiles beneath the skin.",
        (
            Claim(
                "width of SED at half its height, step 1 at −1.63 over step 5 at −3.13",
                "equally wide",
                Near(1.0, 0.1, 0.4),
                _width_ratio,
                "{:.2f}",
                lambda answers: "{:.2f} and {:.2f} mm".format(*widths(answers)),
            ),
        ),
        (LIGHT, LONG[0]),
        _figure("Under both steps", [("low force", [LIGHT, LONG[0]])], "sed", "ep1"),
        missing="the place, force and measure at which the source compares them",
        reading="The value is SED at the places where chapter 4 shows both steps, at the low force.",
    ),
)
