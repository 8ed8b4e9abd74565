"""No test asks how long something took, and none waits for anything but the thing itself, with a deadline."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import LONG, REAL_TIME, STUDIES

TESTS = Path(__file__).parent
CLOCKS = {"sleep", "time", "time_ns", "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns",
          "process_time", "process_time_ns", "thread_time", "thread_time_ns"}  # fmt: skip
WAITS = {"join", "wait", "communicate", "result", "acquire", "settimeout", "create_connection"}
REAL = {"subprocess", "threading", "socket", "multiprocessing", "ProcessPoolExecutor", "WallClock", "WallScheduler",
        "in_processes", "openpty"}  # fmt: skip
MAY = {
    "waiting.py": "waits for all the others",
    "shake.py": "is no test",
    "rig/test_wall_clock.py": "the clock itself, against the system's",
    "sim/test_workers.py": "a sleep as a piece of work that never ends",
    "standa_client.py": "a program that polls, and ends before pytest's deadline",
    "tmcl_client.py": "a program that polls, and ends before pytest's deadline",
    "lsl_client.py": "a program that waits for the streams, and ends before pytest's deadline",
    "sim/test_calculix.py": "another program, that ends before pytest's deadline",
    "rig/test_hostile_files.py": "processor time of a child, which a busy machine does not lengthen",
    "faults/obstacles.py": "times of a stop, recorded and not asserted",
    "rig/test_stop_matrix.py": "times of a stop, recorded and not asserted",
    "faults/panel_attacks.py": "an attacker's own timeout",
    "faults/panel_under_attack.py": "times of stops, compared with each other",
    "whole_program.py": "is held in its report until the test ends it",
}
WORTH_PARSING = re.compile(
    r"\btime\b|timeout|Wall(Clock|Scheduler)|(?<![\"'])\.(join|wait|communicate|result|acquire)\(|create_connection"
)
"""What a text has that holds a clock or a wait: parsing all of the others takes seconds."""


def _forbidden(tree: ast.AST) -> Iterator[str]:
    """Clocks and sleeps of the module time; waits for so many seconds; upper bounds in seconds of a real clock."""
    real = not {"WallClock", "WallScheduler"}.isdisjoint(_names(tree))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "time":
            yield f"line {node.lineno}: from time import"
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id == "time" and node.attr in CLOCKS:
                yield f"line {node.lineno}: time.{node.attr}"
        elif isinstance(node, ast.Call) and _is_wait(node) and any(_is_number(given) for given in _given(node)):
            yield f"line {node.lineno}: a wait for a number of seconds, expected DEADLINE_S or until()"
        elif real and isinstance(node, ast.Assert) and any(map(_bounds_a_clock, ast.walk(node))):
            yield f"line {node.lineno}: an upper bound in seconds"


def _is_wait(call: ast.Call) -> bool:
    """By its name, or because it takes a timeout."""
    named = isinstance(call.func, ast.Attribute) and call.func.attr in WAITS
    return named or any(word.arg == "timeout" for word in call.keywords)


def _given(call: ast.Call) -> list[ast.expr]:
    named = isinstance(call.func, ast.Attribute) and call.func.attr in WAITS
    return [*(call.args if named else []), *(word.value for word in call.keywords if word.arg == "timeout")]


def _is_number(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float)


def _bounds_a_clock(compare: ast.AST) -> bool:
    if not isinstance(compare, ast.Compare):
        return False
    sides = [compare.left, *compare.comparators]
    return any(
        (isinstance(op, ast.Lt | ast.LtE) and _asks_a_clock(low) and _is_number(high))
        or (isinstance(op, ast.Gt | ast.GtE) and _is_number(low) and _asks_a_clock(high))
        for op, low, high in zip(compare.ops, sides, sides[1:], strict=False)
    )


def _asks_a_clock(node: ast.expr) -> bool:
    return any(isinstance(inner, ast.Attribute) and inner.attr == "monotonic_s" for inner in ast.walk(node))


def _names(tree: ast.AST) -> set[str]:
    """All that is imported and called by name."""
    imported = {
        alias.name for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom) for alias in node.names
    }
    return imported | {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}


@pytest.fixture(scope="module")
def texts() -> dict[str, str]:
    paths = sorted(TESTS.rglob("*.py"))
    return {path.relative_to(TESTS).as_posix(): path.read_text(encoding="utf-8") for path in paths}


@pytest.mark.parametrize(
    "source",
    [
        "import time\nassert time.perf_counter() - began < 1.0",
        "import time\ntime.sleep(0.1)",
        "from time import sleep",
        "thread.join(5.0)",
        "run.communicate(timeout=20)",
        "subprocess.run(words, timeout=20)",
        "from rig import WallClock\nassert WallClock().monotonic_s() - began < 0.5",
        "from rig import WallClock\nassert 0.1 <= clock.monotonic_s() - began <= 0.5",
        "from rig import WallClock\nassert 1.0 > clock.monotonic_s() - began",
    ],
)
def test_the_search_for_sleeps_finds_each_forbidden_form(source: str) -> None:
    assert WORTH_PARSING.search(source)
    assert len(list(_forbidden(ast.parse(source)))) == 1


def test_no_test_sleeps_or_measures_seconds(texts: dict[str, str]) -> None:
    parsed = {name: ast.parse(text) for name, text in texts.items() if WORTH_PARSING.search(text)}
    found = {name: uses for name, tree in parsed.items() if (uses := list(_forbidden(tree)))}
    assert {name: uses for name, uses in found.items() if name not in MAY} == {}
    assert set(MAY) - {"waiting.py", "shake.py"} <= set(found), "what is allowed is still needed"


def test_make_shake_repeats_every_real_time_test(texts: dict[str, str]) -> None:
    """Every file with processes, threads, sockets or a wall clock has tests that `make shake` repeats."""
    asked = {name: text for name, text in texts.items() if "test_" in name and any(word in text for word in REAL)}
    found = {name for name, text in asked.items() if not REAL.isdisjoint(_names(ast.parse(text)))}
    shaken = {name for name in found if any(name.startswith(place.partition("::")[0]) for place in REAL_TIME)}
    assert found - shaken == {
        "rig/compare/test_kinds_of_files.py",  # another program, which nothing hurries
        "rig/panel/test_page_scripts.py",  # the same
        "rig/test_ascii_locale.py",  # the same
        "rig/test_figures_without_settings.py",  # the same
        "rig/test_resume_handler.py",  # git waits for nobody
        "rig/test_run_time.py",  # its clock is a virtual one below the wall clock
        "rig/test_silence_limit.py",  # its clock is one of the test
        "sim/test_calculix.py",  # another program, which nothing hurries
        "test_adding_a_part.py",  # commands, one after the other
        "test_house.py",  # git again
        "test_site.py",
        "test_third_party_device.py",  # commands, one after the other
    }


def test_every_test_file_scheduled_first_exists() -> None:
    assert [name for name in LONG if not (TESTS / name).is_file()] == []
    assert len(set(LONG)) == len(LONG)


def test_every_test_left_to_the_studies_exists(texts: dict[str, str]) -> None:
    """Whatever is renamed would be in `make test` again, and whatever begins with the same name would be missing."""
    for place in STUDIES:
        file, _, test = place.partition("::")
        name, tests = test.partition("[")[0], re.findall(r"^ *def (\w+)", texts[file], re.M)
        assert not name or [one for one in tests if one.startswith(name)] == [name], place
