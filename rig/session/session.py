"""Sessions: carry out a script on the virtual bench or on real ports, up to a finished run folder."""

import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Protocol

from rig.bench.checks import refuse_expired
from rig.bench.real import Request, open_bench, refuse_silent_sensor
from rig.bench.sync_line import sync_line
from rig.bench.virtual import virtual_bench
from rig.clock import Clock, WallClock
from rig.control.owned_stage import OwnedStage
from rig.data import Run, RunError, RunFolder, export_run, new_run_folder, read_run
from rig.data.documents import last_document
from rig.data.events import STREAMS, is_last_hold, streams_with
from rig.data.folder import PLAN, UnwritableError
from rig.data.journal import ByteLog, Watch, add_to_end
from rig.data.run_status import RunStatus
from rig.data.tables import foreign_in_one_line
from rig.devices.registry import ForceKind, find
from rig.engine import Engine, Journal, Pause, RecordError, RunAborted, WatchedBench, verbs
from rig.engine.bench import Meanwhile
from rig.engine.limits import FingerStiffness
from rig.errors import LostRecordError
from rig.plan.config import Config
from rig.plan.finger_model import FingerModel, with_stored_file
from rig.plan.plan import Plan, predicted_bands
from rig.protocol.api import Handler, Rig
from rig.protocol.check import ScriptState
from rig.protocol.handlers import Patience, ResumeHandler
from rig.protocol.same_steps import as_lines
from rig.protocol.script import Script
from rig.session.early_ending import Ending, FinalPosition
from rig.session.execute import Live
from rig.session.hardware_stop import (
    BY_THE_BUTTON,
    StopButton,
    explained_by_stop_inputs,
    refuse_stop_inputs,
    stop_inputs_of,
)
from rig.session.lost_files import LostRun
from rig.session.resume import StoppedRun, first_reference_gwt, provenance
from rig.session.script_run import AT_ONCE, ENDINGS, run_script, stopped_at_once, with_trip
from rig.transport.wire import Sink
from sim.devices.clock import VirtualClock
from sim.finger_process import Finger, FingerProcess


class Attendant(Protocol):
    """Observer of a run, which sees every event, may request a pause or a stop, and decides whether to continue."""

    def stopped(self) -> bool:
        """Return whether another thread has stopped the stage; called after a failure."""
        return False

    @property
    def stopped_by(self) -> str:
        """The reason to record for a stop at once."""
        return AT_ONCE

    def begins(self, folder: RunFolder) -> None:
        """Note that ports are open and the journal in this folder has begun: motions may follow."""
        return

    def watch(self, stream: str, data: Mapping[str, Any]) -> None:
        """Note an event that is on disk."""
        return

    def interrupted(self) -> bool:
        """Return whether a pause is requested for the next safe point."""
        return False

    def go_on(self, meanwhile: Meanwhile) -> bool:
        """Return whether to continue after the pause."""
        return False


class NoAttendant(Attendant):
    """Observer that requests nothing."""


@dataclass(frozen=True)
class Made:
    """Number of finished and of planned indentations, and duration on the clock of the run (s)."""

    indentations: int = 0
    planned: int = 0
    duration_s: float = 0.0


@dataclass(frozen=True)
class FinishedRun:
    """Finished run: how it ended, and what its journal contains."""

    folder: RunFolder
    recorded: Run | RunError  # RunError: why the journal cannot be read
    made: Made  # as counted while the run went on
    wall_s: float
    problem: Exception | None  # error that ended the run early, or kept its files from being written
    at: FinalPosition  # final position of the indentor
    files_problem: Exception | None = None  # any other error of its files; the ending holds without them

    @property
    def run(self) -> Run:
        """The run, read from its journal. Raises RunError."""
        if isinstance(self.recorded, RunError):
            raise self.recorded
        return self.recorded

    @property
    def complete(self) -> bool:
        """Whether every planned indentation was done."""
        if isinstance(self.recorded, RunError):
            return self.problem is None and self.made.indentations >= self.made.planned
        return self.recorded.complete

    @property
    def indentations(self) -> int:
        """Number of finished indentations."""
        return self.made.indentations if isinstance(self.recorded, RunError) else len(self.recorded.done)

    @property
    def duration_s(self) -> float:
        """Duration on the clock of the run (s)."""
        return self.made.duration_s if isinstance(self.recorded, RunError) else self.recorded.duration_s

    @cached_property
    def ending(self) -> Ending | None:
        """Ending, unless the run ended normally."""
        if self.complete and self.problem is None:
            return None
        return Ending.of(self.problem, self.at, self.folder.path)


@dataclass(frozen=True)
class NewRun:
    """New run with its own folder in `out`; `subject` is the code of the participant."""

    out: Path
    subject: str | None = None

    @property
    def begins_at_s(self) -> float:
        """Time of the run (`t_s`) at its beginning."""
        return 0.0


@dataclass(frozen=True)
class Session:
    """Checked script, its configuration, finger and plan, and the run: new or resumed."""

    script: Script
    config: Config
    finger: Finger
    plan: Plan
    into: NewRun | StoppedRun
    attendant: Attendant = field(default_factory=NoAttendant)
    button: StopButton | None = None  # of a real run

    @property
    def before(self) -> Run | None:
        """Journal of the run that is resumed, or None."""
        return self.into.run if isinstance(self.into, StoppedRun) else None

    @property
    def pause(self) -> Pause:
        """Pause by Ctrl-C."""
        return Pause(self.attendant.interrupted, self.attendant.go_on)

    @property
    def stopped_by(self) -> str:
        """Reason of an immediate stop."""
        return BY_THE_BUTTON if self.button is not None and self.button.stopped else self.attendant.stopped_by

    @property
    def begins_at_s(self) -> float:
        """Time of the run (`t_s`) of a part that begins now."""
        return self.into.begins_at_s


def dry_run(session: Session, speed: float | None = None) -> FinishedRun:
    """Carry out a session on the virtual bench; `speed` limits virtual seconds per real second."""

    finger = session.finger
    assert not isinstance(finger, FingerProcess), "it is pressed here, by the virtual bench"

    def open_bench(folder: RunFolder, byte_log: Sink, start_unix_s: float) -> WatchedBench:
        clock = VirtualClock(start_unix_s, session.begins_at_s)
        bench = virtual_bench(session.config, finger, byte_log, clock, session.pause)
        return replace(bench, shape_files=folder.path)

    return run_on(session, open_bench, virtual=True, speed=speed)


def real_run(session: Session, ask: Callable[[Request], str], stage: OwnedStage) -> FinishedRun:
    """Carry out a session on the configured ports, with the stage already open.

    Raises BadInputError for a calibration out of date.
    """
    refuse_expired(session.config)

    def open_real_bench(_folder: RunFolder, byte_log: Sink, _start_unix_s: float) -> WatchedBench:
        stage.begin_run(session.begins_at_s)
        bench = open_bench(session.config, stage.clock, byte_log, ask, session.pause, stage)
        try:
            refuse_silent_sensor(bench)
        except BaseException:
            bench.close()
            raise
        return bench

    return run_on(session, open_real_bench, virtual=False)


def run_on(
    session: Session,
    open_bench: Callable[[RunFolder, Sink, float], WatchedBench],
    *,
    virtual: bool,
    speed: float | None = None,
) -> FinishedRun:
    """Carry out a session on a bench that is opened for it.

    A run that ends early has the reason in its journal and in `problem`, and is exported all the same.
    """
    began = time.perf_counter()
    now = datetime.now(UTC)
    folder = _folder(session, now, virtual=virtual)
    ended = PartEnd(None, FinalPosition("not moved"), None, Made())
    there = session.before is not None and session.before.complete
    with _removed_if_empty(session, folder), ExitStack() as owned:
        owned.enter_context(folder.owned())
        if not there:
            ended = _on_a_bench(session, folder, lambda log: open_bench(folder, log, now.timestamp()), speed)
        recorded: Run | RunError
        if ended.lost is not None:
            ended.problem = ended.problem or ended.lost.problem
            recorded = ended.lost.rescued(folder, ended.at)
            owned.enter_context(recorded.folder.owned())
        else:
            recorded = _recorded(folder)
        files_problem = None
        try:
            if isinstance(recorded, RunError):
                raise recorded
            export_run(recorded, again=not there)
        except OSError as error:
            ended.problem = ended.problem or error
        except Exception as error:
            files_problem = error
    return FinishedRun(
        folder if isinstance(recorded, RunError) else recorded.folder,
        recorded, ended.made, time.perf_counter() - began, ended.problem, ended.at, files_problem,
    )  # fmt: skip


def _recorded(folder: RunFolder) -> Run | RunError:
    """Return the run, or why its journal cannot be read."""
    try:
        with foreign_in_one_line(folder.path):
            return read_run(folder.path)
    except RunError as error:
        return error
    except Exception as error:
        problem = f"{type(error).__name__}: {error}"
        return RunError(f"run folder {folder.path}: {problem}", "bad_journal")


@dataclass
class PartEnd:
    """End of a part of a run: error that ended it early, final position, lost files, and what was made."""

    problem: Exception | None
    at: FinalPosition
    lost: LostRun | None
    made: Made


def _folder(session: Session, now: datetime, *, virtual: bool) -> RunFolder:
    """Return a new run folder, or that of the resumed run."""
    script, config, into = session.script, session.config, session.into
    if isinstance(into, StoppedRun):
        return into.folder
    about = provenance(script, config, session.finger, now, virtual=virtual, subject=into.subject)
    files = {**script.beside, **session.plan.shape_files, PLAN: as_lines(session.plan.asked)}
    return new_run_folder(into.out, script.name, now, script.path, config.as_toml(), about, files)


def _on_a_bench(
    session: Session, folder: RunFolder, open_bench: Callable[[Sink], WatchedBench], speed: float | None
) -> PartEnd:
    """Carry out the script."""
    session = replace(session, script=session.script.fresh())
    before = session.before
    contact_s, done = (0.0, set[int]()) if before is None else (before.contact_s, set(before.done))
    copies = folder.copies()
    with ByteLog(folder.bytes_log) as byte_log:
        bench = open_bench(byte_log)
        begun_s = bench.clock.monotonic_s()
        watch = byte_log.checked_before(_counted(done, _paced(session, bench.clock, speed)))
        with closing(bench), sync_line(session.config.sync, bench) as line:
            refuse_stop_inputs(session.config, bench)
            streams = streams_with(find(ForceKind, session.config.force.kind).also)
            journal = Journal(folder.events, bench.clock, streams, watch, bench.witness, virtual=bench.virtual)
            stiffness = FingerStiffness.of(session.plan.all_presses)
            engine = Engine(
                session.config, bench, journal, session.plan.soft_trip_n, contact_s, stiffness,
                memory=bench, stop_inputs=stop_inputs_of(session.config, session.button), sync_line=line,
                first_reference_gwt=None if before is None else first_reference_gwt(before),
            )  # fmt: skip
            journal.at_end = lambda: {"indentor": asdict(FinalPosition.of(engine))}
            journal.interrupted_by = lambda: session.stopped_by
            _begin(session, journal, virtual=bench.virtual)
            session.attendant.begins(folder)
            problem = _carry_out(session, journal, engine, _rig(session, folder, engine), bench)
        lasted_s = bench.clock.monotonic_s() - begun_s + (0.0 if before is None else before.duration_s)
        made = Made(len(done), len(session.plan.indentations), lasted_s)
        return PartEnd(problem, FinalPosition.of(engine), LostRun.of(folder, copies, journal, byte_log), made)


def _carry_out(session: Session, journal: Journal, engine: Engine, rig: Rig, bench: WatchedBench) -> Exception | None:
    try:
        with (
            journal,
            stopped_at_once(engine, session.attendant.stopped, lambda: session.stopped_by),
            explained_by_stop_inputs(session.config, bench.stage),
        ):
            with bench.monitor(engine.heartbeat), _measured_at_end(engine, session.attendant.stopped):
                verbs.leave_finger(engine, bench.before, resumed=session.before is not None)
                run_script(session.script, engine, rig)
            if session.attendant.stopped():  # The script has swallowed the interrupt.
                raise KeyboardInterrupt
            journal.stop("done")
    except ENDINGS as error:
        return error
    except KeyboardInterrupt:  # The stage was stopped; the journal is still worth a report.
        return RunAborted(with_trip(engine, session.stopped_by), "stopped_at_once")
    finally:
        if engine.contact.may_touch:
            with suppress(RecordError):  # The record already assumes contact.
                bench.touched(engine.known_contact)
    return None


@contextmanager
def _measured_at_end(engine: Engine, stopped: Callable[[], bool]) -> Iterator[None]:
    """Measure contact after an error, so that the ending reports the present state; a stop comes before all."""
    try:
        yield
    except Exception:
        if not stopped():
            with suppress(Exception):  # The error that ended the run is reported.
                engine.measure_at_end()
        raise


def _begin(session: Session, journal: Journal, *, virtual: bool) -> None:
    """Write the first document of the run, or of its next part. Raises UnwritableError before a motion."""
    before = session.before
    try:
        if before is None:
            journal.start(_about(session, virtual=virtual))
        else:
            journal.resume({"missing": before.missing, "after": before.last_checkpoint, **_button(session)})
    except RecordError as error:
        journal.close()
        cause = error.__cause__
        raise UnwritableError.of(
            journal.path, cause if isinstance(cause, OSError) else OSError(str(error))
        ) from error


@contextmanager
def _removed_if_empty(session: Session, folder: RunFolder) -> Iterator[None]:
    """Remove the folder of a new run that has journalled nothing."""
    try:
        yield
    except LostRecordError:  # What remains of a run must stay.
        raise
    except BaseException:
        begun = folder.events.exists() and folder.events.stat().st_size > 0
        if isinstance(session.into, NewRun) and not begun:
            shutil.rmtree(folder.path, ignore_errors=True)
        raise


def _rig(session: Session, folder: RunFolder, engine: Engine) -> Rig:
    """Return the script's rig on an engine; in a resumed run, one that does the remaining steps."""
    config, where = session.config, partial(with_stored_file, folder.path)
    state = ScriptState(config, FingerModel(session.finger, session.plan.predictions, where, config.identified))
    handler: Handler = Live(engine, state)
    if session.before is not None:
        handler = ResumeHandler(session.before, handler, config.habits.press_speed_mm_s)
    return Rig(session.script.parameters, state, Patience(handler))


def _about(session: Session, *, virtual: bool) -> dict[str, Any]:
    return {
        **_about_script(session.script, len(session.plan.indentations), session.into.subject, virtual=virtual),
        "soft_trip_n": session.plan.soft_trip_n,
        **_button(session),
        **({} if session.config.identified is None else {"promised": predicted_bands(session.plan)}),
    }


def _about_script(script: Script, planned: int, subject: str | None, *, virtual: bool) -> dict[str, Any]:
    return {
        "protocol": script.name,
        "title": script.title,
        "source": script.source,
        "parameters": script.parameters.model_dump(mode="json"),
        "planned_indentations": planned,
        "subject": subject,
        "virtual": virtual,
    }


def _button(session: Session) -> dict[str, Any]:
    return {} if session.button is None or not session.button.there else {"stop_button": session.button.as_json()}


def _counted(done: set[int], watch: Watch) -> Watch:
    """Return the watch, with the indices of finished indentations added to a set."""

    begun: Mapping[str, Any] = {}

    def counted(stream: str, data: Mapping[str, Any]) -> None:
        nonlocal begun
        if stream == "indentation_start":
            begun = data
        elif stream == "hold_end" and is_last_hold(data, begun):
            done.add(data["index"])
        watch(stream, data)

    return counted


def _paced(session: Session, clock: Clock, speed: float | None) -> Watch:
    """Return the session's watch, slowed down to `speed` virtual seconds per real second."""
    if speed is None:
        return session.attendant.watch
    wall = WallClock()
    start_s = wall.monotonic_s()

    def paced(stream: str, data: Mapping[str, Any]) -> None:
        wall.wait_until(session.attendant.interrupted, start_s + clock.monotonic_s() / speed)
        session.attendant.watch(stream, data)

    return paced


def record_before(
    script: Script,
    config: Config,
    into: NewRun | StoppedRun,
    *,
    virtual: bool,
    reason: str = AT_ONCE,
    clock: WallClock | None = None,
) -> RunFolder:
    """Record a run that was stopped during planning: aborted, without a motion.

    clock: clock of the byte log, if a port was open; the run begins where it began to count.

    The record is in a folder of its own, or the next part of the run to be resumed. Raises OSError, FolderBusyError.
    """
    if isinstance(into, NewRun):
        now = datetime.now(UTC)
        about = provenance(script, config, None, now, virtual=virtual, subject=into.subject)
        folder = new_run_folder(into.out, script.name, now, script.path, config.as_toml(), about, script.beside)
    else:
        folder = into.folder
    before = None if isinstance(into, NewRun) else into.run
    clock = clock or WallClock(into.begins_at_s)
    with folder.owned(), Journal(folder.events, clock, STREAMS, virtual=virtual) as journal:
        if before is None:
            journal.start(_about_script(script, 0, into.subject, virtual=virtual))
            at = FinalPosition("not moved")
        else:
            journal.resume({"missing": before.missing, "after": before.last_checkpoint})
            known = None if before.stop is None else before.stop.get("indentor")
            at = FinalPosition(**known) if known else FinalPosition.last_known(before)
        journal.at_end = lambda: {"indentor": asdict(at), "stopped_while": "planning"}
        journal.stop(RunStatus.ABORTED, reason)
    return folder


def record_after(folder: RunFolder, state: str, wire: str, reason: str = AT_ONCE) -> None:
    """Append the bytes of a stop, and the stop itself if the journal lacks it.

    The end of a finished run is repeated, with the state in which it was stopped. Raises OSError, FolderBusyError.
    """
    with folder.owned():
        with ByteLog(folder.bytes_log) as log:
            for line in wire.splitlines(keepends=True):
                log.write(line)
        last = last_document(folder.events)
        if last["doc"] != "stop":
            at = asdict(FinalPosition.last_known(read_run(folder.path)))
            end = {
                "doc": "stop",
                "status": RunStatus.ABORTED,
                "reason": reason,
                "indentor": at,
                "stopped_while": state,
            }
            add_to_end(folder.events, end, WallClock().unix_s())
        elif last["status"] != RunStatus.ABORTED or state == "reporting":
            add_to_end(folder.events, {"stopped_while": state}, WallClock().unix_s())
        folder.write_checksums()
