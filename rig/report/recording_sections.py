"""Sections of a comparison's report on recordings: fits, the source's figures, the skin's deflection.

The published recordings are figures, not tables; one of them was read and is shipped. Source: Raju 1998, ch. 5.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.compare.comparison import Comparison, Joint, Overlay, Pair
from rig.compare.fit import Fit, predicted
from rig.compare.recordings.deflection import ALONG_BY_DEPTH, read_skin_deflection
from rig.data import Run
from rig.plan.finger_model import from_copy, responses
from rig.report.measure_colors import color_of
from rig.report.page_parts import Section
from rig.report.plot import Plot, Series, Subplot, guide, in_grid, rows_of
from rig.report.style import GREY, as_number, in_unit, label, rate_label, shade, signed
from rig.report.verdict_figures import stimulus_styles
from rig_shared.plural import number_of
from sim.contact.indentor import ACROSS
from sim.contact.shapes import parse_shape
from sim.measures.measures import MEASURES
from sim.models.fingertip import Fingertip

_WIDEST_IN = 9.8


def _rate(joint: Joint) -> str:
    return rate_label(joint.overlays[0].recording.rate_unit)


def overlays(joint: Joint, pairs: list[Pair], figure: str = "", files: str = "") -> Plot:
    """Plot rates predicted by the joint line over recorded ones: pairs down, shapes across."""
    rows, columns = (len(pairs), len(joint.overlays)) if len(joint.overlays) > 1 else (1, len(pairs))
    panels = [
        Subplot("position from field center (mm)", _rate(joint), _overlay(overlay, joint.fit, pair),
              f"{overlay.stimulus.title}: {named(overlay.stimulus.receptor_mm, pair)}",
              printed="x" if k >= (rows - 1) * columns else "")
        for k, (pair, overlay) in enumerate((pair, overlay) for pair in pairs for overlay in joint.overlays)
    ]  # fmt: skip

    def finish(canvas: Figure, axes: list[Axes]) -> None:
        canvas.suptitle(frame(joint.overlays), fontsize=7, color=GREY)
        canvas.supylabel(_rate(joint), fontsize=9)

    return Plot(
        (0.6 + min(3.2 * columns, _WIDEST_IN), 0.7 + 1.85 * rows), panels,
        f"Fig. {figure} of the source: predicted over recorded",
        f"Dots: recorded rates, ± 1 sd. Lines: rates predicted by this line. Data: {files}.",
        arrange=in_grid(len(panels), columns, sharex=rows == 1 or "col", sharey=True), finish=finish,
        titles={"fontsize": 8},
    )  # fmt: skip


def _overlay(overlay: Overlay, fit: Fit, pair: Pair) -> list[Series]:
    recording = overlay.recording
    fine = np.linspace(recording.position_mm[0], recording.position_mm[-1], 241)
    line = predicted(Fit(*(np.asarray(v[pair]) for v in fit)), overlay.stimulus.at(fine)[pair[0], :, pair[1]])
    where = {"stimulus": overlay.stimulus.title, "pair": pair}
    return [
        Series("plot", fine, line, color=color_of(MEASURES[pair[0]]), lw=1.4,
               rows=rows_of("joint line", "position_mm", "predicted", **where)),
        Series("errorbar", recording.position_mm, recording.rate, recording.sd, fmt="o", ms=3, color="black",
               elinewidth=0.7, rows=rows_of("recording", "position_mm", "rate", "sd", **where)),
    ]  # fmt: skip


def scatter(joint: Joint, pairs: list[Pair], figure: str = "", files: str = "") -> Plot:
    """Plot recorded rate against the measure for all shapes, with the joint line."""

    def finish(canvas: Figure, axes: list[Axes]) -> None:
        canvas.suptitle(frame(joint.overlays), fontsize=7, color=GREY)
        canvas.supylabel(_rate(joint), fontsize=9)
        lines, names = axes[0].get_legend_handles_labels()
        canvas.legend(lines, names, loc="outside lower center", ncols=len(names), fontsize=8)

    return Plot(
        (0.4 + 2.7 * len(pairs), 3.1), [_against_measure(joint, pair) for pair in pairs],
        f"Fig. {figure} of the source: rate against measure",
        f"Each point is a recorded position; the line is that over all shapes. Data: {files}.",
        arrange=in_grid(len(pairs), len(pairs), sharey=True), finish=finish, titles={"fontsize": 8},
    )  # fmt: skip


def _against_measure(joint: Joint, pair: Pair) -> Subplot:
    (measure, receptor), series = pair, []
    styles = stimulus_styles(len(joint.overlays))
    for overlay, (colour, marker) in zip(joint.overlays, styles, strict=True):
        style = {
            "ls": "",
            "marker": marker,
            "ms": 4,
            "mfc": "none",
            "mec": colour,
            "label": overlay.stimulus.indentor,
        }
        rows = rows_of("recording", "eps", "rate", stimulus=overlay.stimulus.title, pair=pair)
        series.append(Series("plot", overlay.eps[measure, :, receptor], overlay.recording.rate, rows=rows, **style))
    k, eps0 = joint.fit.k[pair], joint.fit.eps0[pair]
    low, high = (float(f(joint.eps[measure, :, receptor])) for f in (np.nanmin, np.nanmax))
    fine = np.linspace(low - 0.05 * (high - low), high + 0.05 * (high - low), 101)
    rows = rows_of("joint line", "eps", "rate", pair=pair)
    line = Series(
        "plot", fine, np.maximum(0, k * (fine - eps0)), color=color_of(MEASURES[measure]), lw=1.4, rows=rows
    )
    fitted = f"R² = {joint.explained[pair]:.3f}, k = {k:.3g}, ε₀ = {eps0:.3g}".replace("-", "−")
    title = f"{named(joint.overlays[0].stimulus.receptor_mm, pair)}\n{fitted}"
    return Subplot(in_unit(MEASURES[measure]), _rate(joint), [*series, line], title, printed="x")


def frame(overlays: Sequence[Overlay]) -> str:
    """Return the note on every figure about how recorded positions and rates are aligned with the simulation."""
    changed = {f"{p.stimulus.indentor} {change}" for p in overlays for change in p.recording.changes}
    return "; ".join(["indentor x = recorded position + receptor x, no offset fitted", *sorted(changed)])


def named(receptor_mm: NDArray[np.float64], pair: Pair) -> str:
    """Return the name of a measure at a receptor."""
    return f"{label(MEASURES[pair[0]])} at {signed(receptor_mm[pair[1]])} mm"


SURVIVORS = ("ep1", "ep3", "sed")
"""Measures that the source retains and plots."""


class PublishedRecordings(NamedTuple):
    """Recordings that the source compares with, where it judges them, and the figures that show it."""

    scatter: str
    profiles: str
    who: str
    shapes: tuple[str, ...]  # canonical names
    condition: str
    receptor_mm: float


PUBLISHED = (
    PublishedRecordings("5-8", "5-9", "Srinivasan & LaMotte 1987", ("step:1", "step:3", "step:5"), "8 gwt", -1.0),
    PublishedRecordings("5-12", "5-13", "Phillips & Johnson 1981", ("bar:1.5", "bar:3"), "1 mm", 0.0),
)


def source_sections(comparison: Comparison) -> list[Section]:
    """Return the section on the source's figures and files, and its table if a recording is loaded."""
    table = table_5_1(comparison)
    return [source_section(comparison), *([table] if table.rows else [])]


def source_section(comparison: Comparison) -> Section:
    """Return a row for each figure and table of the source, and the figures whose recordings are loaded."""
    return Section(
        "Figures of the source filled by recordings",
        "Raju (1998, ch. 5) plots these over recordings that were published as figures, not as tables; only "
        "the rates under the 3 mm bar are shipped. Published step profiles are mirror images in the frame used "
        "here (--mirror). The program uses any recording given for a shape; the file must state its source.",
        ("figure or table", "content", "needs", "here"),
        (*(row for one in PUBLISHED for row in _rows(comparison, one)), _row_of_table(comparison)),
        tuple(figure for one in PUBLISHED for figure in _figures(comparison, one)),
    )


def table_5_1(comparison: Comparison) -> Section:
    """Return Pearson's r of the source's measures with each recording, and the joint line; no rows without one."""
    return Section(
        "Table 5.1 of the source",
        "Pearson's r between the recorded rates and the measure at the recorded positions for each shape, "
        "and k and ε₀ of one line R = max(0, k(ε − ε₀)) by least squares; steps at −1.0 mm and bars at 0 mm, "
        "as in the source. The verdict does not use r and R².",
        ("recordings", "measure", "receptor (mm)", "r for each shape", "k", "ε₀", "R²"),
        tuple(row for one in PUBLISHED for row in _correlations(comparison, one)),
    )


def _rows(comparison: Comparison, one: PublishedRecordings) -> list[tuple[str, ...]]:
    needs = f"{', '.join(one.shapes)} at {one.condition} ({one.who})"
    what = f"one line over {', '.join(one.shapes)}, receptor at {signed(one.receptor_mm)} mm"
    here = _here(comparison, one)
    return [
        (f"Fig. {one.scatter}", f"rate against measure, {what}", needs, here),
        (f"Fig. {one.profiles}", f"predicted over recorded profiles, {what}", needs, here),
    ]


def _row_of_table(comparison: Comparison) -> tuple[str, ...]:
    filled = [one for one in PUBLISHED if _recorded(comparison, one)]
    here = "filled" if len(filled) == len(PUBLISHED) else "partly filled" if filled else "empty"
    return ("Table 5.1", "correlation of rates and measures for each shape", "either recording", here)


def _here(comparison: Comparison, one: PublishedRecordings) -> str:
    """Return the files that fill the figure, or the missing ones."""
    found = {overlay.stimulus.shape: overlay.recording.name for overlay in _recorded(comparison, one)}
    missing = [shape for shape in one.shapes if shape not in found]
    if not missing:
        return f"filled: {', '.join(found.values())}"
    pressed = {s.shape for s in comparison.stimuli if s.condition == one.condition}
    runs = [f"a run of {shape} at {one.condition}" for shape in missing if shape not in pressed]
    return "empty: give " + ", ".join([*(f"--recorded {shape}=FILE" for shape in missing), *runs])


def _recorded(comparison: Comparison, one: PublishedRecordings) -> list[Overlay]:
    """Return the overlays that belong to a figure, in its order."""
    mine = {p.stimulus.shape: p for p in comparison.overlays if p.stimulus.condition == one.condition}
    return [mine[shape] for shape in one.shapes if shape in mine]


def _joint(comparison: Comparison, one: PublishedRecordings) -> tuple[Joint, list[Pair]] | None:
    """Return the joint line of its recordings, and the source's measures; None if a recording is missing."""
    found = _recorded(comparison, one)
    if len(found) < len(one.shapes):
        return None
    receptor = int(np.argmin(np.abs(found[0].stimulus.receptor_mm - one.receptor_mm)))
    joint = Joint(tuple(found))
    pairs = [(MEASURES.index(name), receptor) for name in SURVIVORS]
    return joint, [pair for pair in pairs if np.isfinite(joint.fit.k[pair])]


def _figures(comparison: Comparison, one: PublishedRecordings) -> list[Plot]:
    found = _joint(comparison, one)
    if found is None or not found[1]:
        return []
    files = ", ".join(overlay.recording.name for overlay in found[0].overlays)
    return [scatter(*found, one.scatter, files), overlays(*found, one.profiles, files)]


def _correlations(comparison: Comparison, one: PublishedRecordings) -> list[tuple[str, ...]]:
    found = _joint(comparison, one)
    return [] if found is None else [_correlation(found[0], pair) for pair in found[1]]


def _correlation(joint: Joint, pair: Pair) -> tuple[str, ...]:
    measure, receptor = pair
    r = [as_number(float(overlay.r[pair]), 2) for overlay in joint.overlays]
    fitted = (float(v[pair]) for v in (joint.fit.k, joint.fit.eps0, joint.explained))
    place = signed(float(joint.overlays[0].stimulus.receptor_mm[receptor]))
    return (joint.title, label(MEASURES[measure]), place, "  ".join(r), *map(as_number, fitted))


# Deflection of the skin along the finger under an indentor across it, and a measured deflection for comparison.
#
# Measured deflections are a CSV of the columns `z_mm,deflection_mm[,doi_mm]`: z along the finger in the model's frame
# (0 at the proximal edge, 12.75 at the tip), the skin's downward displacement there, and the indentation depth.

Array = NDArray[np.float64]

_SAME_DEPTH_MM = 0.05


@dataclass(frozen=True)
class Deflection:
    """Downward displacement (n,) of the skin at z (n,) along the pad's center line, in mm, at one depth."""

    doi_mm: float  # NaN if a measured file states none
    z_mm: Array
    deflection_mm: Array

    @property
    def contents(self) -> str:
        """Depth, points, places and range of the deflections, in words."""
        depth = "" if math.isnan(self.doi_mm) else f"DOI {self.doi_mm:g} mm: "
        down_mm, z_mm = self.deflection_mm, self.z_mm
        return (
            f"{depth}{number_of(len(z_mm), 'points')} from z = {z_mm.min():g} to {z_mm.max():g} mm, "
            f"{down_mm.min():.4g} to {down_mm.max():.4g} mm downward, most at z = {z_mm[down_mm.argmax()]:g} mm."
        )


def simulated(run: Run, finger: Fingertip) -> list[Deflection]:
    """Return the simulated deflection at every hold of an indentor across the finger; none for other indentors."""
    if not any(
        parse_shape(from_copy(run.folder.path, event["indentor"])).axes == ACROSS for event in run.stream("mount")
    ):
        return []
    results = [one.result for one in responses(run, finger) if one.result.indentor.axes == ACROSS]
    return [Deflection(result.doi_mm, *result.axial_profile) for result in results]


def read_deflections(path: Path) -> list[Deflection]:
    """Return the deflections of a file by ascending depth; raise RecordingError with row and column."""
    found = read_skin_deflection(path, ALONG_BY_DEPTH)
    table = np.array(sorted(zip(found.doi_mm, found.z_mm, found.deflection_mm, strict=True)))
    depths, which = np.unique(table[:, 0], return_inverse=True)  # NaNs count as one depth
    return [Deflection(float(depth), *table[which == k, 1:].T) for k, depth in enumerate(depths)]


def partner(measured: Deflection, among: list[Deflection]) -> Deflection | None:
    """Return the simulated deflection within 0.05 mm of a measured one's depth, or None."""
    if math.isnan(measured.doi_mm) or not among:
        return None
    nearest = min(among, key=lambda one: abs(one.doi_mm - measured.doi_mm))
    return nearest if abs(nearest.doi_mm - measured.doi_mm) <= _SAME_DEPTH_MM else None


def deflection_section(profiles: list[Deflection], measured: list[Deflection], source: str = "") -> Section:
    """Return the section on the profiles and the distance of measured points from them."""
    rows = tuple(_row(one, partner(one, profiles)) for one in measured)
    compared = [found for one in measured if (found := _difference(one, partner(one, profiles))) is not None]
    text = (
        "The indentor lies across the finger, so that the deflection of the skin beside it can be "
        "measured from outside."
    )
    points = sum(map(len, compared))
    beside = sum(len(one.z_mm) for one in measured if partner(one, profiles) is not None) - points
    if compared:
        rms = np.sqrt(np.mean(np.concatenate(compared) ** 2))
        text = (
            f"The measured deflection of the skin differs from the simulated one by {rms:.2g} mm rms at "
            f"{number_of(points, 'points')}."
        )
    elif measured and not beside:
        text = "No run pressed to the depth of a measured deflection."
    if beside:
        text += (
            f" {number_of(beside, 'points')} beside the patch of the model {'is' if beside == 1 else 'are'} left out."
        )
    if measured:
        text += "\n\n" + " ".join([f"Measured: {source}."] * bool(source) + [one.contents for one in measured])
    header = ("measured at DOI (mm)", "points", "measured − model, mean (mm)", "rms (mm)") if measured else ()
    return Section("Deflection along the finger", text, header, rows, (deflections(profiles, measured),))


def deflections(profiles: list[Deflection], measured: list[Deflection]) -> Plot:
    """Plot the simulated profiles and the measured points."""
    colors = {id(one): shade(k, len(profiles)) for k, one in enumerate(profiles)}
    lines = [
        Series("plot", one.z_mm, one.deflection_mm, color=colors[id(one)], lw=1.4, label=f"DOI {one.doi_mm:.2f} mm",
               rows=rows_of("deflection", "z_mm", "deflection_mm", simulated=k))
        for k, one in enumerate(profiles)
    ]  # fmt: skip
    points = [
        Series("plot", one.z_mm, one.deflection_mm, ls="", marker="o", ms=4, mfc="none",
               mec="black" if (other := partner(one, profiles)) is None else colors[id(other)],
               rows=rows_of("deflection", "z_mm", "deflection_mm", measured=k))
        for k, one in enumerate(measured)
    ]  # fmt: skip
    zero = guide("axhline", 0, color="black", lw=0.6)

    def finish(figure: Figure, axes: list[Axes]) -> None:
        axes[0].invert_yaxis()
        axes[0].legend(fontsize=8)

    return Plot(
        (7.2, 3.8), [Subplot("z along the finger (mm)", "deflection of the skin (mm)", [*lines, *points, zero])],
        "Deflection of the skin along the finger",
        "Downward displacement of the skin along the center line of the pad against undeformed z (proximal "
        "on the left). "
        + ("Circles: measured, in the color of their depth; black without a depth." if measured else ""),
        finish=finish,
    )  # fmt: skip


def _row(one: Deflection, other: Deflection | None) -> tuple[str, ...]:
    depth = "unknown" if math.isnan(one.doi_mm) else f"{one.doi_mm:g}"
    left = _difference(one, other)
    if left is None:
        return depth, f"{0 if other else len(one.z_mm)}", "–", "–"
    mean, rms = f"{left.mean():+.3f}".replace("-", "−"), f"{np.sqrt(np.mean(left**2)):.3f}"
    return depth, f"{len(left)}", mean, rms


def _difference(one: Deflection, other: Deflection | None) -> Array | None:
    """Return measured minus simulated deflection (mm) at the points that the simulation covers; None without any."""
    if other is None:
        return None
    inside = (one.z_mm >= other.z_mm[0]) & (one.z_mm <= other.z_mm[-1])
    left = one.deflection_mm - np.interp(one.z_mm, other.z_mm, other.deflection_mm)
    return left[inside] if inside.any() else None
