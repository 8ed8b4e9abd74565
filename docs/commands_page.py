"""The commands of `rig` as a page, read off the program."""

from typing import Any

import typer

from rig.cli import program

_HEAD = """\
# Commands

The output of `rig COMMAND --help` for all commands.

Exit codes: 0 done; 1 stopped by a limit, a trip or a device, or closed output; 2 bad input or a file
that cannot be written (one line: what, where, what was expected); 130 stopped by Ctrl-C. `--json` prints
exactly one JSON object on standard output; all else goes to standard error. With `--json` comes
`--json-schema`, which prints the schema of that object.

In `rig dry-run`, `run` and `resume`, Ctrl-C (or a closed terminal) stops at the next safe point and lifts; a second
Ctrl-C stops at once. It ends every other command at once, `rig serve` with 0. These three commands print the time
left from the first second on, in a pipe one line per indentation, and with `--json` nothing.
"""


def commands_page() -> str:
    """Every command with its arguments and options."""
    parts = [_HEAD]
    for name in program.COMMANDS:
        found = typer.main.get_command(program._app([name])).commands[name]
        parts += _command(name, found)
        for below, child in getattr(found, "commands", {}).items():
            parts += _command(f"{name} {below}", child)
    return "".join(parts)


def _command(name: str, found: Any) -> list[str]:
    lines = [f"\n## `rig {name}`\n\n{_plain(found.help or program.COMMANDS[name.split()[0]].line)}\n"]
    rows = [row for row in map(_row, getattr(found, "params", [])) if row]
    return [*lines, "\n| | | |\n|---|---|---|\n", *rows] if rows else lines


def _row(one: Any) -> str:
    if "--help" in one.opts or getattr(one, "hidden", False):
        return ""
    names = ", ".join(f"`{name}`" for name in (*one.opts, *one.secondary_opts))
    words = _plain(getattr(one, "help", "") or "")
    default = one.default if isinstance(one.default, str | int | float) and one.default not in ("", False) else None
    told = words if default is None else f"{words} Default: {default}."
    return f"| {names} | {_cell(one.metavar or '')} | {_cell(told)} |\n"


def _plain(text: str) -> str:
    return " ".join(text.split())


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
