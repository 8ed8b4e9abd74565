"""Run a script for a command: progress, interrupts, ownership of the ports, the finished run."""

import os
import shlex
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn, NotRequired

import filelock
import typer

from rig.bench.checks import checked_subject
from rig.cli.choice_verdict import AdaptiveVerdictJson, choice_as_json, choice_lines
from rig.cli.confirm import Confirm, nothing_to_confirm
from rig.cli.nerve import SpikesJson, add_spikes, print_firing, spike_lines
from rig.cli.output import (
    THE_FINGER,
    ExitCode,
    busy,
    checking_the_script,
    complain,
    out,
    print_json,
    print_lines,
    screen_aside,
    writes_json,
)
from rig.cli.progress import progress
from rig.cli.signals import PauseRequest, at_a_safe_point, interrupt_main, stoppable, unstoppable
from rig.clock import WallClock
from rig.control.client import Announcement
from rig.control.owned_stage import OwnedStage, StopSwitch, answer_to_a_stop
from rig.control.owner_socket import Answers, ControlSocket
from rig.data import FolderBusyError, Run, RunError, RunFolder, export_run
from rig.data.deviation import deviations, warning_of
from rig.data.ending import EndingJson
from rig.data.folder import may_write_below
from rig.data.journal import Watch
from rig.data.planned_presses import pressed_otherwise
from rig.data.run_state import Course, TimeLeft
from rig.data.tables import motions_in_contact
from rig.devices.registry import bench_ports
from rig.engine import EngineError, RunAborted
from rig.engine.bench import Meanwhile
from rig.errors import BadInputError, RigError
from rig.plan.config import Config
from rig.plan.finger_model import about_model
from rig.plan.plan import make_plan
from rig.printable import on_one_line
from rig.protocol.script import Script
from rig.session.early_ending import FinalPosition
from rig.session.hardware_stop import StopButton
from rig.session.rehearsal_summary import Page
from rig.session.resume import StoppedRun
from rig.session.script_run import AT_ONCE, FROM_THE_PANEL
from rig.session.session import FinishedRun, Made, NewRun, NoAttendant, Session, record_after, record_before
from rig_shared.errors import code_of
from rig_shared.outputs import Code, File, Output
from rig_shared.plural import number_of
from sim.errors import ModelRangeError
from sim.finger_process import Finger, FingerLostError, FingerProcess, asked

if TYPE_CHECKING:
    from rig.plan.nerve import SpikeRequest
    from sim.models.fingertip import Fingertip


Phase = Literal["planning", "running", "reporting"]


@dataclass(frozen=True)
class RequestedRun:
    """A run as a command requests it, before its plan."""

    script: Script
    config: Config
    into: NewRun | StoppedRun
    begins: Callable[[], None]  # called before the first motion
    finger: FingerProcess | None = None  # serves a run whose own process must not solve
    spikes: "SpikeRequest | None" = None  # simulated after the run, before its report

    @property
    def stopped(self) -> StoppedRun | None:
        """The run that is resumed."""
        return self.into if isinstance(self.into, StoppedRun) else None

    @property
    def before(self) -> tuple[Run | None, Path | None]:
        """Journal and folder of the run that is resumed."""
        return (None, None) if self.stopped is None else (self.stopped.run, self.stopped.folder.path)

    def loaded(self) -> Finger:
        """Load the configured finger, in its own process if one exists."""
        return loaded(self.config, self.finger)


class FinishedRunJson(Output):
    """A run that was carried out or resumed."""

    run: File
    complete: bool
    indentations: int
    duration_s: float
    wall_s: float
    report: File | None
    choice: NotRequired[AdaptiveVerdictJson]
    missing: NotRequired[int]
    repeated: NotRequired[int]
    restarted: NotRequired[int]
    code: NotRequired[Code]
    ending: NotRequired[EndingJson]
    deviation_text: NotRequired[str]
    otherwise_text: NotRequired[str]
    files_text: NotRequired[str]


class RunOwner:
    """A run that other processes may query: its state, pause, continue and stop. No request blocks the run."""

    def __init__(self, switch: StopSwitch, *, virtual: bool) -> None:
        self.switch, self.pause, self.virtual = switch, PauseRequest(), virtual
        self.folder: RunFolder | None = None
        self.button: StopButton | None = None
        self.announce: Callable[[Path], None] = lambda run: None
        self._phase: Phase = "planning"
        self.stopped_by = AT_ONCE
        self._asks = False
        self._stopped_while = "planning"

    @property
    def answers(self) -> Mapping[str, Callable[[Mapping[str, Any]], dict[str, Any]]]:
        """Return the handlers of requests, by name."""
        return {"status": self._status, "stop": self._stop, "pause": self._pause, "go_on": self._go_on}

    @property
    def state(self) -> str:
        """State in one word."""
        if self._asks:
            return "asking"
        if self._phase != "running" or not self.pause.asked():
            return self._phase
        return "paused" if self.pause.waits else "pausing"

    def at(self, phase: Phase) -> None:
        """Set the phase of the main thread."""
        self._phase = phase
        self.switch.ready()

    @contextmanager
    def asking(self) -> Iterator[None]:
        """Mark the time during which a person is prompted."""
        self._asks = True
        try:
            yield
        finally:
            self._asks = False

    def begins(self, folder: RunFolder) -> None:
        """Announce the run's folder; its ports are open."""
        self.folder = folder
        with suppress(OSError):  # the journal reports it too
            self.announce(folder.path)

    def stopped(self) -> bool:
        """Return whether another process has stopped the stage; called by the main thread."""
        return self.switch.noticed()

    def record(self, run: RequestedRun) -> None:
        """Record a stop in the byte log and the journal, if there was one; later stops are rejected."""
        with unstoppable():
            self.switch.over()
            if not self.switch.stopped:
                return
            try:
                if self.folder is None:
                    self.folder = record_before(
                        run.script,
                        run.config,
                        run.into,
                        virtual=self.virtual,
                        reason=self.stopped_by,
                        clock=self.switch.clock,
                    )
                    complain(f"the run folder {self.folder.path} records the stop")
                record_after(self.folder, self._stopped_while, self.switch.kept, self.stopped_by)
            except (OSError, FolderBusyError) as error:
                complain(f"the stop could not be recorded: {error}")

    def _status(self, _: Mapping[str, Any]) -> dict[str, Any]:
        run = None if self.folder is None else str(self.folder.path)
        found = {"state": self.state, "run": run, "stopped": self.switch.stopped}
        return found if self.button is None else found | {"stop_button": self.button.last_state}

    def _stop(self, request: Mapping[str, Any]) -> dict[str, Any]:
        self._stopped_while = self.state
        if request.get("by") == "panel" and not self.switch.stopped:
            self.stopped_by = FROM_THE_PANEL
        return answer_to_a_stop(self.switch.stop)

    def _pause(self, _: Mapping[str, Any]) -> dict[str, Any]:
        if self._phase != "running":
            return {"ok": False, "problem": f"the run is {self.state}; it can be paused only while it runs"}
        if not self.pause.asked():
            self.pause.ask_from_elsewhere()
        return {"state": self.state}

    def _go_on(self, _: Mapping[str, Any]) -> dict[str, Any]:
        if self._phase != "running" or not self.pause.asked():
            return {"ok": False, "problem": f"the run is {self.state}; it is not paused"}
        self.pause.continue_remotely()
        return {"state": self.state}


@contextmanager
def owning(
    run: RequestedRun,
    stage: OwnedStage | None = None,
    config_file: Path | None = None,
    more_answers: Answers | None = None,
) -> Iterator[RunOwner]:
    """Announce a run, and record a stop that another process requests.

    stage: None for a virtual bench; the caller closes it, once no request can arrive. more_answers: handlers of
    further requests. If the run cannot be announced, it continues and prints that the panel cannot reach it. A stop
    is recorded, or refused, at any time between the announcement and its end.
    """
    into, config, virtual = run.into, run.config, stage is None
    out = into.out if isinstance(into, NewRun) else into.folder.path.parent
    owner = RunOwner(StopSwitch(stage, interrupt_main), virtual=virtual)
    about = Announcement(
        pid=os.getpid(),
        kind="run",
        virtual=virtual,
        ports=() if virtual else bench_ports(config),
        out=str(out.resolve()),
        protocol=run.script.name,
        config=None if config_file is None else str(config_file.resolve()),
        began_unix_s=WallClock().unix_s(),
    )
    with stoppable(), ExitStack() as announced:
        if stage is not None and (config.stop.kind != "off" or config.stop.inputs):
            owner.button = announced.enter_context(StopButton(config.stop, stage, owner.switch.stop))
        try:
            socket = announced.enter_context(ControlSocket(about, {**(more_answers or {}), **owner.answers}))
            owner.announce = lambda run: socket.tell(run=str(run.resolve()))
        except (OSError, filelock.Timeout) as error:
            complain(f"warning: the panel cannot reach this run: {error}")
        announced.callback(owner.record, run)
        try:
            owner.switch.begins()
            yield owner
        finally:
            owner.switch.over()  # ends a stop in progress, so that nothing interrupts its record


def make_report(finger: "Fingertip", run: Run, wall_s: float, ending: Mapping[str, str] | None) -> None:
    """Write the report of a run that has just ended. Raises OSError."""
    from rig.report.run_report import write_report

    write_report(run, finger, wall_s, ending)


def make_missing(finger: "Fingertip", run: Run) -> None:
    """Make the missing parts of a complete run's report. Raises OSError."""
    from rig.report.run_report import write_missing

    write_missing(run, finger)


def lacks_report(run: Run) -> bool:
    """Return whether the report, or data behind its figures, are missing."""
    from rig.report import run_report

    return run_report.lacks_report(run)


class AtTheTerminal:
    """Terminal session with Ctrl-C and a screen, which records a course for observers."""

    def __init__(
        self,
        pause: PauseRequest,
        watch: Watch,
        begins: Callable[[], None],
        course: Course | None,
        owner: RunOwner | None = None,
    ) -> None:
        self.watch, self.interrupted = watch, pause.asked
        self._pause, self._begins, self._course = pause, begins, course
        self._owner = owner or NoAttendant()
        self.stopped = self._owner.stopped

    @property
    def stopped_by(self) -> str:
        """Reason to record for an immediate stop."""
        return self._owner.stopped_by

    def begins(self, folder: RunFolder) -> None:
        """Open the course; a full disk does not end the run, since the journal reports it."""
        self._begins()
        self._owner.begins(folder)
        if self._course is not None:
            with suppress(OSError):
                self._course.save(folder)

    def go_on(self, meanwhile: Meanwhile) -> bool:
        """Return whether to continue, from the answer typed below the screen."""
        with screen_aside():
            return self._pause.go_on(meanwhile)


def new_run(out_dir: Path, subject: str | None) -> NewRun:
    """Return a new run for that folder; raise BadInputError before anything begins."""
    if out_dir.is_file():
        raise BadInputError(f"--out {out_dir}: this is a file; name a folder", "not_a_directory")
    if not may_write_below(out_dir):
        raise BadInputError(f"--out {out_dir}: must be a folder that you may write to", "not_writable")
    return NewRun(out_dir, checked_subject(subject))


def carry_out(
    run: RequestedRun,
    how: Callable[[Session], FinishedRun],
    owner: RunOwner,
    confirm: Confirm | None = None,
    pace: float | None = 1.0,
) -> FinishedRun:
    """Check the script, run or resume it, write its report, and print the location.

    `confirm` is called after all checks and before any motion; None starts at once. `pace` is real seconds per second
    of bench time; None runs as fast as possible.
    """
    spikes = run.spikes
    session = _planned(run)
    if spikes is not None:
        from rig.plan.nerve import firing_speeds_of, presses_of_plan

        with busy("when the afferents fire …"):  # it also refuses afferents that have no place
            speeds = asked(session.finger, firing_speeds_of, spikes, presses_of_plan(session.plan))
        print_firing(speeds)
    page = (confirm or nothing_to_confirm())(session)
    began = time.perf_counter()
    owner.at("running")
    course = None if isinstance(page.rehearsal, EngineError) else page.rehearsal.course
    shown = progress(len(session.plan.indentations), time_left(page, pace), course)
    with at_a_safe_point(owner.pause) as pause, shown as watch:
        attendant = AtTheTerminal(pause, watch, run.begins, course, owner)
        done = how(replace(session, attendant=attendant, button=owner.button))
    owner.at("reporting")
    added = None if spikes is None else _with_spikes(done, session.finger, spikes, run)
    with busy("writing the report …"):
        done = _reported(done, session.finger, owner)
    if added is not None and not writes_json():
        for line in spike_lines(added):
            out.print(line)
    _print(done, time.perf_counter() - began, resumed=run.stopped is not None)
    return done


def loaded(config: Config, finger: FingerProcess | None) -> Finger:
    """Load the configured finger, in its own process if one exists."""
    with busy(THE_FINGER):
        if finger is None:
            from sim.models.fingertip import Fingertip

            return Fingertip.load(config.finger)
        finger.ask(about_model)
        return finger


_MOST_DIFFERENCES = 3


def _planned(run: RequestedRun) -> Session:
    """Check the script, and print how it differs from that of the run that is resumed."""
    finger = run.loaded()
    with checking_the_script() as show_steps:
        plan = make_plan(run.script, run.config, finger, *run.before, show_steps)
    for difference in plan.differences[:_MOST_DIFFERENCES]:
        complain(f"the script differs from the resumed run: {difference}")
    return Session(run.script, run.config, finger, plan, run.into)


def make_whole(stopped: StoppedRun, run: Run, owner: RunOwner) -> FinishedRun:
    """Make the missing exports, report and checksums of a complete run; existing files stay unchanged."""
    folder, began = stopped.folder, time.perf_counter()
    done = FinishedRun(folder, run, Made(), 0.0, None, FinalPosition("not moved"))
    owner.folder = folder
    owner.at("reporting")
    done = _made_whole(done, stopped.config)
    _print(done, time.perf_counter() - began, resumed=True)
    return done


def _made_whole(done: FinishedRun, config: Config) -> FinishedRun:
    folder, run = done.folder, done.run
    with folder.owned():
        there = folder.files
        try:
            export_run(run, again=False)
            if lacks_report(run):
                asked(loaded(config, None), make_missing, run)
            folder.add_checksums(folder.files - there)
        except OSError as error:
            return replace(done, problem=error)
        except Exception as error:
            return replace(done, files_problem=error)
    return done


def _with_spikes(done: FinishedRun, finger: Finger, spikes: "SpikeRequest", run: RequestedRun) -> SpikesJson | None:
    """Write simulated spikes beside a run, or print that there are none for a run without a press."""
    try:
        return asked(finger, add_spikes, done.run, run.config, spikes)
    except (BadInputError, ModelRangeError, OSError) as error:
        complain(f"no spikes: {error}")
        return None


def _reported(done: FinishedRun, finger: Finger, owner: RunOwner) -> FinishedRun:
    """Add the report and the checksums; a write error becomes the problem of the run if it has no other."""
    ending = done.ending
    try:
        done.folder.write_checksums()
        if isinstance(done.recorded, RunError):
            return done
        asked(finger, make_report, done.run, done.wall_s, None if ending is None else ending.lines)
        done.folder.write_checksums()
    except (OSError, FingerLostError) as error:
        return replace(done, problem=done.problem or error)
    except KeyboardInterrupt:
        if not owner.stopped():
            raise
        at = replace(done.at, trusted=False)
        return replace(done, problem=done.problem or RunAborted(owner.stopped_by), at=at)
    except Exception as error:
        return replace(done, files_problem=done.files_problem or error)
    return done


def leave(done: FinishedRun) -> NoReturn:
    """End the command; if the run was stopped, print the reason in one line."""
    if done.problem is not None and done.ending is not None:
        reason = done.ending.reason
        complain(reason if reason.startswith("stopped") else f"stopped: {reason}")
    if done.files_problem is not None:
        complain(files_in_words(done.files_problem, done.folder))
    raise typer.Exit(_exit_code(done))


def files_in_words(problem: Exception, folder: RunFolder) -> str:
    """Return in one line why a run lacks files, and how to make them."""
    what = str(problem) if isinstance(problem, RigError) else f"{type(problem).__name__}: {problem}"
    again = f"rig export {shlex.quote(str(folder.path))} --csv --report"
    return f"the files of the run could not be written: {on_one_line(what)}; its journal is kept; then: {again}"


def _print(done: FinishedRun, wall_s: float, *, resumed: bool) -> None:
    run, ending, problem = (
        None if isinstance(done.recorded, RunError) else done.recorded,
        done.ending,
        done.files_problem,
    )
    report = str(done.folder.report) if done.folder.report.exists() else None
    chosen = None if run is None else choice_as_json(run)
    deviating = None if run is None else warning_of(deviations(run))
    otherwise = None if run is None else pressed_otherwise(run)
    if otherwise is not None:
        complain(otherwise)
    if writes_json():
        found: FinishedRunJson = {
            "run": str(done.folder.path),
            "complete": done.complete,
            "indentations": done.indentations,
            "duration_s": done.duration_s,
            "wall_s": wall_s,
            "report": report,
        }
        if chosen is not None:
            found["choice"] = chosen
        if run is not None and resumed:
            found["missing"], found["repeated"], found["restarted"] = run.missing, run.repeated, run.restarted
        if ending is not None:
            found["code"], found["ending"] = code_of_end(done), ending.as_json()
        if deviating is not None:
            found["deviation_text"] = deviating
        if otherwise is not None:
            found["otherwise_text"] = otherwise
        if problem is not None:
            found["files_text"] = files_in_words(problem, done.folder)
        print_json(found)
    else:
        out.print(
            f"{number_of(done.indentations, 'indentations')}, {done.duration_s:.0f} s of bench time "
            + (f"with all parts; this part took {wall_s:.1f} s" if resumed else f"in {wall_s:.1f} s")
        )
        if run is not None and resumed:
            out.print(f"{run.missing} missing, {run.repeated} repeated, {run.restarted} restarted")
        for some, limits in [] if run is None else motions_in_contact(run):
            out.print(f"{some}: {limits}")
        print_lines([] if chosen is None else choice_lines(chosen), 8)
        out.print(f"run     {done.folder.path}\nreport  {report or 'none'}")
        if deviating is not None:
            complain(deviating)
        print_lines({}.items() if ending is None else ending.lines.items(), 8)


def code_of_end(done: FinishedRun) -> str:
    """Return the code of a run that ended early."""
    return "incomplete" if done.problem is None else code_of(done.problem)


def _exit_code(done: FinishedRun) -> ExitCode:
    if isinstance(done.problem, OSError) or (done.problem is None and done.files_problem is not None):
        return ExitCode.BAD_INPUT
    if isinstance(done.problem, RunAborted):
        return ExitCode.ABORTED
    return ExitCode.DONE if done.complete and done.problem is None else ExitCode.STOPPED


def time_left(page: Page, pace: float | None, now: Callable[[], float] = time.perf_counter) -> TimeLeft | None:
    """Return the predicted time left, or None if the rehearsal did not finish."""
    if isinstance(page.rehearsal, EngineError):
        return None
    instants_s, duration_s = page.rehearsal.course.instants_s, page.rehearsal.duration_s
    if pace is not None:
        return TimeLeft(instants_s, duration_s, now, pace=pace)
    return TimeLeft(instants_s, duration_s, now, pace=page.took_s / max(duration_s, 1.0), measured=True)
