"""`rig take-orders`: a run whose presses another program orders, for `rig.bluesky`."""

import os
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from rig.bench.virtual import refuse_twinless
from rig.cli.confirm import at_the_page, ready_for_a_real_run, refuse_mounts
from rig.cli.options import FingerFileOption, MountedOption, OutOption, SubjectOption, YesOption, numbers
from rig.cli.output import Beginning, one_line_errors
from rig.cli.run import prompt_for
from rig.cli.script_execution import RunOwner, carry_out, leave, new_run, owning
from rig.clock import WallClock
from rig.control.stop import OwnedStage
from rig.plan.config import Config, load_config, with_finger
from rig.plan.plan import Plan
from rig.session.orders import PressOrders, scope_of
from rig.session.resume import left_on_record
from rig.session.session import FinishedRun, NewRun, Session, dry_run, real_run
from sim.finger_process import FingerProcess


def take_orders_command(
    indentor: Annotated[str, typer.Option(metavar="SHAPE", help="Indentor of all presses.")],
    x_mm: Annotated[str, typer.Option(metavar="X,X…", help="Positions of the presses, in mm.")] = "0",
    doi_mm: Annotated[
        float | None, typer.Option(metavar="D", help="Deepest press, in mm. Give this or --force-gwt.")
    ] = None,
    force_gwt: Annotated[
        float | None, typer.Option(metavar="F", help="Highest force of a press, in gwt. Give this or --doi-mm.")
    ] = None,
    presses: Annotated[int, typer.Option(metavar="N", help="Maximum number of presses.")] = 1,
    increments: Annotated[int, typer.Option(metavar="N", help="Maximum number of increments.")] = 1,
    hold_s: Annotated[float, typer.Option(metavar="S", help="Longest hold, in s.")] = 1.0,
    config: Annotated[Path | None, typer.Option(metavar="TOML", help="Configuration of rig and finger.")] = None,
    virtual: Annotated[bool, typer.Option("--virtual", help="Press on the virtual bench.")] = False,
    speed: Annotated[
        float | None, typer.Option(metavar="N", help="Simulated seconds per real second. Default: no limit.")
    ] = None,
    finger_file: FingerFileOption = None,
    out_dir: OutOption = Path("runs"),
    subject: SubjectOption = None,
    mounted: MountedOption = None,
    yes: YesOption = False,
) -> None:
    """Have the highest press confirmed, then press as another program orders; print the result as JSON."""
    beginning = Beginning(aloud=False)
    parent = os.getppid()
    with one_line_errors(as_json=True, beginning=beginning):
        settings = with_finger(load_config(config), finger_file)
        targets = {"doi_mm": doi_mm, "force_gwt": force_gwt, "presses": presses, "increments": increments}
        scope = scope_of({"indentor": indentor, "x_mm": numbers("--x-mm", x_mm), "hold_s": hold_s, **targets})
        orders = PressOrders(scope, lambda: os.getppid() != parent)
        into = new_run(out_dir, subject)
        if virtual:
            refuse_twinless(settings.stage, settings.force)
            with owning(orders.as_script(), settings, into, None, config, orders.answers) as owner:
                done = _carried_out(orders, settings, into, partial(dry_run, speed=speed), owner, beginning)
        else:
            ready_for_a_real_run("take-orders", settings, out_dir, yes=yes)
            refuse_mounts("take-orders", [scope.indentor], mounted)
            with (
                FingerProcess(settings.finger) as finger,
                closing(OwnedStage(settings, WallClock(into.begins_at_s)).open()) as stage,
                owning(orders.as_script(), settings, into, stage, config, orders.answers) as owner,
            ):
                before = left_on_record(out_dir, settings)
                confirm = at_the_page(before, yes=yes, asking=owner.asking, button=owner.button)
                how = partial(real_run, ask=prompt_for(owner, mounted), stage=stage)
                done = _carried_out(orders, settings, into, how, owner, beginning, finger=finger, confirm=confirm)
    leave(done)


def _carried_out(
    orders: PressOrders,
    settings: Config,
    into: NewRun,
    how: Callable[[Session], FinishedRun],
    owner: RunOwner,
    beginning: Beginning,
    **more: Any,
) -> FinishedRun:
    orders.end = owner.pause.end

    def ordered(session: Session) -> FinishedRun:
        """Carry out the orders, of which there may be fewer than planned, with the soft trip of the plan."""
        plan = Plan(
            predictions=session.plan.predictions,
            first_soft_trip_n=session.plan.soft_trip_n,
            shape_files=session.plan.shape_files,
        )
        return how(replace(session, plan=plan, handler=orders.handler))

    script, begins = orders.as_script(), beginning.begins
    return carry_out(script, settings, into, ordered, owner, as_json=True, begins=begins, pace=None, **more)
