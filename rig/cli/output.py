"""Standard output, standard error, and how a command ends."""

import json
import logging
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from enum import IntEnum
from typing import Any, NoReturn

from rich.console import Console, RenderableType
from rich.live import Live
from rich.spinner import Spinner

from rig.errors import RigError

err = Console(stderr=True, highlight=False, soft_wrap=True, markup=False)
out = Console(highlight=False, soft_wrap=True, markup=False)

_spinners: list[Callable[[str], None]] = []
"""Active spinners; each takes its new text."""

THE_FINGER = "fingertip: loading from the cache, or building in about 15 s …"


@contextmanager
def looking_busy(what: str) -> Iterator[None]:
    """Show an activity with a spinner on a terminal; nothing in a pipe."""
    if not err.is_terminal:
        yield
        return
    with Live(Spinner("dots", what), console=err, transient=True) as live:
        _spinners.append(lambda now: live.update(Spinner("dots", now)))
        try:
            yield
        finally:
            _spinners.pop()


def say_now(what: str) -> None:
    """Update the active spinner, or print a line without one."""
    if _spinners:
        _spinners[-1](what)
    else:
        err.print(what)


class _Builds(logging.Handler):
    """Log handler that prints warnings, and shows the progress of a build in the spinner or as lines."""

    def emit(self, record: logging.LogRecord) -> None:
        if record.levelno >= logging.WARNING:
            complain(f"warning: {record.getMessage()}")
        elif _spinners:
            _spinners[-1](record.getMessage())
        elif record.levelno >= logging.INFO:
            err.print(record.getMessage())


def show_builds() -> None:
    """Print warnings of the simulator, and on a terminal the progress of a model that is built."""
    logger = logging.getLogger("sim")
    for handler in [handler for handler in logger.handlers if isinstance(handler, _Builds)]:
        logger.removeHandler(handler)
    logger.addHandler(_Builds())
    if err.is_terminal:
        logger.setLevel(logging.DEBUG)


def loading_the_finger() -> AbstractContextManager[None]:
    """Show a spinner while the finger is loaded; nothing in a pipe."""
    return looking_busy(THE_FINGER)


def busy(what: str, *, as_json: bool) -> AbstractContextManager[None]:
    """Show an activity like `looking_busy`, and print one line in a pipe.

    With JSON output nothing is printed.
    """
    if not (err.is_terminal or as_json):
        err.print(what)
    return looking_busy(what)


@contextmanager
def checking_the_script() -> Iterator[Callable[[int], None]]:
    """Yield a function that shows the number of checked steps on a terminal."""
    if not err.is_terminal:
        yield lambda steps: None
        return
    with err.status("checking the script …", refresh_per_second=2) as status:
        _spinners.append(status.update)
        try:
            yield lambda steps: status.update(f"checking the script: {steps} steps so far …")
        finally:
            _spinners.pop()


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
        yield
    finally:
        for live in shown:
            live.start(refresh=True)


class ExitCode(IntEnum):
    """Exit code of a command."""

    DONE = 0
    STOPPED = 1
    BAD_INPUT = 2
    NO_FINGER = 3
    ABORTED = 130


def print_json(result: Mapping[str, Any]) -> None:
    """Print one JSON object on standard output; raise ValueError for NaN."""
    try:
        print(json.dumps(result, allow_nan=False), flush=True)
    except BrokenPipeError:
        out.on_broken_pipe()  # as for tables: the reader has gone, and there is nothing left to print


def complain(message: str) -> str:
    """Print one line on standard error, without the message's line breaks, and return it."""
    line = " ".join(message.split())
    print(f"rig: {line}", file=sys.stderr)
    return line


def renamed(old: str, new: str) -> None:
    """Print one line on standard error: an old name works for one release."""
    complain(f"warning: {old} is now {new}; the old name works for one release")


class NotConfirmedError(RigError):
    """The person did not confirm."""

    default_code = "not_confirmed"


class Beginning:
    """State of a command that runs a script; until it begins, a failure reports that nothing was moved.

    `aloud` prints that on the screen too, not only in JSON.
    """

    def __init__(self, *, aloud: bool) -> None:
        self.aloud, self.begun = aloud, False

    def begins(self) -> None:
        """Record that the command may move the stage from now on."""
        self.begun = True


def fail(
    message: str, code: str, exit_code: ExitCode, *, as_json: bool, beginning: Beginning | None = None
) -> NoReturn:
    """Print one line on standard error, and JSON on standard output if requested, and exit.

    `code` is for programs; it does not change with the sentence.
    """
    ending = {} if beginning is None or beginning.begun else {"ending": _nothing_moved(message, exit_code)}
    if beginning is not None and ending and beginning.aloud and not as_json:
        print(f"{'where':<8}{ending['ending']['where_text']}", file=sys.stderr)
    line = complain(message)
    if as_json:
        with suppress(OSError):  # standard output may be what failed
            print_json({"error_text": line, "code": code, "exit_code": int(exit_code), **ending})
    sys.exit(exit_code)


def _nothing_moved(message: str, exit_code: ExitCode) -> dict[str, Any]:
    """Return the JSON ending of a run that has not begun."""
    from rig.session.early_ending import Ending  # already imported if the stage can move; help does without

    return Ending.before_it_began(" ".join(message.split()), refused=exit_code is not ExitCode.ABORTED).as_json()


@contextmanager
def one_line_errors(*, as_json: bool, beginning: Beginning | None = None) -> Iterator[None]:
    """Turn expected errors into one line and the right exit code."""
    try:
        yield
    except KeyboardInterrupt:
        line = "stopped at once by the operator"
        fail(line, "interrupted", ExitCode.ABORTED, as_json=as_json, beginning=beginning)
    except NotConfirmedError as error:
        fail(str(error), error.code, ExitCode.ABORTED, as_json=as_json, beginning=beginning)
    except Exception as error:
        from rig.cli.error_exit_codes import outcome

        if (found := outcome(error)) is None:
            raise
        fail(*found, as_json=as_json, beginning=beginning)
