"""Bars pressed on the pad's centre: Fig. 4-1, and the narrow bar of ch. 4."""

from functools import partial

import numpy as np

from rig.report.page import PageFigure
from sim.models.result import FILTER_SPACING_MM, IndentationResult
from studies.source.printed.answers import FingerAnswers, PrintedPress, deep, once
from studies.source.printed.drawing import maps, pressures
from studies.source.printed.entry import Claim, Entry
from studies.source.printed.rules import Below, Same

WIDE = [deep("bar:3.0", doi) for doi in (0.33, 0.67, 1.0, 1.33)]
NARROW = [deep("bar:1.5", doi) for doi in (0.33, 0.67)]
FULLY = 1.5
"""An edge is touched where the pressure beside it exceeds that in the middle, fully where it does by half."""


@once
def edges(answers: FingerAnswers, scene: PrintedPress) -> tuple[float, float]:
    """Of one press."""
    return edge_ratios(answers.press(scene), 0.5 * float(scene.shape.partition(":")[2]))


def edge_ratios(result: IndentationResult, half_width_mm: float) -> tuple[float, float]:
    """Highest pressure beside the left and the right edge of a bar, over that in its middle."""
    x, pressure = result.pressure_profile
    middle = float(np.interp(result.x_mm, x, pressure))
    left, right = (
        float(pressure[np.abs(x - result.x_mm - edge_mm) < 1.5 * FILTER_SPACING_MM].max(initial=0.0))
        for edge_mm in (-half_width_mm, half_width_mm)
    )
    return left / middle, right / middle


def in_words(left: float, right: float) -> str:
    """Which edges are touched, and how."""
    degrees = {
        side: "fully" if ratio >= FULLY else "slightly"
        for side, ratio in (("left", left), ("right", right))
        if ratio > 1
    }
    if len(set(degrees.values())) == 1 and len(degrees) == 2:
        return f"both {degrees['left']}"
    return ", ".join(f"{side} {how}" for side, how in degrees.items()) or "none"


def _touched(answers: FingerAnswers, scene: PrintedPress) -> str:
    return in_words(*edges(answers, scene))


def _ratios(answers: FingerAnswers, scene: PrintedPress) -> str:
    left, right = edges(answers, scene)
    regions = answers.press(scene).contact_regions_mm
    first, last = regions[0][0], regions[-1][1]
    return f"left {left:.2f}, right {right:.2f} of the middle; contact {first:.2f} … {last:.2f}"


def _claim(scene: PrintedPress, source: str, rule: Same) -> Claim:
    says = f"edges touched at DOI {scene.value:g} mm"
    return Claim(says, source, rule, partial(_touched, scene=scene), beside=partial(_ratios, scene=scene))


def _widest(answers: FingerAnswers) -> float:
    found = [answers.press(scene).contact_regions_mm for scene in WIDE]
    return max(b - a for regions in found for a, b in regions)


LEFT_ONLY = ("left slightly", "left fully")
LEFT_MORE = "left fully, right slightly"


def _wide_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    return (
        maps(answers, WIDE, "Pressure under the bar of 3.0 mm over x and z"),
        pressures(answers, WIDE, "Pressure under the bar of 3.0 mm"),
    )


def _narrow_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    return (
        maps(answers, NARROW, "Pressure under the bar of 1.5 mm over x and z"),
        pressures(answers, NARROW, "Pressure under the bar of 1.5 mm", columns=2),
    )


ENTRIES = (
    Entry(
        "4-1",
        "Pressure over x and z under the bar of 3.0 mm: with depth the left edge bears first, then both.",
        (
            _claim(WIDE[0], "none", Same(("none",), LEFT_ONLY)),
            _claim(WIDE[1], "left only", Same(LEFT_ONLY, (LEFT_MORE,))),
            _claim(WIDE[2], "left fully, right slightly", Same((LEFT_MORE,), (*LEFT_ONLY, "both fully"))),
            _claim(WIDE[3], "both, sharp peaks", Same(("both fully",), (LEFT_MORE, "both slightly"))),
            Claim("widest contact over all depths (mm)", "never wider than 3.0", Below(3.0, 3.17), _widest),
        ),
        tuple(WIDE),
        _wide_figures,
        reading="An edge counts as touched where its pressure exceeds that in the middle of the bar, and as fully "
        f"touched from {FULLY:g} times that. The factor was chosen knowing the numbers.",
    ),
    Entry(
        "ch. 4, bar 1.5",
        "The bar of 1.5 mm: the left edge just touches at 0.33 mm, both bear with sharp peaks at 0.67 mm.",
        (
            _claim(
                NARROW[0], "left just touches, right does not", Same(("left slightly",), ("left fully", LEFT_MORE))
            ),
            _claim(NARROW[1], "both, two sharp peaks", Same(("both fully",), (LEFT_MORE, "both slightly"))),
        ),
        tuple(NARROW),
        _narrow_figures,
        reading="At 0.33 mm the contact just reaches the right edge, at 0.75. Pressure rises towards the ends of any "
        "contact of this model.",
    ),
)
