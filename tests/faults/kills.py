"""Cut a run short again and again and take it up each time: is anything lost, done twice, or mixed of two attempts?

By `kill -9`, SIGTERM and SIGHUP, as many of each, shuffled: half on writes of the journal (before, in the middle of,
after one, before and after it is on disk), half on instants of the bench's clock. With `--cables` also by a cable of
stage or force pulled at a random byte: its port gone, or nothing heard any more. All are spread evenly over the run,
and every fourth run is struck again while it is taken up. Each is a process of its own, forked with a loaded finger.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # a fork takes no threads along

import argparse
import io
import json
import random
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr
from pathlib import Path
from typing import Any

from rig.cli.signals import PauseRequest, at_a_safe_point
from rig.data import Run, RunError, read_run
from rig.data.journal import read_journal
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import Script, load_script
from rig.session.resume import StoppedRun, read_stopped
from rig.session.session import NewRun, NoAttendant, Session, dry_run
from sim.models.fingertip import Fingertip
from studies import posix
from studies.registry import as_markdown
from tests.faults.attempts import mixed
from tests.faults.strikes import Strike, cuts, kills

SCRIPT = """\
import random
from rig.protocol import Rig

def run(rig: Rig) -> None:
    places = [-0.5, 0.0, 0.5, 1.0]
    random.Random(5).shuffle(places)
    for indentor, here in (("bar:3.0", places[:2]), ("bar:1.5", places[2:])):
        rig.mount(indentor)
        rig.home()
        rig.zero()
        for x_mm in here:
            rig.move_to(x_mm=x_mm)
            rig.indent(force_gwt=1.0, increments=2, hold_s=0.1)
"""
TITLES = {
    "KILL": "`kill -9`",
    "TERM": "SIGTERM",
    "HUP": "SIGHUP",
    "stage, port gone": "the stage's cable, its port gone",
    "stage, silent": "the stage's cable, in silence",
    "force, port gone": "the sensor's cable, its port gone",
    "force, silent": "the sensor's cable, in silence",
}
"""Ways to cut a run short, as the table names them."""
MUST_BE_NONE = ("lost", "missing", "repeated", "mixed", "touching")


class Leaving(NoAttendant):
    """Asks for a pause where a signal does, and does not come back from it."""

    def __init__(self, pause: PauseRequest) -> None:
        self._pause = pause

    def interrupted(self) -> bool:
        return self._pause.asked()


class Trials:
    """The script on the loaded finger, run and taken up in forked processes."""

    def __init__(self, folder: Path, finger: Fingertip) -> None:
        path = folder / "four.py"
        path.write_text(SCRIPT, encoding="utf-8")
        self._folder, self._finger, self._script = folder, finger, load_script(str(path))
        self._plan = make_plan(self._script, Config(), finger)
        self._whole = whole = read_run(self._run("undisturbed", None))
        self.writes, self.duration_s = sum(1 for _ in read_journal(whole.folder.events)), whole.duration_s
        self._presses = _presses(whole)

    def wire_bytes(self, port: str) -> int:
        """So many go over a wire in a run, both ways."""
        lines = map(json.loads, self._whole.folder.bytes_log.read_text(encoding="ascii").splitlines())
        return sum(len(line["hex"]) // 2 for line in lines if line["port"] == port)

    def trial(self, number: int, strike: Strike) -> dict[str, Any]:
        """One run cut short, perhaps once more while it is taken up, and taken up to its end."""
        cut = self._run(f"{number:03}", strike)
        during, before, left = _during(cut), _done(cut), _left(cut)
        if number % 4 == 3:
            _forked(lambda pause: self._take_up(cut, pause), strike)
        ended = _forked(lambda pause: self._take_up(cut, pause), None)
        run = read_run(cut)
        return {
            "kind": strike.kind,
            "how": strike.how,
            "during": during,
            "left": left,
            "complete": ended == 0 and run.complete and _presses(run) == self._presses,
            "lost": sum(run.done.get(index) != holds for index, holds in before.items()),
            "missing": run.missing,
            "repeated": run.repeated,
            "mixed": mixed(run),
            "restarted": run.restarted,
            "touching": strike.how in ("TERM", "HUP") and left == "held",
        }

    def _run(self, name: str, strike: Strike | None) -> Path:
        """The run's folder, once its process has ended."""
        out = self._folder / name
        _forked(lambda pause: dry_run(self._session(self._script, Config(), NewRun(out), pause)), strike)
        (made,) = (path for path in out.iterdir() if not path.name.startswith("."))
        return made

    def _take_up(self, cut: Path, pause: PauseRequest) -> None:
        stopped = read_stopped(cut)
        dry_run(self._session(stopped.script, stopped.config, stopped, pause))

    def _session(self, script: Script, config: Config, into: NewRun | StoppedRun, pause: PauseRequest) -> Session:
        return Session(script, config, self._finger, self._plan, into, Leaving(pause))


def _forked(work: Callable[[PauseRequest], object], strike: Strike | None) -> int:
    """Do it in a forked process; its exit code, negative for the signal that ended it."""
    child = posix.os.fork()
    if child == 0:
        code = 1
        try:
            if strike is not None:
                strike.arm()
            with at_a_safe_point() as pause, redirect_stderr(io.StringIO()):
                work(pause)
            code = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _presses(run: Run) -> list[tuple[Any, ...]]:
    return [(e["index"], e["indentor"], e["x_mm"], e["value"]) for e in run.stream("indentation_start")]


def _done(cut: Path) -> dict[int, list[dict[str, Any]]]:
    """The indentations that a run had finished when it was cut short, none where nothing was journalled."""
    try:
        return read_run(cut).done
    except RunError:
        return {}


def _left(cut: Path) -> str:
    """Where the run says that it left the indentor; a program that was killed says nothing."""
    *_, last = [{}, *read_journal(cut / "events.jsonl")]
    if last.get("doc") != "stop":
        return "nothing"
    return "done" if last["status"] == "done" else str(last["indentor"]["left"])


def _during(cut: Path) -> str:
    """What the run was at when it was cut short: the last event that its journal knows of."""
    events = [d for d in read_journal(cut / "events.jsonl") if d["doc"] == "event"]
    if not events:
        return "start"
    last = events[-1]
    return last["data"]["phase"] if last["stream"] == "sample" else last["stream"]


def table(results: Sequence[dict[str, Any]], row: str, column: str, title: str) -> str:
    """The histogram, by two of what each result tells: a CSV of studies/results/faults/."""
    heads = sorted({result[column] for result in results})
    counts = Counter((result[row], result[column]) for result in results)
    names = dict.fromkeys(result[row] for result in results)
    return as_markdown(
        [[title, *heads], *([TITLES.get(name, name), *(f"{counts[name, head]}" for head in heads)] for name in names)]
    )


def main() -> None:
    """Cut short, take up, count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--cables", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    chance = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        trials = Trials(Path(folder), Fingertip.load())
        strikes: list[Strike] = [*kills(options.kills, chance, trials.writes, trials.duration_s)]
        strikes += cuts(options.cables, chance, trials.wire_bytes)
        results = [trials.trial(number, strike) for number, strike in enumerate(strikes)]
    total = {key: sum(result[key] for result in results) for key in ("complete", *MUST_BE_NONE, "restarted")}
    total |= {"kills": options.kills, "cables": options.cables}
    total |= {"writes": trials.writes, "duration_s": round(trials.duration_s, 1)}
    if options.json:
        print(json.dumps({**total, "results": results}))
    else:
        print(table(results, "during", "kind", "cut short after"))
        print(table(results, "how", "left", "by"), total, sep="\n")
    sys.exit(0 if total["complete"] == len(results) and not any(total[key] for key in MUST_BE_NONE) else 1)


if __name__ == "__main__":
    main()
