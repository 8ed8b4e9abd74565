"""Whether the verdicts on the 18 measures hold in another world: the shape test, and which measure explains best."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.profile_shape_test import shape_flags
from sim.measures.measures import MEASURES, shown
from sim.measures.receptors import DEFAULT_X_MM
from studies.finite_strain.ratios import correlation

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Profiles = Mapping[tuple[str, str], tuple[Array, Array]]  # shape and target: x (n,) and measures (18, receptors, n)

STEPS, BARS = ("step:1", "step:3", "step:5"), ("bar:1.5", "bar:3.0")
TRUTHS = ("ep1", "ep3", "sed")
BAR_TARGET = "1 mm"
NEAR_CENTRE_MM = 0.25
_STEPS_AT, _BARS_AT = -1.0, 0.0  # the receptors that the source fits


def profiles(rows: Sequence[Mapping[str, Any]], world: str) -> Profiles:
    """Those of a world that reached their target, in the signs in which profiles are shown."""
    found: dict[tuple[str, str], dict[float, Array]] = {}
    for row in rows:
        if row["world"] == world and row["measures"] is not None:
            found.setdefault((row["shape"], row["target"]), {})[row["x_mm"]] = np.array(row["measures"])
    return {
        key: (np.array(sorted(at)), np.stack([_shown(at[x]) for x in sorted(at)], axis=-1))
        for key, at in found.items()
    }


def _shown(measures: Array) -> Array:
    return np.stack([shown(name, values) for name, values in zip(MEASURES, measures, strict=True)])


def among(found: Profiles, others: Profiles) -> Profiles:
    """A world's profiles at the places that another has."""
    kept = {key: np.isin(found[key][0], x) for key, (x, _) in others.items() if key in found}
    return {key: (found[key][0][keep], found[key][1][..., keep]) for key, keep in kept.items()}


class WorldVerdicts(NamedTuple):
    """Of a world at one force: flags (18, receptors) by shape, what survives steps, and steps and bars."""

    flags: Mapping[str, Flags]
    survivors: tuple[str, ...]
    candidates: tuple[str, ...]


def verdicts(found: Profiles, target: str) -> WorldVerdicts:
    """The rule of `rig/compare/comparison.py`: one receptor under all steps, one near x = 0 under both bars."""
    flags = {}
    for shape in (*STEPS, *BARS):
        x, profile = found[shape, BAR_TARGET if shape in BARS else target]
        passed = shape_flags(shape, x, profile)
        assert passed is not None
        flags[shape] = passed & (np.abs(DEFAULT_X_MM) <= NEAR_CENTRE_MM) if shape in BARS else passed
    steps, bars = (np.logical_and.reduce([flags[s] for s in shapes]).any(axis=1) for shapes in (STEPS, BARS))
    return WorldVerdicts(flags, _names(steps), _names(steps & bars))


def _names(passed: Flags) -> tuple[str, ...]:
    return tuple(name for name, yes in zip(MEASURES, passed, strict=True) if yes)


class Rank(NamedTuple):
    """Where the measure that a receptor of one world follows comes among the 18 of another, and who comes first."""

    truth: str
    rank: int
    r: float
    first: str
    first_r: float


def ranks(truth: Profiles, ours: Profiles, target: str) -> list[Rank]:
    """By correlation over steps at one receptor and bars at another, each family less its mean."""
    found = []
    for name in TRUTHS:
        recorded = _joined(truth, target, ours)[MEASURES.index(name)]
        r = np.nan_to_num([correlation(values, recorded) for values in _joined(ours, target, truth)])
        order = np.argsort(-r, kind="stable")
        mine = MEASURES.index(name)
        rank = 1 + int(np.flatnonzero(order == mine)[0])
        found.append(Rank(name, rank, float(r[mine]), MEASURES[order[0]], float(r[order[0]])))
    return found


def _joined(found: Profiles, target: str, other: Profiles) -> Array:
    """(18, positions) of steps and bars where both worlds have them, each family over its own spread."""
    parts = []
    for shapes, receptor, at in ((STEPS, _STEPS_AT, target), (BARS, _BARS_AT, BAR_TARGET)):
        k = DEFAULT_X_MM.index(receptor)
        family = [found[s, at][1][:, k, np.isin(found[s, at][0], other[s, at][0])] for s in shapes]
        joined = np.concatenate(family, axis=1)
        joined = joined - joined.mean(axis=1, keepdims=True)
        spread = np.linalg.norm(joined, axis=1, keepdims=True)
        parts.append(joined / np.where(spread > 0, spread, 1.0))
    return np.concatenate(parts, axis=1)
