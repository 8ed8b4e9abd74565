"""What a script will do, and what the finger model expects of it."""

from dataclasses import dataclass, field

from rig.devices.units import GWT_N
from rig.engine.records import Purpose, Target

_SOFT_TRIP_OVER_PREDICTED = 2.0
_SMALLEST_SOFT_TRIP_N = 0.02


@dataclass(frozen=True)
class PlannedIndentation:
    """One press of the script and what the model expects of it."""

    indentor: str
    x_mm: float
    target: Target
    increments: int
    hold_s: float
    expected_contact_mm: float  # height of the indentor at first touch, from the nominal apex
    predicted_force_gwt: float
    predicted_doi_mm: float
    contact_area_mm2: float
    peak_pressure_mpa: float

    @property
    def mean_pressure_n_cm2(self) -> float:
        """Force over contact area."""
        return self.predicted_force_gwt * GWT_N / self.contact_area_mm2 * 100


def _nothing_yet() -> dict[Purpose, list[PlannedIndentation]]:
    return {"data": [], "precondition": [], "reference": []}


@dataclass
class Plan:
    """Every press of a script by its purpose, and the expected height of every touch (mm), in the script's order."""

    presses: dict[Purpose, list[PlannedIndentation]] = field(default_factory=_nothing_yet)
    touches: list[float] = field(default_factory=list)

    @property
    def indentations(self) -> list[PlannedIndentation]:
        """Those that are data."""
        return self.presses["data"]

    @property
    def all_presses(self) -> list[PlannedIndentation]:
        """Data and what is none."""
        return [planned for presses in self.presses.values() for planned in presses]

    @property
    def peak_force_gwt(self) -> float:
        """Highest force the model predicts."""
        return max((planned.predicted_force_gwt for planned in self.all_presses), default=0.0)

    @property
    def held_s(self) -> float:
        """How long the finger is held: it is touched for longer than that."""
        return sum(planned.increments * planned.hold_s for planned in self.all_presses)

    @property
    def soft_trip_n(self) -> float:
        """Twice the highest force predicted, and never so little that noise would trip."""
        return max(_SOFT_TRIP_OVER_PREDICTED * self.peak_force_gwt * GWT_N, _SMALLEST_SOFT_TRIP_N)
