"""Bayesian decoder: nonnegative pressures within a few contacts, with a band, from noisy receptors.

A smooth fit comes first, and a table of random pressures is weighted by the likelihood of the readings. With loud
noise that is the answer. Otherwise SED is linearized about the smooth fit, and a search climbs to the
maximum-likelihood contacts of each sort (number of contacts, with sharp ends or without). Then, for each sort, SED is
linearized about its own answer until that converges; pressures are averaged over all sorts, and over the table in
proportion to the information that it uses (`model_averaging`). With too few pressures to distinguish contacts, the
smooth fit is the answer.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky
from scipy.special import ndtr

from sim.coding.contact_search import Model, PressureLikelihood, Sort, alone, climbed, linearised, runs, sort_of
from sim.coding.decoder_results import checked_readings
from sim.coding.encoding import Receptor
from sim.coding.model_averaging import Mixture, Weighed, mixed, pooled, table_of, together
from sim.coding.operators import ForwardOperator
from sim.coding.receptor_readings import Readings

# --- smooth fit ---
#
# The cost is the readings' negative log likelihood plus ½ λ Pᵀ L P, with L of squared differences between neighbors.
# For each λ projected Gauss–Newton steps minimize it; λ is where Laplace's evidence is highest, no farther below the
# λ of the discrepancy principle than `EVIDENCE_DECADES`, since evidence alone may choose λ = 0. SED is the same for a
# pressure and its negative, hence several starts.

Array = NDArray[np.float64]

EVIDENCE_DECADES = 3.0
"""Decades by which λ may fall below the λ of the discrepancy principle."""

_DECADES = np.arange(2.0, -8.1, -0.5)  # of λ / the data's curvature; from smooth to rough
_WHOLE_DECADES = np.arange(0.0, -3.1, -1.0)
_ENOUGH = 1.5
_LEVEL = 0.1  # weight of the squares of the pressures in L, chosen on two samples (docs/validation/coding.md)
_MOST_STEPS = 60
_FIT_SETTLED = 1e-9
_NEAR = 1e-3  # the same for the start
_HALVINGS = 30
_STARTS = 3


@dataclass(frozen=True)
class _Fit:
    pressure: Array
    cost: float
    converged: bool


@dataclass(frozen=True)
class SmoothFit:
    """Maximum-a-posteriori pressures for one λ, and its (n, n) penalty."""

    pressure: Array
    smoothing: float  # λ
    penalty: Array
    converged: bool


def smooth_fit(operator: ForwardOperator, readings: Readings, seed: int) -> SmoothFit:
    """Return the fit whose λ has the highest evidence."""
    prior = _prior(operator.parts.shape[2])
    fits = _over_smoothing(operator, readings, prior, seed)
    smoothing = _chosen(operator, readings, prior, fits)
    chosen = fits[smoothing]
    return SmoothFit(chosen.pressure, smoothing, smoothing * prior, chosen.converged)


def smooth_start(operator: ForwardOperator, readings: Readings) -> SmoothFit:
    """Return a quick start: the fit by the discrepancy principle, with λ in whole decades.

    It is an even pressure where all pressures fell to 0.
    """
    prior = _prior(operator.parts.shape[2])
    even, as_root, *_ = _starts(operator, readings, 0)
    curvature = np.trace(_curvature(operator, readings, even)) / np.trace(prior)
    start = as_root
    for smoothing in (curvature * 10**_WHOLE_DECADES).tolist():
        fit = _fitted(operator, readings, smoothing * prior, start, _NEAR)
        start = fit.pressure if fit.pressure.any() else even
        if chi2(operator, readings, fit.pressure) <= _ENOUGH * (~readings.silent).sum():
            break
    return SmoothFit(start, smoothing, smoothing * prior, fit.converged)


def spread(operator: ForwardOperator, readings: Readings, fit: SmoothFit, wrong: Array) -> Array:
    """Return (n,) standard deviations: Laplace's covariance, plus the model error through the readings' gain.

    `wrong` is the (m, m) covariance of the model's SED.
    """
    slope, sed = operator.slope(fit.pressure), operator.sed(fit.pressure)
    _, _, second = readings.cost(sed)
    factor = cho_factor((slope.T * second) @ slope + fit.penalty)
    noise = np.diag(cho_solve(factor, np.eye(len(fit.pressure))))
    gain = cho_solve(factor, slope.T * second)
    return np.asarray(np.sqrt(noise + np.einsum("nm,mk,nk->n", gain, wrong, gain)))


def _prior(n: int) -> Array:
    difference = np.diff(np.eye(n), axis=0)
    return np.asarray(difference.T @ difference + _LEVEL * np.eye(n))


def _over_smoothing(operator: ForwardOperator, readings: Readings, prior: Array, seed: int) -> dict[float, _Fit]:
    """Return fits by λ, from smooth to rough; each starts from the one before, the first from several starts.

    A large λ may reduce all pressures to 0, where SED has no slope, so each also starts from an even pressure.
    """
    starts = _starts(operator, readings, seed)
    even = starts[0]
    curvature = np.trace(_curvature(operator, readings, starts[0])) / np.trace(prior)
    fits: dict[float, _Fit] = {}
    for smoothing in (curvature * 10**_DECADES).tolist():
        fitted = [_fitted(operator, readings, smoothing * prior, start) for start in starts]
        fits[smoothing] = min(fitted, key=lambda fit: fit.cost)
        starts = [fits[smoothing].pressure, even]
    return fits


def _starts(operator: ForwardOperator, readings: Readings, seed: int) -> list[Array]:
    """Return an even pressure of the readings' size, one shaped as their root, and random ones."""
    shown = np.sqrt(np.maximum(readings.sed, readings.sd))
    n = operator.parts.shape[2]
    as_root = np.interp(np.linspace(0, 1, n), np.linspace(0, 1, len(shown)), shown)
    shapes = [np.ones(n), as_root, *np.random.default_rng(seed).uniform(0.1, 1.0, (_STARTS, n))]
    return [shape * size_of(operator, readings, shape) for shape in shapes]


def size_of(operator: ForwardOperator, readings: Readings, shape: Array) -> float:
    """Return the factor by which pressures of a shape explain the readings best."""
    sed = operator.sed(shape)
    return float(np.sqrt(max(readings.sed @ sed, readings.sd * sed.max()) / (sed @ sed)))


def _fitted(
    operator: ForwardOperator, readings: Readings, penalty: Array, start: Array, settled_at: float = _FIT_SETTLED
) -> _Fit:
    """Minimize by projected Gauss–Newton (Bertsekas 1982): pressures at 0 that would fall stay."""
    pressure, cost = start, _cost(operator, readings, penalty, start)
    for _ in range(_MOST_STEPS):
        slope = operator.slope(pressure)
        _, first, second = readings.cost(operator.sed(pressure))
        gradient = first @ slope + penalty @ pressure
        free = (pressure > 0) | (gradient < 0)
        curvature = (slope.T * second) @ slope + penalty
        step = np.zeros_like(pressure)
        step[free] = -np.linalg.solve(curvature[np.ix_(free, free)], gradient[free])
        moved, lower = _searched(operator, readings, penalty, pressure, step, cost)
        settled = cost - lower <= settled_at * (1 + abs(cost))
        pressure, cost = moved, lower
        if settled:
            return _Fit(pressure, cost, converged=True)
    return _Fit(pressure, cost, converged=False)


def _searched(
    operator: ForwardOperator, readings: Readings, penalty: Array, pressure: Array, step: Array, cost: float
) -> tuple[Array, float]:
    """Return the first of successively halved steps that lowers the cost, or the start if none does."""
    for halving in range(_HALVINGS):
        moved = np.maximum(0.0, pressure + 0.5**halving * step)
        lower = _cost(operator, readings, penalty, moved)
        if lower < cost:
            return moved, lower
    return pressure, cost


def _cost(operator: ForwardOperator, readings: Readings, penalty: Array, pressure: Array) -> float:
    return float(readings.cost(operator.sed(pressure))[0].sum() + 0.5 * pressure @ penalty @ pressure)


def _curvature(operator: ForwardOperator, readings: Readings, pressure: Array) -> Array:
    slope = operator.slope(pressure)
    _, _, second = readings.cost(operator.sed(pressure))
    return np.asarray((slope.T * second) @ slope)


def chi2(operator: ForwardOperator, readings: Readings, pressure: Array) -> float:
    """Return Σ ((SED − reading) / sd)² over receptors that are not silent."""
    left = (operator.sed(pressure) - readings.sed) / readings.sd
    return float((left[~readings.silent] ** 2).sum())


def _chosen(operator: ForwardOperator, readings: Readings, prior: Array, fits: dict[float, _Fit]) -> float:
    """Return the λ of highest evidence, from the discrepancy principle's down to `EVIDENCE_DECADES` below it."""
    expected = float((~readings.silent).sum())
    misfits = {smoothing: chi2(operator, readings, fit.pressure) for smoothing, fit in fits.items()}
    enough = max(expected, 1.05 * min(misfits.values()))
    discrepancy = max(smoothing for smoothing, found in misfits.items() if found <= enough)
    floor = discrepancy / 10**EVIDENCE_DECADES
    allowed = [smoothing for smoothing in fits if floor <= smoothing <= discrepancy]
    return max(allowed, key=lambda smoothing: _evidence(operator, readings, smoothing * prior, fits[smoothing]))


def _evidence(operator: ForwardOperator, readings: Readings, penalty: Array, fit: _Fit) -> float:
    """Return Laplace's log evidence of a penalty over the positive pressures, up to a constant."""
    free = np.flatnonzero(fit.pressure > 0)
    if not len(free):
        return -fit.cost
    among = np.ix_(free, free)
    data = _curvature(operator, readings, fit.pressure)[among]
    return -fit.cost + 0.5 * (log_det(penalty[among]) - log_det(data + penalty[among]))


def log_det(matrix: Array) -> float:
    """Return the logarithm of a positive definite matrix's determinant; 0 for an empty one."""
    return 2 * float(np.log(np.diag(cholesky(matrix))).sum()) if len(matrix) else 0.0


Prior = Literal["contacts", "smooth"]

FEWEST_FOR_CONTACTS = 8
"""Fewest pressures that are decoded within contacts; fewer are decoded as a smooth profile."""

FEWEST_READINGS = 5
"""Fewest pressures within contacts, which may exceed the number of readings."""

_LOOSENED = 3.0
"""Model error in the first pass, relative to the final one; far from the solution linear SED is inaccurate too."""


_POSSIBLE = 8.0  # log evidence below the best in the first search
_STILL_POSSIBLE = 4.0  # the same in the first round, which later ones change by less than 1
_MOST_ROUNDS = 8
_AS_GOOD = 0.5  # likelihood power at which the table replaces the search; below it, the table's share is proportional
_SETTLED = 0.02  # relative L2 change of the pressures
_KEPT = 20  # models that start the next round


@dataclass(frozen=True)
class ModelError:
    """Error of the model's SED as a fraction, correlated over a length of skin; measured between meshes."""

    share: float = 0.04
    length_mm: float = 1.0

    def covariance(self, operator: ForwardOperator, sed: Array) -> Array:
        """Return the (m, m) covariance of SEDs."""
        at = operator.receptor_mm.reshape(len(sed), -1)  # along the skin, or over x and z
        apart = np.linalg.norm(at[:, None] - at, axis=-1) / self.length_mm
        return np.asarray(self.share**2 * np.outer(sed, sed) * np.exp(-0.5 * apart**2))


CONTACTS_ERROR = ModelError(0.02, 0.5)
"""Model error of pressures within contacts, in addition to that of leans; smaller at round contacts, larger and over
shorter lengths at corners (docs/validation/coding.md)."""


@dataclass(frozen=True)
class Profile:
    """Decoded pressures with standard deviations; `converged` is false where a search reached its limit."""

    pressure: Array  # (n,) pseudo-units, none below 0
    sd: Array  # (n,) from noise, prior and model error
    smoothing: float  # λ of the smooth fit
    misfit: float  # Σ ((SED − reading) / sd)² over receptors that are not silent
    converged: bool
    mixture: Mixture | None = None  # for pressures within contacts

    def band(self, z: float = 1.645) -> tuple[Array, Array]:
        """Return (n,) lower and upper bounds, of 90 % by default; not below 0, and including the pressure itself.

        The bounds of a mixture are quantiles. Its mean may lie outside them, where a few models have a contact and
        the rest have none; the band then extends to it.
        """
        if self.mixture is None:
            low, high = -z * self.sd, z * self.sd
        else:
            mean, sd = self.mixture.moments()
            wider = np.divide(self.sd, sd, out=np.ones_like(sd), where=sd > 0)
            low, high = (wider * (self.mixture.quantile(float(ndtr(k))) - mean) for k in (-z, z))
        return np.maximum(0.0, self.pressure + np.minimum(0.0, low)), self.pressure + np.maximum(0.0, high)


def decode_profile(
    operator: ForwardOperator,
    readings: Readings,
    error: ModelError | None = None,
    seed: int = 0,
    *,
    prior: Prior | None = None,
    table: bool = True,
) -> Profile:
    """Return pressures and their uncertainty. Raises DecodingError for invalid readings.

    With the prior `contacts` the result is the mean over all possible contacts, with `smooth` the most probable
    pressures; by default contacts, unless there are few pressures. Without the table, which is made once per
    operator, the search alone decides.
    """
    if (prior or ("contacts" if operator.parts.shape[2] >= FEWEST_FOR_CONTACTS else "smooth")) == "contacts":
        checked_readings(operator, readings.sed, FEWEST_READINGS)
        return _within_contacts(operator, readings, CONTACTS_ERROR if error is None else error, table=table)
    checked_readings(operator, readings.sed)
    return _smooth(operator, readings, ModelError() if error is None else error, seed)


def _smooth(operator: ForwardOperator, readings: Readings, error: ModelError, seed: int) -> Profile:
    fit = smooth_fit(operator, readings, seed)
    sd = spread(operator, readings, fit, error.covariance(operator, operator.sed(fit.pressure)))
    return Profile(fit.pressure, sd, fit.smoothing, chi2(operator, readings, fit.pressure), fit.converged)


@dataclass(frozen=True)
class _Within:
    """Problem of pressures within contacts, given readings."""

    operator: ForwardOperator
    readings: Readings
    error: ModelError
    typical: float  # typical pressure in contact

    def seen_from(self, pressure: Array, loosened: float = 1.0) -> PressureLikelihood:
        """Return the likelihood linearized about pressures; a silent receptor's by Newton's step."""
        there = self.operator.leaning(pressure)
        sed, slope = there.sed(pressure), there.slope(pressure)
        first, second = self.readings.derivatives(sed)
        wrong = self.error.covariance(self.operator, sed) + self.operator.unsure(pressure)
        covariance = np.diag(1 / second) + loosened**2 * wrong
        return linearised(slope, slope @ pressure - first / second, covariance, self.typical)

    def begun(self, likelihood: PressureLikelihood, model: Model) -> "_Round":
        """Return models of one sort, linearized about the mean of one of them."""
        return self.next_of(
            _Round(sort_of(model), mixed(likelihood, {model: 0.0}), [model], moved=np.inf, at_top=False)
        )

    def next_of(self, last: "_Round") -> "_Round":
        """Return the next round, linearized about the last round's mean."""
        pressure, _ = last.mixture.moments()
        near = self.seen_from(pressure)
        climb = climbed(near, last.models, sort=last.sort)
        mixture = mixed(near, climb.known)
        moved = float(np.linalg.norm(mixture.moments()[0] - pressure) / np.linalg.norm(pressure))
        return _Round(last.sort, mixture, climb.best(_KEPT), moved, climb.at_top)

    def settled(self, begun: "_Round") -> "_Round":
        """Iterate rounds until the pressures converge."""
        last = begun
        for _ in range(_MOST_ROUNDS - 1):
            if last.settled:
                break
            last = self.next_of(last)
        return last


class _Round(NamedTuple):
    """Models of one sort, linearized about the previous round's mean."""

    sort: Sort
    mixture: Mixture
    models: list[Model]
    moved: float  # relative L2
    at_top: bool

    @property
    def settled(self) -> bool:
        return self.at_top and self.moved <= _SETTLED


def _within_contacts(operator: ForwardOperator, readings: Readings, error: ModelError, *, table: bool) -> Profile:
    """Decode by the table where it uses most of the information; else average it with the search over all sorts."""
    start = smooth_start(operator.leaning(np.zeros(operator.parts.shape[2])), readings)
    by_table = _by_table(operator, readings, error, start.pressure) if table else None
    share = 0.0 if by_table is None else by_table.power / _AS_GOOD
    if by_table is not None and share >= 1:
        mixture, converged = by_table.mixture, True
    else:
        mixture, converged = _by_search(operator, readings, error, start.pressure)
        if by_table is not None:
            mixture = pooled(by_table.mixture, mixture, share)
    pressure, sd = mixture.moments()
    return Profile(pressure, sd, start.smoothing, chi2(operator, readings, pressure), converged, mixture)


def _by_table(operator: ForwardOperator, readings: Readings, error: ModelError, begun: Array) -> Weighed:
    """Weight the table; a silent receptor counts, by Newton's step, as a reading with uncertain noise."""
    sed = operator.sed(begun)
    first, second = readings.derivatives(sed)
    variance = 1 / second + np.diag(error.covariance(operator, sed))
    return table_of(operator).weighed(sed - first / second, variance, float(np.linalg.norm(sed)))


def _by_search(
    operator: ForwardOperator, readings: Readings, error: ModelError, begun: Array
) -> tuple[Mixture, bool]:
    """Search each sort that a first search and round leave possible; return whether all converged."""
    within = _Within(operator, readings, error, float(begun @ begun / begun.sum()))
    likelihood = within.seen_from(begun, _LOOSENED)
    first = climbed(likelihood, [*runs(begun), *alone(len(begun))], _STARTS)
    rounds = [within.begun(likelihood, model) for model in first.best_of_sorts(_POSSIBLE).values()]
    best = max(one.mixture.log_weight.max() for one in rounds)
    found = [within.settled(one) for one in rounds if one.mixture.log_weight.max() > best - _STILL_POSSIBLE]
    return together([one.mixture for one in found]), all(one.settled for one in found)


# --- fitted receptor ---
#
# Standard errors of a fitted receptor's gain and threshold widen the band.


@dataclass(frozen=True)
class FittedReceptor:
    """R = k (S − S₀) with independent standard errors of k and S₀; smaller than k, so that k stays positive."""

    receptor: Receptor
    gain_se: float = 0.0
    threshold_se: float = 0.0


def decode_through(fitted: FittedReceptor, decode: Callable[[Receptor], Profile]) -> Profile:
    """Decode rates, with a band widened by the receptor's standard errors.

    `decode` runs again with gain and threshold one standard error up and down; half the change of the pressures is
    added in quadrature. Converged if all runs are.
    """
    found = decode(fitted.receptor)
    variance, converged = found.sd**2, found.converged
    for name, se in (("gain", fitted.gain_se), ("threshold", fitted.threshold_se)):
        if se > 0:
            middle = getattr(fitted.receptor, name)
            up, down = (decode(replace(fitted.receptor, **{name: middle + sign * se})) for sign in (1, -1))
            variance = variance + ((up.pressure - down.pressure) / 2) ** 2
            converged = converged and up.converged and down.converged
    return replace(found, sd=np.sqrt(variance), converged=converged)
