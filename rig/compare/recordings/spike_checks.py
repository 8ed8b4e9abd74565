"""Questions that are asked of the spikes of every file, whatever its kind: a sentence for the page, or a refusal.

`CHECKS` are those about the spikes alone, `RUN_CHECKS` those about the spikes on the clock of the run. A new question
is a function in one of the two.
"""

import numpy as np

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.spike_times import Array, UnitSpikes, are_inside
from rig_shared.plural import number_of

_ECHO_S, _SAME_S, _JITTER_S, _MOST_ECHOES, _MOST_SHORT = 2e-3, 2e-5, 1.5e-4, 0.3, 0.1
_REFRACTORY_S = 5e-4
_TICK_S = 1e-6
_FEW, _MOST_SAME, _MOST_CLOSE = 2, 0.01, 0.05


def _order(found: UnitSpikes) -> str:
    back = np.flatnonzero(np.diff(found.spike_s) < 0)
    if not len(back):
        return ""
    before_s, after_s = found.spike_s[back[0] : back[0] + 2].tolist()
    return (
        f"Spike times are not in ascending order, and were sorted: {after_s:g} s follows after {before_s:g} s"
        f"{f', and {len(back) - 1} more fall' if len(back) > 1 else ''}. If the file has several recordings that "
        "begin anew, give each its own file."
    )


def _doubles(found: UnitSpikes) -> str:
    """Refuse many spikes that follow another closer than a neuron fires; return a sentence on a few."""
    gaps_s, spikes = np.diff(np.sort(found.spike_s)), len(found.spike_s)
    same, close = (int(np.count_nonzero(gaps_s < least_s)) for least_s in (_TICK_S, _REFRACTORY_S))
    if same > max(_FEW, _MOST_SAME * spikes) or close > max(_FEW, _MOST_CLOSE * spikes):
        raise RecordingError(
            f"{found.where}: {close} of {spikes} spikes come less than {1e3 * _REFRACTORY_S:g} ms after "
            f"another, {same} of them at the same time, which no neuron does; if spikes are in the file twice (a "
            "unit merged with itself, a file appended to itself), delete the copies; if times begin anew in each "
            "trial, export those of the whole recording; if they are rounded, export them with more decimals; else "
            "check their unit of time",
            "spikes_twice",
        )
    comes = "spike comes" if close == 1 else "spikes come"
    said = f"{close} {comes} less than {1e3 * _REFRACTORY_S:g} ms after another, and all are counted."
    return said if close else ""


def _echoes(found: UnitSpikes) -> str:
    """Refuse spikes of which many come less than 2 ms after another with one delay.

    A detector that triggers on both phases of each spike gives such pairs, at the same delay or, if noise moves the
    crossings of the threshold, at nearly the same. A neuron that fires in bursts has intervals that vary more, and
    follow one another.
    """
    gaps_s = np.diff(np.sort(found.spike_s))
    short, spikes = gaps_s < _ECHO_S, len(found.spike_s)
    beside = np.pad(short, 1)
    paired = short & ~beside[:-2] & ~beside[2:]
    delay_s = float(np.median(gaps_s[short])) if short.any() else 0.0
    for some, jitter_s in ((short, _SAME_S), (paired, _JITTER_S)):
        echoes = int(np.count_nonzero(some & (np.abs(gaps_s - delay_s) < jitter_s)))
        if echoes > max(_FEW, _MOST_ECHOES * spikes):
            raise RecordingError(
                f"{found.where}: {echoes} of {spikes} spikes come {1e3 * delay_s:.2f} ms (± "
                f"{1e3 * jitter_s:g} ms) after another, which no neuron does; the detector may have triggered on "
                "both phases of each spike: delete one of the two",
                "spikes_twice",
            )
    return ""


CHECKS = (_order, _doubles, _echoes)


def _outside_run(found: UnitSpikes, run_s: Array, end_s: float) -> str:
    """Return a sentence on the spikes that lie outside of the run, or have negative times in the file."""
    outside_s = found.spike_s[(run_s < 0) | (run_s > end_s) | (found.spike_s < 0)]
    if not len(outside_s):
        return ""
    first, last = float(outside_s[0]), float(outside_s[-1])
    lie, at = ("lies", f"{first:g} s") if len(outside_s) == 1 else ("lie", f"{first:g} to {last:g} s")
    of = f"{len(outside_s)} of {number_of(len(run_s), 'spikes')}"
    return f"{of} {lie} before or after the run, or at a negative time of the file ({at})."


def _short_intervals(found: UnitSpikes, run_s: Array, end_s: float) -> str:
    """Return a sentence on the intervals below 2 ms within the run if they are more than a tenth."""
    gaps_s = np.diff(run_s[(run_s >= 0) & (run_s <= end_s)])
    short = int(np.count_nonzero(gaps_s < _ECHO_S))
    if short <= _MOST_SHORT * len(gaps_s):
        return ""
    share = f"{short} of {number_of(len(gaps_s), 'intervals')} between spikes ({100 * short / len(gaps_s):.0f} %)"
    return (
        f"{share} are shorter than {1e3 * _ECHO_S:g} ms, and all spikes are counted: they may be echoes of a "
        "threshold, of a detector that triggers several times on a spike, or bursts."
    )


def _not_observed(found: UnitSpikes, run_s: Array, end_s: float) -> str:
    outside = int(np.count_nonzero(~are_inside(found.observed_s, found.spike_s)))
    of = f"{outside} of {number_of(len(run_s), 'spikes')} {'lies' if outside == 1 else 'lie'}"
    return f"{of} outside of the times at which the unit was observed." if outside else ""


def _other_unit_of_time(found: UnitSpikes, run_s: Array, end_s: float) -> str:
    """Refuse spikes that are in another unit of time than the pulses, or that count from another start."""
    pulsed = len(found.pulse_s) > 0
    inside = int(np.count_nonzero((run_s >= 0) & (run_s <= end_s)))
    far = not pulsed or float(np.abs(found.spike_s).max(initial=0)) > _FAR * float(np.abs(found.pulse_s).max())
    if inside >= _LEAST_INSIDE * len(run_s) or (inside and not far):
        return ""
    remedy = (
        "the spikes must be in the same unit of time as the pulses, or have theirs in --columns time=COLUMN:ms"
        if pulsed
        else "times must be in s, or have their unit in --columns time=COLUMN:ms, and count from the start of the "
        "run (t_s), or the file must contain its sync pulses"
    )
    raise RecordingError(
        f"{found.path}: only {inside} of {len(run_s)} spikes, {run_s[0]:g} to {run_s[-1]:g} s, lie in the run of "
        f"{end_s:g} s; {remedy}",
        "outside_run",
    )


_LEAST_INSIDE = 0.05  # share of spikes in the run; of times in ms, read as s, a thousandth is
_FAR = 100  # times in ms beside pulses in s are a thousand times as large

RUN_CHECKS = (_other_unit_of_time, _outside_run, _short_intervals, _not_observed)
