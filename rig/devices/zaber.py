"""Stage with two axes of Zaber X-series devices, x lateral and z vertical, on one port.

Sources: Zaber ASCII protocol manual, firmware 6 and 7; transcripts of the maker's client, zaber-motion 10.3.0.

A device counts microsteps away from its home position, and machine coordinates fall away from home, so the counts of
an axis are minus the machine coordinate. The driver writes only `limit.min` and `limit.max`, and only if they differ,
`limit.min` before the first steps of homing: a device stores its settings permanently.
"""

import math
import re
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
from rig.devices.one_axis import POLL_S, TwoAxisStage, WatchedAxis, travel_s, whole_speed
from rig.devices.registry import Evidence, Opener, StageKind
from rig.devices.zaber_link import NO_WARNING, READ_TRIES, Reply, ZaberLink
from rig.settings import BenchSettings, StageSettings, ZaberAxisSettings, ZaberSettings

HOME_S = 180.0
# A move may take this much longer than computed from length, speed and acceleration.
LATE_FACTOR, LATE_S = 1.5, 5.0
STOP_S, HALT_S = 1.0, 2.0
# A stage that still moves so long after a stop gets an emergency stop.
ESTOP_AFTER_S = 0.3
TOLERANCE_MM = 2.5e-3
LEAST_FIRMWARE = (7, 25)
# Way up that `limit.min` must leave to jogs before homing.
UNHOMED_ROOM_MM = 1.0

ALARMS = {
    "FF": "critical system error",
    "FN": "peripheral not supported",
    "FZ": "peripheral inactive",
    "FH": "hardware emergency stop",
    "FV": "supply voltage out of range, driver off",
    "FO": "driver disabled",
    "FC": "current inrush error",
    "FM": "motor temperature",
    "FD": "driver disabled",
    "FQ": "encoder error",
    "FI": "index error",
    "FA": "encoder synchronization",
    "FR": "overdrive limit exceeded",
    "FS": "stalled and stopped",
    "FB": "stream bounds",
    "FP": "path deviation",
    "FE": "limit sensor not reached or faulty",
    "FT": "excessive twist",
    "WL": "unexpected limit sensor",
    "WS": "stalled and recovered",
    "WM": "moved while standing",
}
UNREFERENCED = frozenset(("WR", "WH"))
MANUAL, INTERRUPTED, DISPLACED = "NC", "NI", "WM"
HARMLESS = frozenset((*UNREFERENCED, MANUAL, INTERRUPTED, "WV", "WT", "WP", "ND", "NR", "NT", "NU", "NJ", "NB"))

_VERSION = re.compile(r"(\d+)\.(\d+)(?:\.\d+)?")


class ZaberAxis(WatchedAxis[Reply]):
    """One axis of a chain, in machine mm. counts_per_mm: microsteps for each mm of travel, positive."""

    def __init__(
        self,
        link: ZaberLink,
        clock: Clock,
        name: str,
        address: ZaberAxisSettings,
        units: ZaberSettings,
        *,
        counts_per_mm: float,
        travel_mm: float,
        least_acceleration_mm_s2: float,
    ) -> None:
        self.name, self.travel_mm = name, travel_mm
        self._link, self._clock, self._address, self._units = link, clock, address, units
        self._counts_per_mm = counts_per_mm
        self._least_acceleration_mm_s2 = least_acceleration_mm_s2
        self._acceleration_mm_s2 = math.inf
        self._question = "get encoder.pos" if address.encoder else "get pos"
        self.warned = frozenset[str]()  # warnings when they were last asked for

    @property
    def steps_per_mm(self) -> float:
        """Microsteps for each mm, negative because the counts grow away from home."""
        return -self._counts_per_mm

    def connect(self) -> str:
        """Compare the device with the configuration and return its identification. Raises StageError."""
        link, address = self._link, self._address.address
        device_id = link.ask(address, 0, "get deviceid").data
        version = link.ask(address, 0, "get version").data
        found = _VERSION.fullmatch(version)
        if found is None or (int(found[1]), int(found[2])) < LEAST_FIRMWARE:
            self._refuse_setting("firmware", version, "7.25 or later")
        resolution = self._number("get resolution")
        if resolution != self._address.resolution:
            self._refuse_setting("resolution", resolution, self._address.resolution)
        acceleration = self._number("get accel")
        unit = self._counts_per_mm * self._units.acceleration_unit
        self._acceleration_mm_s2 = acceleration / unit or math.inf
        if self._acceleration_mm_s2 < self._least_acceleration_mm_s2:
            least = f"at least {math.ceil(self._least_acceleration_mm_s2 * unit)} (stage.acceleration_mm_s2)"
            self._refuse_setting("accel", acceleration, least)
        self._refuse_short_travel(self._number("get limit.max"))
        axis = self._address.axis
        return f"{self.name}: Zaber device {address}, axis {axis}, id {device_id}, firmware {version}"

    def set_limits(self) -> None:
        """Make the limits of the device those of the travel; they are written only if they differ.

        Raises StageError if the device does not confirm them, or if its travel is too short.
        """
        for setting, value in (("limit.min", 0), ("limit.max", self._travel)):
            found = self._number(f"get {setting}")
            if setting == "limit.max":
                self._refuse_short_travel(found)
            if found != value:
                self._set_limit(setting, value)

    def allow_unhomed_jogs(self) -> None:
        """Lower `limit.min` if it leaves no way up to an axis without a home position; set_limits() sets it again.

        Raises StageError.
        """
        if not self.warnings(self.look()) & UNREFERENCED:
            return
        room = round(UNHOMED_ROOM_MM * self._counts_per_mm)
        if self._number("get pos") - room < self._number("get limit.min"):
            self._set_limit("limit.min", -self._travel)

    def _refuse_short_travel(self, longest: int) -> None:
        if longest < self._travel:
            self._refuse_setting("limit.max", longest, f"at least {self._travel} (stage.travel_mm)")

    def _set_limit(self, setting: str, value: int) -> None:
        """Set a limit and read it back; again if a message was wrong, since no motion follows. Raises StageError."""
        for left in reversed(range(READ_TRIES)):
            try:
                self._command(f"set {setting} {value}")
                found = self._number(f"get {setting}")
                if found != value:
                    self._refuse_setting(setting, found, value)
                return
            except StageError:
                if not left:
                    raise

    # --- motion ---

    def homing(self, keep_on: Callable[[], bool]) -> Iterator[Reply]:
        """Find the home position, which is 0 from then on; yield at each look. Raises StageError."""
        if not keep_on():
            raise self._stopped()
        self._command("home")

        def look() -> tuple[Reply, bool]:
            reply = self.look()
            self.refuse_alarm(self.warnings(reply), homing=True)
            return reply, not reply.busy

        yield from self._until(look, HOME_S, 0.0, "homing")
        reply = self.look()
        warnings = self.warnings(reply)
        at = self._position(reply)
        if warnings & (UNREFERENCED | {INTERRUPTED}) or abs(at) > self._tolerance:
            found = " ".join(sorted(warnings)) or "none"
            raise StageError(
                f"{self._label} did not home: it is at {at} with the warnings {found}; home again", "did_not_home"
            )

    def moving(self, to_mm: float, speed_mm_s: float, keep_on: Callable[[], bool], look_s: float) -> Iterator[Reply]:
        """Move to a position at a speed; yield each look, until arrival.

        A motion that leaves the way from start to target is stopped. Raises StageError; MoveError before any byte.
        """
        speed, target = self.native_speed(speed_mm_s), self._counts(to_mm)
        start = self._standing()
        if not keep_on():
            raise self._stopped()
        self._command(f"move abs {target} {speed}")

        def look() -> tuple[Reply, bool]:
            reply = self.look()
            if not keep_on():
                raise self._stopped()
            self._refuse_interference(reply)
            self._refuse_off_its_way(reply, start, target)
            return reply, not reply.busy

        mm = abs(target - start) / self._counts_per_mm
        expected_s = travel_s(mm, speed_mm_s, self._acceleration_mm_s2)
        what = f"the move to {to_mm:g} mm"
        yield from self._until(look, LATE_FACTOR * expected_s + LATE_S, expected_s, what, look_s)
        self._be_at(target)

    def jog(self, by_mm: float, speed_mm_s: float, keep_on: Callable[[], bool]) -> None:
        """Move by a distance from rest, and return at once. Raises StageError."""
        speed, by = self.native_speed(speed_mm_s), round(-by_mm * self._counts_per_mm)
        self._refuse_busy()
        if not keep_on():
            raise self._stopped()
        self._command(f"move rel {by} {speed}")

    def _refuse_busy(self) -> None:
        reply = self.look()
        self.refuse_alarm(self.warnings(reply))
        if reply.busy:
            raise StageOverridden(f"{self._label} moves already; another program moves it")

    def halt(self) -> None:
        """Stop this axis and return at rest; steps are not lost. Raises StageError."""
        deadline_s = self._clock.monotonic_s() + HALT_S
        problem: StageError | None = None
        while self._clock.monotonic_s() < deadline_s:
            try:
                self._command("stop")
                while self._clock.monotonic_s() < deadline_s:
                    if not self._ask("").busy:
                        return
                    self._clock.wait_s(POLL_S)
            except StageError as error:
                problem = error
        raise problem or self._still_moves(HALT_S)

    def confirm_stopped(self) -> None:
        """Verify a stop that was sent; one that does not take effect becomes an emergency stop. Raises StageError."""
        begun_s = self._clock.monotonic_s()
        problem: StageError | None = None
        while self._clock.monotonic_s() < begun_s + STOP_S:
            try:
                if not self._command("").busy:
                    return
                problem = None
            except StageError as error:
                problem = error
            late = self._clock.monotonic_s() >= begun_s + ESTOP_AFTER_S
            if late or problem is not None:
                self._link.send_now("estop" if late else "stop")
            self._clock.wait_s(POLL_S)
        raise problem or self._still_moves(STOP_S)

    # --- state ---

    def look(self) -> Reply:
        """Return the reply with position, state and warning. Raises StageError."""
        return self._ask(self._question)

    def mm(self, reply: Reply) -> float:
        """Return the machine coordinate in a reply to `look`. Raises StageError."""
        return -self._position(reply) / self._counts_per_mm

    def warnings(self, reply: Reply) -> frozenset[str]:
        """Return every warning of this axis: a reply shows the highest one alone, which may hide others.

        Raises StageError.
        """
        place = (self._address.address, self._address.axis)
        alerted = self._link.alerts.pop(place, NO_WARNING)
        self.warned = frozenset()
        if NO_WARNING == reply.warning == alerted:
            return self.warned
        found = {reply.warning, alerted} - {NO_WARNING}
        if found <= HARMLESS:
            count, *rest = self._ask("warnings").data.split()
            found |= set(rest)
            if not count.isdigit() or int(count) != len(rest):
                raise StageError(
                    f"{self._label}: {' '.join((count, *rest))!a} is not a list of warnings", "no_warnings"
                )
        self.warned = frozenset(found)
        return self.warned

    def refuse_alarm(self, warnings: frozenset[str], *, homing: bool = False) -> None:
        """Refuse a fault, and a warning that is not known to be harmless. Raises StageAlarm."""
        tolerated = HARMLESS | {DISPLACED} if homing else HARMLESS
        for flag in sorted(warnings - tolerated):
            meaning = ALARMS.get(flag, "unknown warning, see its manual")
            raise StageAlarm(flag, f"{self._label}: {meaning}")

    def refuse_unreferenced(self, warnings: frozenset[str]) -> None:
        """Refuse a device that has lost its home position. Raises StageReset."""
        if warnings & UNREFERENCED:
            raise StageReset(f"{self._label} is no longer homed, probably because it was switched off; home again")

    def clear_warnings(self) -> None:
        """Clear the warnings that stay until they are cleared. Raises StageAlarm if a fault is still there."""
        self._link.alerts.pop((self._address.address, self._address.axis), None)
        self._command("warnings clear")
        self.refuse_alarm(self.warnings(self._ask("")), homing=True)

    def native_speed(self, speed_mm_s: float) -> int:
        """Return the speed in native units, rounded down. Raises MoveError below 1."""
        return whole_speed(speed_mm_s, self._counts_per_mm * self._units.speed_unit)

    # --- helpers ---

    def _refuse_off_its_way(self, reply: Reply, start: int, target: int) -> None:
        """Stop the chain and raise an error for a position that is not between two others, in either order."""
        low, high = min(start, target) - self._tolerance, max(start, target) + self._tolerance
        at = self._position(reply)
        if not low <= at <= high:
            self._link.send_now("stop")
            raise self._not_there(at, target)

    def _be_at(self, target: int) -> None:
        """Raise an error unless the axis is at the target, by one of two status reports."""
        at = self._position(self.look())
        if abs(at - target) > self._tolerance:
            at = self._position(self.look())
        if abs(at - target) > self._tolerance:
            raise self._not_there(at, target)

    def _refuse_interference(self, reply: Reply) -> None:
        """Raise for what ends a motion: a fault, a reset, a hand at the knob, another program."""
        warnings = self.warnings(reply)
        self.refuse_alarm(warnings)
        self.refuse_unreferenced(warnings)
        if MANUAL in warnings:
            raise StageHeld(MANUAL, f"{self._label}: ")
        if INTERRUPTED in warnings:
            raise StageOverridden(f"{self._label}: another program or the device itself has interrupted the motion")

    def _standing(self) -> int:
        """Return the position at rest."""
        reply = self.look()
        warnings = self.warnings(reply)
        self.refuse_alarm(warnings)
        self.refuse_unreferenced(warnings)
        if reply.busy:
            raise StageHeld(MANUAL if MANUAL in warnings else "BUSY", f"{self._label}: ")
        return self._position(reply)

    @property
    def _travel(self) -> int:
        return round(self.travel_mm * self._counts_per_mm)

    @property
    def _tolerance(self) -> float:
        return max(TOLERANCE_MM * self._counts_per_mm, 1.0)

    def _counts(self, mm: float) -> int:
        return round(-mm * self._counts_per_mm)

    def _position(self, reply: Reply) -> int:
        return self._whole(reply.data, self._question)

    def _number(self, question: str) -> int:
        return self._whole(self._ask(question).data, question)

    def _whole(self, data: str, question: str) -> int:
        if not re.fullmatch(r"-?\d{1,10}", data):
            raise StageError(f"{self._label}: {data!a} is not a reply to {question!r}", "no_number")
        return int(data)

    def _ask(self, words: str) -> Reply:
        return self._link.ask(self._address.address, self._address.axis, words)

    def _command(self, words: str) -> Reply:
        return self._link.command(self._address.address, self._address.axis, words)

    def _refuse_setting(self, setting: str, found: object, expected: object) -> None:
        raise StageError(
            f"{self._label}: {setting} of the device is {found}, expected {expected}", "not_as_configured"
        )

    def _not_there(self, at: int, target: int) -> StageError:
        return StageError(
            f"{self._label} is at {-at / self._counts_per_mm:.4f} mm instead of {-target / self._counts_per_mm:g} mm",
            "not_there",
        )

    def _still_moves(self, timeout_s: float) -> StageTimeout:
        return StageTimeout(
            f"{self._label} still moves {timeout_s:g} s after a stop; use the emergency stop", "still_runs"
        )

    @property
    def _label(self) -> str:
        return f"{self._link.name}: {self.name} axis"


class ZaberStage(TwoAxisStage[ZaberAxis, Reply]):
    """Stage with two axes of a Zaber chain."""

    def __init__(self, link: ZaberLink, x: ZaberAxis, z: ZaberAxis, settings: BenchSettings) -> None:
        super().__init__(x, z, name=f"{link.name}: the stage", settings=settings)
        self._link = link

    def homing(self) -> Looks:
        """Home z, then x, and set the limits of the devices. A fault is not cleared. Raises StageError.

        A motion that a program left behind, is ended first: the device reports it as interrupted.
        """
        self._trusted = False
        keep_on = self._until_stopped()
        for axis in self._up_first():
            look = axis.look()
            axis.refuse_alarm(axis.warnings(look), homing=True)
            if look.busy:
                axis.halt()
        for axis in self._up_first():
            for _ in axis.homing(keep_on):
                yield None
            axis.set_limits()
        self._trusted = keep_on()

    def unlock(self) -> None:
        """Clear the warnings of both axes; the position stays untrusted. Raises StageError."""
        self._trusted = False
        for axis in self._up_first():
            axis.clear_warnings()

    def allow_unhomed_jogs(self) -> None:
        """Let the z axis jog up and down before homing. Raises StageError."""
        self._axes["z"].allow_unhomed_jogs()

    def set_output(self, on: bool) -> None:
        """Refuse: no output of a Zaber device is supported. Raises StageError."""
        raise StageError("a Zaber stage has no output for pulses; set sync.output to off", "no_output")

    def close(self) -> None:
        self._link.close()

    def _send_stop(self) -> None:
        self._link.send_now("stop")  # to every device of the chain

    def _refuse_alarm(self, axis: ZaberAxis, look: Reply) -> None:
        warnings = axis.warnings(look)
        axis.refuse_alarm(warnings)
        if self._trusted:
            axis.refuse_unreferenced(warnings)

    def _is_referenced(self, axis: ZaberAxis, look: Reply) -> bool:
        return not axis.warned & UNREFERENCED


def steps_per_mm(stage: StageSettings, axis: str) -> float:
    """Return the microsteps per mm that the configuration gives; y has no motor."""
    own = stage.own(ZaberSettings)
    return -1e3 / (own.x if axis == "x" else own.z).microstep_um


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    stage = settings.stage
    link, own = ZaberLink(opener(stage.port), clock), stage.own(ZaberSettings)
    x, z = (
        ZaberAxis(
            link,
            clock,
            name,
            address,
            own,
            counts_per_mm=abs(settings.calibration.value(f"{name}_steps_per_mm", steps_per_mm(stage, name))),
            travel_mm=stage.travel_mm["xyz".index(name)],
            least_acceleration_mm_s2=stage.acceleration_mm_s2 if name == "z" else 0.0,
        )
        for name, address in (("x", own.x), ("z", own.z))
    )
    return ZaberStage(link, x, z, settings)


def _probe(opener: Opener, clock: Clock, settings: BenchSettings) -> str | None:
    """Ask both devices for their device id."""
    own = settings.stage.own(ZaberSettings)
    transport = opener(settings.stage.port)
    found: dict[int, str] = {}
    # The first command may follow bytes of another probe without a line end, and is then not understood.
    for address in 2 * list(dict.fromkeys((own.x.address, own.z.address))):
        if address in found:
            continue
        with suppress(StageError):
            found[address] = ZaberLink(transport, clock).command(address, 0, "get deviceid").data
    if not found:
        return None
    if len(found) < len({own.x.address, own.z.address}):
        (answers,) = found
        silent = own.x.address + own.z.address - answers
        raise StageError(
            f"{transport.name}: of the Zaber devices {own.x.address} and {own.z.address}, only one answers; "
            f"device {silent} does not; check its power, cable and address, or set the addresses under "
            "[stage.zaber]",
            "one_device",
        )
    return "Zaber devices " + " and ".join(f"{address} (id {device_id})" for address, device_id in found.items())


DEVICE = StageKind(
    name="zaber",
    device="two axes of Zaber X-series devices (ASCII protocol)",
    driver=_driver,
    settings=ZaberSettings,
    axes="xz",
    steps_per_mm=steps_per_mm,
    twin="sim.devices.zaber:zaber_twin",
    ramps=True,
    probe=_probe,
    tests=("tests/rig/test_zaber_driver.py", "tests/rig/test_makers_clients.py"),
    evidence=Evidence(
        manual="ASCII protocol manual, firmware 6 and 7",
        client="zaber-motion 10.3.0",
    ),
)
