"""Every option and argument of the program that is a number: anything else ends in one line with code 2."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_type_hints

import pytest
import typer

from rig.cli import program as commands
from tests.program import Program, functions

WRONG = ["9" * 5000, "1e400", "1.5", "nan", ""]
"""What no command means by a whole number."""
NEEDED = {"--axis": "x", "--indentor": "bar:3.0"}
"""Values of required options; all others may be anything."""


WHOLE, REAL = (int, int | None), (float, float | None)


def _options(kinds: tuple[Any, ...] = WHOLE) -> Iterator[tuple[list[str], str, bool, list[str]]]:
    """Words of a command, its number, whether that is an option, and what else the command requires."""
    for words, function in functions():
        found: Any = typer.main.get_command(commands._app(words[:1])).commands[words[0]]
        found = found.commands[words[1]] if len(words) > 1 else found
        whole = [key for key, kind in get_type_hints(function).items() if kind in kinds]
        for one in (param for param in found.params if param.name in whole):
            needed = [other for other in found.params if other.required and other is not one]
            values = [NEEDED.get(other.opts[0], "1") for other in needed]
            more = [
                f"{other.opts[0]}={value}" if other.param_type_name == "option" else value
                for other, value in zip(needed, values, strict=True)
            ]
            yield words, one.opts[0], one.param_type_name == "option", more


def test_every_whole_number_is_refused_in_one_line_unless_it_is_one(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    walked = set()
    for words, option, is_option, more in _options():
        walked.add((" ".join(words), option))
        for value in WRONG:
            given = [f"{option}={value}"] if is_option else ["--", value]
            ended = program(*words, *more, *given)
            assert ended.code == 2, (words, option, value[:8])
            assert len(ended.complaint) < 200, (words, option)
            assert option in ended.complaint, (words, option)
    assert {("decode", "--half-length"), ("calibrate steps", "--valid-days")} <= walked
    assert len(walked) >= 18


@pytest.mark.parametrize("value", ["nan", "-inf"])
def test_every_number_is_refused_in_one_line_unless_it_is_finite(
    value: str, program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No length, force, gain or time is infinite, or no number; without effect is not an exception."""
    monkeypatch.chdir(tmp_path)
    walked = set()
    for words, option, is_option, more in _options(REAL):
        walked.add((" ".join(words), option))
        ended = program(*words, *more, *([f"{option}={value}"] if is_option else ["--", value]))
        assert ended.code == 2, (words, option)
        assert len(ended.complaint) < 200, (words, option)
        assert option in ended.complaint, (words, option)
    assert {("encode", "--gain"), ("nerve", "--path-m"), ("indent", "--doi-mm")} <= walked
    assert len(walked) >= 40


LISTS = {
    ("indent", "--doi-mm", "0.5", "--shape", "bar:3.0", "--receptor-x-mm"): "1,{}",
    ("encode", "--pressure"): "20,{}",
    ("decode", "--pressure"): "20,{}",
    ("design", "--minutes", "10", "--to", "a.py", "--depths-mm"): "0.3,{}",
    ("dry-run", "bars", "--set"): "doi_mm={}",
    ("dry-run", "bars", "--speed"): "{}",
    ("nerve", ".", "--afferents"): "SA1@{}",
}


@pytest.mark.parametrize("words", LISTS, ids=" ".join)
def test_so_is_a_number_within_a_text(words: tuple[str, ...], program: Program) -> None:
    value = "nan"
    *before, option = words
    ended = program(*before, f"{option}={LISTS[words].format(value)}" if option != "--set" else option,
                    *([LISTS[words].format(value)] if option == "--set" else []))  # fmt: skip
    assert ended.code == 2, ended
    assert len(ended.complaint.splitlines()) == 1
