"""Age of the force samples of a press, which the plan and the rehearsal report."""

from dataclasses import dataclass

from rig.engine.limits import reading_delay_s
from rig.settings import RigSettings


@dataclass(frozen=True)
class SampleAge:
    """Age of a force sample in a press: how much the force rises unseen, and how fast the press can be."""

    age_s: float
    wait_s: float
    increment_mm: float

    @classmethod
    def of(cls, settings: RigSettings) -> "SampleAge":
        """Return it for the configured sensor, with the wait for a reading after an increment."""
        force = settings.force
        age_s = force.latency_s + force.sample_period_s
        return cls(age_s, reading_delay_s(settings), settings.habits.increment_mm)

    def press_speed_mm_s(self, speed_mm_s: float) -> float:
        """Return the mean speed of a press whose moves have this speed (mm/s): it waits after each increment."""
        return self.increment_mm / (self.increment_mm / speed_mm_s + self.wait_s)

    def rise_gwt(self, speed_mm_s: float, stiffness_gwt_mm: float) -> float:
        """Return how much the force rises while a sample ages (gwt): speed · age · stiffness.

        A press moves by one increment at most without a reading.
        """
        return stiffness_gwt_mm * min(speed_mm_s * self.age_s, self.increment_mm)
