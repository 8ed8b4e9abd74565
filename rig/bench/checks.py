"""What the devices of a bench say when they are asked and nothing is changed: for `rig status` and `rig doctor`."""

from contextlib import closing
from typing import Any

from rig.devices.drivers import open_force, open_stage
from rig.devices.force.base import ForceError
from rig.devices.stage.base import StageError, StageStatus
from rig.engine.by_hand.bench_memory import BenchMemory
from rig.errors import code_of
from rig.plan.config import Config
from rig.session.control.at_work import at_work
from rig.transport import PortOwner, TransportError, first_owner, port_owner
from rig.transport.clock import WallClock

_AT_REST = ("Idle", "Alarm")


def look(settings: Config, *, closely: bool = False) -> dict[str, dict[str, Any]]:
    """Stage and force as they are: kind, port, who has that and what they do, or what the device says, or a problem.

    closely: a stage at rest also says who it is, and its settings are compared with the configuration.
    """
    stage, force = settings.stage, settings.force
    return {
        "stage": {"kind": stage.kind, "port": " and ".join(stage.ports), **_look_at_stage(settings, closely=closely)},
        "force": {"kind": force.kind, "port": force.port, **_look_at_force(settings)},
    }


def contact(settings: Config) -> dict[str, Any]:
    """What is on record about contact; nothing where no command has found anything out."""
    known = BenchMemory(settings).read().contact
    return {"words": "nothing on record"} if known is None else known.as_json()


def in_one_line(found: dict[str, Any]) -> str:
    """Return what was found for a terminal: its sentences where it has any, else keys and values but for codes."""
    sentences = [str(found[key]) for key in ("words", "to_do") if found.get(key)]
    return "; ".join(sentences) or ", ".join(f"{key} {value}" for key, value in found.items() if key != "code")


def position(at: StageStatus) -> dict[str, Any]:
    """A status as JSON: machine coordinates in mm."""
    return {"state": at.state, "x_mm": at.x_mm, "y_mm": at.y_mm, "z_mm": at.z_mm}


def _look_at_stage(settings: Config, *, closely: bool) -> dict[str, Any]:
    owner = first_owner(settings.stage.ports)
    if owner is not None:
        return _owned(owner)
    found: dict[str, Any] = {}
    try:
        with closing(open_stage(settings, WallClock())) as stage:
            found |= position(stage.look())
            if closely and found["state"] in _AT_REST:
                found["identity"] = stage.connect()
    except (StageError, TransportError) as error:
        found |= {"problem": str(error), "code": code_of(error)}
    return found


def _look_at_force(settings: Config) -> dict[str, Any]:
    owner = port_owner(settings.force.port)
    if owner is not None:
        return _owned(owner)
    try:
        with closing(open_force(settings, WallClock())) as force:
            name = force.identify()
            reading = force.read()
            return {"identity": name, "force_n": reading.force_n, "stable": reading.stable}
    except (ForceError, TransportError) as error:
        return {"problem": str(error), "code": code_of(error)}


def _owned(owner: PortOwner) -> dict[str, Any]:
    """Who has a port, by number where the system tells it, and what they do."""
    return {"owner": str(owner)} if owner.pid is None else {"owner": owner.pid, **at_work(owner.pid)}
