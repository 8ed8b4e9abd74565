"""What keeps a finger whole: states, single safe moves, trips, lifts and stops, each on record before it counts."""

import contextlib
import math
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any, NoReturn, TypeVar

from rig.devices.heartbeat import Heartbeat
from rig.devices.stage.base import Stage, StageError
from rig.devices.units import GWT_N
from rig.engine.contact_time import ContactTime
from rig.engine.errors import LimitError, NotReadyError, RecordError, TripError
from rig.engine.journal import Recorder
from rig.engine.rig_settings import RigSettings
from rig.transport.base import TransportError
from rig.transport.clock import Clock

_T = TypeVar("_T")

_AT_MM = 0.02  # heights closer than this are the same place
_LATE_FACTOR = 2.0  # a move may take so many times its length over its speed before the heartbeat is missed


class State(Enum):
    """What the engine may do next."""

    UNHOMED = "unhomed"
    READY = "ready"
    IN_CONTACT = "in contact"  # anywhere below clearance
    TRIPPED = "tripped"


class SafeRig:
    """One stage over one finger; positions are x, along and height above the pad's nominal apex, in mm."""

    def __init__(
        self,
        settings: RigSettings,
        clock: Clock,
        stage: Stage,
        journal: Recorder,
        soft_trip_n: float | None,
        heartbeat: Heartbeat | None,
        contact_s: float,
    ) -> None:
        """contact_s: how long the finger was touched in the parts of the run before this one."""
        self.settings, self.clock = settings, clock
        self.state = State.UNHOMED
        self.x_mm, self.along_mm, self.height_mm = math.nan, 0.0, math.nan
        self.problem: Exception | None = None  # the first trip or failure; a run does not end well after it
        self._stage, self._journal = stage, journal
        self._moved = True  # since the last reading
        self._may_touch = False  # below clearance since the last lift or homing
        limit = settings.limits.soft_trip_n
        self.soft_trip_gwt = (limit if soft_trip_n is None else min(limit, soft_trip_n)) / GWT_N
        self._area_trip_gwt = math.inf
        self._heartbeat = heartbeat or Heartbeat(clock)
        self._heartbeat.stop = self._stop_stage
        self.contact = ContactTime(clock, contact_s)

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

    def press_on(self, contact_area_mm2: float) -> None:
        """From here on the force must not exceed limits.max_pressure_n_cm2 over this area."""
        self._area_trip_gwt = self.settings.limits.max_pressure_n_cm2 * contact_area_mm2 / 100 / GWT_N

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
