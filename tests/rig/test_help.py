"""Options of all commands: a number has a unit and a default, and an option has one meaning wherever it stands."""

import re
from collections import defaultdict
from collections.abc import Iterator
from typing import Any, get_args, get_type_hints

import typer

from rig.cli import program
from rig.cli.program import COMMANDS

ABSENT = re.compile(r"Default: |Give this or --")
UNIT = re.compile(
    r"\b(mm|m|mm/s|gwt|g|s|dB|GB|days|pseudo-units|units? of SED|seconds per|[Nn]umber of|min|[Ss]amples of|[Ss]eed|"
    r"TCP port)\b|%"
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


def test_the_help_of_every_numeric_option_states_unit_and_default() -> None:
    for name in HOLDING_NUMBERS:
        option = OPTIONS[name]
        if not option.hidden:
            assert UNIT.search(option.help) or name.split()[-1] in DIMENSIONLESS, name
            assert option.required or option.default is not None or ABSENT.search(option.help), name


KNOWN = {"--columns"}
"""Flags of one command that concern the same thing as the value of another."""


def test_no_option_is_a_flag_on_one_command_and_takes_a_value_on_another() -> None:
    kinds = defaultdict[str, set[bool]](set)
    for option in OPTIONS.values():
        if option.param_type_name == "option":
            for name in option.opts:
                kinds[name].add(option.is_flag)
    assert {name for name, found in kinds.items() if len(found) > 1} <= KNOWN
