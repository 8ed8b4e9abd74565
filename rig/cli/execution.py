"""What `rig dry-run` and `rig run` share: interrupts, progress, and how a finished run is told."""

import errno
import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import typer

from rig.cli.confirming import Confirm, nothing_to_confirm
from rig.cli.interrupts import Pause, at_a_safe_point
from rig.cli.output import THE_FINGER, ExitCode, busy, checking_the_script, complain, out, print_json, screen_aside
from rig.cli.progress import progress
from rig.cli.reporting import lacks_report, make_missing, make_report
from rig.cli.run_owner import Owner
from rig.data import Run, RunFolder, export_run
from rig.engine import EngineError, RunAborted
from rig.errors import code_of
from rig.plan.agenda import Course
from rig.plan.config import Config
from rig.plan.finger_model import about_model
from rig.plan.plan import make_plan
from rig.plan.timeline import TimeLeft
from rig.protocol.script import Script
from rig.session.attendant import Nobody
from rig.session.ending import Whereabouts
from rig.session.page import Page
from rig.session.resume import StoppedRun
from rig.session.session import FinishedRun, NewRun, Session, Watch
from rig.session.subject import checked_subject
from sim.finger_process import Finger, FingerLostError, FingerProcess, asked
from sim.models.fingertip import Fingertip


class AtTheTerminal:
    """Somebody with Ctrl-C at hand and a screen to look at, whose course others may look at too."""

    def __init__(
        self,
        pause: Pause,
        watch: Watch,
        begins: Callable[[], None],
        course: Course | None,
        owner: Owner | None = None,
    ) -> None:
        self.watch, self.interrupted = watch, pause.asked
        self._pause, self._begins, self._course = pause, begins, course
        self._owner = owner or Nobody()
        self.stopped = self._owner.stopped

    def begins(self, folder: RunFolder) -> None:
        """A disk too full for the course ends no run here: the journal will tell."""
        self._begins()
        self._owner.begins(folder)
        if self._course is not None:
            with suppress(OSError):
                self._course.keep(folder)

    def go_on(self) -> bool:
        """The answer is typed below the screen."""
        with screen_aside():
            return self._pause.go_on()


def new_run(out_dir: Path, subject: str | None) -> NewRun:
    """A run that is to get a folder there. Raises BadInputError, OSError before anything is begun."""
    if out_dir.is_file():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(out_dir))
    return NewRun(out_dir, checked_subject(subject))


def carry_out(
    script: Script,
    config: Config,
    into: NewRun | StoppedRun,
    how: Callable[[Session], FinishedRun],
    owner: Owner,
    *,
    as_json: bool,
    begins: Callable[[], None],
    finger: FingerProcess | None = None,
    confirm: Confirm | None = None,
    pace: float | None = 1.0,
) -> FinishedRun:
    """Check the script, carry it out or take it up where it stopped, write its report, and say where it is.

    confirm is called when all is checked and nothing has moved (None: it begins at once), begins when the next thing
    may move. pace: how many seconds one of the bench will take; None where it goes as fast as it can. finger: of a
    run whose own process must not solve.
    """
    session = _planned(script, config, into, loaded(config, finger, as_json=as_json))
    page = (confirm or nothing_to_confirm(as_json=as_json))(session)
    began = time.perf_counter()
    owner.at("running")
    course = None if isinstance(page.rehearsal, EngineError) else page.rehearsal.course
    shown = progress(len(session.plan.indentations), time_left(page, pace), course, as_json=as_json)
    with at_a_safe_point(owner.pause) as pause, shown as watch:
        done = how(
            replace(session, attendant=AtTheTerminal(pause, watch, begins, course, owner), button=owner.button)
        )
    owner.at("reporting")
    done = _reported(done, session.finger, owner)
    _print(done, time.perf_counter() - began, as_json=as_json, resumed=isinstance(into, StoppedRun))
    return done


def loaded(config: Config, finger: FingerProcess | None, *, as_json: bool) -> Finger:
    """The configured finger: in a process of its own, once it is there, or here."""
    with busy(THE_FINGER, as_json=as_json):
        if finger is None:
            return Fingertip.load(config.finger)
        finger.ask(about_model)
        return finger


def _planned(script: Script, config: Config, into: NewRun | StoppedRun, finger: Finger) -> Session:
    before, folder = (None, None) if isinstance(into, NewRun) else (into.run, into.folder.path)
    with checking_the_script() as told:
        plan = make_plan(script, config, finger, before, folder, told)
    return Session(script, config, finger, plan, into)


def make_whole(stopped: StoppedRun, run: Run, owner: Owner, *, as_json: bool) -> FinishedRun:
    """Make what a complete run lacks of its exports, report and checksums; what is there stays as it is."""
    folder, began = stopped.folder, time.perf_counter()
    done = FinishedRun(run, 0.0, None, Whereabouts("not moved"))
    owner.folder = folder
    owner.at("reporting")
    done = _made_whole(done, stopped.config, as_json=as_json)
    _print(done, time.perf_counter() - began, as_json=as_json, resumed=True)
    return done


def _made_whole(done: FinishedRun, config: Config, *, as_json: bool) -> FinishedRun:
    folder, run = done.folder, done.run
    with folder.owned():
        there = folder.files
        try:
            export_run(run, again=False)
            if lacks_report(run):
                asked(loaded(config, None, as_json=as_json), make_missing, run)
            folder.add_checksums(folder.files - there)
        except OSError as error:
            return replace(done, problem=error)
    return done


def _reported(done: FinishedRun, finger: Finger, owner: Owner) -> FinishedRun:
    """With its report and its checksums; what cannot be written is the run's problem, if it has no other."""
    ending = done.ending
    try:
        done.folder.write_checksums()
        asked(finger, make_report, done.run, done.wall_s, None if ending is None else ending.told)
        done.folder.write_checksums()
    except (OSError, FingerLostError) as error:
        return replace(done, problem=done.problem or error)
    except KeyboardInterrupt:
        if not owner.stopped():
            raise
        at = replace(done.at, trusted=False)
        return replace(done, problem=done.problem or RunAborted("at once, by the operator"), at=at)
    return done


def leave(done: FinishedRun) -> NoReturn:
    """End the command with one line on what stopped the run, if anything did."""
    if done.problem is not None and done.ending is not None:
        complain(f"stopped: {done.ending.reason}")
    raise typer.Exit(_exit_code(done))


def _print(done: FinishedRun, wall_s: float, *, as_json: bool, resumed: bool) -> None:
    run, ending = done.run, done.ending
    report = str(done.folder.report) if done.folder.report.exists() else None
    counts = {"missing": run.missing, "repeated": run.repeated, "restarted": run.restarted} if resumed else {}
    if as_json:
        print_json(
            {
                "run": str(done.folder.path),
                "complete": done.complete,
                "indentations": done.indentations,
                "duration_s": done.duration_s,
                "wall_s": wall_s,
                "report": report,
                **counts,
                **failure(done),
            }
        )
    else:
        out.print(f"{done.indentations} indentations, {done.duration_s:.0f} s of bench time in {wall_s:.1f} s")
        if counts:
            out.print(", ".join(f"{number} {what}" for what, number in counts.items()))
        out.print(f"run     {done.folder.path}\nreport  {report or 'none'}")
        for about, words in {} if ending is None else ending.told.items():
            out.print(f"{about:<8}{words}")


def failure(done: FinishedRun) -> dict[str, Any]:
    """What JSON says of a run that ended before its end: a code, and how it ended."""
    if done.ending is None:
        return {}
    code = "incomplete" if done.problem is None else code_of(done.problem)
    return {"code": code, "ending": done.ending.as_json()}


def _exit_code(done: FinishedRun) -> ExitCode:
    if isinstance(done.problem, OSError):
        return ExitCode.BAD_INPUT
    if isinstance(done.problem, RunAborted):
        return ExitCode.ABORTED
    return ExitCode.DONE if done.complete and done.problem is None else ExitCode.STOPPED


def time_left(page: Page, pace: float | None, now: Callable[[], float] = time.perf_counter) -> TimeLeft | None:
    """Of what was rehearsed; None where the rehearsal did not come to its end."""
    if isinstance(page.rehearsal, EngineError):
        return None
    instants_s, duration_s = page.rehearsal.instants_s, page.rehearsal.duration_s
    if pace is not None:
        return TimeLeft(instants_s, duration_s, now, pace=pace)
    return TimeLeft(instants_s, duration_s, now, pace=page.took_s / max(duration_s, 1.0), measured=True)
