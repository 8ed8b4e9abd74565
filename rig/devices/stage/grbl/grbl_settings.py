"""What the configuration says about the settings of a GRBL board. Source: GRBL 1.1 configuration wiki."""

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from rig.devices.bench_settings import BenchSettings, StageBounds
from rig.devices.stage.grbl.grbl_words import Xyz, travel_s

STEP_DIRECTION, REPORTS, INCHES, SOFT_LIMITS, HOMING, LASER = 3, 10, 13, 20, 22, 32
HOMING_DIRECTION, PULL_OFF = 23, 27
STEPS_PER_MM, MOST_MM_MIN, ACCELERATION, TRAVEL = 100, 110, 120, 130
VOLATILE_OFFSET = 384  # grblHAL stores G92, which would wear its memory out, unless this is 1
_REPORTED = 1 << 5 | 1 << 6  # of $10 in grblHAL: the offset of work zero, and overrides

# Boards print three decimals.
_TOLERANCE = 5e-4
_PRINTED_MM = 1e-3
# The board reckons in 24 bits: a target that is just within its soft limits must not come out just beyond them.
_INSIDE_MM, _ROUND_OFF_MM = 2e-4, 1e-9


class Difference(NamedTuple):
    """A setting that is not as it should be, as the line that would set it; `with_which` ends the words for it."""

    number: int
    wanted: float
    found: float
    with_which: str = ""

    def __str__(self) -> str:
        return f"${self.number}={self.wanted:g} (it has {self.found:g}{self.with_which})"


class Misplaced(NamedTuple):
    """An axis that is not where it was told to be."""

    axis: str
    at_mm: float
    target_mm: float

    def __str__(self) -> str:
        return f"{self.axis} is at {self.at_mm} mm, not at {self.target_mm} mm"


def expected_settings(settings: BenchSettings) -> dict[int, float]:
    """Settings by number that the board must have: limits and homing on, the travel, and what was calibrated.

    The travel of the vertical axis is not among them: it is one of enforced_settings().
    """
    expected: dict[int, float] = {INCHES: 0, SOFT_LIMITS: 1, HOMING: 1, LASER: 0}
    expected |= {TRAVEL + i: mm for i, mm in enumerate(settings.stage.travel_mm[:2])}
    measured = dict(settings.calibration.measured())
    steps = [measured.get(f"{axis}_steps_per_mm") for axis in "xyz"]
    expected |= {STEPS_PER_MM + i: abs(one.value) for i, one in enumerate(steps) if one}
    directions = [one.value < 0 for one in steps if one]
    if len(directions) == len(steps):
        expected[STEP_DIRECTION] = sum(against << i for i, against in enumerate(directions))
    return expected


def enforced_settings(board: Mapping[int, float], bounds: StageBounds) -> dict[int, float]:
    """Return what the board is to enforce itself: the lowest height, and a rate that is never raised.

    A board that is slower than the rig would ever ask is left as it is: its motors may not be able to go faster.
    """
    most_mm_min = 60 * bounds.fastest_mm_s
    rates = {n: most_mm_min for n in range(MOST_MM_MIN, MOST_MM_MIN + 3) if board.get(n, 0.0) > most_mm_min}
    return {**rates, TRAVEL + 2: -bounds.lowest_z_mm}


def differences(board: Mapping[int, float], expected: Mapping[int, float]) -> list[Difference]:
    """What to send to the board so that it is as the configuration says; a setting it lacks counts as 0."""
    return [
        Difference(number, value, board.get(number, 0.0))
        for number, value in expected.items()
        if differs(board, number, value)
    ]


def told(wrong: Iterable[Difference]) -> dict[str, Any]:
    """Return the fields of an error about settings."""
    all_wrong = list(wrong)
    return {
        "settings": ", ".join(map(str, all_wrong)),
        "wanted": {one.number: one.wanted for one in all_wrong},
        "found": {one.number: one.found for one in all_wrong},
    }


def unsuited(printed: Iterable[str], board: Mapping[int, float]) -> list[Difference]:
    """What to send to the board so that its moves can be confirmed; GRBL 1.1 always reports what is needed."""
    found, homes_down = list[Difference](), int(board.get(HOMING_DIRECTION, 0.0))
    if homes_down & 4:
        up = homes_down & ~4
        found.append(Difference(HOMING_DIRECTION, up, homes_down, ", with which Z homes downwards"))
    if "[FIRMWARE:grblHAL]" not in printed:
        return found
    mask = int(board.get(REPORTS, _REPORTED))
    if mask & _REPORTED != _REPORTED:
        found.append(Difference(REPORTS, mask | _REPORTED, mask, ", which hides its work zero or its overrides"))
    if board.get(VOLATILE_OFFSET, 1.0) != 1:
        found.append(Difference(VOLATILE_OFFSET, 1, 0, ", which stores each target in a memory that wears out"))
    return found


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


def near(board: Mapping[int, float], axis: int, printed_mm: float, meant_mm: float) -> bool:
    """Whether a position that the board prints is the one that was meant: to half a step and the last digit."""
    steps_per_mm = board.get(STEPS_PER_MM + axis)
    tolerance_mm = 0.5 / steps_per_mm + _PRINTED_MM if steps_per_mm else 0.5 * _PRINTED_MM
    return abs(printed_mm - meant_mm) <= tolerance_mm


def misplaced(board: Mapping[int, float], target: Mapping[str, float], at: Xyz) -> Misplaced | None:
    """Which axis is not where it was told to be; None where all are."""
    for i, (axis, is_mm) in enumerate(zip("XYZ", at, strict=True)):
        if axis in target and not near(board, i, is_mm, target[axis]):
            return Misplaced(axis, is_mm, target[axis])
    return None


def on_a_step(board: Mapping[int, float], axis: int, mm: float) -> float:
    """The position of the step nearest to mm, as the board rounds; within the soft limits by less than half a step.

    What the board prints has three decimals, and where its parser stands is on a step: so it is known exactly.
    """
    steps_per_mm = board.get(STEPS_PER_MM + axis)
    if steps_per_mm:
        mm = math.copysign(math.floor(abs(mm) * steps_per_mm + 0.5), mm) / steps_per_mm
    lowest_mm = -board.get(TRAVEL + axis, math.inf)
    if -_INSIDE_MM < mm <= _ROUND_OFF_MM:
        return -_INSIDE_MM
    return lowest_mm + _INSIDE_MM if lowest_mm - _ROUND_OFF_MM <= mm < lowest_mm + _INSIDE_MM else mm


def at_home(board: Mapping[int, float]) -> dict[str, float]:
    """Where homing ends, mm, by axis; nothing where the board does not tell its pull-off."""
    if PULL_OFF not in board:
        return {}
    negative, off_mm = int(board.get(HOMING_DIRECTION, 0.0)), board[PULL_OFF]
    ends = (off_mm - board.get(TRAVEL + i, 0.0) if negative >> i & 1 else -off_mm for i in range(3))
    return dict(zip("XYZ", ends, strict=True))


def keys_of(board: Mapping[int, float], expected: Mapping[int, float]) -> str:
    """Which key of the configuration a difference may be about, in brackets; nothing for what is always expected."""
    travel = [number for number in (TRAVEL, TRAVEL + 1) if number in expected]
    return " (stage.travel_mm)" if any(differs(board, number, expected[number]) for number in travel) else ""


def differs(board: Mapping[int, float], number: int, value: float) -> bool:
    """Whether a setting is another than a value, as far as boards print it; one that the board lacks counts as 0."""
    return abs(board.get(number, 0.0) - value) > _TOLERANCE
