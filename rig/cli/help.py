"""Layout of help: flags without a type, options in panels, and the page that `rig` alone prints; whole numbers."""

import json
import math
from collections.abc import Iterable
from copy import copy
from typing import Any, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from rig_shared.number_text import read_number

GENERAL = "General options"
"""Title of the panel of options without a panel, in commands that put other options in panels."""

START_PAGE = """\
rig runs, rehearses and compares indentations of a fingertip.

Three commands to try; none of them needs hardware:

  rig indent --shape bar:3.0 --x-mm 0 --doi-mm 0.5    simulate one press
  rig check first_press                               predict the forces of a protocol
  rig dry-run first_press                             run it on virtual devices

All commands: rig --help    Options of one: rig COMMAND --help
Documentation: docs/index.md; begin with docs/tutorial.md
"""


LARGEST_WHOLE = 2**53 - 1
"""Largest whole number of an option: the largest one that a float and JSON contain exactly."""


class PlainCommand(TyperCommand):
    """Command whose help shows no type beside a flag, and whose numbers are finite and whole ones bounded."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters, laid out for the help; with `--json` comes `--json-schema`."""
        return _laid_out(_with_schema(super().get_params(ctx), [self]))

    def make_context(self, *about: Any, **more: Any) -> Any:
        """Return the context of a command line. Raises BadParameter for a text that is no number."""
        kinds = get_type_hints(self.callback)
        for one in self.params:
            number = _NUMBERS.get(kinds.get(one.name or ""))
            if number is not None and "process_value" not in vars(one):
                _plain_number(one, number)
        return super().make_context(*about, **more)

    def invoke(self, ctx: Any) -> Any:
        """Run the command. Raises BadParameter for a number that is not finite, or a whole one that is too large."""
        for one in self.params:
            value = ctx.params.get(one.name)
            if isinstance(value, float) and not math.isfinite(value):
                raise typer.BadParameter(f"{value} must be a finite number", param_hint=repr(one.opts[0]))
            if isinstance(value, int) and abs(value) > LARGEST_WHOLE:
                words = f"must be at most {LARGEST_WHOLE}, in absolute value"
                raise typer.BadParameter(words, param_hint=repr(one.opts[0]))
        return super().invoke(ctx)


_NUMBERS: dict[Any, str] = {
    int: "a whole number",
    int | None: "a whole number",
    float: "a number",
    float | None: "a number",
}
"""Types of numbers, and their names in errors."""


def _plain_number(param: Any, number: str) -> None:
    """Make a parameter refuse what only Python reads as a number, such as 1_0."""
    processed = param.process_value

    def process_value(ctx: Any, value: Any) -> Any:
        if isinstance(value, str):
            try:
                read_number(value)
            except ValueError:
                words = f"must be {number}, got {value!r}"
                raise typer.BadParameter(words, ctx, param_hint=repr(param.opts[0])) from None
        return processed(ctx, value)

    param.process_value = process_value  # the types of parameters differ between versions of typer


class PlainGroup(TyperGroup):
    """Group of commands whose help shows no type beside a flag."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters, laid out for the help; `--json-schema` if its commands have `--json`."""
        return _laid_out(_with_schema(super().get_params(ctx), self.commands.values()))


def _print_schema(ctx: Any, _parameter: Any, requested: bool) -> None:
    """Print the schema of the command's JSON and exit."""
    if requested:
        from rig.cli.json_schema import schema_of_command  # pydantic is slow to import

        _, command, *_ = ctx.command_path.split()
        print(json.dumps(schema_of_command(command), indent=1, ensure_ascii=False))
        raise typer.Exit


def _with_schema(params: list[Any], commands: Iterable[Any]) -> list[Any]:
    """Return the parameters, with `--json-schema` if one of the commands has `--json`."""
    as_json = next((one for command in commands for one in command.params if one.name == "as_json"), None)
    if as_json is None:
        return params
    found = copy(as_json)  # the class of an option differs between versions of typer
    found.name, found.opts, found.help = "json_schema", ["--json-schema"], "Print the schema of --json and exit."
    found.is_eager, found.expose_value, found.callback = True, False, _print_schema
    at = params.index(as_json) + 1 if as_json in params else 0
    return [*params[:at], found, *params[at:]]


def _laid_out(params: list[Any]) -> list[Any]:
    options = [one for one in params if one.param_type_name == "option"]
    in_panels = any(one.rich_help_panel for one in options)
    for one in options:
        if one.is_flag:
            one.metavar = ""
        if in_panels and not one.rich_help_panel:
            one.rich_help_panel = GENERAL
    for one in params:
        if one not in options:
            one.display_type_rich = lambda ctx: None  # an argument's help states its type
    return sorted(params, key=lambda one: one in options and one.rich_help_panel == GENERAL)
