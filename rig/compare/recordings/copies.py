"""Comparison of two recordings that may come from one unit, by their file, spikes or rates."""

from collections import Counter
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.recording import Recording
from rig.compare.recordings.spike_times import joined

Array = NDArray[np.float64]


def common_data(
    found: Recording, part: tuple[str, str], other: Recording, other_part: tuple[str, str], *, scaled: bool = False
) -> str:
    """Return what two recordings have in common: a file and its part, their spikes or rates; "" for nothing.

    Spike times have all presses of a run, so their file may be named for several stimuli. `part`: unit and sheet.
    `scaled`: rates are also the same at common positions, up to a factor, or at shifted ones, as those of one unit
    under two names, and spikes are counted in the window of the other's rates.
    """
    if found.sha256 == other.sha256 and part[found.spikes is None] == other_part[other.spikes is None]:
        return "the same file"
    if found.spikes is not None and other.spikes is not None:
        return _same_spikes(found.spikes.spike_s, other.spikes.spike_s)
    alike = (_same_rates(one, another, scaled=scaled) for one, another in _in_one_window(found, other, scaled))
    return next(filter(None, alike), "")


def _in_one_window(found: Recording, other: Recording, scaled: bool) -> Iterator[tuple[Recording, Recording]]:
    """Yield two recordings, and them with the spikes of one counted in the window of the other, or in usual ones."""
    yield found, other
    if not scaled or (found.spikes is None) == (other.spikes is None):
        return
    table, spikes = (found, other.spikes) if found.spikes is None else (other, found.spikes)
    assert spikes is not None
    for window_s in _USUAL_WINDOWS_S if table.window_s is None else (table.window_s,):
        try:
            counted = spikes.counted(window_s)
        except RecordingError:  # longer than a hold
            continue
        yield table, counted


_USUAL_WINDOWS_S = (0.1, 0.2, 0.25, 0.3, 0.4, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0)


def _same_spikes(spike_s: Array, other_s: Array) -> str:
    """Return in words that nearly all spikes of one unit are those of the other, where both have any.

    Either may be cut shorter, at both ends, or rounded. A constant lag of up to 2 ms, as of another channel or
    filter, is no difference.
    """
    few, many = sorted(_where_both_are(spike_s, other_s), key=len)
    if not len(few) or (len(few) < _FEWEST_SPIKES and len(few) != len(many)):
        return ""
    first, last = np.searchsorted(many, few - _MOST_LAG_S), np.searchsorted(many, few + _MOST_LAG_S)
    lags_s = np.sort(np.concatenate([many[a:b] - one for one, a, b in zip(few, first, last, strict=True)]))
    within = np.searchsorted(lags_s, lags_s + 2 * _SAME_LAG_S, side="right") - np.arange(len(lags_s))
    best_s = float(lags_s[within.argmax()]) + _SAME_LAG_S if len(lags_s) else 0.0
    for lag_s, same_s in ((0.0, _SAME_SPIKE_S), (best_s, _SAME_LAG_S)):
        after = np.clip(np.searchsorted(many, few + lag_s), 1, max(len(many) - 1, 1))
        beside = np.abs(np.stack([many[after - 1], many[np.minimum(after, len(many) - 1)]]) - (few + lag_s))
        same = int(np.count_nonzero(beside.min(axis=0) <= same_s + _TICK_S))
        if same >= _MOST_OF_SPIKES * len(few):
            return f"the same spikes ({same} of {len(few)})"
    return ""


def _where_both_are(spike_s: Array, other_s: Array) -> tuple[Array, Array]:
    """Return the spikes of two units between the later of their first ones and the earlier of their last ones."""
    if not len(spike_s) or not len(other_s):
        return spike_s, other_s
    first = max(spike_s[0], other_s[0]) - _MOST_LAG_S
    last = min(spike_s[-1], other_s[-1]) + _MOST_LAG_S
    here, there = (one[(one >= first) & (one <= last)] for one in (spike_s, other_s))
    enough = min(len(here), len(there)) >= _FEWEST_SPIKES
    return (here, there) if enough else (spike_s, other_s)


def _same_rates(found: Recording, other: Recording, *, scaled: bool) -> str:
    """Return in words that the rates of all common presses are the same, as exactly as a table may have them.

    They are compared if enough of them differ and are above 0: two stimuli may leave an afferent silent.
    """
    for shift_mm in [0.0, *(_shifts_mm(found, other) if scaled else [])]:
        there = {round(float(x), _DECIMALS): rates for x, rates in zip(other.position_mm, other.repeats, strict=True)}
        pairs = [(rates, there[at]) for x, rates in zip(found.position_mm, found.repeats, strict=True)
                 if (at := round(float(x) + shift_mm, _DECIMALS)) in there]  # fmt: skip
        if not pairs:
            continue
        every = len(pairs) == len(found.repeats) == len(other.repeats)
        every = every and all(len(here) == len(rates) for here, rates in pairs)
        pairs = [_common_repeats(*pair) for pair in pairs]
        here, rates = (np.concatenate([pair[k] for pair in pairs]) for k in (0, 1))
        different = len(set(here.tolist()) - {0.0})
        for factor in (1.0, float(rates.sum() / here.sum()) if scaled and here.sum() > 0 else 1.0):
            is_plain = factor == 1.0 and shift_mm == 0
            fewest = _FEWEST_RATES if is_plain and every else _FEWEST_SHORTER if is_plain else _FEWEST_SCALED
            fewer = min(len(found.repeats), len(other.repeats))
            most = every or (scaled and len(pairs) >= _MOST_OF_PRESSES * fewer)
            rounding = 0.0 if factor == 1.0 else 0.51 * (_value_step(rates) + factor * _value_step(here))
            within = np.maximum(_ROUNDED * np.abs(rates), rounding)
            noise = _LEAST_NOISE * np.sqrt(np.maximum(rates, 0.0) * rates.max())
            by_chance = np.divide(2 * within, _SQRT_TAU * noise, out=np.ones_like(noise), where=noise > 0)
            sure = factor == 1.0 or float(np.prod(np.minimum(1.0, by_chance))) < _EXCLUDED
            if different >= fewest and most and sure and (np.abs(rates - factor * here) <= within).all():
                of_factor, of_shift = f"a factor of {factor:.4g}", f"a shift of {shift_mm:g} mm"
                changed = joined([of_factor] * (factor != 1) + [of_shift] * (shift_mm != 0))
                up_to = f", up to {changed}" if changed else ""
                return f"the same rates at {len(pairs)} positions, {different} different ones{up_to}"
    return ""


def _shifts_mm(found: Recording, other: Recording) -> list[float]:
    """Return the shifts after which most positions of two recordings are the same ones."""
    fewest = max(_FEWEST_SCALED, _MOST_OF_PRESSES * min(len(found.repeats), len(other.repeats)))
    shifts = Counter(np.round(other.position_mm[:, None] - found.position_mm, _DECIMALS).ravel().tolist())
    return [shift_mm for shift_mm, positions in shifts.most_common() if shift_mm and positions >= fewest]


def _common_repeats(here: Array, there: Array) -> tuple[Array, Array]:
    """Return the rates of two recordings at a position, in order; of the longer one those that the other has."""
    few, many = np.sort(here), np.sort(there)
    if len(few) == len(many):
        return few, many
    shorter, longer = sorted((few, many), key=len)
    if not Counter(shorter.tolist()) - Counter(longer.tolist()):
        return shorter, shorter
    return few[: len(shorter)], many[: len(shorter)]


_FEWEST_SPIKES, _SAME_SPIKE_S, _MOST_OF_SPIKES = 10, 5e-4, 0.9
_MOST_LAG_S, _SAME_LAG_S, _TICK_S = 2e-3, 2e-4, 1e-7
_FEWEST_RATES, _FEWEST_SHORTER, _FEWEST_SCALED, _MOST_OF_PRESSES = 3, 4, 5, 0.75
_DECIMALS = 3
_ROUNDED, _SQRT_TAU, _LEAST_NOISE, _EXCLUDED = 1e-3, 2.5, 0.1, 1e-7
"""Share by which a rate may be rounded; a step of a normal density has the chance step / (2.5 sd); noise of the
highest rate, relative to it, as of 100 spikes; chance below which rates agree as copies do."""


def _value_step(values: Array) -> float:
    """Return the step of which all differences of some values are multiples, as of counts in a window; 0 for none."""
    gaps = np.diff(np.unique(values))
    for parts in _PARTS if len(gaps) else ():
        steps = gaps * parts / gaps.min()
        if (np.abs(steps - np.round(steps)) < 0.02 * parts).all():
            return float(gaps.min()) / parts
    return 0.0


_PARTS = (1, 2, 3, 4, 5)  # of the smallest difference
