"""Jogs by a bounded distance from rest, for a stage whose position is not trusted.

They make the first steps of homing, the steps of manual control before homing, and the lift of a stage that strayed.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import get_args

from rig.clock import Clock
from rig.devices.base import Axis, Looks, Stage, StageError, StageHeld, StageStatus, is_held
from rig.engine.corridor import PRINTED_MM, Corridor
from rig.engine.motion import StrayedError, refuse_strayed
from rig.transport.wire import TransportError

_POLL_S = 0.02
_SLICE_S = 0.2
# A board that rests short of its target in this many statuses in a row was stopped at the controller.
_ROUNDING_MM, _STANDS = 0.003, 5
_LEAST_MM = 0.0005


@dataclass(frozen=True)
class Direction:
    """Direction along an axis."""

    axis: Axis
    sign: int


DOWN, UP = Direction("z", -1), Direction("z", +1)


def jogging(stage: Stage, clock: Clock, direction: Direction, by_mm: float, speed_mm_s: float) -> Looks:
    """Jog by a distance from rest, where a stage confirms the jog before it moves; yield every status.

    It ends at rest at the target. If this process dies or the cable is cut, the stage stops there, too. Raises
    StageError, MoveError, and StrayedError once the stage is stopped. Code that does not run it to its end calls
    Stage.end_jog() or Stage.stop().
    """
    by_mm = round(by_mm, 4)  # as in the command
    if by_mm < _LEAST_MM:
        return
    start, step_mm = _start(stage), 1 / abs(stage.steps_per_mm(direction.axis))
    corridor = _corridor(start, direction, by_mm, speed_mm_s, clock.monotonic_s(), step_mm)
    stage.jog(direction.axis, direction.sign * by_mm, speed_mm_s)
    stood = 0
    while True:
        clock.wait_s(_POLL_S)
        now = stage.status()
        if is_held(now.state):
            raise StageHeld(now.state)
        try:
            refuse_strayed(corridor, now, stage, clock)
        except StrayedError:
            stage.stop()
            raise
        ahead_mm = by_mm - _gone_mm(now, start, direction.axis)
        short = ahead_mm > step_mm + _ROUNDING_MM
        if now.state == "Idle" and not short:
            return
        stood = stood + 1 if now.state == "Idle" else 0
        if stood > _STANDS:
            raise StageError(
                f"jog: the stage stopped {ahead_mm:.3f} mm short of its target; release the hold at the controller, "
                "then jog again",
                "jog_cut_short",
            )
        yield now


def jog(stage: Stage, clock: Clock, direction: Direction, by_mm: float, speed_mm_s: float) -> StageStatus:
    """Jog by a distance from rest; return the status at rest. Raises as `jogging`, at rest."""
    try:
        for _ in jogging(stage, clock, direction, by_mm, speed_mm_s):
            pass
        return stage.status()
    except StrayedError:
        raise
    except BaseException:
        with suppress(StageError, TransportError):  # The caller reports the first error.
            _end(stage)
        raise


def lift_from_rest(stage: Stage, clock: Clock, by_mm: float, speed_mm_s: float) -> None:
    """Jog up in slices that each begin at rest, so that no corrupted command goes sideways in contact."""
    for slice_mm in slices(by_mm, speed_mm_s * _SLICE_S):
        jog(stage, clock, UP, slice_mm, speed_mm_s)


def slices(whole_mm: float, most_mm: float) -> Iterator[float]:
    """Yield parts of a distance (mm), each at most so long."""
    while whole_mm > _LEAST_MM:
        yield min(most_mm, whole_mm)
        whole_mm -= most_mm


def _start(stage: Stage) -> StageStatus:
    """Return the position at rest from two reports: a corrupted digit would put the corridor elsewhere."""
    start, again = stage.status(), stage.status()
    if is_held(again.state):
        raise StageHeld(again.state)
    if max(_gone_mm(again, start, axis) for axis in get_args(Axis)) > _ROUNDING_MM:
        raise StageError("jog: the stage reports different positions at rest; nothing was moved", "not_at_rest")
    return again


def _corridor(
    start: StageStatus, direction: Direction, by_mm: float, speed_mm_s: float, begun_s: float, step_mm: float
) -> Corridor:
    start_mm = (start.x_mm, start.y_mm, start.z_mm)
    target_mm = tuple(
        mm + direction.sign * by_mm if axis == direction.axis else mm
        for axis, mm in zip("xyz", start_mm, strict=True)
    )
    return Corridor(start_mm, target_mm, speed_mm_s, begun_s, step_mm + PRINTED_MM)


def _gone_mm(now: StageStatus, start: StageStatus, axis: Axis) -> float:
    return abs(float(getattr(now, f"{axis}_mm")) - float(getattr(start, f"{axis}_mm")))


def _end(stage: Stage) -> None:
    """End the jog; stop past every queue if the stage does not respond."""
    try:
        stage.end_jog()
    except StageError:
        stage.stop()
