"""Stage with two Leadshine drives, x lateral and z vertical, on one Modbus port or on two."""

from collections.abc import Callable, Mapping

from rig.clock import Clock
from rig.devices import leadshine_drive as reg
from rig.devices.base import LOOK_S, Axis, Looks, Stage, StageError, StageNotHomed, StageStatus
from rig.devices.leadshine_drive import LeadshineDrive, Status
from rig.devices.one_axis import one_axis, refuse_not_finite
from rig.devices.registry import Evidence, Opener, StageKind
from rig.settings import (
    NOMINAL_STEPS_PER_MM,
    BenchSettings,
    DriveSettings,
    DrivesSettings,
    StageSettings,
    SyncSettings,
)
from rig.transport.modbus import ModbusError, ModbusMaster
from rig.transport.ports import may_be_renamed


class LeadshineStage(Stage):
    """Stage with two drives, which move one axis at a time, since they cannot keep a straight line together.

    y_mm: position along the finger, set by hand. output: what set_output() switches. An axis with backlash always
    arrives in its negative direction (down, for z): an opposite move overruns by twice the backlash and returns.
    """

    def __init__(
        self,
        x: LeadshineDrive,
        z: LeadshineDrive,
        *,
        y_mm: float = 0.0,
        x_backlash_mm: float = 0.0,
        z_backlash_mm: float = 0.0,
        output: SyncSettings | None = None,
        inputs_register: int,
    ) -> None:
        self._drives = {"x": x, "z": z}
        self._overrun_mm = {"x": 2 * x_backlash_mm, "z": 2 * z_backlash_mm}
        self._y_mm = y_mm
        self._output, self._inputs_register = output, inputs_register
        self._trusted = False
        self._times_stopped = 0  # counted from any thread

    @property
    def homed(self) -> bool:
        """Whether the position is trusted: homed, and no alarm, timeout or stop since."""
        return self._trusted

    def connect(self) -> str:
        """Check the settings of both drives, disarm them, and return their identification. Raises StageError."""
        self._trusted = False
        self._refuse_alike()
        return "; ".join(drive.connect() for drive in self._drives.values())

    def _refuse_alike(self) -> None:
        """Refuse drives that cannot be distinguished if their ports change names. Raises StageError."""
        x, z = self._drives["x"], self._drives["z"]
        if x.device_id == z.device_id and any(may_be_renamed(drive.bus.name) for drive in (x, z)):
            raise StageError(
                f"{z.bus.name}: both drives have device_id {z.device_id}, and their ports may change names; give "
                "them different numbers, or name the ports as in /dev/serial/by-id",
                "port_may_change",
            )

    def homing(self) -> Looks:
        """Home z, then x, then set the soft limits in the drives. An alarm is not cleared. Raises StageError."""
        self._trusted = False
        keep_on = self._until_stopped()
        for drive in self._up_first():
            drive.refuse_fault()
        self._disarm(again=True)  # A drive may have been switched off since.
        for drive in self._up_first():
            try:
                for _ in drive.homing(keep_on):
                    yield None
            except StageError:
                self._stop_all_but(drive)
                raise
            drive.set_soft_limits()
        self._trusted = keep_on()

    def unlock(self) -> None:
        """Clear alarms; the position stays untrusted. Raises StageError."""
        self._trusted = False
        for drive in self._up_first():
            drive.clear_alarm()

    def trust_position(self) -> None:
        self._trusted = True

    def status(self) -> StageStatus:
        """Return the state and position of both drives. Raises StageError."""
        return self._status({})

    def moving(
        self,
        *,
        x_mm: float | None = None,
        y_mm: float | None = None,
        z_mm: float | None = None,
        speed_mm_s: float,
        look_s: float = LOOK_S,
    ) -> Looks:
        """Move straight to a position (machine mm).

        Raises StageError; MoveError, StageNotHomed before any byte: for two axes at once, another y, or a speed out
        of range.
        """
        axis, target_mm = one_axis(x_mm, y_mm, z_mm, speed_mm_s, self._y_mm)
        if axis is None:
            return
        drive = self._drives[axis]
        drive.rpm(speed_mm_s)
        if not self._trusted:
            raise StageNotHomed("the drives")
        try:
            self._disarm()
            for stop_mm in self._stops(axis, target_mm):
                for word in drive.moving(stop_mm, speed_mm_s, lambda: self._trusted, look_s):
                    yield self._status({axis: word})
        except StageError:
            self._trusted = False
            raise

    def halt(self) -> None:
        """Quick-stop each drive; its position feedback stays valid."""
        for drive in self._up_first():
            drive.confirm_stopped()

    def look(self) -> StageStatus:
        return self.status()

    def steps_per_mm(self, axis: Axis) -> float:
        """Return the configured pulses per mm. Raises StageError for y."""
        return self._drive(axis).pulses_per_mm

    def jog(self, axis: Axis, by_mm: float, speed_mm_s: float) -> None:
        """Move by a distance from rest; whether the position is trusted does not change.

        Raises StageError; MoveError before any byte.
        """
        drive, keep_on = self._drive(axis), self._until_stopped()
        drive.rpm(speed_mm_s)
        refuse_not_finite("by_mm", by_mm)
        self._disarm()
        drive.jog(by_mm, speed_mm_s, keep_on)

    def limit_depth(self, lowest_z_mm: float) -> None:
        """Set a volatile soft limit of the z drive at a machine height (mm), clipped to the travel.

        It holds until the next homing. Raises StageError if the drive moves or does not confirm the limit (the
        position is then not trusted), and before any byte StageNotHomed, or MoveError if the height is not finite.
        """
        if not self._trusted:
            raise StageNotHomed("the drives")
        try:
            self._drives["z"].limit_travel(lowest_z_mm)
        except StageError:
            self._trusted = False
            raise

    def set_output(self, on: bool) -> None:
        """Write the output word to the drive that has the output. Raises StageError."""
        if self._output is None or self._output.words is None:
            raise StageError(
                "no output of a drive is configured; set sync.output to drive, and its register and words",
                "no_output",
            )
        address, on_word, off_word = self._output.words
        self._drives[self._output.drive].write_word(address, on_word if on else off_word)

    def stop(self) -> None:
        """Quick-stop both drives, past every wait, and confirm it.

        A broadcast is sent at once on a shared serial bus, else a frame to each drive. Then the stop is repeated
        until each drive reports rest, for up to 1 s. Raises StageError if one does not, TransportError.
        """
        self._times_stopped += 1
        self._trusted = False
        for bus in self._buses():
            ids = [drive.device_id for drive in self._up_first() if drive.bus is bus]
            bus.send_now(ids, reg.TRIGGER, reg.QUICK_STOP)
        problems = [problem for drive in self._up_first() if (problem := _unconfirmed(drive))]
        if problems:
            raise problems[0]

    def active_inputs(self) -> frozenset[str]:
        """Return the active digital inputs of the vertical drive, di1 … di7. Raises StageError."""
        word = self._drives["z"].inputs(self._inputs_register)
        return frozenset(name for bit, name in enumerate(reg.INPUT_NAMES) if word >> bit & 1)

    def close(self) -> None:
        for bus in self._buses():
            bus.close()

    def _status(self, known: Mapping[str, Status]) -> StageStatus:
        """Return the status. known: status words that were already read, by axis."""
        words = [known[axis] if axis in known else drive.status() for axis, drive in self._drives.items()]
        referenced = all(Status.HOMED in word for word in words)
        if not referenced:
            self._trusted = False
        x_mm, z_mm = (drive.position_mm() for drive in self._drives.values())
        return StageStatus(_state(words), x_mm, self._y_mm, z_mm, referenced)

    def _disarm(self, *, again: bool = False) -> None:
        """Disarm both before either moves, since a bit error in the address reaches the other one."""
        if again or not all(drive.harmless for drive in self._up_first()):
            for drive in self._up_first():
                drive.disarm()

    def _stop_all_but(self, active: LeadshineDrive) -> None:
        """Stop the other drives, which may have received this command and creep."""
        for drive in self._up_first():
            if drive is not active:
                _unconfirmed(drive)

    def _until_stopped(self) -> Callable[[], bool]:
        times = self._times_stopped
        return lambda: self._times_stopped == times

    def _buses(self) -> list[ModbusMaster]:
        z, x = self._up_first()
        return [z.bus] if x.bus is z.bus else [z.bus, x.bus]

    def _drive(self, axis: Axis) -> LeadshineDrive:
        if axis not in self._drives:
            raise StageError(f"the stage has no drive for the {axis} axis; set it by hand", "no_drive")
        return self._drives[axis]

    def _up_first(self) -> tuple[LeadshineDrive, LeadshineDrive]:
        return self._drives["z"], self._drives["x"]

    def _stops(self, axis: str, to_mm: float) -> list[float]:
        """Return the successive targets: one, or two to take up backlash."""
        overrun = self._overrun_mm[axis]
        if not (overrun and to_mm > self._drives[axis].position_mm()):
            return [to_mm]
        return [min(to_mm + overrun, 0.0), to_mm]


def _state(words: list[Status]) -> str:
    if any(Status.FAULT in word for word in words):
        return "Alarm"
    if not all(Status.ENABLED in word for word in words):
        return "Disabled"
    return "Run" if any(Status.RUNNING in word for word in words) else "Idle"


def _unconfirmed(drive: LeadshineDrive) -> StageError | None:
    try:
        drive.confirm_stopped()
    except StageError as problem:
        return problem
    return None


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    drives = {"x": settings.stage.drives.x, "z": settings.stage.drives.z}
    buses = _buses(opener, clock, settings.stage)
    x, z = (_drive(buses, clock, axis, drive, settings) for axis, drive in drives.items())
    x_backlash, z_backlash = (settings.calibration.value(f"{axis}_backlash_mm", 0.0) for axis in drives)
    return LeadshineStage(
        x,
        z,
        y_mm=settings.frame.pad_y_mm,
        x_backlash_mm=x_backlash,
        z_backlash_mm=z_backlash,
        output=settings.sync if settings.sync.output == "drive" else None,
        inputs_register=settings.stop.inputs_register,
    )


def _ports(stage: StageSettings) -> tuple[str, ...]:
    """Return the ports of the drives."""
    return tuple(dict.fromkeys(drive.port or stage.port for drive in (stage.drives.x, stage.drives.z)))


def _buses(opener: Opener, clock: Clock, stage: StageSettings) -> dict[str, ModbusMaster]:
    """Open the ports; close all of them if one does not open."""
    buses: dict[str, ModbusMaster] = {}
    try:
        for port in _ports(stage):
            buses[port] = ModbusMaster.on_port(opener(port), clock, port, framing=stage.framing, baud=stage.baud)
    except BaseException:
        for bus in buses.values():
            bus.close()
        raise
    return buses


def _drive(
    buses: dict[str, ModbusMaster], clock: Clock, axis: str, drive: DriveSettings, settings: BenchSettings
) -> LeadshineDrive:
    return LeadshineDrive(
        buses[drive.port or settings.stage.port],
        clock,
        axis,
        drive,
        pulses_per_mm=settings.calibration.value(f"{axis}_steps_per_mm", NOMINAL_STEPS_PER_MM),
        travel_mm=settings.stage.travel_mm["xyz".index(axis)],
    )


def _probe(opener: Opener, clock: Clock, settings: BenchSettings) -> str | None:
    """Read the status and the commanded position of both drives."""
    stage = settings.stage
    bus = ModbusMaster.on_port(opener(stage.port), clock, stage.port, framing=stage.framing, baud=stage.baud)
    ids = (stage.drives.x.device_id, stage.drives.z.device_id)
    silent = [device_id for device_id in ids if not _answers(bus, device_id)]
    if len(silent) == len(ids):
        return None
    if silent:
        raise StageError(
            f"{stage.port}: of the Leadshine drives {ids[0]} and {ids[1]}, only one answers; drive {silent[0]} "
            "does not; check its power, cable and address, or set its port under [stage.drives]",
            "one_drive",
        )
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
