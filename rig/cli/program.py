"""Commands of `rig`, and the error for a command line that cannot be parsed."""

import atexit
import gc
import logging
import sys
from collections.abc import Callable
from difflib import get_close_matches
from importlib import import_module
from types import ModuleType
from typing import Annotated, Literal, NamedTuple, get_args

import typer

from rig.cli.help import START_PAGE, PlainCommand, PlainGroup
from rig.cli.output import ExitCode, fail, out, show_builds, starting
from rig.printable import printable

# some versions of typer carry their own copy of click, whose exceptions are reached through a public one.
_ClickException = typer.BadParameter.mro()[2]


Group = Literal["Experiment", "Bench", "Results", "Simulation", "Coding", "System"]


class Command(NamedTuple):
    """Command or group in a module, its line in the help, and the panel that lists it."""

    where: str
    line: str
    group: Group
    hidden: bool = False
    by_program: bool = False  # started by a program, which reads the last line: no progress


# Only the requested command is imported, so that help is fast and a stop does not wait for plotting libraries.
COMMANDS = {
    "dry-run": Command("run.dry_run_command", "Run a protocol on virtual devices.", "Experiment"),
    "run": Command("run.run_command", "Run a protocol on the rig.", "Experiment"),
    "identify": Command(
        "identify_finger.identify_command", "Identify the finger from a few light presses.", "Experiment"
    ),
    "check": Command("run.check_command", "Check a protocol against the limits without motion.", "Experiment"),
    "design": Command("design.command", "Choose presses that distinguish candidate measures.", "Experiment"),
    "resume": Command("run.resume_command", "Resume a stopped run and do the remaining steps.", "Experiment"),
    "nerve": Command("nerve.nerve_command", "Add spikes of simulated afferents to a run.", "Results"),
    "compare": Command("compare.command", "Compare runs with recordings and write a report.", "Results"),
    "runs": Command("runs.runs_command", "List runs, or write a table of their holds.", "Results"),
    "show": Command("runs.show_command", "Describe a run: state, limits, forces and files.", "Results"),
    "watch": Command("watch.watch_command", "Monitor a running protocol.", "Experiment"),
    "stream": Command("stream.stream_command", "Stream runs to the Lab Streaming Layer (LSL).", "Experiment"),
    "panel": Command("panel.panel_command", "Open the browser panel to monitor or move the rig.", "Experiment"),
    "export": Command("runs.export_command", "Export a run to HDF5 and CSV, to NWB, or as a report.", "Results"),
    "study": Command("study.command", "Simulate all combinations of a parameter study.", "Simulation"),
    "indent": Command("indent.indent_command", "Simulate one indentation.", "Simulation"),
    "impulse": Command("encode.impulse_command", "Compute strains in the skin under a point load.", "Coding"),
    "shift-invariance": Command(
        "encode.shift_invariance_command", "Fit how SED decays with distance from a point load.", "Coding"
    ),
    "encode": Command("encode.encode_command", "Compute receptor readings from skin pressure.", "Coding"),
    "decode": Command("decode.decode_command", "Estimate skin pressure from receptor readings.", "Coding"),
    "finger": Command("finger.finger_command", "Fit the skin, build the mesh and print their quality.", "Simulation"),
    "find": Command("identify_finger.find_command", "Locate the finger from a run of find_finger.", "Experiment"),
    "export-deck": Command("finger.export_deck_command", "Write an indentation as a CalculiX deck.", "Simulation"),
    "serve": Command("serve.serve_command", "Serve virtual devices in real time on ports.", "Simulation"),
    "init": Command("init.init_command", "Find the devices and write a configuration file.", "Bench"),
    "home": Command("bench.home", "Home all axes of the stage.", "Bench"),
    "zero": Command("bench.zero", "Zero the force sensor.", "Bench"),
    "status": Command("bench.status", "Print the stage position and the sensor reading.", "Bench"),
    "stop": Command("stop.stop_command", "Stop the stage now, whichever program moves it.", "Bench"),
    "pulse": Command("pulse.pulse_command", "Send test pulses to the recording amplifier.", "Bench"),
    "jog": Command("jog.command", "Move an axis by keys or by a distance.", "Bench"),
    "by-hand": Command(
        "panel.owning_command",
        "Own the ports for manual control from rig panel.",
        "Bench",
        hidden=True,
        by_program=True,
    ),
    "take-orders": Command(
        "take_orders.take_orders_command",
        "Press on orders of another program, such as Bluesky.",
        "Experiment",
        hidden=True,
        by_program=True,
    ),
    "calibrate": Command("calibrate.calibrate", "Calibrate steps/mm, force scale or compliance.", "Bench"),
    "bench": Command("installation.speed_command", "Measure the time and error of the models.", "System"),
    "cache": Command("installation.cache_command", "List or delete cached results.", "System"),
    "config": Command("installation.config_command", "Print configuration keys with units and ranges.", "System"),
    "doctor": Command("installation.doctor_command", "Check ports, versions, limits and cache.", "System"),
}

_GROUPS: tuple[Group, ...] = get_args(Group)

LOOKED_THROUGH = (50_000, 3, 3)
"""Thresholds of Python's garbage collector: new objects before a collection, and collections before older objects
join it. With the defaults (700, 10, 10) a dry run spends a thirtieth of its time there; a figure has a hundred
thousand objects, so the threshold must not be much larger."""


def run() -> None:
    """Run the requested command; always end by SystemExit."""
    gc.set_threshold(*LOOKED_THROUGH)
    sys.excepthook = _print_traceback
    atexit.register(gc.freeze)  # the exit of the process frees memory, so no last collection is needed
    # Our own error has what pymodbus logs of a bad frame, in one line.
    logging.getLogger("pymodbus").addHandler(logging.NullHandler())
    show_builds()
    if not sys.argv[1:]:
        out.print(START_PAGE, end="")
        sys.exit(ExitCode.BAD_INPUT)
    try:
        code = _app(sys.argv[1:])(sys.argv[1:], prog_name="rig", standalone_mode=False)
    except Exception as error:
        if not isinstance(error, _ClickException):
            raise
        from rig.errors import wrong_value  # loaded only for an error, so that help is fast

        message = wrong_value(getattr(error, "format_message", error.__str__)(), error.__cause__)
        if not message:  # help was requested by an empty command line
            sys.exit(ExitCode.BAD_INPUT)
        fail(message, "usage", ExitCode.BAD_INPUT, as_json="--json" in sys.argv)
    sys.exit(code if isinstance(code, int) else 0)


def _print_traceback(_kind: type[BaseException], error: BaseException, _trace: object) -> None:
    """Print the traceback of an unforeseen error, whose message may contain anything."""
    import traceback

    print(printable("".join(traceback.format_exception(error))), end="", file=sys.stderr)


def _app(arguments: list[str]) -> typer.Typer:
    """Return the program with the requested command, or with the names of all commands."""
    app = typer.Typer(cls=PlainGroup, add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False)
    app.callback()(_about)  # without it, a program of one command has no command name
    requested = next((word for word in arguments if word != "--"), "")
    if requested in COMMANDS:
        module, _, command = COMMANDS[requested].where.partition(".")
        silent = COMMANDS[requested].by_program or not {"--help", "--json-schema"}.isdisjoint(arguments)
        with starting(f"rig {requested}", silent=silent):
            _add(app, requested, getattr(_imported(f"rig.cli.{module}"), command))
        return app
    near = get_close_matches(requested, COMMANDS, cutoff=0.65)
    if near:
        raise typer.BadParameter(
            f"there is no command {requested!r}; did you mean {' or '.join(near)}? `rig --help` lists all commands"
        )
    for name in sorted(COMMANDS, key=lambda one: _GROUPS.index(COMMANDS[one].group)):
        _add(app, name, _named)
    return app


def _imported(name: str) -> ModuleType:
    """Import a command's module, exempt from garbage collection, which takes a tenth of a dry run."""
    new = name not in sys.modules
    gc.disable()
    try:
        return import_module(name)
    finally:
        if new:
            gc.freeze()
        gc.enable()


def _add(app: typer.Typer, name: str, command: Callable[..., None] | typer.Typer) -> None:
    """Add a command, or a group of commands, with its line in the help."""
    _, line, group, hidden, _ = COMMANDS[name]
    if isinstance(command, typer.Typer):
        app.add_typer(command, name=name, cls=PlainGroup, help=line, rich_help_panel=group, hidden=hidden)
    else:
        app.command(name, cls=PlainCommand, help=line, rich_help_panel=group, hidden=hidden)(command)


def _named() -> None:
    """Add a command to the list of commands."""


def _print_version(requested: bool) -> None:
    """Print the version and exit."""
    if requested:
        from importlib.metadata import version

        out.print(f"rig {version('indentation-rig')}")
        raise typer.Exit


def _about(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Run, rehearse and compare indentations of a fingertip."""
