"""What the user did and how it is refused: tests/refusals/FAMILY.txt.

A row is an exit code, the code of the error, and a command line; `> NAME` writes a file first, its lines behind bars.
`REFUSALS=write pytest -n 0 tests/rig/test_refusal_table.py` writes the codes anew.
"""

import json
import os
import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from sim.models.fingertip import Fingertip
from tests.program import Program

REFUSALS = Path(__file__).parents[1] / "refusals"
RUNS = Path(__file__).parents[1] / "data" / "runs"
FAMILIES = ("experiment", "bench", "results", "simulation", "coding", "system")
ROW = re.compile(r"(?P<said>\d+(?: \w+)?) +(?P<line>\S*rig .*|\S+=\S* rig .*)")
WITHOUT_JSON = ("by-hand", "export-deck")
"""Commands without an option --json; their code is not seen."""


@pytest.mark.parametrize("family", FAMILIES)
def test_bad_input_is_refused_in_one_line_with_its_code_and_leaves_no_file(
    family: str, finger: Fingertip, program: Program, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert finger is not None  # in the cache from here on
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Fingertip, "load", cache(Fingertip.load))
    path = REFUSALS / f"{family}.txt"
    known = path.read_text(encoding="utf-8").splitlines()
    with monkeypatch.context() as patch:
        found = list(_answered(known, program, patch))
    if os.environ.get("REFUSALS") == "write":
        path.write_text("".join(f"{line}\n" for line in found), encoding="utf-8")
    assert found == known


def _answered(lines: list[str], program: Program, patch: pytest.MonkeyPatch) -> Iterator[str]:
    """The same lines, with the codes of now."""
    file = Path()
    for line in lines:
        if line.startswith("> "):
            file = Path(line.removeprefix("> "))
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text("", encoding="utf-8")
        elif line.startswith("|"):
            with file.open("a", encoding="utf-8") as content:
                content.write(line[2:] + "\n")
        elif row := ROW.fullmatch(line):
            line = f"{_said(row['line'], program, patch):<28}  {row['line']}"
        yield line


def _said(line: str, program: Program, patch: pytest.MonkeyPatch) -> str:
    """Exit code and code; nothing is left behind but a folder for runs."""
    words = shlex.split(line.replace("{runs}", str(RUNS)))
    with patch.context() as here:
        while words[0] != "rig":
            here.setenv(*words.pop(0).split("=", 1))
        arguments = [*words[1:], *(() if words[1:2] and words[1] in WITHOUT_JSON else ("--json",))]
        there = _files()
        ended = program(*arguments)
    assert _files() == there, line
    assert ended.code, f"{line}\n{ended.out}"
    *_, last = ended.err.splitlines()
    assert last.startswith(("rig: ", "Stop NOT sent")), line
    if not ended.out:
        return f"{ended.code}"
    told = json.loads(ended.out)
    if "error_text" not in told:  # it has said more than that it failed
        return f"{ended.code}"
    assert (told["error_text"], told["exit_code"]) == (last.removeprefix("rig: "), ended.code)
    return f"{ended.code} {told['code']}"


def _files() -> set[Path]:
    """But for locks, which stay, and the program's own state, which tests keep here."""
    found = {path for path in Path().rglob("*") if path.is_file() and path.name != ".lock"}
    return {path for path in found if path.parts[0] != "state"}
