"""Registers and words of a Leadshine CS2RS / iEM-RS drive in PR mode. Source: CS2RS and iEM-RS user manuals."""

from collections.abc import Sequence
from enum import IntFlag

STATUS, ALARM, CONTROL, TRIGGER = 0x1003, 0x2203, 0x1801, 0x6002
INPUTS = 0x0179  # second-hand: [stop] inputs_register can say another
INPUT_NAMES = tuple(f"di{n}" for n in range(1, 8))
COMMANDED, FEEDBACK = 0x602C, 0x1014  # 32 bits each
PR0 = 0x6200  # mode, position (32 bits), rpm, ramp up, ramp down, pause; then its trigger, which is never written
PATHS = range(PR0, PR0 + 16 * 8, 8)  # the mode of each path, PR0 to PR15
SOFT_LIMITS, POSITIVE_LIMIT, NEGATIVE_LIMIT = 0x6000, 0x6006, 0x6008
HOMING_MODE, HOMING_SPEEDS = 0x600A, 0x600F  # high and low rpm, ramp up, ramp down
NO_PATH, ABSOLUTE = 0x0000, 0x0001
RUN_PR0, HOME, QUICK_STOP = 0x0010, 0x0020, 0x0040
SOFT_LIMITS_ON = 0x0002
CLEAR_ALARM, JOG_POSITIVE, JOG_NEGATIVE = 0x1111, 0x4001, 0x4002

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
    """A 32-bit number, two's complement, as two registers, high word first."""
    return [value >> 16 & 0xFFFF, value & 0xFFFF]


def number(pair: Sequence[int]) -> int:
    """Two registers, high word first, as a 32-bit number in two's complement."""
    value = pair[0] << 16 | pair[1]
    return value - (1 << 32) if value & 1 << 31 else value


def path(position: int, rpm: int, ramp_ms: int) -> list[int]:
    """The first seven registers of PR0 for an absolute move: all but its trigger."""
    return [ABSOLUTE, *words(position), rpm, ramp_ms, ramp_ms, 0]
