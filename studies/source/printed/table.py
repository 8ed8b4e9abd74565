"""Table 5.2 of the source and what is left at the end of its ch. 5."""

from functools import partial

import numpy as np

from rig.compare.comparison import Comparison, compare
from rig.compare.raju_table_5_2 import Agreement, Flags, agreement, agreement_limits, source_flags
from rig.compare.shape_test import THRESHOLD
from rig.compare.stimuli import Stimulus
from rig.report.page import Section
from studies.source.printed.answers import HIGH_GWT, LOW_GWT, FingerAnswers, forced, once
from studies.source.printed.entry import Claim, Entry
from studies.source.printed.profiles import BAR_POSITIONS, BARS, under_bar, under_step
from studies.source.printed.rules import Above
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


def _low(answers: FingerAnswers) -> list[Stimulus]:
    return [under_step(answers, n) for n in "135"]


def _bars(answers: FingerAnswers) -> list[Stimulus]:
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


def _score(says: str, name: str, source: str) -> Claim:
    def limits(answers: FingerAnswers) -> str:
        found = [getattr(agreement_limits(*flags(answers), over), name) for over in ("measures", "receptors")]
        told = [f"{low:.2f} … {high:.2f}" for low, high in found]
        return f"95 % {told[0]} by measures, {told[1]} by receptors"

    return Claim(says, source, Above(0.8, 0.4), lambda answers: getattr(agreed(answers), name), beside=limits)


def survivors(answers: FingerAnswers, bars: bool) -> list[str]:
    """Of the steps at the low force, and of the bars too."""
    return compared(answers).candidates(THRESHOLD, _low(answers) + (_bars(answers) if bars else []))


def overlap(answers: FingerAnswers, bars: bool, source: tuple[str, ...]) -> float:
    """What both have over what either has."""
    ours = set(survivors(answers, bars))
    return len(ours & set(source)) / len(ours | set(source))


def _named(answers: FingerAnswers, bars: bool) -> str:
    return ", ".join(survivors(answers, bars)) or "none"


def _left(says: str, bars: bool, source: tuple[str, ...]) -> Claim:
    measured = partial(overlap, bars=bars, source=source)
    return Claim(f"{says}, overlap", ", ".join(source), Above(0.99, 0.5), measured, beside=partial(_named, bars=bars))


def _cells(answers: FingerAnswers) -> tuple[Section, ...]:
    judged = [*_low(answers), *_bars(answers)]
    return *table_5_2(compared(answers), LOW_GWT), by_chance_section(judged), perturbed_section(judged)


def _conditions(answers: FingerAnswers) -> tuple[Section, ...]:
    return (survivors_section(compared(answers)),)


LOW_SCENES = tuple(scene for scenes in (*MOVED.values(), *BARS.values()) for scene in scenes)

ENTRIES = (
    Entry(
        "Table 5.2",
        "Which of 18 measures match the recorded profiles at which receptors: 57 of 540 cells.",
        (
            _score("Matthews' coefficient, 540 cells", "matthews", "1 is all alike, 0 is chance"),
            _score("precision", "precision", "1"),
            _score("recall", "recall", "1"),
        ),
        (*LOW_SCENES, *(scene for scenes in STRONG.values() for scene in scenes)),
        tables=_cells,
        reading="The source judged by eye, on an unpublished geometry; this study applies a rule with one threshold, "
        "not tuned to single cells. The printed +1.5 of e11 may be a misprint for −1.5.",
    ),
    Entry(
        "ch. 5, survivors",
        "What is left of 18 measures: of the steps e13, ep1, ep3 and SED, of steps and bars ep1, ep3 and SED.",
        (
            _left("survivors of steps 1, 3, 5 at 2.33 gwt", False, OF_STEPS),
            _left("of steps and bars", True, OF_ALL),
        ),
        LOW_SCENES,
        tables=_conditions,
        reading="docs/validation/source_verdicts.md shows how this changes with receptor depth, epidermis, stiffness "
        "and force.",
    ),
)
