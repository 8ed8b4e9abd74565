"""Progress on standard error: of a run on its own terminal, and of counted tasks."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

from rich.console import Group
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, track
from rich.text import Text

from rig.cli.force_trace import ForceTrace, Screen, named
from rig.cli.output import Activity, a_screen, busy, complain, during, err, writes_json
from rig.data.journal import Watch
from rig.data.run_state import Course, RunState, TimeLeft, as_clock
from rig_shared.plural import number_of

T = TypeVar("T")


class _TextOf(ProgressColumn):
    """Text of a function, evaluated each time the bar is drawn."""

    def __init__(self, text: Callable[[], str]) -> None:
        super().__init__()
        self._text = text

    def render(self, task: Task) -> Text:
        return Text(self._text())


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
        measured = [] if self.deviation is None else [self.deviation.words]
        return ", ".join([done, *marks, self.where, f"peak {peak_gwt:.2f} gwt", *measured, self.left])


class _Between(Activity):
    """Activity of a run between the lines of its indentations."""

    def __init__(self, run: IndentationProgress) -> None:
        super().__init__("")
        self._run = run

    @property
    def title(self) -> str:
        """First line, which is the same as the later ones."""
        return self.line

    @property
    def line(self) -> str:
        """Finished indentations, current step and time left."""
        run = self._run
        return f"{len(run.finished)} of {run.total}, {run.now or run.where}, {run.left}"

    @property
    def state(self) -> tuple[object, ...]:
        """The same without the time left."""
        return len(self._run.finished), self._run.now or self._run.where


def counted(answers: Iterable[T], total: int, what: str) -> Iterator[T]:
    """Yield the results of tasks, with a progress bar on a terminal, else with lines.

    The first line precedes the first result, and the last one follows the last. With --json: only if the tasks are
    slow.
    """
    if not total:
        return
    if err.is_terminal:
        with during(Activity(what), live=True):
            yield from track(answers, what, total, console=err)
        return
    with busy(what, total=total) as now:
        for done, answer in enumerate(answers, 1):
            yield answer
            now.at(done, total)
    if not writes_json():
        err.print(f"{total} of {number_of(total, what)}")


@contextmanager
def progress(
    total: int, time_left: TimeLeft | None, course: Course | None = None, *, lines: bool = True
) -> Iterator[Watch]:
    """Show the progress of a run on standard error.

    Without a terminal: a line for each indentation unless `lines` is unset, or with --json; and lines in between.
    """
    run = IndentationProgress(total, time_left, course)
    shown = _bar if err.is_terminal else _lines if lines and not writes_json() else _nothing
    with during(_Between(run), live=err.is_terminal), shown(run) as show:

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
    err.print(f"{number_of(run.total, 'indentations')}, {run.left}")

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
