"""`rig serve`: the virtual devices in real time, for any client."""

import signal
from typing import Annotated

import typer

from rig.cli.options import FingerConfigOption
from rig.cli.output import ExitCode, complain, err, loading_the_finger, print_json, told_in_one_line
from rig.devices.catalogue import names
from rig.devices.kinds import Room
from rig.plan.config import Config, load_config
from rig.protocol.errors import BadInputError
from rig.session.meeting.stranger import with_stranger
from rig.session.virtual.served_bench import ServedBench
from sim.serve.prefetch import PressStatistics


def command(
    stage: Annotated[str | None, typer.Option(metavar="|".join(names("stage")), help="The stage's kind.")] = None,
    force: Annotated[str | None, typer.Option(metavar="|".join(names("force")), help="The sensor's kind.")] = None,
    pty: Annotated[bool, typer.Option("--pty", help="Behind pseudo-terminals (the default).")] = False,
    tcp: Annotated[
        int | None, typer.Option(metavar="PORT", help="Stage on PORT, force on PORT + 1; 0 takes free ones.")
    ] = None,
    indentor: Annotated[str | None, typer.Option(metavar="S", help="On the carriage, as for `rig indent`.")] = None,
    stranger: Annotated[
        int | None, typer.Option(metavar="SEED", min=0, help="With a finger that nobody was told of, for `rig meet`.")
    ] = None,
    config: FingerConfigOption = None,
) -> None:
    """Print one JSON line of ports, then serve until Ctrl-C."""
    with told_in_one_line(as_json=False):
        settings = _with_indentor(load_config(config), indentor)
        if pty and tcp is not None:
            raise BadInputError("{options}: expected one of them", code="not_together", options="--pty --tcp")
        if tcp is not None and not 0 <= tcp <= 65534:
            raise BadInputError(
                "{option} {value}: expected {low} … {high}",
                code="outside_range", option="--tcp", value=tcp, low=0, high=65534,
            )  # fmt: skip
        if stranger is not None:
            settings = with_stranger(settings, stranger)
        both = stage is None and force is None
        with loading_the_finger():
            bench = ServedBench(
                settings,
                stage=_kind("stage", stage, settings.stage.kind if both else None),
                force=_kind("force", force, settings.force.kind if both else None),
                tcp=tcp,
                complain=complain,
            )
        with bench:
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, lambda *_: bench.stop())
            print_json(bench.ports)
            bench.run()
            if bench.statistics is not None:
                err.print(_told(bench.statistics))
            if bench.press is not None and bench.press.ended:
                raise typer.Exit(ExitCode.STOPPED)


def _kind(room: Room, given: str | None, otherwise: str | None) -> str | None:
    if given is not None and given not in names(room):
        raise BadInputError(
            "{option} {value}: no such device, expected {expected}",
            code="unknown_device", option=f"--{room}", value=given, expected=" or ".join(names(room)),
        )  # fmt: skip
    return given or otherwise


def _with_indentor(config: Config, indentor: str | None) -> Config:
    if indentor is None:
        return config
    return config.model_copy(update={"virtual": config.virtual.model_copy(update={"indentor": indentor})})


def _told(found: PressStatistics) -> str:
    return (
        f"{found.asked} forces asked for, {found.late} not ready in time (the last one given, at most "
        f"{found.stalest_s:.2f} s old; {found.unknown} refused); {found.solved} solved, slowest "
        f"{1e3 * found.slowest_s:.0f} ms"
    )
