"""The shape test of a spatial response profile: has it the form that recorded profiles have?

A recorded step profile shows a peak, then a smaller dip, then recovers; a recorded bar profile shows two peaks
flanking a dip (Raju 1998, ch. 5, by eye). The rules below are ours. They were fixed before any simulated profile was
looked at, and they are not adjusted to the source's verdicts.

Profiles are given in the signs of `shown` and at the positions of the schedule, in any order.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Judged = tuple[Flags, dict[str, Array]]

THRESHOLD = 0.05
"""A dip smaller than this part of the peak (steps) or of the range (bars) does not count."""

THRESHOLDS = (0.02, 0.03, 0.05, 0.08, 0.10, 0.15)
"""Those for which verdicts are shown beside the default."""

_RECOVERED = 0.5
_FEWEST_POSITIONS = 5


@dataclass(frozen=True)
class Verdict:
    """Whether a profile passes, and the lengths it was judged by, in the measure's unit.

    Steps: baseline b, peak p, dip q and recovery; bars: range, first and second prominence.
    """

    passed: bool
    judged_by: dict[str, float]


def shape_test(shape: str, x_mm: Array, profile: Array, threshold: float = THRESHOLD) -> Verdict | None:
    """The verdict on one profile (n,) at indentor positions (n,) mm, or None where no test is defined.

    Tests are defined for steps and bars along the finger, at five positions or more.
    """
    found = _judged(shape, x_mm, np.asarray(profile, dtype=float), threshold)
    if found is None:
        return None
    passed, judged_by = found
    return Verdict(bool(passed), {name: float(value) for name, value in judged_by.items()})


def shape_flags(shape: str, x_mm: Array, profiles: Array, threshold: float = THRESHOLD) -> Flags | None:
    """(…,) which of many profiles (…, n) pass, or None where no test is defined."""
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
    """p = max − b, q = b − min after the peak, b = mean of the ends; p > q > threshold · p, half of q recovered."""
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
    """Two maxima inside the schedule, and so a minimum between them, of prominence > threshold · range each."""
    found = np.apply_along_axis(_prominences, -1, profile)
    first, second, size = found[..., 0], found[..., 1], np.ptp(profile, axis=-1)
    return second > threshold * size, {"range": size, "first": first, "second": second}


def _prominences(profile: Array) -> Array:
    """The two largest, 0 where there are fewer."""
    from scipy.signal import find_peaks  # takes as long to load as a comparison of steps takes

    found = np.sort(find_peaks(profile, prominence=0)[1]["prominences"])[::-1]
    return np.append(found, [0.0, 0.0])[:2]
