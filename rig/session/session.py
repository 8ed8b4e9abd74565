"""A script carried out, on the virtual bench or on real ports, from its check to a finished run folder."""

import shutil
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol, TextIO

from rig.data import Run, RunFolder, export_run, new_run_folder, read_run
from rig.devices.bench import open_bench
from rig.devices.force.base import ForceSensor
from rig.devices.heartbeat import Heartbeat
from rig.devices.stage.base import Stage
from rig.engine import Engine, Journal, Operator, RunAborted
from rig.engine.streams import STREAMS
from rig.plan.config import Config
from rig.plan.plan import CheckingRig
from rig.plan.planned import Plan
from rig.protocol.errors import BadInputError
from rig.protocol.script import Script
from rig.session.calibration import refuse_expired
from rig.session.live import LiveRig
from rig.session.provenance import provenance
from rig.session.resume import ResumedRig, StoppedRun
from rig.session.running import ENDINGS, run_script
from rig.transport.base import TransportError
from rig.transport.clock import Clock, WallClock
from rig.virtual.virtual_bench import virtual_bench
from sim.models.fingertip import Fingertip

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


class Bench(Operator, Protocol):
    """Where a script is carried out: clock, devices, and whoever mounts the indentors."""

    @property
    def clock(self) -> Clock: ...

    @property
    def stage(self) -> Stage: ...

    @property
    def force(self) -> ForceSensor: ...

    @property
    def virtual(self) -> bool: ...

    def look_after(self, heartbeat: Heartbeat) -> AbstractContextManager[None]:
        """Have the heartbeat looked at, whatever the engine waits for."""

    def close(self) -> None: ...


@dataclass(frozen=True)
class Session:
    """One checked script with everything it needs to be carried out.

    `out` is the parent of the folder that a new run gets; `stopped` is the run that is taken up instead; `subject`
    is the code of whoever lies under the rig.
    """

    script: Script
    config: Config
    finger: Fingertip
    plan: Plan
    out: Path
    interrupted: Callable[[], bool]
    watch: Watch = lambda stream, data: None
    go_on: Callable[[], bool] = lambda: False
    stopped: StoppedRun | None = None
    subject: str | None = None

    @property
    def begins_at_s(self) -> float:
        """The first instant of the run's clock."""
        run = None if self.stopped is None else self.stopped.run
        return 0.0 if run is None else run.end_s


def dry_run(session: Session, speed: float | None = None) -> FinishedRun:
    """Carry it out on the virtual bench; `speed` limits virtual seconds per real second."""

    def open_bench(byte_log: TextIO, start_unix_s: float) -> Bench:
        return virtual_bench(session.config, session.finger, byte_log, start_unix_s, session.begins_at_s)

    return _run_session(session, open_bench, virtual=True, speed=speed)


def real_run(session: Session, ask: Callable[[str], str]) -> FinishedRun:
    """Carry it out on the ports of the configuration. Raises BadInputError for a calibration out of date."""
    refuse_expired(session.config)

    def open_real_bench(byte_log: TextIO, _start_unix_s: float) -> Bench:
        return open_bench(session.config, ask, byte_log, session.begins_at_s)

    return _run_session(session, open_real_bench, virtual=False)


def _run_session(
    session: Session, open_bench: Callable[[TextIO, float], Bench], *, virtual: bool, speed: float | None = None
) -> FinishedRun:
    """A run that ends before its end has the reason in its journal and in `problem`, and is exported all the same."""
    began = time.perf_counter()
    now = datetime.now(UTC)
    folder = session.stopped.folder if session.stopped else _new_folder(session, now, virtual=virtual)
    problem: Exception | None = None
    with folder.owned():
        if session.stopped is None or not session.stopped.complete:
            problem = _on_a_bench(session, folder, lambda log: open_bench(log, now.timestamp()), speed)
        run = read_run(folder.path)
        export_run(run)
    return FinishedRun(run, time.perf_counter() - began, problem)


def _new_folder(session: Session, now: datetime, *, virtual: bool) -> RunFolder:
    script, config = session.script, session.config
    about = provenance(script, config, session.finger, now, virtual=virtual, subject=session.subject)
    return new_run_folder(session.out, script.name, now, script.path, config.as_toml(), about)


def _on_a_bench(
    session: Session, folder: RunFolder, open_bench: Callable[[TextIO], Bench], speed: float | None
) -> Exception | None:
    """Carry the script out; returns what ended it before its end."""
    with folder.bytes_log.open("a", encoding="ascii", buffering=1) as byte_log:
        try:
            bench = open_bench(byte_log)
        except (TransportError, BadInputError):
            if session.stopped is None:
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


def _carry_out(session: Session, folder: RunFolder, bench: Bench, watch: Watch) -> None:
    script, config, plan = session.script, session.config, session.plan
    before = None if session.stopped is None else session.stopped.run
    heartbeat = Heartbeat(bench.clock)
    with Journal(folder.events, bench.clock, STREAMS, watch) as journal, bench.look_after(heartbeat):
        if before is None:
            journal.start(_about(session, virtual=bench.virtual))
        else:
            journal.resume({"missing": before.missing, "after": before.last_checkpoint})
        engine = Engine(
            config,
            bench.clock,
            bench.stage,
            bench.force,
            journal,
            bench,
            session.interrupted,
            plan.soft_trip_n,
            session.go_on,
            heartbeat,
            contact_s=0.0 if before is None else before.contact_s,
        )
        check = CheckingRig(script.parameters, config, session.finger)
        if before is None:
            run_script(script, engine, LiveRig(engine, check))
        else:
            bench.confirm("the rig stopped in this run: clear the finger, see to what stopped it; it will home")
            engine.home()
            run_script(script, engine, ResumedRig(engine, check, before))
        journal.stop("done")


def _about(session: Session, *, virtual: bool) -> dict[str, Any]:
    script = session.script
    return {
        "protocol": script.name,
        "title": script.title,
        "source": script.source,
        "parameters": script.parameters.model_dump(mode="json"),
        "planned_indentations": len(session.plan.indentations),
        "subject": session.subject,
        "virtual": virtual,
    }


def _paced(session: Session, clock: Clock, speed: float | None) -> Watch:
    """The session's watch, waiting where the virtual clock has run ahead of `speed` times real time."""
    if speed is None:
        return session.watch
    wall = WallClock()
    start_s = wall.monotonic_s()

    def paced(stream: str, data: Mapping[str, Any]) -> None:
        wall.wait_until(session.interrupted, start_s + clock.monotonic_s() / speed)
        session.watch(stream, data)

    return paced
