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
    force of the stage's own motion. lasts_s: duration of the motion at its speed, which the heartbeat waits for; None
    where the heartbeat is renewed by the checks alone.
    """

    away: bool = False
    touch_ends_it: bool = False
    late_s: float = math.inf
    on_reading: OnReading | None = None
    shakes_gwt: float = 0.0
    lasts_s: float | None = None


class WatchedMotion:
    """Motion under way; calling it makes its checks once."""

    def __init__(self, engine: "Engine", watch: Watch, begun: MotionForce) -> None:
        self._engine, self._watch, self._begun = engine, watch, begun
        self._read_s = engine.clock.monotonic_s()

    def __call__(self) -> None:
        """Make the checks in order. Raises InterruptedMotionError, which brings the stage to rest."""
        engine, watch, sensing = self._engine, self._watch, self._engine.sensing
        engine.beat()

        # A stop input ends every motion, and so does a computer that was suspended in contact.
        if problem := engine.stop_asked(at_rest=False):
            raise InterruptedMotionError(str(problem), problem.code)

        # A missing reading ends a motion, unless it leaves the finger, where nothing may hold the indentor.
        try:
            reading = sensing.read_in_motion(self._begun)
        except NoReadingError as error:
            if self._begun.away:
                return
            raise InterruptedMotionError(str(error), error.code) from error
        if reading is None:
            engine.note_force(None)
            return
        force_gwt = reading.force_n / GWT_N
        engine.note_force(force_gwt)

        # A motion away from the finger goes on while the force does not grow, however large it is.
        if sensing.unloads(self._begun, force_gwt):
            return

        # Every force limit holds in every motion.
        if passed := engine.trips.passed_any(force_gwt):
            raise InterruptedMotionError(f"{passed} while moving", passed.code, force_gwt)

        # A touch ends a motion that should meet no finger.
        if watch.touch_ends_it and abs(force_gwt) >= sensing.touch_gwt:
            raise EndedMotionError(Outcome.TOUCHED, force_gwt)

        # A late reading ends a motion that may go only so far without one.
        before_s, self._read_s = self._read_s, engine.clock.monotonic_s()
        if self._read_s - before_s > watch.late_s:
            raise EndedMotionError(Outcome.LATE, force_gwt)

        # The receiver of the readings may end the motion; where there is one, so may a pause, and the end of the
        # contact time.
        if watch.on_reading is not None:
            watch.on_reading(reading)
            if engine.contact_time.over or engine.bench.operator.pause.asked():
                raise EndedMotionError(Outcome.PAUSED, force_gwt)
