"""`rig check`, `rig dry-run`, `rig run` and `rig resume`."""

import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from rig.bench.checks import expired_calibrations, refuse_bench
from rig.bench.real import Request
from rig.bench.virtual import refuse_twinless
from rig.cli.confirm import Confirm, at_the_page, can_answer, careful, ready_for_a_real_run, refuse_mounts, same_shape
from rig.cli.nerve import firing_as_json, print_firing, spike_request
from rig.cli.options import (
    FingerConfigOption,
    FingerFileOption,
    ForceFingerOption,
    JsonOption,
    MoreArgument,
    MountedOption,
    OutOption,
    ProtocolArgument,
    SetOption,
    SubjectOption,
    YesOption,
    option,
)
from rig.cli.output import (
    THE_FINGER,
    before_motion,
    busy,
    checking_the_script,
    complain,
    err,
    out,
    print_json,
    screen_aside,
    writes_json,
)
from rig.cli.recorded_run import warn_of_damage
from rig.cli.request import repeats, takes
from rig.cli.script_execution import RequestedRun, RunOwner, carry_out, leave, make_whole, new_run, owning
from rig.cli.signals import typed_line
from rig.clock import WallClock
from rig.control.owned_stage import OwnedStage
from rig.engine import RunAborted
from rig.errors import BadInputError
from rig.plan.config import Config, load_config, with_finger
from rig.plan.fresh_passes import find_difference
from rig.plan.plan import make_plan
from rig.protocol.script import Script, load_script
from rig.session.rehearsal_summary import (
    PlannedStepJson,
    PossiblePressesJson,
    PreflightJson,
    in_both_units,
    possible_presses_as_json,
    preflight,
    press_speed_in_words,
)
from rig.session.resume import StoppedRun, careful_of, ending_on_record, left_on_record, read_stopped, with_ports
from rig.session.session import FinishedRun, Session, dry_run, real_run
from rig.transport import TransportError
from rig_shared.number_text import read_number
from rig_shared.outputs import Name
from rig_shared.plural import number_of
from sim.contact.shapes import parse_shape, shape_name, with_size
from sim.finger_process import FingerProcess

_COLUMNS = {
    "index": "",
    "indentor": "",
    "x_mm": "x (mm)",
    "doi_mm": "DOI (mm)",
    "force_gwt": "force (gwt)",
    "mean_pressure_kpa": "mean pressure (kPa)",
    "peak_pressure_kpa": "peak (kPa)",
    "overshoot_gwt": "overshoot at a trip (gwt)",
}


@dataclass(frozen=True, kw_only=True)
class ScriptRequest:
    """Arguments and options of the commands that take a script, a configuration and a finger."""

    protocol: ProtocolArgument
    more: MoreArgument = None
    set_: SetOption = None
    config: FingerConfigOption = None
    finger_file: FingerFileOption = None
    force: ForceFingerOption = False

    def script(self) -> Script:
        """Return the script with its parameters. Raises BadInputError."""
        return load_script(self.protocol, [*(self.set_ or []), *(self.more or [])])

    def settings(self) -> Config:
        """Return the configuration with the finger of the finger file. Raises BadInputError."""
        return with_finger(load_config(self.config), self.finger_file, force=self.force)


class CheckJson(PreflightJson):
    """A protocol against the limits."""

    protocol: Name
    repeats: bool


@dataclass(frozen=True, kw_only=True)
class CheckRequest(ScriptRequest):
    """Arguments and options of `rig check`."""

    afferents: Annotated[
        str | None, option("Also print the speed at which simulated afferents fire, e.g. 3xSA1,5xRA.", "LIST")
    ] = None
    as_json: JsonOption = False


@takes(CheckRequest)
def check_command(request: CheckRequest) -> None:
    """Check the script against the limits and the finger model, and rehearse it on springs."""
    settings = request.settings()
    refuse_bench(settings)
    script = request.script()
    spikes = None if request.afferents is None else spike_request(request.afferents, seed=0)
    with busy(THE_FINGER):
        from sim.models.fingertip import Fingertip

        finger = Fingertip.load(settings.finger)
    with checking_the_script() as show_steps:
        plan = make_plan(script, settings, finger, on_step=show_steps)
    with busy("rehearsing the protocol on a spring model …"):
        checked = preflight(script, settings, finger, plan).as_json()
    with busy("repeating the script in fresh processes …", quick=True):
        differs = find_difference(script, settings, plan.steps)
    found: CheckJson = {"protocol": script.name, **checked, "repeats": differs is None}
    if differs is not None:
        complain(
            "the script does not repeat itself, so a stopped run of it cannot be resumed: "
            f"step {differs.number} is {differs.one} in one pass and {differs.other} in another; {differs.remedy}"
        )
    if plan.allowed:
        found["possible"] = possible_presses_as_json(plan, settings)
    speeds = []
    if spikes is not None:
        from rig.plan.nerve import firing_speeds_of, presses_of_plan

        with busy("when the afferents fire …"):
            speeds = firing_speeds_of(finger, spikes, presses_of_plan(plan))
        found["firing"] = firing_as_json(speeds)
    if writes_json():
        print_json(found)
    else:
        _print_check(found)
    if speeds:
        print_firing(speeds)


_MET_COLUMNS = {
    "index": "",
    "indentor": "",
    "x_mm": "x (mm)",
    "doi_mm": "DOI (mm)",
    "doi_band_mm": "9 in 10",
    "force_gwt": "force (gwt)",
    "force_band_gwt": "9 in 10",
}


def _print_check(found: CheckJson) -> None:
    columns = _MET_COLUMNS if "force_band_gwt" in found["steps"][0] else _COLUMNS
    table = Table(*(title or name for name, title in columns.items()), box=None)
    for step in found["steps"]:
        table.add_row(*(_short(step.get(name)) for name in columns))
    out.print(table)
    left = found["margins"]
    indentors = dict.fromkeys(str(step["indentor"]) for step in found["steps"])
    for line in (
        f"indentors: {', '.join(map(with_size, indentors))}",
        f"{number_of(found['indentations'], 'indentations')} and "
        f"{number_of(found['other_presses'], 'other presses')} in {found['duration_s']:.0f} s, with "
        f"{found['contact_s']:.0f} s of contact",
        f"peak {found['peak_force_gwt']:.4g} gwt, {found['peak_pressure_kpa']:.3g} kPa",
        found["small_strain"]["note_text"],
        f"soft trip {in_both_units(found['soft_trip_n'])}, hard trip {in_both_units(found['hard_trip_n'])}",
        f"remaining up to the limits: {left['force_gwt']:.3g} gwt, DOI {left['doi_mm']:.3g} mm, "
        f"{left['mean_pressure_kpa']:.3g} kPa, {left['contact_s']:.0f} s of contact",
        press_speed_in_words(found),
        f"stopping distance {found['stop_distance_mm']:.3g} mm, overshoot at a trip at most "
        f"{found['overshoot_gwt']:.3g} gwt",
        *(_ramp(step) for step in found["steps"] if "ramp_mm_s" in step),
        *([_possible(found["possible"])] if "possible" in found else []),
    ):
        out.print(line)


def _possible(found: PossiblePressesJson) -> str:
    return (
        f"{number_of(found['presses'], 'presses')} may be chosen: peak {found['peak_force_gwt']:.4g} gwt, "
        f"{found['peak_pressure_kpa']:.3g} kPa, soft trip {in_both_units(found['soft_trip_n'])}"
    )


def _ramp(step: PlannedStepJson) -> str:
    return (
        f"{step['index']}: a ramp at {step['ramp_mm_s']:g} mm/s trips at {step['ramp_trip_gwt']:.3g} gwt, is at rest "
        f"within {step['ramp_stop_mm']:.2g} mm, and stays below {step['ramp_bound_gwt']:.3g} gwt; at most "
        f"{step['ramp_fastest_mm_s']:.2g} mm/s"
    )


def _short(value: object) -> str:
    if isinstance(value, tuple):
        low, high = value
        return "target" if math.isclose(low, high, rel_tol=1e-6) else f"{low:.3g}–{high:.3g}"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True, kw_only=True)
class DryRunRequest(ScriptRequest):
    """Arguments and options of `rig dry-run`."""

    out_dir: OutOption = Path("runs")
    speed: Annotated[str, option("Simulated seconds per real second, or max for no limit.", "max|N")] = "max"
    subject: SubjectOption = None
    afferents: Annotated[
        str | None,
        option("Add spikes of simulated afferents, e.g. 3xSA1,5xRA (rig nerve).", "LIST", "Simulated spikes"),
    ] = None
    as_json: JsonOption = False


@takes(DryRunRequest)
def dry_run_command(request: DryRunRequest) -> None:
    """Check the script, run it on the virtual bench, write the run folder and its report."""
    begins = before_motion(aloud=False)
    settings = request.settings()
    refuse_twinless(settings.stage, settings.force)
    for problem in expired_calibrations(settings):
        complain(f"warning: {problem}; `rig run` would refuse this configuration")
    script, faster = request.script(), _times_real(request.speed)
    spikes = None if request.afferents is None else spike_request(request.afferents, seed=0)
    into = new_run(request.out_dir, request.subject)
    run = RequestedRun(script, settings, into, begins, spikes=spikes)
    with owning(run, config_file=request.config) as owner:
        pace = None if faster is None else 1 / faster
        done = carry_out(run, partial(dry_run, speed=faster), owner, pace=pace)
    leave(done)


def _times_real(text: str) -> float | None:
    if text == "max":
        return None
    try:
        value = read_number(text)
    except ValueError:
        value = 0.0
    if not 0 < value < 1e6:
        raise BadInputError(
            f"--speed {text!r}: must be max, or simulated seconds per real second, above 0", "bad_value"
        )
    return value


@dataclass(frozen=True, kw_only=True)
class RunRequest(ScriptRequest):
    """Arguments and options of `rig run`."""

    config: Annotated[Path, option("Configuration of rig and finger.", "TOML")] = field()
    out_dir: OutOption = Path("runs")
    subject: SubjectOption = None
    mounted: MountedOption = None
    yes: YesOption = False
    as_json: JsonOption = False


@takes(RunRequest)
def run_command(request: RunRequest) -> None:
    """Check the script, have the page confirmed, run it, write the run folder and its report."""
    begins = before_motion(aloud=True)
    with ExitStack() as opened:
        settings = request.settings()
        finger = opened.enter_context(FingerProcess(settings.finger))
        script, into = request.script(), new_run(request.out_dir, request.subject)
        run = RequestedRun(script, settings, into, begins, finger)
        ready_for_a_real_run("run", settings, request.out_dir, yes=request.yes)
        _refuse_mounts("run", run, request.mounted)
        stage = opened.enter_context(closing(OwnedStage(settings, WallClock(into.begins_at_s)).open()))
        owner = opened.enter_context(owning(run, stage, request.config))
        before = left_on_record(request.out_dir, settings)
        confirm = at_the_page(owner, before, yes=request.yes)
        done = carry_out(run, on_the_bench(stage, owner, request.mounted), owner, confirm)
    leave(done)


def ask_at_the_bench(request: Request, asking: Callable[[], AbstractContextManager[None]] = nullcontext) -> str:
    """Prompt the person at the bench and return the answer; end the run if there is none."""
    with screen_aside(), asking():
        text = request.text if request.indentor is None else f"mount {with_size(request.indentor)}"
        err.print(f"{text}, then press Enter")
        answer = typed_line(request.meanwhile)
    if not answer:
        raise RunAborted(f"no answer to the request: {request.text}", "nobody_answered")
    return answer


def prompt_for(owner: RunOwner, mounted: str | None) -> Callable[[Request], str]:
    """Return the prompt for the person at the bench, which skips the indentor that is mounted already.

    Raises ShapeError.
    """
    mounted = None if mounted is None else shape_name(mounted)

    def ask(request: Request) -> str:
        if mounted is not None and request.indentor is not None and same_shape(request.indentor, mounted):
            err.print(f"{with_size(request.indentor)} is mounted already (--mounted)")
            return ""
        return ask_at_the_bench(request, owner.asking)

    return ask


def on_the_bench(
    stage: OwnedStage | None, owner: RunOwner, mounted: str | None, speed: float | None = None
) -> Callable[[Session], FinishedRun]:
    """Return how a session is carried out: on a stage that is open, else on the virtual bench. Raises ShapeError."""
    if stage is None:
        return partial(dry_run, speed=speed)
    return partial(real_run, ask=prompt_for(owner, mounted), stage=stage)


def _refuse_mounts(command: str, run: RequestedRun, mounted: str | None) -> None:
    """Raise BadInputError if a non-interactive run mounts an indentor manually, before a port is opened.

    Raises ShapeError.
    """
    if mounted is not None:
        parse_shape(mounted)
    if can_answer():
        return
    finger = run.loaded()
    with checking_the_script() as show_steps:
        plan = make_plan(run.script, run.config, finger, *run.before, show_steps)
    refuse_mounts(command, [*plan.mounts, *(press.indentor for press in plan.allowed)], mounted)


@dataclass(frozen=True)
class ResumeRequest:
    """Arguments and options of `rig resume`."""

    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of the stopped run.")]
    config: Annotated[
        Path | None, option("Take the ports from this file, if a device was plugged into another one.", "TOML")
    ] = None
    mounted: MountedOption = None
    yes: YesOption = False
    as_json: JsonOption = False


@takes(ResumeRequest)
def resume_command(request: ResumeRequest) -> None:
    """Resume with the script, its parameters and the configuration from the run's own copies."""
    begins = before_motion(aloud=True)
    with ExitStack() as opened:
        with busy("reading the run and its script …", quick=True):
            stopped = read_stopped(request.run)
            if stopped.run is not None:
                warn_of_damage(stopped.run)
            if request.config is not None:
                stopped = with_ports(stopped, request.config)
        here = stopped.virtual or stopped.complete
        finger = None if here else opened.enter_context(FingerProcess(stopped.config.finger))
        run = RequestedRun(stopped.script, stopped.config, stopped, begins, finger)
        stage = opened.enter_context(_stage(request, run, stopped))
        owner = opened.enter_context(owning(run, stage))
        if stopped.run is not None and stopped.complete:
            leave(make_whole(stopped, stopped.run, owner))
        confirm = _checked(stopped, owner, yes=request.yes)
        pace = None if stage is None else 1.0
        done = carry_out(run, on_the_bench(stage, owner, request.mounted), owner, confirm, pace)
    leave(done)


@contextmanager
def _stage(request: ResumeRequest, run: RequestedRun, stopped: StoppedRun) -> Iterator[OwnedStage | None]:
    """Open the stage for the remaining steps, or, without any, only for a stop; the finger serves these steps."""
    if stopped.virtual:
        yield None
        return
    with closing(OwnedStage(stopped.config, WallClock(stopped.begins_at_s))) as stage:
        if run.finger is not None:
            try:
                ready_for_a_real_run("resume", stopped.config, request.run.parent, yes=request.yes)
            except TransportError as error:
                if error.code != "no_port":
                    raise
                again = repeats("resume", replace(request, config=Path("TOML")))
                raise TransportError(f"{error}, then name it: {again}", error.code) from None
            _refuse_mounts("resume", run, request.mounted)
            stage.open()
        yield stage


def _checked(stopped: StoppedRun, owner: RunOwner, *, yes: bool) -> Confirm | None:
    """Print the checkpoint at which the run continues, and how it ended."""
    left = None if stopped.run is None else ending_on_record(stopped.run)
    if stopped.run is not None and stopped.run.last_checkpoint is not None:
        err.print(f"resuming after the checkpoint {stopped.run.last_checkpoint!r}")
    if not stopped.virtual:
        before = careful_of(left, stopped.config)
        return at_the_page(owner, before, yes=yes)
    if left is not None:
        complain(careful(left))
    return None
