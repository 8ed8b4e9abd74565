"""What the finger model expects of a press, and a press that is planned."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from rig.devices.units import GWT_N
from rig.engine.records import Target

BETWEEN_INCREMENTS_S = 0.1
"""Besides the move itself: to stop and to read (virtual GRBL board and MT-SICS balance, `sample.csv` of a run)."""


class Pace(NamedTuple):
    """Of a press in so many ramps, each with a hold at its end."""

    speed_mm_s: float
    increment_mm: float
    ramps: int
    hold_s: float

    def ramp_s(self, doi_mm: float) -> float:
        """All ramps together, down to a depth."""
        return doi_mm / self.speed_mm_s + math.ceil(doi_mm / self.increment_mm) * BETWEEN_INCREMENTS_S


@dataclass(frozen=True)
class Band:
    """Between which force and depth a finger that was met answers, nine times of ten, in the last hold."""

    force_gwt: tuple[float, float]
    doi_mm: tuple[float, float]
    highest_gwt: float  # on the way there, 19 times of 20 no more


@dataclass(frozen=True)
class Prediction:
    """What the model says of a press at a place to a target; of a finger that was met, with a band."""

    indentor: str
    x_mm: float
    target: Target
    expected_contact_mm: float  # height of the indentor at first touch, from the nominal apex
    predicted_force_gwt: float
    predicted_doi_mm: float
    contact_area_mm2: float
    peak_pressure_mpa: float
    band: Band | None = field(default=None, kw_only=True)

    @property
    def highest_gwt(self) -> float:
        """What limits go by: the highest force, the upper end of its band where there is one."""
        return self.predicted_force_gwt if self.band is None else self.band.highest_gwt

    @property
    def deepest_mm(self) -> float:
        """The same of depth."""
        return self.predicted_doi_mm if self.band is None else self.band.doi_mm[1]

    @property
    def mean_pressure_n_cm2(self) -> float:
        """Highest force over contact area."""
        return self.highest_gwt * GWT_N / self.contact_area_mm2 * 100


@dataclass(frozen=True, kw_only=True)
class PlannedIndentation(Prediction):
    """One press of a script, and what the model expects of it."""

    increments: int
    hold_s: float
