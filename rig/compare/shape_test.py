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
    kind, _, how = shape.partition(":")
    test = {"step": _step_test, "bar": _bar_test}.get(kind)
    if test is None or "," in how or len(x_mm) < _FEWEST_POSITIONS:
        return None
    in_order_of_motion = np.argsort(-np.asarray(x_mm), kind="stable")
    return test(np.asarray(profile, dtype=float)[in_order_of_motion], threshold)


def _step_test(profile: Array, threshold: float) -> Verdict:
    """p = max − b, q = b − min after the peak, b = mean of the ends; p > q > threshold · p, half of q recovered."""
    baseline = 0.5 * float(profile[0] + profile[-1])
    top = int(np.argmax(profile))
    bottom = top + int(np.argmin(profile[top:]))
    p, q = float(profile[top]) - baseline, baseline - float(profile[bottom])
    recovery = float(profile[bottom:].max() - profile[bottom])
    passed = p > q > threshold * p and recovery >= _RECOVERED * q
    return Verdict(passed, {"baseline": baseline, "peak": p, "dip": q, "recovery": recovery})


def _bar_test(profile: Array, threshold: float) -> Verdict:
    """Two maxima inside the schedule, and so a minimum between them, of prominence > threshold · range each."""
    from scipy.signal import find_peaks  # takes as long to load as a comparison of steps takes

    found = np.sort(find_peaks(profile, prominence=0)[1]["prominences"])[::-1]
    first, second = (float(v) for v in np.append(found, [0.0, 0.0])[:2])
    size = float(np.ptp(profile))
    return Verdict(second > threshold * size, {"range": size, "first": first, "second": second})
