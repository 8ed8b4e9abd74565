"""The command line: `rig COMMAND`. Exit codes: 0 done, 1 stopped by a limit or trip, 2 bad input, 130 aborted."""

import sys

import typer

from rig.cli import (
    bench,
    calibrate,
    compare,
    doctor,
    dry_run,
    export,
    export_deck,
    finger,
    indent,
    jog,
    not_built,
    run,
    serve,
    speed,
)
from rig.cli.output import ExitCode, fail

# typer carries its own copy of click in some versions: its exceptions are reached through a public one.
_ClickException = typer.BadParameter.mro()[2]

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Indentation rig: run, rehearse and compare fingertip indentations.",
)
dry_run.register(app)
indent.register(app)
finger.register(app)
doctor.register(app)
compare.register(app)
export_deck.register(app)
export.register(app)
run.register(app)
serve.register(app)
bench.register(app)
jog.register(app)
calibrate.register(app)
speed.register(app)
not_built.register(app)


def main() -> None:
    """Entry point of the `rig` program."""
    try:
        code = app(prog_name="rig", standalone_mode=False)
    except Exception as error:
        if not isinstance(error, _ClickException):
            raise
        message = getattr(error, "format_message", error.__str__)()
        if not message:  # the help was asked for by giving nothing
            sys.exit(ExitCode.BAD_INPUT)
        fail(message, ExitCode.BAD_INPUT, as_json="--json" in sys.argv)
    sys.exit(code if isinstance(code, int) else 0)
