"""Bars pressed on the pad's centre: Fig. 4-1, and the narrow bar of ch. 4."""

import numpy as np

from rig.report.page_parts import PageFigure
from sim.models.result import FILTER_SPACING_MM, IndentationResult
from studies.source.printed.answers import FingerAnswers, PrintedPress, deep, once
from studies.source.printed.drawing import maps, pressures

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


def touched(answers: FingerAnswers, scene: PrintedPress) -> str:
    """Edges that are touched, in words."""
    return in_words(*edges(answers, scene))


def ratios(answers: FingerAnswers, scene: PrintedPress) -> str:
    """Pressures at both edges, and where the contact ends."""
    left, right = edges(answers, scene)
    regions = answers.press(scene).contact_regions_mm
    first, last = regions[0][0], regions[-1][1]
    return f"left {left:.2f}, right {right:.2f} of the middle; contact {first:.2f} … {last:.2f}"


def widest(answers: FingerAnswers) -> float:
    """Widest contact, mm."""
    found = [answers.press(scene).contact_regions_mm for scene in WIDE]
    return max(b - a for regions in found for a, b in regions)


def wide_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    """Of the bar of 3.0 mm."""
    return (
        maps(answers, WIDE, "Pressure under the bar of 3.0 mm over x and z"),
        pressures(answers, WIDE, "Pressure under the bar of 3.0 mm"),
    )


def narrow_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    """Of the bar of 1.5 mm."""
    return (
        maps(answers, NARROW, "Pressure under the bar of 1.5 mm over x and z"),
        pressures(answers, NARROW, "Pressure under the bar of 1.5 mm", columns=2),
    )
