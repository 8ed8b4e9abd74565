"""The skin's deflection along the finger under what lies across it, and a measured one laid over it.

Measured deflections are a CSV of the columns `z_mm,deflection_mm[,doi_mm]`: z along the finger in the model's frame
(0 at the proximal edge, 12.75 at the tip), the skin's downward displacement there, and the depth that goes with it.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from rig.compare.recordings.table_file import no_rows, read_table
from rig.data import Run
from rig.plan.responses import responses
from rig.plan.shape_files import from_copy
from rig.report.html import Figure, Section
from rig.report.style import Plot, shade
from sim.contact.indentor import ACROSS
from sim.contact.shapes import parse_shape
from sim.models.fingertip import Fingertip

Array = NDArray[np.float64]

_SAME_DEPTH_MM = 0.05


@dataclass(frozen=True)
class Deflection:
    """(n,) downward displacements at (n,) z along the pad's centre line, in mm, at one depth."""

    doi_mm: float  # NaN where a measured one does not say
    z_mm: Array
    deflection_mm: Array


def simulated(run: Run, finger: Fingertip) -> list[Deflection]:
    """What the model gives at every hold of a run with an indentor that lies across the finger; none of others."""
    if not any(
        parse_shape(from_copy(run.folder.path, event["indentor"])).axes == ACROSS for event in run.stream("mount")
    ):
        return []
    results = [one.result for one in responses(run, finger) if one.result.indentor.axes == ACROSS]
    return [Deflection(result.doi_mm, *result.axial_profile) for result in results]


def read_deflections(path: Path) -> list[Deflection]:
    """One for each depth that the file names, in ascending order. Raises RecordingError with row and column."""
    rows = []
    for row in read_table(path, ("z_mm", "deflection_mm"), ("doi_mm",)):
        doi = row.number("doi_mm", least=0.0) if row.cells.get("doi_mm") else math.nan
        rows.append((doi, row.number("z_mm"), row.number("deflection_mm")))
    if not rows:
        raise no_rows(path, "z_mm,deflection_mm[,doi_mm]")
    table = np.array(sorted(rows))
    depths, which = np.unique(table[:, 0], return_inverse=True)  # NaNs count as one
    return [Deflection(float(depth), *table[which == k, 1:].T) for k, depth in enumerate(depths)]


def partner(measured: Deflection, among: list[Deflection]) -> Deflection | None:
    """The simulated deflection at a measured one's depth; None where none is within 0.05 mm of it."""
    if math.isnan(measured.doi_mm) or not among:
        return None
    nearest = min(among, key=lambda one: abs(one.doi_mm - measured.doi_mm))
    return nearest if abs(nearest.doi_mm - measured.doi_mm) <= _SAME_DEPTH_MM else None


def deflection_section(profiles: list[Deflection], measured: list[Deflection], source: str = "") -> Section:
    """The profiles, and how far the measured points lie from them."""
    rows = tuple(_row(one, partner(one, profiles)) for one in measured)
    figure = Figure(
        "Deflection of the skin along the finger",
        Plot((7.2, 3.8), lambda canvas: _draw(canvas, profiles, measured)),
        "Downward displacement of the skin along the pad's centre line against undeformed z (proximal to the left). "
        + ("Circles: measured, in the colour of their depth, black where none is given." if measured else ""),
    )
    text = "The indentor lies across the finger; what it does to the skin beside it is what can be measured by eye."
    text += f" Measured: {source}." if source else ""
    header = ("measured at DOI (mm)", "points", "measured − model, mean (mm)", "rms (mm)") if measured else ()
    return Section("Deflection along the finger", text, header, rows, (figure,))


def _row(one: Deflection, other: Deflection | None) -> tuple[str, ...]:
    depth = "not given" if math.isnan(one.doi_mm) else f"{one.doi_mm:g}"
    if other is None:
        return depth, f"{len(one.z_mm)}", "–", "–"
    inside = (one.z_mm >= other.z_mm[0]) & (one.z_mm <= other.z_mm[-1])
    left = (one.deflection_mm - np.interp(one.z_mm, other.z_mm, other.deflection_mm))[inside]
    if not len(left):
        return depth, "0", "–", "–"
    mean, rms = f"{left.mean():+.3f}".replace("-", "−"), f"{np.sqrt(np.mean(left**2)):.3f}"
    return depth, f"{len(left)}", mean, rms


def _draw(canvas: Canvas, profiles: list[Deflection], measured: list[Deflection]) -> None:
    axes = canvas.subplots()
    colours = {id(one): shade(k, len(profiles)) for k, one in enumerate(profiles)}
    for one in profiles:
        axes.plot(one.z_mm, one.deflection_mm, color=colours[id(one)], lw=1.4, label=f"DOI {one.doi_mm:.2f} mm")
    for points in measured:
        other = partner(points, profiles)
        colour = "black" if other is None else colours[id(other)]
        axes.plot(points.z_mm, points.deflection_mm, "o", ms=4, mfc="none", mec=colour)
    axes.axhline(0, color="black", lw=0.6)
    axes.set(xlabel="along the finger, z (mm)", ylabel="deflection of the skin (mm)")
    axes.invert_yaxis()
    axes.legend(fontsize=8)
