"""Sections of a comparison's page on its recordings: the rates as read, presses not observed, and whose clock."""

from collections.abc import Mapping

from rig.compare.spike_clock import (
    ClockShift,
    Recordings,
    columns_sentences,
    contents_sentences,
    rate_rows,
    recording_rows,
)
from rig.report.page_parts import Section

_HEADER = ("recording of", "file", "presses used", "not observed", "clock")


def spikes_sections(recordings: Mapping[str, Recordings], shift: ClockShift | None) -> list[Section]:
    """Return the sections on the rates and, with spike times, on presses not observed and the clock, by afferent."""
    rates = _rates(recordings)
    rows = tuple(recording_rows(recordings))
    if not rows:
        return rates
    header = _HEADER if len(rows[0]) == len(_HEADER) else ("afferent", *_HEADER)
    text = (
        "Rates are spikes in a window of each press, so they depend on the clock of the recording. A press at which "
        "the unit was not observed has no rate and is left out; it does not count as silent."
    )
    return [
        *rates,
        Section(
            "Spike times: observed presses and clock",
            text if shift is None else f"{text} {shift.sentence}",
            header,
            rows,
        ),
    ]


_RATES = ("recording of", "file", "position (mm)", "mean rate", "presses", "rate of each", "spikes of each")


def _rates(recordings: Mapping[str, Recordings]) -> list[Section]:
    """Return the section with all recorded rates as they were read, and from which columns; none without any."""
    rows = tuple(rate_rows(recordings))
    if not rows:
        return []
    said = columns_sentences(one for some in recordings.values() for one in some.values())
    text = "All rates of the recordings as they were read."
    header = _RATES if len(rows[0]) == len(_RATES) else ("afferent", *_RATES)
    return [Section("Recorded rates", text, header, rows, points=(*said, *contents_sentences(recordings)))]
