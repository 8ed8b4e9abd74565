"""`rig resume`: a run that stopped goes on with the indentations that are missing."""

from pathlib import Path
from typing import Annotated

import typer

from rig.cli.carrying_out import carry_out, leave, make_whole
from rig.cli.confirming import Confirm, at_the_page, careful, ready_for_a_real_run
from rig.cli.options import JsonOption, YesOption
from rig.cli.output import Beginning, complain, err, told_in_one_line
from rig.cli.run import ask_at_the_bench
from rig.session.resume import ending_on_record, read_stopped
from rig.session.session import FinishedRun, Session, dry_run, real_run


def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The run's folder.")],
    yes: YesOption = False,
    as_json: JsonOption = False,
) -> None:
    """Take the script, its parameters and the configuration from the run's own copies, and go on."""
    beginning = Beginning(aloud=True)
    with told_in_one_line(as_json=as_json, beginning=beginning):
        stopped = read_stopped(run)
        if stopped.run is not None and stopped.complete:
            leave(make_whole(stopped, stopped.run, as_json=as_json))
        left = None if stopped.run is None else ending_on_record(stopped.run)
        if stopped.run is not None and stopped.run.last_checkpoint is not None:
            err.print(f"goes on after the checkpoint {stopped.run.last_checkpoint!r}")
        confirm: Confirm | None = None
        if not stopped.virtual:
            ready_for_a_real_run("resume", stopped.config, run.parent, yes=yes)
            confirm = at_the_page(left, yes=yes)
        elif left is not None:
            complain(careful(left))

        def go_on(session: Session) -> FinishedRun:
            return dry_run(session) if stopped.virtual else real_run(session, ask_at_the_bench)

        done = carry_out(
            stopped.script,
            stopped.config,
            run.parent,
            go_on,
            as_json=as_json,
            stopped=stopped,
            confirm=confirm,
            pace=None if stopped.virtual else 1.0,
            begins=beginning.begins,
        )
    leave(done)
