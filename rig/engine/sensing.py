"""Force readings that can be relied on, their zero and their noise."""

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from rig.clock import Clock, real_s
from rig.devices.base import (
    LOOK_S,
    ForceBusy,
    ForceError,
    ForceOverload,
    ForceReading,
    ForceSensor,
    ForceUnderload,
    ZeroedByDriver,
)
from rig.devices.registry import ForceKind, find
from rig.errors import RigError
from rig.settings import RigSettings
from rig.transport.wire import TransportError
from rig.units import GWT_N

_OUT_OF_RANGE = (ForceOverload, ForceUnderload, ForceBusy)
_READINGS_AT_ZERO = 12
BUSY_S = 1.0
"""How long a busy instrument may delay a reading at rest (s); in motion it counts as no reading."""

NOISE_WIDTH = 6.0
"""Standard deviations of noise that count as one step."""

NOISE_STEPS = 10.0
"""Largest noise of a zero in steps of the sensor."""

APART_S = 0.5
"""Time between the two readings of a force at rest (s)."""
AT_REST_S = 3.0
"""Longest wait for a touch to vanish or for readings to agree (s): the sensor may be late or slow."""
_POLL_S, _TINY_S = 0.1, 1e-6


Meanwhile = Callable[[float], object]
"""Called before each wait for a reading, with the length of the wait (s)."""


def _nothing(wait_s: float) -> None:
    pass


class NoReadingError(RigError):
    """Error of a missing or unreliable reading."""

    default_code = "no_reading"

    @property
    def out_of_range(self) -> bool:
        """Whether the sensor works, but the force is out of its range."""
        return isinstance(self.__cause__, _OUT_OF_RANGE)


@dataclass(frozen=True)
class ReadingListener:
    """Receiver of each raw reading, and of each failure in words."""

    on_reading: Callable[[ForceReading], None] = lambda reading: None
    on_failure: Callable[[str], None] = lambda problem: None


_NOBODY = ReadingListener()


def read(
    sensor: ForceSensor,
    clock: Clock,
    wait_s: float,
    max_age_s: float = math.inf,
    listener: ReadingListener = _NOBODY,
) -> ForceReading:
    """Return a reading taken after the wait.

    Raises NoReadingError if it is missing, not a number, stale, or came later than max_age_s after its request.
    """
    clock.wait_s(wait_s)
    requested_s = clock.monotonic_s()
    try:
        reading = sensor.read()
    except (ForceError, TransportError) as error:
        listener.on_failure(str(error))
        raise NoReadingError(f"no force reading: {error}") from error
    listener.on_reading(reading)
    if not math.isfinite(reading.force_n):
        raise NoReadingError(f"the force reading is {reading.force_n}, not a number", "not_a_number")
    if reading.t_s < requested_s:
        raise NoReadingError(
            f"the force reading is stale: the sensor took it {requested_s - reading.t_s:.3f} s before the request",
            "stale_reading",
        )
    age_s = clock.monotonic_s() - requested_s
    if age_s > max_age_s + _TINY_S:
        raise NoReadingError(
            f"the force reading took {age_s:.3f} s, longer than the maximum sample age of the sensor, "
            f"{max_age_s:g} s",
            "too_old",
        )
    return reading


def zero_readings_gwt(reading: Callable[[], ForceReading]) -> list[float]:
    """Return the readings for a zero (gwt)."""
    return [reading().force_n / GWT_N for _ in range(_READINGS_AT_ZERO)]


@dataclass(frozen=True)
class ForceZero:
    """Zero of a force sensor: offset without contact, and standard deviation of single readings."""

    offset_n: float
    noise_gwt: float
    provisional: bool = False  # Taken at an unknown position: readings from it are changes, not forces.

    @classmethod
    def of(cls, readings_gwt: Sequence[float], *, provisional: bool = False) -> "ForceZero":
        """Return the zero from readings without contact (gwt)."""
        return cls(statistics.fmean(readings_gwt) * GWT_N, statistics.pstdev(readings_gwt), provisional)

    def without_offset(self, reading: ForceReading) -> ForceReading:
        """Return the reading without the offset."""
        return replace(reading, force_n=reading.force_n - self.offset_n)


@dataclass(frozen=True)
class MotionForce:
    """What the forces of one motion are counted from and compared with.

    baseline_n: subtracted from each reading; None if the force is not monitored. before_gwt: force before the motion;
    infinite if it is unknown. shakes_gwt: force of the stage's own motion, which vanishes at rest.
    """

    away: bool = False  # begins by leaving the finger
    baseline_n: float | None = 0.0
    before_gwt: float = 0.0
    shakes_gwt: float = 0.0


class Sensing:
    """One force sensor: forces in gwt, depths in mm."""

    def __init__(
        self, settings: RigSettings, clock: Clock, sensor: ForceSensor, listener: ReadingListener = _NOBODY
    ) -> None:
        self.sensor, self._listener, self.moved = sensor, listener, True  # moved: since the last settled reading.
        self.zero: ForceZero | None = None  # zero that forces are counted from
        self.max_age_s = find(ForceKind, settings.force.kind).max_age_s(settings.force)
        self._settings, self._clock = settings, clock
        self._at_rest_n = 0.0  # last settled reading, before the zero
        self._read_s = -math.inf  # arrival of the last reading

    def connect(self) -> str:
        """Connect the sensor and return its identity. Raises ForceError."""
        return self.sensor.connect()

    @property
    def zeroed(self) -> bool:
        """Whether forces are counted from a zero."""
        return self.zero is not None

    @property
    def absolute(self) -> bool:
        """Whether forces are counted from a zero taken in the air."""
        return self.zero is not None and not self.zero.provisional

    @property
    def resolution_gwt(self) -> float:
        """Smallest step of the sensor (gwt)."""
        return self.sensor.resolution_gwt

    @property
    def least_gwt(self) -> float:
        """Smallest significant force (gwt), twice the detection limit: one step of the sensor, or its noise."""
        return max(self.resolution_gwt, NOISE_WIDTH * self.noise_gwt)

    @property
    def noise_gwt(self) -> float:
        """Standard deviation of single readings (gwt), measured at each zero, at most `NOISE_STEPS` steps.

        A finger that moved while the readings were taken must not raise the touch threshold.
        """
        return 0.0 if self.zero is None else min(self.zero.noise_gwt, NOISE_STEPS * self.resolution_gwt)

    @property
    def touch_gwt(self) -> float:
        """Reading that means contact (gwt): as configured, or well above the noise."""
        return self.touch_with_noise_gwt(self.noise_gwt)

    def touch_with_noise_gwt(self, noise_gwt: float) -> float:
        """Return the reading that means contact (gwt) where single readings scatter by this."""
        return max(self._settings.habits.touch_force_gwt, self.resolution_gwt, NOISE_WIDTH * noise_gwt)

    @property
    def wait_s(self) -> float:
        """Time until a reading shows the present force (s): the settling time after a move, else one sample."""
        return self.settle_s if self.moved else self.sensor.sample_period_s

    @property
    def settle_s(self) -> float:
        """Time from the end of a move to a reading that is unaffected by it (s)."""
        return self._settings.habits.settle_readings * self.sensor.sample_period_s + self._settings.force.latency_s

    @property
    def has_new_reading(self) -> bool:
        """Whether the last reading is no older than one sample, or than one look at a motion."""
        return real_s(self._clock) - self._read_s <= max(self.sensor.sample_period_s, LOOK_S) + _TINY_S

    def now(self) -> ForceReading:
        """Return the newest reading from zero without waiting for rest. Raises NoReadingError."""
        return self.from_zero(self._read(0.0))

    def settled(self, meanwhile: Meanwhile = _nothing) -> ForceReading:
        """Return a new reading from zero, taken at rest. Raises NoReadingError."""
        return self.from_zero(self.raw(meanwhile))

    def raw(self, meanwhile: Meanwhile = _nothing) -> ForceReading:
        """Return the same reading without a zero; retry a busy sensor for BUSY_S. Raises NoReadingError."""
        until_s = self._clock.monotonic_s() + self.wait_s + BUSY_S
        while True:
            meanwhile(self.wait_s)
            try:
                reading = self._read(self.wait_s)
            except NoReadingError as error:
                if not isinstance(error.__cause__, ForceBusy) or self._clock.monotonic_s() >= until_s:
                    raise
            else:
                self.moved, self._at_rest_n = False, reading.force_n
                return reading

    def at_rest_gwt(self, meanwhile: Meanwhile = _nothing) -> float:
        """Return the force from zero at rest (gwt).

        Below the touch threshold two readings, `APART_S` apart, must agree, because the reading of a touch passes
        through zero while the sensor drifts. A touch must persist for `AT_REST_S`, because a late sensor or a slow
        cell still shows it in the air. Raises NoReadingError if the sensor does not respond, or (`unsteady`) its
        readings do not agree within `AT_REST_S`.
        """
        until_s, before_gwt = self._clock.monotonic_s() + AT_REST_S, None
        while True:
            force_gwt = round(self.settled(meanwhile).force_n / GWT_N, 6)
            late = self._clock.monotonic_s() >= until_s
            if abs(force_gwt) >= self.touch_gwt:
                if late:
                    return force_gwt
                before_gwt = None
                continue
            if before_gwt is not None:
                if self.agree((before_gwt, force_gwt)):
                    return force_gwt
                if late:
                    raise NoReadingError(
                        f"the force at rest changed from {before_gwt:.2f} to {force_gwt:.2f} gwt in {APART_S:g} "
                        "s: the sensor drifts",
                        "unsteady",
                    )
            before_gwt = force_gwt
            self._pause(APART_S - self.wait_s, meanwhile)

    def agree(self, forces_gwt: Sequence[float]) -> bool:
        """Return whether forces below a touch differ by no more than half of one, or by the noise."""
        return max(forces_gwt) - min(forces_gwt) <= max(self.touch_gwt / 2, self.least_gwt)

    def _pause(self, seconds: float, meanwhile: Meanwhile) -> None:
        until_s = self._clock.monotonic_s() + seconds
        while (left_s := until_s - self._clock.monotonic_s()) > _TINY_S:
            meanwhile(min(left_s, _POLL_S))
            self._clock.wait_s(min(left_s, _POLL_S))

    def begin_motion(self, *, away: bool, shakes_gwt: float = 0.0) -> MotionForce:
        """Read what the forces of a motion count from: its zero, or without one the reading before the motion.

        away: the motion begins by leaving the finger. If the sensor is out of range before such a motion, its force
        is not monitored; with a zero, the sensor need not respond at all, since nothing may hold the indentor on
        the finger. Raises NoReadingError.
        """
        rested, self.moved = not self.moved, True
        begun = MotionForce(away=away, shakes_gwt=shakes_gwt)
        if self.zeroed and not away:
            return begun
        try:
            before_n = self._at_rest_n if rested and self.zeroed else self._read(0.0).force_n
        except NoReadingError as error:
            if not (away and (self.zeroed or error.out_of_range)):
                raise
            return replace(begun, baseline_n=0.0 if self.zeroed else None, before_gwt=math.inf)
        if self.zero is None:
            return replace(begun, baseline_n=before_n)
        return replace(begun, before_gwt=(before_n - self.zero.offset_n) / GWT_N)

    def unloads(self, begun: MotionForce, force_gwt: float) -> bool:
        """Return whether a motion leaves the finger and this force is no reason to end it.

        A falling force never is. A growing push is, and a growing pull if the zero was taken in the air: without
        one, a pull and an unloading look the same. A force grows by more than the touch threshold and shakes_gwt.
        """
        if not begun.away:
            return False
        before_gwt, grown_gwt = begun.before_gwt, self.touch_gwt + begun.shakes_gwt
        if not self.absolute:
            return force_gwt <= before_gwt + grown_gwt
        return -max(-before_gwt, 0.0) - grown_gwt <= force_gwt <= max(before_gwt, 0.0) + grown_gwt

    def read_in_motion(self, begun: MotionForce) -> ForceReading | None:
        """Return a reading during a motion; None if the force is not monitored. Raises NoReadingError."""
        if begun.baseline_n is None:
            return None
        reading = self.from_zero(self._read(0.0))
        return replace(reading, force_n=reading.force_n - begun.baseline_n)

    @property
    def lasting_zero(self) -> ForceZero | None:
        """Zero for the next command, whose driver subtracts nothing yet."""
        if self.zero is None or not isinstance(self.sensor, ZeroedByDriver):
            return self.zero
        return replace(self.zero, offset_n=self.zero.offset_n + self.sensor.subtracted_n)

    def take_zero(self, readings_gwt: Sequence[float], *, provisional: bool = False) -> ForceZero:
        """Count forces from the mean of these readings; provisional: contact is possible."""
        self.zero = ForceZero.of(readings_gwt, provisional=provisional)
        return self.zero

    def _read(self, wait_s: float) -> ForceReading:
        self._read_s = -math.inf
        reading = read(self.sensor, self._clock, wait_s, self.max_age_s, self._listener)
        self._read_s = real_s(self._clock)
        return reading

    def from_zero(self, reading: ForceReading) -> ForceReading:
        """Return a reading counted from the zero, if there is one."""
        return reading if self.zero is None else self.zero.without_offset(reading)

    def deflection_mm(self, force_gwt: float) -> float:
        """Return the deflection of the rig under a force (mm)."""
        return self._settings.calibration.value("compliance_mm_per_n", 0.0) * force_gwt * GWT_N

    def doi_sd_mm(self, force_gwt: float) -> float:
        """Return the standard deviation of a depth (mm) from the step of the stage and the compliance."""
        compliance = self._settings.calibration.compliance_mm_per_n
        deflection_mm = 0.0 if compliance is None else compliance.sd * force_gwt * GWT_N
        return math.hypot(self._settings.stage.resolution_mm / math.sqrt(12), deflection_mm)
