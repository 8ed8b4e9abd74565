"""Posterior of a finger after some presses: the draws of each kind of tissue, weighed by its evidence.

Readings are compared after a variance-stabilizing transform: y = asinh(ε F / σ) / ε is F / σ where noise dominates,
and a logarithm where the model error does. Errors that readings share (model, depth, zero) are in their covariance.
`weighted_draws` has the draws of one kind.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.special import chdtrc

from sim.identification.predicted_forces import MeasuredPress, PredictedForces
from sim.identification.prior import TISSUE, Kind, Prior, named, plain
from sim.identification.uncertainty_bands import Width, parameter_ends
from sim.identification.weighted_draws import PosteriorDensity, climbed, systematic, weighted_draws

Array = NDArray[np.float64]

READING_ERROR, PRESS_ERROR, SHAPE_ERROR, DEPTH_SD_MM = 0.01, 0.01, 0.02, 0.004
"""Relative model errors of a reading, of a press, and of all presses of a shape; and the error of the stage in depth
(mm)."""

DRAWS = 1500
_LEAST_NOISE_GWT = 0.003  # one step of a fine balance
_STARTS = 600
_HOPELESS = 12.0  # of ln evidence below the best kind, by the normal approximation at its mode


@dataclass(frozen=True)
class Learned:
    """Equally likely fingers after some presses."""

    prior: Prior
    draws: Array  # (n, p)
    most_likely: Array  # (p,) of the fingers whose parameters all lie within their bands
    misfit: Array  # (presses,) squared standardized distance of the best-fitting finger from each press
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


@dataclass(frozen=True)
class ParameterBand:
    """A parameter of the finger without its logarithm: estimate, mean, standard deviation and 90 % band."""

    name: str
    estimate: float
    mean: float
    sd: float
    low: float
    high: float


def parameter_bands(learned: Learned) -> list[ParameterBand]:
    """Return the band of each parameter; an estimate is that of one finger, and lies within its band."""
    low, high = parameter_ends(learned.draws)
    found = []
    for k, name in enumerate(learned.prior.names):
        values = np.exp(learned.draws[:, k]) if named(name) != name else learned.draws[:, k]
        estimate, least, most = (plain(name, float(one[k])) for one in (learned.most_likely, low, high))
        found.append(
            ParameterBand(named(name), estimate, float(values.mean()), float(values.std(ddof=1)), least, most)
        )
    return found


def least_effective(parameters: int) -> int:
    """Return the least number of effective draws for a covariance of this many parameters."""
    return 4 * parameters


def nothing_learned(prior: Prior, chance: np.random.Generator, n: int = DRAWS) -> Learned:
    """Return the estimate before the first press."""
    none = np.zeros(0)
    draws = prior.draws_of_all_kinds(n, chance)
    return Learned(prior, draws, prior.middle, none, none.astype(np.int64), 0.0, float(n))


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
        """Return the (n, r) standardized, uncorrelated residuals of all presses."""
        return np.asarray(np.concatenate(self.each_off(draws), axis=1) @ self._whitening.T)

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
    targets = [_target(prior, readings, kind) for kind in prior.kinds]
    modes = [climbed(target, _start(target, before, chance)) for target in targets]
    best = max(mode.ln_evidence for mode in modes)
    found = [
        (target, mode, weighted_draws(target, mode, len(before.draws), chance))
        for target, mode in zip(targets, modes, strict=True)
        if mode.ln_evidence > best - _HOPELESS
    ]
    ln_evidence = np.array([drawn.ln_evidence for _, _, drawn in found])
    share = np.exp(ln_evidence - ln_evidence.max())
    share /= share.sum()
    kept = [
        target.fingers(drawn.normal[systematic(drawn.weights, n, chance)])
        for (target, _, drawn), n in zip(found, _counts(share, len(before.draws)), strict=True)
    ]
    draws = chance.permutation(np.concatenate(kept))
    target, mode, drawn = found[int(np.argmax(share))]
    best_fit = target.fingers(mode.normal[None])
    effective = 1 / float(np.sum([s**2 / one.effective for s, (_, _, one) in zip(share, found, strict=True)]))
    return Learned(
        prior,
        draws,
        _within_bands(target, best_fit[0], drawn.normal, draws),
        readings.misfits(best_fit[0]),
        np.array([len(press.force_gwt) for press in presses]),
        float((target.off(mode.normal[None]) ** 2).sum()),
        effective,
    )


def _target(prior: Prior, readings: PressResiduals, kind: Kind) -> PosteriorDensity:
    """Return the posterior density of a kind of tissue."""

    def off(normal: Array) -> Array:
        return np.concatenate([readings.off(prior.from_normal(normal, kind)), normal], axis=1)

    return PosteriorDensity(off, lambda normal: prior.from_normal(normal, kind), kind, float(np.log(kind.chance)))


def _counts(share: Array, n: int) -> Sequence[int]:
    """Return how many of n draws each kind has."""
    ends = np.round(n * np.cumsum(share)).astype(int)
    return [int(count) for count in np.diff(ends, prepend=0)]


def _within_bands(target: PosteriorDensity, best_fit: Array, normal: Array, draws: Array) -> Array:
    """Return the best-fitting finger, or the likeliest draw of its kind whose parameters lie in all bands."""
    low, high = parameter_ends(draws)
    tried = np.concatenate([best_fit[None], target.fingers(normal)])
    inside = np.asarray(((tried >= low) & (tried <= high)).all(axis=1))
    if inside[0] or not inside.any():
        return np.clip(best_fit, low, high)
    here = normal[inside[1:]]
    return np.asarray(target.fingers(here[[np.argmax(target.ln(here))]])[0])


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


def _start(target: PosteriorDensity, before: Learned, chance: np.random.Generator) -> Array:
    """Return the best of the previous draws of this kind and of the prior, as normal values."""
    prior = before.prior
    tried = [prior.to_normal(prior.draws(_STARTS, chance), target.kind)]
    alike = before.draws[prior.is_of(before.draws, target.kind)][:_STARTS]
    if len(alike):
        tried.append(prior.to_normal(alike, target.kind))
    normal = np.concatenate(tried)
    return np.asarray(normal[np.argmax(target.ln(normal))])


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
    any_of_them = learned.prior.draws_of_all_kinds(_COMPARED, np.random.default_rng(0))
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
