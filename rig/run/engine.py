"""The engine: states, single safe moves, readings and trips. Every verb of a protocol ends here."""

import contextlib
import math
import statistics
from collections.abc import Callable, Mapping
from dataclasses import replace
from enum import Enum
from typing import Any, NoReturn, Protocol, TypeVar

from rig.clock import Clock
from rig.force.base import ForceError, ForceReading, ForceSensor
from rig.heartbeat import Heartbeat
from rig.run.contact_time import ContactTime
from rig.run.errors import LimitError, NotReadyError, PressPaused, RecordError, RunAborted, TripError
from rig.run.records import NO_PRESS, PressId
from rig.settings import RigSettings
from rig.stage.base import Stage, StageError
from rig.transport.base import TransportError
from rig.units import GWT_N

_T = TypeVar("_T")

_AT_MM = 0.02  # heights closer than this are the same place
_NOISE_READINGS, _NOISE_WIDTH = 12, 6.0  # readings at a zero; standard deviations that a whole step is taken for
_LATE_FACTOR = 2.0  # a move may take so many times its length over its speed before the heartbeat is missed


class State(Enum):
    """What the engine may do next."""

    UNHOMED = "unhomed"
    READY = "ready"
    IN_CONTACT = "in contact"  # anywhere below clearance
    TRIPPED = "tripped"


class Operator(Protocol):
    """Whoever stands at the bench: a person, or the virtual plant of a dry-run."""

    def mount(self, indentor: str) -> str:
        """Put this indentor on the carriage; returns the name of the one that is on then."""

    def confirm(self, request: str) -> None:
        """Do what is asked for before anything moves; returns when it is done."""

    def true_pose(self) -> tuple[float, float] | None:
        """True x and DOI in mm where they can be known (a virtual bench), else None."""


class Recorder(Protocol):
    """Where events go: the journal of a run, or the memory of a rehearsal."""

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Keep it; it counts when this returns. Raises RecordError."""


class Engine:
    """Moves one stage under one force sensor; positions are x and height above the pad's nominal apex, in mm."""

    def __init__(
        self,
        settings: RigSettings,
        clock: Clock,
        stage: Stage,
        force: ForceSensor,
        journal: Recorder,
        operator: Operator,
        interrupted: Callable[[], bool] = lambda: False,
        soft_trip_n: float | None = None,
        go_on: Callable[[], bool] = lambda: False,
        heartbeat: Heartbeat | None = None,
        contact_s: float = 0.0,
    ) -> None:
        """contact_s: how long the finger was touched in the parts of the run before this one."""
        self.settings, self.clock, self.operator = settings, clock, operator
        self.state = State.UNHOMED
        self.indentor: str | None = None
        self.x_mm = math.nan
        self.along_mm = 0.0
        self.height_mm = math.nan
        self.problem: Exception | None = None  # the first trip or failure; a run does not end well after it
        self._next_index = 0
        self._placed = False
        self._moved = True  # since the last reading
        self._may_touch = False  # below clearance since the last lift or homing
        self._stage, self._force, self._journal = stage, force, journal
        self._interrupted, self._go_on = interrupted, go_on
        self._zeroed = False
        self.noise_gwt = 0.0  # standard deviation of single readings, measured at each zero
        self._offset_n = 0.0  # what a noisy sensor still shows after it was zeroed
        limit = settings.limits.soft_trip_n
        self.soft_trip_gwt = (limit if soft_trip_n is None else min(limit, soft_trip_n)) / GWT_N
        self._area_trip_gwt = math.inf
        self._heartbeat = heartbeat or Heartbeat(clock)
        self._heartbeat.stop = self._stop_stage
        self.contact = ContactTime(clock, contact_s)

    @property
    def resolution_gwt(self) -> float:
        """One step of what the force sensor shows."""
        return self._force.resolution_gwt

    @property
    def least_gwt(self) -> float:
        """What is less than half of this cannot be told from nothing: one step of the sensor, or its noise."""
        return max(self.resolution_gwt, _NOISE_WIDTH * self.noise_gwt)

    @property
    def touch_gwt(self) -> float:
        """The reading that means contact: as configured, or well out of the noise."""
        return max(self.settings.habits.touch_force_gwt, self.least_gwt)

    @property
    def trip_gwt(self) -> float:
        """The force that trips now: the lowest of soft trip, hard trip and pressure times the contact's area."""
        return min(self.soft_trip_gwt, self.settings.limits.hard_trip_n / GWT_N, self._area_trip_gwt)

    @property
    def which_trip(self) -> str:
        """The name of the limit that trip_gwt is."""
        if self.trip_gwt == self.soft_trip_gwt:
            return "soft trip"
        return "pressure limit" if self.trip_gwt == self._area_trip_gwt else "hard trip"

    # verbs

    def mount(self, indentor: str) -> None:
        """Have an indentor mounted; the finger must be clear of it."""
        if self._may_touch or self.state is State.TRIPPED:
            raise NotReadyError(f"mount: not allowed while {self.state.value}, the finger may be touched; lift first")
        self.indentor = None
        mounted = self.operator.mount(indentor)
        if mounted != indentor:
            raise NotReadyError(f"mount: {mounted} is on, expected {indentor}; nothing is pressed with the wrong one")
        self.indentor = indentor
        self.record("mount", {"indentor": indentor})

    def home(self) -> None:
        """Find the switches; from then on the position is trusted."""
        if self.state is State.TRIPPED:
            raise NotReadyError("home: the rig has tripped, an operator must reset it")
        self._heartbeat.rest()  # homing lifts first, and takes its time
        controller = self._guarded(self._stage.connect)
        self._guarded(self._stage.home)
        at = self._guarded(self._stage.status)
        self.x_mm = at.x_mm - self.settings.frame.pad_centre_x_mm
        self.height_mm = at.z_mm - self.settings.frame.apex_z_mm
        self._placed = False
        self._lifted()
        self.record("home", {"controller": controller})

    def zero(self) -> None:
        """Zero the force sensor with the indentor in the air; how far it has drifted since the last one is told."""
        self._require_clear("zero")
        drift_gwt = statistics.fmean(self._readings_gwt()) if self._zeroed else None
        name = self._force.connect()
        self.clock.wait_s(self._settle_s)
        self._force.zero()
        self._offset_n = 0.0
        readings = self._readings_gwt()
        self._offset_n, self.noise_gwt = statistics.fmean(readings) * GWT_N, statistics.pstdev(readings)
        self._zeroed = True
        found = {
            "noise_gwt": round(self.noise_gwt, 6),
            "offset_gwt": round(self._offset_n / GWT_N, 6),
            "drift_gwt": None if drift_gwt is None else round(drift_gwt, 6),
        }
        self.record("zero", {"sensor": name, **found})
        band_gwt = self.settings.limits.zero_drift_gwt
        if drift_gwt is not None and abs(drift_gwt) > band_gwt:
            self.alarm(f"the zero has drifted by {drift_gwt:+.2f} gwt, limits.zero_drift_gwt = {band_gwt:g}")

    def _readings_gwt(self) -> list[float]:
        return [self._reading().force_n / GWT_N for _ in range(_NOISE_READINGS)]

    def move_to(self, x_mm: float, along_mm: float = 0.0) -> None:
        """Go to a place, at clearance: sideways, and along the finger where the stage has that axis."""
        self._require_clear("move_to")
        limits = self.settings.limits
        for name, mm, (low, high) in (("x", x_mm, limits.x_mm), ("along", along_mm, limits.along_mm)):
            if not low <= mm <= high:
                raise LimitError(f"move_to: {name} = {mm:g} mm is outside the limits {low:g} … {high:g} mm")
        self.safe_point()
        frame, speed = self.settings.frame, self.settings.habits.travel_speed_mm_s
        self._guarded(
            lambda: self._stage.move_to(
                x_mm=frame.pad_centre_x_mm + x_mm, y_mm=frame.pad_y_mm + along_mm, speed_mm_s=speed
            )
        )
        self.x_mm, self.along_mm = x_mm, along_mm
        self._go_to_clearance(speed)
        self._placed = True
        self.record("move", {"x_mm": x_mm, "along_mm": along_mm, "height_mm": self.height_mm})

    def be_over(self, x_mm: float) -> None:
        """Go to a lateral position unless there already."""
        if not self._placed or (self.x_mm, self.along_mm) != (x_mm, 0.0):
            self.move_to(x_mm)

    def retract(self) -> None:
        """Lift to clearance, straight up."""
        if self.state not in (State.READY, State.IN_CONTACT):
            raise NotReadyError(f"retract: not allowed while {self.state.value}")
        self._lift(self.settings.habits.clearance_mm)
        self._lifted()
        self.record("retract", {"height_mm": self.height_mm, "contact_s": self._contact_s})

    def rest(self, seconds: float) -> None:
        """Let the finger be for so long, at clearance; a pause is taken at once, and its time counts."""
        self._require_clear("rest")
        until_s = self.clock.monotonic_s() + seconds
        while self.clock.monotonic_s() < until_s:
            self.clock.wait_until(self._interrupted, until_s)
            self.safe_point()
        self.record("rest", {"rest_s": seconds})

    def checkpoint(self, name: str) -> None:
        """Write into the journal that the script has come to here."""
        self.record("checkpoint", {"name": name})

    def note(self, text: str) -> None:
        """Write a line into the journal."""
        self.record("note", {"text": text})

    # what an indentation is made of

    def ready_to_indent(self) -> None:
        """Raise NotReadyError unless homed, zeroed, mounted, placed and clear."""
        self._require_clear("indent")
        if self.indentor is None:
            raise NotReadyError("indent: no indentor is mounted")
        if not self._zeroed:
            raise NotReadyError("indent: the force sensor has not been zeroed")
        if not self._placed:
            raise NotReadyError("indent: the indentor has not been moved to a position since homing")
        self._refuse_long_contact()

    def press_on(self, contact_area_mm2: float) -> None:
        """From here on the force must not exceed limits.max_pressure_n_cm2 over this area."""
        self._area_trip_gwt = self.settings.limits.max_pressure_n_cm2 * contact_area_mm2 / 100 / GWT_N

    def next_index(self) -> int:
        """The number of the indentation that begins now; never given twice in a run."""
        self._next_index += 1
        return self._next_index - 1

    def go_to_height(self, height_mm: float, speed_mm_s: float) -> None:
        """One vertical move; below clearance never down by more than one increment."""
        habits = self.settings.habits
        lowest = min(self.height_mm, habits.clearance_mm) - habits.increment_mm
        if height_mm < lowest - 1e-9:
            raise LimitError(f"a move down to {height_mm:.3f} mm is longer than one increment below clearance")
        fastest = self.settings.limits.max_press_speed_mm_s
        if height_mm < min(self.height_mm, habits.clearance_mm) and speed_mm_s > fastest:
            raise LimitError(f"a move down below clearance at {speed_mm_s:g} mm/s is faster than {fastest:g}")
        if height_mm < habits.clearance_mm - _AT_MM:
            self.state, self._may_touch = State.IN_CONTACT, True
        self._beat(_LATE_FACTOR * abs(height_mm - self.height_mm) / speed_mm_s)
        self._moved = True
        z = self.settings.frame.apex_z_mm + height_mm
        self._guarded(lambda: self._stage.move_to(z_mm=z, speed_mm_s=speed_mm_s))
        self.height_mm = height_mm

    def read_force_gwt(self, press: PressId, phase: str, contact_height_mm: float | None = None) -> float:
        """A reading taken after the last move ended, journalled. No reading, or one above the soft trip, trips.

        Raises LimitError where the finger has been touched for longer than limits.max_contact_s.
        """
        reading = self._reading()
        # Far finer than any sensor: a reading of just the threshold must not hang on how it was multiplied.
        force = round(reading.force_n / GWT_N, 6)
        doi = None if contact_height_mm is None else self.doi_mm(contact_height_mm, force)
        if self.state is State.IN_CONTACT and force >= self.touch_gwt:
            self.contact.begin()
        self.record(
            press.stream("sample"),
            {
                "index": press.index,
                "phase": phase,
                "x_mm": self.x_mm,
                "height_mm": round(self.height_mm, 6),
                "doi_mm": None if doi is None else round(doi, 6),
                "force_gwt": force,
                "stable": reading.stable,
                "contact_s": self._contact_s,
            },
        )
        if abs(force) > self.trip_gwt:
            self.trip(f"force {force:.2f} gwt above the {self.which_trip} {self.trip_gwt:.2f} gwt", force)
        self._refuse_long_contact()
        return force

    def _refuse_long_contact(self) -> None:
        longest_s = self.settings.limits.max_contact_s
        if self.contact.total_s > longest_s:
            raise LimitError(
                f"the finger has been touched for {self.contact.total_s:.1f} s in this run, "
                f"limits.max_contact_s = {longest_s:g}"
            )

    def _reading(self) -> ForceReading:
        """A new reading, made when all motion was over. None, no number, or an old one trips."""
        wait_s = self._settle_s if self._moved else self._force.sample_period_s
        self._beat(wait_s)
        self.clock.wait_s(wait_s)
        asked_s = self.clock.monotonic_s()
        try:
            reading = self._force.read()
        except (ForceError, TransportError) as error:
            self.trip(f"no force reading: {error}")
        if not math.isfinite(reading.force_n):
            self.trip(f"the force reading is {reading.force_n}, not a number")
        if reading.t_s < asked_s:
            self.trip(f"the force reading is stale, {asked_s - reading.t_s:.3f} s older than the question")
        self._moved = False
        return replace(reading, force_n=reading.force_n - self._offset_n)

    def doi_mm(self, contact_height_mm: float, force_gwt: float) -> float:
        """Depth past contact: how far the stage has gone, less what the rig itself gives under the force."""
        given_mm = self.settings.calibration.value("compliance_mm_per_n", 0.0) * force_gwt * GWT_N
        return contact_height_mm - self.height_mm - given_mm

    def doi_sd_mm(self, force_gwt: float) -> float:
        """How well a depth past contact is known from travel and compliance: a step of the stage, and sd · force."""
        compliance = self.settings.calibration.compliance_mm_per_n
        given_mm = 0.0 if compliance is None else compliance.sd * force_gwt * GWT_N
        return math.hypot(self.settings.stage.resolution_mm / math.sqrt(12), given_mm)

    def pulse(self, press: PressId, at: str) -> None:
        """Tell the recording amplifier that this is the instant, where an output is configured; of data only.

        rise_s is when the device had confirmed the rise, uncertainty_s how long before that it may have been.
        """
        sync = self.settings.sync
        if sync.output == "off" or press.purpose != "data":
            return
        asked_s = self.clock.monotonic_s()
        self._guarded(lambda: self._stage.set_output(True))
        rise_s = self.clock.monotonic_s()
        self.clock.wait_s(sync.width_s)
        self._guarded(lambda: self._stage.set_output(False))
        width_s = self.clock.monotonic_s() - rise_s
        self.record(
            "sync",
            {
                "index": press.index,
                "at": at,
                "rise_s": round(rise_s, 6),
                "uncertainty_s": round(rise_s - asked_s, 6),
                "width_s": round(width_s, 6),
            },
        )

    def safe_point(self) -> None:
        """Where an operator's pause takes effect: lift and journal; then go on, or raise RunAborted.

        Raises PressPaused where the lift has interrupted an indentation.
        """
        if not self._interrupted():
            return
        pressing = self.state is State.IN_CONTACT
        if pressing:
            self.retract()
        self.record("paused", {"reason": "operator"})
        if not self._go_on():
            raise RunAborted("stopped by the operator at a safe point; the indentor is lifted")
        self.record("resumed", {"by": "operator"})
        if pressing:
            raise PressPaused("paused by the operator")

    def alarm(self, reason: str) -> None:
        """Something has left its band: journalled, and a trip where limits.on_alarm says so."""
        self.record("alarm", {"reason": reason})
        if self.settings.limits.on_alarm == "trip":
            self.trip(reason)

    def trip(self, reason: str, force_gwt: float | None = None) -> NoReturn:
        """Latch, do what limits.on_trip says, journal, raise TripError.

        Between increments the stage is at rest and its position trusted, so that it can be lifted. Where it was
        stopped, or a lift fails, it is held where it is.
        """
        self.state, self.problem = State.TRIPPED, TripError(reason)
        try:
            if self.settings.limits.on_trip == "stop":
                self.stop()
            elif not self._heartbeat.lost:
                self._lift(self._trip_height_mm)
        except (StageError, TransportError) as error:
            reason = f"{reason}; and the lift failed: {error}"
        self._heartbeat.rest()
        self.state, self.problem = State.TRIPPED, TripError(reason)
        with contextlib.suppress(RecordError):  # the trip says more
            self.record("trip", {"reason": reason, "force_gwt": force_gwt, "contact_s": self._contact_s})
        raise self.problem

    def make_safe(self) -> None:
        """After a failure elsewhere: lift where the stage is at rest and trusted, stop it where that fails."""
        if self.state is State.IN_CONTACT:
            try:
                self._lift(self.settings.habits.clearance_mm)
                self._lifted()
            except (StageError, TransportError, TripError):
                self.stop()
        self._heartbeat.rest()

    def record(self, stream: str, data: Mapping[str, Any]) -> None:
        """Journal an event; it is on disk when this returns. Where that fails: lift, and raise RecordError."""
        try:
            self._journal.event(stream, data)
        except RecordError as error:
            self.problem = self.problem or error
            self.make_safe()
            raise

    def stop(self) -> None:
        """Quick stop past every queue; the position is not trusted afterwards, a trip stays latched."""
        if self.state is not State.TRIPPED:
            self.state = State.UNHOMED
        self._heartbeat.rest()
        self._stop_stage()

    def _stop_stage(self) -> None:
        with contextlib.suppress(StageError, TransportError):  # whoever calls has the first error to report
            self._stage.stop()

    def _beat(self, longer_s: float = 0.0) -> None:
        """Tell the heartbeat that all is well, where there is something to watch; too late is lost."""
        self._heartbeat.look()
        if self._heartbeat.lost and self.state is not State.TRIPPED:
            self.trip("the engine's heartbeat was lost: the stage was stopped and stays where it is")
        if self._may_touch:
            self._heartbeat.beat(self.settings.limits.heartbeat_s + longer_s)

    def _lift(self, to_mm: float) -> None:
        if self.height_mm < to_mm - _AT_MM:
            self.go_to_height(to_mm, self.settings.habits.travel_speed_mm_s)

    def _lifted(self) -> None:
        """Nothing is touched any more."""
        self.state, self._may_touch, self._area_trip_gwt = State.READY, False, math.inf
        self._heartbeat.rest()
        self.contact.end()

    @property
    def _contact_s(self) -> float:
        return round(self.contact.total_s, 6)

    @property
    def _trip_height_mm(self) -> float:
        """Clearance; farther up where that is configured, or where clearance is not clear."""
        habits, highest = self.settings.habits, -self.settings.frame.apex_z_mm
        far = self.settings.limits.on_trip == "park" or self.height_mm > habits.clearance_mm - _AT_MM
        if not far:
            return habits.clearance_mm
        return min(max(habits.park_height_mm, self.height_mm + habits.clearance_mm), highest)

    @property
    def _settle_s(self) -> float:
        return self.settings.habits.settle_readings * self._force.sample_period_s + self.settings.force.latency_s

    def _require_clear(self, verb: str) -> None:
        if self.state is not State.READY:
            raise NotReadyError(f"{verb}: not allowed while {self.state.value}")

    def _guarded(self, action: Callable[[], _T]) -> _T:
        """Run a call to the stage; its failure stops the stage before it is passed on."""
        try:
            return action()
        except (StageError, TransportError) as error:
            self.problem = self.problem or error
            self.stop()
            raise

    def _go_to_clearance(self, speed_mm_s: float) -> None:
        """Down to clearance; the first time since homing step by step, since frame and screw may not be right."""
        habits = self.settings.habits
        clearance = habits.clearance_mm
        while self._zeroed and self.height_mm > clearance + habits.descent_step_mm:
            self.go_to_height(self.height_mm - habits.descent_step_mm, speed_mm_s)
            self._refuse_contact(self._reading().force_n / GWT_N)
        self.go_to_height(clearance, speed_mm_s)
        if self._zeroed:
            self._refuse_contact(self.read_force_gwt(NO_PRESS, "clearance"))

    def _refuse_contact(self, force_gwt: float) -> None:
        if abs(force_gwt) >= self.touch_gwt:
            self.trip(
                f"{force_gwt:.2f} gwt at clearance, {self.height_mm:.2f} mm above the nominal apex: "
                "is frame.apex_z_mm right, and the sensor zeroed?",
                force_gwt,
            )
