"""When a run passes what: the instants of its rehearsal, and by them how much of the run is left."""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from rig.engine.streams import WAITED_FOR

Milestone = tuple[str, int, int]
"""Stream; number of the press, or of the event in its stream; number of the hold."""

BEGUN, ENDED = "indentation_start", "indentation_end"
_ONE_BY_ONE = ("mount", "home", "zero", "move", "rest", "find")
_OF_A_PRESS = (BEGUN, "touch", "hold_start", "hold_end", ENDED)

_MARKS = ("block", "repeat", "condition")


class Milestones:
    """Names the events of a run; a rehearsal has the same ones, and a press begun anew passes its own again."""

    def __init__(self) -> None:
        self._passed: Counter[str] = Counter()

    def name(self, stream: str, data: Mapping[str, Any]) -> Milestone | None:
        """None for what is none: readings, notes, pauses."""
        if stream in _ONE_BY_ONE:
            self._passed[stream] += 1
            return stream, self._passed[stream], 0
        return (stream, data["index"], data.get("hold", 0)) if stream.endswith(_OF_A_PRESS) else None


class Timeline:
    """A journal that keeps when each milestone was passed, and what was told of those that are steps."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now, self._milestones = now, Milestones()
        self.instants_s: dict[Milestone, float] = {}
        self._steps: dict[Milestone, Mapping[str, Any]] = {}

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Its instant is kept if it is a milestone."""
        name = self._milestones.name(stream, data)
        if name is not None:
            self.instants_s[name] = self._now()
            if stream in _ONE_BY_ONE or stream.endswith(BEGUN):
                self._steps[name] = data

    @property
    def words(self) -> dict[Milestone, str]:
        """What is done on the way to each step's milestone, or from it on."""
        return {name: step_in_words(name[0], data) for name, data in self._steps.items()}

    @property
    def marks(self) -> dict[Milestone, dict[str, Any]]:
        """Block, repeat and condition of the presses that a schedule asked for."""
        found = {name: {key: data[key] for key in _MARKS if key in data} for name, data in self._steps.items()}
        return {name: marks for name, marks in found.items() if marks}


def step_in_words(stream: str, data: Mapping[str, Any]) -> str:
    """What is done until this event, or from it on where it begins a press."""
    match stream:
        case "mount":
            return f"mount {data['indentor']}"
        case "move":
            along = f", {data['along_mm']:+.2f} mm along the finger" if data.get("along_mm") else ""
            return f"move to x = {data['x_mm']:+.2f} mm{along}"
        case "rest":
            return f"rest {data['rest_s']:g} s"
        case "find":
            return f"touch at x = {data['x_mm']:+.2f} mm"
        case "home" | "zero":
            return stream
    unit = {"doi_mm": "mm", "force_gwt": "gwt"}[data["target"]]
    purpose = stream.removesuffix(BEGUN).replace("_", " ") or "press "
    return f"{purpose}{data['indentor']} at {data['x_mm']:+.2f} mm to {data['value']:g} {unit}"


class TimeLeft:
    """Seconds gone and left of a run as it passes its milestones; waiting for a person is neither."""

    def __init__(
        self,
        instants_s: Mapping[Milestone, float],
        duration_s: float,
        now: Callable[[], float],
        *,
        pace: float,
        measured: bool = False,
    ) -> None:
        """By the timeline of a rehearsal that took duration_s. pace: seconds of `now` for one of those.

        measured: only until a milestone is passed; then it is what the run has taken so far.
        """
        self._instants_s, self._duration_s = instants_s, duration_s
        ends_s = [*instants_s.values(), duration_s]
        self._next_s = ends_s[0]  # milestone, in the rehearsal
        self._next_after_s = dict(zip(instants_s, ends_s[1:], strict=True))
        self._now, self._pace, self._measured = now, pace, measured
        self._milestones = Milestones()
        self._last_s, self._counted_s = now(), 0.0  # at the last event
        self._passed_s, self._passed_at_s = 0.0, 0.0  # the last milestone: in the rehearsal, and here
        self._paused = False

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """What the journal is told."""
        now_s = self._now()
        if stream not in WAITED_FOR:
            self._counted_s += now_s - self._last_s
        self._last_s, self._paused = now_s, stream == "paused"
        name = self._milestones.name(stream, data)
        if name is not None and name in self._instants_s:
            self._passed_s, self._next_s = self._instants_s[name], self._next_after_s[name]
            self._passed_at_s = self._counted_s

    @property
    def elapsed_s(self) -> float:
        """Between two events no longer than the rehearsal took: what takes longer may be a person."""
        if self._paused:
            return self._counted_s
        ahead_s = max(self._to_next_s - (self._counted_s - self._passed_at_s), 0.0)
        return self._counted_s + min(self._now() - self._last_s, ahead_s)

    @property
    def left_s(self) -> float:
        """By the timeline, from the last milestone on; the next one is waited for."""
        gone_s = min(self.elapsed_s - self._passed_at_s, self._to_next_s)
        return (self._duration_s - self._passed_s) * self._seconds_each - gone_s

    @property
    def _seconds_each(self) -> float:
        known = self._measured and self._passed_s > 0
        return self._passed_at_s / self._passed_s if known else self._pace

    @property
    def _to_next_s(self) -> float:
        return (self._next_s - self._passed_s) * self._seconds_each


def as_clock(seconds: float) -> str:
    """h:mm:ss, begun seconds counted."""
    whole = math.ceil(max(seconds, 0.0))
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
