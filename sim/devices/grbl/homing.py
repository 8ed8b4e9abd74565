"""GRBL's homing cycle as motion: Z first, then X and Y together.

Each: seek the switch ($25), pull off ($27), find it again slowly ($24), pull off, with the debounce
pause ($26) between. The switches sit at step 0 of each axis, at the positive end ($23 is not simulated).
Source: GRBL 1.1 configuration wiki.
"""

from dataclasses import dataclass
from math import sqrt

from sim.devices.grbl.motion import Counts, Piece, Ramp, Vec, trapezoid
from sim.devices.grbl.settings import GrblSettings

CYCLES = ((2,), (0, 1))


@dataclass
class _Cycle:
    settings: GrblSettings
    position: list[float]
    t_s: float
    pieces: list[Piece]


def homing_motion(settings: GrblSettings, carriage: Counts, now_s: float) -> tuple[list[Piece], float, Counts]:
    """Return the motion from `carriage` (steps), when the cycle is over, and where the carriage then is."""
    cycle = _Cycle(settings, list(carriage), now_s, [])
    for axes in CYCLES:
        for rate in (settings[25], settings[24]):
            _approach(cycle, axes, rate)
            _pull_off(cycle, axes)
    x, y, z = (round(steps) for steps in cycle.position)
    return cycle.pieces, cycle.t_s, (x, y, z)


def _approach(cycle: _Cycle, axes: tuple[int, ...], rate: float) -> None:
    """Every axis runs until its own switch and stops there dead."""
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
        ramp = Ramp(2 * (end_mm - begin_mm) / (v0 + v1), v0, accel if begin_mm < ramp_mm else 0.0)
        _run(cycle, running, ramp, +1)
        begin_mm = end_mm
    _debounce(cycle)


def _pull_off(cycle: _Cycle, axes: tuple[int, ...]) -> None:
    speed, accel = _speed_and_accel(cycle.settings, axes, cycle.settings[25])
    for ramp in trapezoid(cycle.settings[27], 0.0, 0.0, speed, accel):
        _run(cycle, axes, ramp, -1)
    _debounce(cycle)


def _run(cycle: _Cycle, axes: tuple[int, ...] | list[int], ramp: Ramp, sign: int) -> None:
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
    """Speed (mm/s) and acceleration of each axis; they share one ramp, so the slowest sets it."""
    most = min(settings.per_axis(110)[axis] for axis in axes)
    return min(rate, most) / 60, min(settings.per_axis(120)[axis] for axis in axes)
