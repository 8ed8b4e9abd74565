"""Chapter 5: spatial response profiles under steps and bars, Table 5.2, its survivors, and a recorded afferent."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from rig.compare.comparison import Comparison, compare
from rig.compare.example import DOI_MM, SHAPE, recorded
from rig.compare.fit import correlation
from rig.compare.profile_shape_test import THRESHOLD, Verdict, shape_test
from rig.compare.raju_table_5_2 import agreement, source_flags
from rig.compare.stimuli import StimulusRow
from rig.protocol.schedule import about_the_centre
from sim.measures.measures import MEASURES
from studies.source.answers import FingerAnswers, deep
from studies.source.pressures import MOVED

Array = NDArray[np.float64]

BAR_POSITIONS = {"1.5": 25, "3.0": 34}
BARS = {
    width: [deep(f"bar:{width}", 1.0, x_mm) for x_mm in about_the_centre(n)] for width, n in BAR_POSITIONS.items()
}
WITH_A_DIP_MM = (-1.5, -1.25, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0)
COUNTS = 0.05
ODD = ("e12", "e13")
"""Measures that change their sign in a mirror at x = 0."""

OF_STEPS, OF_ALL = ("e13", "ep1", "ep3", "sed"), ("ep1", "ep3", "sed")
"""Survivors of the source."""


@cache
def under_step(answers: FingerAnswers, number: str) -> StimulusRow:
    """Return profiles at the low force."""
    return answers.stimulus(MOVED[number])


@cache
def under_bar(answers: FingerAnswers, width: str) -> StimulusRow:
    """Return profiles at DOI 1.0 mm."""
    return answers.stimulus(BARS[width])


def _receptor(stimulus: StimulusRow, x_mm: float) -> int:
    return int(np.argmin(np.abs(stimulus.receptor_mm - x_mm)))


def _profile(stimulus: StimulusRow, measure: str, x_mm: float) -> Array:
    return stimulus.ssrp(measure, _receptor(stimulus, x_mm))


def _judged(stimulus: StimulusRow, measure: str, x_mm: float) -> Verdict:
    verdict = shape_test(stimulus.indentor, stimulus.x_mm, _profile(stimulus, measure, x_mm))
    assert verdict is not None
    return verdict


def step_in_words(answers: FingerAnswers, x_mm: float, measure: str = "ep1") -> str:
    """Return what a profile under step 1 shows at a receptor."""
    p, q, passed = _peak_and_dip(under_step(answers, "1"), x_mm, measure)
    if p < COUNTS * q:
        return "only a dip"
    if q < COUNTS * p:
        return "no dip"
    return "passes" if passed else "dip exceeds peak" if q > p else "peak exceeds dip, but fails"


def _peak_and_dip(stimulus: StimulusRow, x_mm: float, measure: str) -> tuple[float, float, bool]:
    verdict = _judged(stimulus, measure, x_mm)
    p, q, b = (verdict.judged_by[name] for name in ("peak", "dip", "baseline"))
    lowest = b - float(_profile(stimulus, measure, x_mm).min())
    return p, lowest if p < COUNTS * lowest else q, verdict.passed  # a dip alone comes before the highest value


def peak_over_dip(answers: FingerAnswers) -> float:
    """Return that of ep3 under step 1 at receptor 0."""
    p, q, _ = _peak_and_dip(under_step(answers, "1"), 0.0, "ep3")
    return p / q if q else np.inf


def dip_follows(answers: FingerAnswers) -> float:
    """Return by how much the dip of ep1 under step 1 moves with the receptor, mm per mm."""
    stimulus = under_step(answers, "1")
    dips = [stimulus.x_mm[np.argmin(_profile(stimulus, "ep1", x))] for x in WITH_A_DIP_MM]
    return float(np.polyfit(WITH_A_DIP_MM, dips, 1)[0])


def second_at_zero(answers: FingerAnswers, width: str, measure: str) -> float:
    """Return how far the second maximum stands out at receptor 0 under a bar, as a part of the range."""
    judged_by = _judged(under_bar(answers, width), measure, 0.0).judged_by
    return judged_by["second"] / judged_by["range"]


def shallower(answers: FingerAnswers) -> float:
    """Return the dip of SED under the narrow bar over that under the wide one, each as a part of its range."""
    return second_at_zero(answers, "1.5", "sed") / second_at_zero(answers, "3.0", "sed")


def least_mirrored(answers: FingerAnswers, width: str) -> float:
    """Return the least correlation of the profiles of ep1, ep3 and SED at +2 with those at −2 in the mirror."""
    return min(mirrored(under_bar(answers, width), measure) for measure in OF_ALL)


def mirrored(stimulus: StimulusRow, measure: str) -> float:
    """Return the correlation of a profile at +2 with that at −2 in the mirror."""
    left = (-1.0 if measure in ODD else 1.0) * _profile(stimulus, measure, -2.0)[::-1]
    return float(np.corrcoef(_profile(stimulus, measure, 2.0), left)[0, 1])


# --- Table 5.2 and what is left ---


@cache
def _compared(answers: FingerAnswers) -> Comparison:
    return compare([*_steps(answers), *_bars(answers)], {})


def _steps(answers: FingerAnswers) -> list[StimulusRow]:
    return [under_step(answers, n) for n in "135"]


def _bars(answers: FingerAnswers) -> list[StimulusRow]:
    return [under_bar(answers, width) for width in BAR_POSITIONS]


def score(answers: FingerAnswers, name: str) -> float:
    """Return a score of the 540 cells at the threshold of the shape test."""
    steps = _steps(answers)
    ours = np.stack([found for s in steps if (found := _compared(answers).passes(s)) is not None], axis=1)
    return float(getattr(agreement(ours, source_flags(steps[0].receptor_mm)), name))


def overlap(answers: FingerAnswers, *, bars: bool) -> float:
    """Return what survives in both over what survives in either, of the steps at the low force or of the bars too."""
    judged = _steps(answers) + (_bars(answers) if bars else [])
    ours, source = set(_compared(answers).candidates(THRESHOLD, judged)), set(OF_ALL if bars else OF_STEPS)
    return len(ours & source) / len(ours | source)


# --- the recorded afferent of `rig compare --example bar3` ---


@cache
def _under_recorded_bar(answers: FingerAnswers) -> StimulusRow:
    return answers.stimulus([deep(SHAPE, DOI_MM, float(x)) for x in recorded("static").position_mm])


def recorded_r(answers: FingerAnswers, measure: str) -> float:
    """Return the correlation of a measure at receptor 0 with the static rates."""
    stimulus, recording = _under_recorded_bar(answers), recorded("static")
    found = correlation(stimulus.at(recording.position_mm), recording.rate)
    return float(found[MEASURES.index(measure), _receptor(stimulus, 0.0)])
