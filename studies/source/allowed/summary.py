"""What is left of each range, and what each fact says of the default finger, of the best one and of all of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from studies.source.allowed.facts import FACTS, Fact
from studies.source.allowed.implausible import CUT_OFF, Judge, measured
from studies.source.allowed.study import CHOOSES, TARGETS, AllowedStudy, score

Array = NDArray[np.float64]


class ShownFact(NamedTuple):
    """A fact of one finger on the default mesh, and how far off it is."""

    value: float
    off: float


@dataclass(frozen=True)
class FactLine:
    """One fact: of the default finger, also at the best one's low force, and of the best; and the nearest of all."""

    fact: Fact
    chooses: bool
    default: ShownFact
    alike: ShownFact
    best: ShownFact
    judge: Judge | None
    nearest: float  # with the emulator's error

    @property
    def out_of_reach(self) -> bool:
        """Whether no finger of the ranges comes near it."""
        return self.nearest > CUT_OFF


def lines(study: AllowedStudy) -> list[FactLine]:
    """In the order of the facts."""
    by_key = {judge.target.key: judge for judge in (*study.last.judges, *study.checks.judges)}
    row = best_row(study)
    values = np.stack([study.default, study.alike.facts[row], study.best.facts[row]])
    off, found = measured(TARGETS, values), []
    for k, fact in enumerate(FACTS):
        default, alike, best = (ShownFact(float(v), float(o)) for v, o in zip(values[:, k], off[:, k], strict=True))
        judge = by_key.get(fact.key)
        found.append(
            FactLine(fact, bool(CHOOSES[k]), default, alike, best, judge, _nearest(judge, study.last.places))
        )
    return found


def _nearest(judge: Judge | None, places: Array) -> float:
    return np.nan if judge is None else float(judge.implausibility(places).min())


def best_row(study: AllowedStudy) -> int:
    """The row of the finger that the choosing half likes best, on the default mesh: fewest ruled out, then rms."""
    scores: Sequence[tuple[int, float]] = [score(facts, CHOOSES) for facts in study.best.facts]
    return min(range(len(scores)), key=lambda k: scores[k])


def met(found: Sequence[FactLine], chooses: bool, limit: float) -> tuple[int, int, int]:
    """Facts of one half within a limit: of the default finger, of it at the best one's low force, of the best."""
    half = [(line.default, line.alike, line.best) for line in found if line.chooses is chooses]
    default, alike, best = (sum(shown.off <= limit for shown in column) for column in zip(*half, strict=True))
    return default, alike, best
