"""What a run is doing now, what comes next and how long it will take, by its journal and its course.

`RunState` is told the documents of a journal one by one. Whoever shows a run asks it: the run's own terminal,
`rig watch` and the panel, and, of a run that was killed, `rig show` and `rig resume`.
"""

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from rig.data.folder import RunFolder, replace_text
from rig.data.journal import Document
from rig.data.schema import WAITED_FOR

Milestone = tuple[str, int, int]
"""Stream; number of the press, or of the event in its stream; number of the hold."""

BEGUN, ENDED, READING = "indentation_start", "indentation_end", "sample"
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


_FILE = "timeline.json"
_INSIDE = (BEGUN, "touch", "hold_start", "hold_end")  # events of a press that is not over


Marks = Mapping[str, Any]
"""Block, repeat and condition of a press that a schedule asked for."""


class CourseStep(NamedTuple):
    """A step of a run, and whether it has been passed."""

    name: Milestone
    words: str
    marks: Marks
    when: Literal["done", "now", "ahead"]


@dataclass(frozen=True)
class Course:
    """What a run will pass, in order: when, in seconds of its clock, and the steps among it in words."""

    duration_s: float
    instants_s: Mapping[Milestone, float]
    words: Mapping[Milestone, str]
    marks: Mapping[Milestone, Marks] = field(default_factory=dict)  # of the steps that have any

    def keep(self, folder: RunFolder) -> None:
        """Write it into a run's folder. Raises UnwritableError."""
        passes = [
            [*name, instant_s, self.words.get(name, ""), *([self.marks[name]] if name in self.marks else [])]
            for name, instant_s in self.instants_s.items()
        ]
        replace_text(folder.path / _FILE, json.dumps({"duration_s": self.duration_s, "passes": passes}) + "\n")

    @classmethod
    def kept(cls, folder: RunFolder) -> "Course | None":
        """That of a run; None where its folder has none."""
        try:
            told = json.loads((folder.path / _FILE).read_text(encoding="utf-8"))
            passes = [((str(p[0]), int(p[1]), int(p[2])), float(p[3]), str(p[4])) for p in told["passes"]]
            words = {name: said for name, _, said in passes if said}
            marks = {name: dict(p[5]) for p, (name, _, _) in zip(told["passes"], passes, strict=True) if p[5:]}
            return cls(float(told["duration_s"]), {name: instant_s for name, instant_s, _ in passes}, words, marks)
        except (OSError, ValueError, TypeError, KeyError, IndexError):
            return None


def written_ns(folder: RunFolder) -> int:
    """When a run's course was written; 0 where there is none."""
    try:
        return (folder.path / _FILE).stat().st_mtime_ns
    except OSError:
        return 0


class Agenda:
    """The step that a run is at and the one after it; told every event."""

    def __init__(self, course: Course) -> None:
        self._words, self._marks = course.words, course.marks
        self._order = list(course.instants_s)
        self._place = {name: n for n, name in enumerate(self._order)}
        self._milestones = Milestones()
        self._passed = -1

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """What the journal is told."""
        name = self._milestones.name(stream, data)
        if name is not None:
            self._passed = self._place.get(name, self._passed)

    @property
    def now(self) -> str:
        """In words; empty when all is done."""
        return self._said(self._now)

    @property
    def next(self) -> str:
        """In words; empty where nothing comes."""
        return self._said(self._step_from(self._now + 1))

    @property
    def steps(self) -> list[CourseStep]:
        """All of them, in order."""
        now = self._now
        return [
            CourseStep(name, self._words[name], self._marks.get(name, {}), _when(n, now))
            for n, name in enumerate(self._order)
            if name in self._words
        ]

    @property
    def _now(self) -> int:
        """The press that was begun and is not over, or the first step that is not passed."""
        if self._passed >= 0:
            stream, number, _ = self._order[self._passed]
            begun = next((stream.removesuffix(end) + BEGUN for end in _INSIDE if stream.endswith(end)), "")
            if (begun, number, 0) in self._place:
                return self._place[begun, number, 0]
        return self._step_from(self._passed + 1)

    def _step_from(self, place: int) -> int:
        steps = (n for n in range(place, len(self._order)) if self._order[n] in self._words)
        return next(steps, len(self._order))

    def _said(self, place: int) -> str:
        return self._words.get(self._order[place], "") if place < len(self._order) else ""


def _when(place: int, now: int) -> Literal["done", "now", "ahead"]:
    if place == now:
        return "now"
    return "done" if place < now else "ahead"


class Placed(NamedTuple):
    """What is mounted, how far along the finger it is, and the press that was begun there last: stream and event."""

    indentor: Any = None
    along_mm: Any = 0.0
    press: tuple[str, Mapping[str, Any]] | None = None


class Heard(NamedTuple):
    """The last that a device said of itself, and when."""

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
    """What a run is doing, by the documents of its journal so far, each told once and in order.

    Values stay as events say them: of what another program wrote only what is asked for must make sense.
    time_left is told every event; without a course nobody knows what comes next.
    """

    def __init__(self, course: Course | None = None, time_left: TimeLeft | None = None) -> None:
        self.agenda = None if course is None else Agenda(course)
        self.time_left = time_left
        self.start: Mapping[str, Any] = {}
        self.stop: Mapping[str, Any] | None = None  # its end; None while it goes on, and where it was killed
        self.said = ""  # why it tripped, paused or warned last
        self.finished: set[int] = set()  # numbers of the indentations that are over
        self.indentation: Mapping[str, Any] = {}  # the one that was begun last
        self.holds: list[Mapping[str, Any]] = []  # of that one, as far as they have ended
        self.pressing = False  # a press is begun and not over, be it data or not
        self.placed: Placed | None = None  # None before anything was mounted, moved or pressed
        self.newest: Mapping[str, Any] = {}  # the last reading
        self.newest_s: tuple[float | None, float | None] = (None, None)  # on the run's clock, and since 1970
        self.x_mm: float | None = None  # by the last event that says it, as are the next two
        self.height_mm: float | None = None
        self.force_gwt: float | None = None
        self.contact: Any = None  # what is known of it: a ContactKind; None before anything is
        self._clear: Any = "raised"  # what a move away leaves
        self.homed = False
        self.heard_stage, self.heard_force = Heard(), Heard()
        self._t_s = 0.0  # of the event that is told, as is the next
        self._unix_s: float | None = None

    def apply(self, document: Document) -> None:
        """The next document."""
        kind = document["doc"]
        if kind == "event":
            self._t_s, self._unix_s = document["t_s"], document.get("unix_s")
            self.event(document["stream"], document["data"])
        elif kind == "start":
            self.start = document
        self.stop = document if kind == "stop" else None

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """The next event; all that a run's own process is told of its journal."""
        self._count(stream, data)
        self._place(stream, data)
        self._hear(stream, data)
        for told in (self.time_left, self.agenda):
            if told is not None:
                told.event(stream, data)

    def _count(self, stream: str, data: Mapping[str, Any]) -> None:
        """How far it is, and what it says of that."""
        if stream.endswith((BEGUN, ENDED)):
            self.pressing = stream.endswith(BEGUN)
        if stream == BEGUN:
            self.indentation, self.holds = data, []
        elif stream == "hold_end":
            self.holds.append(data)
        elif stream == ENDED and "index" in data:
            self.finished.add(data["index"])
        elif stream in ("alarm", "trip", "paused"):
            self.said = str(data.get("reason", ""))

    def _place(self, stream: str, data: Mapping[str, Any]) -> None:
        """Where the indentor is, whether it may touch, and what is pressed with it."""
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

    def _hear(self, stream: str, data: Mapping[str, Any]) -> None:
        """What it says of stage and sensor."""
        if stream.endswith(READING):
            self.newest, self.newest_s = data, (self._t_s, self._unix_s)
            self.heard_stage = Heard(str(data.get("phase", "moving")), self._unix_s)
            self.heard_force = Heard("reads", self._unix_s)
        elif stream in _STAGE_IS:
            self.homed = self.homed or stream == "home"
            self.heard_stage = Heard(_STAGE_IS[stream], self._unix_s)
        elif stream == "zero":
            self.heard_force = Heard("zeroed", self._unix_s)

    @property
    def now(self) -> str:
        """The step that it is at, in words; empty when all is done, or where it is not known."""
        return "" if self.agenda is None else self.agenda.now

    @property
    def next(self) -> str:
        """The step after it."""
        return "" if self.agenda is None else self.agenda.next

    @property
    def steps(self) -> list[CourseStep]:
        """All of them, in order; none where its course is not known."""
        return [] if self.agenda is None else self.agenda.steps

    @property
    def left_s(self) -> float | None:
        """Seconds until it ends; None where nobody knows."""
        return None if self.time_left is None else self.time_left.left_s

    @property
    def planned(self) -> int | None:
        """How many indentations it was begun with."""
        return self.start.get("planned_indentations")


LATE = 1000
"""Events: a course that has not come by then comes no more."""


class Onlooker(RunState):
    """The same by a run's folder: its course comes when its process has written it, and its time is the run's own."""

    def __init__(self, folder: RunFolder) -> None:
        super().__init__()
        self.folder = folder
        self._since: list[Document] = []  # the start or the last resuming; events after it until there is a course
        self._course_ns = 0
        self._words = ""  # of the press that is under way

    def take(self, documents: Iterable[Document]) -> None:
        """What came to the journal."""
        for document in documents:
            self.apply(document)
        if self._since and written_ns(self.folder) != self._course_ns:
            self._course_ns = written_ns(self.folder)
            self._go_by(Course.kept(self.folder))
        if self.agenda is not None or len(self._since) > LATE:
            del self._since[1:]

    def apply(self, document: Document) -> None:
        """The next document."""
        if document["doc"] in ("start", "resume"):
            self._since, self.agenda, self.time_left = [document], None, None
        elif document["doc"] == "event":
            if self.agenda is None and len(self._since) == 1:
                self._course_ns = 0  # a course is kept before anything happens: the one that is there is of this part
            if not document["stream"].endswith(READING):
                self._since.append(document)
        super().apply(document)

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """The next event."""
        if stream.endswith(BEGUN):
            self._words = step_in_words(stream, data)
        super().event(stream, data)

    def _go_by(self, course: Course | None) -> None:
        """What has happened is passed at once; readings are none of it."""
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
        """The step that it is at, in words; the press under way where its course is not known."""
        return (self._words if self.pressing else "") if self.agenda is None else self.agenda.now
