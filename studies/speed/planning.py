"""What is solved before and while a script is carried out, and what that costs in processor seconds.

OMP_NUM_THREADS=1 .venv/bin/python -m studies.speed.planning [PROTOCOL] [--set K=V …]    # half a minute

Counted are the questions that steps ask the model, not what the virtual finger feels.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rig.data.journal import read_journal
from rig.plan.config import Config
from rig.plan.finger_model import FingerModel
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.records import Prediction
from rig.session.preflight import preflight
from rig.session.resume import read_stopped
from rig.session.session import NewRun, Session, dry_run
from sim.models.fingertip import Fingertip


class Counted:
    """How often the model is asked, and how often and how long that makes it solve."""

    def __init__(self) -> None:
        self.asked = self.solved = 0
        self.solving_s = 0.0
        press, solve = FingerModel.press, FingerModel._solved

        def asked(model: FingerModel, *question: Any) -> Prediction:
            self.asked += 1
            return press(model, *question)

        def solved(model: FingerModel, *question: Any) -> Prediction:
            start = time.process_time()
            try:
                return solve(model, *question)
            finally:
                self.solved += 1
                self.solving_s += time.process_time() - start

        FingerModel.press, FingerModel._solved = asked, solved  # type: ignore[method-assign, assignment]

    def row(self, what: str, work: Callable[[], Any]) -> Any:
        """Do it, and print a line of the table."""
        asked, solved, solving_s, start = self.asked, self.solved, self.solving_s, time.process_time()
        done = work()
        asked, solved, solving_s = self.asked - asked, self.solved - solved, self.solving_s - solving_s
        whole_s = time.process_time() - start
        print(f"| {what} | {solved} | {asked} | {solving_s:.2f} | {whole_s:.2f} |", flush=True)
        return done


def _cut_in_half(folder: Path) -> None:
    """The journal as a kill in the middle of the run leaves it."""
    documents = sum(1 for _ in read_journal(folder / "events.jsonl"))
    lines = (folder / "events.jsonl").read_bytes().splitlines(keepends=True)
    (folder / "events.jsonl").write_bytes(b"".join(lines[: documents // 2]))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("protocol", nargs="?", default="steps")
    parser.add_argument("--set", action="append", default=[])
    options = parser.parse_args()
    script, config, finger = load_script(options.protocol, options.set), Config(), Fingertip.load()
    finger.indent("step:1", 0.0, force_gwt=2.0)  # what is loaded once
    counted = Counted()
    print("| | solves | questions | solving (s) | in all (s) |\n|---|---|---|---|---|")
    plan = counted.row("plan", lambda: make_plan(script, config, finger))
    counted.row("check, after the plan", lambda: preflight(script, config, finger, plan).as_json())
    with tempfile.TemporaryDirectory() as out:
        session = Session(script, config, finger, plan, NewRun(Path(out)))
        done = counted.row("run, after the plan", lambda: dry_run(session))
        _cut_in_half(done.folder.path)
        stopped = read_stopped(done.folder.path)
        rest = counted.row("plan of half a run", lambda: make_plan(script, config, finger, stopped.run))
        session = Session(stopped.script, config, finger, rest, stopped)
        counted.row("that half, after its plan", lambda: dry_run(session))


if __name__ == "__main__":
    main()
