"""Verdict on the measures from the recordings of one afferent, from which table, sentence and JSON are derived."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.stimuli import CONTROLS
from rig_shared.outputs import listed
from sim.measures.measures import MEASURES

Array = NDArray[np.float64]
Limits = tuple[float, float]
Outcome = Literal["explained", "not beyond controls", "nothing", "silent"]

LEVEL = 0.05
"""p below which a fit is rejected, and a pair leaves the model confidence set. Not corrected for many pairs."""

A_CONSTANT = "a constant rate"
Candidate = Annotated[str, listed((*MEASURES, *CONTROLS, A_CONSTANT))]


class RecordingNoise(NamedTuple):
    """Kind of recording, source of its noise estimate, and the noise.

    `dispersion` of counts is their variance over Poisson's, of rates with an sd 1, of rates alone the variance of one
    press (rate²). `freedom` is the number of degrees of freedom of the estimate.
    """

    kind: Literal["counts", "sd", "rates"]
    source: Literal["repeats", "sd", "neighbours"]
    dispersion: float
    freedom: float


class FittedPositions(NamedTuple):
    """Positions (p,) that a verdict is based on: number of the stimulus, mm, mean rate, its standard error."""

    stimulus: NDArray[np.int64]
    position_mm: Array
    rate: Array
    error: Array


@dataclass(frozen=True, eq=False)
class PairRow:
    """Measure or control at one receptor, with its fit and tests.

    R = z / (1 + `saturation` z), z = max(0, k(ε − ε₀)). Intervals: 95 %, profile likelihood of this pair alone.
    `deviance` is over the dispersion; `left_out` is the share of it that is predicted for held-out positions.
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
        """Title, e.g. "ep1 at −1 mm"."""
        return titled(self.name, self.receptor_mm)

    @property
    def fits(self) -> bool:
        """Whether the fit is not rejected."""
        return self.p_fit >= LEVEL

    @property
    def in_set(self) -> bool:
        """Whether the pair fits, and no other pair is significantly better."""
        return self.fits and self.p_set >= LEVEL

    @property
    def fires_unloaded(self) -> bool:
        """Whether the model fires at ε = 0."""
        return self.k * self.eps0 < 0


class LeftOut(NamedTuple):
    """Recorded positions of one stimulus, and their rates, that not every receptor covers."""

    stimulus: str
    position_mm: tuple[float, ...]
    rate: tuple[float, ...] = ()
    sentence: str = ""  # how many, why, and what would measure them


class Mimic(NamedTuple):
    """Best imitator of a control, and the probability of its rejection if that control were true."""

    control: str
    pair: str
    probability: float


class Power(NamedTuple):
    """Power of the fit test: the rms misfit, relative to the largest rate, that it rejects in 80 % of recordings."""

    detectable: float
    mimics: tuple[Mimic, ...]


class Separate(NamedTuple):
    """Separate fit of the maximum-likelihood pair to one stimulus, and prediction of it from the others."""

    stimulus: str
    k: float
    eps0: float
    left_out: float


class Together(NamedTuple):
    """F test of separate fits against the joint fit, for the maximum-likelihood pair."""

    freedom: tuple[float, float]
    ratio: float
    p: float
    separate: tuple[Separate, ...]


@dataclass(frozen=True, eq=False)
class AfferentVerdict:
    """Verdict on one afferent; every statement is derived from `rows`, best first.

    `recorded` counts positions in the files, `places` holds those that are used. `ceiling` is the share of variance
    that a model can explain, by split halves of repeats or, as an upper bound, by the best monotone function of any
    candidate. `rows` are empty for an afferent that was silent: nothing was compared.
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
    spikes: int | None = None
    """Number of spikes in all windows together, if spikes were counted."""
    rate_unit: str = "1/s"
    """Unit of the recorded rates."""
    not_observed: tuple[str, ...] = ()
    """Per recording, how many presses were left out since the unit was not observed, and when it was."""

    @property
    def measures(self) -> list[PairRow]:
        """Pairs of a measure and a receptor."""
        return [row for row in self.rows if not row.control]

    @property
    def controls(self) -> list[PairRow]:
        """Controls that a measure must outperform."""
        return [row for row in self.rows if row.control]

    @property
    def set(self) -> list[PairRow]:
        """Pairs that this recording can neither reject nor distinguish."""
        return [row for row in self.measures if row.in_set]

    @property
    def controls_in_set(self) -> list[PairRow]:
        """Controls in the set."""
        return [row for row in self.controls if row.in_set]

    @property
    def outcome(self) -> Outcome:
        """Outcome; "explained" requires a measure, and no control, in the set."""
        if not self.rows:
            return "silent"
        if not self.set:
            return "nothing"
        return "not beyond controls" if self.controls_in_set else "explained"

    @property
    def closest(self) -> PairRow:
        """Maximum-likelihood measure, rejected or not; a silent afferent has none."""
        return self.measures[0]

    @property
    def headline(self) -> PairRow | None:
        """Maximum-likelihood pair of the set."""
        return next(iter(self.set), None)

    @property
    def next(self) -> PairRow | None:
        """Maximum-likelihood measure outside the set."""
        return next((row for row in self.measures if not row.in_set), None)

    @property
    def worse_by(self) -> float:
        """Deviance of the next pair minus that of the headline, relative to the dispersion; NaN without both."""
        first, second = self.headline, self.next
        return np.nan if first is None or second is None else second.deviance - first.deviance

    def interval(self, name: str, of: Literal["k", "eps0"]) -> Limits:
        """Return the limits of k or ε₀ of a measure over its receptors in the set; NaN if it has none."""
        limits = [getattr(row, f"{of}_interval") for row in self.set if row.name == name]
        low, high = zip(*limits, strict=True) if limits else ((np.nan,), (np.nan,))
        return float(np.min(low)), float(np.max(high))


def titled(name: str, receptor_mm: float | None) -> str:
    """Return a candidate at a receptor, e.g. "ep1 at −1.25 mm"."""
    return name if receptor_mm is None else f"{name} at {in_mm(receptor_mm)} mm"


def in_mm(x: float) -> str:
    """Format a position, e.g. "−1.25"."""
    return f"{round(x, 6) + 0.0:g}".replace("-", "−")


def six_digits(value: float) -> float | None:
    """Round to six digits for JSON; return None for NaN and infinities."""
    return float(f"{value:.6g}") if math.isfinite(value) else None
