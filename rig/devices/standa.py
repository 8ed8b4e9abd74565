"""Stage with two Standa 8SMC controllers, x lateral and z vertical, on a port each.

Sources: Standa 8SMC5-USB manual, communication protocol; protocol.xi of libximc, version 20.8.

The axis homes to a limit switch and counts from there; machine coordinates fall away from home. The driver writes the
speed before a move and the zero at homing, both volatile, and no other setting.

The command `stop` also clears an alarm of the controller. An alarm that was seen is therefore kept here until
`unlock`.
"""

import math
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass

from rig.clock import Clock
from rig.devices import standa_link as frames
from rig.devices.base import Stage, StageError
from rig.devices.counted_axis import (
    POLL_S,
    AxisSpec,
    CountedAxis,
    Destination,
    Fault,
    FaultKind,
    Look,
    Setting,
    TwoAxisStage,
)
from rig.devices.drive_link import opened
from rig.devices.registry import Evidence, NumberedIdentity, Opener, StageKind
from rig.devices.standa_link import AxisStatus, StandaLink
from rig.settings import BenchSettings, StageSettings, StandaAxisSettings, StandaSettings
from rig.transport.ports import may_be_renamed

HOMED = 0x20
HARMLESS = HOMED | 0x17
"""Also the bits of earlier error replies and of a memory in the stage."""
ALARMS = {
    0x00000040: "ALARM",
    0x00000080: "CTP_ERROR",
    0x00000100: "POWER_OVERHEAT",
    0x00000200: "CONTROLLER_OVERHEAT",
    0x00000400: "OVERLOAD_POWER_VOLTAGE",
    0x00000800: "OVERLOAD_POWER_CURRENT",
    0x00001000: "OVERLOAD_USB_VOLTAGE",
    0x00002000: "LOW_USB_VOLTAGE",
    0x00004000: "OVERLOAD_USB_CURRENT",
    0x00008000: "BORDERS_SWAP_MISSET",
    0x00010000: "LOW_POWER_VOLTAGE",
    0x00020000: "H_BRIDGE_FAULT",
    0x00100000: "WINDING_RES_MISMATCH",
    0x00200000: "ENCODER_FAULT",
    0x00800000: "ENGINE_RESPONSE_ERROR",
    0x01000000: "EXTIO_ALARM",
}
"""Names of the status flags without `STATE_`; each is an alarm."""
LOST = Fault(FaultKind.LOST, "HOMED", "is no longer homed, or its motor is off")
HELD = Fault(FaultKind.HELD, "BUTTON", "")
OVERRIDDEN = Fault(FaultKind.OVERRIDDEN, "", "another program has interrupted the motion")
EDGE = {"right": 0x1, "left": 0x2}
BUTTONS = 0xC
STOPS_AT_EDGES, EDGES_ARE_POSITIONS = 0x6, 0x1
ACCELERATES, ANTIPLAY = 0x10, 0x08
SWITCHES_OFF = 0x02
HOMES_RIGHT, HOMES_TO_LIMIT = 0x0001, 0x0030


@dataclass(frozen=True, slots=True)
class StandaLook(Look):
    """State of an axis; command: the last one that the controller has begun, failed: whether it did not succeed."""

    command: int = 0
    failed: bool = False


class StandaAxis(CountedAxis[StandaLook]):
    """One controller."""

    halt_again_s, stop_again_s = math.inf, 2 * POLL_S
    zero_acceleration_mm_s2 = 0.0
    link: StandaLink

    def __init__(self, link: StandaLink, clock: Clock, spec: AxisSpec, settings: StandaAxisSettings) -> None:
        super().__init__(link, clock, spec, acceleration_unit=1 / settings.microsteps)
        self.microsteps, self._settings = settings.microsteps, settings
        self.serial: int | None = None  # of the connected controller
        self._ramps: tuple[int, ...] = ()
        self._alarms, self._displaced = 0, False

    # --- settings ---

    def identify(self) -> str:
        self._ramps = ()
        (self.serial,) = self.link.ask("gser", frames.SERIAL)
        if self._settings.serial is None and may_be_renamed(self.link.name):
            raise StageError(
                f"{self.label}: this port may have another controller after the next start; set serial = "
                f"{self.serial} under [stage.standa.{self.name}], or name the port as in /dev/serial/by-id",
                "port_may_change",
            )
        major, minor, release = self.link.ask("gfwv", frames.VERSION)
        return f"Standa controller {self.serial}, firmware {major}.{minor}.{release}"

    def settings(self) -> Iterator[Setting]:
        yield Setting("serial number of the controller", self.serial, self._settings.serial or self.serial)
        *_, engine, _, mode, _ = self.link.ask("geng", frames.ENGINE)
        borders, *_ = self.link.ask("geds", frames.EDGES)
        *_, homing = self.link.ask("ghom", frames.HOMING)
        *_, power = self.link.ask("gpwr", frames.POWER)
        microsteps = 1 << mode - 1 if 1 <= mode <= 9 else 0
        yield Setting("MicrostepMode of the controller", microsteps, self.microsteps)
        yield Setting("ENGINE_ACCEL_ON of the controller", bool(engine & ACCELERATES), True)
        yield Setting("ENGINE_ANTIPLAY of the controller", bool(engine & ANTIPLAY), False)
        yield Setting("BORDER_STOP_LEFT and _RIGHT of the controller", borders & STOPS_AT_EDGES, STOPS_AT_EDGES)
        yield Setting("BORDER_IS_ENCODER of the controller", bool(borders & EDGES_ARE_POSITIONS), False)
        side = "right" if homing & HOMES_RIGHT else "left"
        yield Setting("HOME_DIR_FIRST of the controller", side, self._settings.home)
        yield Setting("HOME_STOP_FIRST_BITS of the controller", homing & HOMES_TO_LIMIT, HOMES_TO_LIMIT)
        yield Setting("POWER_OFF_ENABLED of the controller", bool(power & SWITCHES_OFF), False)
        up, down = self._ramp()
        yield from self.accelerations({"Accel of the controller": up, "Decel of the controller": down})

    def _ramp(self) -> tuple[int, ...]:
        """Return acceleration and deceleration of the controller, in full steps/s²."""
        if not self._ramps:
            self._ramps = self.link.ask("gmov", frames.SPEED)[2:4]
        return self._ramps

    # --- motion ---

    def aim(self, target: Destination, speed: int) -> None:
        steps, part = divmod(speed, self.microsteps)
        self.link.command("smov", frames.SPEED.pack(steps, part, *self._ramp(), 0, 0, 0, 9 * frames.RESERVED))

    def go(self, target: Destination, speed: int) -> None:
        counts = target.position if target.by is None else target.by
        steps = math.trunc(counts / self.microsteps)
        payload = frames.MOVE.pack(steps, counts - steps * self.microsteps, 6 * frames.RESERVED)
        self.link.command("move" if target.by is None else "movr", payload)

    def has_arrived(self, found: StandaLook, target: int) -> bool:
        return super().has_arrived(found, target) and not found.failed

    def send_stop(self, after_s: float, *, halting: bool) -> None:
        self.link.command("sstp" if halting else "stop")  # `sstp` does not clear an alarm.

    def rests(self) -> bool:
        return not self.link.status(tries=1).busy

    def stop_now(self) -> None:
        self.link.send_now("stop")

    def go_home(self) -> None:
        self.link.command("home")

    def not_home(self, found: StandaLook) -> str | None:
        if found.command == frames.HOMES and not found.failed and LOST not in found.faults:
            return None
        return f"it is at {found.position} (command state {found.command})"

    def finish_homing(self) -> None:
        self.link.command("zero")
        found = self.look()
        if found.position or LOST in found.faults:
            raise self.did_not_home(f"it is at {found.position} after the command that sets zero")

    def clear(self) -> None:
        self.link.command("stop")
        self._alarms, self._displaced = 0, False

    # --- state ---

    def look(self) -> StandaLook:
        status = self.link.status()
        return StandaLook(
            position=status.steps * self.microsteps + status.microsteps,
            busy=status.busy,
            faults=tuple(self._faults(status)),
            at_switch=bool(status.inputs & EDGE[self._settings.home]),
            command=status.command & frames.COMMAND,
            failed=bool(status.command & frames.FAILED),
        )

    def refuse(self, found: StandaLook, kinds: Iterable[FaultKind]) -> None:
        displaced = any(fault.kind is FaultKind.DISPLACED for fault in found.faults)
        self._displaced |= displaced and FaultKind.DISPLACED in kinds
        super().refuse(found, kinds)

    def _faults(self, status: AxisStatus) -> Iterator[Fault]:
        self._alarms |= status.flags & ~HARMLESS
        if self._alarms:
            bits = [1 << bit for bit in range(self._alarms.bit_length()) if self._alarms >> bit & 1]
            names = " ".join(ALARMS.get(bit, f"{bit:X} hex") for bit in bits)
            yield Fault(FaultKind.ALARM, names, "see its manual")
        if not status.flags & HOMED or status.power == frames.POWER_OFF:
            yield LOST
        far = "left" if self._settings.home == "right" else "right"
        if self._displaced or status.inputs & EDGE[far]:  # It lies outside the travel.
            kind = FaultKind.ALARM if self._displaced else FaultKind.DISPLACED
            yield Fault(kind, f"{far.upper()}_EDGE", f"unexpected {far} limit switch")
        command = status.command & frames.COMMAND
        if status.inputs & BUTTONS or (status.busy and command in (frames.LEFT, frames.RIGHT)):
            yield HELD
        if command != frames.MOVES:
            yield OVERRIDDEN


class StandaStage(TwoAxisStage[StandaAxis]):
    """Stage with two controllers."""

    def connect(self) -> str:
        """Compare both axes with the configuration and return their identification. Raises StageError."""
        found = super().connect()
        x, z = self._axes["x"], self._axes["z"]
        if x.serial == z.serial:
            raise StageError(
                f"the ports of both axes lead to one Standa controller, {z.serial}; correct stage.port or "
                "stage.standa.x_port",
                "one_controller_for_two",
            )
        return found


def steps_per_mm(stage: StageSettings, axis: str) -> float:
    """Return the microsteps per mm that the configuration gives; y has no motor."""
    own = stage.own(StandaSettings)
    one = own.x if axis == "x" else own.z
    return (1e3 if one.home == "right" else -1e3) * one.microsteps / one.step_um


def _ports(stage: StageSettings) -> tuple[str, ...]:
    """Return the ports of the controllers, that of z first."""
    return stage.port, stage.own(StandaSettings).x_port


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    stage = settings.stage
    own = stage.own(StandaSettings)
    if stage.port == own.x_port:
        raise StageError(
            f"stage.port and stage.standa.x_port are both {stage.port}; every controller has a port of its own",
            "one_port_for_two",
        )
    links = opened(_ports(stage), lambda port: StandaLink(opener(port), clock))
    z, x = (
        StandaAxis(links[port], clock, AxisSpec.of(settings, name, steps_per_mm(stage, name)), axis)
        for port, name, axis in ((stage.port, "z", own.z), (own.x_port, "x", own.x))
    )
    return StandaStage(x, z, settings)


def _probe(opener: Opener, clock: Clock, settings: BenchSettings) -> str | None:
    """Ask for the serial number."""
    transport = opener(settings.stage.port)
    for _ in range(2):
        clock.wait_s(frames.FORGETS_S)  # The bytes of other probes may be the beginning of a command.
        with suppress(StageError):
            (serial,) = StandaLink(transport, clock).ask("gser", frames.SERIAL, tries=1)
            return NumberedIdentity(f"Standa controller {serial}", serial)
    return None


DEVICE = StageKind(
    name="standa",
    device="two Standa 8SMC controllers",
    driver=_driver,
    settings=StandaSettings,
    ports=_ports,
    further_ports=("x_port",),
    serial_keys=("z.serial", "x.serial"),
    axes="xz",
    steps_per_mm=steps_per_mm,
    twin="sim.devices.standa:standa_twin",
    ramps=True,
    probe=_probe,
    tests=("tests/rig/test_standa_driver.py", "tests/rig/test_makers_clients.py"),
    evidence=Evidence(manual="protocol.xi of libximc, version 20.8", client="libximc 2.14.30"),
)
