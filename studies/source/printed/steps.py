"""Steps moved across the pad at the low force: Fig. 4-4 and 4-5."""

from functools import partial

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from rig.report.page import PageFigure
from rig.report.style import BLUE, GREEN, ORANGE, PURPLE, Plot
from sim.contact.profiles import STEP_HALF_WAVELENGTH_MM
from sim.models.result import FILTER_SPACING_MM
from studies.source.printed.answers import HIGH_GWT, LOW_GWT, FingerAnswers, PrintedPress, deep, forced, once
from studies.source.printed.drawing import filtered, maps, pressures
from studies.source.printed.entry import Claim, Entry
from studies.source.printed.rules import Above, Below, Near, Same, Within

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


def most_regions(answers: FingerAnswers, number: str) -> int:
    """Over all positions."""
    return max(len(region_peaks(answers, scene)) for scene in MOVED[number])


def _at_table(answers: FingerAnswers) -> str:
    return f"{len(region_peaks(answers, forced('step:1', LOW_GWT, TABLE_X_MM)))}"


def comparable(answers: FingerAnswers) -> float:
    """The lower over the higher of the two regions' peaks where they are most alike."""
    return max(min(p) / max(p) for p in _two(answers).values())


def _two(answers: FingerAnswers) -> dict[float, tuple[float, ...]]:
    found = {scene.x_mm: region_peaks(answers, scene) for scene in MOVED["1"]}
    return {x: peaks for x, peaks in found.items() if len(peaks) > 1} or {np.nan: (0.0, 1.0)}


def _alike_at(answers: FingerAnswers) -> str:
    two = _two(answers)
    return (
        f"at x = {max(two, key=lambda x: min(two[x]) / max(two[x])):g}; two regions x = {max(two):g} … {min(two):g}"
    )


def upper_touches(answers: FingerAnswers) -> float:
    """x at which the upper flat first carries force."""
    touched = [scene.x_mm for scene in MOVED["1"] if shares(answers, scene)[3] > 0]
    return max(touched, default=np.nan)


def _share(answers: FingerAnswers, number: str, part: int) -> float:
    return max(shares(answers, scene)[part] for scene in MOVED[number])


def _upper_at_table(answers: FingerAnswers) -> float:
    return shares(answers, forced("step:1", LOW_GWT, TABLE_X_MM))[3]


def _flats(answers: FingerAnswers) -> float:
    return peak(answers, MOVED["1"][-1]) / peak(answers, MOVED["1"][0])


def _filtered(answers: FingerAnswers) -> str:
    most = max(float(filtered(answers.press(scene))[1].max()) for scene in MOVED["1"])
    at_table = peak(answers, forced("step:1", LOW_GWT, TABLE_X_MM))
    return f"{most:.0f} filtered; {at_table:.0f} raw at {TABLE_X_MM}"


def _concave_at(answers: FingerAnswers) -> str:
    x = [scene.x_mm for scene in MOVED["5"] if shares(answers, scene)[2] > 0]
    return f"x = {max(x):g} … {min(x):g}" if x else "never"


def _pair(force_gwt: float) -> Claim:
    scene, doi = PAIRS[force_gwt]
    return Claim(
        f"DOI at x = {LONG_X_MM} and {force_gwt:g} gwt (mm)",
        f"{doi}",
        Near(doi, 0.1, 0.3),
        lambda answers: answers.press(scene).doi_mm,
        "{:.3f}",
        lambda answers: f"at DOI {doi}: {answers.press(deep('step:5', doi, LONG_X_MM)).force_gwt:.2f} gwt",
    )


def _figures(answers: FingerAnswers, number: str) -> tuple[PageFigure, ...]:
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
    right.set(xlabel="step's x (mm)", ylabel="share of the force", ylim=(-0.03, 1.03))
    right.legend(fontsize=8)


ENTRIES = (
    Entry(
        "4-4",
        "Step 1 at 2.33 gwt: a peak grows under the convex part, contact parts into two regions, the flat comes "
        "back.",
        (
            Claim(
                "highest peak (pseudo-units)",
                "near 2000",
                Near(2000, 0.15, 0.35),
                lambda answers: peak(answers, highest(answers, "1")),
                "{:.0f}",
                _filtered,
            ),
            Claim(
                "where it is highest (x, mm)",
                "near −1.6",
                Within(-1.6, 0.17, 0.51),
                lambda answers: highest(answers, "1").x_mm,
            ),
            Claim(
                f"contact regions at x = {TABLE_X_MM}",
                "2 in 4-4(e); §5.3.1 of the source says 1",
                Same(("2",), ("1",)),
                _at_table,
            ),
            Claim(
                "peaks of both regions, lower over higher, where most alike",
                "comparable in 4-4(f)",
                Above(0.75, 0.4),
                comparable,
                beside=_alike_at,
            ),
            Claim(
                "share of the force under the concave part, largest",
                "never touches",
                Below(0.0, 0.02),
                partial(_share, number="1", part=2),
            ),
            Claim(
                f"share under the upper flat at x = {TABLE_X_MM}",
                "barely touches",
                Below(0.10, 0.20),
                _upper_at_table,
                beside=lambda answers: f"first touched at x = {upper_touches(answers):g}",
            ),
            Claim("peak on the flat, after over before", "the same", Near(1.0, 0.02, 0.1), _flats, "{:.3f}"),
        ),
        tuple(MOVED["1"]),
        partial(_figures, number="1"),
        reading="The convex corner's radius, 0.08 mm, is half an element: raw peaks depend on the position of the "
        "nodes under it, and a median of four removes most of a contact two or three nodes wide "
        "(docs/model.md). The source contradicts itself at −1.63, and does not state the x of panel (f).",
    ),
    Entry(
        "4-5",
        "Step 5 at 2.33 gwt: one contact region throughout, low peaks, the concave part touches.",
        (
            Claim(
                "highest peak (pseudo-units)",
                "below 1000",
                Below(1000, 1200),
                lambda answers: peak(answers, highest(answers, "5")),
                "{:.0f}",
            ),
            Claim("most contact regions", "1", Below(1, 2), partial(most_regions, number="5"), "{:.0f}"),
            Claim(
                "share of the force under the concave part, largest",
                "touches, panels d–f",
                Above(0.05, 0.001),
                partial(_share, number="5", part=2),
                beside=_concave_at,
            ),
            _pair(HIGH_GWT),
            _pair(LOW_GWT),
        ),
        (
            *MOVED["5"],
            *(scene for scene, _ in PAIRS.values()),
            *(deep("step:5", d, LONG_X_MM) for _, d in PAIRS.values()),
        ),
        partial(_figures, number="5"),
    ),
)
