"""The history match of the source's finger: its waves, meshes compared, the best of what is left in full."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from studies.source.allowed import design, kept
from studies.source.allowed.facts import CHOOSE, FACTS, Fact
from studies.source.allowed.implausible import CUT_OFF, FactTarget, MeshDeviation, measured, mesh_error, worst
from studies.source.allowed.one_finger import facts_of
from studies.source.allowed.pins import but_for_the_pinned
from studies.source.allowed.ranges import COARSE, DEFAULT, FULL, LOW_FORCE, NAMES, place_of, values_at
from studies.source.allowed.waves import Match, RemainingPlaces, WavePlan

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

KEYS = tuple(fact.key for fact in FACTS)
CHOOSES = np.array([fact.figure in CHOOSE for fact in FACTS])
COMPARED = 6
"""Fingers of the first wave that are built on the default mesh too, beside the default finger."""

BEST = 3
"""Of what is left: built on the default mesh, and beside them the default finger but for what is pinned."""


def asked(mesh: Mapping[str, float]) -> design.Asked:
    """A finger on a mesh."""
    return design.Asked(values_at, place_of, partial(facts_of, mesh=mesh), NAMES, KEYS)


def target(fact: Fact) -> FactTarget:
    """A fact without the way to measure it."""
    return FactTarget(fact.key, fact.low, fact.high, fact.reading, fact.model)


TARGETS = tuple(target(fact) for fact in FACTS)


@dataclass(frozen=True)
class AllowedStudy:
    """What came of it: by wave what the choosing half leaves; what each mesh says; the best, on the default mesh."""

    meshes: Sequence[MeshDeviation]
    lefts: Sequence[RemainingPlaces]
    checks: RemainingPlaces
    default: Array  # (facts,) on the default mesh
    best: kept.FingerSample
    alike: kept.FingerSample  # the default finger at the low force of each of the best
    tables: Sequence[kept.FingerSample] = ()  # of each wave

    @property
    def last(self) -> RemainingPlaces:
        """After the last wave."""
        return self.lefts[-1]


PLAN = WavePlan()


def made(folder: Path, say: design.Say, plan: WavePlan = PLAN) -> AllowedStudy:
    """From what is kept in a folder, and what is pressed now."""
    first = design.filling(plan.fingers[0], len(NAMES))
    both = np.vstack([place_of(DEFAULT), first[:COMPARED]])
    coarse = design.run(asked(COARSE), both, folder / "mesh_design.csv", say)
    full = design.run(asked(FULL), both, folder / "mesh_default.csv", say)
    meshes = [mesh_error(a, b) for a, b in zip(coarse.facts.T, full.facts.T, strict=True)]
    match = _match(CHOOSES, meshes, plan, folder)
    lefts = match.all(say)
    tables, after = match.tables(len(lefts)), lefts[-1].fingers
    checks = _match(~CHOOSES, meshes, plan, folder).judged(tables, lefts[-1].inflation)
    for name in ("best", "default_alike"):
        kept.begin_anew(folder / f"{name}.csv", after=after)
    candidates = np.vstack([best_places(lefts[-1]), but_for_the_pinned(lefts[-1])])
    best = design.run(asked(FULL), candidates, folder / "best.csv", say, after=after)
    forces = best.values[:, NAMES.index(LOW_FORCE)]
    others = np.stack([place_of(DEFAULT | {LOW_FORCE: float(force)}) for force in forces])
    alike = design.run(asked(FULL), others, folder / "default_alike.csv", say, after=after)
    return AllowedStudy(meshes, lefts, checks, full.facts[0], best, alike, tables)


def _match(chosen: Flags, meshes: Sequence[MeshDeviation], plan: WavePlan, folder: Path) -> Match:
    """By some of the facts."""
    targets = [one for one, takes_part in zip(TARGETS, chosen, strict=True) if takes_part]
    errors = [one for one, takes_part in zip(meshes, chosen, strict=True) if takes_part]
    return Match(asked(COARSE), targets, errors, plan, folder)


def best_places(left: RemainingPlaces) -> Array:
    """(≤ BEST, d) of what is left: the one that is worst by least, and others spread over the better tenth."""
    inside = left.places[left.allowed]
    by_worst = inside[np.argsort(worst(left.judges, inside, left.inflation))]
    better = by_worst[1 : max(BEST, len(by_worst) // 10)]
    return np.concatenate([by_worst[:1], design.spread_among(better, BEST - 1, by_worst[:1])])


def score(facts: Array, chosen: Flags) -> tuple[int, float]:
    """Of one half on the default mesh: facts that are ruled out, and the rms implausibility."""
    found = measured(TARGETS, facts[None])[0][chosen]
    found = found[np.isfinite(found)]
    return int((found > CUT_OFF).sum()), float(np.sqrt(np.mean(found**2)))


def better(facts: Array, default: Array) -> bool:
    """Whether a finger may become the default one: the checking half improves and the choosing half is no worse.

    Both at one low force, which is no part of a finger. Improves: no more facts ruled out, and a lower rms. No worse:
    neither is higher.
    """
    (out, rms), (out_before, rms_before) = score(facts, ~CHOOSES), score(default, ~CHOOSES)
    chosen, chosen_before = score(facts, CHOOSES), score(default, CHOOSES)
    no_worse = chosen[0] <= chosen_before[0] and chosen[1] <= chosen_before[1]
    return no_worse and out <= out_before and rms < rms_before
