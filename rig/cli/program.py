"""The commands of `rig`, and what ends a command that was not understood."""

import atexit
import gc
import logging
import sys
from collections.abc import Callable
from difflib import get_close_matches
from importlib import import_module
from types import ModuleType
from typing import Annotated, NamedTuple

import typer

from rig.cli.output import ExitCode, fail, looking_busy, out, show_builds

# typer carries its own copy of click in some versions: its exceptions are reached through a public one.
_ClickException = typer.BadParameter.mro()[2]


class Command(NamedTuple):
    """A module's function or group of commands, and its line in the help."""

    where: str
    line: str


# Only what is asked for is imported: a help comes at once, and a stop does not wait for libraries that draw a report.
COMMANDS = {
    "dry-run": Command("run.dry_run_command", "Run a protocol on virtual devices, over the wire protocol."),
    "run": Command("run.run_command", "Run a protocol on the ports of the configuration."),
    "meet": Command("identify.meet_command", "Learn in a few gentle presses which finger lies there."),
    "check": Command(
        "run.check_command", "Say what a protocol will do and how near the limits it goes; moves nothing."
    ),
    "resume": Command(
        "run.resume_command", "Go on with a run that stopped: home, zero, then exactly what is missing."
    ),
    "compare": Command("compare.command", "SSRPs, shape test, correlations, fits and a report of finished runs."),
    "runs": Command(
        "runs.runs_command", "List runs, by subject, shape, protocol, date or state, or tabulate their holds."
    ),
    "show": Command("runs.show_command", "Say of one run what ran, with what, how it ended and what its files are."),
    "watch": Command(
        "monitor.watch_command", "Look on at a run from elsewhere: live force, step now and next, time left."
    ),
    "panel": Command(
        "panel.panel_command", "A page in the browser: the run that goes on, or the bench by hand, with STOP."
    ),
    "export": Command("runs.export_command", "Write a run's journal as HDF5 and CSV, or as NWB, into its folder."),
    "study": Command("study.command", "A parameter study: every combination of fingers, receptors and presses."),
    "indent": Command("indent.indent_command", "One simulated indentation."),
    "impulse": Command("encode.impulse_command", "Impulse responses of the section: strains under a point load."),
    "shift-invariance": Command(
        "encode.shift_invariance_command", "SED under point loads at 24 sites: how alike it falls off."
    ),
    "encode": Command("encode.encode_command", "From pressure on the skin to what receptors under it say."),
    "decode": Command("decode.decode_command", "Pressure on the skin, read back from what receptors under it say."),
    "finger": Command("finger.finger_command", "Fit the finger's skin, build its mesh and say how good both are."),
    "find": Command("identify.find_command", "Say where the finger lies, from a run of find_finger."),
    "export-deck": Command("finger.export_deck_command", "Write a scene as a CalculiX input deck."),
    "serve": Command("serve.serve_command", "Virtual devices in real time, behind ports that any program can open."),
    "stranger": Command(
        "serve.stranger_command", "The truth of a finger of rig serve --stranger, beside what was met."
    ),
    "home": Command("bench.home", "Find the home switches."),
    "zero": Command("bench.zero", "Zero the force sensor, with nothing on it."),
    "status": Command("bench.status", "Where the stage is and what the sensor feels; moves nothing."),
    "stop": Command("stop.stop_command", "Stop the stage now, whoever moves it."),
    "jog": Command("jog.command", "Move an axis by hand: hold a key, or give --axis and --by-mm."),
    "by-hand": Command("panel.owning_command", "Own the ports while somebody works at the bench through rig panel."),
    "calibrate": Command("calibrate.calibrate", "Measure the rig: steps/mm, force scale, compliance."),
    "bench": Command("system.speed_command", "Speed against error on this machine: one HTML page."),
    "cache": Command("system.cache_command", "What is kept on disk to save work, and how large; removes it."),
    "config": Command(
        "system.config_command", "Every key of the configuration: its unit, range, default and effect."
    ),
    "doctor": Command("system.doctor_command", "Ports, versions, limits, solver and cache of this installation."),
}


LOOKED_THROUGH = (50_000, 3, 3)
"""New objects that are looked through for garbage, and how often older ones are with them. At Python's own (700, 10,
10) that takes a thirtieth of a dry-run; a figure is a hundred thousand objects, and few may lie about at a time."""


def run() -> None:
    """Carry out what the command line asks for; always ends by SystemExit."""
    gc.set_threshold(*LOOKED_THROUGH)
    atexit.register(gc.freeze)  # memory goes back with the process: nothing is looked through once more before
    # What pymodbus logs of a bad frame is in our own error, in one line.
    logging.getLogger("pymodbus").addHandler(logging.NullHandler())
    show_builds()
    try:
        code = _app(sys.argv[1:])(prog_name="rig", standalone_mode=False)
    except Exception as error:
        if not isinstance(error, _ClickException):
            raise
        message = getattr(error, "format_message", error.__str__)()
        if not message:  # the help was asked for by giving nothing
            sys.exit(ExitCode.BAD_INPUT)
        fail(message, "usage", ExitCode.BAD_INPUT, as_json="--json" in sys.argv)
    sys.exit(code if isinstance(code, int) else 0)


def _app(arguments: list[str]) -> typer.Typer:
    """The program with the command that is asked for, or with the names of all of them."""
    app = typer.Typer(add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False)
    app.callback()(_about)  # a program of one command would have no command's name
    asked = next((word for word in arguments if word != "--"), "")
    if asked in COMMANDS:
        module, _, command = COMMANDS[asked].where.partition(".")
        with looking_busy(f"rig {asked}: starting …"):
            _add(app, asked, getattr(_imported(f"rig.cli.{module}"), command))
        return app
    near = get_close_matches(asked, COMMANDS, cutoff=0.65)
    if near:
        raise typer.BadParameter(
            f"No such command {asked!r}, expected one that rig --help lists: {' or '.join(near)}?"
        )
    for name in COMMANDS:
        _add(app, name, _named)
    return app


def _imported(name: str) -> ModuleType:
    """A command's module. What it brings along stays: to look it through for garbage takes a tenth of a dry-run."""
    new = name not in sys.modules
    gc.disable()
    try:
        return import_module(name)
    finally:
        if new:
            gc.freeze()
        gc.enable()


def _add(app: typer.Typer, name: str, command: Callable[..., None] | typer.Typer) -> None:
    """A command, or a group of them, with its line in the help."""
    line = COMMANDS[name].line
    if isinstance(command, typer.Typer):
        app.add_typer(command, name=name, help=line)
    else:
        app.command(name, help=line)(command)


def _named() -> None:
    """A command in the list of them, when none is asked for."""


def _say_version(asked: bool) -> None:
    """Print it and end."""
    if asked:
        from importlib.metadata import version

        out.print(f"rig {version('indentation-rig')}")
        raise typer.Exit


def _about(
    version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Say which.")
    ] = False,
) -> None:
    """Indentation rig: run, rehearse and compare fingertip indentations."""
