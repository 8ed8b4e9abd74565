"""Profiles under the 3 mm bar against recorded rates: Fig. 5-12 and 5-13.

The recording is the one of `rig compare --example bar3`: one afferent, 36 positions, read from a printed figure.
"""

import numpy as np
from matplotlib.figure import Figure as Canvas

from rig.compare.example import DOI_MM, SHAPE, recorded
from rig.compare.fit import correlation, fit_rates, predicted
from rig.compare.stimuli import StimulusRow
from rig.report.page_parts import PageFigure
from rig.report.style import BLUE, GREEN, ORANGE, Plot, label
from sim.measures.measures import MEASURES
from studies.source.printed.answers import FingerAnswers, deep, once

SURVIVORS = ("ep1", "ep3", "sed")
PRESSED = [deep(SHAPE, DOI_MM, float(x)) for x in recorded("static").position_mm]
"""The recorded positions themselves, as the source's receptor 0 lies at x = 0."""


@once
def under_recorded_bar(answers: FingerAnswers) -> StimulusRow:
    """The bar at every recorded position."""
    return answers.stimulus(PRESSED)


def recorded_r(answers: FingerAnswers, measure: str, phase: str = "static") -> float:
    """Correlation of a measure at receptor 0 with the recorded rates."""
    stimulus, recording = under_recorded_bar(answers), recorded(phase)
    receptor = int(np.argmin(np.abs(stimulus.receptor_mm)))
    return float(correlation(stimulus.at(recording.position_mm), recording.rate)[MEASURES.index(measure), receptor])


def figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    """Recorded rates, and those that each survivor predicts."""
    return (
        PageFigure(
            "Recorded and predicted rates under the 3 mm bar",
            Plot((7.2, 3.0), lambda canvas: _draw(canvas, answers)),
            "Dots: static discharge rates. Lines: R = max(0, k(ε − ε₀)) at receptor 0, fitted to each measure.",
        ),
    )


def _draw(canvas: Canvas, answers: FingerAnswers) -> None:
    axes, stimulus, recording = canvas.subplots(), under_recorded_bar(answers), recorded("static")
    receptor = int(np.argmin(np.abs(stimulus.receptor_mm)))
    eps = stimulus.at(recording.position_mm)[..., receptor]
    for name, colour in zip(SURVIVORS, (BLUE, GREEN, ORANGE), strict=True):
        values = eps[MEASURES.index(name)]
        axes.plot(recording.position_mm, predicted(fit_rates(values, recording.rate), values), color=colour,
                  label=label(name))  # fmt: skip
    axes.plot(recording.position_mm, recording.rate, "o", ms=3, color="black", label="recorded")
    axes.set(xlabel="position of the bar (mm)", ylabel="discharge rate (impulses/s)")
    axes.legend(fontsize=8)
