"""Profile-likelihood limits of k and ε₀ of one candidate, on one finger or over plausible ones."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri

from rig.compare.candidate_measures import Candidates, Fitted
from rig.compare.likelihood import Form, Observed, at_saturation, saturations
from rig.compare.plausible_fingers import places, weights
from rig.compare.verdict import LEVEL, Limits

Array = NDArray[np.float64]

_FINE = 0.03  # step of the saturation, relative to 1 / largest rate
_GRID = 5  # points along each range of a finger's parameter
_STEPS = np.concatenate([[0.0], np.geomspace(1e-3, 30.0, 60)])
_OFFSETS = np.concatenate([-_STEPS[:0:-1], _STEPS])  # offsets of ε₀ from its best value, relative to the range of ε


class ConfidenceLimits(NamedTuple):
    """Limits of k and ε₀."""

    k: Limits
    eps0: Limits


def limits(candidates: Candidates, observed: Observed, fit: Fitted, row: int, ratio: float) -> ConfidenceLimits:
    """Return limits within which the deviance of candidate `row` exceeds its minimum by at most F(1, noise) at 95 %.

    `ratio` is the F of its fit; above 1 it counts as noise. The finger and the saturation are free. NaN without a
    fit, infinite if even an end of the range of ε₀ is not unlikely.
    """
    found, noise, form = fit.found, observed.noise, candidates.form
    k, eps0 = float(found.k[row]), float(found.eps0[row])
    if np.isnan(k):
        return ConfidenceLimits((np.nan, np.nan), (np.nan, np.nan))
    sign = np.sign(k)
    dispersion = noise.dispersion * max(ratio, 1.0) * _more(candidates, observed, fit, row)
    limit = found.total[row] + dispersion * fdtri(1, min(noise.freedom * observed.evenness, 1e9), 1 - LEVEL)
    eps = sign * _on_fingers(candidates, fit, row)
    tried = saturations(observed, _FINE) if form.saturating else np.zeros(1)
    ends = [_ends(eps, float(saturation), observed, form, float(limit)) for saturation in tried]
    of_k, of_eps0 = np.moveaxis(np.concatenate([*ends, [[[sign * k] * 2, [sign * eps0] * 2]]]), 1, 0)
    return ConfidenceLimits(_hull(sign * of_k), _hull(sign * of_eps0))


def _hull(ends: Array) -> Limits:
    return float(ends.min()), float(ends.max())


def _ends(eps: Array, saturation: float, observed: Observed, form: Form, limit: float) -> Array:
    """Return (n, 2, 2) ends of k and ε₀ at which the deviance of rising ε (places, p) is below a limit."""
    own = at_saturation(eps, observed, form, np.full(len(eps), saturation))
    eps, centre = eps[own.k > 0], own.eps0[own.k > 0]
    eps0 = centre[:, None] + np.ptp(eps, axis=1, keepdims=True) * _OFFSETS
    least = -np.inf
    if form.silent_at_rest:
        eps0, least = np.maximum(eps0, 0.0), 0.0
    best, deviance, spread = along(eps, eps0, observed, saturation)
    room = limit - deviance
    with np.errstate(over="ignore"):  # any k fits if no position is above ε₀
        reach = np.sqrt(np.maximum(room, 0.0) / spread)
    found = []
    for one in np.flatnonzero((room >= 0).any(axis=1)):
        inside = room[one] >= 0
        of_k = (best - reach)[one, inside].min(), (best + reach)[one, inside].max()
        found.append((of_k, _crossed(eps0[one], room[one], least)))
    return np.array(found).reshape(-1, 2, 2)


def _more(candidates: Candidates, observed: Observed, fit: Fitted, row: int) -> float:
    """Return the mean discrepancy of fingers relative to the noise, over firing positions; 1 for one finger."""
    mean = fit.found.mean[row]
    if not candidates.free or not (mean > 0).any():
        return 1.0
    noise = observed.noise.dispersion * observed.variance(mean)
    return 1.0 + float((candidates.discrepancy(fit)[row] / noise)[mean > 0].mean())


def _on_fingers(candidates: Candidates, fit: Fitted, row: int) -> Array:
    """Return (places, p) ε of the candidate, its best finger first."""
    if not candidates.free:
        return fit.eps[row : row + 1]
    at = weights(places(np.linspace(-1, 1, _GRID).tolist(), candidates.free))
    return np.concatenate([fit.eps[row : row + 1], at @ candidates.eps[:, row]])


def along(eps: Array, eps0: Array, observed: Observed, saturation: float) -> tuple[Array, Array, Array]:
    """Return the best k at each ε₀ (places, q), its deviance, and half the second derivative of that by k."""
    above = np.maximum(eps[:, None] - eps0[..., None], 0.0)
    k = _slope(above, observed.rate, 1 / observed.variance(observed.smooth))
    for _ in range(_ROUNDS):
        mean, steep = _bent(k, above, saturation)
        k = _slope(above * steep, observed.rate - mean + steep * k[..., None] * above, 1 / observed.variance(mean))
    mean, steep = _bent(k, above, saturation)
    spread = (steep * steep * above * above / observed.variance(mean)).sum(axis=-1)
    return k, observed.deviance(mean).sum(axis=-1), np.maximum(spread, np.finfo(float).tiny)


def _bent(k: Array, above: Array, saturation: float) -> tuple[Array, Array]:
    """Return rates, and their derivatives by the drive."""
    drive = k[..., None] * above
    return drive / (1 + saturation * drive), (1 + saturation * drive) ** -2


_ROUNDS = 3


def _slope(above: Array, rate: Array, weight: Array) -> Array:
    square = (weight * above * above).sum(axis=-1)
    return np.maximum((weight * above * rate).sum(axis=-1), 0.0) / np.maximum(square, np.finfo(float).tiny)


def _crossed(at: Array, room: Array, least: float) -> Limits:
    """Return the ends at which `room`, linear between positions, crosses zero; `least` or infinity without any."""
    inside = np.flatnonzero(room >= 0)
    first, last = int(inside[0]), int(inside[-1])
    low, high = least, np.inf
    if first > 0:
        low = float(np.interp(0.0, room[first - 1 : first + 1], at[first - 1 : first + 1]))
    if last < len(at) - 1:
        high = float(np.interp(0.0, room[last : last + 2][::-1], at[last : last + 2][::-1]))
    return low, high
