"""Steps moved across the pad at the low force: Fig. 4-4 and 4-5."""

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from rig.report.page_parts import PageFigure
from rig.report.style import BLUE, GREEN, ORANGE, PURPLE, Plot
from sim.contact.profiles import STEP_HALF_WAVELENGTH_MM
from sim.models.result import FILTER_SPACING_MM
from studies.source.printed.answers import HIGH_GWT, LOW_GWT, FingerAnswers, PrintedPress, deep, forced, once
from studies.source.printed.drawing import filtered, maps, pressures

Array = NDArray[np.float64]

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
PAIRS = {f: (forced("step:5", f, LONG_X_MM), doi) for f, doi in ((HIGH_GWT, 0.62), (LOW_GWT, 0.23))}
PAIRED_DEEP = [deep("step:5", doi, LONG_X_MM) for _, doi in PAIRS.values()]
PARTS = ("lower flat", "convex part", "concave part", "upper flat")
_SHOWN = {
    "1": (2.0, 0.17, -0.68, -1.19, -1.36, -1.63, -1.8, -1.97, -2.25, -2.75, -3.25, -3.69),
    "5": (2.5, 0.0, -1.02, -1.63, -2.31, -2.65, -2.99, -3.33, -3.69, -4.2, -4.7, -5.7),
}


@once
def shares(answers: FingerAnswers, scene: PrintedPress) -> tuple[float, ...]:
    """Parts of the force under lower flat, convex part, concave part and upper flat."""
    result, half_wave = answers.press(scene), STEP_HALF_WAVELENGTH_MM[scene.shape[-1]]
    force = np.linalg.norm(result.state.force, axis=0)
    s = result.model.patch.x + result.state.displacement[0] - result.x_mm
    part = np.digitize(s, [0.0, 0.5 * half_wave, half_wave])
    return tuple(float(force[part == k].sum() / force.sum()) for k in range(len(PARTS)))


@once
def peak(answers: FingerAnswers, scene: PrintedPress) -> float:
    """Highest pressure in the receptor plane, raw."""
    return float(answers.press(scene).pressure_profile[1].max())


@once
def region_peaks(answers: FingerAnswers, scene: PrintedPress) -> tuple[float, ...]:
    """Highest pressure of each contact region, from left to right."""
    result = answers.press(scene)
    x, pressure = result.pressure_profile
    reach = FILTER_SPACING_MM
    return tuple(
        float(pressure[(x > a - reach) & (x < b + reach)].max(initial=0.0)) for a, b in result.contact_regions_mm
    )


def highest(answers: FingerAnswers, number: str) -> PrintedPress:
    """Where the peak is highest."""
    return max(MOVED[number], key=lambda scene: peak(answers, scene))


def highest_peak(answers: FingerAnswers, number: str) -> float:
    """Over all positions."""
    return peak(answers, highest(answers, number))


def highest_x(answers: FingerAnswers, number: str) -> float:
    """Where the peak is highest, mm."""
    return highest(answers, number).x_mm


def most_regions(answers: FingerAnswers, number: str) -> int:
    """Over all positions."""
    return max(len(region_peaks(answers, scene)) for scene in MOVED[number])


def at_table(answers: FingerAnswers) -> str:
    """Contact regions at the position of Table 5.2."""
    return f"{len(region_peaks(answers, forced('step:1', LOW_GWT, TABLE_X_MM)))}"


def comparable(answers: FingerAnswers) -> float:
    """The lower over the higher of the two regions' peaks where they are most alike."""
    return max(min(p) / max(p) for p in _two(answers).values())


def _two(answers: FingerAnswers) -> dict[float, tuple[float, ...]]:
    found = {scene.x_mm: region_peaks(answers, scene) for scene in MOVED["1"]}
    return {x: peaks for x, peaks in found.items() if len(peaks) > 1} or {np.nan: (0.0, 1.0)}


def alike_at(answers: FingerAnswers) -> str:
    """Where both regions are most alike, in words."""
    two = _two(answers)
    return (
        f"at x = {max(two, key=lambda x: min(two[x]) / max(two[x])):g}; two regions x = {max(two):g} … {min(two):g}"
    )


def upper_touches(answers: FingerAnswers) -> float:
    """x at which the upper flat first carries force."""
    touched = [scene.x_mm for scene in MOVED["1"] if shares(answers, scene)[3] > 0]
    return max(touched, default=np.nan)


def upper_from(answers: FingerAnswers) -> str:
    """Where the upper flat first carries force, in words."""
    return f"first touched at x = {upper_touches(answers):g}"


def pair_doi(answers: FingerAnswers, force_gwt: float) -> float:
    """DOI of step 5 at a force, mm."""
    return answers.press(PAIRS[force_gwt][0]).doi_mm


def pair_force(answers: FingerAnswers, force_gwt: float) -> str:
    """Force at the DOI that the source prints for it, in words."""
    doi = PAIRS[force_gwt][1]
    return f"at DOI {doi}: {answers.press(deep('step:5', doi, LONG_X_MM)).force_gwt:.2f} gwt"


def share(answers: FingerAnswers, number: str, part: int) -> float:
    """Largest share of the force under a part of the step."""
    return max(shares(answers, scene)[part] for scene in MOVED[number])


def upper_at_table(answers: FingerAnswers) -> float:
    """Share under the upper flat at the position of Table 5.2."""
    return shares(answers, forced("step:1", LOW_GWT, TABLE_X_MM))[3]


def flats(answers: FingerAnswers) -> float:
    """Peak on the flat after the step over that before."""
    return peak(answers, MOVED["1"][-1]) / peak(answers, MOVED["1"][0])


def filtered_peaks(answers: FingerAnswers) -> str:
    """Highest filtered peak, and the raw one of Table 5.2, in words."""
    most = max(float(filtered(answers.press(scene))[1].max()) for scene in MOVED["1"])
    at_table = peak(answers, forced("step:1", LOW_GWT, TABLE_X_MM))
    return f"{most:.0f} filtered; {at_table:.0f} raw at {TABLE_X_MM}"


def concave_at(answers: FingerAnswers) -> str:
    """Where the concave part is touched, in words."""
    x = [scene.x_mm for scene in MOVED["5"] if shares(answers, scene)[2] > 0]
    return f"x = {max(x):g} … {min(x):g}" if x else "never"


def figures(answers: FingerAnswers, number: str) -> tuple[PageFigure, ...]:
    """Of a step that is moved across the pad."""
    shown = [forced(f"step:{number}", LOW_GWT, x) for x in _SHOWN[number]]
    over = [shown[k] for k in (0, 2, 4, 5, 7, 8)]
    plot = Plot((10.2, 2.9), lambda canvas: _draw_moved(canvas, answers, number))
    caption = (
        "Left: highest pressure in the receptor plane, raw (blue) and filtered (orange), and in each of the two "
        "contact regions (marks). Right: how the force is shared. The step moves from right to left."
    )
    return (
        pressures(answers, shown, f"Pressure under step {number} at {LOW_GWT} gwt"),
        PageFigure(f"Step {number} moved across the pad at {LOW_GWT} gwt", plot, caption),
        maps(answers, over, f"Pressure under step {number} over x and z"),
    )


def _draw_moved(canvas: Canvas, answers: FingerAnswers, number: str) -> None:
    left, right = canvas.subplots(1, 2)
    scenes = MOVED[number]
    x = [scene.x_mm for scene in scenes]
    left.plot(x, [peak(answers, scene) for scene in scenes], "-o", ms=2.5, color=BLUE, label="raw")
    left.plot(x, [filtered(answers.press(s))[1].max() for s in scenes], "-", color=ORANGE, label="filtered")
    for scene in scenes:
        peaks = region_peaks(answers, scene)
        if len(peaks) > 1:
            left.plot([scene.x_mm] * len(peaks), peaks, "k_", ms=7)
    left.set(xlabel="step's x (mm)", ylabel="peak pressure (pseudo-units)", ylim=(0, None))
    left.legend(fontsize=8)
    for k, (name, colour) in enumerate(zip(PARTS, (BLUE, ORANGE, GREEN, PURPLE), strict=True)):
        right.plot(x, [shares(answers, scene)[k] for scene in scenes], "-o", ms=2.5, color=colour, label=name)
    right.set(xlabel="step's x (mm)", ylabel="share of the force (1)", ylim=(-0.03, 1.03))
    right.legend(fontsize=8)
