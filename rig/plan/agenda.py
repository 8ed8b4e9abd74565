"""What a run is at, what comes next and how much of it is left, by its rehearsal: kept beside its journal."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from rig.data.folder import RunFolder, replace_text
from rig.plan.timeline import BEGUN, Milestone, Milestones, TimeLeft

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


class Ahead:
    """What is ahead of a run by its course; told every event with its instant on the run's clock."""

    def __init__(self, course: Course, begins_s: float) -> None:
        self._now_s = begins_s
        self.agenda = Agenda(course)
        self._left = TimeLeft(course.instants_s, course.duration_s, lambda: self._now_s, pace=1.0)

    def event(self, t_s: float, stream: str, data: Mapping[str, Any]) -> None:
        """What the journal was told."""
        self._now_s = t_s
        self._left.event(stream, data)
        self.agenda.event(stream, data)

    @property
    def left_s(self) -> float:
        """Seconds of the run's clock."""
        return self._left.left_s
