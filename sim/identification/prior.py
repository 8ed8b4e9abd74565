"""Prior of a finger: named parameters with truncated normal distributions, of which kinds of tissue lack some."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from rig_shared.outputs import listed
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


@dataclass(frozen=True)
class Kind:
    """Kind of tissue: parameters that are 0 in it, and its probability."""

    zero: tuple[str, ...]
    chance: float


_LINEAR, _ELASTIC = 0.1, 0.1  # probabilities of tissue that is linear at small strain, and that does not relax
LIVING = Kind((), 1 - _ELASTIC)
REAL_KINDS = (LIVING, Kind(("share_fast", "share_slow"), _ELASTIC))
"""Kinds of tissue under a real bench, weighed by the evidence of the presses."""

KINDS = tuple(
    Kind((*linear, *kind.zero), chance * kind.chance)
    for linear, chance in (((), 1 - _LINEAR), (("stiffening",), _LINEAR))
    for kind in REAL_KINDS
)
"""Kinds of tissue under a virtual bench too, where a finger may be linear: of small strain, with a stiffening
of 0. No real object is linear."""

_LEAST_CHANCE = 1e-12  # of a tail; its normal quantile is 7


class Prior:
    """Several independent parameters (p) of some kinds of tissue."""

    def __init__(self, parameters: Sequence[Parameter] = PARAMETERS, kinds: Sequence[Kind] = KINDS) -> None:
        self.parameters, self.kinds = tuple(parameters), tuple(kinds)
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
        """Return (n, p) random fingers of living tissue, which stiffens and relaxes."""
        from scipy.stats import truncnorm  # as long to import as all else of scipy, and every report imports this

        low, high = (np.array(edge - self.middle) / self.sd for edge in self.bounds)
        cut = truncnorm(low, high, loc=self.middle, scale=self.sd)
        return np.asarray(cut.ppf(chance.random((n, len(self.names)))))

    def draws_of_all_kinds(self, n: int, chance: np.random.Generator) -> Array:
        """Return (n, p) random fingers of all kinds of tissue, in random order."""
        ends = np.round(n * np.cumsum([kind.chance for kind in self.kinds])).astype(int)
        draws = self.draws(n, chance)
        for first, end, kind in zip([0, *ends[:-1]], ends, self.kinds, strict=True):
            draws[first:end, ~self.free(kind)] = 0.0
        return np.asarray(chance.permutation(draws))

    def free(self, kind: Kind) -> NDArray[np.bool_]:
        """(p,) whether a parameter is free in this kind of tissue."""
        return np.array([name not in kind.zero for name in self.names])

    def is_of(self, draws: Array, kind: Kind) -> NDArray[np.bool_]:
        """Return (n,) whether fingers are of this kind of tissue."""
        return np.asarray(((draws == 0.0) == ~self.free(kind))[:, self._zeroed].all(axis=1))

    @cached_property
    def _zeroed(self) -> NDArray[np.bool_]:
        """(p,) whether a parameter is 0 in some kind."""
        return np.asarray(~np.array([self.free(kind) for kind in self.kinds]).all(axis=0))

    def from_normal(self, normal: Array, kind: Kind) -> Array:
        """Return (n, p) fingers of a kind from (n, free) values that are standard normal for fingers of the prior."""
        from scipy.special import ndtr, ndtri  # slow to import, and most fingers are not identified

        free = self.free(kind)
        low, high = (tail[free] for tail in self._tails)
        draws = np.zeros((len(normal), len(self.names)))
        within = ndtri(low + (high - low) * np.clip(ndtr(normal), _LEAST_CHANCE, 1 - _LEAST_CHANCE))
        draws[:, free] = self.middle[free] + self.sd[free] * within
        least, most = self.bounds
        return np.where(free, np.clip(draws, least, most), 0.0)

    def to_normal(self, draws: Array, kind: Kind) -> Array:
        """Return the (n, free) values of `from_normal`; a free parameter that is 0 counts as its mean."""
        from scipy.special import ndtr, ndtri  # slow to import, and most fingers are not identified

        free = self.free(kind)
        low, high = (tail[free] for tail in self._tails)
        off = np.where(self._zeroed & (draws == 0.0), 0.0, self.off(draws))[:, free]
        share = (ndtr(off) - low) / (high - low)
        return np.asarray(ndtri(np.clip(share, _LEAST_CHANCE, 1 - _LEAST_CHANCE)))

    @cached_property
    def _tails(self) -> tuple[Array, Array]:
        """(p,) probabilities of a normal distribution below the bounds."""
        from scipy.special import ndtr  # slow to import, and most fingers are not identified

        low, high = ((edge - self.middle) / self.sd for edge in self.bounds)
        return np.asarray(ndtr(low)), np.asarray(ndtr(high))

    def within(self, draws: Array) -> NDArray[np.bool_]:
        """Return (n,) whether all parameters of a draw are within their bounds, or 0 as in a kind of tissue."""
        low, high = self.bounds
        none = self._zeroed & (draws == 0.0)
        return np.asarray((none | ((draws >= low) & (draws <= high))).all(axis=1))

    def off(self, draws: Array) -> Array:
        """Return the (n, p) differences from the means, in standard deviations."""
        return np.asarray((draws - self.middle) / self.sd)


# --- in numbers ---
#
# Parameters of the prior as values of a configuration: without logarithms, tissue and relaxation.

_LOGARITHM = "ln_"


def named(name: str) -> str:
    """Return the quantity of a parameter: its name without the prefix of a logarithm."""
    return name.removeprefix(_LOGARITHM)


ParameterName = Annotated[str, listed(named(one.name) for one in PARAMETERS)]


def plain(name: str, value: float) -> float:
    """Return the value of a parameter without its logarithm."""
    return math.exp(value) if name.startswith(_LOGARITHM) else float(value)


def in_numbers(values: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters by name and value, without logarithms."""
    return {named(name): plain(name, value) for name, value in values.items()}


def tissue_of(values: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters that are keys of `finger.tissue`."""
    return {name: value for name, value in in_numbers(values).items() if name in Tissue.model_fields}


def strain_of(stiffening: float) -> Literal["small", "finite"]:
    """Return the strain of an identified finger: one that does not stiffen is of the linear kind."""
    return "finite" if stiffening else "small"


def series_of(values: Mapping[str, float]) -> tuple[tuple[float, float], ...]:
    """Return the Prony series of a finger: shares and time constants (s); empty for tissue that does not relax."""
    numbers = in_numbers(values)
    series = (numbers["share_fast"], TAU_FAST_S), (numbers["share_slow"], numbers["tau_slow_s"])
    return tuple(term for term in series if term[0] > 0)
