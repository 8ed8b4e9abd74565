"""Every promise of docs/safety_promises.md names a test that exists."""

import re
from functools import cache
from pathlib import Path

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


@cache
def _functions(file: str) -> set[str]:
    return set(re.findall(r"^ *def (\w+)", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE))


def test_every_safety_promise_names_an_existing_test() -> None:
    for promise, tests in _promises():
        assert tests, promise
        assert [file for file, _ in tests if not (ROOT / file).exists()] == []
        assert [name for file, name in tests if name and name not in _functions(file)] == []
