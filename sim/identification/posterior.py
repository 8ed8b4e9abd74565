"""Posterior of a finger after some presses: its mode by Gauss-Newton, then weighted draws around it.

Readings are compared after a variance-stabilizing transform: y = asinh(ε F / σ) / ε is F / σ where noise dominates,
and a logarithm where the model error does. Errors that readings share (model, depth, zero) are in their covariance.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.special import chdtrc

from sim.identification.predicted_forces import MeasuredPress, PredictedForces
from sim.identification.prior import TISSUE, Prior
from sim.identification.uncertainty_bands import Width

Array = NDArray[np.float64]

READING_ERROR, PRESS_ERROR, SHAPE_ERROR, DEPTH_SD_MM = 0.01, 0.01, 0.02, 0.004
"""Relative model errors of a reading, of a press, and of all presses of a shape; and the error of the stage in depth
(mm)."""

DRAWS = 1500
_LEAST_NOISE_GWT = 0.003  # one step of a fine balance
_STARTS, _STEPS, _WIDER, _FREEDOM, _ROUNDS = 600, 25, 1.3, 6.0, 3
_STEP = 1e-3  # step of derivatives, relative to the sd of the prior
_MOST_MOVED = 1.5  # largest step, relative to the sd of the prior


@dataclass(frozen=True)
class Learned:
    """Equally likely fingers after some presses."""

    prior: Prior
    draws: Array  # (n, p)
    most_likely: Array  # (p,)
    misfit: Array  # (presses,) squared standardized distance of the most likely finger from each press
    readings: NDArray[np.int64]  # (presses,) number of readings
    total: float  # squared standardized distance from all presses and the prior mean
    effective: float  # effective number of draws

    @property
    def collapsed(self) -> bool:
        """Whether too few effective draws remain for a meaningful spread."""
        return self.effective < least_effective(len(self.prior.names))

    @property
    def mean(self) -> Array:
        """(p,) mean."""
        return np.asarray(self.draws.mean(axis=0))

    @property
    def covariance(self) -> Array:
        """(p, p) covariance."""
        return np.asarray(np.cov(self.draws.T))


def least_effective(parameters: int) -> int:
    """Return the least number of effective draws for a covariance of this many parameters."""
    return 4 * parameters


def nothing_learned(prior: Prior, chance: np.random.Generator, n: int = DRAWS) -> Learned:
    """Return the estimate before the first press."""
    none = np.zeros(0)
    return Learned(prior, prior.draws(n, chance), prior.middle, none, none.astype(np.int64), 0.0, float(n))


class PressResiduals:
    """Presses so far, and the residuals of any finger."""

    def __init__(self, predicted: PredictedForces, presses: Sequence[MeasuredPress]) -> None:
        self._predicted, self._presses = predicted, presses
        self._own = [_covariance(press) for press in presses]
        self._whitening = _whitening(_together(presses, self._own))

    def each_off(self, draws: Array) -> list[Array]:
        """Return (n, r) of each press: measured minus predicted, after the transform."""
        return [
            _even(press.force_gwt, press) - _even(self._predicted.forces_gwt(draws, press.trajectory), press)
            for press in self._presses
        ]

    def off(self, draws: Array) -> Array:
        """Return the (n, r + p) standardized, uncorrelated residuals of all presses and the prior."""
        all_of_them = np.concatenate(self.each_off(draws), axis=1) @ self._whitening.T
        return np.concatenate([all_of_them, self._predicted.prior.off(draws)], axis=1)

    def misfits(self, draw: Array) -> Array:
        """Return the (presses,) squared standardized distances of one finger from each press alone."""
        shared = [np.outer(one, one) for one in (_shared(press) for press in self._presses)]
        return np.array([
            float(off[0] @ np.linalg.solve(own + shape, off[0]))
            for off, own, shape in zip(self.each_off(draw[None]), self._own, shared, strict=True)
        ])  # fmt: skip


def learn(
    predicted: PredictedForces, presses: Sequence[MeasuredPress], before: Learned, chance: np.random.Generator
) -> Learned:
    """Return the estimate after all presses; before: the previous estimate, as a start."""
    prior, readings = predicted.prior, PressResiduals(predicted, presses)
    start = _start(readings, before, chance)
    most_likely, spread = _climbed(prior, readings, start)
    middle, covariance, draws, weights = most_likely, _WIDER * spread, before.draws, np.ones(1)
    for _ in range(_ROUNDS):
        draws, ln_density = _student(middle, covariance, len(before.draws), chance)
        if not prior.within(draws).any():
            draws[0] = most_likely  # all the weight on one finger: collapsed
        weights = _weights(prior, readings, draws, ln_density)
        middle, covariance = _moments(draws, weights, most_likely, spread)
    kept = draws[_systematic(weights, len(before.draws), chance)]
    counts = np.array([len(press.force_gwt) for press in presses])
    total = float((readings.off(most_likely[None]) ** 2).sum())
    effective = float(1 / np.square(weights).sum())
    return Learned(prior, kept, most_likely, readings.misfits(most_likely), counts, total, effective)


def _noise_gwt(press: MeasuredPress) -> float:
    return max(press.noise_gwt, _LEAST_NOISE_GWT)


def _even(force_gwt: Array, press: MeasuredPress) -> Array:
    return np.asarray(np.arcsinh(READING_ERROR * force_gwt / _noise_gwt(press)) / READING_ERROR)


def _scale(press: MeasuredPress) -> Array:
    """Return the (r,) derivatives of the transform (1/gwt)."""
    return np.asarray(1 / np.hypot(_noise_gwt(press), READING_ERROR * press.force_gwt))


def _covariance(press: MeasuredPress) -> Array:
    """Return the (r, r) covariance of the transformed readings of one press."""
    scale = _scale(press)
    shared = PRESS_ERROR * press.force_gwt * scale
    deeper = DEPTH_SD_MM * _slope_gwt_mm(press) * scale
    zero = press.zero_sd_gwt * scale
    return np.asarray(np.eye(len(scale)) + sum(np.outer(one, one) for one in (shared, deeper, zero)))


def _shared(press: MeasuredPress) -> Array:
    """Return the (r,) error that all presses of a shape share."""
    return np.asarray(SHAPE_ERROR * press.force_gwt * _scale(press))


def _together(presses: Sequence[MeasuredPress], own: Sequence[Array]) -> Array:
    """Return the covariance of all readings."""
    names = np.concatenate([[press.trajectory.indentor] * len(press.force_gwt) for press in presses])
    shared = np.concatenate([_shared(press) for press in presses])
    alike = names[:, None] == names
    return np.asarray(block_diag(*own) + np.where(alike, np.outer(shared, shared), 0.0))


def _whitening(covariance: Array) -> Array:
    """Return the (r, r) matrix that makes residuals uncorrelated with variance 1."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def _slope_gwt_mm(press: MeasuredPress) -> Array:
    """Return the slope of force over depth at each reading (gwt/mm), for F ∝ d^1.7 from the first force."""
    height = press.trajectory.height_mm[press.trajectory.lowest]
    shown = press.force_gwt > 3 * _noise_gwt(press)
    touch_mm = float(height[np.argmax(shown)]) if shown.any() else float(height[0])
    return np.asarray(1.7 * np.maximum(press.force_gwt, 0.0) / np.maximum(touch_mm - height + 0.03, 0.03))


def _start(readings: PressResiduals, before: Learned, chance: np.random.Generator) -> Array:
    """Return the best of the previous draws and of the prior."""
    tried = np.concatenate([before.draws[:_STARTS], before.prior.draws(_STARTS, chance)])
    return np.asarray(tried[np.argmin((readings.off(tried) ** 2).sum(axis=1))])


def _climbed(prior: Prior, readings: PressResiduals, start: Array) -> tuple[Array, Array]:
    """Return the most likely finger within the bounds, and its linearized covariance (Levenberg-Marquardt)."""
    (low, high), sd = prior.bounds, prior.sd
    at, damping = start, 1e-2
    off = readings.off(at[None])[0]
    for _ in range(_STEPS):
        slope = _slopes(readings, at, sd)
        normal = slope.T @ slope
        step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slope.T @ off)
        tried = np.clip(at + sd * np.clip(step, -_MOST_MOVED, _MOST_MOVED), low, high)
        tried_off = readings.off(tried[None])[0]
        gained = float(off @ off - tried_off @ tried_off)
        if gained > 0:
            at, off, damping = tried, tried_off, damping / 5
        else:
            damping *= 5
        if abs(gained) < 1e-3 or damping > 1e6:
            break
    slope = _slopes(readings, at, sd)
    return at, np.asarray(np.linalg.inv(slope.T @ slope) * np.outer(sd, sd))


def _slopes(readings: PressResiduals, at: Array, sd: Array) -> Array:
    """Return the (r, p) derivatives of the residuals, per sd of the prior."""
    step = _STEP * np.diag(sd)
    off = readings.off(np.concatenate([at + step, at - step]))
    return np.asarray((off[: len(at)] - off[len(at) :]).T / (2 * _STEP))


def _student(middle: Array, covariance: Array, n: int, chance: np.random.Generator) -> tuple[Array, Array]:
    """Return (n, p) draws of a Student t distribution, and their log density up to a constant."""
    root = np.linalg.cholesky(covariance)
    normal = chance.standard_normal((n, len(middle)))
    z = normal / np.sqrt(chance.chisquare(_FREEDOM, n) / _FREEDOM)[:, None]
    return middle + z @ root.T, -0.5 * (_FREEDOM + len(middle)) * np.log1p((z**2).sum(axis=1) / _FREEDOM)


def _weights(prior: Prior, readings: PressResiduals, draws: Array, ln_density: Array) -> Array:
    """Return the (n,) importance weights, which sum to 1."""
    within = prior.within(draws)
    ln = np.full(len(draws), -np.inf)
    ln[within] = -0.5 * (readings.off(draws[within]) ** 2).sum(axis=1) - ln_density[within]
    weights = np.exp(ln - ln.max())
    return np.asarray(weights / weights.sum())


def _moments(draws: Array, weights: Array, most_likely: Array, spread: Array) -> tuple[Array, Array]:
    """Return mean and covariance of weighted draws, or the linearized ones for too few effective draws."""
    if 1 / np.square(weights).sum() < least_effective(draws.shape[1]):
        return most_likely, 2 * _WIDER * spread
    middle = weights @ draws
    covariance = (weights[:, None] * (draws - middle)).T @ (draws - middle)
    return np.asarray(middle), np.asarray(_WIDER * covariance + 1e-9 * np.diag(np.diag(spread)))


def _systematic(weights: Array, n: int, chance: np.random.Generator) -> NDArray[np.intp]:
    """Return (n,) indices by systematic resampling."""
    at = (np.arange(n) + chance.random()) / n
    return np.minimum(np.searchsorted(np.cumsum(weights), at), len(weights) - 1)


# --- misfit ---
#
# Test whether any finger of the prior explains the presses.

CHANCE_OF_ALL, CHANCE_OF_ONE, CHANCE_OF_LAYERS, MOST_SURPRISE = 0.01, 0.001, 0.01, 4.5
"""Significance levels for the misfit of all readings, of the worst press, and of the moduli; and the largest surprise
of a press, in standard deviations."""

_COMPARED, _RARE, _MOST_PRESSES = 300, 0.025, 0.6  # fingers; share of them; share of the presses
_DEEP, _ENOUGH = 0.3, 3  # share of the largest depth, and readings: there the error of the touch is small
_JUMP_MM = 0.03
_STEP_MM, _LEAST = 1e-3, 1e-12


@dataclass(frozen=True)
class Surprise:
    """Highest force of a press: predicted before it, and measured."""

    predicted: Width
    sd: float  # of the logarithm of the force
    measured_gwt: float

    @property
    def sds(self) -> float:
        """Difference of measurement and prediction, in standard deviations."""
        return float(np.log(max(self.measured_gwt, 1e-3) / self.predicted.middle) / self.sd)


def no_finger(
    predicted: PredictedForces, presses: Sequence[MeasuredPress], learned: Learned, surprises: Sequence[Surprise]
) -> str | None:
    """Return why no finger of the prior explains the presses, as a sentence; None if one does."""
    if not presses:
        return None
    total_off = chdtrc(int(learned.readings.sum()), learned.total) < CHANCE_OF_ALL
    one_off = bool((chdtrc(learned.readings, learned.misfit) < CHANCE_OF_ONE).any())
    surprising = max((abs(one.sds) for one in surprises), default=0.0) > MOST_SURPRISE
    if not (total_off or one_off or surprising):
        return _NO_LAYERS if _layers_off(learned) else None
    return f"no finger of the prior predicts these forces: {_how(predicted, presses, learned)}"


_NO_LAYERS = "no finger of the prior is likely to give these forces; its layers would be at the ends of their ranges"


def _layers_off(learned: Learned) -> bool:
    """Return whether only unlikely moduli of dermis and fat fit, as with other layers."""
    off = learned.prior.off(learned.most_likely)[[learned.prior.index(name) for name in TISSUE]]
    return bool(chdtrc(len(TISSUE), float(off @ off)) < CHANCE_OF_LAYERS)


def _how(predicted: PredictedForces, presses: Sequence[MeasuredPress], learned: Learned) -> str:
    """Return the likely reason, from the growth of force with depth and the heights of the skin."""
    any_of_them = learned.prior.draws(_COMPARED, np.random.default_rng(0))
    ranks = [rank for press in presses if (rank := _rank(predicted, press, any_of_them)) is not None]
    if ranks and np.mean(np.array(ranks) > 1 - _RARE) > _MOST_PRESSES:
        return (
            "force grows more steeply with depth; something stiff lies under the skin, e.g. bone under the indentor"
        )
    if ranks and np.mean(np.array(ranks) < _RARE) > _MOST_PRESSES:
        return "force grows less steeply with depth; the object is homogeneous, e.g. a rubber ball"
    shift_mm = np.array([_shift_mm(predicted, press, learned.most_likely) for press in presses])
    jump_mm = np.diff(shift_mm)
    if len(jump_mm) and np.abs(jump_mm).max() > _JUMP_MM:
        k = int(np.argmax(np.abs(jump_mm)))
        return f"at press {k + 2} the surface moved by {1e3 * jump_mm[k]:+.0f} µm; check whether the mount slips"
    return "shapes and positions do not agree on one finger"


def _rank(predicted: PredictedForces, press: MeasuredPress, draws: Array) -> float | None:
    """Return the share of fingers whose force grows less steeply with depth; None for too few readings."""
    trajectory = press.by_depth
    deep = trajectory.height_mm[trajectory.lowest] < _DEEP * trajectory.height_mm.min()
    moving = deep & (trajectory.read_s <= trajectory.t_s[-1]) & (press.force_gwt > 0)
    if moving.sum() < _ENOUGH:
        return None
    ln_d = np.log(-trajectory.height_mm[trajectory.lowest][moving])
    ln_d = ln_d - ln_d.mean()
    predicted_ln = np.log(predicted.forces_gwt(draws, trajectory)[:, moving])
    return float(np.mean(predicted_ln @ ln_d < np.log(press.force_gwt[moving]) @ ln_d))


def _shift_mm(predicted: PredictedForces, press: MeasuredPress, draw: Array) -> float:
    """Return the height offset of the skin that fits the press best, for this finger (mm)."""
    higher = draw.copy()
    higher[predicted.prior.index("height_mm")] += _STEP_MM
    here, there = predicted.forces_gwt(np.stack([draw, higher]), press.trajectory)
    slope = (there - here) / _STEP_MM
    return float(slope @ (press.force_gwt - here) / max(float(slope @ slope), _LEAST))
