"""Which test runs which line, and for how long: recorded once, before anything is changed.

python -m studies.mutants.cover TEST_FILE=RESULT.json ... [--pytest-option=value ...]
"""

import json
import sys
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import coverage
import pytest

ROOMS = ("rig", "sim", "rig_shared")
_WIDER = ("session", "package", "module", "class")


class CoverageRecorder:
    """A pytest plugin: a context for every test, and one for every fixture that tests share."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.cover = coverage.Coverage(data_file=None, config_file=False, source=[str(root / room) for room in ROOMS])
        self.context = ""
        self.fixtures: dict[str, list[str]] = {}
        self.seconds: dict[str, float] = defaultdict(float)
        self.shared_s: dict[str, float] = defaultdict(float)
        self.failed: set[str] = set()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[Any]:
        """The test's lines are its own and those of the fixtures that it shares."""
        shared = getattr(item, "_fixtureinfo", None)
        found = (d for ds in shared.name2fixturedefs.values() for d in ds) if shared else ()
        self.fixtures[item.nodeid] = [_named(d) for d in found if d.scope in _WIDER]
        self._switch(item.nodeid)
        try:
            return (yield)
        finally:
            self._switch("between tests")

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[Any]:
        """What a shared fixture runs belongs to all that use it."""
        if fixturedef.scope not in _WIDER:
            return (yield)
        outer, start, name = self.context, time.perf_counter(), _named(fixturedef)
        self._switch(name)
        try:
            return (yield)
        finally:
            self._switch(outer)
            spent = time.perf_counter() - start
            self.shared_s[name] += spent
            self.seconds[outer] -= spent

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Seconds of each test, without the making of shared fixtures."""
        self.seconds[report.nodeid] += report.duration
        if report.outcome != "passed":
            self.failed.add(report.nodeid)

    def result(self) -> dict[str, Any]:
        """By test its seconds, those of the fixtures that it shares, and the lines it runs; no test that fails."""
        data = self.cover.get_data()
        lines: dict[str, dict[str, list[int]]] = defaultdict(dict)
        for file in data.measured_files():
            path = Path(file).relative_to(self.root).as_posix()
            for line, contexts in data.contexts_by_lineno(file).items():
                for context in contexts:
                    lines[context].setdefault(path, []).append(line)
        return {
            name: {
                "seconds": round(max(self.seconds[name], 0.0), 3),
                "shared": {f: round(self.shared_s[f], 3) for f in shared if f in self.shared_s},
                "lines": _joined(lines[c] for c in (name, *shared)),
            }
            for name, shared in self.fixtures.items()
            if name in self.seconds and name not in self.failed
        }

    def _switch(self, context: str) -> None:
        self.context = context
        self.cover.switch_context(context)


def _joined(parts: Iterable[dict[str, list[int]]]) -> dict[str, list[int]]:
    whole: dict[str, set[int]] = defaultdict(set)
    for part in parts:
        for path, lines in part.items():
            whole[path].update(lines)
    return {path: sorted(lines) for path, lines in whole.items()}


def _named(fixture: Any) -> str:
    return f"fixture {fixture.baseid}::{fixture.argname}"


def main() -> None:
    """Run test files once under coverage and write what was found of each."""
    wanted = [pair.split("=", 1) for pair in sys.argv[1:] if "=" in pair and not pair.startswith("-")]
    options = [option for option in sys.argv[1:] if option.startswith("-")]
    recorder = CoverageRecorder(Path.cwd())
    recorder.cover.start()
    pytest.main(
        ["-q", "-p", "no:cacheprovider", "-p", "no:xdist", *options, *(p for p, _ in wanted)], plugins=[recorder]
    )
    recorder.cover.stop()
    found = recorder.result()
    for path, out in wanted:
        mine = {test: entry for test, entry in found.items() if test.startswith(f"{path}::")}
        Path(out).write_text(json.dumps(mine), encoding="utf-8")


if __name__ == "__main__":
    main()
