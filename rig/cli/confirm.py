"""The confirmation page of `rig run` and `rig resume`, and the answer to it."""

import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol

from rig.bench.checks import refuse_bench, refuse_expired
from rig.cli.keyboard import text_waits
from rig.cli.output import NotConfirmedError, busy, err, writes_json
from rig.cli.signals import typed_line
from rig.clock import WallClock
from rig.data.folder import refuse_full_disk
from rig.devices.registry import bench_ports
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.session.early_ending import Ending
from rig.session.hardware_stop import StopButton
from rig.session.rehearsal_summary import Page
from rig.session.rehearse import Rehearsed
from rig.session.session import NewRun, Session
from rig.transport import refuse_missing
from sim.contact.shapes import shape_name

Confirm = Callable[[Session], Page]
"""Asks for the confirmation of a checked session before anything moves, and returns the confirmation page."""

_BUTTON_S = 60.0
PRESS_IT = "press the participant's stop button and hold it"
RELEASE_IT = "release the stop button"
_YES = ("", "y", "yes")


def nothing_to_confirm() -> Confirm:
    """Return a confirmation for a dry run, which starts at once but still predicts duration and press speed."""

    def rehearse(session: Session) -> Page:
        page = _rehearsed(session)
        if not writes_json():
            _print(page.speed)
        return page

    return rehearse


def _rehearsed(session: Session) -> Page:
    with busy("rehearsing the protocol on a spring model …"):
        page = Page.of(session)
    into = session.into
    if isinstance(page.rehearsal, Rehearsed):
        refuse_full_disk(into.out if isinstance(into, NewRun) else into.folder.path, page.rehearsal.events)
    return page


def ready_for_a_real_run(command: str, config: Config, out: Path, *, yes: bool) -> None:
    """Check the conditions of a real run before planning and before opening a port.

    Raises BadInputError, TransportError, OSError.
    """
    refuse_expired(config)
    refuse_bench(config)
    out.mkdir(parents=True, exist_ok=True)
    for port in bench_ports(config):
        refuse_missing(port)
    if not (yes or _is_interactive()):
        raise BadInputError(
            f"{command}: cannot ask for confirmation without a terminal; use one, or add --yes to start at once",
            "no_terminal",
        )


def refuse_mounts(command: str, indentors: Iterable[str], mounted: str | None) -> None:
    """Raise BadInputError if a mount needs a person and the session is non-interactive."""
    if can_answer():
        return
    by_hand = [one for one in dict.fromkeys(indentors) if mounted is None or not same_shape(one, mounted)]
    if by_hand:
        raise BadInputError(
            f"{command}: {', '.join(by_hand)} must be mounted by hand, but the session is not interactive; run it "
            "in a terminal, or mount the indentor first and name it with --mounted",
            "mount_by_hand",
        )


def same_shape(one: str, other: str) -> bool:
    """Return whether two names mean the same indentor. Raises ShapeError."""
    return shape_name(one) == shape_name(other)


def can_answer() -> bool:
    """Return whether requests can be answered: by a person at a terminal, or by text waiting on standard input."""
    return _is_interactive() or _text_waits()


class ConfirmingOwner(Protocol):
    """Owner of a run as a confirmation uses it: the participant's button, and the mark of a time of questions."""

    button: StopButton | None

    def asking(self) -> AbstractContextManager[None]: ...


def at_the_page(owner: ConfirmingOwner, before: str | None, *, yes: bool) -> Confirm:
    """Return a function that prints the confirmation page and waits for the answer.

    `before` describes a run that needs caution. The result raises NotConfirmedError.
    """

    def confirm(session: Session) -> Page:
        page = _rehearsed(session)
        confirmed_with(owner, page.lines if before is None else {"careful": before, **page.lines}, yes=yes)
        return page

    return confirm


def confirmed_with(owner: ConfirmingOwner, lines: Mapping[str, str], *, yes: bool) -> None:
    """Print lines by topic, wait for the answer, then test the participant's stop button.

    Raises NotConfirmedError, BadInputError, StageError, TransportError.
    """
    button = owner.button
    _print(lines if button is None else {**lines, "stop": button.words})
    if not yes:
        with owner.asking():
            confirmed = _confirmed()
        if not confirmed:
            raise NotConfirmedError("not confirmed; nothing has moved")
    if button is None:
        return
    if button.there:
        if not yes:
            with owner.asking():
                _seen(button, PRESS_IT, pressed=True)
                _seen(button, RELEASE_IT, pressed=False)
            button.tested = True
        elif button.pressed():
            raise BadInputError(
                "stop: the participant's stop button is pressed; release it and start again; nothing has moved",
                "button_pressed",
            )
        err.print(f"{'stop':<10}{button.state}")
    button.arm()


def _print(lines: Mapping[str, str]) -> None:
    for about, words in lines.items():
        err.print(f"{about:<10}{words}")


def _seen(button: StopButton, request: str, *, pressed: bool) -> None:
    err.print(request)
    clock = WallClock()
    if not clock.wait_until(lambda: button.pressed() is pressed, clock.monotonic_s() + _BUTTON_S):
        raise NotConfirmedError(
            f"no response within {_BUTTON_S:g} s to the request: {request}; nothing has moved; check the button "
            "and start again",
            "button_not_seen",
        )


def careful(before: Ending) -> str:
    """Return a warning about a run that left the indentor where it may touch."""
    return f"{before.reason}; the indentor was {before.at.words}; {before.next} ({before.resume})"


def _confirmed() -> bool:
    err.print("press Enter to start, Ctrl-C to cancel")
    answer = typed_line()
    return bool(answer) and answer.strip().lower() in _YES


def _text_waits() -> bool:
    """Return whether a pipe or a file has text to read; True if unknown."""
    if sys.stdin is None:
        return False
    try:
        return text_waits(sys.stdin.fileno())
    except ValueError:  # not a file
        return True
    except OSError:  # a device that never has text
        return False


def _is_interactive() -> bool:
    return sys.stdin.isatty() and sys.stderr.isatty()
