"""What several figures of the study share."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray
from scipy.signal import find_peaks

from rig.report.page_parts import PageFigure
from rig.report.style import BLUE, GREEN, GREY, ORANGE, PURPLE, Plot, label, signed, unit
from sim.contact.patch import X, Z
from sim.models.result import FILTER_SPACING_MM, IndentationResult, median_of_four
from studies.source.printed.answers import FingerAnswers, PrintedPress

Array = NDArray[np.float64]

PROMINENT = 0.05
"""A peak counts when it stands out by this part of the range."""

COLOURS = (BLUE, ORANGE, GREEN, PURPLE, "black")


def maxima(profile: Array) -> int:
    """How many maxima stand out."""
    return len(find_peaks(profile, prominence=PROMINENT * float(np.ptp(profile)))[0])


def prominences(profile: Array) -> Array:
    """Of all maxima over the range, the highest first."""
    found = find_peaks(profile, prominence=0)[1]["prominences"] / np.ptp(profile)
    return np.sort(found)[::-1]


def second(profile: Array) -> float:
    """How far the second maximum stands out, as a part of the range; 0 without one."""
    return float(np.append(prominences(profile), [0.0, 0.0])[1])


def told(scene: PrintedPress) -> str:
    """For titles: bar:3.0 at x = 0.00, DOI 0.33 mm."""
    how = {"doi_mm": f"DOI {scene.value:g} mm", "force_gwt": f"{scene.value:.4g} gwt"}[scene.kind]
    return f"{scene.shape} at x = {signed(scene.x_mm)}, {how}"


def maps(answers: FingerAnswers, scenes: Sequence[PrintedPress], title: str) -> PageFigure:
    """Pressure over x and z, one picture a press on one scale."""
    columns = 3 if len(scenes) in (3, 6) else min(len(scenes), 4)
    rows = -(-len(scenes) // columns)

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        top = max(answers.press(scene).peak_pressure_pseudo for scene in scenes)
        for axes, scene in zip(panels.ravel(), scenes, strict=False):
            drawn = _map(axes, answers.press(scene), top)
            axes.set_title(told(scene), fontsize=7)
        for axes in panels.ravel()[len(scenes) :]:
            axes.set_visible(False)
        canvas.supxlabel("x (mm)", fontsize=9)
        canvas.supylabel("along the finger, z (mm)", fontsize=9)
        canvas.colorbar(drawn, ax=panels, label="pressure (pseudo-units)", shrink=0.8)

    caption = (
        "Nodal pressure over lateral x and z along the finger, its tip up. Dots: nodes that carry force; dotted: "
        "the receptor plane; dashed: the indentor's reference point. One colour scale for all panels."
    )
    return PageFigure(title, Plot((1.3 + 2.2 * columns, 0.8 + 2.3 * rows), draw), caption)


def _map(axes: Axes, result: IndentationResult, top: float) -> QuadMesh:
    patch = result.model.patch
    x, z = (patch.position_mm[:, axis].reshape(patch.shape) for axis in (X, Z))
    pressure = result.nodal_pressure_pseudo.reshape(patch.shape)
    drawn = axes.pcolormesh(x, z, pressure, shading="gouraud", cmap="Blues", vmin=0, vmax=top, rasterized=True)
    axes.plot(x[pressure > 0], z[pressure > 0], ".", ms=1.2, color=ORANGE, rasterized=True)
    axes.axhline(result.model.plane_mm, color=BLUE, lw=0.5, ls=":")
    axes.axvline(result.x_mm, color=GREY, lw=0.5, ls="--")
    axes.set(xlim=(x.min(), x.max()), ylim=(z.min(), z.max()), aspect="equal")
    return drawn


def filtered(result: IndentationResult) -> tuple[Array, Array]:
    """x (mm) and pressure in the receptor plane after the source's 4×1 filter."""
    x, pressure = result.pressure_profile
    values = median_of_four(x, pressure)
    return x[0] + FILTER_SPACING_MM * (1.5 + np.arange(len(values))), values


def pressures(answers: FingerAnswers, scenes: Sequence[PrintedPress], title: str, columns: int = 4) -> PageFigure:
    """Pressure in the receptor plane, one panel a press, raw and filtered."""
    rows = -(-len(scenes) // columns)

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
        for axes, scene in zip(panels, scenes, strict=False):
            _pressure(axes, answers.press(scene))
            axes.set_title(told(scene), fontsize=7)
        for axes in panels[len(scenes) :]:
            axes.set_visible(False)
        canvas.supxlabel("x (mm)", fontsize=9)
        canvas.supylabel("pressure (pseudo-units)", fontsize=9)

    caption = "In the receptor plane, at the nodes (blue) and after the source's 4×1 median filter (orange)."
    return PageFigure(title, Plot((10.2, 0.4 + 1.75 * rows), draw), caption)


def _pressure(axes: Axes, result: IndentationResult) -> None:
    x, pressure = result.pressure_profile
    axes.plot(x, pressure, "-o", ms=1.8, lw=1, color=BLUE)
    axes.plot(*filtered(result), color=ORANGE, lw=1.1)
    axes.axvline(result.x_mm, color=GREY, lw=0.5, ls=":")
    axes.set_xlim(-2.8, 2.8)


def beneath(
    answers: FingerAnswers, rows: Sequence[tuple[str, Sequence[PrintedPress]]], measures: Sequence[str], title: str
) -> PageFigure:
    """Measures 0.75 mm below the skin in the receptor plane: a panel for each row and measure, a line a press."""

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(len(rows), len(measures), squeeze=False, sharex=True)
        for line, (name, scenes) in zip(panels, rows, strict=True):
            for axes, measure in zip(line, measures, strict=True):
                for colour, scene in zip(COLOURS, scenes, strict=False):
                    x, values = answers.beneath(scene, measure)
                    axes.plot(x, values, "-o", ms=1.8, lw=1.1, color=colour, label=told(scene))
                axes.set_ylabel(f"{label(measure)} ({unit(measure)})", fontsize=8)
            line[0].set_title(name, fontsize=8, loc="left")
            line[-1].legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
        for axes in panels[-1]:
            axes.set_xlabel("x (mm)")

    size = (min(10.2, 0.6 + 4.6 * len(measures)), 0.5 + 2.3 * len(rows))
    return PageFigure(
        title, Plot(size, draw), "In the receptor plane, 0.75 mm below the skin, at points 0.17 mm apart."
    )
