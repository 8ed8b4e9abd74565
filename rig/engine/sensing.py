"""What a rig feels: readings that trip, contact, depth, and the zero they are counted from."""

import math
import statistics
from collections.abc import Callable

from rig.devices.force.base import ForceReading, ForceSensor
from rig.devices.heartbeat import Heartbeat
from rig.devices.stage.base import Stage
from rig.devices.units import GWT_N
from rig.engine.errors import LimitError
from rig.engine.journal import Recorder
from rig.engine.readings import NoReadingError, Zero, read
from rig.engine.records import PressId
from rig.engine.rig_settings import RigSettings
from rig.engine.safety import SafeRig, State
from rig.transport.clock import Clock

_READINGS_AT_ZERO = 12
_NOISE_WIDTH = 6.0  # standard deviations that a whole step is taken for


class SensingRig(SafeRig):
    """A safe rig with a force sensor; forces in gwt, depths in mm."""

    def __init__(
        self,
        settings: RigSettings,
        clock: Clock,
        stage: Stage,
        force: ForceSensor,
        journal: Recorder,
        soft_trip_n: float | None,
        heartbeat: Heartbeat | None,
        contact_s: float,
    ) -> None:
        super().__init__(settings, clock, stage, journal, soft_trip_n, heartbeat, contact_s)
        self._force = force
        self._zero: Zero | None = None

    @property
    def resolution_gwt(self) -> float:
        """One step of what the force sensor shows."""
        return self._force.resolution_gwt

    @property
    def least_gwt(self) -> float:
        """What is less than half of this cannot be told from nothing: one step of the sensor, or its noise."""
        return max(self.resolution_gwt, _NOISE_WIDTH * self.noise_gwt)

    @property
    def noise_gwt(self) -> float:
        """Standard deviation of single readings, measured at each zero."""
        return 0.0 if self._zero is None else self._zero.noise_gwt

    @property
    def touch_gwt(self) -> float:
        """The reading that means contact: as configured, or well out of the noise."""
        return max(self.settings.habits.touch_force_gwt, self.least_gwt)

    def zero(self) -> None:
        """Zero the force sensor with the indentor in the air; how far it has drifted since the last one is told."""
        self._require_clear("zero")
        drift_gwt = None if self._zero is None else statistics.fmean(self._several(self._reading))
        name = self._force.connect()
        self.clock.wait_s(self._settle_s)
        self._force.zero()
        self._zero = Zero.of(self._several(self._raw_reading))
        found = {
            "noise_gwt": round(self.noise_gwt, 6),
            "offset_gwt": round(self._zero.offset_n / GWT_N, 6),
            "drift_gwt": None if drift_gwt is None else round(drift_gwt, 6),
        }
        self.record("zero", {"sensor": name, **found})
        band_gwt = self.settings.limits.zero_drift_gwt
        if drift_gwt is not None and abs(drift_gwt) > band_gwt:
            self.alarm(f"the zero has drifted by {drift_gwt:+.2f} gwt, limits.zero_drift_gwt = {band_gwt:g}")

    def _several(self, reading: Callable[[], ForceReading]) -> list[float]:
        return [reading().force_n / GWT_N for _ in range(_READINGS_AT_ZERO)]

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
        """A new reading, made when all motion was over, less what was there at the zero. One that is none trips."""
        reading = self._raw_reading()
        return reading if self._zero is None else self._zero.taken_off(reading)

    def _raw_reading(self) -> ForceReading:
        wait_s = self._settle_s if self._moved else self._force.sample_period_s
        self._beat(wait_s)
        try:
            reading = read(self._force, self.clock, wait_s)
        except NoReadingError as error:
            self.trip(str(error))
        self._moved = False
        return reading

    def doi_mm(self, contact_height_mm: float, force_gwt: float) -> float:
        """Depth past contact: how far the stage has gone, less what the rig itself gives under the force."""
        given_mm = self.settings.calibration.value("compliance_mm_per_n", 0.0) * force_gwt * GWT_N
        return contact_height_mm - self.height_mm - given_mm

    def doi_sd_mm(self, force_gwt: float) -> float:
        """How well a depth past contact is known from travel and compliance: a step of the stage, and sd · force."""
        compliance = self.settings.calibration.compliance_mm_per_n
        given_mm = 0.0 if compliance is None else compliance.sd * force_gwt * GWT_N
        return math.hypot(self.settings.stage.resolution_mm / math.sqrt(12), given_mm)

    @property
    def _settle_s(self) -> float:
        return self.settings.habits.settle_readings * self._force.sample_period_s + self.settings.force.latency_s
