"""`rig serve`: virtual devices in real time, and the parameters of a random finger."""

import json
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, NotRequired, cast

import typer

from rig.bench.served import ServedBench
from rig.cli.options import FingerConfigOption, JsonOption, option
from rig.cli.output import THE_FINGER, ExitCode, busy, complain, err, out, print_json, resting, writes_json
from rig.cli.request import Excludes, Needs, Rule, takes
from rig.devices.registry import Room, names
from rig.errors import BadInputError
from rig.identify.random_finger import truth_of, with_random_finger
from rig.plan.config import Config, load_config
from rig.plan.finger_file import IdentifiedFinger, read_finger_file
from rig.printable import either
from rig.units import unit_of_key
from rig_shared.outputs import Output, Port, Unit
from sim.identification.prior import ParameterName, named, plain
from sim.serve.prefetch import PressStatistics

_DEVICES, _FINGER = "Devices", "Finger"


class ServedPortsJson(Output):
    """Ports of the virtual devices."""

    stage: NotRequired[Port]
    force: NotRequired[Port]
    x_port: NotRequired[Port]
    """Second port of a stage with a controller for each axis."""
    http_port: NotRequired[int]
    """TCP port of the web page of a Net F/T."""


class TrueParameterJson(Output):
    """A parameter of a random finger, beside its 90 % band in a finger file."""

    name: ParameterName
    unit: Unit
    truth: float
    low: NotRequired[float]
    high: NotRequired[float]
    inside: NotRequired[bool]


class RandomFingerJson(Output):
    """Parameters of a random finger."""

    parameters: list[TrueParameterJson]


@dataclass(frozen=True)
class ServeRequest:
    """Arguments and options of `rig serve`."""

    stage: Annotated[
        str | None, option(f"Kind of stage: {either(names('stage'))}. Default: the configured one.", "KIND", _DEVICES)
    ] = None
    force: Annotated[
        str | None,
        option(
            f"Kind of force sensor: {either(names('force'))}. Default: the configured one.",
            "KIND",
            _DEVICES,
            name="--force-sensor",
        ),
    ] = None
    pty: Annotated[bool, option("Serve on pseudo-terminals; not on Windows.", panel=_DEVICES, name="--pty")] = False
    tcp: Annotated[
        int | None,
        option(
            "TCP port of the stage, {within}; the force sensor has the next. 0 selects free ports. "
            "Default: pseudo-terminals; free TCP ports on Windows.",
            "PORT",
            _DEVICES,
            within=(0, 65534),
        ),
    ] = None
    indentor: Annotated[
        str | None, option("Mounted indentor, as in rig indent. Default: the configured one.", "S", _DEVICES)
    ] = None
    random_finger: Annotated[
        int | None,
        option(
            "Serve a random finger of this seed, to be identified. Default: the configured finger.",
            "SEED",
            _FINGER,
            min=0,
        ),
    ] = None
    reveal: Annotated[
        int | None,
        option(
            "Seed of a random finger to print instead of serving. Default: serve devices.", "SEED", _FINGER, min=0
        ),
    ] = None
    beside: Annotated[Path | None, option("Finger file to compare with --reveal.", "TOML", _FINGER)] = None
    config: FingerConfigOption = None
    as_json: JsonOption = False

    rules: ClassVar[Sequence[Rule]] = (
        Needs("--beside", ("--reveal",)),
        Excludes("--pty", ("--tcp",), "not_together"),
    )


@takes(ServeRequest)
def serve_command(request: ServeRequest) -> None:
    """Print one JSON line of ports, then serve until Ctrl-C; or print the parameters of a random finger."""
    if request.reveal is not None:
        _reveal(request.reveal, request.beside)
        return
    settings = _with_indentor(load_config(request.config), request.indentor)
    if request.pty and sys.platform == "win32":
        raise BadInputError(
            "--pty: Windows has no pseudo-terminals; use --tcp PORT, or neither for free TCP ports",
            "no_terminals",
        )
    if request.random_finger is not None:
        settings = with_random_finger(settings, request.random_finger)
    both = request.stage is None and request.force is None
    with busy(THE_FINGER, quick=True):
        bench = ServedBench(
            settings,
            stage=_kind("stage", request.stage, settings.stage.kind if both else None),
            force=_kind("force", request.force, settings.force.kind if both else None),
            tcp=request.tcp,
            complain=complain,
        )
    with bench:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: bench.stop())
        print_json(cast(ServedPortsJson, bench.ports | bench.pages))  # names are those of the kinds of devices
        if sys.stderr.isatty():
            err.print("\n".join(["in rig.toml:", *_tables(bench)]))
            if settings.sync.adapter is not None:
                err.print(f'no {settings.sync.adapter} is served: use sync.output = "off" with these ports')
        with resting():
            bench.run()
        if bench.statistics is not None:
            err.print(_statistics_line(bench.statistics))
        if bench.press is not None and bench.press.ended:
            raise typer.Exit(ExitCode.STOPPED)


def _tables(bench: ServedBench) -> list[str]:
    """Return the lines of a configuration file that names these ports."""
    return [
        line
        for name, port in (*bench.ports.items(), *bench.pages.items())
        for line in (
            f"[{bench.tables[name]}]",
            f"{'port' if name in ('stage', 'force') else name} = {json.dumps(port)}",
        )
    ]


def _kind(room: Room, name: str | None, otherwise: str | None) -> str | None:
    if name is not None and name not in names(room):
        option = "--force-sensor" if room == "force" else "--stage"
        raise BadInputError(
            f"{option} {name}: unknown kind of device; choose {either(names(room))}", "unknown_device"
        )
    return name or otherwise


def _with_indentor(config: Config, indentor: str | None) -> Config:
    if indentor is None:
        return config
    return config.model_copy(update={"virtual": config.virtual.model_copy(update={"indentor": indentor})})


def _statistics_line(found: PressStatistics) -> str:
    return (
        f"{found.requested} forces requested, {found.late} not ready in time (the last force was repeated, at "
        f"most {found.stalest_s:.2f} s old; {found.unknown} refused); {found.solved} solved, slowest "
        f"{1000.0 * found.slowest_s:.0f} ms"
    )


def _reveal(seed: int, beside: Path | None) -> None:
    """Print each parameter of a random finger, with its 90 % band from a finger file."""
    truth = truth_of(seed)
    identified = None if beside is None else read_finger_file(beside).identified
    found = [_with_band(name, value, identified) for name, value in truth.items()]
    if writes_json():
        truths: RandomFingerJson = {"parameters": found}
        print_json(truths)
        return
    for one in found:
        out.print(f"{one['name']:<14}{one['truth']:<8.3g}{_band(one)}")


def _with_band(name: str, value: float, identified: IdentifiedFinger | None) -> TrueParameterJson:
    """Return a parameter without its logarithm, and its band in the finger file."""
    found: TrueParameterJson = {
        "name": named(name),
        "unit": unit_of_key(named(name)) or "1",
        "truth": plain(name, value),
    }
    if identified is None or name not in identified.posterior.names:
        return found
    low, high = identified.posterior.band(name, identified.band.coverage)
    found["low"], found["high"], found["inside"] = plain(name, low), plain(name, high), low <= value <= high
    return found


def _band(one: TrueParameterJson) -> str:
    if "low" not in one:
        return ""
    return f"  identified {one['low']:.3g} … {one['high']:.3g}{'' if one['inside'] else '  !'}"
