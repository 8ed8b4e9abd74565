"""The bench of a dry-run: real drivers, real bytes, and virtual devices on one virtual clock."""

from dataclasses import dataclass
from typing import TextIO

from rig.force.mtsics import MtSicsForce
from rig.protocol.config import Config
from rig.stage.grbl import GrblStage
from rig.transport.byte_log import LoggedTransport
from rig.transport.loopback import LoopbackTransport
from sim.clock import VirtualClock
from sim.devices.balance import VirtualBalance
from sim.devices.grbl import VirtualGrbl
from sim.devices.line import SerialLine
from sim.fingertip import Fingertip
from sim.plant import Placement, Plant, Screws


@dataclass(frozen=True)
class VirtualBench:
    """What the engine needs, and the plant behind the wire. It is its own operator."""

    clock: VirtualClock
    stage: GrblStage
    force: MtSicsForce
    plant: Plant

    def mount(self, indentor: str) -> None:
        """The virtual operator never takes the wrong one."""
        self.plant.mount(indentor)

    def true_pose(self) -> tuple[float, float]:
        """True x and DOI in mm."""
        pose = self.plant.pose_at(self.clock.monotonic_s())
        return pose.x_mm, pose.doi_mm


def virtual_bench(config: Config, finger: Fingertip, byte_log: TextIO, start_unix_s: float) -> VirtualBench:
    """Devices as configured, with the fingertip under the indentor; the bytes go to `byte_log`."""
    clock = VirtualClock(start_unix_s)
    stage_line = SerialLine(clock, config.stage.baud)
    force_line = SerialLine(clock, config.force.baud)
    x, y, z = config.stage.travel_mm
    board = VirtualGrbl(clock, stage_line, settings={130: x, 131: y, 132: z})
    virtual, frame = config.virtual, config.frame
    plant = Plant(
        finger,
        board.carriage_steps_at,
        Screws(virtual.x_screw_steps_per_mm, virtual.z_screw_steps_per_mm),
        Placement(frame.pad_centre_x_mm + virtual.finger_x_offset_mm, frame.apex_z_mm + virtual.finger_z_offset_mm),
    )
    VirtualBalance(clock, force_line, plant.force_n, sample_period_s=config.force.sample_period_s)
    stage_port = LoggedTransport(LoopbackTransport(stage_line, clock, name="stage"), clock, byte_log)
    force_port = LoggedTransport(LoopbackTransport(force_line, clock, name="force"), clock, byte_log)
    return VirtualBench(
        clock,
        GrblStage(stage_port, clock),
        MtSicsForce(force_port, clock, sample_period_s=config.force.sample_period_s),
        plant,
    )
