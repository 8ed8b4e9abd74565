"""Measured beside predicted: what a press does not control, its force at a depth or its depth at a force."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rig.data.run import Run
from rig_shared.plural import number_of

LARGEST = 0.3
"""Largest relative deviation from a prediction without a warning; an identified finger has a band instead."""
_UNITS = {"force_gwt": "gwt", "doi_mm": "mm"}
_NAMES = {"force_gwt": "force", "doi_mm": "DOI"}


@dataclass(frozen=True)
class PressDeviation:
    """Predicted and measured quantity of a press in its last hold."""

    index: int
    indentor: str
    key: str  # force_gwt or doi_mm
    predicted: float
    measured: float
    band: tuple[float, float] | None = None  # of an identified finger

    @property
    def is_large(self) -> bool:
        """Whether the measurement lies outside the band, or deviates by more than `LARGEST`."""
        low, high = self.band or ((1 - LARGEST) * self.predicted, (1 + LARGEST) * self.predicted)
        return not low <= self.measured <= high

    @property
    def words(self) -> str:
        """Measured and predicted quantity."""
        name, unit, digits = _NAMES[self.key], _UNITS[self.key], 2 if self.key == "force_gwt" else 3
        return f"{name} {self.measured:.{digits}f} {unit}, predicted {self.predicted:.{digits}f} {unit}"


Bands = Mapping[tuple[int, str], tuple[float, float]]
"""Predicted bands of an identified finger, by press and quantity."""


def bands_of(start: Mapping[str, Any]) -> Bands:
    """Return the predicted bands in the first document of a run; empty without an identified finger."""
    data = (one for one in start.get("promised", []) if one["purpose"] == "data")
    return {(one["index"], one["key"]): (one["low"], one["high"]) for one in data}


def deviation_of(start: Mapping[str, Any], last_hold: Mapping[str, Any], bands: Bands) -> PressDeviation | None:
    """Return the deviation of a press from its events; None in a journal of 0.2, which has no predictions."""
    key = "force_gwt" if start.get("target") == "doi_mm" else "doi_mm"
    predicted = start.get(f"predicted_{key}")
    if predicted is None:
        return None
    indentor, measured, band = str(start.get("indentor", "")), float(last_hold[key]), bands.get((start["index"], key))
    return PressDeviation(start["index"], indentor, key, float(predicted), measured, band)


def deviations(run: Run) -> list[PressDeviation]:
    """Return the deviations of all finished indentations."""
    bands, starts = bands_of(run.start), {event["index"]: event for event in run.stream("indentation_start")}
    found = (deviation_of(starts[index], holds[-1], bands) for index, holds in sorted(run.done.items()))
    return [one for one in found if one is not None]


def warning_of(found: Sequence[PressDeviation]) -> str | None:
    """Return a sentence on the presses that deviate much; None without any."""
    large = [one for one in found if one.is_large]
    if not large:
        return None
    first = large[0]
    share = statistics.median(one.measured / one.predicted for one in large)
    beyond = "outside their predicted band" if first.band else f"more than {LARGEST:.0%} off the prediction"
    which = f"{len(large)} of {number_of(len(found), 'presses')} {'is' if len(large) == 1 else 'are'} {beyond}"
    return (
        f"{which}: {_NAMES[first.key]} {share:.2f} times the predicted one (median; press index {first.index}: "
        f"{first.words}); check that {first.indentor} is mounted, and the configured finger"
    )
