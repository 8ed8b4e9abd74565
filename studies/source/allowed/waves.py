"""Waves: emulate, rule out, press more fingers in what is left, until that no longer shrinks."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from studies.source.allowed import design, kept
from studies.source.allowed.implausible import FactTarget, Judge, MeshDeviation, allowed, inflation_needed, judges

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class WavePlan:
    """Fingers of each wave, places at which they are judged, and when to stop before the last."""

    fingers: tuple[int, ...] = (32, 32, 10, 26)
    fewest: int = 100  # fingers, before the waves may stop
    places: int = 2**15
    still: float = 0.9  # of the places left before are left: it no longer shrinks
    least: float = 1e-3  # of all places must be left, or reading and model are trusted too much


@dataclass(frozen=True)
class RemainingPlaces:
    """What a number of fingers leaves: at which inflation, which places of all that were judged, and by whom."""

    fingers: int
    inflation: float
    places: Array  # (m, d)
    allowed: Flags  # (m,)
    judges: list[Judge]

    @property
    def share(self) -> float:
        """Of all places."""
        return float(np.mean(self.allowed))


@dataclass(frozen=True)
class Match:
    """A history match: what is asked, what it should come to, what the mesh adds, how far to go, where it is kept."""

    asked: design.Asked
    targets: Sequence[FactTarget]
    meshes: Sequence[MeshDeviation]
    plan: WavePlan
    folder: Path

    def all(self, say: design.Say) -> list[RemainingPlaces]:
        """Every wave, until nothing more is ruled out."""
        places = design.filling(self.plan.fingers[0], len(self.asked.parameters))
        tables = [design.run(self.asked, places, self._path(1), say)]
        lefts = [self.judged(tables)]
        while len(lefts) < len(self.plan.fingers) and not self._enough(lefts):
            left = lefts[-1]
            say(f"{left.share:.2%} left after {left.fingers} fingers, inflation {left.inflation:g}")
            taken = self.asked.places_of(kept.together(tables))
            places = design.spread_among(left.places[left.allowed], self.plan.fingers[len(tables)], taken)
            tables.append(design.run(self.asked, places, self._path(len(tables) + 1), say))
            lefts.append(self.judged(tables))
        return lefts

    def judged(self, tables: Sequence[kept.FingerSample], inflation: float | None = None) -> RemainingPlaces:
        """What the fingers of all tables leave; without an inflation at the least that leaves something."""
        whole = kept.together(tables)
        x, facts = self.asked.places_of(whole), whole.facts[:, self._columns]
        found = judges(x, facts, self.targets, self.meshes)
        places = design.filling(self.plan.places, len(self.asked.parameters), design.SEED + 1)
        factor = inflation_needed(found, places, self.plan.least) if inflation is None else inflation
        return RemainingPlaces(len(x), factor, places, allowed(found, places, factor), found)

    def tables(self, waves: int) -> list[kept.FingerSample]:
        """Of the first waves, as they are kept."""
        return [kept.read(self._path(k + 1), self.asked.parameters, self.asked.facts) for k in range(waves)]

    @property
    def _columns(self) -> list[int]:
        return [list(self.asked.facts).index(target.key) for target in self.targets]

    def _path(self, wave: int) -> Path:
        return self.folder / f"wave_{wave}.csv"

    def _enough(self, lefts: Sequence[RemainingPlaces]) -> bool:
        """Whether the waves may stop."""
        return lefts[-1].fingers >= self.plan.fewest and self._still(lefts)

    def _still(self, lefts: Sequence[RemainingPlaces]) -> bool:
        """Whether the last two waves ruled out next to nothing each, and asked for no more inflation."""
        steps = list(pairwise(lefts[-3:]))
        ruled = (
            now.inflation > before.inflation or now.share < self.plan.still * before.share for before, now in steps
        )
        return len(steps) == 2 and not any(ruled)
