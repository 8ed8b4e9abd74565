"""What the demo costs, part by part, in processor milliseconds of one thread: the least of several rounds.

OMP_NUM_THREADS=1 .venv/bin/python -m studies.speed.demo [--rounds N] [--beside FOLDER]    # half a minute

Each round is a process of its own, the finger in the cache. --beside: another tree of the project, in turns with
this one.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

HERE = Path(__file__).parents[2]
DEMO = ("dry-run", "protocols/steps.py", "--set", "step=1", "force_gwt=2.33")
PARTS = {
    "the finger and its loops": "rig.cli.script_execution:_loaded",
    "plan": "rig.cli.script_execution:make_plan",
    "rehearsal on springs": "rig.session.rehearsal_summary:rehearsed",
    "run": "rig.session.session:_on_a_bench",
    "its journal read and exported": "rig.session.session:read_run rig.session.session:export_run",
    "report: libraries that draw": "",
    "report: the model asked": "rig.report.run_report:responses",
    "report: figures": "rig.report.style:Plot._save",
    "report: the rest": "rig.cli.script_execution:make_report",
}
STARTING, REST, ALL = "starting: interpreter and imports", "the rest", "in all"


class PartTimes:
    """Processor time of each part that is under way; what is inside another counts for itself alone."""

    def __init__(self) -> None:
        self.spent_s: dict[str, float] = defaultdict(float)
        self._inner_s = [0.0]

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """What is done within belongs to it."""
        began = time.process_time()
        self._inner_s.append(0.0)
        try:
            yield
        finally:
            took_s = time.process_time() - began
            self.spent_s[name] += took_s - self._inner_s.pop()
            self._inner_s[-1] += took_s

    def watch(self, name: str, where: str) -> None:
        """Each call of module:function belongs to the part from now on."""
        module, _, function = where.partition(":")
        *owners, last = function.split(".")
        owner: Any = import_module(module)
        for each in owners:
            owner = getattr(owner, each)
        setattr(owner, last, self._watched(name, getattr(owner, last)))

    def _watched(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def watched(*positional: Any, **named: Any) -> Any:
            with self.part(name):
                return function(*positional, **named)

        return watched


def once(out: str) -> None:
    """The demo in this process; prints the seconds of each part as JSON."""
    program: Any = import_module("rig.cli.program")
    parts, names = PartTimes(), list(PARTS)
    program._imported("rig.cli.run")  # as it does itself
    parts.spent_s[STARTING] = time.process_time()
    for name in (*names[:5], names[8]):
        for where in PARTS[name].split():
            parts.watch(name, where)
    reporting: Any = import_module("rig.cli.script_execution")
    report = reporting.make_report

    def with_libraries(*about: Any) -> None:
        with parts.part(names[5]):
            import_module("rig.report.run_report")
        for name in names[6:8]:
            parts.watch(name, PARTS[name])
        report(*about)

    reporting.make_report = with_libraries
    sys.argv = ["rig", *DEMO, "--out", out, "--json"]
    try:
        program.run()
    except SystemExit as ended:
        if ended.code:
            raise
    print(json.dumps(parts.spent_s), file=sys.stderr)


def measured(tree: Path) -> dict[str, float]:
    """Seconds of each part of a demo of that tree, and of all of it."""
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-P", __file__, "--once", out]
        before = os.times()
        done = subprocess.run(
            command, cwd=tree, env={**os.environ, "PYTHONPATH": str(tree)}, capture_output=True, text=True, check=True
        )
        after = os.times()
    spent: dict[str, float] = json.loads(done.stderr.splitlines()[-1])
    whole = after.children_user + after.children_system - before.children_user - before.children_system
    return {**spent, REST: whole - sum(spent.values()), ALL: whole}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--beside", type=Path)
    parser.add_argument("--once", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.once:
        once(options.once)
        return
    trees = [HERE] if options.beside is None else [options.beside.resolve(), HERE]
    found: list[list[dict[str, float]]] = [[] for _ in trees]
    for _ in range(options.rounds):
        for mine, tree in zip(found, trees, strict=True):
            mine.append(measured(tree))
    heads = ["ms"] if len(trees) == 1 else ["before (ms)", "now (ms)"]
    print("| part | " + " | ".join(heads) + " |\n|" + "---|" * (1 + len(heads)))
    for name in (STARTING, *PARTS, REST, ALL):
        least = [min(spent.get(name, 0.0) for spent in mine) for mine in found]
        print(f"| {name} | " + " | ".join(f"{1000 * s:.0f}" for s in least) + " |")


if __name__ == "__main__":
    main()
