"""Slowest press at which an afferent fires: a class's own current and membrane, without noise, at constant speed."""

from dataclasses import replace

import numpy as np

from sim.nerve.integrator import spikes
from sim.nerve.models import AfferentModel
from sim.nerve.skin import Signal, SkinUnderIndentor

LEAST_MM_S, MOST_MM_S = 0.05, 100.0
_HALVINGS = 8  # of the logarithm of their ratio: within 3 %
_STEP_S = 1e-4
_AFTER_S = 0.3


def firing_speed_mm_s(
    model: AfferentModel, sensitivity: float, skin: SkinUnderIndentor, deepest_mm: float
) -> float | None:
    """Return the slowest press that fires an afferent, at least `LEAST_MM_S`; None if it is silent at `MOST_MM_S`.

    The press has a constant speed and a rest of 0.3 s; `skin` has the measure at the afferent's end organs.
    """
    if not _fires(model, sensitivity, skin, deepest_mm, MOST_MM_S):
        return None
    slow, fast = np.log([LEAST_MM_S, MOST_MM_S])
    if _fires(model, sensitivity, skin, deepest_mm, LEAST_MM_S):
        return LEAST_MM_S
    for _ in range(_HALVINGS):
        middle = 0.5 * (slow + fast)
        if _fires(model, sensitivity, skin, deepest_mm, float(np.exp(middle))):
            fast = middle
        else:
            slow = middle
    return float(np.exp(fast))


def _fires(
    model: AfferentModel, sensitivity: float, skin: SkinUnderIndentor, deepest_mm: float, speed_mm_s: float
) -> bool:
    t_s = np.arange(0.0, deepest_mm / speed_mm_s + _AFTER_S, _STEP_S)
    organs = np.ascontiguousarray(skin.value(np.minimum(speed_mm_s * t_s, deepest_mm)).T)
    current = model.current(Signal(_STEP_S, organs[None]), np.array([sensitivity]))[0]
    quiet = replace(model.membrane, noise=0.0)
    return bool(len(spikes(current, _STEP_S, quiet, 1, np.random.default_rng(0))))
