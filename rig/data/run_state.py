"""Present and next steps of a run and its remaining time, from its journal and its course.

`RunState` receives the documents of a journal one by one. The run's own terminal, `rig watch` and the panel display
it, and for a killed run `rig show` and `rig resume`.
"""

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from rig.data.deviation import PressDeviation, bands_of, deviation_of
from rig.data.documents import Document
from rig.data.events import READING, WAITED_FOR, is_last_hold
from rig.data.folder import RunFolder, replace_text
from rig_shared.user_files import json_of, read_text

Milestone = tuple[str, int, int]
"""Stream; number of the press, or of the event in its stream; number of the hold."""

BEGUN, ENDED = "indentation_start", "indentation_end"
_ONE_BY_ONE = ("mount", "home", "zero", "move", "rest", "find", "choice")
_OF_A_PRESS = (BEGUN, "touch", "hold_start", "hold_end", ENDED)

_MARKS = ("block", "repeat", "condition")


class Milestones:
    """Names of the events of a run, equal to those of its rehearsal; a repeated press passes its own again."""

    def __init__(self) -> None:
        self._passed: Counter[str] = Counter()

    def name(self, stream: str, data: Mapping[str, Any]) -> Milestone | None:
        """Return the milestone of an event; None for readings, notes and pauses."""
        if stream in _ONE_BY_ONE:
            self._passed[stream] += 1
            return stream, self._passed[stream], 0
        return (stream, data["index"], data.get("hold", 0)) if stream.endswith(_OF_A_PRESS) else None


class Timeline:
    """Recorder of the time of each milestone, of the data of steps, and of the number of events."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now, self._milestones = now, Milestones()
        self.instants_s: dict[Milestone, float] = {}
        self._steps: dict[Milestone, Mapping[str, Any]] = {}
        self.events = 0

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Record the time of a milestone."""
        self.events += 1
        name = self._milestones.name(stream, data)
        if name is not None:
            self.instants_s[name] = self._now()
            if stream in _ONE_BY_ONE or stream.endswith(BEGUN):
                self._steps[name] = data

    def settle(self) -> None:
        """Do nothing: there is no disk."""

    @property
    def words(self) -> dict[Milestone, str]:
        """Step in words, by the milestone that ends it, or that begins a press."""
        return {name: step_in_words(name[0], data) for name, data in self._steps.items()}

    @property
    def marks(self) -> dict[Milestone, dict[str, Any]]:
        """Block, repeat and condition of scheduled presses."""
        found = {name: {key: data[key] for key in _MARKS if key in data} for name, data in self._steps.items()}
        return {name: marks for name, marks in found.items() if marks}


def step_in_words(stream: str, data: Mapping[str, Any]) -> str:
    """Return the step that ends with this event, or the press that begins with it, in words."""
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
        case "choice":
            return "choose the next press"
    unit = {"doi_mm": "mm", "force_gwt": "gwt"}[data["target"]]
    purpose = stream.removesuffix(BEGUN).replace("_", " ") or "press "
    return f"{purpose}{data['indentor']} at {data['x_mm']:+.2f} mm to {data['value']:g} {unit}"


class TimeLeft:
    """Elapsed and remaining time of a run (s), without waits for a person."""

    def __init__(
        self,
        instants_s: Mapping[Milestone, float],
        duration_s: float,
        now: Callable[[], float],
        *,
        pace: float,
        measured: bool = False,
    ) -> None:
        """Use the timeline of a rehearsal of duration_s. pace: seconds of `now` per rehearsed second.

        measured: use pace only up to the first milestone, then the measured pace.
        """
        self._instants_s, self._duration_s = instants_s, duration_s
        ends_s = [*instants_s.values(), duration_s]
        self._next_s = ends_s[0]  # next milestone, in the rehearsal
        self._next_after_s = dict(zip(instants_s, ends_s[1:], strict=True))
        self._now, self._pace, self._measured = now, pace, measured
        self._milestones = Milestones()
        self._last_s, self._counted_s = now(), 0.0  # at the last event
        self._passed_s, self._passed_at_s = 0.0, 0.0  # last milestone, in the rehearsal and in the run
        self._paused = False

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Count an event of the journal."""
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
        """Elapsed time (s); between two events no longer than rehearsed, because the rest may be a person."""
        if self._paused:
            return self._counted_s
        ahead_s = max(self._to_next_s - (self._counted_s - self._passed_at_s), 0.0)
        return self._counted_s + min(self._now() - self._last_s, ahead_s)

    @property
    def left_s(self) -> float:
        """Remaining time (s) by the timeline, from the last milestone on; it stops at the next one."""
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
    """Return h:mm:ss, rounded up."""
    whole = math.ceil(max(seconds, 0.0))
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


_FILE = "timeline.json"
_INSIDE = (BEGUN, "touch", "hold_start", "hold_end")  # events within a press


Marks = Mapping[str, Any]
"""Block, repeat and condition of a scheduled press."""


class CourseStep(NamedTuple):
    """Step of a run, and whether it has ended."""

    name: Milestone
    words: str
    marks: Marks
    when: Literal["done", "now", "ahead"]


@dataclass(frozen=True)
class Course:
    """Predicted milestones of a run, with their times (s) on its clock, and its steps in words."""

    duration_s: float
    instants_s: Mapping[Milestone, float]
    words: Mapping[Milestone, str]
    marks: Mapping[Milestone, Marks] = field(default_factory=dict)  # of the steps that have any

    def save(self, folder: RunFolder) -> None:
        """Write the course into a run's folder. Raises UnwritableError."""
        passes = [
            [*name, instant_s, self.words.get(name, ""), *([self.marks[name]] if name in self.marks else [])]
            for name, instant_s in self.instants_s.items()
        ]
        replace_text(folder.path / _FILE, json.dumps({"duration_s": self.duration_s, "passes": passes}) + "\n")

    @classmethod
    def load(cls, folder: RunFolder) -> "Course | None":
        """Return the course from a run's folder, or None."""
        try:
            stored = json_of(read_text(folder.path / _FILE))
            passes = [((str(p[0]), int(p[1]), int(p[2])), float(p[3]), str(p[4])) for p in stored["passes"]]
            words = {name: text for name, _, text in passes if text}
            marks = {name: dict(p[5]) for p, (name, _, _) in zip(stored["passes"], passes, strict=True) if p[5:]}
            return cls(float(stored["duration_s"]), {name: instant_s for name, instant_s, _ in passes}, words, marks)
        except (OSError, ValueError, TypeError, KeyError, IndexError, OverflowError, AttributeError):
            return None


def written_ns(folder: RunFolder) -> int:
    """Return the time at which a run's course was written (ns), or 0."""
    try:
        return (folder.path / _FILE).stat().st_mtime_ns
    except OSError:
        return 0


class Agenda:
    """Present and next step of a run, from all of its events."""

    def __init__(self, course: Course) -> None:
        self._words, self._marks = course.words, course.marks
        self._order = list(course.instants_s)
        self._index = {name: n for n, name in enumerate(self._order)}
        self._milestones = Milestones()
        self._passed = -1

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Follow an event of the journal."""
        name = self._milestones.name(stream, data)
        if name is not None:
            self._passed = self._index.get(name, self._passed)
            if name in self._words:  # A script may decide as it runs.
                self._words = {**self._words, name: step_in_words(stream, data)}

    @property
    def now(self) -> str:
        """Present step in words; empty at the end."""
        return self._words_of(self._now)

    @property
    def next(self) -> str:
        """Next step in words; empty at the end."""
        return self._words_of(self._step_from(self._now + 1))

    @property
    def steps(self) -> list[CourseStep]:
        """All steps, in order."""
        now = self._now
        return [
            CourseStep(name, self._words[name], self._marks.get(name, {}), _when(n, now))
            for n, name in enumerate(self._order)
            if name in self._words
        ]

    @property
    def _now(self) -> int:
        """Index of the present press, or of the first step that has not ended."""
        if self._passed >= 0:
            stream, number, _ = self._order[self._passed]
            begun = next((stream.removesuffix(end) + BEGUN for end in _INSIDE if stream.endswith(end)), "")
            if (begun, number, 0) in self._index:
                return self._index[begun, number, 0]
        return self._step_from(self._passed + 1)

    def _step_from(self, index: int) -> int:
        steps = (n for n in range(index, len(self._order)) if self._order[n] in self._words)
        return next(steps, len(self._order))

    def _words_of(self, index: int) -> str:
        return self._words.get(self._order[index], "") if index < len(self._order) else ""


def _when(index: int, now: int) -> Literal["done", "now", "ahead"]:
    if index == now:
        return "now"
    return "done" if index < now else "ahead"


class Placed(NamedTuple):
    """Mounted indentor, position along the finger, and last press there: stream and event."""

    indentor: Any = None
    along_mm: Any = 0.0
    press: tuple[str, Mapping[str, Any]] | None = None


class DeviceStatus(NamedTuple):
    """Last status of a device, and its time."""

    word: str = "no data"
    unix_s: float | None = None


_CLEAR = ("home", "retract", "move", "rest", "zero", "mount", "paused")
_DOING = {
    purpose + name
    for purpose in ("", "precondition_", "reference_", "find_")
    for name in (BEGUN, READING, "touch", "hold_start", "hold_end", "sync")
}
_STAGE_IS = {"home": "homed", "move": "at rest", "retract": "at rest", "trip": "tripped"}


class RunState:
    """State of a run from the documents of its journal, received once and in order.

    Values stay as recorded: of a journal of another program only the requested ones must be valid. time_left
    receives every event; without a course the next step is unknown.
    """

    def __init__(self, course: Course | None = None, time_left: TimeLeft | None = None) -> None:
        self.agenda = None if course is None else Agenda(course)
        self.time_left = time_left
        self.start: Mapping[str, Any] = {}
        self.stop: Mapping[str, Any] | None = None  # its end; None while it runs, and after a kill
        self.said = ""  # reason of the last trip, pause or alarm
        self.finished: set[int] = set()  # indices of the finished indentations
        self.deviations: dict[int, PressDeviation] = {}  # of the same
        self.indentation: Mapping[str, Any] = {}  # the last one that began
        self.holds: list[Mapping[str, Any]] = []  # finished ones of that indentation
        self.pressing = False  # during any press
        self.placed: Placed | None = None  # None before any mount, move or press
        self.newest: Mapping[str, Any] = {}  # the last reading
        self.newest_s: tuple[float | None, float | None] = (None, None)  # since the start of the run, and since 1970
        self.x_mm: float | None = None  # of the last event that has it, like the next two
        self.height_mm: float | None = None
        self.force_gwt: float | None = None
        self.contact: Any = None  # ContactKind, or None if unknown
        self._clear: Any = "raised"  # state after a move away
        self.homed = False
        self.stage_status, self.force_status = DeviceStatus(), DeviceStatus()
        self._t_s = 0.0  # of the present event, like the next one
        self._unix_s: float | None = None

    def apply(self, document: Document) -> None:
        """Apply the next document."""
        kind = document["doc"]
        if kind == "event":
            self._t_s, self._unix_s = document["t_s"], document.get("unix_s")
            self.event(document["stream"], document["data"])
        elif kind == "start":
            self.start = document
        self.stop = document if kind == "stop" else None

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Apply the next event; a run's own process calls only this."""
        self._update_progress(stream, data)
        self._update_place(stream, data)
        self._update_devices(stream, data)
        for listener in (self.time_left, self.agenda):
            if listener is not None:
                listener.event(stream, data)

    def _update_progress(self, stream: str, data: Mapping[str, Any]) -> None:
        """Update progress and problem."""
        if stream.endswith((BEGUN, ENDED)):
            self.pressing = stream.endswith(BEGUN)
        if stream == BEGUN:
            self.indentation, self.holds = data, []
        elif stream == "hold_end":
            self.holds.append(data)
            if is_last_hold(data, self.indentation) and "index" in data:
                self.finished.add(data["index"])
                if self.deviation is not None:
                    self.deviations[data["index"]] = self.deviation
        elif stream in ("alarm", "trip", "paused"):
            self.said = str(data.get("reason", ""))

    def _update_place(self, stream: str, data: Mapping[str, Any]) -> None:
        """Update position, contact and press."""
        self.x_mm = data.get("x_mm", self.x_mm)
        self.height_mm = data.get("height_mm", self.height_mm)
        self.force_gwt = data.get("force_gwt", self.force_gwt)
        if stream in _CLEAR:
            self.contact = self._clear = "lifted" if stream == "zero" else data.get("contact", self._clear)
        elif stream in _DOING:
            self.contact = "unknown"
        before = self.placed or Placed()
        if stream == "mount":
            self.placed = Placed(data.get("indentor"))
        elif stream == "move":
            self.placed = Placed(before.indentor, data.get("along_mm") or 0.0)
        elif stream.endswith(BEGUN):
            self.placed = Placed(data.get("indentor"), before.along_mm, (stream, data))

    def _update_devices(self, stream: str, data: Mapping[str, Any]) -> None:
        """Update stage and sensor."""
        if stream.endswith(READING):
            self.newest, self.newest_s = data, (self._t_s, self._unix_s)
            self.stage_status = DeviceStatus(str(data.get("phase", "moving")), self._unix_s)
            self.force_status = DeviceStatus("reads", self._unix_s)
        elif stream in _STAGE_IS:
            self.homed = self.homed or stream == "home"
            self.stage_status = DeviceStatus(_STAGE_IS[stream], self._unix_s)
        elif stream == "zero":
            self.force_status = DeviceStatus("zeroed", self._unix_s)

    @property
    def deviation(self) -> PressDeviation | None:
        """Measured beside predicted quantity of the last indentation; None before its last hold has ended."""
        if not self.holds or not is_last_hold(self.holds[-1], self.indentation):
            return None
        return deviation_of(self.indentation, self.holds[-1], bands_of(self.start))

    @property
    def unix_s(self) -> float | None:
        """Time of the last event, seconds since 1970."""
        return self._unix_s

    @property
    def now(self) -> str:
        """Present step in words; empty at the end, or without a course."""
        return "" if self.agenda is None else self.agenda.now

    @property
    def next(self) -> str:
        """Next step."""
        return "" if self.agenda is None else self.agenda.next

    @property
    def steps(self) -> list[CourseStep]:
        """All steps, in order; empty without a course."""
        return [] if self.agenda is None else self.agenda.steps

    @property
    def left_s(self) -> float | None:
        """Remaining time (s), or None."""
        return None if self.time_left is None else self.time_left.left_s

    @property
    def planned(self) -> int | None:
        """Number of planned indentations."""
        return self.start.get("planned_indentations")


LATE = 1000
"""Number of events after which a missing course is no longer expected."""


class RunFollower(RunState):
    """State of a run from its folder, with the course as soon as it is written, on the run's clock."""

    def __init__(self, folder: RunFolder) -> None:
        super().__init__()
        self.folder = folder
        self._since: list[Document] = []  # The last start or resume, and the later events until there is a course.
        self._course_ns = 0
        self._words = ""  # of the present press

    def take(self, documents: Iterable[Document]) -> None:
        """Apply new documents."""
        for document in documents:
            self.apply(document)
        if self._since and written_ns(self.folder) != self._course_ns:
            self._course_ns = written_ns(self.folder)
            self._go_by(Course.load(self.folder))
        if self.agenda is not None or len(self._since) > LATE:
            del self._since[1:]

    def apply(self, document: Document) -> None:
        """Apply the next document."""
        if document["doc"] in ("start", "resume"):
            self._since, self.agenda, self.time_left = [document], None, None
        elif document["doc"] == "event":
            if self.agenda is None and len(self._since) == 1:
                # A course is written before any event, so an existing one belongs to this part.
                self._course_ns = 0
            if not document["stream"].endswith(READING):
                self._since.append(document)
        super().apply(document)

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Apply the next event."""
        if stream.endswith(BEGUN):
            self._words = step_in_words(stream, data)
        super().event(stream, data)

    def _go_by(self, course: Course | None) -> None:
        """Use a course, and apply the past events except readings."""
        self.agenda, self.time_left = None, None
        if course is None:
            return
        self._t_s = self._since[0]["t_s"]
        self.agenda = Agenda(course)
        self.time_left = TimeLeft(course.instants_s, course.duration_s, lambda: self._t_s, pace=1.0)
        for document in self._since:
            if document["doc"] == "event":
                self._t_s = document["t_s"]
                self.time_left.event(document["stream"], document["data"])
                self.agenda.event(document["stream"], document["data"])

    @property
    def now(self) -> str:
        """Present step in words; without a course, the present press."""
        return (self._words if self.pressing else "") if self.agenda is None else self.agenda.now
