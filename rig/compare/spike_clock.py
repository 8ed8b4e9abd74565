"""What a comparison says of recordings from spike times: presses left out, whose clock, and what a shift changes."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.recordings.recording import FromSpikes, Recording
from rig.compare.recordings.spike_times import ClockSource, UnpairedPulses, joined
from rig.compare.verdict import AfferentVerdict, six_digits
from rig.errors import RigError
from rig_shared.outputs import File, Name, Output, Ratio, Shape
from rig_shared.plural import number_of

Recordings = Mapping[str, Recording]
Judge = Callable[[Recordings], object]
"""Returns the answer to recordings, in a form that is equal for equal answers."""

SHIFTS_S = (0.02, 0.1, 0.5, 2.0)
"""Shifts of a clock that are tried, later and earlier."""


class MissingPulseJson(Output):
    """A pulse of the run that is not in the file: its press, and the event that it marks."""

    press: int
    at: Name


class UnpairedPulsesJson(Output):
    """Pulses of the run and of the file that have no partner within the tolerance."""

    tolerance_s: float
    missing: list[MissingPulseJson]
    presses: list[int]
    """Finished presses without any pulse in the file."""
    others_s: list[float]
    """Pulses of the file that the run did not send, in s since its start."""


class ClockJson(Output):
    """Clock of the spike times; drift and the worst pulse are null without pulses."""

    source: ClockSource
    drift_ppm: Ratio | None
    worst_ms: float | None
    at_start_s: float | None
    """Time of the file at the start of the run."""
    known_ms: float | None
    """Largest uncertainty of a rise in the journal, either way."""
    unpaired: UnpairedPulsesJson | None
    """Null without pulses, or in a run whose pulses do not name their presses."""
    clock_text: str


class ClockShiftJson(Output):
    """Smallest tried shift of the clock of the spike times that changes the answer; null if none does."""

    later_s: float | None
    earlier_s: float | None
    tried_s: list[float]
    shift_text: str


class RecordedRateJson(Output):
    """Rates at a recorded position: their mean, and those of the presses (repeats)."""

    position_mm: float
    rate: float
    repeats: list[float]
    unit: Name
    """1/s, or the unit that the file states, such as a.u."""


class RecordingJson(Output):
    """A recording that was read. presses, observed_text, clock: null if it is a table of rates or counts."""

    afferent: Name | None
    """Null for the recordings of one afferent."""
    shape: Shape
    recording: File
    positions: int
    columns_text: str
    """Columns that were read, and their units."""
    contents_text: str
    """Presses used of those in the file, positions, and the range of the rates."""
    window_s: float | None
    """Window of the counts; null for rates."""
    rates: list[RecordedRateJson]
    presses: int | None
    not_observed_mm: list[float]
    """Positions of the presses at which the unit was not observed; they are left out."""
    observed_text: str | None
    clock: ClockJson | None


class ClockShift(NamedTuple):
    """Smallest tried shift of the recordings' clock, later and earlier (s), that changes the answer; None if none."""

    later_s: float | None
    earlier_s: float | None
    tried_s: tuple[float, ...]

    @property
    def sentence(self) -> str:
        """How far the answer depends on the clock."""
        later, earlier = (self._held(changed_s) for changed_s in (self.later_s, self.earlier_s))
        tried = ", ".join(f"{shift:g}" for shift in self.tried_s)
        return f"If this clock is shifted later, the answer {later}; if earlier, it {earlier} (tried: {tried} s)."

    def _held(self, changed_s: float | None) -> str:
        held_s = [shift for shift in self.tried_s if changed_s is None or shift < changed_s]
        holds = [f"holds up to {held_s[-1]:g} s"] if held_s else []
        return joined([*holds, *([] if changed_s is None else [f"changes at {changed_s:g} s"])])


def outcome_of(answers: Sequence[AfferentVerdict]) -> object:
    """Return what a shift may change: each outcome, and the measures of its set."""
    return [(one.outcome, sorted({row.name for row in one.set})) for one in answers]


def clock_shift(recordings: Recordings, judge: Judge, tried_s: Sequence[float] = SHIFTS_S) -> ClockShift | None:
    """Return the shifts that change the answer, or None if no recording has spike times."""
    if not any(one.spikes for one in recordings.values()):
        return None
    answer = _judged(judge, recordings, 0.0)
    later, earlier = (
        next((s for s in tried_s if _judged(judge, recordings, sign * s) != answer), None) for sign in (1, -1)
    )
    return ClockShift(later, earlier, tuple(tried_s))


def _judged(judge: Judge, recordings: Recordings, shift_s: float) -> object:
    """Return the answer to recordings whose clock is shifted, or the code of an error if too few presses are left."""
    try:
        return judge(_shifted(recordings, shift_s) if shift_s else recordings)
    except RigError as error:
        return error.code


def _shifted(recordings: Recordings, shift_s: float) -> dict[str, Recording]:
    return {key: one if one.spikes is None else one.spikes.shifted(shift_s) for key, one in recordings.items()}


def recording_sentences(found: Recording) -> list[str]:
    """Return sentences on the presses and the clock of a recording; none for a table of rates or counts."""
    spikes = found.spikes
    if spikes is None:
        return []
    every = f"All {number_of(spikes.presses, 'presses')} count as observed."
    return [spikes.left_out or every, spikes.clock.text, *spikes.notes]


def columns_sentences(recordings: Iterable[Recording]) -> list[str]:
    """Return which columns were read in which units, with the files if they differ."""
    files: dict[str, dict[str, None]] = {}
    for one in recordings:
        if one.read_as:
            files.setdefault(one.read_as, {})[one.name] = None
    if len(files) == 1:
        return list(files)
    return [f"{_few(list(names))}: {text}" for text, names in files.items()]


def contents_sentences(recordings: Mapping[str, Recordings]) -> list[str]:
    """Return what was read of each recording, by afferent ("" for the only one), with its shape if there are more."""
    every = {f"{afferent} {key}".strip(): one for afferent, some in recordings.items() for key, one in some.items()}
    return [f"{name}: {one.contents}" if len(every) > 1 else one.contents for name, one in every.items()]


_MOST_NAMED = 4


def _few(names: list[str]) -> str:
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return f"{', '.join(names[:_MOST_NAMED])}{more}"


def rate_rows(recordings: Mapping[str, Recordings]) -> Iterator[tuple[str, ...]]:
    """Yield a row per recorded position, by afferent ("" for the only one): mean rate, presses, rates, and counts."""
    for afferent, some in recordings.items():
        for key, one in some.items():
            for position, rates in zip(one.position_mm, one.repeats, strict=True):
                mean, each = f"{rates.mean():.4g} {one.rate_unit}", ", ".join(f"{rate:.4g}" for rate in rates)
                yield (*([afferent] if afferent else []), key, one.name, f"{position:g}", mean, str(len(rates)), each,
                       ", ".join(_counts(one, rates)) or "–")  # fmt: skip


def _counts(one: Recording, rates: NDArray[np.float64]) -> list[str]:
    return [] if one.window_s is None else [f"{count:.0f}" for count in rates * one.window_s]


def recording_rows(recordings: Mapping[str, Recordings]) -> Iterator[tuple[str, ...]]:
    """Yield a row per recording from spike times, by afferent ("" for the only one)."""
    for afferent, some in recordings.items():
        for key, one in some.items():
            if one.spikes is not None:
                counted = f"{one.spikes.presses - one.spikes.not_observed} of {one.spikes.presses}"
                lost = f"{one.spikes.not_observed}: {one.spikes.span}" if one.spikes.lost_mm else "0"
                yield (*([afferent] if afferent else []), key, one.name, counted, lost,
                       " ".join([one.spikes.clock.text, *one.spikes.notes]))  # fmt: skip


def recordings_as_json(recordings: Mapping[str, Recordings]) -> list[RecordingJson]:
    """Return the recordings for `--json`."""
    return [
        {
            "afferent": afferent or None,
            "shape": key.partition("@")[0],
            "recording": one.name,
            "positions": len(one.position_mm),
            "columns_text": one.read_as,
            "contents_text": one.contents,
            "window_s": one.window_s,
            "rates": [
                {
                    "position_mm": _rounded(position),
                    "rate": _rounded(rates.mean()),
                    "repeats": [_rounded(rate) for rate in rates],
                    "unit": one.rate_unit,
                }
                for position, rates in zip(one.position_mm, one.repeats, strict=True)
            ],
            "presses": None if one.spikes is None else one.spikes.presses,
            "not_observed_mm": [] if one.spikes is None else list(one.spikes.lost_mm),
            "observed_text": None if one.spikes is None else one.spikes.span,
            "clock": None if one.spikes is None else _clock_as_json(one.spikes),
        }
        for afferent, some in recordings.items()
        for key, one in some.items()
    ]


def shift_as_json(shift: ClockShift | None) -> ClockShiftJson | None:
    """Return the effect of a shift of the clock of the recordings for `--json`."""
    if shift is None:
        return None
    return {
        "later_s": shift.later_s,
        "earlier_s": shift.earlier_s,
        "tried_s": list(shift.tried_s),
        "shift_text": shift.sentence,
    }


def _rounded(value: float) -> float:
    """Round a recorded number, which is finite, to six digits."""
    return float(f"{value:.6g}")


def _unpaired_as_json(found: UnpairedPulses) -> UnpairedPulsesJson:
    return {
        "tolerance_s": found.tolerance_s,
        "missing": [{"press": press, "at": at} for press, at in found.missing],
        "presses": list(found.presses),
        "others_s": [round(one, 6) for one in found.others_s],
    }


def _clock_as_json(spikes: FromSpikes) -> ClockJson:
    clock = spikes.clock
    return {
        "source": clock.source,
        "drift_ppm": six_digits(clock.drift_ppm),
        "worst_ms": six_digits(clock.worst_ms),
        "at_start_s": six_digits(clock.at_start_s),
        "known_ms": six_digits(clock.known_ms),
        "unpaired": None if clock.unpaired is None else _unpaired_as_json(clock.unpaired),
        "clock_text": " ".join([clock.text, *spikes.notes]),
    }
