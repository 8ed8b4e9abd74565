"""`rig resume`: a run that stopped goes on with the indentations that are missing."""

from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from rig.cli.carrying_out import carry_out, leave, make_whole
from rig.cli.confirming import Confirm, at_the_page, careful, ready_for_a_real_run
from rig.cli.options import JsonOption, YesOption
from rig.cli.output import Beginning, complain, err, told_in_one_line
from rig.cli.run import ask_at_the_bench
from rig.cli.run_owner import Owner, owning
from rig.session.control.stage_in_hand import StageInHand
from rig.session.resume import StoppedRun, careful_of, ending_on_record, read_stopped
from rig.session.session import dry_run, real_run
from rig.transport.clock import WallClock
from sim.finger_process import FingerProcess


def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The run's folder.")],
    yes: YesOption = False,
    as_json: JsonOption = False,
) -> None:
    """Take the script, its parameters and the configuration from the run's own copies, and go on."""
    beginning = Beginning(aloud=True)
    with told_in_one_line(as_json=as_json, beginning=beginning):
        stopped = read_stopped(run)
        with (
            _stage(stopped, run, yes=yes) as stage,
            owning(stopped.script, stopped.config, stopped, stage) as owner,
        ):
            if stopped.run is not None and stopped.complete:
                leave(make_whole(stopped, stopped.run, owner, as_json=as_json))
            with nullcontext() if stage is None else FingerProcess(stopped.config.finger) as finger:
                confirm = _checked(stopped, owner, yes=yes)
                done = carry_out(
                    stopped.script,
                    stopped.config,
                    stopped,
                    dry_run
                    if stage is None
                    else partial(real_run, ask=partial(ask_at_the_bench, asking=owner.asking), stage=stage),
                    owner,
                    as_json=as_json,
                    finger=finger,
                    confirm=confirm,
                    pace=None if stage is None else 1.0,
                    begins=beginning.begins,
                )
    leave(done)


@contextmanager
def _stage(stopped: StoppedRun, run: Path, *, yes: bool) -> Iterator[StageInHand | None]:
    """Of what is left to do on real ports, open; where nothing is left it is opened for a stop alone."""
    if stopped.virtual:
        yield None
        return
    with closing(StageInHand(stopped.config, WallClock(stopped.begins_at_s))) as stage:
        if not stopped.complete:
            ready_for_a_real_run("resume", stopped.config, run.parent, yes=yes)
            stage.open()
        yield stage


def _checked(stopped: StoppedRun, owner: Owner, *, yes: bool) -> Confirm | None:
    """Where it goes on, and how it was left."""
    left = None if stopped.run is None else ending_on_record(stopped.run)
    if stopped.run is not None and stopped.run.last_checkpoint is not None:
        err.print(f"goes on after the checkpoint {stopped.run.last_checkpoint!r}")
    if not stopped.virtual:
        before = careful_of(left, stopped.config)
        return at_the_page(before, yes=yes, asking=owner.asking, button=owner.button)
    if left is not None:
        complain(careful(left))
    return None
