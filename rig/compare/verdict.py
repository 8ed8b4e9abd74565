"""Verdict on the measures from the recording of one afferent; table, sentence and JSON are derived from it."""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Limits = tuple[float, float]
Outcome = Literal["explained", "not beyond controls", "nothing"]

LEVEL = 0.05
"""p below which a fit is rejected, and a pair leaves the model confidence set. Not corrected for many pairs."""

A_CONSTANT = "a constant rate"


class RecordingNoise(NamedTuple):
    """What was recorded, where the size of its noise is known from, and that size.

    `dispersion` of counts is their variance over Poisson's, of rates with an sd 1, of rates alone the variance of one
    press (rate²). `freedom`: the degrees of freedom behind it.
    """

    kind: Literal["counts", "sd", "rates"]
    source: Literal["repeats", "sd", "neighbours"]
    dispersion: float
    freedom: float


class FittedPositions(NamedTuple):
    """The (p,) positions that all of an answer is over: number of the stimulus, mm, mean rate, its standard error."""

    stimulus: NDArray[np.int64]
    position_mm: Array
    rate: Array
    error: Array


@dataclass(frozen=True, eq=False)
class PairRow:
    """A measure or a control at one receptor, and how it fares.

    R = z / (1 + `saturation` z), z = max(0, k(ε − ε₀)). Intervals: 95 %, profile likelihood of this pair alone.
    `deviance` is over the dispersion; `left_out` the share of it that is predicted where the pair was not fitted.
    Arrays (p,): the measure, predicted rates, and residuals in standard deviations of the noise.
    """

    name: str
    control: bool
    receptor_mm: float | None
    k: float
    eps0: float
    saturation: float
    k_interval: Limits
    eps0_interval: Limits
    r: float
    r2: float
    deviance: float
    lack_of_fit: float
    p_fit: float
    p_set: float
    left_out: float
    eps: Array
    predicted: Array
    residual: Array
    finger: dict[str, float] | None = None

    @property
    def title(self) -> str:
        """For example "ep1 at −1 mm"."""
        return titled(self.name, self.receptor_mm)

    @property
    def fits(self) -> bool:
        """Whether its own fit does not reject it."""
        return self.p_fit >= LEVEL

    @property
    def in_set(self) -> bool:
        """Whether the pair fits, and no other pair is known to be better."""
        return self.fits and self.p_set >= LEVEL

    @property
    def fires_unloaded(self) -> bool:
        """Whether the model fires at ε = 0."""
        return self.k * self.eps0 < 0


class LeftOut(NamedTuple):
    """Recorded positions of one stimulus that are not used, since not every receptor covers them, and their rates."""

    stimulus: str
    position_mm: tuple[float, ...]
    rate: tuple[float, ...] = ()


class Mimic(NamedTuple):
    """Were a control the truth: the pair that imitates it best, and how probably even this one would be rejected."""

    control: str
    pair: str
    probability: float


class Power(NamedTuple):
    """Power of the fit test: the rms misfit, relative to the largest rate, that it rejects in 80 % of recordings."""

    detectable: float
    mimics: tuple[Mimic, ...]


class Separate(NamedTuple):
    """The maximum-likelihood pair fitted to one stimulus alone, and how well the other stimuli predict this one."""

    stimulus: str
    k: float
    eps0: float
    left_out: float


class Together(NamedTuple):
    """Whether separate fits of each stimulus are better than the one fit of all: F test of the likeliest pair."""

    freedom: tuple[float, float]
    ratio: float
    p: float
    separate: tuple[Separate, ...]


@dataclass(frozen=True, eq=False)
class AfferentVerdict:
    """What one afferent's recordings say; every statement is made from `rows`, likeliest first.

    `recorded` positions are in the files, those of `places` are used. `ceiling`: the share of variance that a model
    can explain, by split halves of repeats or, as an upper bound, by the best monotone function of any candidate.
    """

    title: str
    stimuli: tuple[str, ...]
    recordings: tuple[str, ...]
    places: FittedPositions
    recorded: int
    left_out: tuple[LeftOut, ...]
    noise: RecordingNoise
    ceiling: float
    ceiling_from: Literal["repeats", "monotone"]
    rows: tuple[PairRow, ...]
    together: Together | None
    power: Power
    saturating: bool = False
    silent_at_rest: bool = False
    fingers: int = 1

    @property
    def measures(self) -> list[PairRow]:
        """Every pair of a measure and a receptor."""
        return [row for row in self.rows if not row.control]

    @property
    def controls(self) -> list[PairRow]:
        """The controls, which a measure must beat."""
        return [row for row in self.rows if row.control]

    @property
    def set(self) -> list[PairRow]:
        """The pairs that this recording can neither reject nor tell apart."""
        return [row for row in self.measures if row.in_set]

    @property
    def controls_in_set(self) -> list[PairRow]:
        """The controls that the recording cannot tell from these."""
        return [row for row in self.controls if row.in_set]

    @property
    def outcome(self) -> Outcome:
        """Explained only if some measure is in the set and no control is."""
        if not self.set:
            return "nothing"
        return "not beyond controls" if self.controls_in_set else "explained"

    @property
    def closest(self) -> PairRow:
        """The maximum-likelihood measure, whether it fits or not."""
        return self.measures[0]

    @property
    def headline(self) -> PairRow | None:
        """The maximum-likelihood pair of the set."""
        return next(iter(self.set), None)

    @property
    def next(self) -> PairRow | None:
        """The maximum-likelihood measure outside the set."""
        return next((row for row in self.measures if not row.in_set), None)

    @property
    def worse_by(self) -> float:
        """Deviance of the next pair minus that of the headline, relative to the dispersion; NaN without both."""
        first, second = self.headline, self.next
        return np.nan if first is None or second is None else second.deviance - first.deviance

    def interval(self, name: str, of: Literal["k", "eps0"]) -> Limits:
        """Limits of k or ε₀ of a measure at whichever receptor of the set; NaN where it has none."""
        limits = [getattr(row, f"{of}_interval") for row in self.set if row.name == name]
        low, high = zip(*limits, strict=True) if limits else ((np.nan,), (np.nan,))
        return float(np.min(low)), float(np.max(high))


def titled(name: str, receptor_mm: float | None) -> str:
    """A candidate at a receptor, for example "ep1 at −1.25 mm"."""
    return name if receptor_mm is None else f"{name} at {in_mm(receptor_mm)} mm"


def in_mm(x: float) -> str:
    """For example "−1.25"."""
    return f"{round(x, 6) + 0.0:g}".replace("-", "−")


def six_digits(value: float) -> float | None:
    """Round to six digits for JSON; NaN and infinities are None."""
    return float(f"{value:.6g}") if math.isfinite(value) else None
