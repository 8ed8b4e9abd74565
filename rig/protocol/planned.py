"""What the finger model expects of a press, and a press that is planned."""

from dataclasses import dataclass

from rig.devices.units import GWT_N
from rig.engine.records import Target


@dataclass(frozen=True)
class Prediction:
    """What the model says of a press at a place to a target."""

    indentor: str
    x_mm: float
    target: Target
    expected_contact_mm: float  # height of the indentor at first touch, from the nominal apex
    predicted_force_gwt: float
    predicted_doi_mm: float
    contact_area_mm2: float
    peak_pressure_mpa: float

    @property
    def mean_pressure_n_cm2(self) -> float:
        """Force over contact area."""
        return self.predicted_force_gwt * GWT_N / self.contact_area_mm2 * 100


@dataclass(frozen=True, kw_only=True)
class PlannedIndentation(Prediction):
    """One press of a script, and what the model expects of it."""

    increments: int
    hold_s: float
