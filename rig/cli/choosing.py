"""`--choose`: options of an adaptive run, and its preparation."""

import math
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli.output import busy
from rig.cli.request import Needs
from rig.cli.script_execution import RequestedRun
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.plan import Plan
from rig.protocol.script import Script
from rig.session.rehearsal_summary import PossiblePressesJson
from sim.finger_process import Finger

if TYPE_CHECKING:
    from rig.design.adaptive_run import AdaptiveRun
    from rig.design.chooser import Choosing
    from rig.design.designed import Designed

_PANEL = "Adaptive run"
ChooseOption = Annotated[
    str | None,
    typer.Option(
        metavar="COUNTS",
        help="Choose each press by the counts so far: COUNTS.csv, lsl:STREAM, virtual:SA1 or virtual:MEASURE.",
        rich_help_panel=_PANEL,
    ),
]
WITHIN_S = 30.0
CountWithinOption = Annotated[
    float,
    typer.Option(
        metavar="S", help="Longest wait for a count, in s; then the planned presses follow.", rich_help_panel=_PANEL
    ),
]
_MOST_WITHIN_S = 3600.0
WAIT_NEEDS_CHOICE = Needs("--count-within-s", ("--choose",))


def refuse_choose(script: Script, source: str, within_s: float, *, virtual: bool) -> "Designed":
    """Return the design that a script carries. Raises an error for a wrong script or source before computing."""
    from rig.design.counts_from.opened import refuse_source, virtual_name
    from rig.design.designed import Designed

    if not (math.isfinite(within_s) and 0 < within_s <= _MOST_WITHIN_S):
        raise BadInputError(
            f"--count-within-s {within_s:g}: must be more than 0 and at most {_MOST_WITHIN_S:g}",
            "outside_range",
        )
    refuse_source(source)
    if virtual and virtual_name(source) is None:
        raise BadInputError(
            f"--choose {source}: a dry-run has no nerve to record; use virtual:SA1 or virtual:MEASURE", "not_virtual"
        )
    return Designed.of(script)


@contextmanager
def with_choice(run: RequestedRun, source: str | None, within_s: float) -> Iterator[RequestedRun]:
    """Yield the run with the choice of its presses by counts from a source, which is open; the run alone without one.

    Raises DesignError, BadInputError, CountError.
    """
    if source is None:
        yield run
        return
    refuse_choose(run.script, source, within_s, virtual=run.finger is None)
    adaptive = adaptive_run(run, source_of(source), within_s, run.loaded())
    with closing(adaptive):
        with busy("opening the source of the counts …", as_json=run.as_json):
            adaptive.opened()
        yield replace(run, choose=adaptive)


def adaptive_run(run: RequestedRun, source: str, within_s: float, finger: Finger) -> "AdaptiveRun":
    """Return the adaptive run of a designed script, with every press that may be chosen checked.

    Raises DesignError, BadInputError.
    """
    from rig.design.adaptive_run import AdaptiveRun, counted_in, presses_in
    from rig.design.chooser import ChooserProcess, InProcessChooser

    virtual, (before, folder) = run.finger is None, run.before
    designed = refuse_choose(run.script, source, within_s, virtual=virtual)
    prepared = _prepared(designed, run.config, finger, as_json=run.as_json)
    choosing = replace(prepared, source=source, history=counted_in(before), made=presses_in(before))
    approved = _approved(choosing, finger, folder, as_json=run.as_json)
    opener = InProcessChooser if virtual else ChooserProcess
    return AdaptiveRun(run.script, designed, choosing, within_s, opener, before, approved)


def _prepared(designed: "Designed", config: Config, finger: Finger, *, as_json: bool) -> "Choosing":
    """Return what a choice needs, without counts."""
    with busy("preparing the choice …", quick=True):
        from threadpoolctl import threadpool_limits

        from rig.cli.design import ShownProgress
        from rig.design import design
        from rig.design.chooser import Choosing

    with ShownProgress(as_json=as_json) as shown, threadpool_limits(1):
        table, times, _ = design.bench_of(
            designed.request, config, finger, designed.plausible, shown.count, shown.progress
        )
    return Choosing(designed.request, "", config, table, times)


def _approved(choosing: "Choosing", finger: Finger, folder: Path | None, *, as_json: bool) -> Plan:
    """Return the plan of every press that may be chosen."""
    from rig.design.adaptive_run import approved

    choosing.refuse_too_short()
    with busy("checking every press that may be chosen …", as_json=as_json):
        return approved(choosing, finger, folder)


def possible_presses_as_json(script: Script, config: Config, finger: Finger, *, as_json: bool) -> PossiblePressesJson:
    """Return how many presses an adaptive run may choose, their highest force and pressure, and its soft trip."""
    from rig.design.designed import Designed

    choosing = _prepared(Designed.of(script), config, finger, as_json=as_json)
    plan = _approved(choosing, finger, None, as_json=as_json)
    return {
        "presses": len(plan.indentations),
        "peak_force_gwt": plan.peak_force_gwt,
        "peak_pressure_kpa": 1000 * max(press.peak_pressure_mpa for press in plan.indentations),
        "soft_trip_n": min(plan.soft_trip_n, config.limits.soft_trip_n),
    }


def source_of(text: str) -> str:
    """Return the text of --choose as a run records it: a file by its absolute path, so that it resumes anywhere."""
    return str(Path(text).absolute()) if text.endswith(".csv") else text
