"""The devices of a real bench, by the names of their kinds, on the ports of the configuration.

A new device is one function here and one line in STAGES or FORCES.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TextIO

from rig.clock import Clock, WallClock
from rig.force.base import ForceSensor
from rig.force.mtsics import MtSicsForce
from rig.settings import RigSettings
from rig.stage.base import Stage
from rig.stage.grbl import GrblStage
from rig.stage.grbl_settings import expected_settings
from rig.transport import LoggedTransport, Transport, open_port


def _grbl(port: Transport, clock: Clock, settings: RigSettings) -> GrblStage:
    return GrblStage(port, clock, expected=expected_settings(settings))


def _mtsics(port: Transport, clock: Clock, settings: RigSettings) -> MtSicsForce:
    scale = settings.calibration.value("force_scale", 1.0)
    return MtSicsForce(port, clock, sample_period_s=settings.force.sample_period_s, scale=scale)


STAGES: dict[str, Callable[[Transport, Clock, RigSettings], Stage]] = {"grbl": _grbl}
FORCES: dict[str, Callable[[Transport, Clock, RigSettings], ForceSensor]] = {"mtsics": _mtsics}


def open_stage(settings: RigSettings, clock: Clock, byte_log: TextIO | None = None) -> Stage:
    """The stage on its port, not yet spoken to. Raises TransportError."""
    return STAGES[settings.stage.kind](
        _open(settings.stage.port, settings.stage.baud, clock, byte_log), clock, settings
    )


def open_force(settings: RigSettings, clock: Clock, byte_log: TextIO | None = None) -> ForceSensor:
    """The force sensor on its port, not yet spoken to. Raises TransportError."""
    return FORCES[settings.force.kind](
        _open(settings.force.port, settings.force.baud, clock, byte_log), clock, settings
    )


def _open(port: str, baud: int, clock: Clock, byte_log: TextIO | None) -> Transport:
    transport = open_port(port, baud)
    return transport if byte_log is None else LoggedTransport(transport, clock, byte_log)


@dataclass(frozen=True)
class RealBench:
    """What the engine needs, on real ports and the wall clock; `ask_to_mount` tells the person at the bench."""

    clock: WallClock
    stage: Stage
    force: ForceSensor
    ask_to_mount: Callable[[str], None]

    def mount(self, indentor: str) -> None:
        """Returns when the person says that it is on."""
        self.ask_to_mount(indentor)

    def true_pose(self) -> None:
        """Nobody knows it on a real bench."""

    def close(self) -> None:
        """Give the ports back."""
        self.stage.close()
        self.force.close()


def open_bench(settings: RigSettings, ask_to_mount: Callable[[str], None], byte_log: TextIO) -> RealBench:
    """Open both ports; the bytes go to `byte_log`. Raises TransportError."""
    clock = WallClock()
    stage = open_stage(settings, clock, byte_log)
    try:
        return RealBench(clock, stage, open_force(settings, clock, byte_log), ask_to_mount)
    except BaseException:
        stage.close()
        raise
