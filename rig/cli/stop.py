"""`rig stop`: stop the stage now, whatever program moves it; imports only what a stop needs."""

import sys
from typing import Annotated, NoReturn, NotRequired

import typer

from rig.cli.options import ConfigOption, JsonOption
from rig.cli.output import ExitCode, complain, out, print_json
from rig.cli.signals import ENDING_SIGNALS
from rig.control.stage_alone import NoStageError, stage_alone
from rig.control.stop import OutsideStop, SentStop
from rig.printable import printable
from rig_shared.outputs import Code, Keywords, Name, Output, Port


class StoppedJson(Output):
    """A stop that was sent. state: as the controller names it; null where it has not answered."""

    stopped: list[Port]
    owner: int | None
    sent: bool
    state: Name | None


class NotStoppedJson(Output):
    """A stop that was not sent, or not confirmed."""

    error_text: str
    code: Code
    exit_code: Annotated[int, Keywords(enum=[1, 2])]
    owner: NotRequired[int | None]
    sent: bool
    state: NotRequired[Name | None]


def stop_command(config: ConfigOption, as_json: JsonOption = False) -> None:
    """Request a stop from the owner of the stage's port, and send the stop to the port."""
    try:
        settings, passed = stage_alone(config)
    except NoStageError as error:
        words = f"Stop NOT sent: {error}"
        nothing_sent: NotStoppedJson = {
            "error_text": words, "code": error.code, "exit_code": int(ExitCode.BAD_INPUT), "sent": False,
        }  # fmt: skip
        _fail(nothing_sent, as_json=as_json)
    stopping = OutsideStop(settings, ENDING_SIGNALS)
    found = stopping.send()
    named = None if found.owner is None else found.owner.pid  # Windows does not name it.
    owner = next(iter(found.notified), None) if named is None else named
    if not found.done:
        code = "not_confirmed" if found.sent else "not_sent"
        _fail(
            {
                "error_text": found.words,
                "code": code,
                "exit_code": int(ExitCode.STOPPED),
                "owner": owner,
                "sent": found.sent,
                "state": found.state,
            },
            as_json=as_json,
        )
    if as_json:
        stopped: StoppedJson = {
            "stopped": list(found.ports), "owner": owner, "sent": found.sent, "state": found.state,
        }  # fmt: skip
        print_json(stopped)
    else:
        out.print(found.words)
    sys.stdout.flush()
    ended = stopping.end_holder()  # The result comes first: an operator waits for it.
    for line in dict.fromkeys([*_still_there(found), *([] if ended is None else [ended]), *passed]):
        complain(line)


def _fail(failure: NotStoppedJson, *, as_json: bool) -> NoReturn:
    print(printable(failure["error_text"]), file=sys.stderr)
    if as_json:
        print_json(failure)
    raise typer.Exit(failure["exit_code"])


def _still_there(found: SentStop) -> list[str]:
    """Return the problems of the owner that remain although the stage was stopped."""
    return [] if found.confirmed_by is not None else found.problems
