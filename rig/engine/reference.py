"""Reference presses, which check that the response of the finger has not changed; compliance of the rig."""

import math
from dataclasses import dataclass

import numpy as np

from rig.data.events import ReferenceEvent
from rig.engine.engine import Engine
from rig.engine.indentation import ready_to_indent
from rig.engine.verbs import safe_point, unpaused
from rig.errors import LimitError, TripError
from rig.records import NO_PRESS, Indentation
from rig.units import GWT_N


def compare_reference(engine: Engine, found: Indentation, promised_gwt: tuple[float, float] | None = None) -> None:
    """Compare a reference press with the first one of the run, and journal the largest deviation.

    `promised_gwt` is the predicted band of the force at the last hold, for an identified finger. A force outside it,
    or a deviation beyond limits.reference_band, is an alarm; TripError if limits.on_alarm is `trip`.
    """
    forces_gwt = [hold.force_gwt for hold in found.holds]
    first_gwt = engine.first_reference_gwt = engine.first_reference_gwt or forces_gwt
    off = max((now / first - 1 for now, first in zip(forces_gwt, first_gwt, strict=True)), key=abs)
    engine.record(ReferenceEvent(found.index, round(off, 6)))
    band = engine.settings.limits.reference_band
    if abs(off) > band:
        engine.alarm(
            TripError(
                f"reference press index {found.index} deviates by {off:+.1%} from the first one, more than "
                f"limits.reference_band = {band:g}",
                "reference_off",
            )
        )
    low, high = promised_gwt or (-math.inf, math.inf)
    if not low <= forces_gwt[-1] <= high:
        engine.alarm(
            TripError(
                f"reference press index {found.index} reads {forces_gwt[-1]:.3g} gwt, but {low:.3g} … {high:.3g} gwt "
                "is predicted for the identified finger; check that the finger has not moved",
                "not_as_met",
            )
        )


_FROM_SHARE = 0.2  # Share of the largest force: below it the surfaces are not yet in full contact.
_FEWEST = 4


@dataclass(frozen=True)
class Compliance:
    """Compliance of the rig and its standard deviation (mm/N), with the number of readings."""

    mm_per_n: float
    sd_mm_per_n: float
    readings: int


def measure_compliance(engine: Engine, to_gwt: float) -> Compliance:
    """Press on a rigid block at the present position in single steps of the stage, up to a force, then lift.

    The top of the block is expected at the nominal apex. Raises LimitError if too few steps lie within the force.
    """
    ready_to_indent(engine)
    try:
        readings = unpaused(lambda: _pressed(engine, to_gwt))
    finally:
        engine.make_safe()
    return _fitted(readings, engine.settings.stage.resolution_mm)


def _pressed(engine: Engine, to_gwt: float) -> list[tuple[float, float]]:
    """Return (height mm, force gwt) of each step in contact."""
    settings = engine.settings
    habits, search_mm = settings.habits, settings.limits.search_mm
    readings: list[tuple[float, float]] = []
    force = 0.0
    while force < to_gwt:
        safe_point(engine)
        step = habits.increment_mm if engine.height_mm > search_mm else settings.stage.resolution_mm
        if engine.height_mm - step < -search_mm:
            engine.trip(
                TripError(
                    f"no block found down to {-search_mm:.3f} mm from the nominal apex; set frame.apex_z_mm to the "
                    "top of the block",
                    "no_block",
                )
            )
        engine.go_to_height(engine.height_mm - step, habits.approach_speed_mm_s)
        force = engine.read_force_gwt(NO_PRESS, "compliance")
        if force >= engine.sensing.touch_gwt:
            readings.append((engine.height_mm, force))
    return readings


def _fitted(readings: list[tuple[float, float]], resolution_mm: float) -> Compliance:
    """Return the slope of the least-squares line of travel against force; the sd of a height is step / √12."""
    height, force_n = np.array(readings).T * np.array([[1.0], [GWT_N]])
    settled = force_n >= _FROM_SHARE * force_n.max()
    height, force_n = height[settled], force_n[settled]
    if len(force_n) < _FEWEST:
        raise LimitError(
            f"only {len(force_n)} steps of {resolution_mm:g} mm lie within the force, at least {_FEWEST} are "
            "needed; press with more force, or treat the rig as rigid",
            "too_few_steps",
        )
    slope, offset = np.polyfit(force_n, height, 1)
    left_mm = height - (slope * force_n + offset)
    sd_mm = max(math.sqrt((left_mm**2).sum() / (len(left_mm) - 2)), resolution_mm / math.sqrt(12))
    spread_n = math.sqrt(((force_n - force_n.mean()) ** 2).sum())
    return Compliance(float(-slope), sd_mm / spread_n, len(force_n))
