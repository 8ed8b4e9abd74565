"""Checks of one motion, made at each status of the stage.

Their order is the safety rule: what is wrong with the rig comes before what the finger does, and both before what the
motion is for.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rig.devices.base import ForceReading
from rig.engine.motion import EndedMotionError, InterruptedMotionError, Outcome
from rig.engine.sensing import MotionForce, NoReadingError
from rig.units import GWT_N

if TYPE_CHECKING:
    from rig.engine.engine import Engine

OnReading = Callable[[ForceReading], None]
"""Called with each reading of a motion that is below its trips; it may raise InterruptedMotionError."""


@dataclass(frozen=True)
class Watch:
    """What ends one motion besides a trip, a stop and a missing reading.

    away: the motion begins by leaving the finger, so that a falling force never ends it. late_s: longest time between
    two readings. on_reading: ends the motion by InterruptedMotionError; a pause then ends it as well. shakes_gwt:
    force of the stage's own motion.
    """

    away: bool = False
    touch_ends_it: bool = False
    late_s: float = math.inf
    on_reading: OnReading | None = None
    shakes_gwt: float = 0.0


class WatchedMotion:
    """Motion under way; calling it makes its checks once."""

    def __init__(self, engine: "Engine", watch: Watch, begun: MotionForce) -> None:
        self._engine, self._watch, self._begun = engine, watch, begun
        self._read_s = engine.clock.monotonic_s()

    def __call__(self) -> None:
        """Make the checks in order. Raises InterruptedMotionError, which brings the stage to rest."""
        self._engine.beat()
        self._end_by_stop()
        reading = self._read()
        if reading is None or self._engine.sensing.unloads(self._begun, reading.force_n / GWT_N):
            return
        for check in (
            self._end_above_trip,
            self._end_at_touch,
            self._end_if_late,
            self._end_by_reader,
            self._end_for_pause,
        ):
            check(reading)

    def _end_by_stop(self) -> None:
        """A stop input ends every motion, and so does a computer that was suspended in contact."""
        if problem := self._engine.stop_asked(at_rest=False):
            raise InterruptedMotionError(str(problem), problem.code)

    def _read(self) -> ForceReading | None:
        """A missing reading ends a motion, unless it leaves the finger, where nothing may hold the indentor."""
        try:
            reading = self._engine.sensing.read_in_motion(self._begun)
        except NoReadingError as error:
            if self._begun.away:
                return None
            raise InterruptedMotionError(str(error), error.code) from error
        self._engine.note_force(None if reading is None else reading.force_n / GWT_N)
        return reading

    def _end_above_trip(self, reading: ForceReading) -> None:
        """Every force limit holds in every motion."""
        force_gwt = reading.force_n / GWT_N
        if passed := self._engine.trips.passed_any(force_gwt):
            raise InterruptedMotionError(f"{passed} while moving", passed.code, force_gwt)

    def _end_at_touch(self, reading: ForceReading) -> None:
        """A touch ends a motion that should meet no finger."""
        force_gwt = reading.force_n / GWT_N
        if self._watch.touch_ends_it and abs(force_gwt) >= self._engine.sensing.touch_gwt:
            raise EndedMotionError(Outcome.TOUCHED, force_gwt)

    def _end_if_late(self, reading: ForceReading) -> None:
        """A late reading ends a motion that may go only so far without one."""
        before_s, self._read_s = self._read_s, self._engine.clock.monotonic_s()
        if self._read_s - before_s > self._watch.late_s:
            raise EndedMotionError(Outcome.LATE, reading.force_n / GWT_N)

    def _end_by_reader(self, reading: ForceReading) -> None:
        """Who receives the readings may end the motion."""
        if self._watch.on_reading is not None:
            self._watch.on_reading(reading)

    def _end_for_pause(self, reading: ForceReading) -> None:
        """A pause, or the end of the contact time, ends a motion in contact whose readings are received."""
        engine = self._engine
        if self._watch.on_reading is not None and (engine.contact_time.over or engine.bench.operator.pause.asked()):
            raise EndedMotionError(Outcome.PAUSED, reading.force_n / GWT_N)
