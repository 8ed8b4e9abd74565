"""`rig identify` and `rig find`: identify the finger, and find where it lies."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NoReturn, TypeVar

import numpy as np
import typer

from rig.bench.virtual import refuse_twinless
from rig.cli.confirm import confirmed_with, ready_for_a_real_run, refuse_mounts
from rig.cli.options import (
    FingerConfigOption,
    JsonOption,
    MountedOption,
    OutOption,
    SubjectOption,
    YesOption,
    checked_file,
)
from rig.cli.output import Beginning, ExitCode, complain, err, loading_the_finger, out, print_json, told_in_one_line
from rig.cli.progress import counted, progress
from rig.cli.run import asks_for
from rig.cli.script_execution import AtTheTerminal, RunOwner, failure, leave, loaded, new_run, owning
from rig.cli.signals import at_a_safe_point, at_once
from rig.clock import WallClock
from rig.control.stop import StageInHand
from rig.data import RunFolder, read_run
from rig.data.folder import IDENTIFICATION_PAGE, replace_text
from rig.devices.registry import stage_ports
from rig.errors import BadInputError
from rig.identify.adaptive_presses import (
    BEYOND_DEPTH,
    DEPTHS_MM,
    PLACES_MM,
    SHAPES,
    IdentificationOptions,
    Meeting,
    PressReport,
    felt_surely,
)
from rig.identify.finger_from_presses import finger_file
from rig.identify.frame import find
from rig.identify.identification_script import MeetingScript, as_script
from rig.plan.config import Config, load_config, unit
from rig.plan.plan import Plan, make_plan
from rig.protocol.api import Rig
from rig.protocol.script import Script, load_script
from rig.report.identification_page import IdentificationPage, write_identification_page
from rig.session.session import FinishedRun, NewRun, Session, dry_run, real_run
from rig.study.parallel import spread
from rig.units import GWT_N
from sim.contact.shapes import parse_shape, with_size
from sim.finger_process import Finger, FingerProcess
from sim.identification.next_press import PressAt
from sim.identification.predicted_forces import Foreseen
from sim.identification.prior import Prior, named, plain
from sim.identification.uncertainty_bands import Width, ends
from sim.models.fingertip import Fingertip

USUAL_GOALS = (
    *(PressAt("bar:3.0", x_mm, 0.67) for x_mm in (-1.0, 0.0, 1.0)),
    PressAt("cylinder:9", 0.0, 0.67),
    PressAt("sphere:6", 0.0, 0.5),
)

_PRESSES = "Presses"
_BEYOND_X_MM = 0.6
_SECONDS_A_PRESS = 15.0


def usual_goals(shapes: Sequence[str]) -> tuple[PressAt, ...]:
    """Return a few common presses, limited to shapes that slope like the pressed ones; others need another model."""
    axes = {parse_shape(shape).axes for shape in shapes}
    return tuple(goal for goal in USUAL_GOALS if parse_shape(goal.indentor).axes in axes)


def goals_of(script: Script, config: Config, finger: Finger) -> tuple[PressAt, ...]:
    """The presses of a protocol, each once, as deep as the configured finger lets them go. Raises BadInputError."""
    plan = make_plan(script, config, finger)
    found = [PressAt(p.indentor, p.x_mm, round(p.predicted_doi_mm, 3)) for p in plan.indentations]
    if any("," in press.indentor and "across" in press.indentor for press in found):
        raise BadInputError(
            "protocol {protocol}: the forces of presses across the finger cannot be predicted; choose a "
            "protocol of presses along it",
            code="not_foreseen", protocol=script.name,
        )  # fmt: skip
    return tuple(dict.fromkeys(found))


def scope_of(wanted: IdentificationOptions) -> tuple[float, float]:
    """Return the largest distance from the pad center and the largest depth of the predicted forces (mm)."""
    places = [*map(abs, PLACES_MM), *(abs(goal.x_mm) for goal in wanted.goals)]
    depths = [*DEPTHS_MM, *(goal.doi_mm for goal in wanted.goals)]
    return max(places) + _BEYOND_X_MM, BEYOND_DEPTH * max(depths)


def page_lines(config: Config, wanted: IdentificationOptions) -> dict[str, str]:
    """Return the lines of the confirmation page."""
    stage, force = config.stage, config.force
    return {
        "presses": f"at most {wanted.presses} presses, lightest first, predicted below {wanted.most_gwt:g} gwt",
        "devices": f"{stage.kind} on {' and '.join(stage_ports(stage))}, {force.kind} on {force.port}",
        "shapes": f"{', '.join(map(with_size, wanted.shapes))}: the program asks you to mount each one",
        "duration": f"about {wanted.presses * _SECONDS_A_PRESS + 35:.0f} s, without the time to mount indentors",
        "safety": "check that the emergency stop is within reach and the finger is clear of the indentor",
    }


def said_before(meeting: Meeting, press: PressAt | None) -> None:
    """One line on what begins now."""
    if press is None:
        err.print("homing the stage, then zeroing the force sensor …")
        return
    where = f"{press.indentor} at {press.x_mm:+.1f} mm to {press.doi_mm:.2f} mm"
    trip_gwt = min(meeting.trip_n(press), meeting.settings.limits.soft_trip_n) / GWT_N
    err.print(
        f"press {len(meeting.told) + 1} of at most {meeting.wanted.presses}: {where}, trips at {trip_gwt:.1f} gwt …"
    )


def said_after(meeting: Meeting, told: PressReport) -> None:
    """Print one line: measured and predicted force with its band, what is known now, and what remains."""
    left = meeting.wanted.presses - told.number
    goes_on = "enough" if meeting.enough else f"at most {left} presses, about {left * _SECONDS_A_PRESS:.0f} s remain"
    foreseen = _in_brackets(told.surprise.foreseen, " gwt")
    err.print(
        f"press {told.number}: measured {told.surprise.measured_gwt:.2f} gwt, predicted {foreseen}; forces "
        f"are known to ± {100 * told.widest:.0f} %, target ± {100 * meeting.wanted.width:g} %; {goes_on}"
    )


def press_rows(meeting: Meeting) -> list[tuple[str, ...]]:
    """Return a row per press: the press, its prediction, its measurement, and the uncertainty after it."""
    return [
        (
            f"{told.number}",
            told.press.indentor,
            f"{told.press.x_mm:+.1f}",
            f"{told.press.doi_mm:.2f}",
            _in_brackets(told.surprise.foreseen),
            f"{told.surprise.measured_gwt:.2f}",
            f"± {100 * told.widest:.0f} %",
        )
        for told in meeting.told
    ]


def force_rows(meeting: Meeting) -> list[tuple[str, ...]]:
    """Return a row per requested force: its press, its band and its uncertainty."""
    return [
        (goal.indentor, f"{goal.x_mm:+.1f}", f"{goal.doi_mm:.2f}", _in_brackets(w), f"± {100 * w.half:.0f} %")
        for goal, w in zip(meeting.wanted.goals, meeting.widths, strict=True)
    ]


def number_rows(meeting: Meeting) -> list[tuple[str, ...]]:
    """Return a row per parameter: the maximum-likelihood value, and its bands after and before."""
    known = [np.quantile(one.draws, ends(), axis=0) for one in (meeting.learned, meeting.before)]
    return [
        (
            named(name),
            f"{plain(name, likeliest):.3g}",
            *(" … ".join(f"{plain(name, end):.3g}" for end in band[:, k]) for band in known),
        )
        for k, (name, likeliest) in enumerate(
            zip(meeting.learned.prior.names, meeting.learned.likeliest.tolist(), strict=True)
        )
    ]


def said_at_the_end(done: FinishedRun, meeting: Meeting, to: object) -> dict[str, Any]:
    """Return the results of the identification, and what was not learned."""
    said: dict[str, Any] = {"run": str(done.folder.path), "presses": len(meeting.given)}
    if done.problem is not None and done.ending is not None:
        told = {about: words for about, words in done.ending.lines.items() if about != "resume"}
        said |= {"ended": done.ending.reason} | told
    if meeting.learned.collapsed:
        said["collapsed"] = (
            f"too few samples of the prior explain these presses ({meeting.learned.effective:.1f} effective "
            f"samples); the bands are meaningless and no command accepts {to}; repeat the identification"
        )
    if meeting.stranger is not None:
        said["no finger"] = f"{meeting.stranger}; check that the requested indentor is mounted"
    if meeting.given:
        learned = [f"{name} {likeliest} ({after})" for name, likeliest, after, _ in number_rows(meeting)]
        forces = [
            f"{goal.indentor} at {goal.x_mm:+.1f} mm to {goal.doi_mm:.2f} mm: {_in_brackets(w, ' gwt')}"
            for goal, w in zip(meeting.wanted.goals, meeting.widths, strict=True)
        ]
        said |= {"finger": str(to), "learned": learned, "forces": forces, "not learned": meeting.not_learned}
    return said | {"duration_s": round(done.duration_s, 1)}


def _as_json(done: FinishedRun, meeting: Meeting, to: Path) -> dict[str, Any]:
    """Return the same results as JSON; without a press there is neither a finger file nor a number."""
    flag = "collapsed" if meeting.learned.collapsed else "no_finger" if meeting.stranger is not None else None
    return {
        "run": str(done.folder.path),
        "finger": str(to) if meeting.given else None,
        "presses": len(meeting.given),
        "bench_s": done.duration_s,
        "consistent": meeting.stranger is None and not meeting.learned.collapsed,
        "parameters": _parameters(meeting) if meeting.given else [],
        "predicted": _predicted(meeting) if meeting.given else [],
        "problems_text": meeting.not_learned if meeting.given else [],
        **({} if flag is None else {"code": flag}),
        **failure(done),
    }


def _parameters(meeting: Meeting) -> list[dict[str, Any]]:
    names, draws = meeting.learned.prior.names, meeting.learned.draws
    values = [np.exp(draws[:, k]) if named(name) != name else draws[:, k] for k, name in enumerate(names)]
    bands = [np.quantile(column, ends()).tolist() for column in values]
    return [
        {
            "name": named(name),
            "unit": unit(named(name)) or "1",
            "mean": float(column.mean()),
            "sd": float(column.std(ddof=1)),
            "low": low,
            "high": high,
        }
        for name, column, (low, high) in zip(names, values, bands, strict=True)
    ]


def _predicted(meeting: Meeting) -> list[dict[str, Any]]:
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
        for goal, width in zip(meeting.wanted.goals, meeting.widths, strict=True)
    ]


def _in_brackets(width: Width, unit: str = "") -> str:
    return f"{width.middle:.2f}{unit} ({width.low:.2f} … {width.high:.2f})"


T = TypeVar("T")
A = TypeVar("A")


class MeetingAttendant(AtTheTerminal):
    """Attendant that gives the script the location of the journal."""

    script: MeetingScript

    def begins(self, folder: RunFolder) -> None:
        """Tell the script the run folder, from which presses can be read."""
        self.script.begins(folder)
        super().begins(folder)


def identify_command(
    protocol: Annotated[
        str | None, typer.Argument(help="Protocol whose forces to predict. Default: a few common presses.")
    ] = None,
    more: Annotated[list[str] | None, typer.Argument(metavar="K=V", help="Protocol parameters, KEY=VALUE.")] = None,
    config: FingerConfigOption = None,
    dry: Annotated[bool, typer.Option("--dry-run", help="Use virtual devices and the configured finger.")] = False,
    to: Annotated[Path, typer.Option(metavar="TOML", help="Finger file to write.")] = Path("finger.toml"),
    width: Annotated[
        float,
        typer.Option(
            metavar="PERCENT",
            help="Stop when the 90 % bands of all forces are within ± this value, 1 to 50 %.",
            rich_help_panel=_PRESSES,
        ),
    ] = 8.0,
    presses: Annotated[
        int, typer.Option(metavar="N", min=1, max=8, help="Maximum number of presses.", rich_help_panel=_PRESSES)
    ] = 8,
    most_gwt: Annotated[
        float,
        typer.Option(
            metavar="GWT",
            help="Do not press where the predicted force is larger, 1 gwt to limits.max_force_gwt.",
            rich_help_panel=_PRESSES,
        ),
    ] = 20.0,
    shapes: Annotated[
        str,
        typer.Option(
            metavar="S,S",
            help="Indentors that you can mount, separated by commas, e.g. sphere:2.0,bar:3.0.",
            rich_help_panel=_PRESSES,
        ),
    ] = ",".join(SHAPES),
    out_dir: OutOption = Path("runs"),
    subject: SubjectOption = None,
    mounted: MountedOption = None,
    yes: YesOption = False,
    as_json: JsonOption = False,
) -> None:
    """Press gently, print after each press what was learned, and write the finger file."""
    beginning = Beginning(aloud=not dry)
    with told_in_one_line(as_json=as_json, beginning=beginning), ExitStack() as opened:
        settings = felt_surely(load_config(config))
        _refuse(width, most_gwt, settings)
        checked_file("--to", to)
        names = tuple(one.strip() for one in shapes.split(","))
        for name in (*names, *([] if mounted is None else [mounted])):
            parse_shape(name)
        asked = None if protocol is None else load_script(protocol, more or [])
        into = new_run(out_dir, subject)
        if dry:
            refuse_twinless(settings.stage, settings.force)
        else:
            ready_for_a_real_run("identify", settings, out_dir, yes=yes)
            refuse_mounts("identify", names, mounted)
        # Ports are open before anything is computed: a server that is not there is said at once, and a stop is heard.
        stage = None if dry else opened.enter_context(closing(_stage(settings, into)))
        owner = opened.enter_context(owning(as_script(_nothing_yet), settings, into, stage, config))
        process = None if dry else opened.enter_context(FingerProcess(settings.finger))
        finger = loaded(settings, process, as_json=False)
        goals = usual_goals(names) if asked is None else goals_of(asked, settings, finger)
        wanted = IdentificationOptions(goals, width / 100, presses, most_gwt, names)
        foreseen = Foreseen.over(settings.finger, Prior(), *scope_of(wanted))
        with at_once():  # what ends this ends the processes that help it
            foreseen.have(wanted.indentors, _counted)
        meeting = Meeting(settings, foreseen, wanted)
        script = MeetingScript(meeting, partial(said_after, meeting), partial(said_before, meeting))
        session = Session(script.as_script(), settings, finger, Plan(), into, handler=script.handler)
        if stage is not None:
            lines = page_lines(settings, wanted)
            confirmed_with(lines, yes=yes, asking=owner.asking, button=owner.button)
        done = _carried_out(session, script, owner, beginning, stage, mounted)
        _written(done, meeting, settings, to, as_json=as_json)
    _leave(done, meeting, to)


def _refuse(width: float, most_gwt: float, settings: Config) -> None:
    if not 1 <= width <= 50:
        raise BadInputError(
            "{option} {value:g}: must be {low} to {high} %",
            code="outside_range", option="--width", value=width, low=1, high=50,
        )  # fmt: skip
    if not 1 <= most_gwt <= settings.limits.max_force_gwt:
        raise BadInputError(
            "{option} {value:g}: must be {low} to {high:g} gwt",
            code="outside_range", option="--most-gwt", value=most_gwt, low=1, high=settings.limits.max_force_gwt,
        )  # fmt: skip


def _nothing_yet(rig: Rig) -> None:
    """Do nothing; placeholder script while the identification is prepared."""


def _counted(what: str, function: Callable[[T], A], items: Sequence[T], /) -> Iterator[A]:
    """Shared by as many processes as there are cores, and shown."""
    return counted(spread(function, items) if items else (), len(items), f"{what}, computed once", quiet=False)


def _stage(settings: Config, into: NewRun) -> StageInHand:
    return StageInHand(settings, WallClock(into.begins_at_s)).open()


def _carried_out(
    session: Session,
    script: MeetingScript,
    owner: RunOwner,
    beginning: Beginning,
    stage: StageInHand | None,
    mounted: str | None,
) -> FinishedRun:
    owner.at("running")
    shown = progress(script.meeting.wanted.presses, None, as_json=True)  # in a pipe each press has its own lines
    with at_a_safe_point(owner.pause) as pause, shown as watch:
        attendant = MeetingAttendant(pause, watch, beginning.begins, None, owner)
        attendant.script = script
        session = replace(session, attendant=attendant, button=owner.button)
        done = dry_run(session) if stage is None else real_run(session, asks_for(owner, mounted), stage)
    owner.at("reporting")
    return done


def _leave(done: FinishedRun, meeting: Meeting, to: Path) -> NoReturn:
    if done.problem is None and meeting.learned.collapsed:
        complain(
            "the identification failed: too few samples explain the presses, and no command accepts "
            f"{to}; repeat the identification"
        )
        raise typer.Exit(ExitCode.STOPPED)
    if done.problem is None and meeting.stranger is not None:
        complain(
            f"the identification is flagged: {meeting.stranger}; other commands accept {to} only with --force; check "
            "the indentors, the mount and the geometry, then repeat the identification"
        )
        raise typer.Exit(ExitCode.NO_FINGER)
    leave(done)


def _written(done: FinishedRun, meeting: Meeting, settings: Config, to: Path, *, as_json: bool) -> None:
    """The finger's file and a page, whatever ended the meeting, where there was a press to learn from."""
    if meeting.given:
        file = finger_file(meeting, settings, [done.folder.events])
        replace_text(to, file.as_toml())
        course = (meeting.foreseen, meeting.given, meeting.before, meeting.learned)
        rows = (press_rows(meeting), force_rows(meeting), number_rows(meeting))
        page = IdentificationPage(*course, *rows, meeting.not_learned, meeting.stranger)
        write_identification_page(done.folder.path / IDENTIFICATION_PAGE, page)
    done.folder.write_checksums()
    if as_json:
        print_json(_as_json(done, meeting, to))
        return
    for about, words in said_at_the_end(done, meeting, to).items():
        for line in words if isinstance(words, list) else [words]:
            out.print(f"{about:<12}{line}")
    if done.problem is not None:
        err.print(
            "the finger file holds what was learned before the end"
            if meeting.given
            else "nothing was learned; no finger file was written"
        )


_LARGEST_TURN_DEG = 3.0


def find_command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run with touches at several positions.")],
    as_json: JsonOption = False,
) -> None:
    """Fit pad centre, height, roll and tilt to the touches; print [frame] for the configuration."""
    with told_in_one_line(as_json=as_json):
        recorded, settings = read_run(run), load_config(run / "config.toml")
        with loading_the_finger():
            finger = Fingertip.load(settings.finger)
        lie = find(recorded, settings, finger)
        if as_json:
            found = {"value": lie.value, "sd": lie.sd, "correlation": lie.correlation.tolist()}
            print_json({**found, "residual_mm": lie.residual_mm, "touches": lie.touches, "toml": lie.as_toml()})
        else:
            out.print(
                f"{lie.touches} touches, residual {1000 * lie.residual_mm:.1f} µm from the finger's "
                f"surface\n\n{lie.as_toml()}"
            )
        for name in ("roll_deg", "tilt_deg"):
            turned, sd = lie.value.get(name, 0.0), lie.sd.get(name, 0.0)
            if abs(turned) > max(_LARGEST_TURN_DEG, 2 * sd):
                complain(
                    f"{name} = {turned:.1f}°: the stage cannot rotate the finger; rotate the finger "
                    "holder by this angle"
                )
