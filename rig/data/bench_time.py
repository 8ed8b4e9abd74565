"""What the time of a run went to."""

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


def booked_s(run: Run) -> dict[str, float]:
    """Seconds of the run's clock that led to each kind of event, presses that are no data or were begun anew too."""
    totals = dict.fromkeys(_LEADS_TO.values(), 0.0)
    last_s, before_s = run.start["t_s"], 0.0
    for t_s, kind in sorted(_stamps(run)):
        gone_s, last_s = t_s - last_s, t_s
        if kind == _UNTIL_THEN:
            before_s += gone_s
            continue
        totals[_LEADS_TO[kind]] += gone_s
        if kind not in WAITED_FOR:
            totals[_LEADS_TO[kind]] += before_s
            before_s = 0.0
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
