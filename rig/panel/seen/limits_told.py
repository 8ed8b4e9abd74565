"""Limits and how far the newest force is from them, in gram-weight and newtons."""

from typing import Any

from rig.devices.units import GWT_N
from rig.engine.limits import Trips
from rig.plan.config import Config


def limits_told(config: Config, soft_trip_n: float | None, force_gwt: float | None) -> dict[str, Any]:
    """Trips, margins of the newest force (None without one) and the deepest press."""
    trips = Trips(config.limits, soft_trip_n)
    told: dict[str, Any] = {"max_doi_mm": config.limits.max_doi_mm, "max_force_gwt": config.limits.max_force_gwt}
    for name, margin, trip_gwt in (
        ("trip", "margin", trips.soft_gwt),
        ("hard_trip", "hard_margin", trips.hard_gwt),
    ):
        left_gwt = None if force_gwt is None else trip_gwt - abs(force_gwt)
        told |= in_both(name, trip_gwt) | in_both(margin, left_gwt)
    return told


def in_both(name: str, force_gwt: float | None) -> dict[str, float | None]:
    """A force under its name in either unit."""
    return {f"{name}_gwt": force_gwt, f"{name}_n": None if force_gwt is None else force_gwt * GWT_N}
