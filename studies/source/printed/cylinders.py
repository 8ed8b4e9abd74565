"""Cylinders on the pad's centre, beside the bar: Fig. 4-3 and 4-8."""

from functools import partial

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from rig.report.page import PageFigure
from rig.report.style import Plot
from studies.source.printed.answers import ROW_DEPTH_MM, FingerAnswers, PrintedPress, deep, forced, once
from studies.source.printed.drawing import COLOURS, PROMINENT, maps, maxima, pressures, second
from studies.source.printed.entry import Claim, Entry
from studies.source.printed.rules import Above, Below, Near, Same

Array = NDArray[np.float64]

DOIS_MM = (0.33, 1.0, 1.33)
THICK, THIN = ([deep(f"cylinder:{d}", doi) for doi in DOIS_MM] for d in (9, 3))
SHAPES = ("bar:3.0", "cylinder:9", "cylinder:3")
DEEP_MM, DEEP_X_MM = 2.5, 0.17 * np.arange(-11.0, 12.0)  # the row that lies inside the finger there


@once
def equal_force(answers: FingerAnswers) -> PrintedPress:
    """The thin cylinder at the force that the thick one needs for its deepest DOI."""
    return forced("cylinder:3", answers.press(THICK[-1]).force_gwt)


def more_force(answers: FingerAnswers, k: int) -> float:
    """By how much the thick cylinder's force exceeds the thin one's."""
    return answers.press(THICK[k]).force_gwt / answers.press(THIN[k]).force_gwt - 1


def _forces(answers: FingerAnswers, k: int) -> str:
    thick, thin = answers.press(THICK[k]).force_gwt, answers.press(THIN[k]).force_gwt
    return f"{thick:.2f} and {thin:.2f} gwt"


def _peak(answers: FingerAnswers, scene: PrintedPress) -> float:
    return float(answers.press(scene).pressure_profile[1].max())


def higher_peak(answers: FingerAnswers) -> float:
    """By how much the thin cylinder's peak exceeds the thick one's at the same force."""
    return _peak(answers, equal_force(answers)) / _peak(answers, THICK[-1]) - 1


def _peaks(answers: FingerAnswers) -> str:
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


def _maxima(answers: FingerAnswers, shape: str) -> str:
    return f"{maxima(_sed(answers, shape))}"


def _sed(answers: FingerAnswers, shape: str) -> Array:
    _, profiles = sed_below(answers, DOIS_MM[-1], ROW_DEPTH_MM)
    return profiles[SHAPES.index(shape)]


def _second(answers: FingerAnswers, shape: str) -> str:
    return f"second stands out by {second(_sed(answers, shape)):.0%}"


def _count(shape: str, source: str, partly: tuple[str, ...]) -> Claim:
    return Claim(
        f"SED maxima under {shape}, DOI 1.33, 0.75 mm deep",
        source,
        Same((source,), partly),
        partial(_maxima, shape=shape),
        beside=partial(_second, shape=shape),
    )


def _pressure_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    pressed = [*THICK, *THIN]
    beside = [deep("bar:3.0", DOIS_MM[-1]), THICK[-1], THIN[-1], equal_force(answers)]
    return (
        maps(answers, pressed, "Pressure under the cylinders over x and z"),
        pressures(answers, beside, "Bar and cylinders side by side"),
    )


def _sed_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
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
        row[0].set_ylabel("SED over its peak")
    for axes in panels[-1]:
        axes.set_xlabel("x (mm)")
    panels[0, 0].legend(fontsize=8)


ENTRIES = (
    Entry(
        "4-3",
        "Pressure over x and z under cylinders of 9 and 3 mm: the blunt one needs more force, the thin one "
        "presses harder.",
        (
            Claim(
                "force of 9 mm over 3 mm less one, DOI 0.33",
                "about 10 %",
                Near(0.10, 0.35, 1.0),
                partial(more_force, k=0),
                "{:.1%}",
                partial(_forces, k=0),
            ),
            Claim(
                "the same, DOI 1.0",
                "about 15 %",
                Near(0.15, 0.35, 1.0),
                partial(more_force, k=1),
                "{:.1%}",
                partial(_forces, k=1),
            ),
            Claim(
                "peak of 3 mm over 9 mm less one, at the force of 9 mm at 1.33",
                "about 30 %",
                Near(0.30, 0.35, 1.0),
                higher_peak,
                "{:.0%}",
                _peaks,
            ),
        ),
        (*THICK, *THIN, deep("bar:3.0", DOIS_MM[-1])),
        _pressure_figures,
        reading="The shapes of the printed panels are not known; the figure shows all of the schedule.",
    ),
    Entry(
        "4-8",
        "SED under bar and cylinders: its shapes differ near the skin and nearly coincide 2.5 mm below it.",
        (
            Claim(
                "largest difference of normalised SED, DOI 1.33, 2.5 mm deep",
                "nearly coincide",
                Below(0.10, 0.25),
                partial(apart, doi_mm=1.33, depth_mm=DEEP_MM),
            ),
            Claim(
                "the same, DOI 1.33, 0.75 mm deep",
                "differ",
                Above(0.25, 0.10),
                partial(apart, doi_mm=1.33, depth_mm=ROW_DEPTH_MM),
            ),
            _count("bar:3.0", "2", ("3",)),
            _count("cylinder:9", "1", ("2",)),
            _count("cylinder:3", "1", ("2",)),
        ),
        tuple(deep(shape, doi) for shape in SHAPES for doi in DOIS_MM),
        _sed_figures,
        reading=f"A maximum counts from {100 * PROMINENT:g} % of the range. The source shows DOI 0.33 and 1.33, not "
        "1.0.",
    ),
)
