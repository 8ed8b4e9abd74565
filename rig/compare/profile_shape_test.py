"""The shape test of a response profile, and how often a random smooth profile passes it.

A recorded step profile shows a peak, then a smaller dip, then recovers; a recorded bar profile shows two peaks
around a dip (Raju 1998, ch. 5, by eye). The rules below are not from the source: they were fixed before any simulated
profile was seen, and are not adjusted to its verdicts.

Profiles are in the signs of `shown` and at the positions of the schedule, in any order.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.stimuli import StimulusRow
from rig_shared.outputs import Name, Output, Ratio, Shape

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Judged = tuple[Flags, dict[str, Array]]

THRESHOLD = 0.05
"""Smallest dip that counts, as a share of the peak (steps) or of the range (bars)."""

THRESHOLDS = (0.02, 0.03, 0.05, 0.08, 0.10, 0.15)
"""Thresholds for which verdicts are shown beside the default."""

_RECOVERED = 0.5
_FEWEST_POSITIONS = 5


class ShapeTestChanceJson(Output):
    """Share of random profiles that pass the shape test."""

    shape: Shape
    condition: Name
    positions: int
    smooth_over_mm: float | None
    passes_by_chance: Ratio | None
    draws: int


@dataclass(frozen=True)
class Verdict:
    """Result of the shape test, and the lengths it is based on, in the measure's unit.

    Steps: baseline b, peak p, dip q and recovery; bars: range, first and second prominence.
    """

    passed: bool
    judged_by: dict[str, float]


def shape_test(shape: str, x_mm: Array, profile: Array, threshold: float = THRESHOLD) -> Verdict | None:
    """Return the verdict on one profile (n,) at indentor positions (n,) mm, or None if no test is defined.

    Tests are defined for steps and bars along the finger, at five positions or more.
    """
    found = _judged(shape, x_mm, np.asarray(profile, dtype=float), threshold)
    if found is None:
        return None
    passed, judged_by = found
    return Verdict(bool(passed), {name: float(value) for name, value in judged_by.items()})


def shape_flags(shape: str, x_mm: Array, profiles: Array, threshold: float = THRESHOLD) -> Flags | None:
    """Return (…,) flags of profiles (…, n) that pass, or None if no test is defined."""
    found = _judged(shape, x_mm, np.asarray(profiles, dtype=float), threshold)
    return None if found is None else found[0]


def _judged(shape: str, x_mm: Array, profiles: Array, threshold: float) -> Judged | None:
    kind, _, how = shape.partition(":")
    test = {"step": _step_test, "bar": _bar_test}.get(kind)
    if test is None or "," in how or len(x_mm) < _FEWEST_POSITIONS:
        return None
    in_order_of_motion = np.argsort(-np.asarray(x_mm), kind="stable")
    return test(profiles[..., in_order_of_motion], threshold)


def _step_test(profile: Array, threshold: float) -> Judged:
    """Test p > q > threshold · p with half of q recovered: p = max − b, q = b − min after it, b = mean of ends."""
    baseline = 0.5 * (profile[..., 0] + profile[..., -1])
    place = np.arange(profile.shape[-1])
    top = np.argmax(profile, axis=-1)[..., None]
    bottom = np.argmin(np.where(place >= top, profile, np.inf), axis=-1)[..., None]
    highest, lowest = (np.take_along_axis(profile, at, -1)[..., 0] for at in (top, bottom))
    p, q = highest - baseline, baseline - lowest
    recovery = np.where(place >= bottom, profile, -np.inf).max(axis=-1) - lowest
    passed = (p > q) & (q > threshold * p) & (recovery >= _RECOVERED * q)
    return passed, {"baseline": baseline, "peak": p, "dip": q, "recovery": recovery}


def _bar_test(profile: Array, threshold: float) -> Judged:
    """Test for two interior maxima, and so a minimum between them, each of prominence > threshold · range."""
    found = np.apply_along_axis(_prominences, -1, profile)
    first, second, size = found[..., 0], found[..., 1], np.ptp(profile, axis=-1)
    return second > threshold * size, {"range": size, "first": first, "second": second}


def _prominences(profile: Array) -> Array:
    """Return the two largest prominences, 0 if there are fewer."""
    from scipy.signal import find_peaks  # as slow to import as a comparison of steps

    found = np.sort(find_peaks(profile, prominence=0)[1]["prominences"])[::-1]
    return np.append(found, [0.0, 0.0])[:2]


# How often the shape test is passed by chance: random smooth profiles at the positions of a schedule.
#
# A profile is drawn from a Gaussian process of correlation exp(−d²/2ℓ²), where ℓ is the smoothing length. A
# response that moves with the skin has one such profile for each shape, which each receptor sees shifted by its own
# position.

DRAWS = 1000
SEED = 52
NEAR_CENTRE_MM = 0.25
"""Largest distance from x = 0 (mm) of a receptor at which bars must pass, as for a candidate."""


class ShapePositions(NamedTuple):
    """Shape and the positions (n,) mm of its presses."""

    shape: str
    x_mm: Array


def smooth_profiles(x_mm: Array, over_mm: float, draws: int, rng: np.random.Generator) -> Array:
    """Return (draws, n) random profiles of unit variance at positions (n,) mm, in any order."""
    apart = np.subtract.outer(np.asarray(x_mm, dtype=float), x_mm) / over_mm
    values, vectors = np.linalg.eigh(np.exp(-0.5 * apart * apart))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(rng.standard_normal((draws, len(x_mm))) @ root.T)


def smooth_over_mm(x_mm: Array, profiles: Array) -> float:
    """Return ℓ of random profiles as smooth as profiles (N, n) at ascending positions (n,) mm; NaN if all are flat.

    Equal smoothness means the same median ratio of rms deviation to rms slope. Between 0.1 and 5 mm.
    """
    rng = np.random.default_rng(SEED)
    tried = np.geomspace(*_SMOOTH_BETWEEN_MM, _TRIED)
    ratios = [_deviation_over_slope(x_mm, smooth_profiles(x_mm, over_mm, _EACH, rng)) for over_mm in tried]
    return float(np.interp(_deviation_over_slope(x_mm, profiles), np.maximum.accumulate(ratios), tried))


_SMOOTH_BETWEEN_MM = (0.1, 5.0)
_TRIED, _EACH = 16, 1000


def _deviation_over_slope(x_mm: Array, profiles: Array) -> float:
    """Return the median ratio (mm) by trapezoids over the positions; flat profiles are ignored, NaN if all are."""
    step = np.diff(x_mm)
    middle = 0.5 * (profiles[..., 1:] + profiles[..., :-1])
    away = middle - np.average(middle, axis=-1, weights=step)[..., None]
    deviation, slope = (np.average(v * v, axis=-1, weights=step) for v in (away, np.diff(profiles) / step))
    varies = slope > 0
    return float(np.sqrt(np.median(deviation[varies] / slope[varies]))) if varies.any() else np.nan


def passed_by_chance(
    schedule: ShapePositions, over_mm: float, threshold: float = THRESHOLD, draws: int = DRAWS
) -> float | None:
    """Return the share of random smooth profiles that pass, or None if no test is defined; fixed seed."""
    profiles = smooth_profiles(schedule.x_mm, over_mm, draws, np.random.default_rng(SEED))
    flags = shape_flags(schedule.shape, schedule.x_mm, profiles, threshold)
    return None if flags is None else float(flags.mean())


def chance_rows(stimuli: Sequence[StimulusRow]) -> list[ShapeTestChanceJson]:
    """Return, for each stimulus with a shape test, the share of equally smooth random profiles that pass."""
    rows: list[ShapeTestChanceJson] = []
    for stimulus in stimuli:
        if shape_flags(stimulus.indentor, stimulus.x_mm, stimulus.x_mm) is None:
            continue
        profiles = np.moveaxis(stimulus.measures, 1, -1).reshape(-1, len(stimulus.x_mm))
        over_mm = smooth_over_mm(stimulus.x_mm, profiles)
        by_chance = (
            passed_by_chance(ShapePositions(stimulus.indentor, stimulus.x_mm), over_mm) if over_mm > 0 else None
        )
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
