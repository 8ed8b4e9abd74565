"""How far a run, or work of many pieces, is: a bar where somebody looks, elsewhere a line now and then."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

from rich.console import Group
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, track
from rich.text import Text

from rig.cli.output import a_screen, complain, err
from rig.cli.screen import Force, Screen, named
from rig.plan.agenda import Agenda, Course
from rig.plan.timeline import TimeLeft, as_clock
from rig.session.session import Watch

T = TypeVar("T")

_APART_S = 3.0  # lines of what is counted


class _Told(ProgressColumn):
    """What a function says, each time that the bar is drawn."""

    def __init__(self, say: Callable[[], str]) -> None:
        super().__init__()
        self._say = say

    def render(self, task: Task) -> Text:
        return Text(self._say())


class Indentations:
    """Counts the indentations of a run, and knows where each is made, its forces, its steps and what time is left."""

    def __init__(self, total: int, time_left: TimeLeft | None, course: Course | None = None) -> None:
        self.total, self.done = total, 0
        self.time_left = time_left
        self.agenda = None if course is None else Agenda(course)
        self.force = Force()
        self._about: Mapping[str, Any] = {}
        self._peak_gwt = 0.0

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """What the journal is told."""
        if self.time_left is not None:
            self.time_left.event(stream, data)
        if self.agenda is not None:
            self.agenda.event(stream, data)
        self.force.event(stream, data)
        if stream == "indentation_start":
            self._about, self._peak_gwt = data, 0.0
        elif stream == "hold_end":
            self._peak_gwt = max(self._peak_gwt, data["peak_gwt"])
        elif stream == "indentation_end":
            self.done += 1

    @property
    def elapsed(self) -> str:
        """h:mm:ss without what a person was waited for."""
        return "" if self.time_left is None else as_clock(self.time_left.elapsed_s)

    @property
    def left(self) -> str:
        """h:mm:ss, or that it is not known."""
        return "time left not known" if self.time_left is None else f"{as_clock(self.time_left.left_s)} left"

    @property
    def where(self) -> str:
        """The indentor and the place of the indentation that was begun last."""
        return f"{self._about['indentor']} at {self._about['x_mm']:+.2f} mm" if self._about else "starting"

    @property
    def steps(self) -> list[str]:
        """Now and next."""
        now, after = ("", "") if self.agenda is None else (self.agenda.now, self.agenda.next)
        return [named("now", now or "-"), named("next", after or "-")]

    @property
    def line(self) -> str:
        """All of the indentation that has ended."""
        marks = [f"block {self._about['block']}"] if "block" in self._about else []
        marks += [f"condition {self._about['condition']}"] if "condition" in self._about else []
        parts = [f"{self.done} of {self.total}", *marks, self.where, f"peak {self._peak_gwt:.2f} gwt", self.left]
        return ", ".join(parts)


def counted(
    answers: Iterable[T], total: int, what: str, *, quiet: bool, now: Callable[[], float] = time.perf_counter
) -> Iterator[T]:
    """The answers of so many pieces of work: a bar where somebody looks, elsewhere lines, unless it is quiet there.

    The first line is there before the first answer, and the last with the last; those between are 3 s apart.
    """
    if err.is_terminal or quiet or not total:
        yield from track(answers, what, total, console=err, disable=not (err.is_terminal and total))
        return
    err.print(f"{total} {what}")
    began_s = said_s = now()
    for done, answer in enumerate(answers, 1):
        yield answer
        now_s = now()
        if done == total or now_s - said_s >= _APART_S:
            left = "" if done == total else f", {as_clock((now_s - began_s) * (total - done) / done)} left"
            err.print(f"{done} of {total} {what}{left}")
            said_s = now_s


@contextmanager
def progress(
    total: int, time_left: TimeLeft | None, course: Course | None = None, *, as_json: bool
) -> Iterator[Watch]:
    """A run of so many indentations, shown on standard error from its first second on.

    Whoever asked for JSON and has no terminal is a program, and is told of alarms only.
    """
    run = Indentations(total, time_left, course)
    shown = _bar if err.is_terminal else _nothing if as_json else _lines
    with shown(run) as show:

        def watch(stream: str, data: Mapping[str, Any]) -> None:
            run.event(stream, data)
            show(stream)
            if stream == "alarm":
                complain(f"alarm: {data['reason']}")

        yield watch


@contextmanager
def _nothing(run: Indentations) -> Iterator[Callable[[str], None]]:
    yield lambda stream: None


@contextmanager
def _lines(run: Indentations) -> Iterator[Callable[[str], None]]:
    err.print(f"{run.total} indentations, {run.left}")

    def show(stream: str) -> None:
        if stream == "indentation_end":
            err.print(run.line)

    yield show


@contextmanager
def _bar(run: Indentations) -> Iterator[Callable[[str], None]]:
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    told = (_Told(lambda: run.elapsed), _Told(lambda: run.left))
    bar = Progress(*columns, *told, console=err)
    task = bar.add_task(run.where, total=run.total)
    with a_screen(err, Group(Screen(run.force, list, lambda: run.steps), bar)):
        yield lambda stream: bar.update(task, description=run.where, completed=run.done)
