"""Jogging with a dead man's switch: the stage goes on only as long as somebody keeps saying so."""

from collections.abc import Callable
from dataclasses import dataclass

from rig.clock import Clock
from rig.stage.base import Axis, DeadManStage, Stage, StageStatus

SLICE_S = 0.1
_LOOK_S = 0.02


@dataclass(frozen=True)
class Direction:
    """Along an axis, and which way."""

    axis: Axis
    sign: int


def dead_man_jog(
    stage: Stage, clock: Clock, held: Callable[[], Direction | None], speed_mm_s: float, by_mm: float | None = None
) -> StageStatus:
    """Jog while held() keeps its first answer, by_mm at most; returns where the stage has then come to rest.

    A controller with a dead man's switch of its own is left to it, unless the way is limited. Otherwise the stage is
    told of no more than two slices of SLICE_S ahead of where it is: if this process dies, or its wire is cut, it
    stops by itself within 2 · speed_mm_s · SLICE_S. Raises StageError.
    """
    direction, start = held(), stage.status()
    if direction is None:
        return start
    if by_mm is None and isinstance(stage, DeadManStage):
        stage.jog_while(direction.axis, direction.sign, lambda: held() == direction, speed_mm_s)
        return stage.status()
    slice_mm, told_mm = speed_mm_s * SLICE_S, 0.0
    try:
        while held() == direction:
            left_mm = slice_mm if by_mm is None else by_mm - told_mm
            gone_mm = _gone_mm(stage.status(), start, direction.axis)
            if left_mm <= 0 and gone_mm >= told_mm - slice_mm:
                break
            if told_mm - gone_mm < slice_mm and left_mm > 0:
                part_mm = min(slice_mm, left_mm)
                stage.jog(direction.axis, direction.sign * part_mm, speed_mm_s)
                told_mm += part_mm
            clock.wait_s(_LOOK_S)
        else:
            stage.end_jog()
    except BaseException:
        stage.stop()
        raise
    return _at_rest(stage, clock)


def _gone_mm(now: StageStatus, start: StageStatus, axis: Axis) -> float:
    return abs(float(getattr(now, f"{axis}_mm")) - float(getattr(start, f"{axis}_mm")))


def _at_rest(stage: Stage, clock: Clock) -> StageStatus:
    while (now := stage.status()).state in ("Jog", "Run"):
        clock.wait_s(_LOOK_S)
    return now
