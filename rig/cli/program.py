"""The commands of `rig`, and what ends a command that was not understood."""

import logging
import sys
from importlib import import_module

import typer

from rig.cli.not_built import COMMANDS as NOT_BUILT
from rig.cli.output import ExitCode, fail

# typer carries its own copy of click in some versions: its exceptions are reached through a public one.
_ClickException = typer.BadParameter.mro()[2]

# Only what is asked for is imported: a stop must not wait for the libraries that draw a report.
_MODULES = {
    "dry-run": "dry_run",
    "run": "run",
    "check": "check",
    "resume": "resume",
    "compare": "compare",
    "export": "export",
    "study": "study",
    "indent": "indent",
    "finger": "finger",
    "find": "find",
    "export-deck": "export_deck",
    "serve": "serve",
    **dict.fromkeys(("home", "zero", "status", "stop"), "at_the_bench"),
    "jog": "jog",
    "calibrate": "calibrate",
    "bench": "speed",
    "doctor": "doctor",
    **dict.fromkeys(NOT_BUILT, "not_built"),
}


def run() -> None:
    """Carry out what the command line asks for; always ends by SystemExit."""
    # What pymodbus logs of a bad frame is in our own error, in one line.
    logging.getLogger("pymodbus").addHandler(logging.NullHandler())
    try:
        code = _app(sys.argv[1:])(prog_name="rig", standalone_mode=False)
    except Exception as error:
        if not isinstance(error, _ClickException):
            raise
        message = getattr(error, "format_message", error.__str__)()
        if not message:  # the help was asked for by giving nothing
            sys.exit(ExitCode.BAD_INPUT)
        fail(message, ExitCode.BAD_INPUT, as_json="--json" in sys.argv)
    sys.exit(code if isinstance(code, int) else 0)


def _app(arguments: list[str]) -> typer.Typer:
    """The program with the command that is asked for, or with all of them."""
    app = typer.Typer(add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False)
    app.callback()(_about)  # a program of one command would have no command's name
    asked = _MODULES.get(arguments[0]) if arguments else None
    for name in [asked] if asked else dict.fromkeys(_MODULES.values()):
        import_module(f"rig.cli.{name}").register(app)
    return app


def _about() -> None:
    """Indentation rig: run, rehearse and compare fingertip indentations."""
