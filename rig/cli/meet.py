"""`rig meet`: learn in a few gentle presses which finger lies there."""

from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from rig.cli.carrying_out import AtTheTerminal, leave, new_run
from rig.cli.confirming import confirmed_with, ready_for_a_real_run
from rig.cli.interrupts import at_a_safe_point
from rig.cli.meeting_said import goals_of, page_lines, press_rows, said_after, said_at_the_end, scope_of
from rig.cli.options import JsonOption, OutOption, SubjectOption, YesOption, checked_file
from rig.cli.output import Beginning, busy, err, out, print_json, told_in_one_line
from rig.cli.run import ask_at_the_bench
from rig.cli.run_owner import Owner, owning
from rig.data import RunFolder
from rig.data.folder import replace_text
from rig.plan.config import Config, load_config
from rig.plan.plan import Plan
from rig.protocol.errors import BadInputError
from rig.report.meeting_page import Met, write_meeting_page
from rig.session.control.stage_in_hand import StageInHand
from rig.session.meeting.meeting import SHAPES, Meeting, Wanted, felt_surely
from rig.session.meeting.meeting_script import MeetingScript
from rig.session.meeting.written_finger import finger_file
from rig.session.session import FinishedRun, NewRun, Session, dry_run, real_run
from rig.session.virtual.twins import refuse_twinless
from rig.transport.clock import WallClock
from sim.contact.shapes import parse_shape
from sim.models.fingertip import Fingertip
from sim.models.meeting.foreseen import Foreseen
from sim.models.meeting.prior import Prior
from sim.models.processes.finger_process import Finger, FingerProcess

PAGE = "meeting.html"
"""In the folder of the run."""


class MeetingAttendant(AtTheTerminal):
    """Who looks on knows where the journal is."""

    script: MeetingScript

    def begins(self, folder: RunFolder) -> None:
        """From now on presses can be read back."""
        self.script.folder = folder.path
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
    with told_in_one_line(as_json=as_json, beginning=beginning):
        settings = felt_surely(load_config(config))
        _refuse(width, most_gwt, settings)
        checked_file("--to", to)
        if dry:
            refuse_twinless(settings.stage, settings.force)
        else:
            ready_for_a_real_run("meet", settings, out_dir, yes=yes)
        names = tuple(one.strip() for one in shapes.split(","))
        for name in names:
            parse_shape(name)
        goals = goals_of(protocol, more or [], settings)
        wanted = Wanted(goals, width / 100, presses, most_gwt, names)
        meeting = _begun(settings, wanted, as_json=as_json)
        script = MeetingScript(meeting, lambda told: said_after(meeting, told, as_json=as_json))
        into = new_run(out_dir, subject)
        with ExitStack() as opened:
            finger: Finger = _on_the_bench(settings) if dry else opened.enter_context(FingerProcess(settings.finger))
            stage = None if dry else opened.enter_context(closing(_stage(settings, into)))
            owner = opened.enter_context(owning(script.as_script(), settings, into, stage, config))
            session = Session(script.as_script(), settings, finger, Plan(), into, handler=script.handler)
            if stage is not None:
                confirmed_with(page_lines(settings, wanted), yes=yes, asking=owner.asking)
            done = _carried_out(session, script, owner, beginning, stage)
        _written(done, meeting, settings, to, as_json=as_json)
    leave(done)


def _refuse(width: float, most_gwt: float, settings: Config) -> None:
    if not 1 <= width <= 50:
        raise BadInputError(f"--width {width:g}: expected 1 … 50 percent")
    if not 1 <= most_gwt <= settings.limits.max_force_gwt:
        raise BadInputError(f"--most-gwt {most_gwt:g}: expected 1 … {settings.limits.max_force_gwt:g} gwt")


def _begun(settings: Config, wanted: Wanted, *, as_json: bool) -> Meeting:
    with busy("fingers of the prior: from the cache, or built in some minutes …", as_json=as_json):
        foreseen = Foreseen.over(settings.finger, Prior(), *scope_of(wanted))
        return Meeting(settings, foreseen, wanted)


def _on_the_bench(settings: Config) -> Fingertip:
    return Fingertip.load(settings.finger)


def _stage(settings: Config, into: NewRun) -> StageInHand:
    return StageInHand(settings, WallClock(into.begins_at_s)).open()


def _carried_out(
    session: Session, script: MeetingScript, owner: Owner, beginning: Beginning, stage: StageInHand | None
) -> FinishedRun:
    owner.at("running")
    with at_a_safe_point(owner.pause) as pause:
        attendant = MeetingAttendant(pause, lambda stream, data: None, beginning.begins, None, owner)
        attendant.script = script
        session = replace(session, attendant=attendant)
        ask = partial(ask_at_the_bench, asking=owner.asking)
        done = dry_run(session) if stage is None else real_run(session, ask, stage)
    owner.at("reporting")
    return done


def _written(done: FinishedRun, meeting: Meeting, settings: Config, to: Path, *, as_json: bool) -> None:
    """The finger's file and a page, whatever ended the meeting, where there was a press to learn from."""
    if meeting.given:
        file = finger_file(meeting, settings, [done.folder.events])
        replace_text(to, file.as_toml())
        course = (meeting.foreseen, meeting.given, meeting.before, meeting.learned)
        write_meeting_page(done.folder.path / PAGE, Met(*course, press_rows(meeting), meeting.not_learned))
    done.folder.write_checksums()
    if as_json:
        print_json(said_at_the_end(done, meeting, to))
        return
    for about, words in said_at_the_end(done, meeting, to).items():
        for line in words if isinstance(words, list) else [words]:
            out.print(f"{about:<12}{line}")
    if done.problem is not None:
        err.print("what was learned until then is kept" if meeting.given else "nothing was learned")
