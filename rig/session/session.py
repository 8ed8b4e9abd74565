"""A script carried out, on the virtual bench or on real ports, from its check to a finished run folder."""

import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TextIO

from rig.data import Run, RunFolder, export_run, new_run_folder, read_run
from rig.engine import Engine, Journal, Pause, RunAborted, WatchedBench, verbs
from rig.engine.pressing.reference import Reference
from rig.engine.streams import STREAMS
from rig.plan.config import Config
from rig.plan.finger_model import FingerModel
from rig.plan.plan import Plan
from rig.protocol.api import Handler, Rig
from rig.protocol.errors import BadInputError
from rig.protocol.script import Script
from rig.protocol.taken_up import TakenUp
from rig.protocol.walk import Walk
from rig.session.attendant import Attendant, Nobody
from rig.session.calibration import refuse_expired
from rig.session.live import Live
from rig.session.provenance import provenance
from rig.session.real_bench import open_bench
from rig.session.resume import StoppedRun, first_reference_gwt
from rig.session.running import ENDINGS, run_script
from rig.transport.base import TransportError
from rig.transport.clock import Clock, WallClock
from rig.virtual.virtual_bench import virtual_bench
from sim.devices.clock import VirtualClock
from sim.models.fingertip import Fingertip

_TAKEN_UP = "the rig stopped in this run: clear the finger, see to what stopped it; it will home"

Watch = Callable[[str, Mapping[str, Any]], None]


@dataclass(frozen=True)
class FinishedRun:
    """A finished run, as its journal tells it."""

    run: Run
    wall_s: float
    problem: Exception | None  # what ended it before its end

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


@dataclass(frozen=True)
class NewRun:
    """A run that gets a folder of its own in `out`; `subject` is the code of whoever lies under the rig."""

    out: Path
    subject: str | None = None


@dataclass(frozen=True)
class Session:
    """One checked script, what it was checked against, and the run that comes of it: a new one, or one taken up."""

    script: Script
    config: Config
    finger: Fingertip
    plan: Plan
    into: NewRun | StoppedRun
    attendant: Attendant = field(default_factory=Nobody)

    @property
    def before(self) -> Run | None:
        """What the run that is taken up has journalled."""
        return self.into.run if isinstance(self.into, StoppedRun) else None

    @property
    def pause(self) -> Pause:
        """Ctrl-C and what follows it."""
        return Pause(self.attendant.interrupted, self.attendant.go_on)

    @property
    def begins_at_s(self) -> float:
        """The first instant of the run's clock."""
        return 0.0 if self.before is None else self.before.end_s


def dry_run(session: Session, speed: float | None = None) -> FinishedRun:
    """Carry it out on the virtual bench; `speed` limits virtual seconds per real second."""

    def open_bench(byte_log: TextIO, start_unix_s: float) -> WatchedBench:
        clock = VirtualClock(start_unix_s, session.begins_at_s)
        return virtual_bench(session.config, session.finger, byte_log, clock, session.pause)

    return _run_session(session, open_bench, virtual=True, speed=speed)


def real_run(session: Session, ask: Callable[[str], str]) -> FinishedRun:
    """Carry it out on the ports of the configuration. Raises BadInputError for a calibration out of date."""
    refuse_expired(session.config)

    def open_real_bench(byte_log: TextIO, _start_unix_s: float) -> WatchedBench:
        return open_bench(session.config, WallClock(session.begins_at_s), byte_log, ask, session.pause)

    return _run_session(session, open_real_bench, virtual=False)


def _run_session(
    session: Session,
    open_bench: Callable[[TextIO, float], WatchedBench],
    *,
    virtual: bool,
    speed: float | None = None,
) -> FinishedRun:
    """A run that ends before its end has the reason in its journal and in `problem`, and is exported all the same."""
    began = time.perf_counter()
    now = datetime.now(UTC)
    folder = _folder(session, now, virtual=virtual)
    problem: Exception | None = None
    with folder.owned():
        if session.before is None or not session.before.complete:
            problem = _on_a_bench(session, folder, lambda log: open_bench(log, now.timestamp()), speed)
        run = read_run(folder.path)
        export_run(run)
    return FinishedRun(run, time.perf_counter() - began, problem)


def _folder(session: Session, now: datetime, *, virtual: bool) -> RunFolder:
    """A new one, or that of the run that is taken up."""
    script, config, into = session.script, session.config, session.into
    if isinstance(into, StoppedRun):
        return into.folder
    about = provenance(script, config, session.finger, now, virtual=virtual, subject=into.subject)
    return new_run_folder(into.out, script.name, now, script.path, config.as_toml(), about)


def _on_a_bench(
    session: Session, folder: RunFolder, open_bench: Callable[[TextIO], WatchedBench], speed: float | None
) -> Exception | None:
    """Carry the script out; returns what ended it before its end."""
    with folder.bytes_log.open("a", encoding="ascii", buffering=1) as byte_log:
        try:
            bench = open_bench(byte_log)
        except (TransportError, BadInputError):
            if isinstance(session.into, NewRun):
                shutil.rmtree(folder.path)  # nothing has happened
            raise
        try:
            _carry_out(session, folder, bench, _paced(session, bench.clock, speed))
        except ENDINGS as error:
            return error
        except KeyboardInterrupt:  # the stage has been stopped; what is on disk is still worth a report
            return RunAborted("at once, by the operator")
        finally:
            bench.close()
    return None


def _carry_out(session: Session, folder: RunFolder, bench: WatchedBench, watch: Watch) -> None:
    before = session.before
    contact_s = 0.0 if before is None else before.contact_s
    with Journal(folder.events, bench.clock, STREAMS, watch, bench.witness) as journal:
        engine = Engine(session.config, bench, journal, session.plan.soft_trip_n, contact_s)
        if before is None:
            journal.start(_about(session, virtual=bench.virtual))
        else:
            journal.resume({"missing": before.missing, "after": before.last_checkpoint})
        with bench.look_after(engine.heartbeat):
            if before is not None:
                bench.operator.confirm(_TAKEN_UP)
                verbs.home(engine)
            run_script(session.script, engine, _rig(session, engine))
        journal.stop("done")


def _rig(session: Session, engine: Engine) -> Rig:
    """The script's rig on an engine; in a run that is taken up, one that does what is missing."""
    walk = Walk(session.config, FingerModel(session.finger, session.plan.predictions))
    handler: Handler = Live(engine, walk)
    if session.before is not None:
        walk.reference = Reference(first_reference_gwt(session.before))
        handler = TakenUp(session.before, handler)
    return Rig(session.script.parameters, walk, handler)


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
    }


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
