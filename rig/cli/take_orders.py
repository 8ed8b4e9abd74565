"""`rig take-orders`: a run whose presses another program orders, for `rig.bluesky`."""

import os
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

from rig.bench.virtual import refuse_twinless
from rig.cli.confirm import at_the_page, ready_for_a_real_run, refuse_mounts
from rig.cli.options import FingerFileOption, MountedOption, OutOption, SubjectOption, YesOption, numbers, option
from rig.cli.output import before_motion
from rig.cli.request import takes
from rig.cli.run import on_the_bench
from rig.cli.script_execution import RequestedRun, carry_out, leave, new_run, owning
from rig.clock import WallClock
from rig.control.owned_stage import OwnedStage
from rig.plan.config import load_config, with_finger
from rig.plan.plan import Plan
from rig.session.orders import OrderScope, PressOrders, scope_of
from rig.session.resume import left_on_record
from rig.session.session import FinishedRun, Session
from sim.finger_process import FingerProcess


@dataclass(frozen=True)
class TakeOrdersRequest:
    """Options of `rig take-orders`."""

    indentor: Annotated[str, option("Indentor of all presses.", "SHAPE")]
    x_mm: Annotated[str, option("Positions of the presses, in mm.", "X,X…")] = "0"
    doi_mm: Annotated[float | None, option("Deepest press, in mm. Give this or --force-gwt.", "D")] = None
    force_gwt: Annotated[float | None, option("Highest force of a press, in gwt. Give this or --doi-mm.", "F")] = None
    presses: Annotated[int, option("Maximum number of presses.", "N")] = 1
    increments: Annotated[int, option("Maximum number of increments.", "N")] = 1
    hold_s: Annotated[float, option("Longest hold, in s.", "S")] = 1.0
    config: Annotated[Path | None, option("Configuration of rig and finger.", "TOML")] = None
    virtual: Annotated[bool, option("Press on the virtual bench.", name="--virtual")] = False
    speed: Annotated[float | None, option("Simulated seconds per real second. Default: no limit.", "N")] = None
    finger_file: FingerFileOption = None
    out_dir: OutOption = Path("runs")
    subject: SubjectOption = None
    mounted: MountedOption = None
    yes: YesOption = False

    as_json: ClassVar[bool] = True

    def scope(self) -> OrderScope:
        """Return the limits of the orders. Raises BadInputError."""
        names = ("indentor", "doi_mm", "force_gwt", "presses", "increments", "hold_s")
        return scope_of({name: getattr(self, name) for name in names} | {"x_mm": numbers("--x-mm", self.x_mm)})


@takes(TakeOrdersRequest)
def take_orders_command(request: TakeOrdersRequest) -> None:
    """Have the highest press confirmed, then press as another program orders; print the result as JSON."""
    begins = before_motion(aloud=False)
    parent = os.getppid()
    with ExitStack() as opened:
        settings = with_finger(load_config(request.config), request.finger_file)
        orders = PressOrders(request.scope(), lambda: os.getppid() != parent)
        into = new_run(request.out_dir, request.subject)
        run, stage = RequestedRun(orders.as_script(), settings, into, begins), None
        if request.virtual:
            refuse_twinless(settings.stage, settings.force)
        else:
            ready_for_a_real_run("take-orders", settings, request.out_dir, yes=request.yes)
            refuse_mounts("take-orders", [orders.scope.indentor], request.mounted)
            run = replace(run, finger=opened.enter_context(FingerProcess(settings.finger)))
            stage = opened.enter_context(closing(OwnedStage(settings, WallClock(into.begins_at_s)).open()))
        owner = opened.enter_context(owning(run, stage, request.config, orders.answers))
        orders.end = owner.pause.end
        how = on_the_bench(stage, owner, request.mounted, request.speed)
        confirm = None
        if stage is not None:
            before = left_on_record(request.out_dir, settings)
            confirm = at_the_page(owner, before, yes=request.yes)

        def ordered(session: Session) -> FinishedRun:
            """Carry out the orders, of which there may be fewer than planned, with the soft trip of the plan."""
            plan = Plan(
                predictions=session.plan.predictions,
                first_soft_trip_n=session.plan.soft_trip_n,
                shape_files=session.plan.shape_files,
            )
            return how(replace(session, plan=plan))

        done = carry_out(run, ordered, owner, confirm, pace=None)
    leave(done)
