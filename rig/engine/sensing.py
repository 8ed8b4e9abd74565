"""What a rig feels: readings that can be relied on, counted from a zero, and what they show in the air."""

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from rig.clock import Clock
from rig.devices.base import ForceBusy, ForceError, ForceOverload, ForceReading, ForceSensor, ForceUnderload
from rig.errors import RigError, code_of
from rig.settings import RigSettings
from rig.transport.wire import TransportError
from rig.units import GWT_N

_OUT_OF_RANGE = (ForceOverload, ForceUnderload, ForceBusy)
_READINGS_AT_ZERO = 12
BUSY_S = 1.0
"""At rest an instrument that has no answer just now is waited for so long; in motion it is no reading."""

_NOISE_WIDTH = 6.0  # standard deviations that a whole step is taken for

APART_S = 0.5
"""Between the two readings that make a force at rest."""
AT_REST_S = 3.0
"""So long a touch, or readings that do not agree, are waited for: a late sensor, a slow cell."""
_LOOK_S, _TINY_S = 0.1, 1e-6


class NoReadingError(RigError):
    """There is no reading, or none to rely on; the message says why."""

    default_code = "no_reading"

    @property
    def out_of_range(self) -> bool:
        """Whether the sensor works, and feels more or less than it can measure."""
        return isinstance(self.__cause__, _OUT_OF_RANGE)


def read(sensor: ForceSensor, clock: Clock, wait_s: float) -> ForceReading:
    """A reading made after the wait. Raises NoReadingError where it is none, no number, or an old one."""
    clock.wait_s(wait_s)
    asked_s = clock.monotonic_s()
    try:
        reading = sensor.read()
    except (ForceError, TransportError) as error:
        raise NoReadingError("no force reading: {error}", error=str(error), error_code=code_of(error)) from error
    if not math.isfinite(reading.force_n):
        raise NoReadingError(
            "the force reading is {force_n}, not a number", code="not_a_number", force_n=reading.force_n
        )
    if reading.t_s < asked_s:
        raise NoReadingError(
            "the force reading is stale: the sensor took it {older_s:.3f} s before the request",
            code="stale_reading",
            older_s=asked_s - reading.t_s,
        )
    return reading


def several_gwt(reading: Callable[[], ForceReading]) -> list[float]:
    """As many readings as a zero is made of."""
    return [reading().force_n / GWT_N for _ in range(_READINGS_AT_ZERO)]


@dataclass(frozen=True)
class ForceZero:
    """What a zeroed sensor still shows with nothing touched: an offset, and the sd of single readings."""

    offset_n: float
    noise_gwt: float
    provisional: bool = False  # taken wherever the indentor was: what it shows then is a change, not a force

    @classmethod
    def of(cls, readings_gwt: Sequence[float], *, provisional: bool = False) -> "ForceZero":
        """Measured."""
        return cls(statistics.fmean(readings_gwt) * GWT_N, statistics.pstdev(readings_gwt), provisional)

    def taken_off(self, reading: ForceReading) -> ForceReading:
        """The reading without the offset."""
        return replace(reading, force_n=reading.force_n - self.offset_n)


class Sensing:
    """One force sensor: forces in gwt, depths in mm."""

    def __init__(self, settings: RigSettings, clock: Clock, sensor: ForceSensor) -> None:
        self.sensor, self.moved = sensor, True  # moved: since the last settled reading
        self.zero: ForceZero | None = None  # what forces are counted from
        self._settings, self._clock = settings, clock
        # of the motion that is under way
        self._felt_from_n: float | None = 0.0
        self.away, self._before_gwt = False, 0.0
        self._at_rest_n = 0.0  # the last settled reading, as the sensor has it

    def connect(self) -> str:
        """Make contact with the sensor; returns its identity. Raises ForceError."""
        return self.sensor.connect()

    @property
    def zeroed(self) -> bool:
        """Whether forces are counted from a zero."""
        return self.zero is not None

    @property
    def absolute(self) -> bool:
        """Whether forces are counted from a zero that was taken in the air."""
        return self.zero is not None and not self.zero.provisional

    @property
    def resolution_gwt(self) -> float:
        """One step of what the force sensor shows."""
        return self.sensor.resolution_gwt

    @property
    def least_gwt(self) -> float:
        """What is less than half of this cannot be told from nothing: one step of the sensor, or its noise."""
        return max(self.resolution_gwt, _NOISE_WIDTH * self.noise_gwt)

    @property
    def noise_gwt(self) -> float:
        """Standard deviation of single readings, measured at each zero."""
        return 0.0 if self.zero is None else self.zero.noise_gwt

    @property
    def touch_gwt(self) -> float:
        """The reading that means contact: as configured, or well out of the noise."""
        return max(self._settings.habits.touch_force_gwt, self.least_gwt)

    @property
    def wait_s(self) -> float:
        """Until a reading shows what is now: the settling after a move, else a new sample."""
        return self.settle_s if self.moved else self.sensor.sample_period_s

    @property
    def settle_s(self) -> float:
        """From the end of a move to a reading that knows nothing of it."""
        return self._settings.habits.settle_readings * self.sensor.sample_period_s + self._settings.force.latency_s

    def now(self) -> ForceReading:
        """The newest reading from zero, whatever moves, waited for no longer than it takes. Raises NoReadingError."""
        return self._from_zero(read(self.sensor, self._clock, 0.0))

    def settled(self) -> ForceReading:
        """A new reading, made when all motion was over, from zero. Raises NoReadingError."""
        return self._from_zero(self.raw())

    def raw(self) -> ForceReading:
        """The same as the sensor has it; one that is busy is asked again, for BUSY_S. Raises NoReadingError."""
        until_s = self._clock.monotonic_s() + self.wait_s + BUSY_S
        while True:
            try:
                reading = read(self.sensor, self._clock, self.wait_s)
            except NoReadingError as error:
                if not isinstance(error.__cause__, ForceBusy) or self._clock.monotonic_s() >= until_s:
                    raise
            else:
                self.moved, self._at_rest_n = False, reading.force_n
                return reading

    def at_rest_gwt(self, meanwhile: Callable[[float], object] = lambda seconds: None) -> float:
        """Return the force at rest, gwt from zero.

        Below the touch threshold two readings, `APART_S` apart, must agree: while the sensor drifts, the reading of a
        touch passes through zero. A touch is waited for: a late sensor and a slow cell still show it in the air.

        Parameters
        ----------
        meanwhile : callable
            Called before each wait with its length, s.

        Returns
        -------
        float
            The force, gwt; at or above `touch_gwt` it was there for `AT_REST_S`.

        Raises
        ------
        NoReadingError
            The sensor does not answer, or (`unsteady`) its readings do not agree within `AT_REST_S`.
        """
        until_s, before_gwt = self._clock.monotonic_s() + AT_REST_S, None
        while True:
            meanwhile(self.wait_s)
            force_gwt = round(self.settled().force_n / GWT_N, 6)
            late = self._clock.monotonic_s() >= until_s
            if abs(force_gwt) >= self.touch_gwt:
                if late:
                    return force_gwt
                before_gwt = None
                continue
            if before_gwt is not None:
                if abs(force_gwt - before_gwt) <= max(self.touch_gwt / 2, self.least_gwt):
                    return force_gwt
                if late:
                    raise NoReadingError(
                        "the force at rest changed from {before_gwt:.2f} to {force_gwt:.2f} gwt in {apart_s:g} s: "
                        "the sensor drifts",
                        code="unsteady",
                        before_gwt=before_gwt,
                        force_gwt=force_gwt,
                        apart_s=APART_S,
                    )
            before_gwt = force_gwt
            self._pause(APART_S - self.wait_s, meanwhile)

    def _pause(self, seconds: float, meanwhile: Callable[[float], object]) -> None:
        until_s = self._clock.monotonic_s() + seconds
        while (left_s := until_s - self._clock.monotonic_s()) > _TINY_S:
            meanwhile(min(left_s, _LOOK_S))
            self._clock.wait_s(min(left_s, _LOOK_S))

    def begin_motion(self, *, away: bool) -> None:
        """Something will move; without a zero its forces count from the reading before it. Raises NoReadingError.

        away: it leaves the finger first. A sensor that is out of its range before that says so, and is not felt with;
        against a zero it need not answer at all, since nothing may keep the indentor on the finger.
        """
        rested, self.moved, self.away = not self.moved, True, away
        self._felt_from_n, self._before_gwt = 0.0, 0.0
        if self.zeroed and not away:
            return
        try:
            before = self._at_rest_n if rested and self.zeroed else read(self.sensor, self._clock, 0.0).force_n
        except NoReadingError as error:
            if not (away and (self.zeroed or error.out_of_range)):
                raise
            self._before_gwt = math.inf
            self._felt_from_n = 0.0 if self.zeroed else None
            return
        if self.zero is None:
            self._felt_from_n = before
        else:
            self._before_gwt = (before - self.zero.offset_n) / GWT_N

    def unloads(self, force_gwt: float) -> bool:
        """Whether the motion under way leaves the finger, and this force is no reason to end it.

        A force that falls never is. One that grows is, towards the finger; a pull as well where a zero was taken in
        the air, since without one a pull and an unloading look the same.
        """
        if not self.away:
            return False
        pushes = force_gwt > max(self._before_gwt, 0.0) + self.touch_gwt
        pulls = self.absolute and -force_gwt > max(-self._before_gwt, 0.0) + self.touch_gwt
        return not (pushes or pulls)

    def glance_gwt(self) -> float | None:
        """The force while something moves, from zero or from what it was before. Raises NoReadingError.

        None where nothing can be felt.
        """
        if self._felt_from_n is None:
            return None
        reading = self._from_zero(read(self.sensor, self._clock, 0.0))
        return (reading.force_n - self._felt_from_n) / GWT_N

    def take_zero(self, readings_gwt: Sequence[float], *, provisional: bool = False) -> ForceZero:
        """From here on forces are counted from the mean of these readings; provisional: not surely in the air."""
        self.zero = ForceZero.of(readings_gwt, provisional=provisional)
        return self.zero

    def _from_zero(self, reading: ForceReading) -> ForceReading:
        return reading if self.zero is None else self.zero.taken_off(reading)

    def given_mm(self, force_gwt: float) -> float:
        """How far the rig itself gives under a force."""
        return self._settings.calibration.value("compliance_mm_per_n", 0.0) * force_gwt * GWT_N

    def doi_sd_mm(self, force_gwt: float) -> float:
        """How well a depth past contact is known from travel and compliance: a step of the stage, and sd · force."""
        compliance = self._settings.calibration.compliance_mm_per_n
        given_mm = 0.0 if compliance is None else compliance.sd * force_gwt * GWT_N
        return math.hypot(self._settings.stage.resolution_mm / math.sqrt(12), given_mm)
