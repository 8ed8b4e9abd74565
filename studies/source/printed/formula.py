"""Pressure as a formula of depth and curvature: Fig. 4-9, Eq. 4.1 and 4.2."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from scipy.stats import spearmanr

from rig.compare.pressure_formula import ContactSamples
from rig.report.page_parts import PageFigure, Section
from rig.report.style import Plot
from studies.source.pressure_fits import (
    CENTRED,
    DEPTHS_MM,
    STEP_GWT,
    STEP_X_MM,
    UNSEEN,
    PressedPlaces,
    PressureStudy,
    fits_section,
    layers_section,
    pressed,
)
from studies.source.printed.answers import FingerAnswers, PrintedPress, deep, forced, once
from studies.source.printed.drawing import COLOURS

MIDDLE = [deep(shape, doi) for shape, depths in CENTRED.items() for doi in depths]
STEPS = [forced(f"step:{n}", force, x) for n in "135" for x in STEP_X_MM for force in STEP_GWT]
OTHERS = [deep(shape, doi) for shape in UNSEEN for doi in DEPTHS_MM]


@once
def study(answers: FingerAnswers) -> PressureStudy:
    """All that is pressed for the formula."""

    def of(scenes: list[PrintedPress]) -> list[PressedPlaces]:
        return [pressed(answers.finger, scene.shape, answers.press(scene)) for scene in scenes]

    return PressureStudy(answers.finger, of(MIDDLE), of(STEPS), of(OTHERS))


def least(answers: FingerAnswers, k: int) -> float:
    """Low end of a constant's interval, over the patch."""
    return study(answers).fits["patch"].spread.intervals[k][0]


def least_k2_over_k1(answers: FingerAnswers) -> float:
    """Low end of the interval of K2 − K1, over the patch."""
    return study(answers).fits["patch"].spread.k2_over_k1[0]


def constants_said(answers: FingerAnswers) -> str:
    """All constants, in words."""
    fits = study(answers).fits
    return "; ".join(
        f"{name} K1, K2, K3 = {', '.join(f'{k:.0f}' for k in fits[name].constants)}" for name in ("patch", "row")
    )


def k2_with_curvature(answers: FingerAnswers) -> float:
    """Rank correlation of the slope within contacts with the curvature, over bars and cylinders."""
    _, curvature, _, k2 = zip(*study(answers).by_shape, strict=True)
    return float(spearmanr(curvature, k2).statistic)


def by_shape(answers: FingerAnswers) -> str:
    """K2 of every shape, in words."""
    return ", ".join(f"{k2:.0f} ({shape})" for shape, _, _, k2 in study(answers).by_shape)


def constant(answers: FingerAnswers, k: int) -> str:
    """With its intervals, in words."""
    fits = study(answers).fits
    return f"patch {fits['patch'].with_interval(k)}, row {fits['row'].with_interval(k)}"


def figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    """Pressure against displacement."""
    caption = (
        "Pressure against the skin's own downward displacement at every node that carries force, one colour a "
        "depth (0.33, 0.67, 1.0, 1.33 mm); lines: the formula with the patch's constants at the contact's median "
        "curvature. Upper row: all nodes of the patch; lower row: the receptor plane alone. Crosses lie within "
        "0.35 mm of a bar's edge and are not fitted."
    )
    title = "Pressure against displacement"
    return (PageFigure(title, Plot((10.2, 5.6), lambda canvas: _draw(canvas, study(answers))), caption),)


def _draw(canvas: Canvas, shown: PressureStudy) -> None:
    panels = canvas.subplots(2, len(CENTRED), sharex=True, sharey=True)
    for column, shape in zip(panels.T, CENTRED, strict=True):
        members = [one for one in shown.centred if one.shape == shape]
        for colour, one in zip(COLOURS, members, strict=False):
            for axes, at in zip(column, (one.patch, one.row), strict=True):
                _scatter(axes, at, colour)
                _line(axes, at, shown, colour)
        column[0].set_title(shape, fontsize=9)
        column[-1].set_xlabel("displacement d (mm)")
    panels[0, 0].set(ylabel="pressure, patch (pseudo-units)", ylim=(0, 2200))
    panels[1, 0].set_ylabel("pressure, row (pseudo-units)")


def _scatter(axes: Axes, at: ContactSamples, colour: str) -> None:
    fitted = at.off_edges
    axes.plot(at.displacement_mm, at.pressure, "x", ms=2.5, mew=0.4, color=colour, rasterized=True)
    axes.plot(fitted.displacement_mm, fitted.pressure, "o", ms=2.2, color=colour, rasterized=True)


def _line(axes: Axes, at: ContactSamples, shown: PressureStudy, colour: str) -> None:
    k1, k2, k3 = shown.fits["patch"].constants
    doi, curvature = at.doi_mm[0], np.median(at.curvature_per_mm)
    d = np.array([at.displacement_mm.min(), doi])
    axes.plot(d, k2 * (d - doi * (1 - k1 / k2)) + k3 * curvature, color=colour, lw=1)


def tables(answers: FingerAnswers) -> tuple[Section, ...]:
    """Fits, and fingers of other layers."""
    return fits_section(study(answers)), layers_section()
