"""Cylinders on the pad's centre, beside the bar: Fig. 4-3 and 4-8."""

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from rig.report.page_parts import PageFigure
from rig.report.style import Plot
from studies.source.printed.answers import ROW_DEPTH_MM, FingerAnswers, PrintedPress, deep, forced, once
from studies.source.printed.drawing import COLOURS, maps, maxima, pressures, second

Array = NDArray[np.float64]

DOIS_MM = (0.33, 1.0, 1.33)
THICK, THIN = ([deep(f"cylinder:{d}", doi) for doi in DOIS_MM] for d in (9, 3))
SHAPES = ("bar:3.0", "cylinder:9", "cylinder:3")
ALL = [deep(shape, doi) for shape in SHAPES for doi in DOIS_MM]
DEEP_MM, DEEP_X_MM = 2.5, 0.17 * np.arange(-11.0, 12.0)  # the row that lies inside the finger there


@once
def equal_force(answers: FingerAnswers) -> PrintedPress:
    """The thin cylinder at the force that the thick one needs for its deepest DOI."""
    return forced("cylinder:3", answers.press(THICK[-1]).force_gwt)


def more_force(answers: FingerAnswers, k: int) -> float:
    """By how much the thick cylinder's force exceeds the thin one's."""
    return answers.press(THICK[k]).force_gwt / answers.press(THIN[k]).force_gwt - 1


def forces(answers: FingerAnswers, k: int) -> str:
    """Of the thick and the thin cylinder, in words."""
    thick, thin = answers.press(THICK[k]).force_gwt, answers.press(THIN[k]).force_gwt
    return f"{thick:.2f} and {thin:.2f} gwt"


def _peak(answers: FingerAnswers, scene: PrintedPress) -> float:
    return float(answers.press(scene).pressure_profile[1].max())


def higher_peak(answers: FingerAnswers) -> float:
    """By how much the thin cylinder's peak exceeds the thick one's at the same force."""
    return _peak(answers, equal_force(answers)) / _peak(answers, THICK[-1]) - 1


def peaks(answers: FingerAnswers) -> str:
    """Of both at the same force, in words."""
    return f"{_peak(answers, equal_force(answers)):.0f} and {_peak(answers, THICK[-1]):.0f} pseudo-units"


@once
def sed_below(answers: FingerAnswers, doi_mm: float, depth_mm: float) -> tuple[Array, tuple[Array, ...]]:
    """x (mm) and SED under bar, thick and thin cylinder, at one DOI and depth below the skin."""
    scenes = [deep(shape, doi_mm) for shape in SHAPES]
    if depth_mm == ROW_DEPTH_MM:
        found = [answers.beneath(scene, "sed") for scene in scenes]
        return found[0][0], tuple(sed for _, sed in found)
    points = answers.finger.points_below(DEEP_X_MM, depth_mm)
    fields = answers.finger.fields([answers.press(scene) for scene in scenes], points)
    return DEEP_X_MM, tuple(field.measures["sed"] for field in fields)


def apart(answers: FingerAnswers, doi_mm: float, depth_mm: float) -> float:
    """Largest difference between two of the three SED profiles over the row that reaches both depths, each "
    "over its peak."""
    x, profiles = sed_below(answers, doi_mm, depth_mm)
    inside = np.abs(x) <= DEEP_X_MM[-1] + 1e-9
    shapes = np.array([profile[inside] / profile[inside].max() for profile in profiles])
    return float(np.ptp(shapes, axis=0).max())


def count(answers: FingerAnswers, shape: str) -> str:
    """Maxima of SED under a shape."""
    return f"{maxima(_sed(answers, shape))}"


def _sed(answers: FingerAnswers, shape: str) -> Array:
    _, profiles = sed_below(answers, DOIS_MM[-1], ROW_DEPTH_MM)
    return profiles[SHAPES.index(shape)]


def stands_out(answers: FingerAnswers, shape: str) -> str:
    """How far the second one stands out, in words."""
    return f"second stands out by {second(_sed(answers, shape)):.0%}"


def pressure_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    """Pressure under the cylinders."""
    pressed = [*THICK, *THIN]
    beside = [deep("bar:3.0", DOIS_MM[-1]), THICK[-1], THIN[-1], equal_force(answers)]
    return (
        maps(answers, pressed, "Pressure under the cylinders over x and z"),
        pressures(answers, beside, "Bar and cylinders side by side"),
    )


def sed_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    """SED under bar and cylinders."""
    caption = "Each over its peak, in the receptor plane; upper row 0.75 mm below the skin, lower 2.5 mm."
    return (PageFigure("SED under bar and cylinders", Plot((10.2, 5.2), lambda c: _draw_sed(c, answers)), caption),)


def _draw_sed(canvas: Canvas, answers: FingerAnswers) -> None:
    panels = canvas.subplots(2, len(DOIS_MM), sharex=True, sharey=True)
    for row, depth in zip(panels, (ROW_DEPTH_MM, DEEP_MM), strict=True):
        for axes, doi in zip(row, DOIS_MM, strict=True):
            x, profiles = sed_below(answers, doi, depth)
            for colour, shape, sed in zip(COLOURS, SHAPES, profiles, strict=False):
                axes.plot(x, sed / sed.max(), "-o", ms=1.8, lw=1.1, color=colour, label=shape)
            axes.set_title(f"DOI {doi:g} mm, {depth:g} mm deep", fontsize=8)
            axes.set_ylim(0, 1.05)
        row[0].set_ylabel("SED over its peak (1)")
    for axes in panels[-1]:
        axes.set_xlabel("x (mm)")
    panels[0, 0].legend(fontsize=8)
