"""A process with a tree of its own: writes a mutant, forks, lets the child run tests, says what became of it.

Libraries are imported before the fork; `rig`, and `sim` where it is changed, after it, so that whatever reads the
module reads the mutant, tests' own subprocesses included. Requests and answers are lines of JSON.
"""

import gc
import importlib
import json
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from studies.posix import os, resource, signal

_LIBRARIES = (
    *("numpy", "scipy.linalg", "scipy.sparse.linalg", "scipy.sparse.csgraph", "scipy.interpolate", "scipy.optimize"),
    *("scipy.integrate", "scipy.special", "scipy.stats", "scipy.spatial", "matplotlib", "pydantic", "typer", "h5py"),
    *("serial", "rich.console", "rich.table", "jinja2", "filelock", "platformdirs", "threadpoolctl", "hypothesis"),
    *("pymodbus.client", "pymodbus.server", "pymodbus.framer"),
)
_SIMULATOR = ("sim.models.fingertip", "sim.devices", "sim.plant", "sim.serve", "sim.measures.measures")
_MOST_BYTES = 12 * 2**30
OPTIONS = (
    *("-q", "-x", "--assert=plain", "--hypothesis-seed=0", "-p", "no:cacheprovider", "-p", "no:xdist"),
    *("-o", "timeout=0", "-o", "tmp_path_retention_policy=none"),
)


class Failed:
    """A pytest plugin that keeps the first test that fails."""

    name = ""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """The first failure is what noticed."""
        if report.failed and not self.name:
            self.name = report.nodeid


def attempt(tests: list[str], limit_s: float, temp: str) -> tuple[str, str]:
    """Run tests in a child: "survived", "killed" with the test that noticed, or "timeout"."""
    ours, its = os.pipe()
    child = os.fork()
    if child == 0:
        os.setsid()
        os.close(ours)
        resource.setrlimit(resource.RLIMIT_AS, (_MOST_BYTES, _MOST_BYTES))
        silence = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(silence, stream)
        failed, code = Failed(), 3
        try:
            code = int(pytest.main([*OPTIONS, f"--basetemp={temp}", *tests], plugins=[failed]))
        finally:
            os.write(its, json.dumps([code, failed.name]).encode())
            os._exit(0)
    os.close(its)
    ended = _wait(child, time.monotonic() + limit_s)
    _kill(child)
    said = os.read(ours, 65536)
    os.close(ours)
    if not ended:
        return "timeout", ""
    code, name = json.loads(said) if said else (3, "the process ended")
    if code == pytest.ExitCode.NO_TESTS_COLLECTED:
        raise RuntimeError(f"no tests were run of {tests}")
    return ("survived", "") if code == 0 else ("killed", name or "not even imported")


def _wait(child: int, deadline: float) -> bool:
    """Whether the child ended in time."""
    while time.monotonic() < deadline:
        if os.waitpid(child, os.WNOHANG)[0]:
            return True
        time.sleep(0.01)
    return False


def _kill(child: int) -> None:
    """End the child with all that it started."""
    try:
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
    except (ProcessLookupError, ChildProcessError):
        return


def main() -> None:
    """Serve requests {path, source, tests, limit_s} until there are no more."""
    tree, preload = Path.cwd(), sys.argv[1] == "simulator"
    sys.path.insert(0, str(tree))
    for name in [*_LIBRARIES, *(_SIMULATOR if preload else ())]:
        importlib.import_module(name)
    sys.dont_write_bytecode = True
    gc.freeze()
    answers = os.fdopen(os.dup(1), "w")
    for line in sys.stdin:
        request: dict[str, Any] = json.loads(line)
        module = tree / request["path"]
        original = module.read_bytes()
        start = time.monotonic()
        try:
            module.write_text(request["source"], encoding="utf-8")
            outcome, test = attempt(request["tests"], request["limit_s"], str(tree / ".tests"))
        finally:
            module.write_bytes(original)
        print(json.dumps([outcome, test, time.monotonic() - start]), file=answers, flush=True)


if __name__ == "__main__":
    main()
