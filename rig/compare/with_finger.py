"""What recordings say when the finger is known within ranges: sets and intervals that hold on all fingers of them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rig.compare.comparison import Joint
from rig.compare.fingers import fit_all_with_finger, fit_with_finger, free_of, places, weights
from rig.compare.fit import Fit, Flags, Interval, by_pair, compared, fit_rates, interval, not_worse, squared_residuals

Array = NDArray[np.float64]

LEVEL = 0.025
"""One-sided level at which a pair, or a finger for a pair, counts as worse than the best."""

_GRID = 9  # places along each range at which a finger is judged


@dataclass(frozen=True)
class WithFinger:
    """A joint fit in which each pair may have its best plausible finger."""

    joint: Joint

    @property
    def place(self) -> Array:
        """(18, receptors, free) of the best finger of each pair."""
        return self._fitted[0]

    @property
    def fit(self) -> Fit:
        """(18, receptors) on these fingers."""
        return self._fitted[1]

    @cached_property
    def explained(self) -> Array:
        """(18, receptors) R² on these fingers."""
        return self.joint.explained_by(self.fit)

    @cached_property
    def indistinguishable(self) -> Flags | None:
        """(18, receptors) pairs that explain the recordings no worse than the best; None with too few positions."""
        return indistinguishable_with_finger(self.joint.eps_on_fingers, self.joint.rate)

    def interval(self, measure: int, receptor: int) -> Interval | None:
        """Confidence limits of one pair on whatever plausible finger, None where it has no fit."""
        known, repeats = self.joint.covered(receptor)
        eps = self.joint.eps_on_fingers[:, measure, known, receptor]
        return interval_with_finger(eps, repeats, self.joint.shape_of[known])

    @cached_property
    def _fitted(self) -> tuple[Array, Fit]:
        return fit_all_with_finger(self.joint.eps_on_fingers, self.joint.rate)


def indistinguishable_with_finger(eps: Array, rate: Array) -> Flags | None:
    """(18, receptors) pairs that, on their best finger, explain the rates no worse than the best pair on its own.

    Vuong's test as in `statistics.indistinguishable`, eps (fingers, 18, p, receptors), rate (p,). None with too few
    positions.
    """
    which = compared(eps[0])
    if which is None:
        return None
    receptors, common = which
    pairs = by_pair(eps[..., common, :][..., receptors])
    found = fit_with_finger(pairs, rate[common])
    residual = squared_residuals(found.fit, found.eps, rate[common])
    best = residual[np.argmin(residual.sum(axis=1))]
    flags = np.zeros((eps.shape[1], len(receptors)), dtype=bool)
    flags[:, receptors] = not_worse(residual, best, LEVEL).reshape(eps.shape[1], -1)
    return flags


def interval_with_finger(eps: Array, repeats: list[Array], shape_of: NDArray[np.int64]) -> Interval | None:
    """Limits of k and ε₀ of one pair on whatever plausible finger, for SSRPs (fingers, n) on the design.

    The hull of the intervals on those fingers on which the pair is not significantly worse than on its best one; it
    is taken over the fingers that give the lowest and the highest k and ε₀. None without a fit.
    """
    rate = np.array([rates.mean() for rates in repeats])
    best = fit_with_finger(eps[:, None], rate)
    if np.isnan(best.fit.k[0]):
        return None
    sign = 1 if best.fit.k[0] > 0 else -1
    judged = places(np.linspace(-1, 1, _GRID).tolist(), free_of(eps))
    tried = np.concatenate([best.eps, weights(judged) @ eps])
    fit = fit_rates(tried, rate, sign=sign)
    residual = squared_residuals(fit, tried, rate)
    kept = np.flatnonzero(not_worse(residual, residual[0], LEVEL) & np.isfinite(fit.k))
    extreme = {int(kept[pick(v[kept])]) for v in (fit.k, fit.eps0) for pick in (np.argmin, np.argmax)}
    return _hull([interval(tried[i], repeats, shape_of, sign) for i in sorted(extreme)])


def _hull(limits: list[Interval]) -> Interval:
    """NaN where one of them has no limit."""
    k, eps0 = (np.array([getattr(one, name) for one in limits]) for name in ("k", "eps0"))
    return Interval((k[:, 0].min(), k[:, 1].max()), (eps0[:, 0].min(), eps0[:, 1].max()), limits[0].over)
