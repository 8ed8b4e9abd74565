"""Help of all commands: panels, length, and what the line of each option says."""

import re
from collections.abc import Iterator
from typing import Any, get_args, get_type_hints

import pytest
import typer

from rig.cli import program
from rig.cli.program import COMMANDS
from tests.program import Program

COLUMNS, LINES, COMMAND_LINES = 80, 57, 60
SHORTEST = 3  # words
LONGEST = 60  # characters of a command's line
ABSENT = re.compile(r"Default: |Give this or --")
UNIT = re.compile(
    r"\b(mm|m|mm/s|gwt|g|s|dB|GB|days|pseudo-units|units? of SED|seconds per|[Nn]umber of|min|[Ss]amples of|[Ss]eed|"
    r"TCP port)\b|%"
)
TRANSLATED = re.compile(
    r"\b(told|met|whoever|somebody|nobody|felt|so many|lies there|goes on)\b|^(Of|Say|How|Where) "
)
OF_TEXT = ("--tol", "--window-s", "--receptor-depth-mm", "--receptor-x-mm", "--receptor-z-mm", "--range",
           "--depth-range-mm", "--offset-mm", "--threshold")  # fmt: skip
"""Options that hold numbers as text."""
DIMENSIONLESS = ("--tol", "--friction", "--dispersion")


def _command(name: str) -> Any:
    return typer.main.get_command(program._app([name])).commands[name]  # type: ignore[attr-defined]


def _commands() -> Iterator[tuple[str, Any]]:
    for name in COMMANDS:
        found = _command(name)
        below = getattr(found, "commands", {})
        yield from ((f"{name} {inner}", command) for inner, command in below.items())
        yield name, found


ALL = dict(_commands())
OPTIONS = {
    f"{name} {one.opts[0]}": one
    for name, command in ALL.items()
    for one in command.params
    if "--help" not in one.opts
}


def _is_number(command: Any, option: Any) -> bool:
    """Whether a parameter is a number, also one that may be absent, or holds numbers as text."""
    kind, *_ = get_args(get_type_hints(command.callback, include_extras=True)[option.name])
    return option.opts[0] in OF_TEXT or kind in (int, float, int | None, float | None)


HOLDING_NUMBERS = [
    f"{name} {one.opts[0]}"
    for name, command in ALL.items()
    for one in command.params
    if f"{name} {one.opts[0]}" in OPTIONS and _is_number(command, one)
]


@pytest.mark.parametrize("name", ALL)
def test_a_command_has_one_line_in_the_imperative(name: str) -> None:
    line = ALL[name].help or COMMANDS[name].line
    assert len(line) <= LONGEST
    assert len(line.split()) >= SHORTEST
    assert line.endswith(".")
    assert not TRANSLATED.search(line)


def test_an_option_says_what_it_does() -> None:
    for name, option in OPTIONS.items():
        assert len(option.help.split()) >= SHORTEST, name
        assert option.help.endswith("."), name
        assert not TRANSLATED.search(option.help), name


def test_a_number_has_its_unit_and_a_default_or_what_its_absence_means() -> None:
    for name in HOLDING_NUMBERS:
        option = OPTIONS[name]
        if not option.hidden:
            assert UNIT.search(option.help) or name.split()[-1] in DIMENSIONLESS, name
            assert option.required or option.default is not None or ABSENT.search(option.help), name


def test_every_option_that_holds_a_number_is_looked_at() -> None:
    assert {"decode --snr-db", "jog --by-mm", "identify --presses", "indent --tol"} <= set(HOLDING_NUMBERS)


@pytest.mark.parametrize("name", ALL)
def test_the_help_of_a_command_fits_a_screen(name: str, program: Program, monkeypatch: pytest.MonkeyPatch) -> None:
    ended = _help(program, monkeypatch, *name.split())
    assert ended.count("\n") <= COMMAND_LINES
    assert "<bool>" not in ended


@pytest.mark.parametrize("name", ALL)
def test_more_than_eight_options_are_in_panels(name: str) -> None:
    shown = [one for one in ALL[name].params if one.param_type_name == "option" and not one.hidden]
    assert len(shown) <= 8 or any(one.rich_help_panel for one in shown)


def test_all_commands_fit_a_screen_in_groups(program: Program, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = _help(program, monkeypatch)
    assert shown.count("\n") <= LINES
    panels = re.findall(r"╭─ (\w+) ", shown)
    assert panels == ["Options", "Experiment", "Bench", "Results", "Simulation", "Coding", "System"]
    for name, command in COMMANDS.items():
        assert bool(re.search(rf"^│ {name} .*{re.escape(command.line)}", shown, re.M)) is not command.hidden


def test_the_program_alone_prints_where_to_begin(program: Program) -> None:
    ended = program()
    assert (ended.code, ended.err) == (2, "")
    tried = re.findall(r"^  rig ([\w-]+)", ended.out, re.M)
    assert len(tried) == 3
    assert set(tried) <= set(COMMANDS)
    assert "docs/tutorial.md" in ended.out


def _help(program: Program, monkeypatch: pytest.MonkeyPatch, *words: str) -> str:
    monkeypatch.setenv("COLUMNS", str(COLUMNS))
    ended = program(*words, "--help")
    assert (ended.code, ended.err) == (0, "")
    assert all(len(line) <= COLUMNS for line in ended.out.splitlines())
    return ended.out
