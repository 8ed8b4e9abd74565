"""The finger itself: ch. 3."""

import numpy as np
from matplotlib.figure import Figure as Canvas

from rig.report.page import PageFigure
from rig.report.style import BLUE, GREY, ORANGE, Plot
from sim.finger.surface import published_points
from studies.source.printed.answers import FingerAnswers
from studies.source.printed.entry import Claim, Entry
from studies.source.printed.rules import Below, Near, Within


def _spacing(answers: FingerAnswers) -> float:
    """Largest distance between neighbouring nodes across the finger, under the pad's centre; mm."""
    model = answers.finger.model
    x = np.sort(
        model.patch.x[model.patch.x.size // 2 // model.patch.shape[1] * model.patch.shape[1] :][
            : model.patch.shape[1]
        ]
    )
    return float(np.diff(x).max())


def _figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
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


ENTRIES = (
    Entry(
        "ch. 3, geometry",
        "A pad that is nearly spherical at its apex; elements of 170 µm or less on the pulp, some 30 000 nodes.",
        (
            Claim(
                "lateral radius at the apex (mm)",
                "about 3.5",
                Near(3.5, 0.1, 0.25),
                lambda answers: answers.finger.surface.apex.lateral_radius_mm,
            ),
            Claim(
                "axial radius at the apex (mm)",
                "about 3.8",
                Near(3.8, 0.1, 0.25),
                lambda answers: answers.finger.surface.apex.axial_radius_mm,
            ),
            Claim(
                "apex at x (mm)",
                "about −0.1",
                Within(-0.1, 0.1, 0.3),
                lambda answers: answers.finger.surface.apex.position_mm[0],
            ),
            Claim("widest element across the pulp (mm)", "170 µm or less", Below(0.1705, 0.2), _spacing, "{:.3f}"),
            Claim(
                "nodes",
                "about 30 000",
                Near(30000, 0.2, 0.5),
                lambda answers: float(answers.finger.model.nodes),
                "{:.0f}",
            ),
        ),
        figures=_figures,
        reading="The source published 24 of 49 × 72 surface points, all on the pulp. docs/model.md shows which "
        "fingers its figures allow.",
    ),
)
