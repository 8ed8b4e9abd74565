"""Standard output, standard error, and how a command ends."""

import json
import logging
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from enum import IntEnum
from functools import wraps
from itertools import pairwise
from statistics import median
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

from rich.console import Console, ConsoleOptions, RenderableType
from rich.live import Live
from rich.segment import Segment
from rich.spinner import Spinner

from rig.errors import RigError
from rig.printable import printable
from rig_shared.plural import number_of

if TYPE_CHECKING:
    from rig.cli.failure import FailureJson
    from rig.data.ending import EndingJson
    from rig_shared.outputs import Output


class _Terminal(Console):
    """Console that prints no control sequences of texts, also in tables and live screens."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        """Yield the printed segments, with visible control characters."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(printable(segment.text), segment.style)


err = _Terminal(stderr=True, highlight=False, soft_wrap=True, markup=False)
out = _Terminal(highlight=False, soft_wrap=True, markup=False)

THE_FINGER = "fingertip: loading from the cache, or building …"

FIRST_S, EVERY_S = 0.5, 2.0
"""Time after which work that may be short prints its description, and time between lines without a terminal (s)."""

_FEWEST_PIECES = 3
"""Finished pieces before the time left is printed; the first often includes work that is done once."""

_LOOKS_S = 0.1
_REFRESH_PER_S = 8


class Activity:
    """Work in progress, with its description, its finished pieces, and the time left by the pieces of this time.

    A build of a model within the work has a description and pieces of its own, until it ends or the work goes on.
    """

    def __init__(self, what: str, total: int = 0, now: Callable[[], float] | None = None) -> None:
        self.what = self._own = what
        self._counted = total > 0
        self._now = now or time.monotonic
        self._began_s = self._now()
        self._done, self._total = self._pieces = 0, total
        self._of, self._stamps = total, [(0, self._began_s)]  # pieces finished at times, since their total changed

    def say(self, what: str) -> None:
        """Change the description of the work."""
        self._own = what
        self.turn_back()

    def at(self, done: int, total: int) -> None:
        """Set how many pieces of the work are done."""
        self._pieces = done, total
        self.turn_back()

    def builds(self, what: str, done: int = 0, total: int = 0) -> None:
        """Show a step of a build within the work."""
        self.what, self._done, self._total = what, done, total
        self._stamp()

    def turn_back(self) -> None:
        """Continue with the work after a build."""
        self.what, (self._done, self._total) = self._own, self._pieces
        self._stamp()

    def _stamp(self) -> None:
        if not self._total:
            return
        if self._total != self._of:
            self._of, self._stamps = self._total, [(self._done, self._now())]
        elif self._done > self._stamps[-1][0]:
            self._stamps.append((self._done, self._now()))

    @property
    def title(self) -> str:
        """Description of the work, with the number of its pieces."""
        return number_of(self._total, self.what) if self._counts else self.what

    @property
    def elapsed_s(self) -> float:
        """Time since it began."""
        return self._now() - self._began_s

    @property
    def line(self) -> str:
        """Description of the work, its progress, and the time left."""
        what = self.what
        if self._counts:  # of one piece, "0 of 1" would say nothing
            pieces = number_of(self._total, self.what)
            what = pieces if self._total == 1 else f"{self._done} of {pieces}"
        return f"{what}, {in_words(self.elapsed_s)} so far{self._left}"

    @property
    def state(self) -> tuple[object, ...]:
        """Description and progress without times; without a terminal, a line is printed only when it changes."""
        return self.what, self._done, self._total

    @property
    def _counts(self) -> bool:
        """True if the line shows finished pieces of the work; false while it shows a build within the work."""
        return self._counted and self.what == self._own

    @property
    def _left(self) -> str:
        done, at_s = self._stamps[-1]
        if done - self._stamps[0][0] < _FEWEST_PIECES or self._done >= self._total:
            return ""
        each_s = median((after_s - before_s) / (after - before)
                        for (before, before_s), (after, after_s) in pairwise(self._stamps))  # fmt: skip
        left_s = each_s * (self._total - done) - (self._now() - at_s)
        return f", about {in_words(left_s)} left" if left_s > 0 else ""


def in_words(seconds: float) -> str:
    """Format a duration: 7 s, 2 min 5 s."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


class _Activities:
    """Activities in progress, the innermost last, and the thread that breaks their silence."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._all: list[tuple[Activity | None, bool]] = []  # and whether a live line shows it; None while people act
        self._said_s = self._began_s = 0.0
        self._said: tuple[Activity, tuple[object, ...]] | None = None
        self._printer: threading.Thread | None = None
        self.silent = False  # nobody reads progress: a program started the command, or it only prints its help

    @property
    def current(self) -> Activity | None:
        """Innermost activity."""
        return self._all[-1][0] if self._all else None

    @property
    def live(self) -> bool:
        """Whether a live line shows the innermost activity."""
        return bool(self._all) and self._all[-1][1]

    @contextmanager
    def during(self, activity: Activity | None, *, at_once: bool = False, live: bool = False) -> Iterator[None]:
        """Print lines of an activity: one at once, or when nothing was printed for a while."""
        if self.silent:
            yield
            return
        with self._changed:
            if not self._all:
                self._began_s, self._said_s = time.monotonic(), 0.0
            self._all.append((activity, live))
            if activity is not None and not live and (at_once or FIRST_S <= 0):
                self._say(activity)
            if self._printer is None:
                self._printer = threading.Thread(target=self._print, name="progress", daemon=True)
                self._printer.start()
            self._changed.notify()
        try:
            yield
        finally:
            with self._changed:
                self._all.pop()
                if activity is None:
                    self._said_s = time.monotonic()

    def look(self) -> None:
        """Print a line of the innermost activity if nothing was printed for a while, and it is not the last line."""
        activity, first = self.current, self._said_s < self._began_s
        if activity is None or self.live or self._said == (activity, activity.state):
            return
        if time.monotonic() - max(self._said_s, self._began_s) >= (FIRST_S if first else EVERY_S):
            self._say(activity)

    def said(self, activity: Activity) -> None:
        """Record that the state of an activity was printed."""
        self._said, self._said_s = (activity, activity.state), time.monotonic()

    def _say(self, activity: Activity) -> None:
        new = (self._said is None or activity is not self._said[0]) and activity.elapsed_s < EVERY_S
        self.said(activity)
        with suppress(OSError, ValueError):  # nobody reads it any more, which costs the work nothing
            print(printable(activity.title if new else activity.line), file=err.file, flush=True)

    def _print(self) -> None:
        while True:
            with self._changed:
                while self.current is None or self.live:
                    self._changed.wait()
                with suppress(RuntimeError):  # what it describes has just changed
                    self.look()
                self._changed.wait(_LOOKS_S)


_activities = _Activities()
during = _activities.during
_command = "rig"


@contextmanager
def busy(what: str, *, quick: bool = False, total: int = 0) -> Iterator[Activity]:
    """Print a command's activity and progress: in a live line on a terminal, else in lines on standard error.

    `total` pieces are counted; with `quick` or --json, short work prints nothing.
    """
    activity = Activity(what, total)
    with _shown(activity, at_once=not (quick or writes_json())):
        yield activity


@contextmanager
def _shown(activity: Activity, *, at_once: bool) -> Iterator[None]:
    """Show an activity in a live line on a terminal, else print lines."""
    if not err.is_terminal or _activities.live or _activities.silent:
        with _activities.during(activity, at_once=at_once, live=_activities.live):
            yield
        return
    spinner = Spinner("dots", activity.what)

    def drawn() -> Spinner:
        now = _activities.current or activity
        spinner.update(text=now.line if now.elapsed_s >= EVERY_S else now.title)
        return spinner

    live = Live(get_renderable=drawn, console=err, transient=True, refresh_per_second=_REFRESH_PER_S)
    with _activities.during(activity, live=True), live:
        live.refresh()  # which it does by itself for a fixed text only
        yield


@contextmanager
def working() -> Iterator[None]:
    """Print that the command is working whenever it has printed nothing for a while."""
    with _activities.during(Activity(f"{_command}: working …")):
        yield


@contextmanager
def starting(command: str, *, silent: bool = False) -> Iterator[None]:
    """Print that a command starts, if that takes a while; silent: the command never prints progress."""
    global _command
    _command, _activities.silent = command, silent
    with _shown(Activity(f"{command}: starting …"), at_once=False):
        yield


@contextmanager
def resting() -> Iterator[None]:
    """Print no progress while a person acts or a service waits."""
    with _activities.during(None):
        yield


def say_now(what: str) -> None:
    """Change the description of the current activity, and print it unless a live line shows it."""
    if (now := _activities.current) is not None:
        now.say(what)
        _activities.said(now)
    if not _activities.live:
        err.print(what)


class _Builds(logging.Handler):
    """Log handler that prints warnings and shows the builds of the simulator as the current activity."""

    def emit(self, record: logging.LogRecord) -> None:
        now, message = _activities.current, record.getMessage()
        if record.levelno >= logging.WARNING:
            complain(f"warning: {message}")
            return
        if record.levelno >= logging.INFO and err.is_terminal and not _activities.live:
            err.print(message)
        if now is None:
            return
        pieces = (getattr(record, "done", 0), getattr(record, "total", 0))
        if hasattr(record, "made"):
            now.turn_back()
        else:
            now.builds(message, *pieces)


def show_builds() -> None:
    """Print warnings, and show builds of the simulator as progress."""
    for logger in map(logging.getLogger, ("sim", "rig")):
        for handler in logger.handlers[:]:
            logger.removeHandler(handler)
        logger.addHandler(_Builds())
        logger.setLevel(logging.DEBUG)


@contextmanager
def checking_the_script() -> Iterator[Callable[[int], None]]:
    """Yield a function that shows the number of checked steps."""
    with busy("checking the script …", quick=True) as now:
        yield lambda steps: now.say(f"checking the script: {number_of(steps, 'steps')} …")


_screens: list[Live] = []
"""Live screens of running protocols."""


@contextmanager
def a_screen(console: Console, shown: RenderableType) -> Iterator[None]:
    """Show a live screen below all other output."""
    with Live(shown, console=console, transient=True, refresh_per_second=4) as live:
        _screens.append(live)
        try:
            yield
        finally:
            _screens.pop()


@contextmanager
def screen_aside() -> Iterator[None]:
    """Hide the live screens while a person types."""
    shown = list(_screens)
    for live in shown:
        live.stop()
    try:
        with resting():
            yield
    finally:
        for live in shown:
            live.start(refresh=True)


def print_lines(lines: Iterable[tuple[str, object]], width: int) -> None:
    """Print lines behind their topic; a list has several lines on one topic."""
    for about, words in lines:
        for line in words if isinstance(words, list) else [words]:
            out.print(f"{about:<{width}}{line}")


MOST_PRINTED = 100_000
"""Characters of an error that are printed; a damaged file may contain a cell of any length."""


class ExitCode(IntEnum):
    """Exit code of a command."""

    DONE = 0
    STOPPED = 1
    BAD_INPUT = 2
    NO_FINGER = 3
    ABORTED = 130


class _Command:
    """Command under way: where its JSON goes, and whether it has yet to move the stage."""

    def __init__(self, stdout: TextIO | None = None) -> None:
        self.stdout = stdout  # with --json; `sys.stdout` is standard error meanwhile
        self.moves_later = self.aloud = False


_under_way = _Command()


def writes_json() -> bool:
    """Return whether the command under way prints JSON: short work then reports no progress."""
    return _under_way.stdout is not None


def before_motion(*, aloud: bool) -> Callable[[], None]:
    """Report of a failure that nothing was moved, until the returned function is called.

    `aloud` prints that on the screen too, not only in JSON.
    """
    _under_way.moves_later, _under_way.aloud = True, aloud

    def begins() -> None:
        _under_way.moves_later = False

    return begins


def print_json(result: "Output") -> None:
    """Print one JSON object on standard output, of any type of outputs; raise ValueError for NaN."""
    try:
        print(json.dumps(result, allow_nan=False), file=_under_way.stdout or sys.stdout, flush=True)
    except BrokenPipeError:
        out.on_broken_pipe()  # as for tables: the reader has gone, and there is nothing left to print


def complain(message: str) -> str:
    """Print one line on standard error, without the message's line breaks, and return it."""
    line = printable(" ".join(message[:MOST_PRINTED].split())) + " …" * (len(message) > MOST_PRINTED)
    print(f"rig: {line}", file=sys.stderr)
    return line


class NotConfirmedError(RigError):
    """Error of a request that the person did not confirm."""

    default_code = "not_confirmed"


def fail(message: str, code: str, exit_code: ExitCode, *, as_json: bool) -> NoReturn:
    """Print one line on standard error, and JSON on standard output if requested, and exit.

    `code` is for programs; it does not change with the sentence.
    """
    ending = _nothing_moved(message, exit_code) if _under_way.moves_later else None
    if ending is not None and _under_way.aloud and not as_json:
        print(printable(f"{'where':<8}{ending['where_text']}"), file=sys.stderr)
    line = complain(message)
    if as_json:
        with suppress(OSError):  # standard output may be what failed
            failure: FailureJson = {"error_text": line, "code": code, "exit_code": int(exit_code)}
            if ending is not None:
                failure["ending"] = ending
            print_json(failure)
    sys.exit(exit_code)


def _nothing_moved(message: str, exit_code: ExitCode) -> "EndingJson":
    """Return the JSON ending of a run that has not begun."""
    from rig.session.early_ending import Ending  # already imported if the stage can move; help does without

    return Ending.before_it_began(" ".join(message.split()), refused=exit_code is not ExitCode.ABORTED).as_json()


@contextmanager
def one_line_errors(*, as_json: bool) -> Iterator[None]:
    """Turn expected errors into one line and the right exit code, and break long silences.

    With JSON, what a script, or a package that it uses, prints beside the object goes to standard error.
    """
    global _under_way
    before, _under_way = _under_way, _Command(sys.stdout if as_json else None)
    try:
        with working(), redirect_stdout(sys.stderr) if as_json else nullcontext():
            yield
    except KeyboardInterrupt:
        fail("stopped at once by the operator", "interrupted", ExitCode.ABORTED, as_json=as_json)
    except NotConfirmedError as error:
        fail(str(error), error.code, ExitCode.ABORTED, as_json=as_json)
    except Exception as error:
        from rig.cli.error_exit_codes import outcome

        if (found := outcome(error)) is None:
            raise
        fail(*found, as_json=as_json)
    finally:
        _under_way = before


def reporting_errors(command: Callable[..., None]) -> Callable[..., None]:
    """Make a function report its errors in one line, as a command does."""

    @wraps(command)
    def run(*given: Any, **options: Any) -> None:
        with one_line_errors(as_json=options.get("as_json", False)):
            command(*given, **options)

    return run
