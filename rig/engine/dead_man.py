"""Jog with a dead man's switch: the stage moves only while the request is repeated."""

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rig.clock import Clock
from rig.devices.base import Axis, DeadManStage, Stage, StageError, StageHeld, StageStatus, is_held
from rig.engine.corridor import PRINTED_MM, Corridor
from rig.engine.motion import StrayedError, refuse_strayed
from rig.transport.wire import TransportError

# A stage that covers less than this share of the distance, or accepts a line this much later, may have stopped.
_SLOWER, _LATER, _LATER_S = 0.9, 2.0, 0.005
_PRINTED_MM = 0.001
_POLLS = 3


class StagePace:
    """Progress of a jog, to detect a stop at the controller.

    A GRBL board cancels a jog on a feed hold without reporting it. It accepts a line that arrives while it slows down
    only at rest, and then continues: both the line and the stage are late. Either delay alone may come from a busy
    computer. A doubtful stage gets no further line until it is at rest, where its position shows what is missing.
    """

    def __init__(self, step_mm: float) -> None:
        self._rounding_mm = step_mm + _PRINTED_MM
        self._quickest_s = math.inf
        self._begin()

    def _begin(self) -> None:
        self._polls: list[tuple[float, float, float]] = []  # times of request and reply (s), distance (mm)
        self._fastest_mm_s = 0.0
        self._late = False
        self.doubtful = self.stood = False

    def accepted(self, took_s: float) -> None:
        """Record how long the board took to accept a line (s)."""
        self._late = took_s > _LATER * self._quickest_s + _LATER_S
        self._quickest_s = min(took_s, self._quickest_s)

    def seen(self, requested_s: float, received_s: float, gone_mm: float, *, at_rest: bool) -> None:
        """Record a status: times of request and reply (s), and the distance covered (mm)."""
        if at_rest:
            self._begin()
        self._polls = [*self._polls[1 - _POLLS :], (requested_s, received_s, gone_mm)]
        before_requested_s, before_received_s, before_mm = self._polls[0]
        since_mm, at_least_s = gone_mm - before_mm, requested_s - before_received_s
        slower = since_mm + self._rounding_mm < _SLOWER * self._fastest_mm_s * at_least_s
        if at_least_s > 0:
            surely_mm_s = (since_mm - self._rounding_mm) / (received_s - before_requested_s)
            self._fastest_mm_s = max(self._fastest_mm_s, surely_mm_s)
        self.doubtful = self.doubtful or slower or self._late
        self.stood = slower and self._late
        self._late = False


SLICE_S = 0.1
_POLL_S = 0.02
# A board that rests short of its target in this many statuses in a row was stopped at the controller.
_ROUNDING_MM, _STANDS = 0.003, 5


@dataclass(frozen=True)
class Direction:
    """Direction along an axis."""

    axis: Axis
    sign: int


DOWN, UP = Direction("z", -1), Direction("z", +1)


def dead_man_jog(
    stage: Stage,
    clock: Clock,
    held: Callable[[], Direction | None],
    speed_mm_s: float,
    by_mm: float | None = None,
    look: Callable[[StageStatus], None] | None = None,
    *,
    slice_s: float = SLICE_S,
) -> StageStatus:
    """Jog while held() returns its first direction, by at most by_mm; return the status at rest.

    At most two slices of slice_s are queued ahead of the stage. If this process dies or the cable is cut, the stage
    therefore stops within 2 · speed_mm_s · slice_s. Every status is passed to `look`; an exception from it ends the
    jog at rest and is raised again. Without `look` and by_mm, a controller with its own dead man's switch does the
    work. Raises StageError.
    """
    start, direction = stage.status(), held()
    if direction is None:
        return start
    try:
        if by_mm is None and look is None and isinstance(stage, DeadManStage):
            stage.jog_while(direction.axis, direction.sign, lambda: held() == direction, speed_mm_s)
            return stage.status()
        for now in _jogging(stage, clock, direction, held, speed_mm_s, by_mm, slice_s):
            if look is not None:
                look(now)
        return stage.status()
    except StrayedError:
        stage.stop()
        raise
    except BaseException:
        _end(stage)
        raise


def jog_up_from_rest(
    stage: Stage,
    clock: Clock,
    held: Callable[[], Direction | None],
    speed_mm_s: float,
    by_mm: float,
    look: Callable[[StageStatus], None] | None = None,
) -> Iterator[tuple[StageStatus, float]]:
    """Jog up in slices that each begin at rest; yield the status after each, and the remaining distance (mm).

    A stage confirms a slice from rest before it moves, so that no corrupted command can move sideways while the
    indentor may touch the finger. Each slice lasts 2 · SLICE_S, because none is queued ahead. Raises StageError.
    """
    slice_s = 2 * SLICE_S
    while held() == UP and by_mm > _PRINTED_MM / 2:
        slice_mm = min(speed_mm_s * slice_s, by_mm)
        at = dead_man_jog(stage, clock, held, speed_mm_s, slice_mm, look, slice_s=slice_s)
        by_mm -= slice_mm
        yield at, by_mm


def _jogging(
    stage: Stage,
    clock: Clock,
    direction: Direction,
    held: Callable[[], Direction | None],
    speed_mm_s: float,
    by_mm: float | None,
    slice_s: float,
) -> Iterator[StageStatus]:
    """Yield every status during the jog; the stage is at rest at the end."""
    start: StageStatus | None = None
    step_mm = 1 / abs(stage.steps_per_mm(direction.axis))
    slice_mm, commanded_mm, stood = max(round(speed_mm_s * slice_s / step_mm), 1) * step_mm, 0.0, 0
    pace, begun_s = StagePace(step_mm), clock.monotonic_s()
    while held() == direction:
        requested_s, now, received_s = clock.monotonic_s(), stage.status(), clock.monotonic_s()
        if is_held(now.state):
            raise StageHeld(now.state)
        start = start or now
        refuse_strayed(_corridor(start, direction, commanded_mm, speed_mm_s, begun_s, step_mm), now, stage, clock)
        gone_mm = _gone_mm(now, start, direction.axis)
        ahead_mm = commanded_mm - gone_mm
        pace.seen(requested_s, received_s, gone_mm, at_rest=now.state == "Idle")
        if pace.stood and by_mm is None:
            raise StageError(
                "jog: the stage stopped although the key was held; release the hold at the controller, then "
                "jog again",
                "jog_stood_still",
            )
        stood = stood + 1 if now.state == "Idle" and ahead_mm > step_mm + _ROUNDING_MM else 0
        if stood > _STANDS:
            raise StageError(
                f"jog: the stage stopped {ahead_mm:.3f} mm short of its target; release the hold at the "
                "controller, then jog again",
                "jog_cut_short",
            )
        # rounded like the commands, so that their sum is exact
        left_mm = round(slice_mm if by_mm is None else min(slice_mm, by_mm - commanded_mm), 4)
        if left_mm <= 0 and now.state == "Idle" and not stood:
            return
        if left_mm > 0 and ahead_mm < slice_mm and not (stood or pace.doubtful):
            sent_s = clock.monotonic_s()
            stage.jog(direction.axis, direction.sign * left_mm, speed_mm_s)
            pace.accepted(clock.monotonic_s() - sent_s)
            commanded_mm += left_mm
        yield now
        clock.wait_s(_POLL_S)
    stage.end_jog()


def _corridor(
    start: StageStatus, direction: Direction, commanded_mm: float, speed_mm_s: float, begun_s: float, step_mm: float
) -> Corridor:
    """Return the corridor of the distance commanded so far."""
    start_mm = (start.x_mm, start.y_mm, start.z_mm)
    target_mm = tuple(
        mm + direction.sign * commanded_mm if axis == direction.axis else mm
        for axis, mm in zip("xyz", start_mm, strict=True)
    )
    return Corridor(start_mm, target_mm, speed_mm_s, begun_s, step_mm + PRINTED_MM)


def _gone_mm(now: StageStatus, start: StageStatus, axis: Axis) -> float:
    return abs(float(getattr(now, f"{axis}_mm")) - float(getattr(start, f"{axis}_mm")))


def _end(stage: Stage) -> None:
    """End the jog; stop past every queue if the stage does not respond."""
    with contextlib.suppress(StageError, TransportError):  # the caller reports the first error
        try:
            stage.end_jog()
        except StageError:
            stage.stop()
