"""Force limits of manual control."""

import math
from collections.abc import Callable

from rig.engine.limits import TRIP_MARGIN, FingerStiffness, SidewaysLimit, Trips
from rig.engine.motion import InterruptedMotionError
from rig.engine.press import FrozenReading
from rig.engine.sensing import MotionForce, NoReadingError, Sensing, zero_readings_gwt
from rig.errors import LimitError, TripError
from rig.settings import RigSettings
from rig.units import GWT_N

_LOST_INCREMENTS = 2.0


class Guard:
    """Guard of the force (gwt) in the motions of one program; heights are machine z (mm).

    A touch is measured from the force before the motion, so that a drift of an old zero does not hide it, and
    sideways from the zero as well, so that a touch of before does not hide it either; trips count from the zero.
    """

    def __init__(self, settings: RigSettings, sensing: Sensing) -> None:
        self._settings, self._sensing, self._trips = settings, sensing, Trips(settings.limits, None)
        self._increment_mm = settings.habits.increment_mm
        self.force_gwt: float | None = None  # last force; None if the sensor has no reading
        self.forget()
        # State of each motion, from `begin` on.
        self._up: bool
        self._sideways: bool
        self._unanswered: FrozenReading
        self._air_gwt: float  # before the motion that touched
        self._rest_gwt: float  # at the last rest
        self._stiffness_gwt_mm: float  # of the last step
        self._begun: MotionForce

    def forget(self) -> None:
        """Forget the last touch, since the heights or the zero have changed."""
        self._touched_z_mm: float | None = None

    @property
    def above_trip(self) -> TripError | None:
        """Trip that the last reading exceeds, or None."""
        return None if self.force_gwt is None else self._trips.passed_any(self.force_gwt)

    @property
    def from_air_gwt(self) -> float | None:
        """Last force from a zero taken in the air (gwt); None without such a zero."""
        return self.force_gwt if self._sensing.absolute else None

    def refuse_contact(self, meanwhile: Callable[[float], object]) -> None:
        """Raise LimitError if the force at rest is a touch or does not settle."""
        problem = self.read_at_rest(meanwhile)
        if problem is not None and problem.code == "unsteady":
            words = (
                f"{problem}; no lateral motion after a touch: move up first, or use "
                "`rig zero --anyway` if nothing touches the indentor"
            )
            raise LimitError(words, problem.code)
        force_gwt = self.from_air_gwt
        if force_gwt is not None and abs(force_gwt) >= self.touch_gwt:
            raise LimitError(
                f"the sensor reads {force_gwt:.2f} gwt; no lateral motion after a touch: move up first, or use "
                "`rig zero --anyway` if nothing touches the indentor",
                "touches_still",
            )
        self._begun = self._sensing.begin_motion(away=False)

    @property
    def touch_gwt(self) -> float:
        """Force that means contact (gwt)."""
        return self._sensing.touch_gwt

    @property
    def may_be_a_touch(self) -> bool:
        """Whether the last force is a touch, or nothing shows that it is none."""
        return self.from_air_gwt is None or abs(self.from_air_gwt) >= self.touch_gwt

    @property
    def sideways_mm_s(self) -> float:
        """Highest speed sideways (mm/s), at which a touch ends a motion below half the soft trip."""
        trip_gwt, unknown = self._trips.lowest_gwt, FingerStiffness.unknown()
        return SidewaysLimit.of(self._settings, trip_gwt, self.touch_gwt, unknown).speed_mm_s

    @property
    def room_mm(self) -> float:
        """Distance down (mm) to nine tenths of the soft trip, at the stiffness of the last step."""
        if self._stiffness_gwt_mm <= 0:
            return math.inf
        return max(TRIP_MARGIN * self._trips.lowest_gwt - self._rest_gwt, 0.0) / self._stiffness_gwt_mm

    def begin(self, *, up: bool, down: bool) -> None:
        """Begin a motion. Raises LimitError if there is no force, or, except upwards, if it exceeds a trip.

        Upwards a sensor may be out of range, but it must respond. Sideways there must be a zero taken in the air,
        because without one a touch of before cannot be measured.
        """
        self._up, self._unanswered = up, FrozenReading(self._sensing.resolution_gwt)
        self._sideways, self.force_gwt = not (up or down), None
        if self._sideways and not self._sensing.absolute:
            raise LimitError(
                "the force sensor has no zero, so a touch cannot be measured; nothing was moved: use `rig zero` "
                "while nothing touches the indentor; to move without force, use --without-force",
                "not_zeroed",
            )
        try:
            if not self._sensing.zeroed:
                self._sensing.take_zero(zero_readings_gwt(self._sensing.raw), provisional=True)
            self._rest_gwt = self._sensing.settled().force_n / GWT_N
            self._begun = self._sensing.begin_motion(away=up)
        except NoReadingError as error:
            if not (up and error.out_of_range):
                words = f"{error}; nothing was moved; to move without force, use --without-force"
                raise LimitError(words, error.code) from error
            self.force_gwt, self._touched_z_mm = None, None
            self._begun = self._sensing.begin_motion(away=up)
            return
        self.force_gwt = self._rest_gwt
        if (above := self.above_trip) and not up:
            words = f"{above}; nothing was moved: move up first, or run `rig zero`"
            raise LimitError(words, above.code)
        if not (down and self._touched_z_mm is not None):
            self._touched_z_mm, self._air_gwt, self._stiffness_gwt_mm = None, self._rest_gwt, 0.0

    def read_at_rest(self, meanwhile: Callable[[float], object]) -> NoReadingError | None:
        """Read the force at rest if it counts from a zero taken in the air; return the error if there is no force.

        meanwhile is called before each wait with its length (s).
        """
        if not self._sensing.absolute:
            self.look()
            return None
        try:
            self.force_gwt = self._sensing.at_rest_gwt(meanwhile)
        except NoReadingError as error:
            self.force_gwt = None
            return error
        return None

    def look(self) -> None:
        """Read the force between motions; a missing reading does no harm."""
        try:
            self.force_gwt = self._sensing.settled().force_n / GWT_N
        except NoReadingError:
            self.force_gwt = None

    def glance(self, z_mm: float) -> None:
        """Check the force during a motion.

        Raises InterruptedMotionError; upwards only for a force that grew past a trip.
        """
        try:
            reading = self._sensing.read_in_motion(self._begun)
            self.force_gwt = None if reading is None else reading.force_n / GWT_N
        except NoReadingError as error:
            self.force_gwt = None
            if not self._up:
                raise InterruptedMotionError(str(error), error.code) from error
        if self.force_gwt is None or self._sensing.unloads(self._begun, self.force_gwt):
            return
        self._refuse_trip(self.force_gwt)
        if not self._up:
            self._refuse_touch(z_mm, self.force_gwt)

    def rest(self, z_mm: float, step_mm: float) -> None:
        """Check the force at rest after a step down. Raises InterruptedMotionError."""
        before_gwt = self._rest_gwt
        try:
            force_gwt = self._sensing.settled().force_n / GWT_N
        except NoReadingError as error:
            self.force_gwt = None
            raise InterruptedMotionError(str(error), error.code) from error
        self.force_gwt = self._rest_gwt = force_gwt
        self._refuse_trip(force_gwt)
        if force_gwt <= self._air_gwt - self._sensing.touch_gwt:
            words = f"the sensor reads {force_gwt:.2f} gwt (a pull) during the descent; check its sign and mounting"
            raise InterruptedMotionError(words, "reads_backwards", force_gwt)
        self._refuse_silence(before_gwt, force_gwt, z_mm, step_mm)
        if step_mm > 0 and force_gwt - before_gwt > 0.5 * self._sensing.resolution_gwt:
            self._stiffness_gwt_mm = (force_gwt - before_gwt) / step_mm
        self._refuse_touch(z_mm, force_gwt)

    def _refuse_silence(self, before_gwt: float, force_gwt: float, z_mm: float, step_mm: float) -> None:
        """Raise if the sensor responded to the finger before, and no longer does farther down."""
        if self._touched_z_mm is None:
            return
        if z_mm < self._touched_z_mm - _LOST_INCREMENTS * self._increment_mm and not self._touches(force_gwt):
            raise InterruptedMotionError(
                f"{force_gwt:.2f} gwt, {self._touched_z_mm - z_mm:.2f} mm below a touch; check for a frozen reading",
                "lost_finger",
                force_gwt,
            )
        # A touch found during a motion has no stiffness yet; it is at least the touch force per increment.
        stiffness_gwt_mm = self._stiffness_gwt_mm or self._sensing.touch_gwt / self._increment_mm
        if self._unanswered.stays(force_gwt, stiffness_gwt_mm * step_mm, 1, before_gwt):
            words = f"the force stays at {force_gwt:.2f} gwt while the stage moves; check for a frozen reading"
            raise InterruptedMotionError(words, "frozen", force_gwt)

    def _touches(self, force_gwt: float) -> bool:
        touch_gwt = self._sensing.touch_gwt
        return force_gwt - self._air_gwt >= touch_gwt or (self._sideways and abs(force_gwt) >= touch_gwt)

    def _refuse_touch(self, z_mm: float, force_gwt: float) -> None:
        if self._touched_z_mm is None and self._touches(force_gwt):
            self._touched_z_mm = z_mm
            raise InterruptedMotionError(
                f"touched, {force_gwt - self._air_gwt:.2f} gwt more than before; start a new motion to continue",
                "touched",
                force_gwt,
            )

    def _refuse_trip(self, force_gwt: float) -> None:
        passed = self._trips.passed_any(force_gwt)
        if passed:
            raise InterruptedMotionError(str(passed), passed.code, force_gwt)
