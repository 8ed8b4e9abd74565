"""Stage with two Standa 8SMC controllers, x lateral and z vertical, on a port each.

Sources: Standa 8SMC5-USB manual, communication protocol; protocol.xi of libximc, version 20.8.

The axis homes to a limit switch and counts from there; machine coordinates fall away from home. The driver writes the
speed before a move and the zero at homing, both volatile, and no other setting.

The command `stop` also clears an alarm of the controller. An alarm that was seen is therefore kept here until
`unlock`.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import suppress

from rig.clock import Clock
from rig.devices.base import (
    Looks,
    Stage,
    StageAlarm,
    StageError,
    StageHeld,
    StageOverridden,
    StageReset,
    StageTimeout,
)
from rig.devices.one_axis import POLL_S, TwoAxisStage, WatchedAxis, WayHome, travel_s, whole_speed
from rig.devices.registry import Evidence, NumberedIdentity, Opener, StageKind
from rig.devices.standa_link import (
    COMMAND,
    EDGES,
    ENGINE,
    FAILED,
    FORGETS_S,
    HOMES,
    HOMING,
    LEFT,
    MOVE,
    MOVES,
    POWER,
    POWER_OFF,
    RESERVED,
    RIGHT,
    SERIAL,
    SPEED,
    VERSION,
    AxisStatus,
    StandaLink,
)
from rig.settings import BenchSettings, StageSettings, StandaAxisSettings, StandaSettings
from rig.transport.ports import may_be_renamed

HOME_S = 180.0
# A move may take this much longer than computed from length, speed and acceleration.
LATE_FACTOR, LATE_S = 1.5, 5.0
STOP_S, HALT_S = 1.0, 2.0
TOLERANCE_MM = 2.5e-3

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
"""Names of the status flags without `STATE_`."""
EDGE = {"right": 0x1, "left": 0x2}
BUTTONS = 0xC
STOPS_AT_EDGES, EDGES_ARE_POSITIONS = 0x6, 0x1
ACCELERATES, ANTIPLAY = 0x10, 0x08
SWITCHES_OFF = 0x02
HOMES_RIGHT, HOMES_TO_LIMIT = 0x0001, 0x0030


class StandaAxis(WatchedAxis[AxisStatus]):
    """One controller, in machine mm. counts_per_mm: microsteps for each mm of travel, positive."""

    def __init__(
        self,
        link: StandaLink,
        clock: Clock,
        name: str,
        settings: StandaAxisSettings,
        *,
        counts_per_mm: float,
        least_acceleration_mm_s2: float,
    ) -> None:
        self.name, self.microsteps = name, settings.microsteps
        self._link, self._clock, self._settings = link, clock, settings
        self._counts_per_mm = counts_per_mm
        self._least_acceleration_mm_s2 = least_acceleration_mm_s2
        self._sign = 1 if settings.home == "right" else -1
        self.serial: int | None = None  # of the connected controller
        self._ramps: tuple[int, int] | None = None
        self._alarm = ""

    @property
    def steps_per_mm(self) -> float:
        """Microsteps for each mm, negative if the axis homes to the left switch."""
        return self._sign * self._counts_per_mm

    def connect(self) -> str:
        """Compare the controller with the configuration and return its identification. Raises StageError."""
        self._ramps = None
        (serial,) = self._link.ask("gser", SERIAL)
        self.serial = serial
        self._refuse_another(serial)
        major, minor, release = self._link.ask("gfwv", VERSION)
        *_, engine_flags, _, mode, _ = self._link.ask("geng", ENGINE)
        borders, *_ = self._link.ask("geds", EDGES)
        *_, homing_flags = self._link.ask("ghom", HOMING)
        *_, power_flags = self._link.ask("gpwr", POWER)
        microsteps = 1 << mode - 1 if 1 <= mode <= 9 else 0
        for name, found, expected in (
            ("MicrostepMode", microsteps, self.microsteps),
            ("ENGINE_ACCEL_ON", bool(engine_flags & ACCELERATES), True),
            ("ENGINE_ANTIPLAY", bool(engine_flags & ANTIPLAY), False),
            ("BORDER_STOP_LEFT and _RIGHT", borders & STOPS_AT_EDGES, STOPS_AT_EDGES),
            ("BORDER_IS_ENCODER", bool(borders & EDGES_ARE_POSITIONS), False),
            ("HOME_DIR_FIRST", "right" if homing_flags & HOMES_RIGHT else "left", self._settings.home),
            ("HOME_STOP_FIRST_BITS", homing_flags & HOMES_TO_LIMIT, HOMES_TO_LIMIT),
            ("POWER_OFF_ENABLED", bool(power_flags & SWITCHES_OFF), False),
        ):
            if found != expected:
                self._refuse_setting(name, found, expected)
        for name, steps_s2 in zip(("Accel", "Decel"), self._ramp(), strict=True):
            least = self._least_acceleration_mm_s2 * self._counts_per_mm / microsteps
            if steps_s2 < least:
                self._refuse_setting(name, steps_s2, f"at least {math.ceil(least)} (stage.acceleration_mm_s2)")
        return f"{self.name}: Standa controller {serial}, firmware {major}.{minor}.{release}"

    # --- motion ---

    def homing(self, keep_on: Callable[[], bool]) -> Iterator[AxisStatus]:
        """Find the home position, which is 0 from then on; yield at each look. Raises StageError."""
        before = self._at(self.look())
        if not keep_on():
            raise self._stopped()
        self._link.command("home")
        way = WayHome()

        def look() -> tuple[AxisStatus, bool]:
            nonlocal before
            status = self.look()
            self.refuse_alarm(status)
            at, before = before, self._at(status)
            up_mm = (before - at) / self.steps_per_mm
            if way.is_wrong(up_mm, at_switch=bool(status.inputs & EDGE[self._settings.home])):
                self._link.send_now("stop")
                raise self._homes_the_wrong_way()
            return status, not status.busy

        yield from self._until(look, HOME_S, 0.0, "homing")
        status = self.look()
        if status.busy or status.command != HOMES or not status.flags & HOMED:
            raise self._not_homed(status)
        if not keep_on():
            raise self._stopped()
        self._link.command("zero")
        status = self.look()
        if not status.flags & HOMED or status.steps or status.microsteps:
            raise self._not_homed(status)

    def moving(
        self, to_mm: float, speed_mm_s: float, keep_on: Callable[[], bool], look_s: float
    ) -> Iterator[AxisStatus]:
        """Move to a position at a speed; yield each look, until arrival.

        A motion that leaves the way from start to target is stopped. Raises StageError; MoveError before any byte.
        """
        target = self._counts(to_mm)
        start = self._standing()
        self._set_speed(speed_mm_s)
        if not keep_on():
            raise self._stopped()
        self._link.command("move", self._payload(target))
        low, high = sorted((start, target))

        def look() -> tuple[AxisStatus, bool]:
            status = self.look()
            if not keep_on():
                raise self._stopped()
            self._refuse_interference(status, MOVES)
            at = self._at(status)
            if not low - self._tolerance <= at <= high + self._tolerance:
                self._link.send_now("stop")
                raise self._not_there(at, to_mm)
            return status, not status.busy

        mm = abs(target - start) / self._counts_per_mm
        acceleration_mm_s2 = min(self._ramp()) * self.microsteps / self._counts_per_mm or math.inf
        expected_s = travel_s(mm, speed_mm_s, acceleration_mm_s2)
        what = f"the move to {to_mm:g} mm"
        yield from self._until(look, LATE_FACTOR * expected_s + LATE_S, expected_s, what, look_s)
        for last in (False, True):  # A late reply may be an old one.
            status = self.look()
            away = status.busy or status.command & FAILED or abs(self._at(status) - target) > self._tolerance
            if away and last:
                raise self._not_there(self._at(status), to_mm)
            if not away:
                return

    def jog(self, by_mm: float, speed_mm_s: float, keep_on: Callable[[], bool]) -> None:
        """Move by a distance from rest, and return at once. Raises StageError."""
        by, status = round(self.steps_per_mm * by_mm), self.look()
        self.refuse_alarm(status)
        if status.busy:
            raise StageOverridden(f"{self._label} moves already; another program moves it")
        self._set_speed(speed_mm_s)
        if not keep_on():
            raise self._stopped()
        self._link.command("movr", self._payload(by))

    def halt(self) -> None:
        """Slow down to rest; steps are not lost, and an alarm is not cleared. Raises StageError."""
        self._end("sstp", HALT_S)

    def confirm_stopped(self) -> None:
        """Verify a stop that was sent, and repeat it until the axis rests. Raises StageError."""
        self._end("stop", STOP_S, sent=True)

    def stop_now(self) -> None:
        """Send a stop without waiting. Raises TransportError."""
        self._link.send_now("stop")

    def clear_alarm(self) -> None:
        """Clear the alarm in the controller, then the one stored here. Raises StageAlarm if it persists."""
        self._link.command("stop")
        self._alarm = ""
        self.refuse_alarm(self.look())

    # --- state ---

    def look(self) -> AxisStatus:
        """Return position and state. Raises StageError."""
        return self._link.status()

    def mm(self, status: AxisStatus) -> float:
        """Return the machine coordinate."""
        return (status.steps * self.microsteps + status.microsteps) / self.steps_per_mm + 0.0

    def refuse_alarm(self, status: AxisStatus) -> None:
        """Refuse an alarm, now or since the last `unlock`, and an unknown flag. Raises StageAlarm."""
        flags = status.flags & ~HARMLESS
        if not self._alarm:
            bits = [1 << bit for bit in range(flags.bit_length()) if flags >> bit & 1]
            self._alarm = " ".join(ALARMS.get(bit, f"{bit:X} hex") for bit in bits)
        if self._alarm:
            raise StageAlarm(self._alarm, f"{self._label}: remove the cause, see its manual")

    @staticmethod
    def is_referenced(status: AxisStatus) -> bool:
        """Return whether a controller is homed and its motor on."""
        return bool(status.flags & HOMED) and status.power != POWER_OFF

    def refuse_unreferenced(self, status: AxisStatus) -> None:
        """Refuse a controller that is no longer homed or whose motor is off. Raises StageReset."""
        if not self.is_referenced(status):
            raise StageReset(f"{self._label} is no longer homed, or its motor is off; home again")

    def refuse_far_edge(self, status: AxisStatus) -> None:
        """Refuse the limit switch away from home, which lies outside the travel; after `refuse_alarm`.

        Raises StageAlarm.
        """
        far = "left" if self._settings.home == "right" else "right"
        if status.inputs & EDGE[far]:
            self._alarm = f"{far.upper()}_EDGE"
            self.refuse_alarm(status)

    def native_speed(self, speed_mm_s: float) -> int:
        """Return the speed in microsteps per second, rounded down. Raises MoveError below 1."""
        return whole_speed(speed_mm_s, self._counts_per_mm)

    # --- helpers ---

    def _refuse_another(self, serial: int) -> None:
        """Refuse the controller of another axis, which would move that axis. Raises StageError."""
        if self._settings.serial is None and may_be_renamed(self._link.name):
            raise StageError(
                f"{self._label}: this port may have another controller after the next start; set serial = {serial} "
                f"under [stage.standa.{self.name}], or name the port as in /dev/serial/by-id",
                "port_may_change",
            )
        if self._settings.serial not in (None, serial):
            self._refuse_setting("serial number", serial, self._settings.serial)

    def _end(self, letters: str, most_s: float, *, sent: bool = False) -> None:
        deadline_s = self._clock.monotonic_s() + most_s
        problem: StageError | None = None
        while self._clock.monotonic_s() < deadline_s:
            try:
                if not sent:
                    self._link.command(letters)
                sent = False
                begun_s = self._clock.monotonic_s()
                while letters == "sstp" or self._clock.monotonic_s() < begun_s + 2 * POLL_S:
                    if not self._link.status(tries=1).busy:
                        return
                    if self._clock.monotonic_s() >= deadline_s:
                        break
                    self._clock.wait_s(POLL_S)
                problem = None
            except StageError as error:
                problem, sent = error, False
        raise problem or StageTimeout(
            f"{self._label} still moves {most_s:g} s after a stop; use the emergency stop", "still_runs"
        )

    def _refuse_interference(self, status: AxisStatus, command: int) -> None:
        """Raise for what ends a motion: an alarm, a reset, a button at the controller, another program."""
        self.refuse_alarm(status)
        self.refuse_unreferenced(status)
        self.refuse_far_edge(status)
        self._refuse_buttons(status)
        if status.command & COMMAND != command:
            raise StageOverridden(f"{self._label}: another program has interrupted the motion")

    def _refuse_buttons(self, status: AxisStatus) -> None:
        if status.inputs & BUTTONS or (status.busy and status.command & COMMAND in (LEFT, RIGHT)):
            raise StageHeld("BUTTON", f"{self._label}: ")

    def _standing(self) -> int:
        """Return the position at rest."""
        status = self.look()
        self.refuse_alarm(status)
        self.refuse_unreferenced(status)
        self._refuse_buttons(status)
        if status.busy:
            raise StageHeld("BUSY", f"{self._label}: ")
        return self._at(status)

    def _set_speed(self, speed_mm_s: float) -> None:
        steps, part = divmod(self.native_speed(speed_mm_s), self.microsteps)
        self._link.command("smov", SPEED.pack(steps, part, *self._ramp(), 0, 0, 0, 9 * RESERVED))

    def _ramp(self) -> tuple[int, int]:
        """Return acceleration and deceleration of the controller, in full steps/s²."""
        if self._ramps is None:
            _, _, up, down, *_ = self._link.ask("gmov", SPEED)
            self._ramps = up, down
        return self._ramps

    @property
    def _tolerance(self) -> float:
        return max(TOLERANCE_MM * self._counts_per_mm, 1.0)

    def _counts(self, mm: float) -> int:
        return round(mm * self.steps_per_mm)

    def _at(self, status: AxisStatus) -> int:
        return status.steps * self.microsteps + status.microsteps

    def _payload(self, counts: int) -> bytes:
        steps = math.trunc(counts / self.microsteps)
        return MOVE.pack(steps, counts - steps * self.microsteps, 6 * RESERVED)

    def _refuse_setting(self, setting: str, found: object, expected: object) -> None:
        raise StageError(
            f"{self._label}: {setting} of the controller is {found}, expected {expected}", "not_as_configured"
        )

    def _not_homed(self, status: AxisStatus) -> StageError:
        return StageError(
            f"{self._label} did not home: it is at {self._at(status)} (command state {status.command}); home again",
            "did_not_home",
        )

    def _not_there(self, at: int, target_mm: float) -> StageError:
        return StageError(
            f"{self._label} is at {at / self.steps_per_mm:.4f} mm instead of {target_mm:g} mm", "not_there"
        )

    @property
    def _label(self) -> str:
        return f"{self._link.name}: {self.name} axis"


class StandaStage(TwoAxisStage[StandaAxis, AxisStatus]):
    """Stage with two controllers."""

    def __init__(self, links: tuple[StandaLink, ...], x: StandaAxis, z: StandaAxis, settings: BenchSettings) -> None:
        super().__init__(x, z, name="the stage", settings=settings)
        self._links = links

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

    def homing(self) -> Looks:
        """Home z, then x. An alarm is not cleared, also one that a stop has cleared in the controller.

        Raises StageError.
        """
        self._trusted = False
        keep_on = self._until_stopped()
        for axis in self._up_first():
            axis.refuse_alarm(axis.look())
        for axis in self._up_first():
            for _ in axis.homing(keep_on):
                yield None
        self._trusted = keep_on()

    def unlock(self) -> None:
        """Clear the alarms of both axes; the position stays untrusted. Raises StageError."""
        self._trusted = False
        for axis in self._up_first():
            axis.clear_alarm()

    def set_output(self, on: bool) -> None:
        """Refuse: no output of a Standa controller is supported. Raises StageError."""
        raise StageError("a Standa stage has no output for pulses; set sync.output to off", "no_output")

    def close(self) -> None:
        for link in self._links:
            link.close()

    def _send_stop(self) -> None:
        # It clears alarms in the controllers, but not those that this driver has seen.
        for axis in self._up_first():
            axis.stop_now()

    def _refuse_alarm(self, axis: StandaAxis, look: AxisStatus) -> None:
        axis.refuse_alarm(look)
        if self._trusted:
            axis.refuse_unreferenced(look)
            axis.refuse_far_edge(look)

    def _is_referenced(self, axis: StandaAxis, look: AxisStatus) -> bool:
        return axis.is_referenced(look)


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
    links: list[StandaLink] = []
    try:
        for port in _ports(stage):
            links.append(StandaLink(opener(port), clock))
    except BaseException:
        for link in links:
            link.close()
        raise
    z, x = (
        StandaAxis(
            link,
            clock,
            name,
            axis,
            counts_per_mm=abs(settings.calibration.value(f"{name}_steps_per_mm", steps_per_mm(stage, name))),
            least_acceleration_mm_s2=stage.acceleration_mm_s2 if name == "z" else 0.0,
        )
        for link, (name, axis) in zip(links, (("z", own.z), ("x", own.x)), strict=True)
    )
    return StandaStage(tuple(links), x, z, settings)


def _probe(opener: Opener, clock: Clock, settings: BenchSettings) -> str | None:
    """Ask for the serial number."""
    transport = opener(settings.stage.port)
    for _ in range(2):
        clock.wait_s(FORGETS_S)  # The bytes of other probes may be the beginning of a command.
        with suppress(StageError):
            (serial,) = StandaLink(transport, clock).ask("gser", SERIAL, tries=1)
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
