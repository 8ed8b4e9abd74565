"""What an indentation is asked to do and what it did."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal


@dataclass(frozen=True)
class Target:
    """A depth in mm past first contact, or a force in gwt."""

    kind: Literal["doi_mm", "force_gwt"]
    value: float

    def part(self, hold: int, increments: int) -> "Target":
        """The target of one of several equal increments, the first being 1."""
        return Target(self.kind, self.value * hold / increments)


_FORCE_DIGITS = 6


def as_fine(data: Mapping[str, Any]) -> dict[str, Any]:
    """An event as it is journalled: no force (a key that ends in _gwt) finer than a millionth of a gram-weight."""
    return {
        key: round(value, _FORCE_DIGITS) if key.endswith("_gwt") and isinstance(value, float) else value
        for key, value in data.items()
    }


Phase = Literal["clearance", "moving", "approach", "back off", "touch", "press", "hold", "compliance"]
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
class Touch:
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
