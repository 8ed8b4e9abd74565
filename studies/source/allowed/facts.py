"""What the source's figures say, as numbers that can be emulated: a target, and how far off it may be read.

Targets are those of `studies/source/printed`: a word there ("left only", two maxima) is here the quantity deciding
it, and the bound at which it does. `reading`: one standard deviation of what is read off a printed figure, or of the
number that we put for a word. `model`: of what this kind of model (linear, small strain, layers of one E, mesh of the
default finger) gets wrong by itself. The errors of the design's coarser mesh and of the emulator come on top. All of
this, and which half a figure belongs to, was fixed before the first finger of a design was pressed; the default
finger's values were known. What Table 5.2 and the survivors say is by eye and in yes and no: it takes no part.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from rig.compare.pressure_formula import fit, together
from studies.source.pressure_fits import pressed
from studies.source.printed import bars, cylinders, formula, profiles, steps, under_steps
from studies.source.printed.answers import (
    HIGH_GWT,
    LOW_GWT,
    ROW_DEPTH_MM,
    FingerAnswers,
    PrintedPress,
    deep,
    forced,
    once,
)
from studies.source.printed.drawing import second

ANY = np.inf
FIGURES_IN_PAIRS = (
    ("4-1", "ch. 4, bar 1.5"),
    ("4-3", "4-8"),
    ("4-4", "4-5"),
    ("ch. 4, SED under step 1", "4-7"),
    ("5-3", "ch. 5, two forces"),
    ("5-5, 5-6, 5-7", "5-10, 5-11"),
)
"""Figures of one kind; a coin says which of the two chooses and which checks."""

GIVEN = ("ch. 3, geometry",), ("4-9, Eq. 4.1, 4.2",)
"""Those without a coin: what the finger was made from chooses, what was fitted to pressures checks."""

SEED = 1998


@dataclass(frozen=True)
class Fact:
    """A quantity whose value lies between `low` and `high` on the source's finger."""

    key: str
    figure: str
    says: str
    low: float
    high: float
    reading: float
    model: float
    measure: Callable[[FingerAnswers], float]


def halves(seed: int = SEED) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The figures that choose and those that check."""
    coins = np.random.default_rng(seed).integers(2, size=len(FIGURES_IN_PAIRS))
    chosen = (pair[coin] for pair, coin in zip(FIGURES_IN_PAIRS, coins, strict=True))
    others = (pair[1 - coin] for pair, coin in zip(FIGURES_IN_PAIRS, coins, strict=True))
    return (*GIVEN[0], *chosen), (*GIVEN[1], *others)


CHOOSE, CHECK = halves()

# --- ch. 3 and what touches ---

_radius = [
    Fact(
        f"{way}_radius_mm",
        "ch. 3, geometry",
        f"{way} radius at the apex (mm)",
        r,
        r,
        0.1,
        0.0,
        lambda a, way=way: getattr(a.finger.surface.apex, f"{way}_radius_mm"),  # type: ignore[misc]
    )
    for way, r in (("lateral", 3.5), ("axial", 3.8))
]
_apex = Fact(
    "apex_x_mm",
    "ch. 3, geometry",
    "apex at x (mm)",
    -0.1,
    -0.1,
    0.1,
    0.0,
    lambda a: a.finger.surface.apex.position_mm[0],
)


def _side(answers: FingerAnswers, scene: PrintedPress, side: int) -> float:
    return bars.edges(answers, scene)[side]


def _edge(figure: str, scene: PrintedPress, side: int, low: float, high: float) -> Fact:
    width, name = scene.shape.partition(":")[2], ("left", "right")[side]
    return Fact(
        f"bar_{width}_{name}_{scene.value:g}",
        figure,
        f"pressure beside the {name} edge of bar {width} over its middle, DOI {scene.value:g}",
        low,
        high,
        0.25,
        0.25,
        partial(_side, scene=scene, side=side),
    )


_1, _15 = 1.0, bars.FULLY
_WIDE = ((-ANY, _1, -ANY, _1), (_1, ANY, -ANY, _1), (_15, ANY, _1, _15), (_15, ANY, _15, ANY))
_NARROW = ((_1, _15, -ANY, _1), (_15, ANY, _15, ANY))
_edges = [
    fact
    for figure, scenes, bounds in (("4-1", bars.WIDE, _WIDE), ("ch. 4, bar 1.5", bars.NARROW, _NARROW))
    for scene, (a, b, c, d) in zip(scenes, bounds, strict=True)
    for fact in (_edge(figure, scene, 0, a, b), _edge(figure, scene, 1, c, d))
]

# --- cylinders ---

_cylinders = [
    Fact(f"thick_force_{doi:g}", "4-3", f"force of cylinder 9 over 3 less one, DOI {doi:g}", at, at, 0.02, 0.03,
         partial(cylinders.more_force, k=k))
    for k, (doi, at) in enumerate(((0.33, 0.10), (1.0, 0.15)))
]  # fmt: skip
_cylinders += [
    Fact("thin_peak", "4-3", "peak of cylinder 3 over 9 less one, equal force", 0.3, 0.3, 0.05, 0.1,
         cylinders.higher_peak)
]  # fmt: skip


def _second_sed(answers: FingerAnswers, *shapes: str) -> float:
    _, found = cylinders.sed_below(answers, 1.33, ROW_DEPTH_MM)
    return max(second(found[cylinders.SHAPES.index(shape)]) for shape in shapes)


_beneath = [
    Fact("apart_deep", "4-8", "SED of bar and cylinders apart, 2.5 mm deep", -ANY, 0.10, 0.05, 0.03,
         partial(cylinders.apart, doi_mm=1.33, depth_mm=cylinders.DEEP_MM)),
    Fact("apart_near", "4-8", "the same, 0.75 mm deep", 0.25, ANY, 0.05, 0.03,
         partial(cylinders.apart, doi_mm=1.33, depth_mm=ROW_DEPTH_MM)),
    Fact("bar_sed_second", "4-8", "second SED maximum under bar 3.0, DOI 1.33", 0.05, ANY, 0.03, 0.03,
         lambda a: _second_sed(a, "bar:3.0")),
    Fact("cylinder_sed_second", "4-8", "the same under the cylinders", -ANY, 0.05, 0.03, 0.03,
         lambda a: _second_sed(a, "cylinder:9", "cylinder:3")),
]  # fmt: skip

# --- steps ---


def _peaks(answers: FingerAnswers) -> tuple[list[float], list[float]]:
    return [s.x_mm for s in steps.MOVED["1"]], [steps.peak(answers, s) for s in steps.MOVED["1"]]


def _where_high(answers: FingerAnswers) -> float:
    """The middle of where the peak exceeds 70 % of its highest; positions alone jump with the mesh."""
    x, peaks = _peaks(answers)
    fine = np.linspace(min(x), max(x), 2001)
    over = np.maximum(np.interp(fine, x[::-1], peaks[::-1]) / max(peaks) - 0.7, 0.0)
    return float((fine * over).sum() / over.sum())


_LIGHT = forced("step:1", LOW_GWT, steps.TABLE_X_MM)
_steps = [
    Fact("step_1_peak", "4-4", "highest peak under step 1 (pseudo-units)", 2000, 2000, 200, 300,
         lambda a: max(_peaks(a)[1])),
    Fact("step_1_peak_x", "4-4", "where it is high (x, mm)", -1.6, -1.6, 0.1, 0.1, _where_high),
    Fact("upper_share", "4-4", "share under the upper flat at −1.63", -ANY, 0.10, 0.05, 0.03,
         lambda a: steps.shares(a, _LIGHT)[3]),
    Fact("flats", "4-4", "peak on the flat, after over before", 1.0, 1.0, 0.02, 0.02,
         lambda a: steps.peak(a, steps.MOVED["1"][-1]) / steps.peak(a, steps.MOVED["1"][0])),
    Fact("step_5_peak", "4-5", "highest peak under step 5 (pseudo-units)", -ANY, 1000, 50, 100,
         lambda a: max(steps.peak(a, s) for s in steps.MOVED["5"])),
    Fact("concave_share", "4-5", "share under its concave part, largest", 0.05, ANY, 0.02, 0.05,
         lambda a: max(steps.shares(a, s)[2] for s in steps.MOVED["5"])),
    *(
        Fact(f"step_5_doi_{name}", "4-5", f"DOI under step 5 at −3.13, {name} force (mm)", doi, doi, 0.01, 0.05 * doi,
             lambda a, scene=scene: a.press(scene).doi_mm)  # type: ignore[misc]
        for name, (scene, doi) in zip(("high", "low"), steps.PAIRS.values(), strict=True)
    ),
]  # fmt: skip

# --- beneath steps ---


def _second_beneath(answers: FingerAnswers, scene: PrintedPress, measure: str) -> float:
    return second(answers.beneath(scene, measure)[1])


def _maxima(key: str, figure: str, scene: PrintedPress, measure: str, one: bool) -> Fact:
    says = f"second maximum of {measure} under {scene.shape} at {scene.x_mm:g}, {key.rpartition('_')[2]}"
    low, high = (-ANY, 0.05) if one else (0.05, ANY)
    return Fact(key, figure, says, low, high, 0.03, 0.03, partial(_second_beneath, scene=scene, measure=measure))


_SED = "ch. 4, SED under step 1"
_under = [
    _maxima("sed_second_deep", _SED, under_steps.DEEP, "sed", one=False),
    _maxima("sed_second_light", _SED, under_steps.LIGHT, "sed", one=True),
    _maxima("s33_second_deep", _SED, under_steps.DEEP, "s33", one=True),
    _maxima("s33_second_light", _SED, under_steps.LIGHT, "s33", one=True),
    _maxima("step_5_sed_second_high", "4-7", under_steps.LONG[1], "sed", one=True),
    _maxima("step_5_sed_second_low", "4-7", under_steps.LONG[0], "sed", one=True),
    Fact("second_over_first_high", "5-3", "second SED maximum over the first at −2.25, 8 gwt", 0.85, ANY, 0.1, 0.05,
         partial(under_steps.two_highest, scene=under_steps.TWO[1])),
    Fact("second_over_first_low", "5-3", "the same at the low force", -ANY, 0.7, 0.1, 0.05,
         partial(under_steps.two_highest, scene=under_steps.TWO[0])),
    Fact("growth", "5-3", "growth of the population's peak", 5.0, 5.0, 0.5, 0.5, under_steps.nearest_growth),
    *(
        Fact(f"alike_{x:g}", "ch. 5, two forces", f"correlation of ep1 at both forces, x = {x:g}", 0.95, ANY,
             0.03, 0.02, partial(under_steps.alike, x_mm=x))
        for x in under_steps.PAIRED_X_MM
    ),
]  # fmt: skip


@once
def _constants(answers: FingerAnswers) -> tuple[float, float, float]:
    found = [pressed(answers.finger, scene.shape, answers.press(scene)).patch.off_edges for scene in formula.MIDDLE]
    return fit(together(found))


_formula = [
    Fact("k2_over_k1", "4-9, Eq. 4.1, 4.2", "K2 − K1 over the patch (pseudo-units/mm)", 0.0, ANY, 50, 100,
         lambda a: _constants(a)[1] - _constants(a)[0]),
    Fact("k3", "4-9, Eq. 4.1, 4.2", "K3 over the patch (pseudo-units · mm)", 0.0, ANY, 50, 100,
         lambda a: _constants(a)[2]),
]  # fmt: skip

# --- profiles ---


def _balance(answers: FingerAnswers, x_mm: float, measure: str) -> float:
    """1 for a peak alone, −1 for a dip alone, 0 for both alike."""
    p, q, _ = profiles.peak_and_dip(answers, x_mm, measure)
    return (p - q) / (p + q)


_ALONE = (1 - profiles.COUNTS) / (1 + profiles.COUNTS)
_SHAPES = {
    -2.0: (_ALONE, ANY),
    **dict.fromkeys(profiles.PASSING, (0.0, _ALONE)),
    **dict.fromkeys(profiles.EXCEEDED, (-_ALONE, 0.0)),
    **dict.fromkeys(profiles.ONLY_DIPS, (-ANY, -_ALONE)),
}
_STEP, _BAR = "5-5, 5-6, 5-7", "5-10, 5-11"
_profiles = [
    *(
        Fact(f"ep1_{x:g}", _STEP, f"ep1 under step 1 at receptor {x:g}, peak less dip over both", *bounds, 0.1, 0.1,
             partial(_balance, x_mm=x, measure="ep1"))
        for x, bounds in _SHAPES.items()
    ),
    Fact("ep3_0", _STEP, "ep3 under step 1 at receptor 0, the same", 0.0, ANY, 0.1, 0.1,
         partial(_balance, x_mm=0.0, measure="ep3")),
    Fact("dip_follows", _STEP, "the dip's place, mm per mm of the receptor's", 0.5, ANY, 0.2, 0.1,
         profiles.dip_follows),
    *(
        Fact(f"{measure}_bar_{width}", _BAR, f"second maximum of {measure} at receptor 0 under bar {width}",
             low, high, 0.03, model, partial(profiles.second_at_zero, width=width, measure=measure))
        for width in ("3.0", "1.5")
        for measure, low, high, model in (
            *((m, 0.05, ANY, 0.03) for m in ("ep1", "ep3", "sed")), ("e13", -ANY, 0.05, 0.05)
        )
    ),
    Fact("shallower", _BAR, "dip of SED, bar 1.5 over bar 3.0", -ANY, 0.8, 0.1, 0.05, profiles.shallower),
    *(
        Fact(f"mirror_{width}", _BAR, f"profiles at ± 2 in the mirror under bar {width}", 0.95, ANY, 0.03, 0.02,
             partial(profiles.least_mirrored, width=width))
        for width in ("3.0", "1.5")
    ),
]  # fmt: skip

FACTS = (*_radius, _apex, *_edges, *_cylinders, *_beneath, *_steps, *_under, *_formula, *_profiles)
SCENES = list(
    dict.fromkeys(
        [
            *bars.WIDE, *bars.NARROW, *cylinders.THICK, *cylinders.THIN, deep("bar:3.0", 1.33),
            *steps.MOVED["1"], *steps.MOVED["5"], *(scene for scene, _ in steps.PAIRS.values()),
            under_steps.DEEP, under_steps.LIGHT, *under_steps.LONG,
            *(scene for pair in under_steps.PAIRED.values() for scene in pair),
            *formula.MIDDLE, *(scene for scenes in profiles.BARS.values() for scene in scenes),
            forced("step:1", HIGH_GWT, steps.TABLE_X_MM),
        ]
    )
)  # fmt: skip
"""What is pressed for all of them, each once."""
