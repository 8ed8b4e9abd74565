"""The page that `rig run` and `rig resume` begin with, and the one answer to it."""

import sys
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from rig.cli.interrupts import typed_line
from rig.cli.output import NotConfirmedError, busy, err
from rig.plan.config import Config
from rig.protocol.errors import BadInputError
from rig.session.bench_problems import refuse_bench
from rig.session.calibration import refuse_expired
from rig.session.ending import Ending
from rig.session.page import Page
from rig.session.session import Session
from rig.transport import refuse_missing

Confirm = Callable[[Session], Page]
"""Has a checked session confirmed, nothing having moved; returns its page."""

_YES = ("", "y", "yes")


def nothing_to_confirm(*, as_json: bool) -> Confirm:
    """A dry-run begins at once; how long it will take is known all the same."""

    def rehearse(session: Session) -> Page:
        with busy("rehearsing on springs …", as_json=as_json):
            return Page.of(session)

    return rehearse


def ready_for_a_real_run(command: str, config: Config, out: Path, *, yes: bool) -> None:
    """Refuse what would stop a real run, before anything is planned or a port is opened.

    Raises BadInputError, TransportError, OSError.
    """
    refuse_expired(config)
    refuse_bench(config)
    out.mkdir(parents=True, exist_ok=True)
    for port in (*config.stage.ports, config.force.port):
        refuse_missing(port)
    if not (yes or _somebody_there()):
        raise BadInputError(f"{command}: nobody can be asked here, expected a terminal or --yes")


def at_the_page(
    before: Ending | None, *, yes: bool, asking: Callable[[], AbstractContextManager[None]] = nullcontext
) -> Confirm:
    """Print the page, and wait for the one answer to it; before: how the last run left the indentor.

    asking: is entered while the answer is waited for.

    What it returns raises NotConfirmedError.
    """

    def confirm(session: Session) -> Page:
        page = nothing_to_confirm(as_json=False)(session)
        lines = page.lines if before is None else {"careful": careful(before), **page.lines}
        confirmed_with(lines, yes=yes, asking=asking)
        return page

    return confirm


def confirmed_with(
    lines: Mapping[str, str], *, yes: bool, asking: Callable[[], AbstractContextManager[None]] = nullcontext
) -> None:
    """Print lines by what they are about, and wait for the one answer. Raises NotConfirmedError."""
    for about, words in lines.items():
        err.print(f"{about:<10}{words}")
    if not yes:
        with asking():
            confirmed = _confirmed()
        if not confirmed:
            raise NotConfirmedError("not confirmed: nothing has moved")


def careful(before: Ending) -> str:
    """One line on a run that left the indentor where it may touch."""
    return f"{before.reason}; the indentor was {before.at.words}; {before.next} ({before.resume})"


def _confirmed() -> bool:
    err.print("press Enter to begin, Ctrl-C to leave")
    answer = typed_line()
    return bool(answer) and answer.strip().lower() in _YES


def _somebody_there() -> bool:
    return sys.stdin.isatty() and sys.stderr.isatty()
