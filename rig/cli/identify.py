"""`rig meet`: learn in a few gentle presses which finger lies there."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, NoReturn, TypeVar

import typer

from rig.cli.carrying_out import AtTheTerminal, failure, leave, loaded, new_run
from rig.cli.confirming import confirmed_with, ready_for_a_real_run
from rig.cli.interrupts import at_a_safe_point, at_once
from rig.cli.meeting_said import (
    force_rows,
    goals_of,
    number_rows,
    page_lines,
    press_rows,
    said_after,
    said_at_the_end,
    said_before,
    scope_of,
    usual_goals,
)
from rig.cli.options import JsonOption, OutOption, SubjectOption, YesOption, checked_file
from rig.cli.output import Beginning, ExitCode, complain, err, out, print_json, told_in_one_line
from rig.cli.progress import counted, progress
from rig.cli.run import ask_at_the_bench
from rig.cli.run_owner import Owner, owning
from rig.compare.parameter_study.workers import spread
from rig.data import RunFolder
from rig.data.folder import replace_text
from rig.plan.config import Config, load_config
from rig.plan.plan import Plan
from rig.protocol.api import Rig
from rig.protocol.errors import BadInputError
from rig.protocol.script import load_script
from rig.report.meeting_page import Met, write_meeting_page
from rig.session.control.stage_in_hand import StageInHand
from rig.session.meeting import MEETING_PAGE
from rig.session.meeting.meeting import SHAPES, Meeting, Wanted, felt_surely
from rig.session.meeting.meeting_script import MeetingScript, as_script
from rig.session.meeting.written_finger import finger_file
from rig.session.session import FinishedRun, NewRun, Session, dry_run, real_run
from rig.session.virtual.twins import refuse_twinless
from rig.transport.clock import WallClock
from sim.contact.shapes import parse_shape
from sim.finger_process import FingerProcess
from sim.identification.forward import Foreseen
from sim.identification.prior import Prior

T = TypeVar("T")
A = TypeVar("A")


class MeetingAttendant(AtTheTerminal):
    """Who looks on knows where the journal is."""

    script: MeetingScript

    def begins(self, folder: RunFolder) -> None:
        """From now on presses can be read back."""
        self.script.begins(folder)
        super().begins(folder)


def command(
    protocol: Annotated[
        str | None, typer.Argument(help="The protocol whose forces are to be known; none: a few common presses.")
    ] = None,
    more: Annotated[list[str] | None, typer.Argument(metavar="[K=V]...", help="Its settings.")] = None,
    config: Annotated[Path | None, typer.Option(metavar="TOML", help="Configuration of rig and finger.")] = None,
    dry: Annotated[bool, typer.Option("--dry-run", help="On the virtual bench, with the configured finger.")] = False,
    to: Annotated[Path, typer.Option(metavar="TOML", help="The met finger's file.")] = Path("finger.toml"),
    width: Annotated[float, typer.Option(metavar="PERCENT", help="Half-width at which a force is known.")] = 8.0,
    presses: Annotated[int, typer.Option(min=1, max=8, help="At most so many.")] = 8,
    most_gwt: Annotated[float, typer.Option(metavar="GWT", help="No press is to be harder.")] = 20.0,
    shapes: Annotated[str, typer.Option(metavar="S,S", help="Indentors there are.")] = ",".join(SHAPES),
    out_dir: OutOption = Path("runs"),
    subject: SubjectOption = None,
    yes: YesOption = False,
    as_json: JsonOption = False,
) -> None:
    """Press gently, say after each press what was learned, write the finger's file."""
    beginning = Beginning(aloud=not dry)
    with told_in_one_line(as_json=as_json, beginning=beginning), ExitStack() as opened:
        settings = felt_surely(load_config(config))
        _refuse(width, most_gwt, settings)
        checked_file("--to", to)
        names = tuple(one.strip() for one in shapes.split(","))
        for name in names:
            parse_shape(name)
        asked = None if protocol is None else load_script(protocol, more or [])
        into = new_run(out_dir, subject)
        if dry:
            refuse_twinless(settings.stage, settings.force)
        else:
            ready_for_a_real_run("meet", settings, out_dir, yes=yes)
        # Ports are open before anything is computed: a server that is not there is said at once, and a stop is heard.
        stage = None if dry else opened.enter_context(closing(_stage(settings, into)))
        owner = opened.enter_context(owning(as_script(_nothing_yet), settings, into, stage, config))
        process = None if dry else opened.enter_context(FingerProcess(settings.finger))
        finger = loaded(settings, process, as_json=False)
        goals = usual_goals(names) if asked is None else goals_of(asked, settings, finger)
        wanted = Wanted(goals, width / 100, presses, most_gwt, names)
        foreseen = Foreseen.over(settings.finger, Prior(), *scope_of(wanted))
        with at_once():  # what ends this ends the processes that help it
            foreseen.have(wanted.indentors, _counted)
        meeting = Meeting(settings, foreseen, wanted)
        script = MeetingScript(meeting, partial(said_after, meeting), partial(said_before, meeting))
        session = Session(script.as_script(), settings, finger, Plan(), into, handler=script.handler)
        if stage is not None:
            lines = page_lines(settings, wanted)
            confirmed_with(lines, yes=yes, asking=owner.asking, button=owner.button)
        done = _carried_out(session, script, owner, beginning, stage)
        _written(done, meeting, settings, to, as_json=as_json)
    _leave(done, meeting, to)


def _refuse(width: float, most_gwt: float, settings: Config) -> None:
    if not 1 <= width <= 50:
        raise BadInputError(
            "{option} {value:g}: expected {low} … {high} percent",
            code="outside_range", option="--width", value=width, low=1, high=50,
        )  # fmt: skip
    if not 1 <= most_gwt <= settings.limits.max_force_gwt:
        raise BadInputError(
            "{option} {value:g}: expected {low} … {high:g} gwt",
            code="outside_range", option="--most-gwt", value=most_gwt, low=1, high=settings.limits.max_force_gwt,
        )  # fmt: skip


def _nothing_yet(rig: Rig) -> None:
    """What the meeting runs while it is prepared."""


def _counted(what: str, function: Callable[[T], A], items: Sequence[T], /) -> Iterator[A]:
    """Shared by as many processes as there are cores, and shown."""
    return counted(spread(function, items) if items else (), len(items), f"{what}, made once", quiet=False)


def _stage(settings: Config, into: NewRun) -> StageInHand:
    return StageInHand(settings, WallClock(into.begins_at_s)).open()


def _carried_out(
    session: Session, script: MeetingScript, owner: Owner, beginning: Beginning, stage: StageInHand | None
) -> FinishedRun:
    owner.at("running")
    shown = progress(script.meeting.wanted.presses, None, as_json=True)  # in a pipe each press has its own lines
    with at_a_safe_point(owner.pause) as pause, shown as watch:
        attendant = MeetingAttendant(pause, watch, beginning.begins, None, owner)
        attendant.script = script
        session = replace(session, attendant=attendant, button=owner.button)
        ask = partial(ask_at_the_bench, asking=owner.asking)
        done = dry_run(session) if stage is None else real_run(session, ask, stage)
    owner.at("reporting")
    return done


def _leave(done: FinishedRun, meeting: Meeting, to: Path) -> NoReturn:
    if done.problem is None and meeting.learned.collapsed:
        complain(f"the identification has collapsed: no command accepts {to}")
        raise typer.Exit(ExitCode.STOPPED)
    leave(done)


def _written(done: FinishedRun, meeting: Meeting, settings: Config, to: Path, *, as_json: bool) -> None:
    """The finger's file and a page, whatever ended the meeting, where there was a press to learn from."""
    if meeting.given:
        file = finger_file(meeting, settings, [done.folder.events])
        replace_text(to, file.as_toml())
        course = (meeting.foreseen, meeting.given, meeting.before, meeting.learned)
        rows = (press_rows(meeting), force_rows(meeting), number_rows(meeting))
        met = Met(*course, *rows, meeting.not_learned, meeting.stranger)
        write_meeting_page(done.folder.path / MEETING_PAGE, met)
    done.folder.write_checksums()
    if as_json:
        code = failure(done).get("code", "collapsed" if meeting.learned.collapsed else None)
        print_json(({} if code is None else {"code": code}) | said_at_the_end(done, meeting, to))
        return
    for about, words in said_at_the_end(done, meeting, to).items():
        for line in words if isinstance(words, list) else [words]:
            out.print(f"{about:<12}{line}")
    if done.problem is not None:
        err.print("what was learned until then is kept" if meeting.given else "nothing was learned")
