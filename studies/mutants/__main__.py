"""Mutation testing of the product: `make mutants`, or

python -m studies.mutants [--fresh] [--jobs 2] [--only 'rig/engine/*.py' ...] [--tests 'tests/rig/*.py' ...]
                          [--group first|sample] [--share 0.1] [--survivors] [--list]

Begins with one run of the tests under coverage. Results are appended to .mutants/results.jsonl as they come; a run
that was stopped goes on where it was. `--survivors` tries again what survived or ended by time, with more of the
tests that run it, ten times as long.
"""

import argparse
import hashlib
import json
import math
import os
import random
import subprocess
import sys
import threading
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from studies.mutants.report import Result, accepted, page
from studies.mutants.source import Mutant, mutants_of, plain
from studies.mutants.tests_of import LineTests, read_coverage
from studies.mutants.trees import Worker, copy_project, lend_models, surroundings

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / ".mutants"
FIRST_GROUP = (
    "rig/engine/*.py",
    "rig/plan/*.py",
    "rig/protocol/*.py",
    "rig/data/journal.py",
    "rig/data/events.py",
    "rig/data/run_state.py",
    "rig/manual/session.py",
    "rig/manual/without_force.py",
    "rig/session/execute.py",
    "rig/session/resume.py",
    "rig/transport/modbus.py",
    "rig/devices/*.py",
    "rig/cli/signals.py",
)
LEFT_OUT = ("tests/rig/real_time", "tests/sim/oracles", "tests/portable", "tests/rig/test_patience.py")
"""Tests in real time, against closed forms, and of programs as on Windows: slow, and what they notice others notice
too. And alarms that raise where they strike: in a lock of coverage's own they end nothing, and coverage waits.
"""

SLOWEST_TEST_S = 20.0
EVERY_S = 2.0
"""Time between lines of progress (s)."""

_AGAIN = ("survived", "timeout")  # On a busy machine what ended by time may only have been slow.

ACCEPTED = Path(__file__).with_name("accepted.toml")


def main() -> None:
    """Cover, mutate, run, report."""
    options = _options()
    FOLDER.mkdir(exist_ok=True)
    wanted = _wanted(options)
    if options.list:
        for group, mutant in wanted:
            print(f"{group} {mutant.lines[0]} {mutant.key}")
        return
    trees = [FOLDER / f"tree{k}" for k in range(options.jobs)]
    print(f"copying the project to {FOLDER} for each of {options.jobs} workers", flush=True)
    with ThreadPoolExecutor(options.jobs) as pool:
        list(pool.map(lambda tree: copy_project(ROOT, tree), trees))
    _cover(trees, options.tests)
    if options.fresh:
        (FOLDER / "results.jsonl").unlink(missing_ok=True)
    MutationRun(trees, LineTests(ROOT, read_coverage(FOLDER / "coverage")), options.budget).run(
        wanted, again=options.survivors
    )
    known = {m.key for _, m in wanted}
    text = page([r for r in _results() if r["key"] in known], accepted(ACCEPTED))
    (FOLDER / "survivors.md").write_text(text, encoding="utf-8")
    print(text[: text.index("## Survivors")] + f"survivors: {FOLDER / 'survivors.md'}")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m studies.mutants")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument(
        "--only", nargs="+", metavar="GLOB", help="these modules of the first group or elsewhere, whole"
    )
    parser.add_argument("--tests", nargs="+", metavar="GLOB", default=["*"], help="these test files alone")
    parser.add_argument("--group", choices=["first", "sample"], help="this one alone")
    parser.add_argument("--share", type=float, default=1.0, help="share of these to draw with the seed, such as 0.1")
    parser.add_argument("--sample", type=int, default=300, help="mutants elsewhere in rig/ and sim/")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--budget", type=float, default=6.0, help="seconds of tests for one mutant")
    parser.add_argument("--fresh", action="store_true", help="forget earlier results")
    parser.add_argument("--survivors", action="store_true", help="try again what survived or ended by time")
    parser.add_argument("--list", action="store_true", help="print the mutants and end")
    return parser.parse_args()


def _wanted(options: argparse.Namespace) -> list[tuple[str, Mutant]]:
    """The first group, or the modules asked for, or a seeded share of them; and a seeded sample of the rest."""
    modules = sorted(
        p.relative_to(ROOT) for room in ("rig", "sim", "rig_shared") for p in (ROOT / room).rglob("*.py")
    )
    if options.only:
        chosen = [p for p in modules if any(p.match(glob) for glob in options.only)]
        return [("first", m) for m in _drawn(_made(chosen), options)]
    first = [p for p in modules if any(p.match(glob) for glob in FIRST_GROUP)]
    guarded = [] if options.group == "sample" else _drawn(_made(first), options)
    rest = [] if options.group == "first" or not options.sample else _made([p for p in modules if p not in first])
    sample = random.Random(options.seed).sample(rest, min(options.sample, len(rest)))
    return [("first", m) for m in guarded] + [("sample", m) for m in sample]


def _drawn(mutants: list[Mutant], options: argparse.Namespace) -> list[Mutant]:
    """A seeded share of some mutants, module by module."""
    if options.share == 1.0:
        return mutants
    drawn = random.Random(options.seed).sample(range(len(mutants)), round(options.share * len(mutants)))
    return [mutants[k] for k in sorted(drawn)]


def _made(modules: list[Path]) -> list[Mutant]:
    """Return all mutants of some modules, and report the progress."""
    found: list[Mutant] = []
    said_s = -math.inf
    for n, module in enumerate(modules):
        path = module.as_posix()
        if time.monotonic() - said_s >= EVERY_S:
            said_s = time.monotonic()
            print(f"making the mutants of {path}: {n} of {len(modules)} modules done", file=sys.stderr, flush=True)
        found += mutants_of(ROOT, path)
    return found


def _results() -> list[Result]:
    """The latest result of each mutant whose module is as it was then."""
    path = FOLDER / "results.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    latest = {r["key"]: r for r in map(json.loads, lines)}
    return [r for r in latest.values() if r["module"] == _digest([ROOT / r["path"]])]


def _digest(paths: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.read_bytes() if path.exists() else b"")
    return digest.hexdigest()[:16]


def _cover(trees: list[Path], globs: list[str]) -> None:
    """Run under coverage each test file asked for whose result is not known for this state of it and the product."""
    folder = FOLDER / "coverage"
    folder.mkdir(exist_ok=True)
    shared = sorted(
        [*(ROOT / "rig").rglob("*.py"), *(ROOT / "sim").rglob("*.py"), *(ROOT / "tests").rglob("conftest.py")]
    )
    state = _digest(shared)
    files = [
        p
        for p in sorted((ROOT / "tests").rglob("test_*.py"))
        if not str(p.relative_to(ROOT)).startswith(LEFT_OUT) and any(p.match(glob) for glob in globs)
    ]
    due = {folder / f"{p.stem}-{state}-{_digest([p])}.json": p.relative_to(ROOT).as_posix() for p in files}
    for old in set(folder.glob("*.json")) - set(due):
        old.unlink()
    todo = sorted(path for path in due if not path.exists())
    print(f"{len(todo)} of {len(due)} test files to run under coverage", flush=True)

    def work(k: int) -> None:
        lend_models(trees[k])
        while todo:
            path = todo.pop()
            start = time.monotonic()
            command = [
                sys.executable,
                "-m",
                "studies.mutants.cover",
                f"--timeout={SLOWEST_TEST_S}",
                "--hypothesis-seed=0",
                "-m=not study",
            ]
            command.append(f"{due[path]}={path}")
            subprocess.run(command, cwd=trees[k], env=surroundings(trees[k]), stdout=subprocess.DEVNULL, check=True)
            known = "" if json.loads(path.read_text(encoding="utf-8")) else ", and no test of it can be used"
            print(f"  {len(todo)} left; {due[path]} in {time.monotonic() - start:.0f} s{known}", flush=True)

    with ThreadPoolExecutor(len(trees)) as pool:
        list(pool.map(work, range(len(trees))))


class MutationRun:
    """All mutants over some workers, module by module, so that the order of tests does not hang on chance."""

    def __init__(self, trees: list[Path], tests: LineTests, budget_s: float) -> None:
        self._trees, self._tests, self._budget_s = trees, tests, budget_s
        self._lock = threading.Lock()
        self._count = {"killed": 0, "timeout": 0, "survived": 0}
        self._todo = 0
        self._start = 0.0

    def run(self, wanted: list[tuple[str, Mutant]], *, again: bool) -> None:
        """Try what has no result yet, or what survived; first all of `rig`, then all of `sim`."""
        done = {r["key"]: r["outcome"] for r in _results()}
        due = [w for w in wanted if (done.get(w[1].key) in _AGAIN if again else w[1].key not in done)]
        if again:
            self._budget_s = 60.0
        self._todo, self._start = len(due), time.monotonic()
        print(f"{len(due)} of {len(wanted)} mutants to try", flush=True)
        for room in ("rig/", "sim/"):
            modules: dict[str, list[tuple[str, Mutant]]] = {}
            for group, mutant in due:
                if mutant.path.startswith(room):
                    modules.setdefault(mutant.path, []).append((group, mutant))
            queue = sorted(modules.values(), key=len)
            with ThreadPoolExecutor(len(self._trees)) as pool:
                list(pool.map(lambda tree, q=queue, r=room: self._work(tree, q, r), self._trees))

    def _work(self, tree: Path, queue: list[list[tuple[str, Mutant]]], room: str) -> None:
        lend_models(tree)
        with Worker(tree, simulator=room == "rig/") as worker:
            while queue:
                module = queue.pop()
                self._require_sound(worker, module[0][1])
                for group, mutant in module:
                    self._try(worker, group, mutant)

    def _require_sound(self, worker: Worker, mutant: Mutant) -> None:
        """The module written as mutants are, but unchanged, must live."""
        tests, *_ = self._tests.likely(mutant, self._budget_s)
        if tests:
            outcome, test, _ = worker.ask(
                path=mutant.path, source=plain(ROOT, mutant.path), tests=tests, limit_s=120.0
            )
            if outcome != "survived":
                print(
                    f"{mutant.path} unchanged was {outcome} by {test}: what kills its mutants says nothing",
                    flush=True,
                )

    def _try(self, worker: Worker, group: str, mutant: Mutant) -> None:
        tests, usual_s, every = self._tests.likely(mutant, self._budget_s)
        outcome, test, seconds = "survived", "", 0.0
        if tests:
            limit_s = 8.0 + 4 * usual_s
            outcome, test, seconds = worker.ask(path=mutant.path, source=mutant.source, tests=tests, limit_s=limit_s)
        result = {"key": mutant.key, "group": group, "outcome": outcome, "by": test, "seconds": round(seconds, 2),
                  "tests": len(tests), "every": every, "path": mutant.path, "line": mutant.lines[0],
                  "before": mutant.before, "after": mutant.after,
                  "module": _digest([ROOT / mutant.path])}  # fmt: skip
        with self._lock:
            self._tests.noticed(mutant, test)
            with (FOLDER / "results.jsonl").open("a", encoding="utf-8") as file:
                file.write(json.dumps(result) + "\n")
            self._say(result)

    def _say(self, result: Result) -> None:
        """Progress, and every survivor at once."""
        self._count[result["outcome"]] += 1
        tried = sum(self._count.values())
        if result["outcome"] == "survived":
            how = (
                f"{result['tests']} tests{'' if result['every'] else ' of more'}"
                if result["tests"]
                else "no test runs it"
            )
            print(
                f"survived ({how}) {result['path']}:{result['line']}  {result['before']}  →  {result['after']}",
                flush=True,
            )
        if tried % 20 == 0 or tried == self._todo:
            spent = time.monotonic() - self._start
            left = spent / tried * (self._todo - tried)
            killed = self._count["killed"] + self._count["timeout"]
            print(f"{tried}/{self._todo}: killed {killed} ({self._count['timeout']} by time), "
                  f"survived {self._count['survived']}; {spent / 60:.1f} min, {left / 60:.0f} min left",
                  flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
