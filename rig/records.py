"""Records of an indentation: what is asked, what the model expects, what was done."""

import math
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, TypeVar

from rig.units import GWT_N


@dataclass(frozen=True)
class Target:
    """A depth in mm past first contact, or a force in gwt."""

    kind: Literal["doi_mm", "force_gwt"]
    value: float

    def part(self, hold: int, increments: int) -> "Target":
        """The target of one of several equal increments, the first being 1."""
        return Target(self.kind, self.value * hold / increments)


K = TypeVar("K", bound=Hashable)
T = TypeVar("T")


def grouped(items: Iterable[T], key: Callable[[T], K]) -> dict[K, list[T]]:
    """Return all items of each key, in order of first appearance, sorted or not."""
    found: dict[K, list[T]] = {}
    for item in items:
        found.setdefault(key(item), []).append(item)
    return found


_FORCE_DIGITS = 6


def as_fine(data: Mapping[str, Any]) -> dict[str, Any]:
    """An event as it is journalled: no force (a key that ends in _gwt) finer than a millionth of a gram-weight."""
    return {
        key: round(value, _FORCE_DIGITS) if key.endswith("_gwt") and isinstance(value, float) else value
        for key, value in data.items()
    }


Phase = Literal[
    "clearance", "moving", "approach", "back off", "touch", "press", "ramp", "vibrate", "hold", "compliance"
]
"""What was being done when the force was read."""

Purpose = Literal["data", "precondition", "reference", "find"]


@dataclass(frozen=True)
class PressId:
    """Which press it is: its number among those of its purpose, in the order of the script; and in its schedule."""

    index: int
    purpose: Purpose = "data"
    marks: Mapping[str, Any] = field(default_factory=dict, compare=False)  # block, repeat and condition

    def stream(self, name: str) -> str:
        """Where its events go: what is no data has streams of its own."""
        return name if self.purpose == "data" else f"{self.purpose}_{name}"


NO_PRESS = PressId(-1)


@dataclass(frozen=True)
class ContactFit:
    """Where contact was found: heights above the nominal apex in mm, forces in gwt."""

    threshold_gwt: float
    height_at_threshold_mm: float
    force_gwt: float  # the reading there
    contact_height_mm: float
    fit_points: int

    @property
    def doi_bias_mm(self) -> float:
        """DOI already reached when the threshold was crossed."""
        return self.contact_height_mm - self.height_at_threshold_mm


@dataclass(frozen=True)
class Hold:
    """A finished hold: mean force and depth as delivered."""

    target: Target
    doi_mm: float
    force_gwt: float
    force_sd_gwt: float


@dataclass(frozen=True)
class Indentation:
    """A finished indentation."""

    index: int
    x_mm: float
    holds: tuple[Hold, ...]


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
class PredictionBand:
    """Between which force and depth an identified finger answers, nine times of ten, in the last hold."""

    force_gwt: tuple[float, float]
    doi_mm: tuple[float, float]
    highest_gwt: float  # on the way there, 19 times of 20 no more


@dataclass(frozen=True)
class Prediction:
    """What the model says of a press at a place to a target; of an identified finger, with a band."""

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
        """What limits go by: the highest force, the upper end of its band where there is one."""
        return self.predicted_force_gwt if self.band is None else self.band.highest_gwt

    @property
    def deepest_mm(self) -> float:
        """The same of depth."""
        return self.predicted_doi_mm if self.band is None else self.band.doi_mm[1]

    @property
    def mean_pressure_kpa(self) -> float:
        """Highest force over contact area."""
        return self.highest_gwt * GWT_N / self.contact_area_mm2 * 1000


@dataclass(frozen=True)
class SineMotion:
    """A sine about a preload: amplitude is half of the way from the highest to the lowest position."""

    amplitude_mm: float
    period_s: float  # in steps of 0.1 ms
    cycles: int

    @classmethod
    def of(cls, frequency_hz: float, amplitude_um: float, duration_s: float) -> "SineMotion":
        """Of whole cycles, as many as come nearest to the duration, and no faster than asked."""
        period_s = math.ceil(10_000 / frequency_hz - 1e-9) / 10_000
        return cls(amplitude_um / 1000, period_s, max(round(duration_s / period_s), 1))

    @property
    def frequency_hz(self) -> float:
        """Cycles per second."""
        return 1 / self.period_s

    @property
    def amplitude_um(self) -> float:
        """Amplitude in micrometers."""
        return 1000 * self.amplitude_mm

    @property
    def duration_s(self) -> float:
        """Of all cycles."""
        return self.cycles * self.period_s

    @property
    def speed_mm_s(self) -> float:
        """Highest speed, half-way."""
        return 2 * math.pi * self.amplitude_mm / self.period_s


@dataclass(frozen=True, kw_only=True)
class PlannedIndentation(Prediction):
    """One press of a script, and what the model expects of it."""

    increments: int
    hold_s: float
    ramp_mm_s: float | None = None  # speed of a ramp
    vibration: SineMotion | None = None
