"""Progress on standard error: of a run on its own terminal, and of counted tasks."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

from rich.console import Group
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, track
from rich.text import Text

from rig.cli.force_trace import ForceTrace, Screen, named
from rig.cli.output import a_screen, complain, err
from rig.data.journal import Watch
from rig.data.run_state import Course, RunState, TimeLeft, as_clock

T = TypeVar("T")

_APART_S = 3.0  # time between lines of counted tasks


class _TextOf(ProgressColumn):
    """Text of a function, evaluated each time the bar is drawn."""

    def __init__(self, say: Callable[[], str]) -> None:
        super().__init__()
        self._say = say

    def render(self, task: Task) -> Text:
        return Text(self._say())


class IndentationProgress(RunState):
    """Progress of a run on its own terminal."""

    def __init__(self, total: int, time_left: TimeLeft | None, course: Course | None = None) -> None:
        super().__init__(course, time_left)
        self.total, self.force = total, ForceTrace(self)

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Process the next event."""
        super().event(stream, data)
        self.force.event(stream, data)

    @property
    def elapsed(self) -> str:
        """Elapsed time as h:mm:ss, excluding time spent waiting for a person."""
        return "" if self.time_left is None else as_clock(self.time_left.elapsed_s)

    @property
    def left(self) -> str:
        """Predicted time left as h:mm:ss, or that it is unknown."""
        return "time left unknown" if self.time_left is None else f"{as_clock(self.time_left.left_s)} left"

    @property
    def where(self) -> str:
        """Indentor and position of the current indentation."""
        about = self.indentation
        return f"{about['indentor']} at {about['x_mm']:+.2f} mm" if about else "starting"

    def below(self) -> list[str]:
        """Return the lines below the force."""
        return [named("now", self.now or "-"), named("next", self.next or "-")]

    @property
    def line(self) -> str:
        """Line about the finished indentation."""
        about = self.indentation
        marks = [f"block {about['block']}"] if "block" in about else []
        marks += [f"condition {about['condition']}"] if "condition" in about else []
        peak_gwt = max([0.0, *(hold["peak_gwt"] for hold in self.holds)])
        done = f"{len(self.finished)} of {self.total}"
        return ", ".join([done, *marks, self.where, f"peak {peak_gwt:.2f} gwt", self.left])


def counted(
    answers: Iterable[T], total: int, what: str, *, quiet: bool, now: Callable[[], float] = time.perf_counter
) -> Iterator[T]:
    """Yield the results of tasks, with a progress bar on a terminal, else with lines unless quiet.

    The first line precedes the first result, and the last one follows the last; others are 3 s apart.
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
    """Show the progress of a run on standard error.

    With JSON output and without a terminal, only alarms are printed.
    """
    run = IndentationProgress(total, time_left, course)
    shown = _bar if err.is_terminal else _nothing if as_json else _lines
    with shown(run) as show:

        def watch(stream: str, data: Mapping[str, Any]) -> None:
            run.event(stream, data)
            show(stream)
            if stream == "alarm":
                complain(f"alarm: {data['reason']}")

        yield watch


@contextmanager
def _nothing(run: IndentationProgress) -> Iterator[Callable[[str], None]]:
    yield lambda stream: None


@contextmanager
def _lines(run: IndentationProgress) -> Iterator[Callable[[str], None]]:
    err.print(f"{run.total} indentations, {run.left}")

    def show(stream: str) -> None:
        if stream == "indentation_end":
            err.print(run.line)

    yield show


@contextmanager
def _bar(run: IndentationProgress) -> Iterator[Callable[[str], None]]:
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    times = (_TextOf(lambda: run.elapsed), _TextOf(lambda: run.left))
    bar = Progress(*columns, *times, console=err)
    task = bar.add_task(run.where, total=run.total)
    with a_screen(err, Group(Screen(run.force, list, run.below), bar)):
        yield lambda stream: bar.update(task, description=run.where, completed=len(run.finished))
