"""Section of a comparison's page on spike times: presses that were not observed, and whose clock."""

from collections.abc import Mapping

from rig.compare.spike_clock import ClockShift, Recordings, recording_rows
from rig.report.page_parts import Section

_HEADER = ("recording of", "file", "presses used", "not observed", "clock")


def spikes_sections(recordings: Mapping[str, Recordings], shift: ClockShift | None) -> list[Section]:
    """Return the section on presses that were not observed and the clock, by afferent; none without spike times."""
    rows = tuple(recording_rows(recordings))
    if not rows:
        return []
    header = _HEADER if len(rows[0]) == len(_HEADER) else ("afferent", *_HEADER)
    text = (
        "Rates are spikes in a window of each press, so they depend on the clock of the recording. A press at which "
        "the unit was not observed has no rate and is left out; it does not count as silent."
    )
    return [
        Section(
            "Spike times: observed presses and clock",
            text if shift is None else f"{text} {shift.sentence}",
            header,
            rows,
        )
    ]
