"""Kill a run again and again, `kill -9`, and take it up each time: is anything missing, or done twice?

Half of the kills fall on writes of the journal (before, in the middle of, after one, before and after it is on disk),
half on instants of the bench's clock, both spread evenly over the run; every fourth run is killed a second time while
it is being taken up. Each run is a process of its own, forked with the finger loaded.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # a fork takes no threads along

import argparse
import json
import random
import signal
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rig.session.session as sessions
from rig.data import Run, read_run
from rig.engine.journal import Journal, read_journal
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import Script, load_script
from rig.session.resume import StoppedRun, read_stopped
from rig.session.session import NewRun, Session, dry_run
from rig.virtual.virtual_bench import virtual_bench
from sim.models.fingertip import Fingertip

SCRIPT = """\
import random
from rig.protocol import Rig

def run(rig: Rig) -> None:
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    places = [-0.5, 0.0, 0.5, 1.0]
    random.Random(5).shuffle(places)
    for x_mm in places:
        rig.move_to(x_mm=x_mm)
        rig.indent(force_gwt=1.0, increments=2, hold_s=0.1)
"""
STAGES = ("before the write", "half written", "before the flush", "on disk")


@dataclass(frozen=True)
class Kill:
    """Where a run ends: at a write of the journal, or at an instant of the bench's clock (s)."""

    write: int | None = None
    stage: str = STAGES[0]
    t_s: float | None = None

    @property
    def kind(self) -> str:
        """For the histogram."""
        return "motion" if self.write is None else f"journal, {self.stage}"


def kill_now() -> None:
    """No handler, no buffer flushed, nothing closed."""
    os.kill(os.getpid(), signal.SIGKILL)


def arm(kill: Kill) -> None:
    """Have this process killed there."""
    if kill.t_s is not None:
        _arm_clock(kill.t_s)
        return
    append, left = Journal._append, [kill.write]

    def deadly(journal: Journal, line: bytes) -> None:
        if left[0]:
            left[0] -= 1
            append(journal, line)
            return
        if kill.stage == "on disk":
            append(journal, line)
        else:
            journal._file.write(
                {"half written": line[: len(line) // 2], "before the flush": line}.get(kill.stage, b"")
            )
        kill_now()

    Journal._append = deadly  # type: ignore[method-assign, assignment]


def _arm_clock(t_s: float) -> None:
    make = virtual_bench

    def deadly(*arguments: Any) -> Any:
        bench = make(*arguments)
        bench.clock.call_at(bench.clock.monotonic_s() + t_s, kill_now)
        return bench

    sessions.virtual_bench = deadly  # type: ignore[attr-defined, assignment]


class Trials:
    """The script on the loaded finger, run and taken up in forked processes."""

    def __init__(self, folder: Path, finger: Fingertip) -> None:
        path = folder / "four.py"
        path.write_text(SCRIPT, encoding="utf-8")
        self._folder, self._finger, self._script = folder, finger, load_script(str(path))
        self._plan = make_plan(self._script, Config(), finger)
        whole = read_run(self._run("undisturbed", None))
        self.writes, self.duration_s = sum(1 for _ in read_journal(whole.folder.events)), whole.duration_s
        self._presses = _presses(whole)

    def kills(self, number: int, seed: int) -> list[Kill]:
        """Half on writes, half on instants, one in each equal part of the run."""
        chance, half = random.Random(seed), number // 2
        writes = [int((n + chance.random()) * self.writes / half) for n in range(half)]
        times = [(n + chance.random()) * self.duration_s / (number - half) for n in range(number - half)]
        found = [Kill(write=write, stage=STAGES[n % len(STAGES)]) for n, write in enumerate(writes)]
        return found + [Kill(t_s=t_s) for t_s in times]

    def trial(self, number: int, kill: Kill) -> dict[str, Any]:
        """One run killed, perhaps killed once more while it is taken up, and taken up to its end."""
        cut = self._run(f"{number:03}", kill)
        during = _during(cut)
        if number % 4 == 3:
            _forked(lambda: self._take_up(cut), kill)
        ended = _forked(lambda: self._take_up(cut), None)
        run = read_run(cut)
        return {
            "kind": kill.kind,
            "during": during,
            "complete": ended == 0 and run.complete and _presses(run) == self._presses,
            "missing": run.missing,
            "repeated": run.repeated,
            "restarted": run.restarted,
        }

    def _run(self, name: str, kill: Kill | None) -> Path:
        """The run's folder, once its process has ended."""
        out = self._folder / name
        _forked(lambda: dry_run(self._session(self._script, Config(), NewRun(out))), kill)
        (made,) = (path for path in out.iterdir() if not path.name.startswith("."))
        return made

    def _take_up(self, cut: Path) -> None:
        stopped = read_stopped(cut)
        dry_run(self._session(stopped.script, stopped.config, stopped))

    def _session(self, script: Script, config: Config, into: NewRun | StoppedRun) -> Session:
        return Session(script, config, self._finger, self._plan, into)


def _forked(work: Callable[[], object], kill: Kill | None) -> int:
    """Do it in a forked process; its exit code, negative for the signal that ended it."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            if kill is not None:
                arm(kill)
            work()
            code = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _presses(run: Run) -> list[tuple[Any, ...]]:
    return [(e["index"], e["indentor"], e["x_mm"], e["value"]) for e in run.stream("indentation_start")]


def _during(cut: Path) -> str:
    """What the run was at when it was killed: the last event that its journal knows of."""
    events = [d for d in read_journal(cut / "events.jsonl") if d["doc"] == "event"]
    if not events:
        return "start"
    last = events[-1]
    return last["data"]["phase"] if last["stream"] == "sample" else last["stream"]


def table(results: list[dict[str, Any]]) -> str:
    """The histogram: kills by what the run was at, and by what they hit."""
    kinds = sorted({result["kind"] for result in results})
    rows = Counter((result["during"], result["kind"]) for result in results)
    lines = [f"| killed after | {' | '.join(kinds)} |", "|---" * (len(kinds) + 1) + "|"]
    for during in dict.fromkeys(result["during"] for result in results):
        lines.append(f"| {during} | {' | '.join(str(rows[during, kind]) for kind in kinds)} |")
    return "\n".join(lines)


def main() -> None:
    """Kill, take up, count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        trials = Trials(Path(folder), Fingertip.load())
        kills = trials.kills(options.kills, options.seed)
        results = [trials.trial(number, kill) for number, kill in enumerate(kills)]
    total = {key: sum(result[key] for result in results) for key in ("complete", "missing", "repeated", "restarted")}
    total |= {"kills": len(results), "writes": trials.writes, "duration_s": round(trials.duration_s, 1)}
    if options.json:
        print(json.dumps({**total, "results": results}))
    else:
        print(table(results), f"{total}", sep="\n\n")
    sys.exit(0 if total["complete"] == len(results) and not (total["missing"] or total["repeated"]) else 1)


if __name__ == "__main__":
    main()
