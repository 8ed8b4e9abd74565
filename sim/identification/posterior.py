"""What presses say of a finger: the most likely one by Gauss and Newton, then weighted draws around it.

Readings are compared where their errors are even: y = asinh(ε F / σ) / ε is F / σ where noise rules, and a logarithm
where the model's own error does. Errors that readings share (model, depth, zero) are in their covariance.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.special import chdtrc

from sim.identification.predicted_forces import Foreseen, Given
from sim.identification.prior import TISSUE, Prior
from sim.identification.uncertainty_bands import Width

Array = NDArray[np.float64]

READING_ERROR, PRESS_ERROR, SHAPE_ERROR, DEPTH_SD_MM = 0.01, 0.01, 0.02, 0.004
"""Of the model, relative: between readings of a press, shared by all of it, and by all presses of its shape; and of a
press's depth, the stage's."""

DRAWS = 1500
_LEAST_NOISE_GWT = 0.003  # one step of a fine balance
_STARTS, _STEPS, _WIDER, _FREEDOM, _ROUNDS = 600, 25, 1.3, 6.0, 3
_STEP = 1e-3  # of a parameter's sd in the prior, for derivatives
_MOST_MOVED = 1.5  # sd of the prior in one step


@dataclass(frozen=True)
class Learned:
    """Equally likely fingers after some presses."""

    prior: Prior
    draws: Array  # (n, p)
    likeliest: Array  # (p,)
    misfit: Array  # (presses,) squared standardised distance of the likeliest from each press
    readings: NDArray[np.int64]  # (presses,) that each of them has
    total: float  # the same from all presses together and from the middle of the prior
    effective: float  # draws that the weights are worth

    @property
    def collapsed(self) -> bool:
        """Whether so few draws carry the weight that their spread means nothing."""
        return self.effective < least_effective(len(self.prior.names))

    @property
    def mean(self) -> Array:
        """(p,)"""
        return np.asarray(self.draws.mean(axis=0))

    @property
    def covariance(self) -> Array:
        """(p, p)"""
        return np.asarray(np.cov(self.draws.T))


def least_effective(parameters: int) -> int:
    """Return how many effective draws a covariance of so many parameters needs at least."""
    return 4 * parameters


def nothing_learned(prior: Prior, chance: np.random.Generator, n: int = DRAWS) -> Learned:
    """Before the first press."""
    none = np.zeros(0)
    return Learned(prior, prior.draws(n, chance), prior.middle, none, none.astype(np.int64), 0.0, float(n))


class PressResiduals:
    """The presses so far, and how far any finger is off them."""

    def __init__(self, foreseen: Foreseen, presses: Sequence[Given]) -> None:
        self._foreseen, self._presses = foreseen, presses
        self._own = [_covariance(press) for press in presses]
        self._whitening = _whitening(_together(presses, self._own))

    def each_off(self, draws: Array) -> list[Array]:
        """(n, r) of each press: measured less foreseen, where errors are even."""
        return [
            _even(press.force_gwt, press) - _even(self._foreseen.forces_gwt(draws, press.way), press)
            for press in self._presses
        ]

    def off(self, draws: Array) -> Array:
        """(n, r + p) of all presses and of the prior: standardised and uncorrelated."""
        all_of_them = np.concatenate(self.each_off(draws), axis=1) @ self._whitening.T
        return np.concatenate([all_of_them, self._foreseen.prior.off(draws)], axis=1)

    def misfits(self, draw: Array) -> Array:
        """(presses,) squared standardised distance of one finger from each press, as if there were no other."""
        shared = [np.outer(one, one) for one in (_shared(press) for press in self._presses)]
        return np.array([
            float(off[0] @ np.linalg.solve(own + shape, off[0]))
            for off, own, shape in zip(self.each_off(draw[None]), self._own, shared, strict=True)
        ])  # fmt: skip


def learn(foreseen: Foreseen, presses: Sequence[Given], before: Learned, chance: np.random.Generator) -> Learned:
    """What all presses together say; before: what was known, to begin from."""
    prior, readings = foreseen.prior, PressResiduals(foreseen, presses)
    start = _start(readings, before, chance)
    likeliest, spread = _climbed(prior, readings, start)
    middle, covariance, draws, weights = likeliest, _WIDER * spread, before.draws, np.ones(1)
    for _ in range(_ROUNDS):
        draws, ln_density = _student(middle, covariance, len(before.draws), chance)
        if not prior.within(draws).any():
            draws[0] = likeliest  # all the weight on one finger: collapsed
        weights = _weights(prior, readings, draws, ln_density)
        middle, covariance = _moments(draws, weights, likeliest, spread)
    kept = draws[_systematic(weights, len(before.draws), chance)]
    counts = np.array([len(press.force_gwt) for press in presses])
    total = float((readings.off(likeliest[None]) ** 2).sum())
    effective = float(1 / np.square(weights).sum())
    return Learned(prior, kept, likeliest, readings.misfits(likeliest), counts, total, effective)


def _noise_gwt(press: Given) -> float:
    return max(press.noise_gwt, _LEAST_NOISE_GWT)


def _even(force_gwt: Array, press: Given) -> Array:
    return np.asarray(np.arcsinh(READING_ERROR * force_gwt / _noise_gwt(press)) / READING_ERROR)


def _scale(press: Given) -> Array:
    """(r,) even readings of one gwt, there."""
    return np.asarray(1 / np.hypot(_noise_gwt(press), READING_ERROR * press.force_gwt))


def _covariance(press: Given) -> Array:
    """(r, r) of its even readings by themselves: own noise, and what all of them share."""
    scale = _scale(press)
    shared = PRESS_ERROR * press.force_gwt * scale
    deeper = DEPTH_SD_MM * _slope_gwt_mm(press) * scale
    zero = press.zero_sd_gwt * scale
    return np.asarray(np.eye(len(scale)) + sum(np.outer(one, one) for one in (shared, deeper, zero)))


def _shared(press: Given) -> Array:
    """(r,) what its shape adds to all presses of it."""
    return np.asarray(SHAPE_ERROR * press.force_gwt * _scale(press))


def _together(presses: Sequence[Given], own: Sequence[Array]) -> Array:
    """(all readings)² covariance."""
    names = np.concatenate([[press.way.indentor] * len(press.force_gwt) for press in presses])
    shared = np.concatenate([_shared(press) for press in presses])
    alike = names[:, None] == names
    return np.asarray(block_diag(*own) + np.where(alike, np.outer(shared, shared), 0.0))


def _whitening(covariance: Array) -> Array:
    """(r, r) that makes differences uncorrelated, each of variance 1."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def _slope_gwt_mm(press: Given) -> Array:
    """Of force over depth at each reading, as F ∝ d^1.7 has it, d by the height where force first showed."""
    height = press.way.height_mm[press.way.lowest]
    shown = press.force_gwt > 3 * _noise_gwt(press)
    touch_mm = float(height[np.argmax(shown)]) if shown.any() else float(height[0])
    return np.asarray(1.7 * np.maximum(press.force_gwt, 0.0) / np.maximum(touch_mm - height + 0.03, 0.03))


def _start(readings: PressResiduals, before: Learned, chance: np.random.Generator) -> Array:
    """The best of what was likely before, and of the prior."""
    tried = np.concatenate([before.draws[:_STARTS], before.prior.draws(_STARTS, chance)])
    return np.asarray(tried[np.argmin((readings.off(tried) ** 2).sum(axis=1))])


def _climbed(prior: Prior, readings: PressResiduals, start: Array) -> tuple[Array, Array]:
    """The likeliest finger within the ranges, and its covariance were all linear (Levenberg and Marquardt)."""
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
    """(r, p) of the standardised differences over parameters in units of their sd in the prior."""
    step = _STEP * np.diag(sd)
    off = readings.off(np.concatenate([at + step, at - step]))
    return np.asarray((off[: len(at)] - off[len(at) :]).T / (2 * _STEP))


def _student(middle: Array, covariance: Array, n: int, chance: np.random.Generator) -> tuple[Array, Array]:
    """(n, p) draws with heavy tails, and the logarithm of their density but for a constant."""
    root = np.linalg.cholesky(covariance)
    normal = chance.standard_normal((n, len(middle)))
    z = normal / np.sqrt(chance.chisquare(_FREEDOM, n) / _FREEDOM)[:, None]
    return middle + z @ root.T, -0.5 * (_FREEDOM + len(middle)) * np.log1p((z**2).sum(axis=1) / _FREEDOM)


def _weights(prior: Prior, readings: PressResiduals, draws: Array, ln_density: Array) -> Array:
    """(n,) that sum to 1."""
    within = prior.within(draws)
    ln = np.full(len(draws), -np.inf)
    ln[within] = -0.5 * (readings.off(draws[within]) ** 2).sum(axis=1) - ln_density[within]
    weights = np.exp(ln - ln.max())
    return np.asarray(weights / weights.sum())


def _moments(draws: Array, weights: Array, likeliest: Array, spread: Array) -> tuple[Array, Array]:
    """Of weighted draws, for the next round; those of the linear problem where too few of them count."""
    if 1 / np.square(weights).sum() < least_effective(draws.shape[1]):
        return likeliest, 2 * _WIDER * spread
    middle = weights @ draws
    covariance = (weights[:, None] * (draws - middle)).T @ (draws - middle)
    return np.asarray(middle), np.asarray(_WIDER * covariance + 1e-9 * np.diag(np.diag(spread)))


def _systematic(weights: Array, n: int, chance: np.random.Generator) -> NDArray[np.intp]:
    """(n,) indices, each as often as its weight says."""
    at = (np.arange(n) + chance.random()) / n
    return np.minimum(np.searchsorted(np.cumsum(weights), at), len(weights) - 1)


# --- misfit ---
#
# What is no finger of the prior: presses that none of its fingers answers like.

CHANCE_OF_ALL, CHANCE_OF_ONE, CHANCE_OF_LAYERS, MOST_SURPRISE = 0.01, 0.001, 0.01, 4.5
"""How often a finger of the prior would be so far off all readings, off those of its worst press, and its moduli so
far from what is usual; and by how many sd a press may surprise."""

_COMPARED, _RARE, _MOST_PRESSES = 300, 0.025, 0.6  # fingers; share of them; share of the presses
_DEEP, _ENOUGH = 0.3, 3  # of the deepest, and readings: there the touch's own error counts little
_JUMP_MM = 0.03
_STEP_MM, _LEAST = 1e-3, 1e-12


@dataclass(frozen=True)
class Surprise:
    """The highest force of a press as it was foreseen before it, and as it came."""

    foreseen: Width
    sd: float  # of its logarithm
    measured_gwt: float

    @property
    def sds(self) -> float:
        """How far off."""
        return float(np.log(max(self.measured_gwt, 1e-3) / self.foreseen.middle) / self.sd)


def no_finger(
    foreseen: Foreseen, presses: Sequence[Given], learned: Learned, surprises: Sequence[Surprise]
) -> str | None:
    """Why this is no finger of the prior, in one sentence; None where it may be one."""
    if not presses:
        return None
    total_off = chdtrc(int(learned.readings.sum()), learned.total) < CHANCE_OF_ALL
    one_off = bool((chdtrc(learned.readings, learned.misfit) < CHANCE_OF_ONE).any())
    surprising = max((abs(one.sds) for one in surprises), default=0.0) > MOST_SURPRISE
    if not (total_off or one_off or surprising):
        return _NO_LAYERS if _layers_off(learned) else None
    return f"no finger of the prior predicts these forces: {_how(foreseen, presses, learned)}"


_NO_LAYERS = "no finger of the prior is likely to give these forces; its layers would be at the ends of their ranges"


def _layers_off(learned: Learned) -> bool:
    """Whether only unlikely moduli of dermis and fat come near: what lies there may be layered otherwise."""
    off = learned.prior.off(learned.likeliest)[[learned.prior.index(name) for name in TISSUE]]
    return bool(chdtrc(len(TISSUE), float(off @ off)) < CHANCE_OF_LAYERS)


def _how(foreseen: Foreseen, presses: Sequence[Given], learned: Learned) -> str:
    """By how force grows with depth under each press, and by where each found the skin."""
    any_of_them = learned.prior.draws(_COMPARED, np.random.default_rng(0))
    ranks = [rank for press in presses if (rank := _rank(foreseen, press, any_of_them)) is not None]
    if ranks and np.mean(np.array(ranks) > 1 - _RARE) > _MOST_PRESSES:
        return (
            "force grows more steeply with depth; something stiff lies under the skin, e.g. bone under the indentor"
        )
    if ranks and np.mean(np.array(ranks) < _RARE) > _MOST_PRESSES:
        return "force grows less steeply with depth; the object is homogeneous, e.g. a rubber ball"
    shift_mm = np.array([_shift_mm(foreseen, press, learned.likeliest) for press in presses])
    jump_mm = np.diff(shift_mm)
    if len(jump_mm) and np.abs(jump_mm).max() > _JUMP_MM:
        k = int(np.argmax(np.abs(jump_mm)))
        return f"at press {k + 2} the surface moved by {1e3 * jump_mm[k]:+.0f} µm; check whether the mount slips"
    return "shapes and positions do not agree on one finger"


def _rank(foreseen: Foreseen, press: Given, draws: Array) -> float | None:
    """The share of fingers under which force grows less steeply with depth; None where too little was pressed."""
    way = press.by_depth
    deep = way.height_mm[way.lowest] < _DEEP * way.height_mm.min()
    moving = deep & (way.asked_s <= way.t_s[-1]) & (press.force_gwt > 0)
    if moving.sum() < _ENOUGH:
        return None
    ln_d = np.log(-way.height_mm[way.lowest][moving])
    ln_d = ln_d - ln_d.mean()
    foreseen_ln = np.log(foreseen.forces_gwt(draws, way)[:, moving])
    return float(np.mean(foreseen_ln @ ln_d < np.log(press.force_gwt[moving]) @ ln_d))


def _shift_mm(foreseen: Foreseen, press: Given, draw: Array) -> float:
    """How much higher than under this finger the skin would have to lie, by least squares."""
    higher = draw.copy()
    higher[foreseen.prior.index("height_mm")] += _STEP_MM
    here, there = foreseen.forces_gwt(np.stack([draw, higher]), press.way)
    slope = (there - here) / _STEP_MM
    return float(slope @ (press.force_gwt - here) / max(float(slope @ slope), _LEAST))
