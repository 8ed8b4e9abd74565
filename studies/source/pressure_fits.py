"""The pressure formula of Raju (1998), Eq. 4.1 and 4.2, fitted over shapes and depths, and inverted for curvature."""

from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from rig.compare.pressure_formula import (
    FROM_EDGE_MM,
    Constants,
    Places,
    finger_curvature,
    fit,
    places,
    predicted,
    recover_curvature,
    residual,
    together,
)
from rig.report.html import Figure, Section
from rig.report.style import BLUE, GREEN, GREY, ORANGE, Plot
from sim.config.fingertip_config import FingertipConfig, Tissue
from sim.models.fingertip import Fingertip
from sim.models.results.indentation import IndentationResult

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
class Pressed:
    """One indentation and its places in contact."""

    shape: str
    result: IndentationResult
    at: Places


@dataclass(frozen=True)
class PressureStudy:
    """Everything that the section shows."""

    finger: Fingertip
    pressed: list[Pressed]
    unseen: list[Pressed]

    @cached_property
    def constants(self) -> Constants:
        """Over all shapes and depths, away from edges."""
        return fit(together([one.at.inside for one in self.pressed]))

    def by_shape(self) -> list[tuple[str, list[Pressed]]]:
        """In the order of the scenes."""
        return [(shape, list(members)) for shape, members in groupby(self.pressed, key=lambda one: one.shape)]


def press(finger: Fingertip, shape: str, x_mm: float, **target: Any) -> Pressed:
    """One indentation."""
    result = finger.indent(shape, x_mm, **target)
    return Pressed(shape, result, places(result, finger.surface))


def centred(finger: Fingertip) -> list[Pressed]:
    """Bars and cylinders on the pad's centre."""
    return [press(finger, shape, 0.0, doi_mm=d) for shape, depths in CENTRED.items() for d in depths]


def press_all(finger: Fingertip) -> PressureStudy:
    """The scenes of the fit and those it has not seen."""

    pressed = centred(finger)
    pressed += [press(finger, f"step:{n}", x, force_gwt=f) for n in "135" for x in STEP_X_MM for f in STEP_GWT]
    unseen = [press(finger, shape, 0.0, doi_mm=d) for shape in UNSEEN for d in DEPTHS_MM]
    return PressureStudy(finger, pressed, unseen)


def slope_of_peak(members: list[Pressed]) -> float:
    """K1 as the source defines it: highest pressure away from edges against DOI, a line through all depths.

    NaN where the indentor was not at one place.
    """
    if len({m.result.x_mm for m in members}) > 1:
        return np.nan
    found = [(m.result.doi_mm, m.at.inside.pressure.max()) for m in members if len(m.at.inside.pressure)]
    doi, peak = np.array(found).reshape(-1, 2).T
    return float(np.polyfit(doi, peak, 1)[0]) if len(np.unique(doi.round(3))) > 1 else np.nan


def k2_alone(members: list[Pressed]) -> float:
    """Slope of pressure against displacement within contacts, each with an intercept of its own."""
    inside = [m.at.inside for m in members]
    d = np.concatenate([at.displacement_mm - at.displacement_mm.mean() for at in inside if len(at.pressure) > 2])
    p = np.concatenate([at.pressure - at.pressure.mean() for at in inside if len(at.pressure) > 2])
    return float(d @ p / (d @ d)) if len(d) else np.nan


def pressure_section(study: PressureStudy) -> Section:
    """Constants, residuals by shape, and what the inversion gives."""
    k, every = study.constants, together([one.at.inside for one in study.pressed])
    rms, explained = residual(k, every)
    text = (
        f"P = K2 (d − d0) + K3 C with d0 = DOI (1 − K1/K2) (Raju 1998, Eq. 4.1, 4.2), least squares over "
        f"{len(every.pressure)} nodes in the receptor plane, {FROM_EDGE_MM:g} mm or more from the ends of their "
        f"contact regions, in {len(study.pressed)} indentations: {told(k)}; residual {rms:.0f} pseudo-units rms, "
        f"R² = {explained:.2f}. The table has each shape's own slopes beside it, and what the common constants leave."
    )
    header = ("shape", "C (1/mm), median", "places", "K1, slope of the peak", "K2 within contacts",
              "residual, rms", "mean", "rms / mean pressure")  # fmt: skip
    rows = tuple(_row(shape, members, k) for shape, members in study.by_shape())
    figure = Figure(
        "The pressure formula and its inverse",
        Plot((10.2, 3.6), lambda canvas: _draw(canvas, study)),
        "Left: pressures by the formula against the model's, away from edges. Middle: what is left against the "
        f"distance from the end of the contact (a few at bars' edges lie far outside); the fit used only what lies "
        f"right of {FROM_EDGE_MM:g} mm. Right: "
        "curvature of cylinders that the fit had not seen, read back from their pressure profiles and depths (open: "
        "fewer than five nodes); the line is the truth.",
    )
    return Section("Pressure from depth and curvature", text, header, rows, (figure,))


def _row(shape: str, members: list[Pressed], k: Constants) -> tuple[str, ...]:
    at = together([one.at.inside for one in members])
    if not len(at.pressure):
        return shape, *(["–"] * 7)
    left = predicted(k, at) - at.pressure
    rms, _ = residual(k, at)
    slopes = (f"{slope_of_peak(members):.0f}", f"{k2_alone(members):.0f}")
    remains = (f"{rms:.0f}", f"{left.mean():+.0f}", f"{rms / at.pressure.mean():.0%}")
    return shape, *_typeset(f"{np.median(at.curvature_per_mm):.2f}", f"{len(left)}", *slopes, *remains)


def _typeset(*cells: str) -> tuple[str, ...]:
    return tuple("–" if cell == "nan" else cell.replace("-", "−") for cell in cells)


def told(k: Constants) -> str:
    """The constants with their units."""
    numbers = f"K1 = {k.k1:.0f}, K2 = {k.k2:.0f} pseudo-units/mm, K3 = {k.k3:.0f} pseudo-units · mm"
    return numbers.replace("-", "−").replace("pseudo−units", "pseudo-units")


def layers_section() -> Section:
    """The same formula on fingers whose epidermis carries less: does K2 change its sign?"""
    rows = []
    for name, tissue in LAYERS.items():
        finger = Fingertip.load(FingertipConfig(tissue=tissue))
        at = together([one.at.inside for one in centred(finger)])
        k = fit(at)
        rms, explained = residual(k, at)
        numbers = (f"{value:.0f}" for value in k)
        rows.append((name, *_typeset(*numbers, f"{rms / at.pressure.mean():.0%}", f"{explained:.2f}")))
    return Section(
        "The pressure formula and the layers",
        "Centred bars and cylinders only. A stiff epidermis over soft tissue is a bent plate: it presses hardest "
        "near the ends of the contact, so that pressure does not rise with the local displacement.",
        ("finger", "K1", "K2", "K3", "rms / mean pressure", "R²"),
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
    found = []
    for one in study.unseen:
        x, pressure = one.result.pressure_profile
        (low, high), *_ = one.result.contact_regions_mm
        inside = (x >= low + FROM_EDGE_MM) & (x <= high - FROM_EDGE_MM)
        if inside.sum() < 3:
            continue
        relative = recover_curvature(x[inside], pressure[inside], one.result.doi_mm, study.constants)
        own = relative - finger_curvature(study.finger.surface, x[inside], one.result.z_mm).mean()
        true = 2 / float(one.shape.partition(":")[2])
        found.append(Curvature(true, float(own), one.result.doi_mm, int(inside.sum())))
    return found


def _draw(canvas: Canvas, study: PressureStudy) -> None:
    against, ends, curvature = canvas.subplots(1, 3)
    for one in study.pressed:
        colour, marker = _LOOK[one.shape.partition(":")[0]]
        left = predicted(study.constants, one.at) - one.at.pressure
        inside = one.at.from_end_mm >= FROM_EDGE_MM
        style = {"ls": "", "marker": marker, "ms": 3, "mfc": "none", "mec": colour, "mew": 0.7}
        against.plot(one.at.pressure[inside], (one.at.pressure + left)[inside], **style)
        ends.plot(one.at.from_end_mm, left, **style)
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
    ends.set_ylim(-1500, 1500)
    ends.set(xlabel="distance from the contact's end (mm)", ylabel="formula − model (pseudo-units)")


def _draw_curvatures(axes: Axes, found: list[Curvature]) -> None:
    for one in found:
        filled = ORANGE if one.nodes >= 5 else "none"
        axes.plot(one.true, one.recovered, "o", ms=2 + 4 * one.doi_mm, mfc=filled, mec=ORANGE, alpha=0.8)
    top = max(one.true for one in found)
    axes.plot([0, top], [0, top], color="black", lw=0.8)
    axes.set(xlabel="object's curvature (1/mm)", ylabel="read from its pressure (1/mm)")
    axes.set_title("larger circles: deeper (DOI 0.33 … 1.33 mm)", fontsize=8)
