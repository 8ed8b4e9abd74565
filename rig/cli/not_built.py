"""Commands that are promised and not built yet: they say so, and nothing else happens."""

import typer

from rig.cli.output import ExitCode, fail

COMMANDS = ("decode",)


def say_so_for_each(app: typer.Typer) -> None:
    """Add every such command, hidden from the help."""
    for name in COMMANDS:
        app.command(name, hidden=True, context_settings={"ignore_unknown_options": True, "allow_extra_args": True})(
            _say_so
        )


def _say_so(context: typer.Context) -> None:
    fail(
        f"{context.info_name}: not built yet, expected one that rig --help lists",
        ExitCode.BAD_INPUT,
        as_json="--json" in context.args,
    )
