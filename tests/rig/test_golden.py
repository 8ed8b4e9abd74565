"""What each command prints where it refuses: tests/golden/FAMILY.txt, so that wording a line anew is one diff.

A file is a list of command lines; below each stand its exit code, its code as JSON has it, and what it prints to
standard error. `> NAME` writes a file first, its lines behind bars. `GOLDEN=write pytest tests/rig/test_golden.py`
writes anew what stands below the commands.
"""

import json
import os
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from sim.models.fingertip import Fingertip
from tests.program import Program

GOLDEN = Path(__file__).parents[1] / "golden"
RUNS = Path(__file__).parents[1] / "data" / "runs_of_0_1"
FAMILIES = ("experiment", "bench", "results", "simulation", "coding", "system")
WITHOUT_JSON = ("by-hand", "export-deck")
"""Commands without an option --json; their code is not seen."""


def test_every_file_is_of_a_family() -> None:
    assert sorted(path.name for path in GOLDEN.iterdir()) == sorted(f"{family}.txt" for family in FAMILIES)


@pytest.mark.parametrize("family", FAMILIES)
def test_lines_are_as_they_stand(
    family: str, finger: Fingertip, program: Program, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert finger is not None  # in the cache from here on
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Fingertip, "load", cache(Fingertip.load))
    path = GOLDEN / f"{family}.txt"
    known = path.read_text(encoding="utf-8")
    with monkeypatch.context() as patch:
        found = "".join(f"{line}\n" for line in _answered(known.splitlines(), program, patch))
    if os.environ.get("GOLDEN") == "write":
        path.write_text(found, encoding="utf-8")
    else:
        assert found == known


def _answered(lines: list[str], program: Program, patch: pytest.MonkeyPatch) -> Iterator[str]:
    """The same lines, with what the commands say now."""
    file: Path | None = None
    for line in lines:
        if line.startswith("> "):
            file = Path(line.removeprefix("> "))
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text("", encoding="utf-8")
        elif line.startswith("|"):
            assert file is not None, line
            with file.open("a", encoding="utf-8") as content:
                content.write(line[2:] + "\n")
        if not line.startswith("  "):
            yield line
        if line.startswith("$ "):
            yield from (f"  {one}" for one in _said(line.removeprefix("$ "), program, patch))


def _said(line: str, program: Program, patch: pytest.MonkeyPatch) -> list[str]:
    """Exit code and code, then the lines on standard error; nothing is left behind but a folder for runs."""
    words = shlex.split(line.replace("{runs}", str(RUNS)))
    with patch.context() as here:
        while words[0] != "rig":
            here.setenv(*words.pop(0).split("=", 1))
        arguments = [*words[1:], *(() if words[1:2] and words[1] in WITHOUT_JSON else ("--json",))]
        there = _files()
        ended = program(*arguments)
    assert _files() == there, line
    assert ended.code, f"{line}\n{ended.out}"
    said = [one.replace(str(RUNS), "{runs}").replace(os.getcwd(), "{here}") for one in ended.err.splitlines()]
    if not ended.out:
        return [f"{ended.code}", *said]
    told = json.loads(ended.out)
    if "error_text" not in told:  # it has said more than that it failed
        return [f"{ended.code}", *said]
    assert (told["error_text"], told["exit_code"]) == (ended.err.splitlines()[-1].removeprefix("rig: "), ended.code)
    return [f"{ended.code} {told['code']}", *said]


def _files() -> set[Path]:
    """But for locks, which stay, and the program's own state, which tests keep here."""
    found = {path for path in Path().rglob("*") if path.is_file() and path.name != ".lock"}
    return {path for path in found if path.parts[0] != "state"}
