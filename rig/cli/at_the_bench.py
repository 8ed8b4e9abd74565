"""The bench-side verbs: `rig home`, `zero`, `status` and `stop`, each for whoever stands beside the rig."""

import os
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import typer

from rig.cli.interrupts import STOP_SIGNAL, at_once
from rig.cli.looking import look, position
from rig.cli.options import ConfigOption, JsonOption
from rig.cli.output import ExitCode, complain, out, print_json, told_in_one_line
from rig.devices.catalogue import open_force, open_stage
from rig.devices.stage.base import Stage
from rig.plan.config import Config, load_config
from rig.transport import TransportError, first_owner
from rig.transport.clock import WallClock

_LET_GO_S = 5.0


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("home", help="Find the home switches.")(home)
    app.command("zero", help="Zero the force sensor, with nothing on it.")(zero)
    app.command("status", help="Where the stage is and what the sensor feels; moves nothing.")(status)
    app.command("stop", help="Stop the stage now, whoever moves it.")(stop)


@contextmanager
def stage_at_hand(settings: Config) -> Iterator[tuple[Stage, WallClock]]:
    """The stage, connected; whatever interrupts its use stops it past every queue."""
    clock = WallClock()
    with at_once(), closing(open_stage(settings, clock)) as stage:
        try:
            stage.connect()
            yield stage, clock
        except KeyboardInterrupt:
            stage.stop()
            raise


def home(config: ConfigOption, as_json: JsonOption = False) -> None:
    """Home all axes and say where they then are."""
    with told_in_one_line(as_json=as_json), stage_at_hand(load_config(config)) as (stage, _):
        stage.home()
        tell(position(stage.status()), as_json=as_json)


def zero(config: ConfigOption, as_json: JsonOption = False) -> None:
    """Take the present load for zero."""
    with told_in_one_line(as_json=as_json), at_once():
        clock = WallClock()
        with closing(open_force(load_config(config), clock)) as force:
            name = force.connect()
            force.zero()
            clock.wait_s(2 * force.sample_period_s)
            tell({"identity": name, "force_n": force.read().force_n}, as_json=as_json)


def status(config: ConfigOption, as_json: JsonOption = False) -> None:
    """Look at both devices; a port that somebody owns is left alone."""
    with told_in_one_line(as_json=as_json):
        found = look(load_config(config))
        tell(found, as_json=as_json)
        problems = [device["problem"] for device in found.values() if "problem" in device]
        for problem in problems:
            complain(problem)
    raise typer.Exit(ExitCode.STOPPED if problems else ExitCode.DONE)


def stop(config: ConfigOption, as_json: JsonOption = False) -> None:
    """Tell the owner of the stage's port to stop; then, or if there is none, send the stop down the wire."""
    with told_in_one_line(as_json=as_json):
        settings = load_config(config)
        ports = settings.stage.ports
        owner = first_owner(ports)
        if owner is not None:
            _have_it_let_go(ports, owner)
        with closing(open_stage(settings, WallClock())) as stage:
            stage.stop()
        tell({"stopped": " and ".join(ports), "owner": owner}, as_json=as_json)


def tell(found: dict[str, Any], *, as_json: bool) -> None:
    """As one JSON object, or a line for each entry."""
    if as_json:
        print_json(found)
        return
    for name, value in found.items():
        if isinstance(value, dict):
            value = ", ".join(f"{k} {v}" for k, v in value.items())
        out.print(f"{name:<12}{value}")


def _have_it_let_go(ports: tuple[str, ...], owner: int) -> None:
    port = " and ".join(ports)
    if STOP_SIGNAL is None:
        raise TransportError(f"{port} is in use by process {owner}, which cannot be signalled on this system")
    try:
        os.kill(owner, STOP_SIGNAL)
    except ProcessLookupError:
        return
    except OSError as error:
        raise TransportError(f"{port} is in use by process {owner}: {error.strerror}") from None
    clock = WallClock()
    if not clock.wait_until(lambda: first_owner(ports) is None, clock.monotonic_s() + _LET_GO_S):
        raise TransportError(f"process {owner} was told to stop and has not let go of {port}: use the emergency stop")
