"""Axis with a Leadshine CS2RS or iEM-RS drive in PR mode. Source: CS2RS and iEM-RS user manuals.

Nothing is ever saved to the drive's EEPROM, which wears out: the written settings are lost at power-off.

Modbus TCP has no checksum, so a single bit error must not start a wrong motion:

- A path is written without its trigger and read back; the trigger that follows is the same word for every move.
- Every other motion that a bit error can start is made harmless beforehand (disarm): all other paths are null, and
  homing and jogging creep. A path that has arrived ends where the axis is; any other one is set to null.
- A target that counts from a position of the drive uses a position that was read twice.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntFlag

from rig.clock import Clock
from rig.devices.base import MoveError, StageError, StageReset, StageTimeout
from rig.devices.counted_axis import AxisSpec, CountedAxis, Destination, Fault, FaultKind, Look, Setting
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

# Speed of homing and jogging that a bit error could start.
CREEP_RPM = 1

ALARMS = {
    0xE0: "over-current",
    0xC0: "over-voltage",
    0xA1: "current sensing",
    0x152: "motor phase",
    0x240: "EEPROM",
}
DISABLED = Fault(FaultKind.DISABLED, "", "is not enabled; enable it")
LOST = Fault(FaultKind.LOST, "", "is no longer homed, probably because it was switched off")


class Status(IntFlag):
    """Bits of the motion status word."""

    FAULT = 1 << 0
    ENABLED = 1 << 1
    RUNNING = 1 << 2
    COMMAND_DONE = 1 << 4
    PATH_DONE = 1 << 5
    HOMED = 1 << 6


NO_STATUS = Status(0)


def words(value: int) -> list[int]:
    """Return a 32-bit number, two's complement, as two registers, high word first."""
    return [value >> 16 & 0xFFFF, value & 0xFFFF]


def number(pair: Sequence[int]) -> int:
    """Return two registers, high word first, as a 32-bit number in two's complement."""
    value = pair[0] << 16 | pair[1]
    return value - (1 << 32) if value & 1 << 31 else value


@dataclass(frozen=True, slots=True)
class DriveLook(Look):
    """State of a drive: its status word."""

    word: Status = NO_STATUS


class LeadshineDrive(CountedAxis[DriveLook]):
    """One drive; its measured number of pulses is negative if the motor runs against the axis."""

    halt_again_s = 0.0
    link: ModbusMaster

    def __init__(self, bus: ModbusMaster, clock: Clock, spec: AxisSpec, settings: DriveSettings) -> None:
        super().__init__(bus, clock, spec, speed_unit=60 / settings.pulses_per_rev)
        self.device_id, self._settings = settings.device_id, settings
        ramp_s = settings.ramp_ms / 1000 / settings.ramp_rpm  # for 1 rpm
        self.acceleration_mm_s2 = 1 / (ramp_s * self.speed_unit) if ramp_s else math.inf
        self._loose = False  # whether PR0 may lead away from the present position
        self.harmless = False  # whether disarm() was done and every exchange since succeeded

    @property
    def label(self) -> str:
        return f"{self.link.name}: {self.name} axis, drive {self.device_id}"

    # --- settings ---

    def identify(self) -> str:
        return f"Leadshine drive {self.device_id}, {self._settings.pulses_per_rev} pulses per turn"

    def settings(self) -> Iterator[Setting]:
        yield self._setting(
            "pulses per turn", self._settings.pulses_per_rev_register, [self._settings.pulses_per_rev]
        )
        self.disarm()

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

    def limit_travel(self, lowest_mm: float) -> None:
        """Move the lower soft limit within the travel, at rest; it holds until the next homing.

        Raises StageError, also if the drive does not confirm it; MoveError.
        """
        if not math.isfinite(lowest_mm):
            raise MoveError(f"lowest_mm must be a finite number, got {lowest_mm}", "not_finite")
        found = self.look()
        self.refuse(found, (*FaultKind,))
        if found.busy:
            raise StageError(f"{self.label} is moving; a soft limit can be set only at rest", "runs")
        lowest = words(self.counts(min(max(lowest_mm, -self.travel_mm), 0.0)))
        if self.steps_per_mm > 0:
            self._set("negative soft limit", NEGATIVE_LIMIT, lowest)
        else:
            self._set("positive soft limit", POSITIVE_LIMIT, lowest)
        self.compare(self._setting("soft limits", SOFT_LIMITS, [SOFT_LIMITS_ON]))

    # --- motion ---

    def aim(self, target: Destination, speed: int) -> None:
        """Write the path without its trigger, and read it back."""
        self._loose = True
        ramp_ms = self._settings.ramp_ms
        self._set("path 0", PR0, [ABSOLUTE, *words(target.position), speed, ramp_ms, ramp_ms, 0])

    def go(self, target: Destination, speed: int) -> None:
        self.write_word(TRIGGER, RUN_PR0)

    def is_over(self, found: DriveLook, target: int) -> bool:
        return not found.busy and Status.PATH_DONE in found.word and self._commanded() == target

    def strayed(self, found: DriveLook, start: int, target: int, speed_mm_s: float, begun_s: float) -> None:
        """Judge nothing: the feedback lags behind and overshoots by some pulses."""

    def finish_move(self) -> None:
        self._loose = False

    def count_at_rest(self, found: DriveLook) -> int:
        """Return the commanded position; read twice, since an error would become a wrong target."""
        once, again = self._commanded(), self._commanded()
        if once != again:
            raise StageError(
                f"{self.label} reports {once} and then {again} pulses at rest; check whether it moves",
                "answers_differ",
            )
        return again

    def send_stop(self, after_s: float, *, halting: bool) -> None:
        self.write_word(TRIGGER, QUICK_STOP)

    def rests(self) -> bool:
        """Return whether the drive rests; its path is then made null."""
        if Status.RUNNING in self._word():
            return False
        if self._loose:
            self._set("path 0", PR0, [NO_PATH])
            self._loose = False
        return True

    def stop_now(self) -> None:
        self.link.send_now([self.device_id], TRIGGER, QUICK_STOP)

    def before_homing(self) -> None:
        self.disarm()  # It may have been switched off since.

    def aim_home(self) -> None:
        settings, ramp = self._settings, self._settings.homing_ramp_ms
        self._set("homing mode", HOMING_MODE, [settings.homing_mode])
        speeds = [settings.homing_high_rpm, settings.homing_low_rpm, ramp, ramp]
        self._set("homing speeds", HOMING_SPEEDS, speeds)

    def go_home(self) -> None:
        self.write_word(TRIGGER, HOME)

    def homes(self, found: DriveLook) -> bool:
        return found.busy or LOST in found.faults

    def has_homed(self, found: DriveLook) -> bool:
        return not found.busy and LOST not in found.faults and self._commanded() == 0

    def not_home(self, found: DriveLook) -> str | None:
        return "it lost its home position" if LOST in found.faults else None

    def finish_homing(self) -> None:
        """Set the soft limits of the drive to the travel, and read them back."""
        low, high = sorted((0, self.counts(-self.travel_mm)))
        for name, register, value in (
            ("positive soft limit", POSITIVE_LIMIT, words(high)),
            ("negative soft limit", NEGATIVE_LIMIT, words(low)),
            ("soft limits", SOFT_LIMITS, [SOFT_LIMITS_ON]),
        ):
            self._set(name, register, value)

    def clear(self) -> None:
        self.write_word(CONTROL, CLEAR_ALARM)

    # --- state ---

    def look(self) -> DriveLook:
        word = self._word()
        faults = tuple(self._faults(word))
        return DriveLook(0, Status.RUNNING in word, faults, word=word)

    def position(self, found: DriveLook) -> int:
        return number(self._read(FEEDBACK, 2))

    def _faults(self, word: Status) -> Iterator[Fault]:
        if Status.FAULT in word:
            code = self._read(ALARM)[0]
            yield Fault(FaultKind.ALARM, code, f"{ALARMS.get(code, 'see its manual')} ({code:X} hex)")
        elif Status.ENABLED not in word:
            yield DISABLED
        if Status.HOMED not in word:
            yield LOST

    def refuse(self, found: DriveLook, kinds: Iterable[FaultKind]) -> None:
        try:
            super().refuse(found, kinds)
        except StageReset:
            self.harmless = False  # After power-off its paths are those of its EEPROM.
            raise

    def inputs(self, register: int) -> int:
        """Return the word of the digital inputs, DI1 in the lowest bit. Raises StageError."""
        return self._read(register)[0]

    # --- registers ---

    def write_word(self, register: int, value: int) -> None:
        """Write one register. Raises StageError."""
        with self._errors():
            self.link.write_one(self.device_id, register, value)

    def _word(self) -> Status:
        return Status(self._read(STATUS)[0])

    def _commanded(self) -> int:
        return number(self._read(COMMANDED, 2))

    def _set(self, name: str, register: int, values: list[int]) -> None:
        with self._errors():
            self.link.write(self.device_id, register, values)
        self.compare(self._setting(name, register, values))

    def _setting(self, name: str, register: int, expected: list[int]) -> Setting:
        found = self._read(register, len(expected))
        self.harmless &= found == expected
        return Setting(f"{name} (0x{register:04X})", found, expected)

    def _read(self, register: int, count: int = 1) -> list[int]:
        with self._errors():
            return self.link.read(self.device_id, register, count)

    @contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except ModbusTimeout as error:
            self.harmless = False
            raise StageTimeout(f"{self.name} axis: {error}", error.code) from error
        except ModbusError as error:
            self.harmless = False
            raise StageError(f"{self.name} axis: {error}", error.code) from error
