"""Figures that only the study has."""

from typing import Any

from matplotlib.figure import Figure as Canvas

from rig.report.html import Figure, Section
from rig.report.style import BLUE, GREEN, ORANGE, Plot
from sim.models.fingertip import Fingertip
from sim.models.results.indentation import IndentationResult

DOI_MM = 1.33
_LINES = ((BLUE, "-"), (ORANGE, "--"), (GREEN, "-."), ("black", ":"))


def shapes_side_by_side(finger: Fingertip, fine: dict[float, Fingertip], force_gwt: float) -> Section:
    """Bar and both cylinders at one depth, and the thin cylinder at the thick one's force."""
    scenes: dict[str, tuple[str, dict[str, Any]]] = {
        f"bar 3.0 at {DOI_MM} mm": ("bar:3.0", {"doi_mm": DOI_MM}),
        f"cylinder 9 at {DOI_MM} mm": ("cylinder:9", {"doi_mm": DOI_MM}),
        f"cylinder 3 at {DOI_MM} mm": ("cylinder:3", {"doi_mm": DOI_MM}),
        f"cylinder 3 at {force_gwt:g} gwt": ("cylinder:3", {"force_gwt": force_gwt}),
    }
    fingers = {0.0: finger, **fine}
    results = {
        depth: {name: one.indent(shape, 0.0, **target) for name, (shape, target) in scenes.items()}
        for depth, one in fingers.items()
    }
    rows = tuple(
        (name, f"{r.force_gwt:.2f}", f"{r.doi_mm:.3f}", f"{r.peak_pressure_pseudo:.0f}")
        for name, r in results[0.0].items()
    )
    figure = Figure(
        "Bar and cylinders side by side",
        Plot((10.2, 3.4), lambda canvas: _draw(canvas, results)),
        "Pressure in the receptor plane (left) and SED at two depths below the skin, indentor centred.",
    )
    text = "The source's comparison of a bar with two cylinders. The last row has the force of the second."
    return Section(
        "Bar and cylinders",
        text,
        ("scene", "force (gwt)", "DOI (mm)", "peak pressure (pseudo-units)"),
        rows,
        (figure,),
    )


def _draw(canvas: Canvas, results: dict[float, dict[str, IndentationResult]]) -> None:
    panels = canvas.subplots(1, len(results))
    for axes, (depth, scenes) in zip(panels, results.items(), strict=True):
        for (name, result), (colour, line) in zip(scenes.items(), _LINES, strict=True):
            if depth == 0:
                x, y = result.pressure_profile
            else:
                x, y = result.model.receptors.position_mm[:, 0], result.receptor_measures["sed"]
            axes.plot(x, y, line, color=colour, lw=1.3, label=name)
        axes.set(xlabel="x (mm)", ylabel="SED (pseudo-units)" if depth else "pressure (pseudo-units)")
        axes.set_title(f"SED {depth:g} mm below the skin" if depth else "pressure on the skin", fontsize=9)
        axes.set_ylim(bottom=0)
    handles, labels = panels[0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)
