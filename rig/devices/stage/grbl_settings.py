"""What the configuration says about the settings of a GRBL board. Source: GRBL 1.1 configuration wiki."""

from collections.abc import Mapping

from rig.devices.bench_settings import BenchSettings

STEP_DIRECTION, INCHES, SOFT_LIMITS, HOMING, LASER = 3, 13, 20, 22, 32
STEPS_PER_MM, TRAVEL = 100, 130

# Boards print three decimals.
_TOLERANCE = 5e-4


def expected_settings(settings: BenchSettings) -> dict[int, float]:
    """Settings by number that the board must have: limits and homing on, the travel, and what was calibrated."""
    expected: dict[int, float] = {INCHES: 0, SOFT_LIMITS: 1, HOMING: 1, LASER: 0}
    expected |= {TRAVEL + i: mm for i, mm in enumerate(settings.stage.travel_mm)}
    measured = dict(settings.calibration.measured())
    steps = [measured.get(f"{axis}_steps_per_mm") for axis in "xyz"]
    expected |= {STEPS_PER_MM + i: abs(one.value) for i, one in enumerate(steps) if one}
    if all(steps):
        expected[STEP_DIRECTION] = sum(1 << i for i, one in enumerate(steps) if one and one.value < 0)
    return expected


def differences(board: Mapping[int, float], expected: Mapping[int, float]) -> list[str]:
    """What to send to the board so that it is as the configuration says; a setting it lacks counts as 0."""
    return [
        f"${number}={value:g} (it has {board.get(number, 0.0):g})"
        for number, value in expected.items()
        if abs(board.get(number, 0.0) - value) > _TOLERANCE
    ]
