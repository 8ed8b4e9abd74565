"""Stage with two Leadshine drives, x lateral and z vertical, on one Modbus port or on two."""

from contextlib import suppress

from rig.clock import Clock
from rig.devices import leadshine_drive as reg
from rig.devices.base import Stage, StageError
from rig.devices.counted_axis import AxisSpec, TwoAxisStage
from rig.devices.drive_link import both_answer, opened
from rig.devices.leadshine_drive import LeadshineDrive
from rig.devices.registry import Evidence, Opener, StageKind
from rig.settings import NOMINAL_STEPS_PER_MM, BenchSettings, DrivesSettings, StageSettings
from rig.transport import TransportError
from rig.transport.modbus import ModbusError, ModbusMaster
from rig.transport.ports import may_be_renamed


class LeadshineStage(TwoAxisStage[LeadshineDrive]):
    """Stage with two drives."""

    def __init__(self, x: LeadshineDrive, z: LeadshineDrive, settings: BenchSettings) -> None:
        super().__init__(x, z, settings)
        self._sync, self._inputs_register = settings.sync, settings.stop.inputs_register

    def connect(self) -> str:
        """Check the settings of both drives, disarm them, and return their identification. Raises StageError.

        Drives that cannot be distinguished if their ports change names are refused.
        """
        z, x = self._up_first()
        if x.device_id == z.device_id and any(may_be_renamed(drive.link.name) for drive in (x, z)):
            raise StageError(
                f"{z.link.name}: both drives have device_id {z.device_id}, and their ports may change names; give "
                "them different numbers, or name the ports as in /dev/serial/by-id",
                "port_may_change",
            )
        return super().connect()

    def limit_depth(self, lowest_z_mm: float) -> None:
        """Set a volatile soft limit of the z drive at a machine height (mm), clipped to the travel.

        It holds until the next homing. Raises StageError if the drive moves or does not confirm the limit (the
        position is then not trusted), and before any byte StageNotHomed, or MoveError if the height is not finite.
        """
        if not self._trusted:
            raise self._not_homed()
        try:
            self._axes["z"].limit_travel(lowest_z_mm)
        except StageError:
            self._trusted = False
            raise

    def set_output(self, on: bool) -> None:
        """Write the output word to the drive that has the output. Raises StageError."""
        if self._sync.output != "drive" or self._sync.words is None:
            raise StageError(
                "no output of a drive is configured; set sync.output to drive, and its register and words",
                "no_output",
            )
        address, on_word, off_word = self._sync.words
        self._axes[self._sync.drive].write_word(address, on_word if on else off_word)

    def active_inputs(self) -> frozenset[str]:
        """Return the active digital inputs of the vertical drive, di1 … di7. Raises StageError."""
        word = self._axes["z"].inputs(self._inputs_register)
        return frozenset(name for bit, name in enumerate(reg.INPUT_NAMES) if word >> bit & 1)

    def _send_stop(self) -> None:
        """Send a broadcast on a shared serial bus, else a frame to each drive."""
        z, x = self._up_first()
        if x.link is not z.link:
            super()._send_stop()
        else:
            z.link.send_now([z.device_id, x.device_id], reg.TRIGGER, reg.QUICK_STOP)

    def _confirm_idle(self, axis: LeadshineDrive) -> None:
        with suppress(StageError, TransportError):
            axis.confirm_stopped()

    def _prepare_motion(self) -> None:
        """Disarm both before either moves, since a bit error in the address reaches the other one."""
        if not all(drive.harmless for drive in self._up_first()):
            for drive in self._up_first():
                drive.disarm()


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    stage = settings.stage
    buses = opened(
        _ports(stage),
        lambda port: ModbusMaster.on_port(opener(port), clock, port, framing=stage.framing, baud=stage.baud),
    )
    x, z = (
        LeadshineDrive(
            buses[drive.port or stage.port],
            clock,
            AxisSpec(
                name,
                settings.calibration.value(f"{name}_steps_per_mm", NOMINAL_STEPS_PER_MM),
                stage.travel_mm["xyz".index(name)],
            ),
            drive,
        )
        for name, drive in (("x", stage.drives.x), ("z", stage.drives.z))
    )
    return LeadshineStage(x, z, settings)


def _ports(stage: StageSettings) -> tuple[str, ...]:
    """Return the ports of the drives."""
    return tuple(dict.fromkeys(drive.port or stage.port for drive in (stage.drives.x, stage.drives.z)))


def _probe(opener: Opener, clock: Clock, settings: BenchSettings) -> str | None:
    """Read the status and the commanded position of both drives."""
    stage = settings.stage
    bus = ModbusMaster.on_port(opener(stage.port), clock, stage.port, framing=stage.framing, baud=stage.baud)
    ids = (stage.drives.x.device_id, stage.drives.z.device_id)
    answers = {f"Leadshine drive {device_id}": _answers(bus, device_id) for device_id in ids}
    if not both_answer(stage.port, answers, "one_drive", "set its port under [stage.drives]"):
        return None
    return f"Leadshine drives {ids[0]} and {ids[1]}"


def _answers(bus: ModbusMaster, device_id: int) -> bool:
    try:
        # The frame that reads the alarm has the byte `~` in its checksum, which continues a held board.
        bus.read(device_id, reg.STATUS)
        bus.read(device_id, reg.COMMANDED, 2)
    except ModbusError:
        return False
    return True


DEVICE = StageKind(
    name="leadshine",
    device="two Leadshine CS2RS or iEM-RS drives",
    driver=_driver,
    settings=DrivesSettings,
    table="drives",
    ports=_ports,
    axes="xz",
    outputs=("off", "drive"),
    inputs=reg.INPUT_NAMES,
    ramps=True,
    twin="sim.devices.leadshine:leadshine_twin",
    probe=_probe,
    tests=("tests/rig/test_leadshine_driver.py", "tests/rig/test_modbus_counterparties.py"),
    evidence=Evidence(
        manual="CS2RS and iEM-RS user manuals",
        client="minimalmodbus 2.1.1, modbus-tk 1.1.5, mbpoll 1.4.11",
    ),
)
