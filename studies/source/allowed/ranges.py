"""What the source leaves open about its finger, as ranges with their reasons.

Values are a dictionary by name; a place is the same in units of the ranges, 0 the lowest and 1 the highest.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig, Geometry, MeshSpec
from sim.finger.surface import published_points

Array = NDArray[np.float64]
Values = Mapping[str, float]


@dataclass(frozen=True)
class Range:
    """One parameter: lowest and highest value, the default finger's, and why so. `log`: spread evenly in log."""

    name: str
    low: float
    high: float
    default: float
    why: str
    log: bool = False

    def at(self, unit: float) -> float:
        """The value at a part (0 … 1) of the range."""
        if self.log:
            return float(self.low * (self.high / self.low) ** unit)
        return float(self.low + (self.high - self.low) * unit)

    def unit(self, value: float) -> float:
        """The part of the range at a value."""
        if self.log:
            return float(np.log(value / self.low) / np.log(self.high / self.low))
        return float((value - self.low) / (self.high - self.low))


LOW_FORCE = "low_force_gwt"
BONE_AXIS = "bone_axis_mm"

RANGES = (
    Range(
        BONE_AXIS,
        -0.4,
        0.8,
        0.0,
        "height of the bone's axis, and of the widest places, in the frame of the published points, which does not "
        "say where its y = 0 lies; fingers about a centre at 0 … 0.8 reproduced the facts in a prototype",
    ),
    Range(
        "geometry.nail_depth_ratio",
        0.55,
        1.1,
        0.75,
        "no point lies beside or behind the pulp; from a flat nail side to one as deep as the pulp; sets the "
        "sections' width with it",
    ),
    Range(
        "geometry.proximal_half_width_mm", 2.6, 4.2, 3.4, "weak anchor of the fit at z = 0; the points begin at 4.1"
    ),
    Range("geometry.tip_radius_mm", 0.6, 1.6, 1.0, "weak anchor at the tip; the points end at z = 11.5"),
    Range(
        "geometry.stiffness_of_fit",
        0.02,
        0.2,
        0.06,
        "how much the skin may bend between points: residuals of 10 to 18 µm rms; sets the axial radius",
        log=True,
    ),
    Range("tissue.epidermis_mm", 0.25, 0.6, 0.4, "not printed; wider than the ± 25 % of the facts by parameter"),
    Range("tissue.dermis_mm", 0.4, 1.4, 0.8, "not printed; counts where its E is not that of fat"),
    Range("tissue.bone_fraction", 0.2, 0.42, 0.32, "not printed; wider than the ± 20 % of the facts by parameter"),
    Range("tissue.e_dermis", 0.05, 0.2, 0.1, "printed as 10³ of 10⁴, a power of ten: half to twice", log=True),
    Range("tissue.e_fat", 0.05, 0.2, 0.1, "printed as 10³ of 10⁴, a power of ten: half to twice", log=True),
    Range("tissue.nail_arc_deg", 90.0, 180.0, 140.0, "the source holds the nail, and does not say how far around"),
    Range("tissue.nail_from_z_mm", 3.0, 7.0, 5.0, "nor how far back it reaches"),
    Range(LOW_FORCE, 1.6, 2.7, 2.33, "the low force is “about 2.33” gwt and “a third” of 8: a nuisance"),
)
NAMES = tuple(one.name for one in RANGES)
DEFAULT: dict[str, float] = {one.name: one.default for one in RANGES}


def values_at(place: Array) -> dict[str, float]:
    """Of a place (n,)."""
    return {one.name: one.at(u) for one, u in zip(RANGES, place, strict=True)}


def place_of(values: Values) -> Array:
    """(n,) of values."""
    return np.array([one.unit(values[one.name]) for one in RANGES])


def finger_of(values: Values, mesh: Mapping[str, Any]) -> FingertipConfig:
    """The finger that has them. Its skin goes by the published points, seen from another bone's axis."""
    down = values[BONE_AXIS]
    tree: dict[str, dict[str, Any]] = {"geometry": {}, "tissue": {}, "mesh": dict(mesh), "contact": {"patch_gb": 0}}
    for name, value in values.items():
        table, _, key = name.rpartition(".")
        if table:
            tree[table][key] = value
    _, points, _ = published_points()
    if down:
        tree["geometry"]["points"] = [(x, y - down, z) for x, y, z in points.tolist()]
        tree["geometry"]["proximal_apex_mm"] = Geometry().proximal_apex_mm - down
    return FingertipConfig.model_validate(tree)


COARSE = {"spacing_mm": 0.22}
"""The design's mesh: half the work of the default one; what that changes is measured, fact by fact."""

FULL: dict[str, Any] = MeshSpec().model_dump(include={"spacing_mm"})
