"""Axis with a Leadshine CS2RS or iEM-RS drive in PR mode. Source: CS2RS and iEM-RS user manuals.

Nothing is ever saved to the drive's EEPROM, which wears out: the written settings are lost at power-off.

Modbus TCP has no checksum, so a single bit error must not start a wrong motion:

- A path is written without its trigger and read back; the trigger that follows is the same word for every move.
- Every other motion that a bit error can start is made harmless beforehand (disarm): all other paths are null, and
  homing and jogging creep. A path that has arrived ends where the axis is; any other one is set to null.
- A target that counts from a position of the drive uses a position that was read twice.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from enum import IntFlag

from rig.clock import Clock
from rig.devices.base import LOOK_S, MoveError, StageAlarm, StageError, StageOverridden, StageTimeout, next_look_s
from rig.settings import DriveSettings
from rig.transport.modbus import ModbusError, ModbusMaster, ModbusTimeout

STATUS, ALARM, CONTROL, TRIGGER = 0x1003, 0x2203, 0x1801, 0x6002
INPUT_NAMES = tuple(f"di{n}" for n in range(1, 8))
COMMANDED, FEEDBACK = 0x602C, 0x1014  # 32 bits each
PR0 = 0x6200  # mode, position (32 bits), rpm, ramp up, ramp down, pause, and the trigger, which is never written
PATHS = range(PR0, PR0 + 16 * 8, 8)  # mode register of each path, PR0 to PR15
SOFT_LIMITS, POSITIVE_LIMIT, NEGATIVE_LIMIT = 0x6000, 0x6006, 0x6008
HOMING_MODE, HOMING_SPEEDS = 0x600A, 0x600F  # high and low rpm, ramp up, ramp down
NO_PATH, ABSOLUTE = 0x0000, 0x0001
RUN_PR0, HOME, QUICK_STOP = 0x0010, 0x0020, 0x0040
SOFT_LIMITS_ON = 0x0002
CLEAR_ALARM = 0x1111

ALARMS = {
    0xE0: "over-current",
    0xC0: "over-voltage",
    0xA1: "current sensing",
    0x152: "motor phase",
    0x240: "EEPROM",
}


class Status(IntFlag):
    """Bits of the motion status word."""

    FAULT = 1 << 0
    ENABLED = 1 << 1
    RUNNING = 1 << 2
    COMMAND_DONE = 1 << 4
    PATH_DONE = 1 << 5
    HOMED = 1 << 6


def words(value: int) -> list[int]:
    """Return a 32-bit number, two's complement, as two registers, high word first."""
    return [value >> 16 & 0xFFFF, value & 0xFFFF]


def number(pair: Sequence[int]) -> int:
    """Return two registers, high word first, as a 32-bit number in two's complement."""
    value = pair[0] << 16 | pair[1]
    return value - (1 << 32) if value & 1 << 31 else value


def path(position: int, rpm: int, ramp_ms: int) -> list[int]:
    """Return the first seven registers of PR0 for an absolute move: all but its trigger."""
    return [ABSOLUTE, *words(position), rpm, ramp_ms, ramp_ms, 0]


POLL_S, ALARM_S = 0.02, 0.25
HOME_S = 180.0
# Time until the status word shows a trigger.
START_S = 0.05
# A move may take this much longer than computed from length, speed and ramps.
LATE_FACTOR, LATE_S = 1.5, 5.0
STOP_S = 1.0
# Maximum distance of the feedback from the target on arrival.
TOLERANCE_MM = 0.0025
# Within this time a homing drive reports that it runs, or that it is no longer homed.
HOMING_BEGINS_S = 1.0
# Speed of homing and jogging that a bit error could start.
CREEP_RPM = 1


class LeadshineDrive:
    """Moves of one axis in mm; the vertical one is positive away from the finger.

    pulses_per_mm is the measured number, negative if the motor runs against the axis.
    """

    def __init__(
        self,
        bus: ModbusMaster,
        clock: Clock,
        axis: str,
        settings: DriveSettings,
        *,
        pulses_per_mm: float,
        travel_mm: float,
    ) -> None:
        self.bus, self.axis, self.device_id = bus, axis, settings.device_id
        self._clock, self._settings = clock, settings
        self.travel_mm = travel_mm
        self.pulses_per_mm = pulses_per_mm
        self._loose = False  # whether PR0 may lead away from the present position
        self.harmless = False  # whether disarm() was done and every exchange since succeeded

    # --- settings ---

    def connect(self) -> str:
        """Check that the drive agrees with the configuration, disarm it, and return its identification.

        Raises StageError.
        """
        settings = self._settings
        self._expect("pulses per turn", settings.pulses_per_rev_register, [settings.pulses_per_rev])
        self.disarm()
        return f"{self.axis}: Leadshine drive {self.device_id}, {settings.pulses_per_rev} pulses per turn"

    def disarm(self) -> None:
        """Clear everything that a bit error could start: null paths, and creep speed for homing and jogs.

        Nothing is saved, so the owner's paths return when the drive is switched on again. Raises StageError.
        """
        ramp = self._settings.homing_ramp_ms
        for name, register, harmless in (
            *((f"path {number}", register, [NO_PATH]) for number, register in enumerate(PATHS)),
            ("homing speeds", HOMING_SPEEDS, [CREEP_RPM, CREEP_RPM, ramp, ramp]),
            ("jog speed", self._settings.jog_rpm_register, [CREEP_RPM]),
        ):
            if self._read(register, len(harmless)) != harmless:
                self._set(name, register, harmless)
        self._loose = False
        self.harmless = True

    def set_soft_limits(self) -> None:
        """Set the soft limits of the drive to 0 … −travel and read them back. Raises StageError."""
        low, high = sorted((0, self._pulses(-self.travel_mm)))
        for name, register, value in (
            ("positive soft limit", POSITIVE_LIMIT, words(high)),
            ("negative soft limit", NEGATIVE_LIMIT, words(low)),
            ("soft limits", SOFT_LIMITS, [SOFT_LIMITS_ON]),
        ):
            self._set(name, register, value)

    def limit_travel(self, lowest_mm: float) -> None:
        """Move the lower soft limit within the travel, at rest; it holds until the next homing.

        Raises StageError, also if the drive does not confirm it; MoveError.
        """
        if not math.isfinite(lowest_mm):
            raise MoveError(f"lowest_mm must be a finite number, got {lowest_mm}", "not_finite")
        status = self.status()
        self._refuse(status)
        self._refuse_unhomed(status)
        if Status.RUNNING in status:
            raise StageError(f"{self._label} is moving; a soft limit can be set only at rest", "runs")
        lowest = self._pulses(min(max(lowest_mm, -self.travel_mm), 0.0))
        if self.pulses_per_mm > 0:
            self._set("negative soft limit", NEGATIVE_LIMIT, words(lowest))
        else:
            self._set("positive soft limit", POSITIVE_LIMIT, words(lowest))
        self._expect("soft limits", SOFT_LIMITS, [SOFT_LIMITS_ON])

    # --- motion ---

    def homing(self, keep_on: Callable[[], bool]) -> Iterator[Status]:
        """Home the axis, whose switch is 0 from then on; yield at each status.

        keep_on is checked just before the start. Raises StageError.
        """
        self.refuse_fault()
        settings = self._settings
        ramp = settings.homing_ramp_ms
        self._set("homing mode", HOMING_MODE, [settings.homing_mode])
        speeds = [settings.homing_high_rpm, settings.homing_low_rpm, ramp, ramp]
        self._set("homing speeds", HOMING_SPEEDS, speeds)
        self._trigger(HOME, keep_on)
        begun, begins_by_s = False, self._clock.monotonic_s() + HOMING_BEGINS_S

        def at_home(status: Status) -> bool:
            nonlocal begun
            begun = begun or Status.RUNNING in status or Status.HOMED not in status
            if not begun and self._clock.monotonic_s() >= begins_by_s:
                raise StageError(f"{self._label} did not start to home; home again", "did_not_home")
            return begun and Status.HOMED in status and self._commanded() == 0

        yield from self._until(at_home, HOME_S, START_S, "homing")

    def moving(self, to_mm: float, speed_mm_s: float, keep_on: Callable[[], bool], look_s: float) -> Iterator[Status]:
        """Move to a position at up to speed_mm_s; yield the status every look_s, until arrival.

        keep_on returns whether to continue waiting. Raises StageError; MoveError before any byte if the speed is
        too low for the drive.
        """
        target, rpm = self._pulses(to_mm), self.rpm(speed_mm_s)
        status, start = self.status(), self._commanded()
        self._refuse(status)
        self._refuse_unhomed(status)
        self._start(target, rpm, keep_on)
        expected_s = self._travel_s(abs(target - start), rpm)
        late_s = LATE_FACTOR * expected_s + LATE_S

        def there(status: Status) -> bool:
            if not keep_on():
                raise self._stopped()
            self._refuse_unhomed(status)
            return Status.PATH_DONE in status and self._commanded() == target

        yield from self._until(there, late_s, expected_s, f"the move to {to_mm:g} mm", look_s)
        at_mm = self.position_mm()
        if abs(at_mm - target / self.pulses_per_mm) > TOLERANCE_MM:
            raise StageError(f"{self._label} is at {at_mm:.4f} mm instead of {to_mm:g} mm", "not_there")
        self._loose = False

    def jog(self, by_mm: float, speed_mm_s: float, keep_on: Callable[[], bool]) -> None:
        """Move by a distance from rest, and return at once.

        keep_on is checked just before the start. Raises StageError.
        """
        rpm, status = self.rpm(speed_mm_s), self.status()
        self._refuse(status)
        if Status.RUNNING in status:
            raise StageOverridden(f"{self._label} moves already; another program moves it")
        self._start(self._standing() + self._pulses(by_mm), rpm, keep_on)

    def confirm_stopped(self) -> None:
        """Repeat the quick stop until the drive reports rest, and clear its path. Raises StageError."""
        deadline_s = self._clock.monotonic_s() + STOP_S
        problem: StageError | None = None
        while self._clock.monotonic_s() < deadline_s:
            try:
                self._write(TRIGGER, QUICK_STOP)
                if Status.RUNNING not in self.status():
                    if self._loose:
                        self._drop_path()
                    return
            except StageError as error:
                problem = error
            self._clock.wait_s(POLL_S)
        raise problem or StageTimeout(
            f"{self._label} still moves {STOP_S:g} s after a quick stop; use the emergency stop", "still_runs"
        )

    def write_word(self, register: int, value: int) -> None:
        """Write another register. Raises StageError."""
        self._write(register, value)

    # --- status ---

    def status(self) -> Status:
        """Return the status word. Raises StageError."""
        return Status(self._read(STATUS)[0])

    def inputs(self, register: int) -> int:
        """Return the word of the digital inputs, DI1 in the lowest bit. Raises StageError."""
        return self._read(register)[0]

    def position_mm(self) -> float:
        """Return the position by the feedback (mm). Raises StageError."""
        return number(self._read(FEEDBACK, 2)) / self.pulses_per_mm

    def refuse_fault(self) -> None:
        """Check that the drive works. Raises StageAlarm for an alarm, StageError if it is not enabled."""
        self._refuse(self.status())

    def clear_alarm(self) -> None:
        """Clear an alarm. Raises StageAlarm if it is still there afterwards."""
        self._write(CONTROL, CLEAR_ALARM)
        self.refuse_fault()

    def rpm(self, speed_mm_s: float) -> int:
        """Return the speed in whole rpm, rounded down. Raises MoveError below 1 rpm."""
        pulses_s = abs(self.pulses_per_mm) * speed_mm_s
        rpm = math.floor(60 * pulses_s / self._settings.pulses_per_rev + 1e-9)
        if rpm < 1:
            slowest = self._settings.pulses_per_rev / 60 / abs(self.pulses_per_mm)
            raise MoveError(f"speed_mm_s must be at least {slowest:.4f}, got {speed_mm_s}", "too_slow")
        return rpm

    # --- motion commands ---

    def _start(self, target: int, rpm: int, keep_on: Callable[[], bool]) -> None:
        """Start an absolute move that the drive has confirmed."""
        self._loose = True
        self._set("path 0", PR0, path(target, rpm, self._settings.ramp_ms))
        self._trigger(RUN_PR0, keep_on)

    def _trigger(self, word: int, keep_on: Callable[[], bool]) -> None:
        """Start the prepared motion, unless the drive was stopped meanwhile."""
        if not keep_on():
            raise self._stopped()
        self._write(TRIGGER, word)

    def _drop_path(self) -> None:
        self._set("path 0", PR0, [NO_PATH])
        self._loose = False

    def _standing(self) -> int:
        """Return the commanded position at rest; read twice, since an error would become a wrong target."""
        once, again = self._commanded(), self._commanded()
        if once != again:
            raise StageError(
                f"{self._label} reports {once} and then {again} pulses at rest; check whether it moves",
                "answers_differ",
            )
        return again

    def _until(
        self, done: Callable[[Status], bool], most_s: float, first_s: float, what: str, look_s: float = LOOK_S
    ) -> Iterator[Status]:
        """Wait until the drive rests and done() is true; yield the status every look_s.

        During the first first_s the drive is polled seldom, for alarms, and steadily afterwards.
        """
        begun_s = self._clock.monotonic_s()
        over_s, due_s = begun_s + first_s, next_look_s(begun_s, begun_s + first_s, look_s)
        while True:
            now_s = self._clock.monotonic_s()
            self._clock.wait_s(min(over_s - now_s, due_s - now_s, ALARM_S) if over_s > now_s else POLL_S)
            status = self.status()
            self._refuse(status)
            if done(status) and Status.RUNNING not in status:
                return
            if self._clock.monotonic_s() >= begun_s + most_s:
                raise StageTimeout(
                    f"{self._label}: {what} takes longer than {most_s:.1f} s (status {status!r})", "not_over"
                )
            if self._clock.monotonic_s() >= due_s:
                yield status
                due_s = next_look_s(self._clock.monotonic_s(), over_s, look_s)

    def _refuse_unhomed(self, status: Status) -> None:
        """Raise if the drive lost its home: after power-off its origin and its paths have changed."""
        if Status.HOMED not in status:
            self.harmless = False
            raise StageError(
                f"{self._label} is no longer homed, probably because it was switched off; home again", "lost_home"
            )

    def _refuse(self, status: Status) -> None:
        if Status.FAULT in status:
            code = self._read(ALARM)[0]
            raise StageAlarm(code, f"{self._label}: {ALARMS.get(code, 'see its manual')} ({code:X} hex)")
        if Status.ENABLED not in status:
            raise StageError(f"{self._label} is not enabled; enable it", "not_enabled")

    def _travel_s(self, pulses: int, rpm: int) -> float:
        pulses_s = rpm * self._settings.pulses_per_rev / 60
        ramp_s = self._settings.ramp_ms / 1000 * rpm / self._settings.ramp_rpm
        if pulses <= pulses_s * ramp_s:
            return 2 * math.sqrt(pulses * ramp_s / pulses_s)
        return pulses / pulses_s + ramp_s

    def _commanded(self) -> int:
        return number(self._read(COMMANDED, 2))

    def _pulses(self, mm: float) -> int:
        return round(mm * self.pulses_per_mm)

    def _set(self, name: str, register: int, values: list[int]) -> None:
        with self._errors():
            self.bus.write(self.device_id, register, values)
        self._expect(name, register, values)

    def _expect(self, name: str, register: int, values: list[int]) -> None:
        found = self._read(register, len(values))
        if found != values:
            self.harmless = False
            raise StageError(
                f"{self._label}: {name} (0x{register:04X}) is {found}, expected {values}", "not_as_configured"
            )

    def _read(self, register: int, count: int = 1) -> list[int]:
        with self._errors():
            return self.bus.read(self.device_id, register, count)

    def _write(self, register: int, value: int) -> None:
        with self._errors():
            self.bus.write_one(self.device_id, register, value)

    @contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except ModbusTimeout as error:
            self.harmless = False
            raise StageTimeout(f"{self.axis} axis: {error}", error.code) from error
        except ModbusError as error:
            self.harmless = False
            raise StageError(f"{self.axis} axis: {error}", error.code) from error

    def _stopped(self) -> StageError:
        return StageError(f"{self._label} was stopped", "stopped")

    @property
    def _label(self) -> str:
        return f"{self.bus.name}: {self.axis} axis, drive {self.device_id}"
