"""Linear viscoelastic tissue with one Prony series for all layers: G(t) = 1 − Σ g (1 − exp(−t / τ)).

Poisson's ratio does not change with time, so that displacements follow the equivalent elastic forces p:
f(t) = ∫ G(t − s) dp(s), p = K u. The integration is exact where p is linear between the time points, with one
variable for each term.

Source: Taylor, Pister & Goudreau, Int. J. Numer. Methods Eng. 2 (1970) 45–59.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.contact.patch import Patch
from sim.errors import ArgumentError

# --- preloaded skin ---

Array = NDArray[np.float64]


def held_by(patch: Patch, force: Array) -> Patch:
    """Return the patch displaced by (m, n) forces, as the reference state of further forces; areas stay."""
    return held_at(patch, patch.displaced(force))


def held_at(patch: Patch, displaced_mm: Array) -> Patch:
    """Return the patch displaced by (m, n) displacements in mm."""
    position_mm = patch.position_mm.copy()
    position_mm[:, list(patch.axes)] += displaced_mm.T
    return replace(patch, position_mm=position_mm)


# --- moves ---


@dataclass(frozen=True)
class Moves:
    """Linear ramps from zero force to one elastic force after another: end times (p,) and durations (p,) in s."""

    ended_s: Array
    took_s: Array

    def fading(self, tau_s: float, asked_s: Array, last: NDArray[np.intp]) -> Array:
        """Return (r, p) weights of the elastic forces in a relaxation term at (r,) times: ∫ exp(−(t−s)/τ) dF.

        Exact. `last` (r,) is the last ramp that counts at each time.
        """
        took_s = np.where(self.took_s > 0, self.took_s, 1.0)
        still = np.where(self.took_s > 0, -np.expm1(-took_s / tau_s) * tau_s / took_s, 1.0)
        there = np.arange(len(self.ended_s)) <= last[:, None]
        since_s = np.where(there, asked_s[:, None] - self.ended_s, 0.0)
        left = np.where(there, np.exp(-since_s / tau_s) * still, 0.0)
        return np.asarray(left - np.concatenate([left[:, 1:], np.zeros((len(left), 1))], axis=1))


@dataclass(frozen=True)
class PronyTerm:
    """Share g of the instantaneous stiffness that relaxes with the time constant τ (s)."""

    share: float
    tau_s: float


class Prony:
    """Prony series of a tissue. Raises ArgumentError where no stiffness would remain."""

    def __init__(self, terms: Sequence[PronyTerm]) -> None:
        if any(not (term.share > 0 and term.tau_s > 0) for term in terms) or sum(t.share for t in terms) >= 1:
            raise ArgumentError(
                "the shares of a Prony series must be positive and sum to less than 1, and its time "
                "constants must be positive",
                "bad_series",
            )
        self.shares = np.array([term.share for term in terms])
        self.tau_s = np.array([term.tau_s for term in terms])

    @property
    def lasting(self) -> float:
        """Share of the stiffness that never relaxes."""
        return float(1 - self.shares.sum())

    def relaxed(self, t_s: ArrayLike) -> Array:
        """Return G at times after a sudden strain, any shape."""
        decays = np.exp(-np.asarray(t_s, dtype=float)[..., None] / self.tau_s)
        return np.asarray(1 - (self.shares * (1 - decays)).sum(axis=-1))


@dataclass(frozen=True)
class RelaxationStep:
    """Effect of the load history on a time step: f = stiffness · (p − carried)."""

    stiffness: float  # average of G over the step; 1 for a sudden one
    carried: Array  # elastic force p at which the actual force f is zero
    _decays: Array
    _weights: Array  # g (τ / Δ) (1 − exp(−Δ / τ))


class Memory:
    """Load history of tissue, any shape: p, and for each term the part of f that is still to relax."""

    def __init__(self, prony: Prony, borne: Array, kept: Array) -> None:
        self._prony, self.borne, self._kept = prony, borne, kept

    @classmethod
    def none(cls, prony: Prony, shape: tuple[int, ...] = ()) -> "Memory":
        """Return the history of tissue that was never loaded."""
        return cls(prony, np.zeros(shape), np.zeros((len(prony.shares), *shape)))

    def ahead(self, step_s: float) -> RelaxationStep:
        """Return a time step from here; 0 s is a sudden one. Raises ArgumentError for a negative step."""
        if not step_s >= 0 or math.isinf(step_s):
            raise ArgumentError(f"step_s = {step_s}: must be a finite number of seconds, 0 or more", "bad_step")
        tau_s, shares = self._prony.tau_s, self._prony.shares
        decays = np.exp(-step_s / tau_s)
        weights = shares * (-np.expm1(-step_s / tau_s) * tau_s / step_s if step_s > 0 else 1.0)
        stiffness = self._prony.lasting + float(weights.sum())
        past = weights.sum() * self.borne - np.tensordot(decays, self._kept, axes=1)
        return RelaxationStep(stiffness, past / stiffness, decays, weights)

    def released(self, step_s: float) -> "Memory":
        """Return the history after a sudden release and a time without force: exact for any step."""
        from scipy.linalg import expm  # slow to import, and the name of a term needs none

        release = self.ahead(0.0)
        remaining = self.after(release, release.carried)._kept
        tau_s, shares, lasting = self._prony.tau_s, self._prony.shares, self._prony.lasting
        rates = np.linalg.solve(np.eye(len(shares)) + shares[:, None] / lasting, np.diag(1 / tau_s))
        remaining = np.tensordot(expm(-step_s * rates), remaining, axes=1)
        return Memory(self._prony, -remaining.sum(axis=0) / lasting, remaining)

    def after(self, ahead: RelaxationStep, borne: ArrayLike) -> "Memory":
        """Return the history at the end of a step in which p changes linearly to a new value."""
        change = np.asarray(borne, dtype=float) - self.borne
        column: Any = (slice(None), *[None] * self.borne.ndim)
        kept = ahead._decays[column] * self._kept + ahead._weights[column] * change
        return Memory(self._prony, self.borne + change, kept)
