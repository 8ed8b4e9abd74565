"""Spatial response profiles under steps and bars, all 18 measures: Fig. 5-5 to 5-7, 5-10, 5-11."""

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from rig.compare.profile_shape_test import Verdict, shape_test
from rig.compare.stimuli import StimulusRow
from rig.protocol.schedule import about_the_centre
from rig.report.page_parts import PageFigure
from rig.report.style import BLUE, GREY, ORANGE, Plot, label, signed
from sim.measures.measures import MEASURES
from studies.source.printed.answers import FingerAnswers, deep, once
from studies.source.printed.steps import MOVED

Array = NDArray[np.float64]

BAR_POSITIONS = {"1.5": 25, "3.0": 34}
BARS = {
    width: [deep(f"bar:{width}", 1.0, x_mm) for x_mm in about_the_centre(n)] for width, n in BAR_POSITIONS.items()
}
PASSING, EXCEEDED, ONLY_DIPS = (-1.5, -1.25, -1.0), (-0.5, 0.0), (0.5, 1.0, 1.5, 2.0)
COUNTS = 0.05
_ODD = ("e12", "e13")
"""Measures that change their sign in a mirror at x = 0."""


@once
def under_step(answers: FingerAnswers, number: str) -> StimulusRow:
    """At the low force."""
    return answers.stimulus(MOVED[number])


@once
def under_bar(answers: FingerAnswers, width: str) -> StimulusRow:
    """At DOI 1.0."""
    return answers.stimulus(BARS[width])


def _receptor(stimulus: StimulusRow, x_mm: float) -> int:
    return int(np.argmin(np.abs(stimulus.receptor_mm - x_mm)))


def judged(stimulus: StimulusRow, measure: str, x_mm: float) -> Verdict:
    """The shape test at one receptor."""
    verdict = shape_test(stimulus.indentor, stimulus.x_mm, stimulus.ssrp(measure, _receptor(stimulus, x_mm)))
    assert verdict is not None
    return verdict


def step_in_words(answers: FingerAnswers, x_mm: float, measure: str = "ep1") -> str:
    """What a profile under step 1 shows at a receptor: passes, no dip, dip exceeds peak, only a dip, or fails."""
    p, q, passed = peak_and_dip(answers, x_mm, measure)
    if p < COUNTS * q:
        return "only a dip"
    if q < COUNTS * p:
        return "no dip"
    return "passes" if passed else "dip exceeds peak" if q > p else "peak exceeds dip, but fails"


def peak_and_dip(answers: FingerAnswers, x_mm: float, measure: str) -> tuple[float, float, bool]:
    stimulus = under_step(answers, "1")
    verdict = judged(stimulus, measure, x_mm)
    p, q, b = (verdict.judged_by[name] for name in ("peak", "dip", "baseline"))
    lowest = b - float(stimulus.ssrp(measure, _receptor(stimulus, x_mm)).min())
    return p, lowest if p < COUNTS * lowest else q, verdict.passed  # a dip alone comes before the highest value


def peak_and_dip_said(answers: FingerAnswers, x_mm: float, measure: str = "ep1") -> str:
    """Peak and dip, in words."""
    p, q, _ = peak_and_dip(answers, x_mm, measure)
    return f"peak {p:.4f}, dip {q:.4f}"


def peak_over_dip(answers: FingerAnswers) -> float:
    """ep3 under step 1 at receptor 0."""
    p, q, _ = peak_and_dip(answers, 0.0, "ep3")
    return p / q if q else np.inf


def dip_follows(answers: FingerAnswers) -> float:
    """By how much the dip of ep1 under step 1 moves with the receptor, mm per mm, over the receptors that have "
    "one."""
    stimulus, receptors = under_step(answers, "1"), (*PASSING, *EXCEEDED, *ONLY_DIPS)
    dips = [stimulus.x_mm[np.argmin(stimulus.ssrp("ep1", _receptor(stimulus, x)))] for x in receptors]
    return float(np.polyfit(receptors, dips, 1)[0])


def second_at_zero(answers: FingerAnswers, width: str, measure: str) -> float:
    """How far the second maximum stands out at receptor 0 under a bar, as a part of the range."""
    verdict = judged(under_bar(answers, width), measure, 0.0)
    return verdict.judged_by["second"] / verdict.judged_by["range"]


@once
def mirrored(answers: FingerAnswers, width: str) -> dict[str, float]:
    """Correlation of each measure's profile at +2 with that at −2 in the mirror."""
    stimulus = under_bar(answers, width)
    left, right = (_receptor(stimulus, x) for x in (-2.0, 2.0))
    return {
        m: float(np.corrcoef(stimulus.ssrp(m, right), _turned(m, stimulus.ssrp(m, left)))[0, 1]) for m in MEASURES
    }


def _turned(measure: str, profile: Array) -> Array:
    return (-1.0 if measure in _ODD else 1.0) * profile[::-1]


def least_mirrored(answers: FingerAnswers, width: str) -> float:
    """Of ep1, ep3 and SED."""
    found = mirrored(answers, width)
    return min(found[m] for m in ("ep1", "ep3", "sed"))


def mirrored_said(answers: FingerAnswers, width: str) -> str:
    """Of all measures, in words."""
    found = mirrored(answers, width)
    worst = min(found, key=lambda m: found[m])
    return f"median of 18 measures {np.median(list(found.values())):.2f}, least {found[worst]:.2f} of {worst}"


def shallower(answers: FingerAnswers) -> float:
    """The dip of SED under the narrow bar over that under the wide one, each as a part of its range."""
    return second_at_zero(answers, "1.5", "sed") / second_at_zero(answers, "3.0", "sed")


def _ssrps(stimulus: StimulusRow, title: str) -> PageFigure:
    caption = (
        "One panel a measure, its ten receptors above each other (x on the left, mm), each from its own baseline, "
        "as a part of the measure's range; blue passes the shape test at 5 %."
    )
    return PageFigure(title, Plot((10.2, 11.5), lambda canvas: _draw_ssrps(canvas, stimulus)), caption)


def _draw_ssrps(canvas: Canvas, stimulus: StimulusRow) -> None:
    canvas.set_layout_engine(None)
    canvas.subplots_adjust(left=0.06, right=0.99, bottom=0.04, top=0.97, wspace=0.08, hspace=0.16)
    panels = canvas.subplots(3, 6, sharex=True, sharey=True).ravel()
    places = 0.8 * np.arange(len(stimulus.receptor_mm))
    for axes, measure, values in zip(panels, MEASURES, stimulus.measures, strict=False):
        size = float(np.ptp(values)) or 1.0
        for k, place in enumerate(places):
            verdict = shape_test(stimulus.indentor, stimulus.x_mm, values[:, k])
            passed = verdict is not None and verdict.passed
            profile = (values[:, k] - 0.5 * (values[0, k] + values[-1, k])) / size + place
            axes.plot(stimulus.x_mm, profile, color=BLUE if passed else GREY, lw=1.4 if passed else 0.8)
            axes.axhline(place, color=GREY, lw=0.3, ls=":")
        axes.set_title(label(measure), fontsize=9)
        axes.set_yticks(places, [signed(x) for x in stimulus.receptor_mm], fontsize=7)
    canvas.supxlabel("indentor x (mm)", fontsize=9)


def _mirrors(answers: FingerAnswers, width: str) -> PageFigure:
    caption = "Receptor +2 (blue) and, in the mirror at x = 0, −2 (orange); e12 and e13 change their sign there."
    plot = Plot((10.2, 4.6), lambda canvas: _draw_mirrors(canvas, under_bar(answers, width)))
    return PageFigure(f"Receptors ± 2 under bar {width} as mirror images", plot, caption)


def _draw_mirrors(canvas: Canvas, stimulus: StimulusRow) -> None:
    canvas.set_layout_engine(None)
    canvas.subplots_adjust(left=0.03, right=0.99, bottom=0.1, top=0.94, wspace=0.12, hspace=0.3)
    left, right = (_receptor(stimulus, x) for x in (-2.0, 2.0))
    panels = canvas.subplots(3, 6, sharex=True).ravel()
    for axes, measure in zip(panels, MEASURES, strict=False):
        axes.plot(stimulus.x_mm, stimulus.ssrp(measure, right), color=BLUE, lw=1.2)
        axes.plot(
            -stimulus.x_mm, (-1.0 if measure in _ODD else 1.0) * stimulus.ssrp(measure, left), color=ORANGE, lw=1.2
        )
        axes.set_title(label(measure), fontsize=8, pad=2)
        axes.set_yticks([])
    canvas.supxlabel("indentor x (mm)", fontsize=9)


def step_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    """Profiles under the steps."""
    return tuple(_ssrps(under_step(answers, n), f"Profiles under step {n} at 2.33 gwt") for n in "135")


def bar_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    """Profiles under the bars, and their mirror images."""
    profiles = [_ssrps(under_bar(answers, w), f"Profiles under bar {w} at DOI 1.0") for w in BAR_POSITIONS]
    return (*profiles, *(_mirrors(answers, w) for w in BAR_POSITIONS))
