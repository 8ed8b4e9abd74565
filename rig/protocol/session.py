"""A dry-run from script to finished run folder."""

import platform
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rig.clock import WallClock
from rig.data import Run, RunFolder, export_run, new_run_folder, read_run
from rig.force.base import ForceError
from rig.protocol.config import Config
from rig.protocol.live import LiveRig
from rig.protocol.plan import CheckingRig, Plan
from rig.protocol.script import Script, where_in_script
from rig.protocol.virtual_bench import VirtualBench, virtual_bench
from rig.run import Engine, EngineError, Journal, ScriptError
from rig.run.streams import STREAMS
from rig.stage.base import StageError
from rig.transport.base import TransportError
from rig.units import GWT_N
from sim.fingertip import Fingertip

_SOFT_TRIP_OVER_PREDICTED = 2.0
_SMALLEST_SOFT_TRIP_N = 0.02

# The engine has lifted or stopped before it raises these.
_ENDINGS = (EngineError, StageError, ForceError, TransportError)

Watch = Callable[[str, Mapping[str, Any]], None]


@dataclass(frozen=True)
class DryRun:
    """A finished dry-run, as its journal tells it."""

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
        return len(self.run.stream("indentation_end"))

    @property
    def duration_s(self) -> float:
        """Seconds of the run's clock."""
        return self.run.duration_s


def dry_run(
    script: Script,
    config: Config,
    finger: Fingertip,
    plan: Plan,
    out: Path,
    *,
    interrupted: Callable[[], bool],
    watch: Watch = lambda stream, data: None,
    speed: float | None = None,
) -> DryRun:
    """Run a checked script on the virtual bench; `speed` limits virtual seconds per real second.

    A run that ends before its end has the reason in its journal and in `problem`, and is exported all the same.
    """
    began = time.perf_counter()
    now = datetime.now(UTC)
    folder = new_run_folder(
        out, script.name, now, script.path, config.as_toml(), _provenance(script, finger, config, now)
    )
    problem = None
    with folder.bytes_log.open("w", encoding="ascii") as byte_log:
        bench = virtual_bench(config, finger, byte_log, now.timestamp())
        try:
            _carry_out(
                script, config, finger, plan, folder, bench, interrupted, _paced(watch, bench, speed, interrupted)
            )
        except _ENDINGS as error:
            problem = error
    run = read_run(folder.path)
    export_run(run)
    return DryRun(run, time.perf_counter() - began, problem)


def _carry_out(
    script: Script,
    config: Config,
    finger: Fingertip,
    plan: Plan,
    folder: RunFolder,
    bench: VirtualBench,
    interrupted: Callable[[], bool],
    watch: Watch,
) -> None:
    with Journal(folder.events, bench.clock, STREAMS, watch) as journal:
        journal.start(
            {
                "protocol": script.name,
                "title": script.title,
                "source": script.source,
                "parameters": script.parameters.model_dump(mode="json"),
                "planned_indentations": len(plan.indentations),
                "virtual": True,
            }
        )
        soft_trip = max(_SOFT_TRIP_OVER_PREDICTED * plan.peak_force_gwt * GWT_N, _SMALLEST_SOFT_TRIP_N)
        engine = Engine(
            config, bench.clock, bench.stage, bench.force, journal, bench, interrupted, soft_trip_n=soft_trip
        )
        _run_script(script, engine, CheckingRig(script.parameters, config, finger))
        journal.stop("done")


def _run_script(script: Script, engine: Engine, check: CheckingRig) -> None:
    """Run it; a failure elsewhere than in the engine lifts the indentor, and no swallowed trip ends well."""
    try:
        script.run(LiveRig(engine, check))
    except _ENDINGS:
        raise
    except (Exception, SystemExit) as error:
        engine.make_safe()
        place = where_in_script(script.path, error)
        raise ScriptError(f"{place}: {type(error).__name__}: {error}") from error
    except BaseException:
        engine.stop()
        raise
    if engine.problem is not None:
        raise engine.problem


def _paced(watch: Watch, bench: VirtualBench, speed: float | None, interrupted: Callable[[], bool]) -> Watch:
    """`watch`, waiting where the virtual clock has run ahead of `speed` times real time."""
    if speed is None:
        return watch
    wall = WallClock()
    start_s = wall.monotonic_s()

    def paced(stream: str, data: Mapping[str, Any]) -> None:
        wall.wait_until(interrupted, start_s + bench.clock.monotonic_s() / speed)
        watch(stream, data)

    return paced


def _provenance(script: Script, finger: Fingertip, config: Config, now: datetime) -> dict[str, Any]:
    packages = ("indentation-rig", "numpy", "scipy", "h5py", "pydantic", "matplotlib")
    return {
        "started_utc": now.isoformat(timespec="seconds"),
        "command": ["rig", *sys.argv[1:]],
        "protocol": script.path.name,
        "parameters": script.parameters.model_dump(mode="json"),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "versions": {name: version(name) for name in packages},
        "model": {
            "nodes": finger.model.nodes,
            "e_epidermis_mpa": finger.e_epidermis_mpa,
            "from_cache": finger.from_cache,
        },
        "devices": {"stage": f"virtual {config.stage.kind}", "force": f"virtual {config.force.kind}"},
    }
