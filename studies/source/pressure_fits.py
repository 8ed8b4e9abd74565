"""The pressure formula of Raju (1998), Eq. 4.1 and 4.2, fitted over shapes and depths, and inverted for curvature.

.venv/bin/python -m studies.source.pressure_fits    # K1, K2, K3 with intervals, over patch and row; seconds
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from rig.compare.pressure_formula import (
    FROM_EDGE_MM,
    BootstrapConstants,
    Constants,
    ContactSamples,
    Nodes,
    finger_curvature,
    fit,
    places,
    predicted,
    recover_curvature,
    refitted,
    residual,
    together,
)
from rig.report.page_parts import PageFigure, Section
from rig.report.style import BLUE, GREEN, GREY, ORANGE, Plot
from sim.config import FingertipConfig, Tissue
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult

Array = NDArray[np.float64]

DEPTHS_MM = (0.33, 0.67, 1.0, 1.33)
CENTRED = {"bar:3.0": DEPTHS_MM, "bar:1.5": DEPTHS_MM[:2], "cylinder:3": DEPTHS_MM, "cylinder:9": DEPTHS_MM}
STEP_X_MM, STEP_GWT = (2.0, -0.68, -1.63, -3.69), (2.33, 8.0)
UNSEEN = ("cylinder:2", "cylinder:4", "cylinder:6", "cylinder:15", "cylinder:40")
"""Objects that the constants were not fitted to."""

LAYERS = {
    "default": Tissue(),
    "epidermis half as thick": Tissue(epidermis_mm=0.5 * Tissue().epidermis_mm),
    "all of one stiffness": Tissue(e_dermis=1.0, e_fat=1.0),
}
"""Fingers whose skin bends less, and not at all like a plate."""

_LOOK = {"bar": (BLUE, "s"), "cylinder": (ORANGE, "o"), "step": (GREEN, "^")}


@dataclass(frozen=True)
class PressedPlaces:
    """One indentation and its places in contact, in the receptor plane and on the whole patch."""

    shape: str
    result: IndentationResult
    row: ContactSamples
    patch: ContactSamples


@dataclass(frozen=True)
class FormulaFit:
    """Constants over one choice of shapes, nodes and edges, with what they leave."""

    told: str
    parts: list[ContactSamples]

    @cached_property
    def at(self) -> ContactSamples:
        """All places."""
        return together(self.parts)

    @cached_property
    def constants(self) -> Constants:
        """Least squares."""
        return fit(self.at)

    @cached_property
    def spread(self) -> BootstrapConstants:
        """Over indentations drawn with replacement."""
        return refitted(self.parts)

    def with_interval(self, k: int) -> str:
        """A constant with 95 % of it."""
        low, high = self.spread.intervals[k]
        return f"{self.constants[k]:.0f} [{low:.0f}, {high:.0f}]".replace("-", "−")

    @property
    def row(self) -> tuple[str, ...]:
        """As cells."""
        rms, explained = residual(self.constants, self.at)
        sure, part = f"{self.spread.k2_above_k1:.0%}", f"{rms / self.at.pressure.mean():.0%}"
        constants = (self.with_interval(k) for k in range(3))
        return self.told, f"{len(self.at.pressure)}", *constants, sure, f"{rms:.0f}", part, f"{explained:.2f}"


FIT_HEADER = ("shapes, nodes, left out", "places", "K1 (pseudo-units/mm)", "K2 (pseudo-units/mm)",
              "K3 (pseudo-units · mm)", "K2 > K1 in", "rms", "rms / mean", "R²")  # fmt: skip


@dataclass(frozen=True)
class PressureStudy:
    """Everything that is pressed for the formula."""

    finger: Fingertip
    centred: list[PressedPlaces]
    steps: list[PressedPlaces]
    unseen: list[PressedPlaces]

    @cached_property
    def fits(self) -> dict[str, FormulaFit]:
        """By choice; the verdict rests on the first, the row is the second."""
        both = [*self.centred, *self.steps]
        bars, every, edges, ends = "bars and cylinders", "and steps", "indentor's edges", "contacts' ends too"
        return {
            "patch": FormulaFit(f"{bars}, patch, {edges}", [one.patch.off_edges for one in self.centred]),
            "row": FormulaFit(f"{bars}, row, {edges}", [one.row.off_edges for one in self.centred]),
            "patch, no ends": FormulaFit(
                f"{bars}, patch, {ends}", [one.patch.off_edges.inside for one in self.centred]
            ),
            "row, no ends": FormulaFit(f"{bars}, row, {ends}", [one.row.off_edges.inside for one in self.centred]),
            "patch, nothing": FormulaFit(f"{bars}, patch, nothing", [one.patch for one in self.centred]),
            "all, patch": FormulaFit(f"{every}, patch, {edges}", [one.patch.off_edges for one in both]),
            "all, row": FormulaFit(f"{every}, row, {edges}", [one.row.off_edges for one in both]),
            "all, row, no ends": FormulaFit(f"{every}, row, {ends}", [one.row.inside for one in both]),
        }

    @property
    def by_shape(self) -> list[tuple[str, float, float, float]]:
        """(shape, median C in 1/mm, slope of the peak against DOI, K2 within contacts) on the patch, by C."""
        found = []
        for shape in CENTRED:
            parts = [one.patch.off_edges for one in self.centred if one.shape == shape]
            curvature = float(np.median(together(parts).curvature_per_mm))
            found.append((shape, curvature, slope_of_peak(parts), k2_alone(parts)))
        return sorted(found, key=lambda one: one[1])


def press(finger: Fingertip, shape: str, x_mm: float, **target: Any) -> PressedPlaces:
    """One indentation."""
    return pressed(finger, shape, finger.indent(shape, x_mm, **target))


def pressed(finger: Fingertip, shape: str, result: IndentationResult) -> PressedPlaces:
    """An indentation that is there."""
    sampled: dict[Nodes, ContactSamples] = {
        nodes: places(result, finger.surface, nodes) for nodes in ("row", "patch")
    }
    return PressedPlaces(shape, result, sampled["row"], sampled["patch"])


def press_all(finger: Fingertip) -> PressureStudy:
    """The scenes of the fit and those it has not seen."""
    steps = [press(finger, f"step:{n}", x, force_gwt=f) for n in "135" for x in STEP_X_MM for f in STEP_GWT]
    unseen = [press(finger, shape, 0.0, doi_mm=d) for shape in UNSEEN for d in DEPTHS_MM]
    return PressureStudy(finger, centred(finger), steps, unseen)


def centred(finger: Fingertip) -> list[PressedPlaces]:
    """Bars and cylinders on the pad's centre."""
    return [press(finger, shape, 0.0, doi_mm=d) for shape, depths in CENTRED.items() for d in depths]


def slope_of_peak(parts: Sequence[ContactSamples]) -> float:
    """K1 as the source defines it: highest pressure of each indentation against its DOI, a line through all."""
    return float(np.polyfit([at.doi_mm[0] for at in parts], [at.pressure.max() for at in parts], 1)[0])


def k2_alone(parts: Sequence[ContactSamples]) -> float:
    """Slope of pressure against displacement within contacts, each with an intercept of its own."""
    inside = [at for at in parts if len(at.pressure) > 2]
    if not inside:
        return np.nan
    d = np.concatenate([at.displacement_mm - at.displacement_mm.mean() for at in inside])
    p = np.concatenate([at.pressure - at.pressure.mean() for at in inside])
    return float(d @ p / (d @ d))


def fits_section(study: PressureStudy) -> Section:
    """Constants by choice of shapes, nodes and edges, and what the inversion gives."""
    figure = PageFigure(
        "The pressure formula and its inverse",
        Plot((10.2, 3.6), lambda canvas: _draw(canvas, study)),
        "On the patch. Left: pressures by the formula against the model's, away from the indentor's edges. "
        "Middle: what is left "
        "against the distance from the contact's end, across the finger. Right: curvature of cylinders that the "
        "fit had not "
        "seen, read back from their pressure profiles and depths with the constants of the row without "
        "contacts' ends "
        "(open: fewer than five nodes); the line is the truth.",
    )
    return Section(
        "The pressure formula by choice of places",
        "P = K2 (d − d0) + K3 C with d0 = DOI (1 − K1/K2), least squares over all nodes that carry force. "
        "Intervals: 95 % "
        "over indentations drawn with replacement. “Indentor's edges”: places within "
        f"{FROM_EDGE_MM:g} mm of an edge of a bar or of step 1 are left out, “contacts' ends too”: also those "
        f"as near to where "
        "the contact ends across the finger.",
        FIT_HEADER,
        tuple(one.row for one in study.fits.values()),
        (figure,),
    )


def layers_section() -> Section:
    """The same formula on fingers whose epidermis carries less."""
    rows = []
    for name, tissue in LAYERS.items():
        finger = Fingertip.load(FingertipConfig(tissue=tissue))
        members = centred(finger)
        rows.append(FormulaFit(f"{name}, patch", [one.patch.off_edges for one in members]).row)
        rows.append(FormulaFit(f"{name}, row, contacts' ends left out too", [one.row.inside for one in members]).row)
    return Section(
        "The pressure formula and the layers",
        "Centred bars and cylinders on other fingers. A stiff epidermis over soft tissue is a bent plate: it presses "
        "hardest near the ends of the contact, so that pressure across one row does not rise with the local "
        "displacement.",
        FIT_HEADER,
        tuple(rows),
    )


@dataclass(frozen=True)
class Curvature:
    """An object's own curvature (1/mm) and what its pressure profile says of it."""

    true: float
    recovered: float
    doi_mm: float
    nodes: int


def recovered_curvatures(study: PressureStudy) -> list[Curvature]:
    """From pressure against undeformed x and the depth, away from edges; the finger's own curvature taken off."""
    found, constants = [], study.fits["row, no ends"].constants
    for one in study.unseen:
        x, pressure = one.result.pressure_profile
        (low, high), *_ = one.result.contact_regions_mm
        inside = (x >= low + FROM_EDGE_MM) & (x <= high - FROM_EDGE_MM)
        if inside.sum() < 3:
            continue
        relative = recover_curvature(x[inside], pressure[inside], one.result.doi_mm, constants)
        own = relative - finger_curvature(study.finger.surface, x[inside], one.result.z_mm).mean()
        true = 2 / float(one.shape.partition(":")[2])
        found.append(Curvature(true, float(own), one.result.doi_mm, int(inside.sum())))
    return found


def _draw(canvas: Canvas, study: PressureStudy) -> None:
    against, ends, curvature = canvas.subplots(1, 3)
    constants = study.fits["patch"].constants
    for one in [*study.centred, *study.steps]:
        colour, marker = _LOOK[one.shape.partition(":")[0]]
        at = one.patch.off_edges
        style = {"ls": "", "marker": marker, "ms": 2, "mfc": "none", "mec": colour, "mew": 0.5, "rasterized": True}
        against.plot(at.pressure, predicted(constants, at), **style)
        ends.plot(at.from_end_mm, predicted(constants, at) - at.pressure, **style)
    _decorate(against, ends)
    _draw_curvatures(curvature, recovered_curvatures(study))
    for name, (colour, marker) in _LOOK.items():
        against.plot([], [], marker, mfc="none", mec=colour, label=name)
    against.legend(fontsize=8)


def _decorate(against: Axes, ends: Axes) -> None:
    top = max(against.get_xlim()[1], against.get_ylim()[1])
    against.plot([0, top], [0, top], color="black", lw=0.8)
    against.set(xlabel="pressure in the model (pseudo-units)", ylabel="by the formula (pseudo-units)")
    ends.axhline(0, color="black", lw=0.8)
    ends.axvline(FROM_EDGE_MM, color=GREY, lw=0.8, ls="--")
    ends.set(
        ylim=(-1500, 1500), xlabel="distance from the contact's end (mm)", ylabel="formula − model (pseudo-units)"
    )


def _draw_curvatures(axes: Axes, found: list[Curvature]) -> None:
    for one in found:
        filled = ORANGE if one.nodes >= 5 else "none"
        axes.plot(one.true, one.recovered, "o", ms=2 + 4 * one.doi_mm, mfc=filled, mec=ORANGE, alpha=0.8)
    top = max(one.true for one in found)
    axes.plot([0, top], [0, top], color="black", lw=0.8)
    axes.set(xlabel="object's curvature (1/mm)", ylabel="read from its pressure (1/mm)")
    axes.set_title("larger circles: deeper (DOI 0.33 … 1.33 mm)", fontsize=8)


def main() -> None:
    """Print the constants over the patch and over the row."""
    study = press_all(Fingertip.load())
    print(f"| {' | '.join(FIT_HEADER)} |\n|{'---|' * len(FIT_HEADER)}")
    for one in study.fits.values():
        print(f"| {' | '.join(one.row)} |")
    for shape, curvature, k1, k2 in study.by_shape:
        print(
            f"{shape}: C {curvature:.2f} /mm, slope of the peak {k1:.0f}, K2 within contacts {k2:.0f} pseudo-units/mm"
        )


if __name__ == "__main__":
    main()
