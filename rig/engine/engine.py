"""Engine: states, monitored moves, trips, lifts and stops. Every verb of a protocol ends here."""

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from enum import Enum
from types import MappingProxyType
from typing import NoReturn, Protocol, TypeVar

from rig.clock import real_s
from rig.data.events import AlarmEvent, Event, RetractEvent, SampleEvent, TripEvent, stream_of
from rig.data.journal import Recorder
from rig.devices.base import LOOK_S, ForceReading, StageError
from rig.devices.sync_line import StageOutput, SyncLine
from rig.engine.bench import Bench, EngineMemory, NoMemory
from rig.engine.contact import ContactRecord, KnownContact, contact_kind
from rig.engine.limits import (
    AT_MM,
    ContactTime,
    FingerStiffness,
    Heartbeat,
    Stopping,
    Touched,
    TouchLimit,
    Trips,
    late_reading_s,
    longer_than_an_increment,
    park_height_mm,
    refuse_height,
    trip_height_mm,
)
from rig.engine.motion import Check, EndedMotionError, InterruptedMotionError, Motion, Outcome, insist, lift_from_rest
from rig.engine.sensing import NoReadingError, Sensing
from rig.engine.watch import OnReading, Watch, WatchedMotion
from rig.errors import NotReadyError, RecordError, TripError
from rig.records import NO_PRESS, ContactKind, Phase, PressId, as_fine
from rig.settings import RigSettings
from rig.transport.wire import TransportError
from rig.units import GWT_N
from rig_shared.errors import code_of

_T = TypeVar("_T")

_SUSPENDED_S = 0.5  # The two clocks of a computer that was not suspended differ by less.
LATE_FACTOR = 2.0  # A motion may take this multiple of its nominal duration before the heartbeat is lost.


class StopInputs(Protocol):
    """Stop inputs of the bench, polled with each reading."""

    def __call__(self, engine: "Engine", *, at_rest: bool) -> TripError | None:
        """Return a trip or None; it may stop the stage itself and raise."""
        ...


def no_stop_inputs(engine: "Engine", *, at_rest: bool) -> TripError | None:
    """Return None: the bench has no stop inputs."""
    return None


def _unwatched() -> None:
    """Check nothing: the motion is the lift after a trip."""


class State(Enum):
    """State of the engine, which determines the allowed commands."""

    UNHOMED = "unhomed"
    READY = "ready"
    IN_CONTACT = "in contact"  # anywhere below clearance
    TRIPPED = "tripped"  # for good: another engine begins with the next command, or when manual control homes


class Engine:
    """Engine of one bench and one finger; positions are x, along and height above the pad's nominal apex (mm).

    Parts: motion (position), sensing (force), trips (force limits), contact (what is known of it), contact_time and
    heartbeat. The checks of a motion are in rig/engine/watch.py, the verbs of a script in rig/engine/verbs.py, the
    indentations in rig/engine/indentation.py.
    """

    def __init__(
        self,
        settings: RigSettings,
        bench: Bench,
        journal: Recorder,
        soft_trip_n: float | None = None,
        contact_s: float = 0.0,
        stiffness: FingerStiffness | None = None,
        *,
        memory: EngineMemory | None = None,
        stop_inputs: StopInputs = no_stop_inputs,
        sensing: Sensing | None = None,
        sync_line: SyncLine | None = None,
        first_reference_gwt: Sequence[float] | None = None,
    ) -> None:
        """Begin with what the earlier parts of a run left: contact time (s) and forces of the first reference press.

        stiffness: as predicted. memory: keeps contact and zero for the next command. sync_line: by default the
        configured output of the stage, if any.
        """
        self.settings, self.bench, self.clock = settings, bench, bench.clock
        self.stiffness = stiffness or FingerStiffness.unknown()
        self.stop_inputs = stop_inputs
        self._journal, self.memory = journal, memory or NoMemory()
        self.state = State.UNHOMED
        self.problem: Exception | None = None  # The first trip or failure: the run cannot end normally after it.
        self.indentor: str | None = None
        self.placed = False  # moved to a position since homing
        self.first_reference_gwt = first_reference_gwt
        self.contact = ContactRecord()
        self.trips = Trips(settings.limits, soft_trip_n)
        self.sensing = sensing or Sensing(settings, bench.clock, bench.force)
        self.motion = Motion(settings, bench.stage, bench.clock)
        self.touched = Touched(settings)
        of_stage = settings.sync.output != "off" and settings.sync.adapter is None
        self.sync_line = sync_line or (StageOutput(bench.stage, bench.clock) if of_stage else None)
        self.contact_time = ContactTime(bench.clock, settings.limits, contact_s)
        self.heartbeat = Heartbeat(bench.clock, self._stop_stage)
        self._suspended_s = self.clock.suspended_s()
        self._next_index = 0

    # --- position ---

    @property
    def x_mm(self) -> float:
        """Lateral position from the center of the pad (mm)."""
        return self.motion.x_mm

    @property
    def along_mm(self) -> float:
        """Position along the finger from the receptor plane (mm)."""
        return self.motion.along_mm

    @property
    def height_mm(self) -> float:
        """Height of the indentor above the pad's nominal apex (mm)."""
        return self.motion.height_mm

    def require_clear(self, verb: str) -> None:
        """Raise NotReadyError unless at clearance, homed and not tripped."""
        if self.state is not State.READY:
            raise self.not_allowed(verb)

    def not_allowed(self, verb: str) -> NotReadyError:
        """Return the error for a verb that the present state does not allow."""
        return NotReadyError(f"{verb}: not allowed while {self.state.value}")

    def next_index(self) -> int:
        """Return a new index, unique in the run."""
        self._next_index += 1
        return self._next_index - 1

    # --- motion ---

    def go_to_height(
        self,
        height_mm: float,
        speed_mm_s: float,
        *,
        touch_ends_it: bool = False,
        expected_below_mm: float = math.inf,
        on_reading: OnReading | None = None,
    ) -> Outcome:
        """Move vertically.

        Below clearance a move down is at most one increment, or ends just above an earlier contact, or above where
        contact is expected at a place beside one, or is a ramp, whose readings `on_reading` receives as they arrive.
        """
        clearance_mm, from_mm = self.settings.habits.clearance_mm, self.height_mm
        free_mm = height_mm if on_reading else self.free_mm(speed_mm_s, expected_below_mm)
        refuse_height(self.settings, from_mm, height_mm, speed_mm_s, free_mm)
        if height_mm < clearance_mm - AT_MM:
            self._below_clearance()
        long = longer_than_an_increment(self.settings, from_mm, height_mm, clearance_mm)
        look_s = min(self.sensing.sensor.sample_period_s, LOOK_S) if on_reading or long else LOOK_S
        watch = Watch(
            away=height_mm > from_mm,
            touch_ends_it=not on_reading and (long or touch_ends_it),
            late_s=late_reading_s(self.settings) if long or on_reading else math.inf,
            on_reading=on_reading,
            # A ramp is polled from its start, so that it is late as soon as a hold is.
            lasts_s=0.0 if on_reading else abs(height_mm - from_mm) / speed_mm_s,
        )
        return self.run_watched(lambda check: self.motion.to_height(height_mm, speed_mm_s, check, look_s), watch)

    def run_watched(self, motion: Callable[[Check], None], watch: Watch) -> Outcome:
        """Run a motion with the force monitored; trip at rest if a force or a missing reading ended it.

        After a touch, a pause or a late reading, the reading at rest is more accurate, and decides. The lift after a
        trip is not watched: nothing may keep the indentor on the finger.
        """
        self.contact = replace(self.contact, at_rest=False)
        check: Check = _unwatched
        try:
            if self.state is not State.TRIPPED:
                begun = self.sensing.begin_motion(away=watch.away, shakes_gwt=watch.shakes_gwt)
                check = WatchedMotion(self, watch, begun)
                if not (watch.away or self.sensing.has_new_reading):
                    check()
            if watch.lasts_s is not None:
                self.beat(LATE_FACTOR * watch.lasts_s)
            self.guarded(lambda: motion(check))
        except NoReadingError as error:
            self.trip(TripError(str(error), error.code))
        except EndedMotionError as ended:
            return ended.outcome
        except InterruptedMotionError as interruption:
            if self.state is State.TRIPPED:
                raise  # The lift after a trip continues.
            if isinstance(interruption.__cause__, RecordError):
                self._lift_unrecorded(interruption.__cause__)
            force_gwt = interruption.force_gwt
            sample = None if force_gwt is None else self._sample("moving", force_gwt)
            self.trip(TripError(str(interruption), interruption.code), force_gwt, sample)
        return Outcome.ARRIVED

    def stop_asked(self, *, at_rest: bool) -> TripError | None:
        """Return the trip of a stop input, or of a computer that was suspended in contact, or None."""
        before_s, self._suspended_s = self._suspended_s, self.clock.suspended_s()
        for_s = self._suspended_s - before_s
        if for_s > _SUSPENDED_S and self.contact.may_touch:
            return TripError(
                f"the computer was suspended for {for_s:.1f} s while the indentor may have touched the finger; "
                "switch its sleep off",
                "suspended",
            )
        return self.stop_inputs(self, at_rest=at_rest)

    def note_force(self, force_gwt: float | None) -> None:
        """Note a force read in a motion (gwt); above clearance it renews or ends a measured lift."""
        self._keep_force(force_gwt)
        if force_gwt is not None:
            self._renew_lift(force_gwt)

    def _keep_force(self, force_gwt: float | None) -> None:
        known_gwt = force_gwt if self.sensing.zeroed else None
        self.contact = self.contact.after_force(known_gwt, self.sensing.touch_gwt, self.clock.monotonic_s())

    @property
    def touch_limit(self) -> TouchLimit:
        """Speed of a motion that a touch ends, with the present trips."""
        stiffness = self.touched.stiffest(self.stiffness)
        return TouchLimit.of(self.settings, self.trips.lowest_gwt, self.sensing.touch_gwt, stiffness)

    def free_mm(self, speed_mm_s: float, expected_below_mm: float) -> float:
        """Return the height (mm) down to which one move at this speed is safe at the present position.

        expected_below_mm: highest height at which contact is expected.
        """
        farther_mm = Stopping.at_a_touch(self.settings, speed_mm_s).distance_mm - self.touch_limit.stop_mm
        return self.touched.free_mm(self.x_mm, self.along_mm, expected_below_mm) + max(farther_mm, 0.0)

    def limit_depth(self, height_mm: float) -> None:
        """Set the lowest height that the stage itself allows, if it can; at rest only. Raises StageError."""
        self.guarded(lambda: self.motion.limit_depth(height_mm))

    def lift(self, to_mm: float | None = None) -> None:
        """Lift straight up to a height (mm), clearance by default; do nothing if already there."""
        height_mm = self.settings.habits.clearance_mm if to_mm is None else to_mm
        if self.height_mm < height_mm - AT_MM:
            self.go_to_height(height_mm, self.settings.habits.travel_speed_mm_s)

    # --- contact ---

    @property
    def trusted(self) -> bool:
        """Whether the position of the stage is trusted."""
        return self.bench.stage.homed and self.state is not State.UNHOMED

    @property
    def at_clearance(self) -> bool:
        """Whether a trusted position is at clearance or higher."""
        return self.bench.stage.homed and self.height_mm >= self.settings.habits.clearance_mm - AT_MM

    @property
    def known_contact(self) -> KnownContact:
        """State of contact from the last measurements, without a query to a device."""
        contact = self.contact
        if contact.at_rest or not contact.may_touch:
            return contact.measured.after(self._now_s - contact.measured_s, trusted=self.trusted)
        touches = contact.force_gwt is not None and abs(contact.force_gwt) >= self.sensing.touch_gwt
        return self._here("touching" if touches else "unknown", contact.force_gwt)

    @property
    def is_lifted(self) -> bool:
        """Whether a measurement at rest, at most `FRESH_S` old, shows that the indentor does not touch the finger."""
        return not self.known_contact.may_touch

    def measure_contact(self) -> KnownContact:
        """Measure and record the state of contact at rest; neither trip nor move.

        A remaining force may still vanish: a sensor may be late, or a load cell slow.
        """
        return self.record_contact(self.force_at_rest_gwt())

    def record_contact(self, force_gwt: float | None) -> KnownContact:
        """Record and return the state of contact from the position and this force at rest; None: no force."""
        kind = contact_kind(clear=self.at_clearance, force_gwt=force_gwt, touch_gwt=self.sensing.touch_gwt)
        found = self._here(kind, force_gwt)
        self.contact = self.contact.after_measuring(found, self._now_s)
        self.memory.touched(found)
        return found

    @property
    def _now_s(self) -> float:
        return real_s(self.clock)

    def _renew_lift(self, force_gwt: float) -> None:
        if self.sensing.zeroed:
            found = self._here("lifted", round(force_gwt, 6))
            self.contact = self.contact.after_reading(found, self._now_s, self.sensing.touch_gwt)

    def measure_at_end(self) -> None:
        """Measure contact at the end of a run that was not stopped, unless the last measurement is fresh."""
        if self.motion.begun and not (self.contact.at_rest and self.contact.is_fresh(self._now_s)):
            self.measure_contact()

    def confirm_lifted(self) -> None:
        """Confirm at rest that the indentor is clear of the finger; trip if this is not confirmed."""
        found = self.measure_contact()
        if found.kind == "disagreement" or (found.kind == "raised" and self.sensing.zeroed):
            self.trip(self.not_lifted, found.force_gwt)
        self.enter_clearance()

    @property
    def not_lifted(self) -> TripError:
        """Trip for the last measurement of contact."""
        known, unread = self.contact.measured, self.contact.unread
        unread = f": {unread}" if known.kind == "raised" else ""
        return TripError(f"not lifted: {known.words}{unread}", "not_lifted")

    def enter_clearance(self) -> None:
        """Record that the indentor is clear of the finger, which ends the contact time and the heartbeat."""
        self.state, self.contact = State.READY, replace(self.contact, may_touch=False)
        self.trips.press_on(math.inf)
        self.heartbeat.rest()
        self.contact_time.end()

    def _here(self, kind: ContactKind, force_gwt: float | None) -> KnownContact:
        x_mm, height_mm = (round(mm, 6) if math.isfinite(mm) else None for mm in (self.x_mm, self.height_mm))
        return KnownContact(kind, force_gwt, x_mm, height_mm, self.clock.unix_s())

    def _below_clearance(self) -> None:
        """Record a possible contact before the first motion below clearance."""
        self.state = State.IN_CONTACT
        if not self.contact.may_touch:
            self.contact, self._suspended_s = replace(self.contact, may_touch=True), self.clock.suspended_s()
            self.memory.touched(self._here("unknown", self.contact.force_gwt))

    def force_at_rest_gwt(self) -> float | None:
        """Return the force from zero at rest (gwt), or None without a zero or a reading."""
        if not self.sensing.zeroed:
            return None
        try:
            force_gwt = self.sensing.at_rest_gwt(self.beat)
        except NoReadingError as error:
            self.contact = replace(self.contact, unread=str(error))
            return None
        self._keep_force(force_gwt)
        return force_gwt

    # --- force ---

    def read_force_gwt(self, press: PressId, phase: Phase, contact_height_mm: float | None = None) -> float:
        """Read and journal a force taken after the last move ended (gwt); trip without one or beyond a limit.

        Raises ContactTimeError if the contact time exceeds limits.max_contact_s.
        """
        reading = self.reading()
        # Rounding makes a reading at exactly the threshold independent of its unit conversion.
        force_gwt = round(reading.force_n / GWT_N, 6)
        self._keep_force(force_gwt)
        doi_mm = None if contact_height_mm is None else self.doi_mm(contact_height_mm, force_gwt)
        if self.state is State.IN_CONTACT and force_gwt >= self.sensing.touch_gwt:
            self.contact_time.begin()
        sample = self._sample(phase, force_gwt, doi_mm, press, stable=reading.stable, also=reading.also)
        if passed := self.trips.passed(force_gwt):
            self.trip(passed, force_gwt, sample, press)
        self.record(sample, press)
        self.contact_time.refuse_more()
        return force_gwt

    def record_in_motion(self, press: PressId, phase: Phase, reading: ForceReading, doi_mm: float) -> None:
        """Journal a reading of a motion. If that fails, raises InterruptedMotionError, so that the motion ends."""
        force_gwt = round(reading.force_n / GWT_N, 6)
        try:
            self._journalled(self._sample(phase, force_gwt, doi_mm, press, also=reading.also), press)
        except RecordError as error:
            raise InterruptedMotionError(str(error), error.code) from error

    def _sample(
        self,
        phase: Phase,
        force_gwt: float,
        doi_mm: float | None = None,
        press: PressId = NO_PRESS,
        *,
        stable: bool = False,
        also: Mapping[str, float] = MappingProxyType({}),
    ) -> SampleEvent:
        """Return a reading for the journal, at the present position and contact time."""
        return SampleEvent(
            index=press.index,
            phase=phase,
            x_mm=None if math.isnan(self.x_mm) else self.x_mm,
            height_mm=None if math.isnan(self.height_mm) else round(self.height_mm, 6),
            doi_mm=None if doi_mm is None else round(doi_mm, 6),
            force_gwt=force_gwt,
            stable=stable,
            contact_s=self.contact_time.rounded_s,
            of_the_sensor=also,
        )

    def watch_at_clearance(self, *, recorded: bool) -> None:
        """Read the force in a wait at clearance; a finger that comes up trips as in a hold, and its time counts.

        Raises TripError, and ContactTimeError after a lift if the contact time exceeds limits.max_contact_s.
        """
        reading = self.reading()
        if not self.sensing.absolute:
            return
        force_gwt = round(reading.force_n / GWT_N, 6)
        self._keep_force(force_gwt)
        if abs(force_gwt) >= self.sensing.touch_gwt:
            self.contact_time.begin()
        else:
            self.contact_time.end()
        sample = self._sample("rest", force_gwt, stable=reading.stable, also=reading.also)
        if passed := self.trips.passed(force_gwt):
            words = f"{passed} in a wait at clearance: the finger has come up to the indentor"
            self.trip(TripError(words, f"{passed.code}_at_rest"), force_gwt, sample)
        if recorded:
            self.record(sample)
        if self.contact_time.over:
            self.lift(park_height_mm(self.settings, self.height_mm))
            self.measure_contact()
            self.contact_time.refuse_more()

    def reading(self, *, from_zero: bool = True) -> ForceReading:
        """Return a new reading taken at rest; trip for a stop input, without a reading, or beyond the hard trip."""
        if problem := self.stop_asked(at_rest=True):
            self.trip(problem)
        try:
            reading = self.sensing.settled(self.beat) if from_zero else self.sensing.raw(self.beat)
        except NoReadingError as error:
            self.trip(TripError(str(error), error.code))
        force_gwt = reading.force_n / GWT_N
        if passed := self.trips.passed_hard(force_gwt):
            self.trip(passed, force_gwt)
        if problem := self.stop_inputs(self, at_rest=True):
            self.trip(problem)
        self._renew_lift(force_gwt)
        return reading

    def doi_mm(self, contact_height_mm: float, force_gwt: float) -> float:
        """Return the depth past contact (mm), corrected for the compliance of the rig."""
        return contact_height_mm - self.height_mm - self.sensing.deflection_mm(force_gwt)

    # --- alarms, trips and stops ---

    def alarm(self, reason: TripError) -> None:
        """Journal an alarm; trip if limits.on_alarm is `trip`."""
        self.record(AlarmEvent(str(reason)))
        if self.settings.limits.on_alarm == "trip":
            self.trip(reason)

    @property
    def trip_lifts(self) -> bool:
        """Whether a trip lifts: not where it is configured to stay, nor after a lost heartbeat stopped the stage."""
        return self.settings.limits.on_trip != "stop" and not self.heartbeat.lost

    def trip(
        self,
        reason: TripError,
        force_gwt: float | None = None,
        sample: SampleEvent | None = None,
        press: PressId = NO_PRESS,
    ) -> NoReturn:
        """Latch the trip, journal it after its reading, act by limits.on_trip, and raise the reason.

        The stage is at rest and its position trusted, so it can lift. If it was stopped, or the lift fails, it
        stays. While a force remains after the lift, it goes on to the park height.
        """
        # A journal that fails does not delay the lift; the caller reports the trip.
        with contextlib.suppress(RecordError):
            if sample is not None:
                self._journalled(sample, press)
        self.state, self.problem = State.TRIPPED, reason
        with contextlib.suppress(RecordError):
            self._journalled(TripEvent(str(reason), force_gwt, self.contact_time.rounded_s))
        lifted = False
        try:
            if self.trip_lifts:
                to_mm = trip_height_mm(self.settings, self.height_mm)
                insist(lambda: self._leave(to_mm))
                insist(self._leave_force)
                lifted = True
                with contextlib.suppress(RecordError):
                    self.measure_contact()
                if self.contact.measured.kind == "disagreement":  # A finger came up after the lift.
                    insist(self._leave_force)
            elif self.settings.limits.on_trip == "stop":
                self.stop()
        except (InterruptedMotionError, StageError, TransportError) as error:
            reason = TripError(f"{reason}; and the lift failed: {error}", reason.code)
            reason.lift_code = code_of(error)
        with contextlib.suppress(RecordError):
            if not (lifted and self.contact.at_rest):
                self.measure_contact()
            if lifted:
                self._journalled(self.after_lift())
        self.heartbeat.rest()
        self.state, self.problem = State.TRIPPED, reason
        raise reason

    def after_lift(self) -> RetractEvent:
        """Return height, contact time and state of contact for the journal."""
        known = self.known_contact
        height_mm = round(self.height_mm, 6) if math.isfinite(self.height_mm) else None
        return RetractEvent(height_mm, self.contact_time.rounded_s, known.kind, known.force_gwt)

    def _leave_force(self) -> None:
        """Go on up to the park height after a lift while the force does not vanish."""
        top_mm = min(self.settings.habits.park_height_mm, -self.settings.frame.apex_z_mm)
        if not (self.bench.stage.homed and self.sensing.zeroed) or self.height_mm >= top_mm - AT_MM:
            return
        try:
            force_gwt = self.sensing.settled(self.beat).force_n / GWT_N
        except NoReadingError:
            return
        if abs(force_gwt) >= self.sensing.touch_gwt:
            self.lift(top_mm)

    def _leave(self, to_mm: float) -> None:
        """Lift to a height after a trip; by as much and in jogs, if the stage strayed and was stopped."""
        if self.bench.stage.homed or not self.motion.strayed:
            self.lift(to_mm)
            return
        top_mm = -self.settings.frame.apex_z_mm
        by_mm = min(max(to_mm - self.height_mm, self.settings.habits.clearance_mm), top_mm - self.height_mm)
        stage, speed_mm_s = self.bench.stage, self.settings.habits.travel_speed_mm_s
        stage.unlock()
        if by_mm > AT_MM:
            self.run_watched(
                lambda check: lift_from_rest(stage, self.clock, by_mm, speed_mm_s),
                Watch(away=True, lasts_s=math.inf),  # Each jog ends by itself.
            )
        self.motion.set_position(stage.status())

    def make_safe(self) -> None:
        """Lift after a failure elsewhere, if the stage is at rest and trusted; stop if the lift fails."""
        if self.state is State.IN_CONTACT:
            try:
                self.lift()
                self._leave_force()
            except (StageError, TransportError, TripError):
                self.stop()
            with contextlib.suppress(TripError):
                if self.state is State.IN_CONTACT and not self.measure_contact().may_touch:
                    self.enter_clearance()
        self.heartbeat.rest()

    def stop(self) -> None:
        """Stop past every queue, without a lift: for STOP, a second Ctrl-C and the participant's button.

        The position is no longer trusted; a trip stays latched.
        """
        self.motion.forget_depth()
        if self.state is not State.TRIPPED:
            self.state = State.UNHOMED
        self.heartbeat.rest()
        self._stop_stage()

    def _stop_stage(self) -> None:
        with contextlib.suppress(StageError, TransportError):  # The caller reports the first error.
            self.bench.stage.stop()

    # --- journal and heartbeat ---

    def record(self, event: Event, press: PressId = NO_PRESS) -> None:
        """Journal an event, of a press if it has one, without waiting for the disk.

        If that fails, lift and raise RecordError.
        """
        try:
            self._journalled(event, press)
        except RecordError as error:
            self._lift_unrecorded(error)

    def settle(self) -> None:
        """Wait until all events are on disk. If that fails, lift and raise RecordError."""
        try:
            self._journal.settle()
        except RecordError as error:
            self._lift_unrecorded(error)

    def _journalled(self, event: Event, press: PressId = NO_PRESS) -> None:
        self._journal.event(press.stream(stream_of(type(event))), as_fine(event.data()))

    def _lift_unrecorded(self, error: RecordError) -> NoReturn:
        self.problem = self.problem or error
        self.make_safe()
        raise error

    def beat(self, longer_s: float = 0.0) -> None:
        """Renew the heartbeat while the indentor may touch the finger; trip if it was lost."""
        self.heartbeat.look()
        if self.heartbeat.lost and self.state is not State.TRIPPED:
            words = "the engine's heartbeat was lost: the stage was stopped and stays where it is"
            self.trip(TripError(words, "heartbeat_lost"))
        if self.contact.may_touch:
            least_s = self.sensing.max_age_s + LOOK_S  # The engine is silent while it waits for a slow sensor.
            self.heartbeat.beat(max(self.settings.limits.heartbeat_s, least_s) + longer_s)

    def guarded(self, action: Callable[[], _T]) -> _T:
        """Call the stage; on failure stop it and raise the error again."""
        try:
            return action()
        except (StageError, TransportError) as error:
            self.problem = self.problem or error
            self.stop()
            raise
