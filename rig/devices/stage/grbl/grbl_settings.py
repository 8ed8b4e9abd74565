"""What the configuration says about the settings of a GRBL board. Source: GRBL 1.1 configuration wiki."""

import math
from collections.abc import Iterable, Mapping

from rig.devices.bench_settings import BenchSettings
from rig.devices.stage.grbl.grbl_words import Xyz, travel_s

STEP_DIRECTION, REPORTS, INCHES, SOFT_LIMITS, HOMING, LASER = 3, 10, 13, 20, 22, 32
OVERRIDES_REPORTED = 1 << 6
STEPS_PER_MM, MOST_MM_MIN, ACCELERATION, TRAVEL = 100, 110, 120, 130

# Boards print three decimals.
_TOLERANCE = 5e-4
# How far from the target an arrival may be: the board rounds to a step and prints 0.001 mm.
_TOLERANCE_STEPS = 1.0


def expected_settings(settings: BenchSettings) -> dict[int, float]:
    """Settings by number that the board must have: limits and homing on, the travel, and what was calibrated."""
    expected: dict[int, float] = {INCHES: 0, SOFT_LIMITS: 1, HOMING: 1, LASER: 0}
    expected |= {TRAVEL + i: mm for i, mm in enumerate(settings.stage.travel_mm)}
    measured = dict(settings.calibration.measured())
    steps = [measured.get(f"{axis}_steps_per_mm") for axis in "xyz"]
    expected |= {STEPS_PER_MM + i: abs(one.value) for i, one in enumerate(steps) if one}
    directions = [one.value < 0 for one in steps if one]
    if len(directions) == len(steps):
        expected[STEP_DIRECTION] = sum(against << i for i, against in enumerate(directions))
    return expected


def differences(board: Mapping[int, float], expected: Mapping[int, float]) -> list[str]:
    """What to send to the board so that it is as the configuration says; a setting it lacks counts as 0."""
    return [
        f"${number}={value:g} (it has {board.get(number, 0.0):g})"
        for number, value in expected.items()
        if _differs(board, number, value)
    ]


def unreported(printed: Iterable[str], board: Mapping[int, float]) -> list[str]:
    """What to send to a grblHAL board that would not report its overrides ($10, bit 6); GRBL 1.1 always does."""
    mask = int(board.get(REPORTS, OVERRIDES_REPORTED))
    blind = "[FIRMWARE:grblHAL]" in printed and not mask & OVERRIDES_REPORTED
    return [f"${REPORTS}={mask | OVERRIDES_REPORTED} (it has {mask}, which hides its overrides)"] if blind else []


def expected_s_of(
    board: Mapping[int, float], was: Xyz | None, target: Mapping[str, float], speed_mm_s: float
) -> float:
    """How long a move from where it was takes a board of these settings; 0 where either is not known."""
    if was is None:
        return 0.0
    moves = {i: abs(target[axis] - was[i]) for i, axis in enumerate("XYZ") if target.get(axis, was[i]) != was[i]}
    length, accel = math.hypot(*moves.values()), math.inf
    for i, mm in moves.items():
        most, steepest = (board.get(first + i, math.inf) for first in (MOST_MM_MIN, ACCELERATION))
        speed_mm_s = min(speed_mm_s, most / 60 * length / mm)
        accel = min(accel, steepest * length / mm)
    return travel_s(length, speed_mm_s, accel)


def overrun(target: dict[str, float], was: Xyz | None, backlash_mm: Xyz) -> dict[str, float]:
    """The target, overrun by twice the backlash on the axes that would get there in their positive direction."""
    if was is None:
        return target
    slack = {
        axis: 2 * backlash
        for axis, backlash, from_mm in zip("XYZ", backlash_mm, was, strict=True)
        if target.get(axis, from_mm) > from_mm
    }
    return {axis: min(mm + slack[axis], 0.0) if slack.get(axis) else mm for axis, mm in target.items()}


def misplaced(board: Mapping[int, float], target: Mapping[str, float], at: Xyz) -> str:
    """Which axis is not where it was told to be, in words; nothing where all are."""
    for i, (axis, is_mm) in enumerate(zip("XYZ", at, strict=True)):
        steps_per_mm = board.get(STEPS_PER_MM + i, math.inf)
        if axis in target and abs(is_mm - target[axis]) * steps_per_mm > _TOLERANCE_STEPS:
            return f"{axis} is at {is_mm} mm, not at {target[axis]} mm"
    return ""


def keys_of(board: Mapping[int, float], expected: Mapping[int, float]) -> str:
    """Which key of the configuration a difference may be about, in brackets; nothing for what is always expected."""
    travel = [number for number in (TRAVEL, TRAVEL + 1, TRAVEL + 2) if number in expected]
    return " (stage.travel_mm)" if any(_differs(board, number, expected[number]) for number in travel) else ""


def _differs(board: Mapping[int, float], number: int, value: float) -> bool:
    return abs(board.get(number, 0.0) - value) > _TOLERANCE
