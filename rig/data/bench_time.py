"""What the time of a run went to."""

from dataclasses import dataclass

from rig.data.reader import Run
from rig.engine.streams import WAITED_FOR

_LEADS_TO = {
    **dict.fromkeys(WAITED_FOR, "waiting for a person"),
    **dict.fromkeys(("home", "zero", "note", "checkpoint", "trip"), "homing, zero and notes"),
    **dict.fromkeys(("clearance", "move", "moving"), "lateral moves"),
    "rest": "rest",
    "approach": "approach",
    "back off": "touch-off",
    "touch": "touch-off",
    "press": "press and seek",
    "hold": "hold",
    "retract": "lift",
}
_UNTIL_THEN = "paused"  # what leads to it belongs to what it came between


@dataclass(frozen=True)
class Span:
    """A stretch of the run's clock and what it went to."""

    begin_s: float
    end_s: float
    what: str


def spans(run: Run) -> list[Span]:
    """What led to each event, presses that are no data or were begun anew too; together they are the whole run."""
    found, paused = list[Span](), list[tuple[float, float]]()
    last_s = run.start["t_s"]
    for t_s, kind in sorted(_stamps(run)):
        gone, last_s = (last_s, t_s), t_s
        if kind == _UNTIL_THEN:
            paused.append(gone)
            continue
        found.append(Span(*gone, _LEADS_TO[kind]))
        if kind not in WAITED_FOR:
            found += [Span(*before, _LEADS_TO[kind]) for before in paused]
            paused = []
    return found


def booked_s(run: Run) -> dict[str, float]:
    """Seconds of the run's clock that led to each kind of event."""
    totals = dict.fromkeys(_LEADS_TO.values(), 0.0)
    for span in spans(run):
        totals[span.what] += span.end_s - span.begin_s
    return totals


def _stamps(run: Run) -> list[tuple[float, str]]:
    stamps = list[tuple[float, str]]()
    for events in (run.events, run.superseded):
        for stream, found in events.items():
            if stream.endswith("sample"):
                stamps += [(event["t_s"], event["phase"]) for event in found]
            elif stream in _LEADS_TO or stream == _UNTIL_THEN:
                stamps += [(event["t_s"], stream) for event in found]
    return stamps
