"""`rig watch`, and the progress that a terminal shows of a run: force, step now and next, time left."""

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from rich.console import Console, ConsoleOptions, Group, RenderResult
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, track
from rich.text import Text

from rig.cli.options import JsonOption
from rig.cli.output import ExitCode, a_screen, complain, err, out, print_json, told_in_one_line
from rig.cli.runs import ending_of
from rig.clock import WallClock
from rig.data.folder import RunFolder
from rig.data.journal import Document, Watch
from rig.data.run import Following, RunError, followed, read_run
from rig.data.run_state import READING, Course, Onlooker, RunState, TimeLeft, as_clock
from rig.data.tables import FOREIGN, RUNNING, alive, foreign, summary_of

BLOCKS = " ▁▂▃▄▅▆▇█"
COLUMNS, ROWS, EACH = 64, 3, 4
"""Columns and lines of the trace, in characters, and readings per column."""


class ForceTrace:
    """The last readings of a run: the newest as a number, the highest of each few as a column of a trace."""

    def __init__(self, run: RunState) -> None:
        self._run = run
        self._columns: deque[float] = deque(maxlen=COLUMNS)
        self._readings = 0

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Receive an entry of the journal; only readings count."""
        if not stream.endswith(READING):
            return
        force_gwt = float(data["force_gwt"])
        if self._readings % EACH:
            self._columns[-1] = max(self._columns[-1], force_gwt)
        else:
            self._columns.append(force_gwt)
        self._readings += 1

    @property
    def line(self) -> str:
        """Force, depth and place of the newest reading."""
        newest = self._run.newest
        if not newest:
            return "no reading yet"
        depth, place = newest.get("doi_mm"), newest.get("x_mm")
        parts = [f"{newest['force_gwt']:.2f} gwt"]
        parts += [] if depth is None else [f"depth {depth:.3f} mm"]
        parts += [] if place is None else [f"x = {place:+.2f} mm"]
        return ", ".join([*parts, str(newest["phase"])])

    @property
    def highest_gwt(self) -> float:
        """Largest force of the trace, its full height (gwt)."""
        return max(self._columns, default=0.0)

    @property
    def trace(self) -> list[str]:
        """Lines of blocks from the top, as wide as the trace; values below zero are plotted as zero."""
        full = self.highest_gwt
        levels = [round(len(BLOCKS[1:]) * ROWS * force / full) if full > 0 else 0 for force in self._columns]
        lines = []
        for row in reversed(range(ROWS)):
            below = len(BLOCKS[1:]) * row
            lines.append("".join(BLOCKS[min(max(level - below, 0), len(BLOCKS) - 1)] for level in levels))
        return [line.ljust(COLUMNS) for line in lines]


class Screen:
    """Lines no wider than the terminal, with text above and below the force."""

    def __init__(self, force: ForceTrace, above: Callable[[], list[str]], below: Callable[[], list[str]]) -> None:
        self._force, self._above, self._below = force, above, below

    @property
    def lines(self) -> list[str]:
        """The current lines."""
        force = self._force
        trace = force.trace
        trace[0] += f" {force.highest_gwt:.2f} gwt"
        trace[-1] += " 0"
        return [*self._above(), named("force", force.line), *(f"  {line}" for line in trace), *self._below()]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for line in self.lines:
            yield Text(line, no_wrap=True, overflow="ellipsis")


def named(name: str, words: str) -> str:
    """A line of the screen."""
    return f"{name:<8}{words}"


LOOK_S = 0.2


class RunScreen(Onlooker):
    """A run as `rig watch` shows it."""

    def __init__(self, folder: RunFolder) -> None:
        super().__init__(folder)
        self.force = ForceTrace(self)

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """The next event."""
        super().event(stream, data)
        self.force.event(stream, data)

    def above(self) -> list[str]:
        """The lines above the force."""
        subject = f", subject {self.start['subject']}" if self.start.get("subject") else ""
        virtual = ", virtual bench" if self.start.get("virtual") else ""
        return [named("run", f"{self.folder.path.name}{subject}{virtual}")]

    def below(self) -> list[str]:
        """And below it."""
        done = f"{len(self.finished)} of {'?' if self.planned is None else self.planned}"
        left = "time left unknown" if self.left_s is None else f"{as_clock(self.left_s)} left on the run's clock"
        return [named("now", self.now or "-"), named("next", self.next or "-"), named("done", f"{done}, {left}")]


def watch_command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of the run.")],
    as_json: JsonOption = False,
) -> None:
    """Live force, step now and next, and the time left, until the run ends; in a pipe one line an event.

    With --json: how it is now, at once.
    """
    with told_in_one_line(as_json=as_json):
        seen = RunScreen(RunFolder(run))
        try:
            if as_json:
                seen.take(Following(seen.folder).new())
                print_json(_now(seen))
                return
            (_on_a_screen if out.is_terminal else _line_by_line)(seen)
            out.print("\n".join(_end(seen)))
        except FOREIGN as error:
            raise RunError(
                "run folder {run}: {problem}", code="foreign_run", run=run, problem=foreign(error)
            ) from None
        except KeyboardInterrupt:
            err.print("stopped monitoring; the run continues")
            raise typer.Exit(ExitCode.ABORTED) from None


def _on_a_screen(seen: RunScreen) -> None:
    clock, screen = WallClock(), Screen(seen.force, seen.above, seen.below)
    with Live(screen, console=out, auto_refresh=False) as live:
        for documents in followed(seen.folder, lambda: clock.wait_s(LOOK_S)):
            seen.take(documents)
            live.refresh()


def _line_by_line(seen: RunScreen) -> None:
    clock = WallClock()
    for documents in followed(seen.folder, lambda: clock.wait_s(LOOK_S)):
        seen.take(documents)
        out.print("\n".join(line for document in documents for line in _line(document)))


def _line(document: Document) -> list[str]:
    """One for each document but those that only describe others."""
    if document["doc"] == "descriptor":
        return []
    of_an_event = document["doc"] == "event"
    name, data = (document["stream"], document["data"]) if of_an_event else (document["doc"], document)
    hidden = () if of_an_event else ("doc", "uid", "seq", "t_s", "unix_s", "parameters")
    told = ", ".join(f"{key} {value}" for key, value in data.items() if value is not None and key not in hidden)
    return [f"{document['t_s']:10.3f}  {name:<18}  {told}".rstrip()]


def _end(seen: RunScreen) -> list[str]:
    """How the run ended, or left off."""
    found = read_run(seen.folder.path)
    about = alive(summary_of(found), seen.folder.path.parent)
    ending = ending_of(found, about.state) or {}
    told = {name: ending.get(name) for name in ("reason_text", "where_text", "next_text", "resume")}
    lines = [named("state", f"{about.state}, {about.done} of {about.planned} indentations")]
    names = {"reason_text": "because", "where_text": "where", "next_text": "next"}
    return lines + [named(names.get(name, name), words) for name, words in told.items() if words]


def _now(seen: RunScreen) -> dict[str, Any]:
    found = read_run(seen.folder.path)
    about = alive(summary_of(found), seen.folder.path.parent)
    newest = {name: seen.newest.get(name) for name in ("force_gwt", "doi_mm", "x_mm", "height_mm", "phase")}
    goes_on = about.state == RUNNING
    return {
        "run": str(seen.folder.path),
        "state": about.state,
        "done": about.done,
        "planned": about.planned,
        **newest,
        "now_text": seen.now if goes_on else None,
        "next_text": seen.next if goes_on else None,
        "left_s": seen.left_s if goes_on else None,
        "ending": ending_of(found, about.state),
    }


T = TypeVar("T")

_APART_S = 3.0  # lines of what is counted


class _Told(ProgressColumn):
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
        """The next event."""
        super().event(stream, data)
        self.force.event(stream, data)

    @property
    def elapsed(self) -> str:
        """h:mm:ss without what a person was waited for."""
        return "" if self.time_left is None else as_clock(self.time_left.elapsed_s)

    @property
    def left(self) -> str:
        """h:mm:ss, or that it is not known."""
        return "time left unknown" if self.time_left is None else f"{as_clock(self.time_left.left_s)} left"

    @property
    def where(self) -> str:
        """The indentor and the place of the indentation that was begun last."""
        about = self.indentation
        return f"{about['indentor']} at {about['x_mm']:+.2f} mm" if about else "starting"

    def below(self) -> list[str]:
        """The lines below the force."""
        return [named("now", self.now or "-"), named("next", self.next or "-")]

    @property
    def line(self) -> str:
        """All of the indentation that has ended."""
        about = self.indentation
        marks = [f"block {about['block']}"] if "block" in about else []
        marks += [f"condition {about['condition']}"] if "condition" in about else []
        peak_gwt = max([0.0, *(hold["peak_gwt"] for hold in self.holds)])
        done = f"{len(self.finished)} of {self.total}"
        return ", ".join([done, *marks, self.where, f"peak {peak_gwt:.2f} gwt", self.left])


def counted(
    answers: Iterable[T], total: int, what: str, *, quiet: bool, now: Callable[[], float] = time.perf_counter
) -> Iterator[T]:
    """Yield the results of pieces of work, with a progress bar on a terminal, else with lines unless quiet.

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
    told = (_Told(lambda: run.elapsed), _Told(lambda: run.left))
    bar = Progress(*columns, *told, console=err)
    task = bar.add_task(run.where, total=run.total)
    with a_screen(err, Group(Screen(run.force, list, run.below), bar)):
        yield lambda stream: bar.update(task, description=run.where, completed=len(run.finished))
