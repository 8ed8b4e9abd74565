"""The program run in this process, and how it ended."""

import html
import io
import json
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

import pytest
import typer
from jsonschema import Draft202012Validator
from jsonschema.exceptions import best_match
from pydantic import TypeAdapter

from rig.cli import main
from rig.cli.failure import FailureJson
from rig.cli.json_schema import OUTPUTS, schema_of_command
from rig.cli.output import THE_FINGER
from rig.cli.program import COMMANDS


def press_script(*presses: str) -> str:
    """Return a script that presses at one place with these arguments."""
    verbs = ['mount("bar:3.0")', "home()", "zero()", "move_to(x_mm=0.0)", *(f"indent({how})" for how in presses)]
    return "def run(rig):\n" + "".join(f"    rig.{verb}\n" for verb in verbs)


@cache
def _schema(command: str) -> Draft202012Validator:
    found = schema_of_command(command) if command in OUTPUTS else TypeAdapter(FailureJson).json_schema()
    Draft202012Validator.check_schema(found)
    return Draft202012Validator(found)


def as_in_its_schema(command: str, found: Any) -> Any:
    """Validate what a command printed with --json against its schema; an unknown command can only fail."""
    wrong = best_match(_schema(command).iter_errors(found))
    assert wrong is None, f"rig {command}: {wrong.json_path}: {wrong.message}"
    return found


INIT_ANSWERS = (
    *("--travel-mm", "60,30,40", "--steps-per-mm", "none", "--range-gwt", "200"),
    *("--trip-n", "1.5", "--finger", "none"),
)
"""Options of `rig init` that answer all of its questions."""

_PROGRESS = re.compile(r"(?!rig: )(.* …|.* so far)(,.*)?|\d+ [a-z ]+")


def beside_progress(err: str) -> str:
    """What a program of its own printed besides its progress, of which a slow machine has more."""
    lines = err.splitlines(keepends=True)
    return "".join(line for line in lines if not _PROGRESS.fullmatch(line.rstrip("\n")))


def _no_constant(name: str) -> NoReturn:
    raise AssertionError(f"{name} in JSON")


@dataclass(frozen=True)
class Ended:
    """How a command ended and what it printed."""

    code: int
    out: str
    err: str
    command: str = field(default="", compare=False)

    @property
    def json(self) -> Any:
        """Standard output, which must be one object as the command's schema says, on one line, and nothing else."""
        assert self.out.count("\n") == 1, self.err
        return as_in_its_schema(self.command, json.loads(self.out, parse_constant=_no_constant))

    @property
    def complaint(self) -> str:
        """The one line on standard error, besides what was begun with."""
        lines = [line for line in self.err.strip().splitlines() if line != THE_FINGER]
        assert len(lines) == 1, self.err
        assert lines[0].startswith("rig: ")
        return lines[0].removeprefix("rig: ")

    @property
    def error_code(self) -> str:
        """The code of what failed with --json, which says the same as the one line on standard error."""
        told = self.json
        assert (told["error_text"], told["exit_code"]) == (self.complaint, self.code)
        return str(told["code"])


Program = Callable[..., Ended]


def text_of_page(page: str) -> str:
    """Return what a page says, without its tags, as a terminal would print it."""
    printed = html.unescape(re.sub(r"<[^>]*>", "", re.sub(r"<(style|script).*?</\1>", "", page, flags=re.S)))
    return printed.replace("\N{NO-BREAK SPACE}", " ").replace("\N{MINUS SIGN}", "-")


def functions() -> Iterator[tuple[list[str], Callable[..., None]]]:
    """Words and function of each command, and of those in a group."""
    for name, command in COMMANDS.items():
        module, _, function = command.where.partition(".")
        found = getattr(import_module(f"rig.cli.{module}"), function)
        if isinstance(found, typer.Typer):
            yield from (([name, str(one.name)], one.callback) for one in found.registered_commands if one.callback)
        else:
            yield [name], found


EMPTY_FIGURES = """\
from matplotlib.figure import Figure
from rig.report.plot import Plot
Plot._laid_out = property(lambda plot: Figure((1, 1)))
"""
"""To begin a program with that has a process of its own: what the fixture of that name is in this one."""

WHOLE = str(Path(__file__).with_name("whole_program.py"))
"""A Python runs this file as `rig`; its figures are empty, also those that the process of the finger draws."""
HELD_REPORT = "HELD_REPORT"
"""In its environment, this keeps its report from being made."""


SEVERAL = """\
import json, sys
from rig.cli import main

for words in json.loads(sys.argv[1]):
    sys.argv[1:] = words
    try:
        main()
    except SystemExit as ended:
        assert not ended.code
    print(end="\\0", flush=True)
"""
"""What a Python of its own carries out of commands as JSON, one after the other; after each it prints a zero byte."""


FRAME_NEAR_HOME = """\
[frame]
pad_centre_x_mm = -12.0
apex_z_mm = -12.0
"""
"""The finger close to the switches and still below where a virtual stage begins: a short way down from home."""
NEAR_HOME = f"""\
{FRAME_NEAR_HOME}\
[habits]
clearance_mm = 0.8
"""
"""And a short way from the clearance to the finger."""


def program_of(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Program:
    """Run it with these arguments, and with what is typed to it."""

    def run(*arguments: object, typed: str | io.StringIO = "") -> Ended:
        monkeypatch.setattr(sys, "argv", ["rig", *map(str, arguments)])
        monkeypatch.setattr(sys, "stdin", io.StringIO(typed) if isinstance(typed, str) else typed)
        with pytest.raises(SystemExit) as caught:
            main()
        printed = capsys.readouterr()
        return Ended(int(caught.value.code or 0), printed.out, printed.err, str(next(iter(arguments), "")))

    return run
