"""Table 5.2 of the source and what is left at the end of its ch. 5."""

import numpy as np

from rig.compare.comparison import Comparison, compare
from rig.compare.profile_shape_test import THRESHOLD
from rig.compare.raju_table_5_2 import Agreement, Flags, agreement, agreement_limits, source_flags
from rig.compare.stimuli import StimulusRow
from rig.report.page_parts import Section
from studies.source.printed.answers import HIGH_GWT, LOW_GWT, FingerAnswers, forced, once
from studies.source.printed.profiles import BAR_POSITIONS, BARS, under_bar, under_step
from studies.source.printed.steps import MOVED, POSITIONS_MM
from studies.source.shape_test_errors import by_chance_section, perturbed_section
from studies.source.table_agreement import survivors_section, table_5_2

STRONG = {n: [forced(f"step:{n}", HIGH_GWT, x) for x in positions] for n, positions in POSITIONS_MM.items()}
OF_STEPS, OF_ALL = ("e13", "ep1", "ep3", "sed"), ("ep1", "ep3", "sed")


@once
def compared(answers: FingerAnswers) -> Comparison:
    """Steps at both forces, and bars."""
    strong = [answers.stimulus(STRONG[n]) for n in "135"]
    return compare([*_low(answers), *strong, *_bars(answers)], {})


def _low(answers: FingerAnswers) -> list[StimulusRow]:
    return [under_step(answers, n) for n in "135"]


def _bars(answers: FingerAnswers) -> list[StimulusRow]:
    return [under_bar(answers, width) for width in BAR_POSITIONS]


@once
def flags(answers: FingerAnswers) -> tuple[Flags, Flags]:
    """(18, 3, receptors) ours, at the threshold of the shape test, and the source's."""
    low = _low(answers)
    ours = np.stack([found for s in low if (found := compared(answers).passes(s)) is not None], axis=1)
    return ours, source_flags(low[0].receptor_mm)


@once
def agreed(answers: FingerAnswers) -> Agreement:
    """Cell by cell."""
    return agreement(*flags(answers))


def score(answers: FingerAnswers, name: str) -> float:
    """A score of all cells."""
    return float(getattr(agreed(answers), name))


def limits(answers: FingerAnswers, name: str) -> str:
    """Its 95 % limits, in words."""
    found = [getattr(agreement_limits(*flags(answers), over), name) for over in ("measures", "receptors")]
    by_measures, by_receptors = (f"{low:.2f} … {high:.2f}" for low, high in found)
    return f"95 % {by_measures} by measures, {by_receptors} by receptors"


def survivors(answers: FingerAnswers, bars: bool) -> list[str]:
    """Of the steps at the low force, and of the bars too."""
    return compared(answers).candidates(THRESHOLD, _low(answers) + (_bars(answers) if bars else []))


def overlap(answers: FingerAnswers, bars: bool, source: tuple[str, ...]) -> float:
    """What both have over what either has."""
    ours = set(survivors(answers, bars))
    return len(ours & set(source)) / len(ours | set(source))


def named(answers: FingerAnswers, bars: bool) -> str:
    """The survivors, in words."""
    return ", ".join(survivors(answers, bars)) or "none"


def cells(answers: FingerAnswers) -> tuple[Section, ...]:
    """Table 5.2, and how often the shape test errs."""
    judged = [*_low(answers), *_bars(answers)]
    return *table_5_2(compared(answers), LOW_GWT), by_chance_section(judged), perturbed_section(judged)


def conditions(answers: FingerAnswers) -> tuple[Section, ...]:
    """Survivors by condition."""
    return (survivors_section(compared(answers)),)


LOW_SCENES = tuple(scene for scenes in (*MOVED.values(), *BARS.values()) for scene in scenes)
