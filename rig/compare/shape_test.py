"""How often the shape test is passed by chance: random smooth profiles at the positions of a schedule.

A profile is drawn from a Gaussian process of correlation exp(−d²/2ℓ²); ℓ is called what it is smooth over. A response
that moves with the skin has one such profile for each shape, which receptors see shifted by their own place.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.shape_test import THRESHOLD, shape_flags
from rig.compare.stimuli import Stimulus

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

DRAWS = 1000
SEED = 52
NEAR_CENTRE_MM = 0.25
"""Bars must pass at a receptor this near to x = 0, as of a candidate."""


class Schedule(NamedTuple):
    """A shape and the positions (n,) mm that it is pressed at."""

    shape: str
    x_mm: Array


def smooth_profiles(x_mm: Array, over_mm: float, draws: int, rng: np.random.Generator) -> Array:
    """(draws, n) random profiles of unit variance at positions (n,) mm, in any order."""
    apart = np.subtract.outer(np.asarray(x_mm, dtype=float), x_mm) / over_mm
    values, vectors = np.linalg.eigh(np.exp(-0.5 * apart * apart))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(rng.standard_normal((draws, len(x_mm))) @ root.T)


def smooth_over_mm(x_mm: Array, profiles: Array) -> float:
    """ℓ of random profiles as smooth as profiles (N, n) at ascending positions (n,) mm; NaN of flat ones.

    As smooth: with the same median ratio of the rms deviation from the mean to the rms slope. Between 0.1 and 5 mm.
    """
    rng = np.random.default_rng(SEED)
    tried = np.geomspace(*_SMOOTH_BETWEEN_MM, _TRIED)
    ratios = [_deviation_over_slope(x_mm, smooth_profiles(x_mm, over_mm, _EACH, rng)) for over_mm in tried]
    return float(np.interp(_deviation_over_slope(x_mm, profiles), np.maximum.accumulate(ratios), tried))


_SMOOTH_BETWEEN_MM = (0.1, 5.0)
_TRIED, _EACH = 16, 1000


def _deviation_over_slope(x_mm: Array, profiles: Array) -> float:
    """In mm, trapezoids over the positions; the median of the profiles that vary, NaN where none does."""
    step = np.diff(x_mm)
    middle = 0.5 * (profiles[..., 1:] + profiles[..., :-1])
    away = middle - np.average(middle, axis=-1, weights=step)[..., None]
    deviation, slope = (np.average(v * v, axis=-1, weights=step) for v in (away, np.diff(profiles) / step))
    varies = slope > 0
    return float(np.sqrt(np.median(deviation[varies] / slope[varies]))) if varies.any() else np.nan


def passed_by_chance(
    schedule: Schedule, over_mm: float, threshold: float = THRESHOLD, draws: int = DRAWS
) -> float | None:
    """The share of random smooth profiles that pass; None where no test is defined. A fixed seed."""
    profiles = smooth_profiles(schedule.x_mm, over_mm, draws, np.random.default_rng(SEED))
    flags = shape_flags(schedule.shape, schedule.x_mm, profiles, threshold)
    return None if flags is None else float(flags.mean())


def moved_response(
    schedule: Schedule, receptor_mm: Array, over_mm: float, draws: int, rng: np.random.Generator
) -> Array:
    """(draws, receptors, n) profiles of a response that each receptor sees shifted by its own place."""
    places = schedule.x_mm - np.asarray(receptor_mm)[:, None]
    different, where = np.unique(places.round(6), return_inverse=True)
    return smooth_profiles(different, over_mm, draws, rng)[:, where.reshape(places.shape)]


def candidates_by_chance(
    schedules: Sequence[Schedule],
    receptor_mm: Array,
    over_mm: float,
    threshold: float = THRESHOLD,
    draws: int = DRAWS,
) -> float | None:
    """The share of unrelated responses that one receptor passes under every step, and one near x = 0 under every bar.

    None where no schedule has a test.
    """
    rng = np.random.default_rng(SEED)
    found: dict[str, Flags] = {}
    near = np.abs(receptor_mm) <= NEAR_CENTRE_MM
    for schedule in schedules:
        flags = shape_flags(
            schedule.shape, schedule.x_mm, moved_response(schedule, receptor_mm, over_mm, draws, rng), threshold
        )
        if flags is not None:
            family = schedule.shape.partition(":")[0]
            flags = flags & near if family == "bar" else flags
            found[family] = found.get(family, np.array(True)) & flags
    return float(np.logical_and.reduce([flags.any(axis=1) for flags in found.values()]).mean()) if found else None


def chance_rows(stimuli: Sequence[Stimulus]) -> list[dict[str, Any]]:
    """For `--json`: of each stimulus with a shape test, what random profiles as smooth as its own pass."""
    rows = []
    for stimulus in stimuli:
        if shape_flags(stimulus.indentor, stimulus.x_mm, stimulus.x_mm) is None:
            continue
        profiles = np.moveaxis(stimulus.measures, 1, -1).reshape(-1, len(stimulus.x_mm))
        over_mm = smooth_over_mm(stimulus.x_mm, profiles)
        by_chance = passed_by_chance(Schedule(stimulus.indentor, stimulus.x_mm), over_mm) if over_mm > 0 else None
        rows.append(
            {
                "shape": stimulus.indentor,
                "condition": stimulus.condition,
                "positions": len(stimulus.x_mm),
                "smooth_over_mm": round(over_mm, 3) if over_mm > 0 else None,
                "passes_by_chance": by_chance,
                "draws": DRAWS,
            }
        )
    return rows
