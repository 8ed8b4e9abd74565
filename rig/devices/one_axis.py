"""Moves of a stage whose axes cannot keep a straight line together: one axis at a time, y set by hand."""

import math

from rig.devices.base import MoveError
from rig.settings import SLOWEST_MM_S

_SAME_PLACE_MM = 1e-6


def one_axis(
    x_mm: float | None, y_mm: float | None, z_mm: float | None, speed_mm_s: float, set_y_mm: float
) -> tuple[str | None, float]:
    """Return the axis that moves and its target (machine mm); no axis for a move to the y that is set by hand.

    Raises MoveError for two axes at once, another y, a speed below the slowest, and numbers that are not finite.
    """
    for name, value in (("x_mm", x_mm), ("y_mm", y_mm), ("z_mm", z_mm), ("speed_mm_s", speed_mm_s)):
        if value is not None:
            refuse_not_finite(name, value)
    if speed_mm_s < SLOWEST_MM_S:
        raise MoveError(
            "speed_mm_s must be at least {least_mm_s:.4f}, got {speed_mm_s}",
            code="too_slow",
            least_mm_s=SLOWEST_MM_S,
            speed_mm_s=speed_mm_s,
        )
    if y_mm is not None and abs(y_mm - set_y_mm) > _SAME_PLACE_MM:
        raise MoveError(
            "y_mm must be {set_mm:g}, the position set by hand, got {y_mm:g}",
            code="set_by_hand",
            set_mm=set_y_mm,
            y_mm=y_mm,
        )
    moves = {axis: mm for axis, mm in (("x", x_mm), ("z", z_mm)) if mm is not None}
    if len(moves) > 1 or not (moves or y_mm is not None):
        raise MoveError(
            "a move needs exactly one of x_mm and z_mm: two drives cannot keep a straight line",
            code="not_one_axis",
        )
    return next(iter(moves.items()), (None, set_y_mm))


def refuse_not_finite(name: str, value: float) -> None:
    """Raise MoveError for a number that is not finite."""
    if not math.isfinite(value):
        raise MoveError("{name} must be a finite number, got {value}", code="not_finite", name=name, value=value)
