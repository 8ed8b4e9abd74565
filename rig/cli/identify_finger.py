"""`rig identify` and `rig find`: identify the finger, and locate it."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn, NotRequired, TypeVar

import typer

from rig.bench.virtual import refuse_twinless
from rig.cli.confirm import confirmed_with, ready_for_a_real_run, refuse_mounts
from rig.cli.options import (
    FingerConfigOption,
    JsonOption,
    MoreArgument,
    MountedOption,
    OutOption,
    SubjectOption,
    YesOption,
    bounded,
    checked_file,
    option,
)
from rig.cli.output import (
    THE_FINGER,
    ExitCode,
    before_motion,
    busy,
    complain,
    err,
    out,
    print_json,
    print_lines,
    reporting_errors,
    writes_json,
)
from rig.cli.progress import counted, progress
from rig.cli.recorded_run import recorded_run
from rig.cli.request import takes
from rig.cli.run import on_the_bench
from rig.cli.script_execution import (
    AtTheTerminal,
    RequestedRun,
    RunOwner,
    code_of_end,
    leave,
    loaded,
    new_run,
    owning,
)
from rig.cli.signals import at_a_safe_point, at_once
from rig.clock import WallClock
from rig.control.owned_stage import OwnedStage
from rig.data import RunError, RunFolder
from rig.data.ending import EndingJson
from rig.data.folder import IDENTIFICATION_PAGE, replace_text
from rig.data.run import RunWarningJson, warnings_as_json
from rig.devices.registry import stage_ports
from rig.errors import BadInputError
from rig.identify.adaptive_presses import (
    BEYOND_DEPTH,
    DEPTHS_MM,
    PLACES_MM,
    SHAPES,
    Identification,
    IdentificationOptions,
    PressReport,
    with_reliable_touch,
)
from rig.identify.expected_duration import ExpectedDuration, expected_duration
from rig.identify.finger_from_presses import finger_file
from rig.identify.frame import FingerFrameJson, find, frame_as_json
from rig.identify.identification_script import IdentificationScript, as_script
from rig.plan.config import Config, load_config
from rig.plan.plan import Plan, make_plan
from rig.protocol.api import Rig
from rig.protocol.script import Script, load_script
from rig.report.identification_page import ForceBand, IdentificationPage, write_identification_page
from rig.report.page_source import source_line
from rig.report.style import signed
from rig.session.session import FinishedRun, Session
from rig.study.parallel import spread
from rig.units import GWT_N, unit_of_key
from rig_shared.outputs import Code, File, Output, Ratio, Shape, Toml, Unit
from rig_shared.plural import number_of
from sim.contact.shapes import parse_shape, with_size
from sim.finger_process import Finger, FingerProcess
from sim.identification.next_press import PressAt
from sim.identification.posterior import parameter_bands
from sim.identification.predicted_forces import PredictedForces
from sim.identification.prior import KINDS, REAL_KINDS, ParameterName, Prior
from sim.identification.uncertainty_bands import Width
from sim.models.fingertip import Fingertip

USUAL_GOALS = (
    *(PressAt("bar:3.0", x_mm, 0.67) for x_mm in (-1.0, 0.0, 1.0)),
    PressAt("cylinder:9", 0.0, 0.67),
    PressAt("sphere:6", 0.0, 0.5),
)

_PRESSES = "Presses"
_BEYOND_X_MM = 0.6


class IdentifiedParameterJson(Output):
    """A parameter of the finger, with its 90 % band; stiffness and moduli over the default's."""

    name: ParameterName
    unit: Unit
    estimate: float
    """Value of the most likely finger whose parameters all lie within their bands."""
    mean: float
    sd: float
    low: float
    high: float


class PredictedForceJson(Output):
    """Force of a press on the identified finger with its 90 % band, in gwt."""

    shape: Shape
    x_mm: float
    doi_mm: float
    force_gwt: float
    low: float
    high: float
    unit: Literal["gwt"]


class IdentificationJson(Output):
    """An identified finger. `consistent`: the presses agree with a finger of the prior, and the bands hold."""

    run: File
    finger: File | None
    presses: int
    bench_s: float
    consistent: bool
    parameters: list[IdentifiedParameterJson]
    predicted: list[PredictedForceJson]
    problems_text: list[str]
    code: NotRequired[Code]
    ending: NotRequired[EndingJson]


class FindJson(Output):
    """Position of the finger, fitted to touches; `toml` is for the configuration."""

    value: FingerFrameJson
    sd: FingerFrameJson
    correlation: list[list[Ratio]]
    residual_mm: float
    touches: int
    toml: Toml
    warnings: NotRequired[list[RunWarningJson]]


def usual_goals(shapes: Sequence[str]) -> tuple[PressAt, ...]:
    """Return a few common presses, limited to shapes that slope like the pressed ones; others need another model."""
    axes = {parse_shape(shape).axes for shape in shapes}
    return tuple(goal for goal in USUAL_GOALS if parse_shape(goal.indentor).axes in axes)


def goals_of(script: Script, config: Config, finger: Finger) -> tuple[PressAt, ...]:
    """Return the presses of a protocol, each once, at their predicted depths. Raises BadInputError."""
    plan = make_plan(script, config, finger)
    found = [PressAt(p.indentor, p.x_mm, round(p.predicted_doi_mm, 3)) for p in plan.indentations]
    if any("," in press.indentor and "across" in press.indentor for press in found):
        raise BadInputError(
            f"protocol {script.name}: the forces of presses across the finger cannot be predicted; choose a "
            "protocol of presses along it",
            "not_foreseen",
        )
    return tuple(dict.fromkeys(found))


def scope_of(options: IdentificationOptions) -> tuple[float, float]:
    """Return the largest distance from the pad center and the largest depth of the predicted forces (mm)."""
    places = [*map(abs, PLACES_MM), *(abs(goal.x_mm) for goal in options.goals)]
    depths = [*DEPTHS_MM, *(goal.doi_mm for goal in options.goals)]
    return max(places) + _BEYOND_X_MM, BEYOND_DEPTH * max(depths)


_SERVED = ("tcp://127.", "tcp://localhost:", "tcp://[::1]:", "udp://127.", "/dev/pts/")


def is_virtual(config: Config) -> bool:
    """Return whether this machine serves both devices, as `rig serve` does."""
    return all(port.startswith(_SERVED) for port in (*stage_ports(config.stage), config.force.port))


def possible(
    options: IdentificationOptions, predicted: PredictedForces, refused: Mapping[str, str], *, own_goals: bool
) -> IdentificationOptions:
    """Return the options without shapes that the finger cannot be pressed with. Raises BadInputError if none is left.

    own_goals: whether the goals are the program's, which are then made as deep as the finger allows; without any,
    they are the presses of the shapes.
    """
    shapes = tuple(shape for shape in options.shapes if shape not in refused)
    asked = [] if own_goals else [goal.indentor for goal in options.goals if goal.indentor in refused]
    if asked or not shapes:
        name = (asked or list(options.shapes))[0]
        raise BadInputError(f"{name} cannot be pressed on this finger: {refused[name]}", "impossible_shape")
    if not own_goals:
        return replace(options, shapes=shapes)
    usual = [goal for goal in options.goals if goal.indentor not in refused]
    usual = usual or [PressAt(shape, 0.0, max(DEPTHS_MM)) for shape in shapes]
    deepest_mm = {goal.indentor: predicted.table(goal.indentor).scope.depth_mm[1] for goal in usual}
    goals = [replace(goal, doi_mm=min(goal.doi_mm, round(deepest_mm[goal.indentor], 2) - 0.01)) for goal in usual]
    return replace(options, shapes=shapes, goals=tuple(goals))


def page_lines(config: Config, options: IdentificationOptions, expected: ExpectedDuration | None) -> dict[str, str]:
    """Return the lines of the confirmation page."""
    about = "no estimate" if expected is None else f"at most about {expected.total_s:.0f} s"
    stage, force = config.stage, config.force
    return {
        "presses": f"at most {number_of(options.presses, 'presses')}, lightest first, predicted below "
        f"{options.most_gwt:g} gwt",
        "devices": f"{stage.kind} on {' and '.join(stage_ports(stage))}, {force.kind} on {force.port}",
        "shapes": f"{', '.join(map(with_size, options.shapes))}: the program asks you to mount each one",
        "duration": f"{about}, without the time to mount indentors",
        "safety": "check that the emergency stop is within reach and the finger is clear of the indentor",
    }


def print_before_press(identification: Identification, press: PressAt | None) -> None:
    """Print one line on the next press; None for homing."""
    if press is None:
        err.print("homing the stage, then zeroing the force sensor …")
        return
    where = f"{with_size(press.indentor)} at {press.x_mm:+.1f} mm to {press.doi_mm:.2f} mm"
    trip_gwt = min(identification.trip_n(press), identification.settings.limits.soft_trip_n) / GWT_N
    number, presses = len(identification.reports) + 1, identification.options.presses
    err.print(f"press {number} of at most {presses}: {where}, trips at {trip_gwt:.1f} gwt …")


def print_after_press(identification: Identification, expected: ExpectedDuration | None, report: PressReport) -> None:
    """Print one line on a press: measured and predicted force, present uncertainty, remaining presses."""
    remaining = identification.options.presses - report.number
    about = "" if expected is None else f", about {remaining * expected.press_s:.0f} s,"
    next_text = (
        "enough"
        if identification.enough
        else f"at most {number_of(remaining, 'presses')}{about} remain{'s' if remaining == 1 else ''}"
    )
    predicted = _in_brackets(report.surprise.predicted, " gwt")
    err.print(
        f"press {report.number}: measured {report.surprise.measured_gwt:.2f} gwt, predicted {predicted}; forces "
        f"are known to ± {100 * report.widest:.0f} %, target ± {100 * identification.options.width:g} %; {next_text}"
    )


def press_rows(identification: Identification) -> list[tuple[str, ...]]:
    """Return a row per press: the press, its prediction, its measurement, and the uncertainty after it."""
    return [
        (
            f"{report.number}",
            report.press.indentor,
            f"{report.press.x_mm:+.1f}",
            f"{report.press.doi_mm:.2f}",
            _in_brackets(report.surprise.predicted),
            f"{report.surprise.measured_gwt:.2f}",
            f"± {100 * report.widest:.0f} %",
        )
        for report in identification.reports
    ]


def force_rows(identification: Identification) -> list[tuple[str, ...]]:
    """Return a row per requested force: its press, its band and its uncertainty."""
    return [
        (goal.indentor, f"{goal.x_mm:+.1f}", f"{goal.doi_mm:.2f}", _in_brackets(w), f"± {100 * w.half:.0f} %")
        for goal, w in zip(identification.options.goals, identification.widths, strict=True)
    ]


def force_bands(identification: Identification) -> list[ForceBand]:
    """Return the force of each press and of each goal with its band, for the figure of the page."""
    made = [
        ForceBand(f"press {report.number}: {press_name(report.press)}", width, measured_gwt)
        for report, (width, measured_gwt) in zip(identification.reports, identification.explained, strict=True)
    ]
    goals = zip(identification.options.goals, identification.widths, strict=True)
    return [*made, *(ForceBand(press_name(goal), width) for goal, width in goals)]


def press_name(press: PressAt) -> str:
    """Return a press in words, e.g. "bar:3.0 at −1.20 mm to 0.60 mm"."""
    return f"{press.indentor} at {signed(press.x_mm)} mm to {press.doi_mm:.2f} mm"


def number_rows(identification: Identification) -> list[tuple[str, ...]]:
    """Return a row per parameter: the estimate, and its bands after and before."""
    after, before = (parameter_bands(one) for one in (identification.learned, identification.before))
    return [
        (now.name, f"{now.estimate:.3g}", *(f"{one.low:.3g} … {one.high:.3g}" for one in (now, then)))
        for now, then in zip(after, before, strict=True)
    ]


def final_lines(done: FinishedRun, identification: Identification, to: object) -> dict[str, Any]:
    """Return the results of the identification, including the parameters that the presses did not determine."""
    lines: dict[str, Any] = {"run": str(done.folder.path), "presses": len(identification.measured)}
    if done.problem is not None and done.ending is not None:
        lines |= {"ended": done.ending.reason}
        lines |= {about: words for about, words in done.ending.lines.items() if about != "resume"}
    if identification.learned.collapsed:
        lines["collapsed"] = (
            f"too few samples of the prior explain these presses ({identification.learned.effective:.1f} effective "
            f"samples); the bands are meaningless and no command accepts {to}; repeat the identification"
        )
    if identification.mismatch is not None:
        lines["no finger"] = f"{identification.mismatch}; check that the requested indentor is mounted"
    if identification.measured:
        learned = [f"{name} {estimate} ({after})" for name, estimate, after, _ in number_rows(identification)]
        forces = [
            f"{with_size(goal.indentor)} at {goal.x_mm:+.1f} mm to {goal.doi_mm:.2f} mm: {_in_brackets(w, ' gwt')}"
            for goal, w in zip(identification.options.goals, identification.widths, strict=True)
        ]
        lines |= {"finger": str(to), "learned": learned, "forces": forces, "not learned": identification.not_learned}
    return lines | {"duration_s": round(done.duration_s, 1)}


def _as_json(done: FinishedRun, identification: Identification, to: Path) -> IdentificationJson:
    """Return the same results as JSON; without a press there is neither a finger file nor a number."""
    flag = identification.flag
    found: IdentificationJson = {
        "run": str(done.folder.path),
        "finger": str(to) if identification.measured else None,
        "presses": len(identification.measured),
        "bench_s": done.duration_s,
        "consistent": flag is None,
        "parameters": _parameters(identification) if identification.measured else [],
        "predicted": _predicted(identification) if identification.measured else [],
        "problems_text": identification.not_learned if identification.measured else [],
    }
    if flag is not None:
        found["code"] = flag
    if done.ending is not None:
        found["code"], found["ending"] = code_of_end(done), done.ending.as_json()
    return found


def _parameters(identification: Identification) -> list[IdentifiedParameterJson]:
    return [
        {
            "name": one.name,
            "unit": unit_of_key(one.name) or "1",
            "estimate": one.estimate,
            "mean": one.mean,
            "sd": one.sd,
            "low": one.low,
            "high": one.high,
        }
        for one in parameter_bands(identification.learned)
    ]


def _predicted(identification: Identification) -> list[PredictedForceJson]:
    return [
        {
            "shape": goal.indentor,
            "x_mm": goal.x_mm,
            "doi_mm": goal.doi_mm,
            "force_gwt": width.middle,
            "low": width.low,
            "high": width.high,
            "unit": "gwt",
        }
        for goal, width in zip(identification.options.goals, identification.widths, strict=True)
    ]


def _in_brackets(width: Width, unit: str = "") -> str:
    return f"{width.middle:.2f}{unit} ({width.low:.2f} … {width.high:.2f})"


T = TypeVar("T")
A = TypeVar("A")


class IdentificationAttendant(AtTheTerminal):
    """Attendant that gives the script the location of the journal."""

    script: IdentificationScript

    def begins(self, folder: RunFolder) -> None:
        """Pass the run folder to the script, which reads its presses there."""
        self.script.begins(folder)
        super().begins(folder)


@dataclass(frozen=True)
class IdentifyRequest:
    """Arguments and options of `rig identify`."""

    protocol: Annotated[
        str | None, typer.Argument(help="Protocol whose forces to predict. Default: a few common presses.")
    ] = None
    more: MoreArgument = None
    config: FingerConfigOption = None
    dry: Annotated[bool, option("Use virtual devices and the configured finger.", name="--dry-run")] = False
    to: Annotated[Path, option("Finger file to write.", "TOML")] = Path("finger.toml")
    width: Annotated[
        float,
        option(
            "Stop when the 90 % bands of all forces are within ± this value, {within} %.",
            "PERCENT",
            _PRESSES,
            within=(1, 50),
        ),
    ] = 8.0
    presses: Annotated[int, option("Maximum number of presses.", "N", _PRESSES, min=1, max=8)] = 8
    most_gwt: Annotated[
        float,
        option("Do not press where the predicted force is larger, 1 gwt to limits.max_force_gwt.", "GWT", _PRESSES),
    ] = 20.0
    shapes: Annotated[
        str, option("Indentors that you can mount, separated by commas, e.g. sphere:r=2,bar:3.", "S,S", _PRESSES)
    ] = ",".join(SHAPES)
    out_dir: OutOption = Path("runs")
    subject: SubjectOption = None
    mounted: MountedOption = None
    yes: YesOption = False
    as_json: JsonOption = False


@takes(IdentifyRequest)
def identify_command(request: IdentifyRequest) -> None:
    """Press gently, print the result of each press, and write the finger file."""
    begins = before_motion(aloud=not request.dry)
    with ExitStack() as opened:
        settings = with_reliable_touch(load_config(request.config))
        bounded("--most-gwt", request.most_gwt, 1, settings.limits.max_force_gwt)
        checked_file("--to", request.to, ".toml")
        names = tuple(one.strip() for one in request.shapes.split(","))
        for name in (*names, *([] if request.mounted is None else [request.mounted])):
            parse_shape(name)
        requested = None if request.protocol is None else load_script(request.protocol, request.more or [])
        into = new_run(request.out_dir, request.subject)
        if request.dry:
            refuse_twinless(settings.stage, settings.force)
        else:
            ready_for_a_real_run("identify", settings, request.out_dir, yes=request.yes)
            refuse_mounts("identify", names, request.mounted)
        # Ports are opened before anything is computed, so that a missing server is reported and a stop acts at once.
        stage = (
            None
            if request.dry
            else opened.enter_context(closing(OwnedStage(settings, WallClock(into.begins_at_s)).open()))
        )
        run = RequestedRun(as_script(_nothing_yet), settings, into, begins)
        owner = opened.enter_context(owning(run, stage, request.config))
        process = None if request.dry else opened.enter_context(FingerProcess(settings.finger))
        finger = loaded(settings, process)
        with busy("checking the script …", quick=True):
            goals = usual_goals(names) if requested is None else goals_of(requested, settings, finger)
        options = IdentificationOptions(goals, request.width / 100, request.presses, request.most_gwt, names)
        prior = Prior(kinds=KINDS if request.dry or is_virtual(settings) else REAL_KINDS)
        predicted = PredictedForces.over(settings.finger, prior, *scope_of(options))
        with at_once():  # what ends this ends the processes that help it
            refused = predicted.have(options.indentors, _counted)
        options = possible(options, predicted, refused, own_goals=requested is None)
        for name in (name for name in names if name in refused):
            err.print(f"{name} is left out, because it cannot press this finger: {refused[name]}")
        with busy("sampling fingers of the prior …", quick=True):
            identification = Identification(settings, predicted, options)
        with busy("estimating the duration …", quick=True):
            expected = expected_duration(settings, options, finger)
        script = IdentificationScript(
            identification,
            partial(print_after_press, identification, expected),
            partial(print_before_press, identification),
        )
        session = Session(script.as_script(), settings, finger, Plan(), into)
        if stage is not None:
            lines = page_lines(settings, options, expected)
            confirmed_with(owner, lines, yes=request.yes)
        done = _carried_out(run, session, script, owner, on_the_bench(stage, owner, request.mounted))
        with busy("writing the finger file and the page …", quick=True):
            _write(done, identification, settings, request.to)
        _print(done, identification, request.to)
    _leave(done, identification, request.to)


def _nothing_yet(rig: Rig) -> None:
    """Do nothing; placeholder script while the identification is prepared."""


def _counted(what: str, function: Callable[[T], A], items: Sequence[T], /) -> Iterator[A]:
    """Compute the items on all cores, with a progress bar."""
    return counted(spread(function, items) if items else (), len(items), f"{what}, computed once")


def _carried_out(
    run: RequestedRun,
    session: Session,
    script: IdentificationScript,
    owner: RunOwner,
    how: Callable[[Session], FinishedRun],
) -> FinishedRun:
    owner.at("running")
    # In a pipe each press has its own lines.
    shown = progress(script.identification.options.presses, None, lines=False)
    with at_a_safe_point(owner.pause) as pause, shown as watch:
        attendant = IdentificationAttendant(pause, watch, run.begins, None, owner)
        attendant.script = script
        done = how(replace(session, attendant=attendant, button=owner.button))
    owner.at("reporting")
    return done


def _leave(done: FinishedRun, identification: Identification, to: Path) -> NoReturn:
    flag = None if done.problem is not None else identification.flag
    if flag == "collapsed":
        complain(
            "the identification failed: too few samples explain the presses, and no command accepts "
            f"{to}; repeat the identification"
        )
        raise typer.Exit(ExitCode.STOPPED)
    if flag == "no_finger":
        complain(
            f"the identification is flagged: {identification.mismatch}; other commands accept {to} only with "
            "--accept-flagged; check the indentors, the mount and the geometry, then repeat the identification"
        )
        raise typer.Exit(ExitCode.NO_FINGER)
    leave(done)


def _write(done: FinishedRun, identification: Identification, settings: Config, to: Path) -> None:
    """Write the finger file and the page if there was a press, and the checksums."""
    if identification.measured:
        file = finger_file(identification, settings, [done.folder.events])
        replace_text(to, file.as_toml())
        course = (identification.predicted, identification.measured, identification.before, identification.learned)
        rows = (press_rows(identification), force_rows(identification), number_rows(identification))
        readable = [] if isinstance(done.recorded, RunError) else [done.recorded]
        source = source_line(readable, f"run {done.folder.path.name}")
        page = IdentificationPage(
            *course, *rows, identification.not_learned, force_bands(identification), source, identification.mismatch
        )
        write_identification_page(done.folder.path / IDENTIFICATION_PAGE, page)
    done.folder.write_checksums()


def _print(done: FinishedRun, identification: Identification, to: Path) -> None:
    """Print the results."""
    if writes_json():
        print_json(_as_json(done, identification, to))
        return
    print_lines(final_lines(done, identification, to).items(), 12)
    if done.problem is not None:
        err.print(
            "the finger file contains the estimate from the presses before the end"
            if identification.measured
            else "no press was evaluated; no finger file was written"
        )


_LARGEST_TURN_DEG = 3.0


@reporting_errors
def find_command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run with touches at several positions.")],
    as_json: JsonOption = False,
) -> None:
    """Fit pad center, height, roll and tilt to the touches; print [frame] for the configuration."""
    with busy("reading the run …", quick=True):
        recorded, settings = recorded_run(run), load_config(run / "config.toml")
    with busy(THE_FINGER, quick=True):
        finger = Fingertip.load(settings.finger)
    with busy("fitting the pad to the touches …", quick=True):
        lie = find(recorded, settings, finger)
    if writes_json():
        found: FindJson = {
            "value": frame_as_json(lie.value),
            "sd": frame_as_json(lie.sd),
            "correlation": lie.correlation.tolist(),
            "residual_mm": lie.residual_mm,
            "touches": lie.touches,
            "toml": lie.as_toml(),
        }
        if warnings := warnings_as_json([recorded]):
            found["warnings"] = warnings
        print_json(found)
    else:
        out.print(
            f"{lie.touches} touches, residual {1000 * lie.residual_mm:.1f} µm from the finger's "
            f"surface\n\n{lie.as_toml()}"
        )
    for name in ("roll_deg", "tilt_deg"):
        turned, sd = lie.value.get(name, 0.0), lie.sd.get(name, 0.0)
        if abs(turned) > max(_LARGEST_TURN_DEG, 2 * sd):
            complain(
                f"{name} = {turned:.1f}°: the stage cannot rotate the finger; rotate the finger holder by this angle"
            )
