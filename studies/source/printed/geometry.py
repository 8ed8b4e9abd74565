"""The finger itself: ch. 3."""

import numpy as np
from matplotlib.figure import Figure as Canvas

from rig.report.page_parts import PageFigure
from rig.report.recording_sections import Deflection, deflection_section
from rig.report.style import BLUE, GREY, ORANGE, Plot
from sim.finger.surface import published_points
from studies.source.printed.answers import FingerAnswers

LINE_DOIS_MM = (0.5, 1.0, 1.5, 2.0)


def apex(answers: FingerAnswers, name: str) -> float:
    """One number of the skin's apex."""
    return float(getattr(answers.finger.surface.apex, name))


def apex_x(answers: FingerAnswers) -> float:
    """Where the apex lies across the finger, mm."""
    return float(answers.finger.surface.apex.position_mm[0])


def nodes(answers: FingerAnswers) -> float:
    """Of the whole mesh."""
    return float(answers.finger.model.nodes)


def spacing(answers: FingerAnswers) -> float:
    """Largest distance between neighbouring nodes across the finger, under the pad's centre; mm."""
    model = answers.finger.model
    x = np.sort(
        model.patch.x[model.patch.x.size // 2 // model.patch.shape[1] * model.patch.shape[1] :][
            : model.patch.shape[1]
        ]
    )
    return float(np.diff(x).max())


def figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    """The skin and its published points."""
    caption = (
        "Left: the section in the receptor plane, and the published points within 1 mm of it. Right: the skin's "
        "topmost line along the finger, and the points nearest to it."
    )
    return (PageFigure("The skin", Plot((10.2, 3.4), lambda canvas: _draw(canvas, answers)), caption),)


def _draw(canvas: Canvas, answers: FingerAnswers) -> None:
    surface, plane_mm = answers.finger.surface, answers.finger.config.receptor_plane_mm
    across, along = canvas.subplots(1, 2, width_ratios=(2, 3))
    x, y = surface.section(np.linspace(0, 2 * np.pi, 181), plane_mm)
    _, points, _ = published_points()
    near = np.abs(points[:, 2] - plane_mm) < 1.0
    across.plot(x, y, color=BLUE)
    across.plot(points[near, 0], points[near, 1], "o", ms=4, mfc="none", color=ORANGE)
    across.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    z = np.linspace(2.2, 10.8, 120)
    along.plot(z, surface.crest(z), color=BLUE)
    middle = np.abs(points[:, 0]) < 0.8
    along.plot(points[middle, 2], points[middle, 1], "o", ms=4, mfc="none", color=ORANGE)
    along.axvline(plane_mm, color=GREY, lw=0.6, ls=":")
    along.set(xlabel="along the finger, z (mm)", ylabel="y (mm)", aspect="equal")


def line_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    """Deflection under a line load across the finger."""
    results = [answers.finger.indent("line", doi_mm=doi) for doi in LINE_DOIS_MM]
    return deflection_section([Deflection(result.doi_mm, *result.axial_profile) for result in results], []).figures
