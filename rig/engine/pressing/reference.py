"""The same press again and again: does force still follow depth as it did at first?"""

import math
from collections.abc import Sequence

from rig.engine.engine import Engine
from rig.engine.errors import TripError
from rig.engine.records import Indentation


class Reference:
    """Forces at the holds of the first reference indentation, and the band that the later ones must keep."""

    def __init__(self, first_gwt: Sequence[float] | None = None) -> None:
        """first_gwt: the forces of the first one, where the run had one before it stopped."""
        self._first_gwt = first_gwt

    def compare(self, engine: Engine, found: Indentation, promised_gwt: tuple[float, float] | None = None) -> None:
        """Journal the largest deviation as a share of the first force; an alarm beyond limits.reference_band.

        promised_gwt: the band of a finger that was met, of the last hold; an alarm beyond it, too.
        """
        forces_gwt = [hold.force_gwt for hold in found.holds]
        first_gwt = self._first_gwt = self._first_gwt or forces_gwt
        off = max((now / first - 1 for now, first in zip(forces_gwt, first_gwt, strict=True)), key=abs)
        engine.record("reference", {"index": found.index, "deviation": round(off, 6)})
        band = engine.settings.limits.reference_band
        if abs(off) > band:
            engine.alarm(
                TripError(
                    "reference {index} is off by {deviation:+.1%}, limits.reference_band = {band:g}",
                    code="reference_off",
                    index=found.index,
                    deviation=off,
                    band=band,
                )
            )
        low, high = promised_gwt or (-math.inf, math.inf)
        if not low <= forces_gwt[-1] <= high:
            engine.alarm(
                TripError(
                    "reference {index} is {force_gwt:.3g} gwt, the finger that was met should be at "
                    "{low_gwt:.3g} … {high_gwt:.3g} gwt",
                    code="not_as_met",
                    index=found.index,
                    force_gwt=forces_gwt[-1],
                    low_gwt=low,
                    high_gwt=high,
                )
            )
