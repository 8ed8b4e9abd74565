"""What a kind of device is: one entry says all that the rest of the program must know of it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from rig.devices.force.base import ForceSensor
from rig.devices.stage.base import Stage
from rig.transport import Transport
from rig.transport.clock import Clock
from rig.transport.port_settings import Settings

if TYPE_CHECKING:  # the settings are checked against the entries
    from rig.devices.bench_settings import BenchSettings, StageSettings

Opener = Callable[[str], Transport]
Room = Literal["stage", "force"]


def own_port(stage: "StageSettings") -> tuple[str, ...]:
    """One device on one port."""
    return (stage.port,)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What every entry says.

    name: as in `kind = "…"`. device: what it is, in words. settings: the table of its own, which stands in [stage] or
    [force] under `table`, or else under its name. twin: "module:function" of its virtual twin, for the virtual bench
    alone to find (StageTwin, ForceTwin in `sim/devices/line.py`); empty where it has none. tests: the modules that
    hold its driver to the bytes of the real device, from the folder of its project.
    """

    room: ClassVar[Room]
    name: str
    device: str
    tests: tuple[str, ...]
    settings: type[Settings] | None = None
    table: str = ""
    twin: str = ""

    @property
    def place(self) -> str:
        """Where in [stage] or [force] its own table stands."""
        return self.table or self.name


@dataclass(frozen=True, kw_only=True)
class StageKind(Kind):
    """A kind of stage.

    driver raises what the opener raises. ports: every one that it is on, by its settings. axes: those with a motor,
    x lateral, y along the finger, z vertical. outputs: of sync.output, those that it can switch. inputs: names of the
    stop inputs that its driver can report, for [stop].
    """

    room: ClassVar[Room] = "stage"
    driver: Callable[[Opener, Clock, "BenchSettings"], Stage]
    ports: Callable[["StageSettings"], tuple[str, ...]] = own_port
    axes: Literal["xz", "xyz"] = "xyz"
    outputs: tuple[str, ...] = ("off",)
    inputs: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ForceKind(Kind):
    """A kind of force sensor; driver raises what the opener raises."""

    room: ClassVar[Room] = "force"
    driver: Callable[[Opener, Clock, "BenchSettings"], ForceSensor]
