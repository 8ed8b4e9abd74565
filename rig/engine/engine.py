"""The engine: states, watched moves, readings that trip, lifts and stops. Every verb of a protocol ends here."""

import contextlib
import math
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any, NoReturn, Protocol, TypeVar

from rig.devices.force.base import ForceReading
from rig.devices.stage.base import StageError
from rig.devices.units import GWT_N
from rig.engine.bench import Bench
from rig.engine.errors import NotReadyError, RecordError, TripError
from rig.engine.heartbeat import Heartbeat
from rig.engine.journal import Recorder
from rig.engine.limits import AT_MM, ContactTime, Trips, longer_than_an_increment, refuse_height, trip_height_mm
from rig.engine.motion import FeltError, Motion, TouchError, insist
from rig.engine.records import NO_PRESS, Phase, PressId, as_fine
from rig.engine.rig_settings import RigSettings
from rig.engine.sensing import NoReadingError, Sensing
from rig.engine.touched import Touched
from rig.transport.base import TransportError

_T = TypeVar("_T")

_LATE_FACTOR = 2.0  # a move may take so many times its length over its speed before the heartbeat is missed


class StopProblem(Protocol):
    """Looks at stop inputs with each reading; returns what trips. It may stop the stage itself, and raise."""

    def __call__(self, *, at_rest: bool) -> str | None: ...


def _no_stop_inputs(*, at_rest: bool) -> str | None:
    return None


class State(Enum):
    """What the engine may do next."""

    UNHOMED = "unhomed"
    READY = "ready"
    IN_CONTACT = "in contact"  # anywhere below clearance
    TRIPPED = "tripped"


class Engine:
    """One bench over one finger; positions are x, along and height above the pad's nominal apex, in mm.

    Its parts: motion (where the indentor is), sensing (what is felt), trips (what must not be felt), contact (for how
    long the finger was touched), heartbeat. What a script may ask of it is in rig/engine/verbs.py, what an
    indentation is made of in rig/engine/pressing.
    """

    def __init__(
        self,
        settings: RigSettings,
        bench: Bench,
        journal: Recorder,
        soft_trip_n: float | None = None,
        contact_s: float = 0.0,
    ) -> None:
        """contact_s: how long the finger was touched in the parts of the run before this one."""
        self.settings, self.bench, self.clock = settings, bench, bench.clock
        self.state = State.UNHOMED
        self.problem: Exception | None = None  # the first trip or failure; a run does not end well after it
        self.indentor: str | None = None
        self.placed = False  # over a position that was asked for
        self.trips = Trips(settings.limits, soft_trip_n)
        self.sensing = Sensing(settings, bench.clock, bench.force)
        self.motion = Motion(settings, bench.stage, self._glance)
        self.touched = Touched(settings)
        self.contact = ContactTime(bench.clock, settings.limits, contact_s)
        self.heartbeat = Heartbeat(bench.clock)
        self.heartbeat.stop = self._stop_stage
        self._journal = journal
        self.may_touch = self._touch_ends_it = False  # below clearance since the last lift or homing; this motion
        self._next_index = 0
        self.stop_problem: StopProblem = _no_stop_inputs

    # where it is

    @property
    def x_mm(self) -> float:
        """Lateral position from the centre of the pad."""
        return self.motion.x_mm

    @property
    def along_mm(self) -> float:
        """Position along the finger from the receptor plane."""
        return self.motion.along_mm

    @property
    def height_mm(self) -> float:
        """Of the indentor above the pad's nominal apex."""
        return self.motion.height_mm

    def require_clear(self, verb: str) -> None:
        """Raises NotReadyError unless at clearance, homed and not tripped."""
        if self.state is not State.READY:
            raise NotReadyError(f"{verb}: not allowed while {self.state.value}")

    def next_index(self) -> int:
        """The number of the indentation that begins now; never given twice in a run."""
        self._next_index += 1
        return self._next_index - 1

    # moving

    def go_to_height(self, height_mm: float, speed_mm_s: float) -> None:
        """One vertical move; below clearance one increment down, or as far as touched knows: a touch ends that."""
        clearance_mm, from_mm = self.settings.habits.clearance_mm, self.height_mm
        free_mm = self.touched.free_mm(self.x_mm, self.along_mm, speed_mm_s)
        refuse_height(self.settings, from_mm, height_mm, speed_mm_s, free_mm)
        if height_mm < clearance_mm - AT_MM:
            self.state, self.may_touch = State.IN_CONTACT, True
        self.beat(_LATE_FACTOR * abs(height_mm - from_mm) / speed_mm_s)
        long = longer_than_an_increment(self.settings, from_mm, height_mm, clearance_mm)
        self.move(lambda: self.motion.to_height(height_mm, speed_mm_s), touch_ends_it=long)

    def move(self, motion: Callable[[], None], *, away: bool = False, touch_ends_it: bool = False) -> None:
        """Carry a motion out, feeling on the way: a force or a reading that must not be trips, at rest again.

        away: it leaves the finger before anything else.
        """
        self._touch_ends_it = touch_ends_it
        try:
            if self.state is not State.TRIPPED:
                self.sensing.begin_motion(away=away)
            self.guarded(motion)
        except NoReadingError as error:
            self.trip(str(error))
        except TouchError:
            pass  # the reading at rest says more
        except FeltError as felt:
            if self.state is State.TRIPPED:
                raise  # on the way up from the trip, which goes on
            if felt.force_gwt is not None:
                self._record_sample(NO_PRESS, "moving", felt.force_gwt)
            self.trip(str(felt), felt.force_gwt)

    def _glance(self) -> None:
        """One look at the force while something moves; on the way up from a trip there is nothing to wait for."""
        if self.state is State.TRIPPED:
            return
        self.beat()
        if problem := self.stop_problem(at_rest=False):
            raise FeltError(problem)
        try:
            force_gwt = self.sensing.glance_gwt()
        except NoReadingError as error:
            raise FeltError(str(error)) from error
        if force_gwt is None:
            return
        if passed := self.trips.passed_any(force_gwt):
            raise FeltError(f"{passed} while moving", force_gwt)
        if self._touch_ends_it and abs(force_gwt) >= self.sensing.touch_gwt:
            raise TouchError("a touch", force_gwt)

    def lift(self, to_mm: float | None = None) -> None:
        """Straight up to a height, clearance by default, where the indentor is lower."""
        height_mm = self.settings.habits.clearance_mm if to_mm is None else to_mm
        if self.height_mm < height_mm - AT_MM:
            self.go_to_height(height_mm, self.settings.habits.travel_speed_mm_s)

    def lifted(self) -> None:
        """Nothing is touched any more."""
        self.state, self.may_touch = State.READY, False
        self.trips.press_on(math.inf)
        self.heartbeat.rest()
        self.contact.end()

    # feeling

    @property
    def trip_gwt(self) -> float:
        """The force that trips a press now."""
        return self.trips.lowest_gwt

    def read_force_gwt(self, press: PressId, phase: Phase, contact_height_mm: float | None = None) -> float:
        """A reading taken after the last move ended, journalled. No reading, or one above the soft trip, trips.

        Raises LimitError where the finger has been touched for longer than limits.max_contact_s.
        """
        reading = self.reading()
        # Far finer than any sensor: a reading of just the threshold must not hang on how it was multiplied.
        force = round(reading.force_n / GWT_N, 6)
        doi = None if contact_height_mm is None else self.doi_mm(contact_height_mm, force)
        if self.state is State.IN_CONTACT and force >= self.sensing.touch_gwt:
            self.contact.begin()
        self._record_sample(press, phase, force, doi, stable=reading.stable)
        if passed := self.trips.passed(force):
            self.trip(passed, force)
        self.contact.refuse_more()
        return force

    def _record_sample(
        self, press: PressId, phase: Phase, force_gwt: float, doi_mm: float | None = None, *, stable: bool = False
    ) -> None:
        about = {
            "index": press.index,
            "phase": phase,
            "x_mm": None if math.isnan(self.x_mm) else self.x_mm,
            "height_mm": None if math.isnan(self.height_mm) else round(self.height_mm, 6),
            "doi_mm": None if doi_mm is None else round(doi_mm, 6),
            "force_gwt": force_gwt,
            "stable": stable,
            "contact_s": self.contact.rounded_s,
        }
        self.record(press.stream("sample"), about)

    def reading(self) -> ForceReading:
        """A new reading, made when all motion was over. One that is none, or above the hard trip, trips."""
        return self._told(self.sensing.settled)

    def raw_reading(self) -> ForceReading:
        """The same, not counted from any zero."""
        return self._told(self.sensing.raw)

    def _told(self, read: Callable[[], ForceReading]) -> ForceReading:
        self.beat(self.sensing.wait_s)
        if problem := self.stop_problem(at_rest=True):
            self.trip(problem)
        try:
            reading = read()
        except NoReadingError as error:
            self.trip(str(error))
        force_gwt = reading.force_n / GWT_N
        if passed := self.trips.passed_hard(force_gwt):
            self.trip(passed, force_gwt)
        if problem := self.stop_problem(at_rest=True):
            self.trip(problem)
        return reading

    def doi_mm(self, contact_height_mm: float, force_gwt: float) -> float:
        """Depth past contact: how far the stage has gone, less what the rig itself gives under the force."""
        return contact_height_mm - self.height_mm - self.sensing.given_mm(force_gwt)

    # what ends it

    def alarm(self, reason: str) -> None:
        """Something has left its band: journalled, and a trip where limits.on_alarm says so."""
        self.record("alarm", {"reason": reason})
        if self.settings.limits.on_alarm == "trip":
            self.trip(reason)

    def trip(self, reason: str, force_gwt: float | None = None) -> NoReturn:
        """Latch, do what limits.on_trip says, journal, raise TripError.

        The stage is at rest and its position trusted, so that it can be lifted. Where it was stopped, or a lift
        fails, it is held where it is.
        """
        self.state, self.problem = State.TRIPPED, TripError(reason)
        try:
            if self.settings.limits.on_trip == "stop":
                self.stop()
            elif not self.heartbeat.lost:
                to_mm = trip_height_mm(self.settings, self.height_mm)
                insist(lambda: self.lift(to_mm))
        except (FeltError, StageError, TransportError) as error:
            reason = f"{reason}; and the lift failed: {error}"
        self.heartbeat.rest()
        self.state, self.problem = State.TRIPPED, TripError(reason)
        with contextlib.suppress(RecordError):  # the trip says more
            self.record("trip", {"reason": reason, "force_gwt": force_gwt, "contact_s": self.contact.rounded_s})
        raise self.problem

    def make_safe(self) -> None:
        """After a failure elsewhere: lift where the stage is at rest and trusted, stop it where that fails."""
        if self.state is State.IN_CONTACT:
            try:
                self.lift()
                self.lifted()
            except (StageError, TransportError, TripError):
                self.stop()
        self.heartbeat.rest()

    def stop(self) -> None:
        """Quick stop past every queue; the position is not trusted afterwards, a trip stays latched."""
        if self.state is not State.TRIPPED:
            self.state = State.UNHOMED
        self.heartbeat.rest()
        self._stop_stage()

    def _stop_stage(self) -> None:
        with contextlib.suppress(StageError, TransportError):  # whoever calls has the first error to report
            self.bench.stage.stop()

    # what it promises

    def record(self, stream: str, data: Mapping[str, Any]) -> None:
        """Journal an event; it is on disk when this returns. Where that fails: lift, and raise RecordError."""
        try:
            self._journal.event(stream, as_fine(data))
        except RecordError as error:
            self.problem = self.problem or error
            self.make_safe()
            raise

    def beat(self, longer_s: float = 0.0) -> None:
        """Tell the heartbeat that all is well, where there is something to watch; too late is lost."""
        self.heartbeat.look()
        if self.heartbeat.lost and self.state is not State.TRIPPED:
            self.trip("the engine's heartbeat was lost: the stage was stopped and stays where it is")
        if self.may_touch:
            self.heartbeat.beat(self.settings.limits.heartbeat_s + longer_s)

    def guarded(self, action: Callable[[], _T]) -> _T:
        """Run a call to the stage; its failure stops the stage before it is passed on."""
        try:
            return action()
        except (StageError, TransportError) as error:
            self.problem = self.problem or error
            self.stop()
            raise
