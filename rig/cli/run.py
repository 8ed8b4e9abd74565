"""`rig run`: a protocol on real ports."""

from collections.abc import Callable
from contextlib import AbstractContextManager, closing, nullcontext
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from rig.cli.interrupts import typed_line
from rig.cli.options import (
    JsonOption,
    MetFingerOption,
    MoreArgument,
    OutOption,
    ProtocolArgument,
    SetOption,
    SubjectOption,
    YesOption,
)
from rig.cli.output import Beginning, err, screen_aside, told_in_one_line
from rig.engine import RunAborted
from rig.plan.config import load_config, with_finger
from rig.protocol.script import load_script
from sim.finger_process import FingerProcess


def command(
    protocol: ProtocolArgument,
    config: Annotated[Path, typer.Option(metavar="TOML", help="Configuration of rig and finger.")],
    more: MoreArgument = None,
    set_: SetOption = None,
    finger_file: MetFingerOption = None,
    out_dir: OutOption = Path("runs"),
    subject: SubjectOption = None,
    yes: YesOption = False,
    as_json: JsonOption = False,
) -> None:
    """Check the script, have the page confirmed, carry it out, write the run folder and its report."""
    beginning = Beginning(aloud=True)
    with told_in_one_line(as_json=as_json, beginning=beginning):
        settings = with_finger(load_config(config), finger_file)
        with FingerProcess(settings.finger) as finger:
            # Its process reads the model while this one reads what follows.
            from rig.cli.carrying_out import carry_out, leave, new_run
            from rig.cli.confirming import at_the_page, ready_for_a_real_run
            from rig.cli.run_owner import owning
            from rig.session.control.stage_in_hand import StageInHand
            from rig.session.resume import left_on_record
            from rig.session.session import real_run
            from rig.transport.clock import WallClock

            script = load_script(protocol, [*(set_ or []), *(more or [])])
            into = new_run(out_dir, subject)
            ready_for_a_real_run("run", settings, out_dir, yes=yes)
            clock = WallClock(into.begins_at_s)
            with (
                closing(StageInHand(settings, clock).open()) as stage,
                owning(script, settings, into, stage, config) as owner,
            ):
                done = carry_out(
                    script,
                    settings,
                    into,
                    partial(real_run, ask=partial(ask_at_the_bench, asking=owner.asking), stage=stage),
                    owner,
                    as_json=as_json,
                    finger=finger,
                    confirm=at_the_page(
                        left_on_record(out_dir, settings), yes=yes, asking=owner.asking, button=owner.button
                    ),
                    begins=beginning.begins,
                )
    leave(done)


def ask_at_the_bench(request: str, asking: Callable[[], AbstractContextManager[None]] = nullcontext) -> str:
    """Ask the person at the bench and return the line that answers; no answer at all ends the run."""
    with screen_aside(), asking():
        err.print(f"{request}, then press Enter")
        answer = typed_line()
    if not answer:
        raise RunAborted("nobody answered: {request}", code="nobody_answered", request=request)
    return answer
