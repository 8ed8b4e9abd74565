"""Every promise of docs/safety_promises.md names a test that exists."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
_TEST = re.compile(r"`(tests/[\w/]+\.py)(?:: (\w+))?`")


def _promises() -> list[tuple[str, list[tuple[str, str]]]]:
    """Each row of the table "| promise | test |": the promise, and the files and functions that hold it."""
    lines = (ROOT / "docs" / "safety_promises.md").read_text(encoding="utf-8").splitlines()
    begin = next((n for n, line in enumerate(lines) if re.match(r"\|\s*promise\s*\|", line)), len(lines))
    rows = []
    for line in lines[begin + 2 :]:
        if not line.startswith("|"):
            break
        promise, tests = (cell.strip() for cell in line.strip().strip("|").rsplit(" | ", 1))
        if tests:  # else a heading within the table
            rows.append((promise, _TEST.findall(tests)))
    return rows


def test_the_safety_page_lists_at_least_forty_promises() -> None:
    assert len(_promises()) >= 40


@pytest.mark.parametrize(("promise", "tests"), _promises(), ids=[promise[:60] for promise, _ in _promises()])
def test_every_safety_promise_names_an_existing_test(promise: str, tests: list[tuple[str, str]]) -> None:
    assert tests, promise
    for file, function in tests:
        path = ROOT / file
        assert path.exists(), file
        if function:
            tree = ast.parse(path.read_text(encoding="utf-8"))
            assert function in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}, function
