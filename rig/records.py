"""Records of an indentation: target, prediction, and result."""

import math
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, TypeVar

from rig.units import GWT_N


@dataclass(frozen=True)
class Target:
    """Target of a press: a depth in mm past first contact, or a force in gwt."""

    kind: Literal["doi_mm", "force_gwt"]
    value: float

    def part(self, hold: int, increments: int) -> "Target":
        """Return the target of one of several equal increments, numbered from 1."""
        return Target(self.kind, self.value * hold / increments)


_TOLERANCE_GWT, _TOLERANCE = 0.05, 0.01


def force_tolerance_gwt(target_gwt: float, resolution_gwt: float) -> float:
    """Return how far a delivered force may be from its target (gwt)."""
    return max(_TOLERANCE_GWT, _TOLERANCE * target_gwt, resolution_gwt)


K = TypeVar("K", bound=Hashable)
T = TypeVar("T")


def grouped(items: Iterable[T], key: Callable[[T], K]) -> dict[K, list[T]]:
    """Return all items of each key, in order of first appearance, sorted or not."""
    found: dict[K, list[T]] = {}
    for item in items:
        found.setdefault(key(item), []).append(item)
    return found


SAME_DECIMALS = 6
"""Decimals to which positions (mm) and targets of repeats are compared; further ones are arithmetic (3 × 0.1)."""
_FORCE_DIGITS = 6


def as_fine(data: Mapping[str, Any]) -> dict[str, Any]:
    """Round the forces of an event (keys that end in _gwt) to a millionth of a gram-weight, for the journal."""
    return {
        key: round(value, _FORCE_DIGITS) if key.endswith("_gwt") and isinstance(value, float) else value
        for key, value in data.items()
    }


Phase = Literal["clearance", "rest", "moving", "approach", "back off", "touch", "press", "ramp", "hold", "compliance"]
"""Activity during which the force was read."""

ContactKind = Literal["lifted", "raised", "disagreement", "touching", "unknown"]
"""State of contact between indentor and finger; rig/engine/contact.py says what each one means."""

Purpose = Literal["data", "precondition", "reference", "find"]


@dataclass(frozen=True)
class PressId:
    """Identity of a press: its number among those of its purpose, in script order, and its place in the schedule."""

    index: int
    purpose: Purpose = "data"
    marks: Mapping[str, Any] = field(default_factory=dict, compare=False)  # block, repeat and condition

    def stream(self, name: str) -> str:
        """Return the stream of its events; presses that are not data have streams of their own."""
        return name if self.purpose == "data" else f"{self.purpose}_{name}"


NO_PRESS = PressId(-1)


@dataclass(frozen=True)
class ContactFit:
    """Fitted contact: heights above the nominal apex in mm, forces in gwt."""

    threshold_gwt: float
    height_at_threshold_mm: float
    force_gwt: float  # the reading there
    contact_height_mm: float
    fit_points: int

    @property
    def doi_bias_mm(self) -> float:
        """DOI already reached when the force crossed the threshold (mm)."""
        return self.contact_height_mm - self.height_at_threshold_mm


@dataclass(frozen=True)
class Hold:
    """Finished hold: mean force and depth as delivered."""

    target: Target
    doi_mm: float
    force_gwt: float
    force_sd_gwt: float


@dataclass(frozen=True)
class Indentation:
    """Finished indentation."""

    index: int
    x_mm: float
    holds: tuple[Hold, ...]


BETWEEN_INCREMENTS_S = 0.1
"""Time per increment besides the move, to stop and to read (virtual GRBL and MT-SICS, `sample.csv` of a run)."""


class Pace(NamedTuple):
    """Pace of a press in several ramps, each followed by a hold."""

    speed_mm_s: float
    increment_mm: float
    ramps: int
    hold_s: float

    def ramp_s(self, doi_mm: float) -> float:
        """Return the duration of all ramps to a depth (s)."""
        return doi_mm / self.speed_mm_s + math.ceil(doi_mm / self.increment_mm) * BETWEEN_INCREMENTS_S


@dataclass(frozen=True)
class PredictionBand:
    """90 % bands of force and depth in the last hold of a press on an identified finger."""

    force_gwt: tuple[float, float]
    doi_mm: tuple[float, float]
    highest_gwt: float  # on the way there, 19 times of 20 no more


@dataclass(frozen=True)
class Prediction:
    """Prediction of the finger model for a press; with a band if the finger was identified."""

    indentor: str
    x_mm: float
    target: Target
    expected_contact_mm: float  # height of the indentor at first touch, from the nominal apex
    predicted_force_gwt: float
    predicted_doi_mm: float
    contact_area_mm2: float
    peak_pressure_mpa: float
    band: PredictionBand | None = field(default=None, kw_only=True)

    @property
    def highest_gwt(self) -> float:
        """Force that is compared with the limits (gwt): the prediction, or the upper end of its band."""
        return self.predicted_force_gwt if self.band is None else self.band.highest_gwt

    @property
    def deepest_mm(self) -> float:
        """Depth that is compared with the limits (mm): the prediction, or the upper end of its band."""
        return self.predicted_doi_mm if self.band is None else self.band.doi_mm[1]

    @property
    def mean_pressure_kpa(self) -> float:
        """Highest force over contact area (kPa)."""
        return self.highest_gwt * GWT_N / self.contact_area_mm2 * 1000


@dataclass(frozen=True, kw_only=True)
class PlannedIndentation(Prediction):
    """Press of a script, with its prediction."""

    increments: int
    hold_s: float
    ramp_mm_s: float | None = None  # speed of a ramp
