"""Settings `$n=v` of a GRBL 1.1 board and the rules for storing them.

Source: GRBL 1.1 configuration wiki. The defaults are this rig's, not the firmware's.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt

from sim.devices.grbl.planner import AxisLimits, ConstantAcceleration, Counts, Piece, Vec, trapezoid

STEP_DIRECTION, INCHES, SOFT_LIMITS, HOMING = 3, 13, 20, 22
STEPS_PER_MM, TRAVEL = 100, 130  # of x, the other axes after it

# 400 steps/mm: a 1.8° motor on a 0.5 mm screw. Z (vertical) is the slow axis; all are far under a stall.
RIG_DEFAULTS: Mapping[int, float] = {
    0: 10, 1: 255, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 10: 1, 11: 0.010, 12: 0.002, 13: 0,
    20: 1, 21: 0, 22: 1, 23: 0, 24: 25, 25: 300, 26: 250, 27: 1, 30: 1000, 31: 0, 32: 0,
    100: 400, 101: 400, 102: 400, 110: 600, 111: 600, 112: 300, 120: 50, 121: 50, 122: 50,
    130: 60, 131: 30, 132: 40,
}  # fmt: skip
_DECIMAL = {11, 12, 24, 25, 27}
_DIVISORS = {100, 101, 102, 110, 111, 112, 120, 121, 122}
_SWITCHES = {4, 5, 6, 13, 20, 21, 22, 32}

UNKNOWN_SETTING, NEGATIVE_VALUE, SHORT_PULSE, NO_HOMING = 3, 4, 6, 10


class GrblSettings:
    """Settings in the board's EEPROM."""

    def __init__(self, changes: Mapping[int, float] | None = None) -> None:
        self._values = {**RIG_DEFAULTS, **(changes or {})}

    def __getitem__(self, number: int) -> float:
        return self._values[number]

    def flag(self, number: int) -> bool:
        return bool(self._values[number])

    def per_axis(self, number: int) -> Vec:
        """Return three consecutive settings as (x, y, z)."""
        return (self._values[number], self._values[number + 1], self._values[number + 2])

    def store(self, number: float, value: float) -> int:
        """Store a value; return GRBL's error number, 0 for ok."""
        if value < 0:
            return NEGATIVE_VALUE
        if number not in self._values:
            return UNKNOWN_SETTING
        if number == 0 and value < 3:
            return SHORT_PULSE
        if value == 0 and number in _DIVISORS:
            # The firmware accepts zero and then divides by it; a simulation cannot.
            return NEGATIVE_VALUE
        if number == SOFT_LIMITS and value and not self.flag(HOMING):
            return NO_HOMING
        self._put(int(number), value)
        return 0

    def listing(self) -> list[str]:
        """Return the answer to `$$`."""
        return [f"${number}={_shown(number, value)}" for number, value in self._values.items()]

    def limits(self) -> AxisLimits:
        x, y, z = self.per_axis(110)
        return AxisLimits(self.per_axis(100), (x / 60, y / 60, z / 60), self.per_axis(120), self[11])

    def _put(self, number: int, value: float) -> None:
        if number in _SWITCHES:
            value = float(bool(value))
        elif number not in _DECIMAL and number < 100:
            value = float(int(value))
        self._values[number] = value
        if number == HOMING and not value:
            self._values[SOFT_LIMITS] = 0.0


def _shown(number: int, value: float) -> str:
    return f"{value:.3f}" if number in _DECIMAL or number >= 100 else str(int(value))


# --- homing ---
#
# GRBL homes Z first, then X and Y together. Each cycle seeks the switch ($25), pulls off ($27), finds it again slowly
# ($24) and pulls off, with the debounce pause ($26) between. The switches are at step 0 of each axis, at the positive
# end ($23 is not simulated). Source: GRBL 1.1 configuration wiki.

CYCLES = ((2,), (0, 1))


@dataclass
class _Cycle:
    settings: GrblSettings
    position: list[float]
    t_s: float
    pieces: list[Piece]


def homing_motion(settings: GrblSettings, carriage: Counts, now_s: float) -> tuple[list[Piece], float, Counts]:
    """Return the motion from `carriage` (steps), its end time, and the carriage's final position."""
    cycle = _Cycle(settings, list(carriage), now_s, [])
    for axes in CYCLES:
        for rate in (settings[25], settings[24]):
            _approach(cycle, axes, rate)
            _pull_off(cycle, axes)
    x, y, z = (round(steps) for steps in cycle.position)
    return cycle.pieces, cycle.t_s, (x, y, z)


def _approach(cycle: _Cycle, axes: tuple[int, ...], rate: float) -> None:
    """Run every axis until its own switch, where it stops at once."""
    per_mm = cycle.settings.per_axis(100)
    speed, accel = _speed_and_accel(cycle.settings, axes, rate)
    to_switch = {axis: max(-cycle.position[axis], 0.0) / per_mm[axis] for axis in axes}
    ramp_mm = speed * speed / (2 * accel)
    marks = sorted({mm for mm in (ramp_mm, *to_switch.values()) if 0 < mm <= max(to_switch.values())})
    begin_mm = 0.0
    for end_mm in marks:
        running = [axis for axis in axes if to_switch[axis] > begin_mm]
        v0 = min(sqrt(2 * accel * begin_mm), speed)
        v1 = min(sqrt(2 * accel * end_mm), speed)
        ramp = ConstantAcceleration(2 * (end_mm - begin_mm) / (v0 + v1), v0, accel if begin_mm < ramp_mm else 0.0)
        _run(cycle, running, ramp, +1)
        begin_mm = end_mm
    _debounce(cycle)


def _pull_off(cycle: _Cycle, axes: tuple[int, ...]) -> None:
    speed, accel = _speed_and_accel(cycle.settings, axes, cycle.settings[25])
    for ramp in trapezoid(cycle.settings[27], 0.0, 0.0, speed, accel):
        _run(cycle, axes, ramp, -1)
    _debounce(cycle)


def _run(cycle: _Cycle, axes: tuple[int, ...] | list[int], ramp: ConstantAcceleration, sign: int) -> None:
    per_mm = cycle.settings.per_axis(100)
    i, j, k = (sign * per_mm[axis] if axis in axes else 0.0 for axis in range(3))
    slope: Vec = (i, j, k)
    x, y, z = cycle.position
    cycle.pieces.append(Piece(cycle.t_s, ramp, (x, y, z), slope))
    cycle.position = [now + along * ramp.mm for now, along in zip(cycle.position, slope, strict=True)]
    cycle.t_s += ramp.duration_s


def _debounce(cycle: _Cycle) -> None:
    cycle.t_s += cycle.settings[26] / 1000


def _speed_and_accel(settings: GrblSettings, axes: tuple[int, ...], rate: float) -> tuple[float, float]:
    """Return speed (mm/s) and acceleration of the axes, which share one ramp, so that the slowest limits it."""
    most = min(settings.per_axis(110)[axis] for axis in axes)
    return min(rate, most) / 60, min(settings.per_axis(120)[axis] for axis in axes)
