"""Carry a script out, on the virtual bench or on real ports, to a finished run folder."""

import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from rig.bench.checks import refuse_expired
from rig.bench.real import open_bench
from rig.bench.virtual import virtual_bench
from rig.clock import Clock, WallClock
from rig.control.stop import StageInHand
from rig.data import Run, RunFolder, export_run, new_run_folder, read_run
from rig.data.folder import UnwritableError
from rig.data.journal import ByteLog, Watch, add_to_end, read_journal
from rig.data.schema import STREAMS
from rig.engine import Engine, Journal, Pause, RecordError, RunAborted, WatchedBench, verbs
from rig.errors import LostRecordError
from rig.plan.config import Config
from rig.plan.finger_model import FingerModel, kept_in
from rig.plan.plan import Plan, promised
from rig.protocol.api import Handler, Rig
from rig.protocol.check import Walk
from rig.protocol.handlers import Patience, TakenUp
from rig.protocol.script import Script
from rig.session.early_ending import Ending, FinalPosition
from rig.session.execute import Live
from rig.session.lost_files import LostRun
from rig.session.resume import StoppedRun, first_reference_gwt, provenance
from rig.session.script_run import AT_ONCE, ENDINGS, run_script, stopped_at_once
from rig.session.stop_button import BY_THE_BUTTON, StopButton, refuse_stop_inputs, stop_inputs_heeded
from rig.transport.wire import Sink
from sim.devices.clock import VirtualClock
from sim.finger_process import Finger, FingerProcess


class Attendant(Protocol):
    """Whoever looks on: sees every event, may ask for a pause or stop, and says whether to go on after a pause."""

    def stopped(self) -> bool:
        """Whether somebody has stopped the stage from another thread; asked where something has failed."""

    @property
    def stopped_by(self) -> str:
        """The reason to record for a stop at once."""

    def begins(self, folder: RunFolder) -> None:
        """Ports are open and the journal in this folder has begun: from now on something may move."""

    def watch(self, stream: str, data: Mapping[str, Any]) -> None:
        """An event is on disk."""

    def interrupted(self) -> bool:
        """Whether a pause is asked for at the next safe point."""

    def go_on(self) -> bool:
        """Whether the run goes on after the pause."""


class Nobody:
    """Looks on and asks for nothing."""

    def stopped(self) -> bool:
        """No."""
        return False

    @property
    def stopped_by(self) -> str:
        """The reason to record for a stop at once."""
        return AT_ONCE

    def begins(self, folder: RunFolder) -> None:
        """Nothing comes of it."""

    def watch(self, stream: str, data: Mapping[str, Any]) -> None:
        """Nothing comes of it."""

    def interrupted(self) -> bool:
        """No."""
        return False

    def go_on(self) -> bool:
        """No."""
        return False


@dataclass(frozen=True)
class FinishedRun:
    """A finished run, as its journal tells it."""

    run: Run
    wall_s: float
    problem: Exception | None  # what ended it before its end, or kept its files from being written
    at: FinalPosition  # where that left the indentor

    @property
    def folder(self) -> RunFolder:
        """Where it lies."""
        return self.run.folder

    @property
    def complete(self) -> bool:
        """Whether every planned indentation was done."""
        return self.run.complete

    @property
    def indentations(self) -> int:
        """How many were finished."""
        return len(self.run.done)

    @property
    def duration_s(self) -> float:
        """Seconds of the run's clock."""
        return self.run.duration_s

    @property
    def ending(self) -> Ending | None:
        """What is to be said of any end but the right one."""
        if self.complete and self.problem is None:
            return None
        return Ending.of(self.problem, self.at, self.folder.path)


@dataclass(frozen=True)
class NewRun:
    """A run that gets a folder of its own in `out`; `subject` is the code of whoever lies under the rig."""

    out: Path
    subject: str | None = None

    @property
    def begins_at_s(self) -> float:
        """The first instant of its clock."""
        return 0.0


@dataclass(frozen=True)
class Session:
    """One checked script, what it was checked against, and the run that comes of it: a new one, or one taken up."""

    script: Script
    config: Config
    finger: Finger
    plan: Plan
    into: NewRun | StoppedRun
    attendant: Attendant = field(default_factory=Nobody)
    handler: Callable[[Engine, Walk], Handler] = Live  # what carries its steps out
    button: StopButton | None = None  # of a real run

    @property
    def before(self) -> Run | None:
        """What the run that is taken up has journalled."""
        return self.into.run if isinstance(self.into, StoppedRun) else None

    @property
    def pause(self) -> Pause:
        """Ctrl-C and what follows it."""
        return Pause(self.attendant.interrupted, self.attendant.go_on)

    @property
    def stopped_by(self) -> str:
        """Who stopped it at once, where somebody did."""
        return BY_THE_BUTTON if self.button is not None and self.button.stopped else self.attendant.stopped_by

    @property
    def begins_at_s(self) -> float:
        """The first instant of the run's clock."""
        return self.into.begins_at_s


def dry_run(session: Session, speed: float | None = None) -> FinishedRun:
    """Carry it out on the virtual bench; `speed` limits virtual seconds per real second."""

    finger = session.finger
    assert not isinstance(finger, FingerProcess), "it is pressed here, by the virtual bench"

    def open_bench(folder: RunFolder, byte_log: Sink, start_unix_s: float) -> WatchedBench:
        clock = VirtualClock(start_unix_s, session.begins_at_s)
        bench = virtual_bench(session.config, finger, byte_log, clock, session.pause)
        return replace(bench, shape_files=folder.path)

    return run_on(session, open_bench, virtual=True, speed=speed)


def real_run(session: Session, ask: Callable[[str], str], stage: StageInHand) -> FinishedRun:
    """Carry it out on the ports of the configuration; that of the stage is open already.

    Raises BadInputError for a calibration out of date.
    """
    refuse_expired(session.config)

    def open_real_bench(_folder: RunFolder, byte_log: Sink, _start_unix_s: float) -> WatchedBench:
        return open_bench(session.config, stage.clock, byte_log, ask, session.pause, stage)

    return run_on(session, open_real_bench, virtual=False)


def run_on(
    session: Session,
    open_bench: Callable[[RunFolder, Sink, float], WatchedBench],
    *,
    virtual: bool,
    speed: float | None = None,
) -> FinishedRun:
    """Carry it out on a bench that is opened for it.

    A run that ends before its end has the reason in its journal and in `problem`, and is exported all the same.
    """
    began = time.perf_counter()
    now = datetime.now(UTC)
    folder = _folder(session, now, virtual=virtual)
    problem, at, lost = None, FinalPosition("not moved"), None
    there = session.before is not None and session.before.complete
    with _nothing_left(session, folder), ExitStack() as owned:
        owned.enter_context(folder.owned())
        if not there:
            problem, at, lost = _on_a_bench(
                session, folder, lambda log: open_bench(folder, log, now.timestamp()), speed
            )
        if lost is not None:
            problem = problem or lost.problem
            run = lost.rescued(folder, at)
            owned.enter_context(run.folder.owned())
        else:
            run = read_run(folder.path)
        try:
            export_run(run, again=not there)
        except OSError as error:
            problem = problem or error
    return FinishedRun(run, time.perf_counter() - began, problem, at)


def _folder(session: Session, now: datetime, *, virtual: bool) -> RunFolder:
    """A new one, or that of the run that is taken up."""
    script, config, into = session.script, session.config, session.into
    if isinstance(into, StoppedRun):
        return into.folder
    about = provenance(script, config, session.finger, now, virtual=virtual, subject=into.subject)
    return new_run_folder(into.out, script.name, now, script.path, config.as_toml(), about, session.plan.shape_files)


def _on_a_bench(
    session: Session, folder: RunFolder, open_bench: Callable[[Sink], WatchedBench], speed: float | None
) -> tuple[Exception | None, FinalPosition, LostRun | None]:
    """Carry the script out; returns what ended it before its end, where that left the indentor, and what is lost."""
    contact_s = 0.0 if session.before is None else session.before.contact_s
    copies = folder.copies()
    with ByteLog(folder.bytes_log) as byte_log:
        bench = open_bench(byte_log)
        watch = byte_log.checked_before(_paced(session, bench.clock, speed))
        with closing(bench):
            refuse_stop_inputs(session.config, bench)
            journal = Journal(folder.events, bench.clock, STREAMS, watch, bench.witness, virtual=bench.virtual)
            engine = Engine(session.config, bench, journal, session.plan.soft_trip_n, contact_s)
            engine.keep_contact = bench.touched
            journal.at_end = lambda: {"indentor": asdict(FinalPosition.of(engine))}
            journal.interrupted_by = lambda: session.stopped_by
            _begin(session, journal, virtual=bench.virtual)
            session.attendant.begins(folder)
            problem = _carry_out(session, journal, engine, _rig(session, folder, engine), bench)
        return problem, FinalPosition.of(engine), LostRun.of(folder, copies, journal, byte_log)


def _carry_out(session: Session, journal: Journal, engine: Engine, rig: Rig, bench: WatchedBench) -> Exception | None:
    try:
        with (
            journal,
            stopped_at_once(engine, session.attendant.stopped, lambda: session.stopped_by),
            stop_inputs_heeded(session.config, engine, session.button),
        ):
            with bench.look_after(engine.heartbeat):
                verbs.leave_finger(engine, bench.before, resumed=session.before is not None)
                run_script(session.script, engine, rig)
            journal.stop("done")
    except ENDINGS as error:
        return error
    except KeyboardInterrupt:  # the stage has been stopped; what is on disk is still worth a report
        return RunAborted("{stopped_by}", code="stopped_at_once", stopped_by=session.stopped_by)
    finally:
        bench.left_with(engine.sensing.zero)
        if engine.may_touch:
            with suppress(RecordError):  # it says already that the finger may be touched
                bench.touched(engine.known_contact)
    return None


def _begin(session: Session, journal: Journal, *, virtual: bool) -> None:
    """The first document of the run, or of its next part. Raises UnwritableError; nothing has moved."""
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
def _nothing_left(session: Session, folder: RunFolder) -> Iterator[None]:
    """A new run that has journalled nothing leaves no folder behind."""
    try:
        yield
    except LostRecordError:  # there was a run, and what is left of it stays
        raise
    except BaseException:
        begun = folder.events.exists() and folder.events.stat().st_size > 0
        if isinstance(session.into, NewRun) and not begun:
            shutil.rmtree(folder.path, ignore_errors=True)
        raise


def _rig(session: Session, folder: RunFolder, engine: Engine) -> Rig:
    """The script's rig on an engine; in a run that is taken up, one that does what is missing."""
    config, where = session.config, partial(kept_in, folder.path)
    walk = Walk(config, FingerModel(session.finger, session.plan.predictions, where, config.met))
    handler = session.handler(engine, walk)
    if session.before is not None:
        engine.first_reference_gwt = first_reference_gwt(session.before)
        handler = TakenUp(session.before, handler)
    return Rig(session.script.parameters, walk, Patience(handler))


def _about(session: Session, *, virtual: bool) -> dict[str, Any]:
    script = session.script
    return {
        "protocol": script.name,
        "title": script.title,
        "source": script.source,
        "parameters": script.parameters.model_dump(mode="json"),
        "planned_indentations": len(session.plan.indentations),
        "soft_trip_n": session.plan.soft_trip_n,
        "subject": session.into.subject,
        "virtual": virtual,
        **_button(session),
        **({} if session.config.met is None else {"promised": promised(session.plan)}),
    }


def _button(session: Session) -> dict[str, Any]:
    return {} if session.button is None or not session.button.there else {"stop_button": session.button.as_json()}


def _paced(session: Session, clock: Clock, speed: float | None) -> Watch:
    """The session's watch, waiting where the virtual clock has run ahead of `speed` times real time."""
    if speed is None:
        return session.attendant.watch
    wall = WallClock()
    start_s = wall.monotonic_s()

    def paced(stream: str, data: Mapping[str, Any]) -> None:
        wall.wait_until(session.attendant.interrupted, start_s + clock.monotonic_s() / speed)
        session.attendant.watch(stream, data)

    return paced


def record_before(
    script: Script, config: Config, into: NewRun | StoppedRun, *, virtual: bool, reason: str = AT_ONCE
) -> RunFolder:
    """A run that was stopped while it was planned: aborted, and nothing moved.

    In a folder of its own, or as one part more of the run that was to be taken up. Raises OSError, FolderBusyError.
    """
    if isinstance(into, NewRun):
        now = datetime.now(UTC)
        about = provenance(script, config, None, now, virtual=virtual, subject=into.subject)
        folder = new_run_folder(into.out, script.name, now, script.path, config.as_toml(), about)
    else:
        folder = into.folder
    before = None if isinstance(into, NewRun) else into.run
    clock = WallClock(into.begins_at_s)
    with folder.owned(), Journal(folder.events, clock, STREAMS, virtual=virtual) as journal:
        if before is None:
            journal.start(
                {
                    "protocol": script.name,
                    "title": script.title,
                    "source": script.source,
                    "parameters": script.parameters.model_dump(mode="json"),
                    "planned_indentations": 0,
                    "subject": into.subject,
                    "virtual": virtual,
                }
            )
            at = FinalPosition("not moved")
        else:
            journal.resume({"missing": before.missing, "after": before.last_checkpoint})
            known = None if before.stop is None else before.stop.get("indentor")
            at = FinalPosition(**known) if known else FinalPosition.last_known(before)
        journal.at_end = lambda: {"indentor": asdict(at), "stopped_while": "planning"}
        journal.stop("aborted", reason)
    return folder


def record_after(folder: RunFolder, state: str, wire: str, reason: str = AT_ONCE) -> None:
    """The bytes of a stop, and the stop itself where the run's last document does not say it.

    A run that had ended stays what it was: its end is said again, with the state that it was stopped in.
    Raises OSError, FolderBusyError.
    """
    with folder.owned():
        with ByteLog(folder.bytes_log) as log:
            for line in wire.splitlines(keepends=True):
                log.write(line)
        *_, last = read_journal(folder.events)
        if last["doc"] != "stop":
            at = asdict(FinalPosition.last_known(read_run(folder.path)))
            end = {"doc": "stop", "status": "aborted", "reason": reason, "indentor": at, "stopped_while": state}
            add_to_end(folder.events, end, WallClock().unix_s())
        elif last["status"] != "aborted" or state == "reporting":
            add_to_end(folder.events, {"stopped_while": state}, WallClock().unix_s())
        folder.write_checksums()
