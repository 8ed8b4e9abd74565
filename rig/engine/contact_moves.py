"""Moves in contact: increments and ramps that stay below the trips, and what every reading of one must show."""

import math

from rig.data.events import RampEvent
from rig.devices.base import ForceReading
from rig.engine.engine import Engine
from rig.engine.limits import CONTACT_EXPONENT, TRIP_MARGIN, RampBound, late_reading_s, reading_delay_s
from rig.engine.motion import PRINTED_MM, InterruptedMotionError, Outcome
from rig.engine.sync_pulse import pulse
from rig.engine.verbs import safe_point
from rig.errors import LateReading, LimitError, TripError
from rig.records import ContactFit, Phase, PressId
from rig.units import GWT_N

_MOVES, _STEPS, _SHARE = 3, 5, 0.1
# Share of the touch threshold: less force one increment below the touch means that the finger is gone.
_LOST_SHARE = 0.5


class FrozenReading:
    """Detector of a reading that stays the same although the finger must push harder, or less.

    least_moved: motion, in the unit of `stays`, before which a reading may still be on its way; moves by default.
    """

    def __init__(self, resolution_gwt: float, least_moved: float = _MOVES) -> None:
        self._resolution_gwt, self._least_moved = resolution_gwt, least_moved
        self._changed_gwt = math.nan  # reading at the last change
        self._moved = self._expected_gwt = 0.0  # since then

    def stays(self, force_gwt: float, expected_gwt: float, moved: float, before_gwt: float | None = None) -> bool:
        """Return whether the reading has stayed for too long.

        expected_gwt, moved: change of the force expected since the last call, and the motion since. before_gwt:
        reading to compare with, by default that of the last change.
        """
        compared_gwt = self._changed_gwt if before_gwt is None else before_gwt
        if not abs(force_gwt - compared_gwt) <= 0.5 * self._resolution_gwt:
            self._changed_gwt, self._moved, self._expected_gwt = force_gwt, 0.0, 0.0
            return False
        self._moved += moved
        self._expected_gwt += expected_gwt
        enough_gwt = max(_STEPS * self._resolution_gwt, _SHARE * force_gwt)
        return self._moved >= self._least_moved and self._expected_gwt > enough_gwt


def pull_in_descent(force_gwt: float) -> TripError:
    """Return the trip of a sensor that reads a pull where a finger can only push."""
    return TripError(
        f"the sensor reads {force_gwt:.2f} gwt (a pull) during the descent; check its sign and mounting",
        "reads_backwards",
    )


class ContactMoves:
    """Depth and force of one press from its touch-off on, and the only moves that change them."""

    def __init__(self, engine: Engine, press: PressId, touch: ContactFit, speed_mm_s: float) -> None:
        self.engine, self.id, self._touch, self._speed = engine, press, touch, speed_mm_s
        self.habits, self.smallest_mm = engine.settings.habits, engine.settings.stage.resolution_mm
        self.force_gwt = touch.force_gwt
        self.stiffness_gwt_mm = 0.0  # of the last move
        self.peak_gwt = 0.0  # highest reading since the last hold
        # force and time at contact, or at the end of the last hold
        self.ramp_from = (touch.force_gwt, engine.clock.monotonic_s())
        self._frozen = FrozenReading(engine.sensing.resolution_gwt)

    @property
    def contact_mm(self) -> float:
        """Height of contact above the nominal apex (mm)."""
        return self._touch.contact_height_mm

    @property
    def doi_mm(self) -> float:
        """Depth past contact (mm)."""
        return self.engine.doi_mm(self._touch.contact_height_mm, self.force_gwt)

    def press_by(self, step_mm: float, phase: Phase = "press") -> None:
        """Make one move: at most an increment, not past the soft trip at the present stiffness, not too deep."""
        engine, trips = self.engine, self.engine.trips
        safe_point(engine)
        room = TRIP_MARGIN * self.to_force(trips.lowest_gwt)
        if room < min(step_mm, self.smallest_mm):
            raise LimitError(
                f"the next move at x = {engine.x_mm:g} mm would exceed the {trips.lowest} of "
                f"{trips.lowest_gwt:.2f} gwt",
                f"next_move_past_{trips.lowest.replace(' ', '_')}",
            )
        step = max(min(step_mm, self.habits.increment_mm, room), -self.habits.increment_mm)
        doi_mm, before_gwt = self.doi_mm, self.force_gwt
        self._refuse_too_deep(doi_mm + step)
        doi_mm = max(doi_mm, self.smallest_mm)
        expected_gwt = before_gwt * (max(doi_mm + step, 0.0) / doi_mm) ** CONTACT_EXPONENT
        engine.go_to_height(engine.height_mm - step, self._speed)
        self.force_gwt = self.read(phase)
        if abs(step) >= self.smallest_mm:
            self.stiffness_gwt_mm = (self.force_gwt - before_gwt) / step
        if self._frozen.stays(self.force_gwt, abs(expected_gwt - before_gwt), 1, before_gwt):
            engine.trip(_stays(self.force_gwt), self.force_gwt)

    def to_force(self, force_gwt: float) -> float:
        """Return the move (mm) that reaches a force on F ∝ d^1.5 through the present reading."""
        present = max(self.force_gwt, 0.5 * self.habits.touch_force_gwt)
        return max(self.doi_mm, self.smallest_mm) * ((force_gwt / present) ** (1 / CONTACT_EXPONENT) - 1)

    def read(self, phase: Phase) -> float:
        """Read the force at rest (gwt); trip beyond a limit, without a reading, or if the finger is lost."""
        force = self.engine.read_force_gwt(self.id, phase, self._touch.contact_height_mm)
        self.peak_gwt = max(self.peak_gwt, force)
        if lost := self._lost_finger(force):
            self.engine.trip(lost, force)
        return force

    def ramp_to(self, doi_mm: float, bound: RampBound) -> None:
        """Move to a depth at constant speed from above the skin.

        Each reading is compared with the trip of the ramp as it arrives, then journalled. A ramp also trips if the
        stage covers more than it may without a reading, and at a reading that is too small for a finger. Raises
        LateReading, at rest, after a reading that came too late.
        """
        engine, speed_mm_s = self.engine, bound.speed_mm_s
        self._refuse_too_deep(doi_mm)
        safe_point(engine)
        to_mm = self._touch.contact_height_mm - doi_mm - engine.sensing.deflection_mm(bound.force_gwt)
        engine.limit_depth(to_mm - self.habits.increment_mm)
        engine.trips.ramp_at(bound.trip_gwt)
        start = RampEvent(
            index=self.id.index,
            speed_mm_s=speed_mm_s,
            measured_gwt=bound.force_gwt,
            trip_gwt=bound.trip_gwt,
            bound_gwt=bound.bound_gwt,
            stop_mm=round(bound.stop_mm, 6),
        )
        engine.record(start, self.id)
        pulse(engine, self.id, "ramp")
        self.peak_gwt, self.ramp_from = 0.0, (0.0, engine.clock.monotonic_s())
        unread_s = late_reading_s(engine.settings)
        unread_mm = speed_mm_s * unread_s + self.smallest_mm + PRINTED_MM
        late_mm = speed_mm_s * reading_delay_s(engine.settings)
        before_mm, before_gwt = engine.height_mm, 0.0
        frozen = FrozenReading(engine.sensing.resolution_gwt, late_mm)

        def on_reading(reading: ForceReading) -> None:
            nonlocal before_mm, before_gwt
            force = round(reading.force_n / GWT_N, 6)
            gone_mm, before_mm = before_mm - engine.height_mm, engine.height_mm
            self.peak_gwt = max(self.peak_gwt, force)
            here_mm = engine.doi_mm(self._touch.contact_height_mm, force)
            engine.record_in_motion(self.id, "ramp", reading, here_mm)
            if gone_mm > unread_mm:
                raise InterruptedMotionError(
                    f"the stage moved by {gone_mm:.3f} mm without a force reading, farther than the "
                    f"{unread_mm:.3f} mm that a ramp may",
                    "ramp_unread",
                    force,
                )
            if lost := self._lost_finger(force, late_mm):
                raise InterruptedMotionError(str(lost), lost.code, force)
            expected_gwt = bound.force_gwt * (max(here_mm, 0.0) / doi_mm) ** CONTACT_EXPONENT
            risen_gwt, before_gwt = expected_gwt - before_gwt, expected_gwt
            feels = force >= _LOST_SHARE * self._touch.threshold_gwt  # Below, the finger is lost, or not yet reached.
            if feels and frozen.stays(force, risen_gwt, gone_mm):
                stays = _stays(force)
                raise InterruptedMotionError(str(stays), stays.code, force)

        if engine.go_to_height(to_mm, speed_mm_s, on_reading=on_reading) is Outcome.LATE:
            raise LateReading(
                f"a force reading of a ramp at x = {engine.x_mm:g} mm came later than {unread_s:g} s after the one "
                "before; close other programs on this computer, or use a faster force sensor"
            )
        safe_point(engine)  # A pause ends the ramp.
        self.force_gwt = self.read("ramp")

    def _refuse_too_deep(self, doi_mm: float) -> None:
        deepest = self.engine.settings.limits.max_doi_mm
        if doi_mm > deepest + 1e-9:
            raise LimitError(
                f"DOI {doi_mm:.3f} mm at x = {self.engine.x_mm:g} mm would exceed limits.max_doi_mm = {deepest:g} mm",
                "too_deep",
            )

    def _lost_finger(self, force_gwt: float, late_mm: float = 0.0) -> TripError | None:
        """Return the trip of a force below the touch that is too small for a finger, or a pull, else None.

        late_mm: distance that the stage covers while a reading ages.
        """
        below_mm = self._touch.height_at_threshold_mm - self.engine.height_mm
        seen = force_gwt >= _LOST_SHARE * self._touch.threshold_gwt
        if seen or below_mm < self.habits.increment_mm + late_mm - 1e-9:
            return None
        return TripError(
            f"the sensor reads {force_gwt:.2f} gwt {below_mm:.2f} mm below the touch; check its cable and sign, "
            "and whether the finger has moved away",
            "lost_finger",
        )


def _stays(force_gwt: float) -> TripError:
    return TripError(
        f"the force stays at {force_gwt:.2f} gwt while the stage moves; check for a frozen reading or a stalled "
        "motor",
        "frozen",
    )
