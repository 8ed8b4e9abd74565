"""Chapters 3 and 4: the finger itself, pressure under bars, cylinders and steps, and strain beneath them."""

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from sim.contact.profiles import STEP_HALF_WAVELENGTH_MM
from sim.models.result import FILTER_SPACING_MM
from studies.source.answers import (
    HIGH_GWT,
    LOW_GWT,
    ROW_DEPTH_MM,
    FingerAnswers,
    PrintedPress,
    deep,
    forced,
    maxima,
    second,
)

Array = NDArray[np.float64]

# --- the finger ---


def apex_x_mm(answers: FingerAnswers) -> float:
    """Return where the apex lies across the finger."""
    return float(answers.finger.surface.apex.position_mm[0])


def widest_element_mm(answers: FingerAnswers) -> float:
    """Return the largest distance between neighboring nodes across the finger, under the pad's center."""
    patch = answers.finger.model.patch
    across = patch.shape[1]
    first = patch.x.size // 2 // across * across
    return float(np.diff(np.sort(patch.x[first : first + across])).max())


# --- bars ---

WIDE = [deep("bar:3.0", doi) for doi in (0.33, 0.67, 1.0, 1.33)]
FULLY = 1.5
"""An edge is touched where the pressure beside it exceeds that in the middle, fully where it does by half."""


def edges(answers: FingerAnswers, shape: str, doi_mm: float) -> str:
    """Return which edges of a bar are touched, and how."""
    result, half_mm = answers.press(deep(shape, doi_mm)), 0.5 * float(shape.partition(":")[2])
    x, pressure = result.pressure_profile
    middle = float(np.interp(result.x_mm, x, pressure))
    left, right = (
        float(pressure[np.abs(x - result.x_mm - edge_mm) < 1.5 * FILTER_SPACING_MM].max(initial=0.0))
        for edge_mm in (-half_mm, half_mm)
    )
    return in_words(left / middle, right / middle)


def in_words(left: float, right: float) -> str:
    """Return which edges are touched, by their pressures over that in the middle."""
    degrees = {
        side: "fully" if ratio >= FULLY else "slightly"
        for side, ratio in (("left", left), ("right", right))
        if ratio > 1
    }
    if len(set(degrees.values())) == 1 and len(degrees) == 2:
        return f"both {degrees['left']}"
    return ", ".join(f"{side} {how}" for side, how in degrees.items()) or "none"


def widest_contact_mm(answers: FingerAnswers) -> float:
    """Return the width of the widest contact under the bar of 3 mm."""
    found = [answers.press(scene).contact_regions_mm for scene in WIDE]
    return max(b - a for regions in found for a, b in regions)


# --- cylinders ---

DEEPEST_MM, DEEP_MM = 1.33, 2.5
DEEP_X_MM = 0.17 * np.arange(-11.0, 12.0)  # the row that lies inside the finger there
SHAPES = ("bar:3.0", "cylinder:9", "cylinder:3")


def more_force(answers: FingerAnswers, doi_mm: float) -> float:
    """Return by how much the thick cylinder's force exceeds the thin one's."""
    thick, thin = (answers.press(deep(f"cylinder:{d}", doi_mm)).force_gwt for d in (9, 3))
    return thick / thin - 1


def higher_peak(answers: FingerAnswers) -> float:
    """Return by how much the thin cylinder's peak exceeds the thick one's at the force of the deepest press."""
    thick = deep("cylinder:9", DEEPEST_MM)
    thin = forced("cylinder:3", answers.press(thick).force_gwt)
    return peak(answers, thin) / peak(answers, thick) - 1


@cache
def sed_below(answers: FingerAnswers, depth_mm: float) -> tuple[Array, tuple[Array, ...]]:
    """Return x (mm) and SED under bar, thick and thin cylinder pressed deepest, at a depth below the skin."""
    scenes = [deep(shape, DEEPEST_MM) for shape in SHAPES]
    if depth_mm == ROW_DEPTH_MM:
        found = [answers.beneath(scene, "sed") for scene in scenes]
        return found[0][0], tuple(sed for _, sed in found)
    points = answers.finger.points_below(DEEP_X_MM, depth_mm)
    fields = answers.finger.fields([answers.press(scene) for scene in scenes], points)
    return DEEP_X_MM, tuple(field.measures["sed"] for field in fields)


def apart(answers: FingerAnswers, depth_mm: float) -> float:
    """Return the largest difference of the three SED profiles, each over its peak, where both depths have them."""
    x, profiles = sed_below(answers, depth_mm)
    inside = np.abs(x) <= DEEP_X_MM[-1] + 1e-9
    shapes = np.array([profile[inside] / profile[inside].max() for profile in profiles])
    return float(np.ptp(shapes, axis=0).max())


def sed_maxima(answers: FingerAnswers, shape: str) -> str:
    """Return how many maxima SED has near the skin."""
    return f"{maxima(sed_below(answers, ROW_DEPTH_MM)[1][SHAPES.index(shape)])}"


# --- steps that are moved across the pad ---

# Fine where the flank passes under the pad, wide outside; step 5 is long, so its schedule is wider: as in
# protocols/steps.py, which a test compares.
POSITIONS_MM = {
    "1": (2.0, 1.5, 1.0, 0.5, 0.17, 0.0, -0.17, -0.34, -0.51, -0.68, -0.85, -1.02, -1.19, -1.36, -1.63, -1.8,
          -1.97, -2.25, -2.75, -3.25, -3.69),
    "3": (2.0, 1.5, 1.0, 0.5, 0.17, 0.0, -0.17, -0.34, -0.51, -0.68, -0.85, -1.02, -1.19, -1.36, -1.63, -1.8,
          -1.97, -2.25, -2.75, -3.25, -3.69, -4.2),
    "5": (2.5, 2.0, 1.5, 1.0, 0.5, 0.0, -0.34, -0.68, -1.02, -1.36, -1.63, -1.97, -2.31, -2.65, -2.99, -3.33,
          -3.69, -4.2, -4.7, -5.2, -5.7),
}  # fmt: skip
MOVED = {n: [forced(f"step:{n}", LOW_GWT, x) for x in positions] for n, positions in POSITIONS_MM.items()}
TABLE_X_MM, LONG_X_MM = -1.63, -3.13
AT_TABLE = forced("step:1", LOW_GWT, TABLE_X_MM)
CONCAVE, UPPER_FLAT = 2, 3


def shares(answers: FingerAnswers, scene: PrintedPress) -> tuple[float, ...]:
    """Return the parts of the force under lower flat, convex part, concave part and upper flat."""
    result, half_wave = answers.press(scene), STEP_HALF_WAVELENGTH_MM[scene.shape[-1]]
    force = np.linalg.norm(result.state.force, axis=0)
    s = result.model.patch.x + result.state.displacement[0] - result.x_mm
    part = np.digitize(s, [0.0, 0.5 * half_wave, half_wave])
    return tuple(float(force[part == k].sum() / force.sum()) for k in range(4))


def share(answers: FingerAnswers, number: str, part: int) -> float:
    """Return the largest share of the force under a part of the step."""
    return max(shares(answers, scene)[part] for scene in MOVED[number])


def peak(answers: FingerAnswers, scene: PrintedPress) -> float:
    """Return the highest pressure in the receptor plane."""
    return float(answers.press(scene).pressure_profile[1].max())


def highest(answers: FingerAnswers, number: str) -> PrintedPress:
    """Return the press whose peak is highest."""
    return max(MOVED[number], key=lambda scene: peak(answers, scene))


def region_peaks(answers: FingerAnswers, scene: PrintedPress) -> tuple[float, ...]:
    """Return the highest pressure of each contact region, from left to right."""
    result, reach = answers.press(scene), FILTER_SPACING_MM
    x, pressure = result.pressure_profile
    return tuple(
        float(pressure[(x > a - reach) & (x < b + reach)].max(initial=0.0)) for a, b in result.contact_regions_mm
    )


def comparable(answers: FingerAnswers) -> float:
    """Return the lower over the higher of two regions' peaks where they are most alike."""
    two = [peaks for scene in MOVED["1"] if len(peaks := region_peaks(answers, scene)) > 1]
    return max((min(peaks) / max(peaks) for peaks in two), default=0.0)


def flats(answers: FingerAnswers) -> float:
    """Return the peak on the flat after the step over that before it."""
    return peak(answers, MOVED["1"][-1]) / peak(answers, MOVED["1"][0])


# --- strain beneath steps ---

PAIRED = {x: [forced("step:1", force, x) for force in (LOW_GWT, HIGH_GWT)] for x in (2.0, TABLE_X_MM, -2.25, -3.69)}


def count(answers: FingerAnswers, scene: PrintedPress, measure: str) -> str:
    """Return how many maxima a measure has."""
    return f"{maxima(answers.beneath(scene, measure)[1])}"


def second_maximum(answers: FingerAnswers, scene: PrintedPress) -> float:
    """Return how far the second maximum of SED stands out, of the range."""
    return second(answers.beneath(scene, "sed")[1])


def two_highest(answers: FingerAnswers, scene: PrintedPress) -> float:
    """Return the second highest maximum of SED over the highest; 0 without one."""
    _, sed = answers.beneath(scene, "sed")
    tops = np.sort(sed[find_peaks(sed)[0]])[::-1]
    return float(tops[1] / tops[0]) if len(tops) > 1 else 0.0


def growth(answers: FingerAnswers) -> float:
    """Return the largest growth of the population's highest SED or ep1 from the low to the high force."""
    return max(
        float(np.divide(*(np.abs(answers.beneath(scene, measure)[1]).max() for scene in reversed(pair))))
        for measure in ("sed", "ep1")
        for pair in PAIRED.values()
    )


def alike(answers: FingerAnswers, x_mm: float) -> float:
    """Return the correlation of ep1's population responses at both forces."""
    low, high = (answers.beneath(scene, "ep1")[1] for scene in PAIRED[x_mm])
    return float(np.corrcoef(low, high)[0, 1])


def width_ratio(answers: FingerAnswers) -> float:
    """Return the width of SED at half its height under step 1 over that under step 5, at the low force."""
    return _width(answers, AT_TABLE) / _width(answers, forced("step:5", LOW_GWT, LONG_X_MM))


def _width(answers: FingerAnswers, scene: PrintedPress) -> float:
    x, sed = answers.beneath(scene, "sed")
    fine = np.linspace(x[0], x[-1], 2001)
    above = fine[np.interp(fine, x, sed) >= 0.5 * sed.max()]
    return float(above[-1] - above[0])
