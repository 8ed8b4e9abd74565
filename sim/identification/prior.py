"""Prior of a finger: named parameters, each with a truncated normal distribution."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.config import Tissue

Array = NDArray[np.float64]

TAU_FAST_S = 0.07
"""Time constant (s) of the fast part of relaxation, shorter than two readings of a balance, so that it cannot be
learned."""


LEAST_STIFFENING = 0.02
"""Stiffening of living tissue; at 0 a finger is linear at small strain."""


@dataclass(frozen=True)
class Parameter:
    """Parameter of the finger or of its position: normal between low and high. A name with ln_ is a logarithm."""

    name: str
    middle: float
    sd: float
    low: float
    high: float
    why: str


def _logarithm(name: str, middle: float, factor: float, low: float, high: float, why: str) -> Parameter:
    middle, sd, low, high = (float(np.log(v)) for v in (middle, factor, low, high))
    return Parameter(name, middle, sd, low, high, why)


PARAMETERS = (
    _logarithm("ln_stiffness", 0.7, 2.0, 0.1, 5.0, "four people under a plate, on two geometries (docs/validation)"),
    _logarithm("ln_e_dermis", 0.16, 1.6, 0.05, 0.5, "from half of the source's 0.1 almost to the published 0.59"),
    _logarithm("ln_e_fat", 0.08, 1.6, 0.025, 0.28, "from a quarter of the source's 0.1 to the published 0.25"),
    Parameter("stiffening", 0.3, 0.2, LEAST_STIFFENING, 0.8, "under a plate, force grows fivefold from 1 to 2 mm"),
    Parameter("share_fast", 0.2, 0.07, 0.02, 0.4, "70 ms: Pawluk & Howe 1999"),
    Parameter("share_slow", 0.2, 0.07, 0.02, 0.4, "1.4 s: Pawluk & Howe 1999"),
    _logarithm("ln_tau_slow_s", 1.4, 1.2, 0.8, 2.5, "Pawluk & Howe 1999, spread between people"),
    Parameter("x_mm", 0.0, 0.3, -0.6, 0.6, "a finger positioned by eye"),
    Parameter("height_mm", 0.0, 0.15, -0.4, 0.4, "the same, within limits.search_mm"),
)
"""Prior of a finger that lies on a bench."""

TISSUE = ("ln_e_dermis", "ln_e_fat")
"""Parameters that require a new model of the finger; force is proportional to stiffness, and stiffening is a
factor."""


class Prior:
    """Several independent parameters (p)."""

    def __init__(self, parameters: Sequence[Parameter] = PARAMETERS) -> None:
        self.parameters = tuple(parameters)
        self.names = tuple(p.name for p in parameters)

    @cached_property
    def middle(self) -> Array:
        """(p,) means."""
        return np.array([p.middle for p in self.parameters])

    @cached_property
    def sd(self) -> Array:
        """(p,) standard deviations before truncation."""
        return np.array([p.sd for p in self.parameters])

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """(p,) lower and upper bounds."""
        return np.array([p.low for p in self.parameters]), np.array([p.high for p in self.parameters])

    def index(self, name: str) -> int:
        """Return the column of a parameter in draws."""
        return self.names.index(name)

    def parameter(self, name: str) -> Parameter:
        """Return a parameter by its name."""
        return self.parameters[self.index(name)]

    def draws(self, n: int, chance: np.random.Generator) -> Array:
        """Return (n, p) random fingers."""
        from scipy.stats import truncnorm  # as long to import as all else of scipy, and every report imports this

        low, high = (np.array(edge - self.middle) / self.sd for edge in self.bounds)
        cut = truncnorm(low, high, loc=self.middle, scale=self.sd)
        return np.asarray(cut.ppf(chance.random((n, len(self.names)))))

    def within(self, draws: Array) -> NDArray[np.bool_]:
        """Return (n,) whether all parameters of a draw are within their bounds."""
        low, high = self.bounds
        return np.asarray(((draws >= low) & (draws <= high)).all(axis=1))

    def off(self, draws: Array) -> Array:
        """Return the (n, p) differences from the means, in standard deviations."""
        return np.asarray((draws - self.middle) / self.sd)


# --- in numbers ---
#
# Parameters of the prior as values of a configuration: without logarithms, tissue and relaxation.

_LOGARITHM = "ln_"


def named(name: str) -> str:
    """What a parameter is of."""
    return name.removeprefix(_LOGARITHM)


def plain(name: str, value: float) -> float:
    """Return the value of a parameter without its logarithm."""
    return math.exp(value) if name.startswith(_LOGARITHM) else float(value)


def in_numbers(values: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters by name and value, without logarithms."""
    return {named(name): plain(name, value) for name, value in values.items()}


def tissue_of(values: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters that are keys of `finger.tissue`."""
    return {name: value for name, value in in_numbers(values).items() if name in Tissue.model_fields}


def series_of(values: Mapping[str, float]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the Prony series of a finger: shares and time constants (s)."""
    numbers = in_numbers(values)
    return (numbers["share_fast"], TAU_FAST_S), (numbers["share_slow"], numbers["tau_slow_s"])
