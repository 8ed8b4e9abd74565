"""Linear viscoelastic tissue with one Prony series for all its layers: G(t) = 1 − Σ g (1 − exp(−t / τ)).

Poisson's ratio does not change with time, so that displacements follow those forces which would bring them about at
once: f(t) = ∫ G(t − s) dp(s), p = K u. Exact where p is linear between the instants given, one variable a term.
Source: Taylor, Pister & Goudreau, Int. J. Numer. Methods Eng. 2 (1970) 45–59.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

from sim.contact.patch import Patch
from sim.errors import ArgumentError

# --- held ---
#
# Skin that forces hold where it would not lie by itself.

Array = NDArray[np.float64]


def held_by(patch: Patch, force: Array) -> Patch:
    """The patch where (m, n) forces hold it: further ones act on it as on skin at rest; its areas stay."""
    return held_at(patch, patch.displaced(force))


def held_at(patch: Patch, displaced_mm: Array) -> Patch:
    """The same where (m, n) displacements are known."""
    position_mm = patch.position_mm.copy()
    position_mm[:, list(patch.axes)] += displaced_mm.T
    return replace(patch, position_mm=position_mm)


# --- moves ---
#
# What relaxation leaves of a force whose elastic course is known: moves, each even, with rests between them.


@dataclass(frozen=True)
class Moves:
    """From no force to one elastic force after another, each reached evenly: when (p,) and in how long (p,), s."""

    ended_s: Array
    took_s: Array

    def fading(self, tau_s: float, asked_s: Array, last: NDArray[np.intp]) -> Array:
        """(r, p) what a term of relaxation has left of the elastic forces at (r,) instants: ∫ exp(−(t−s)/τ) dF.

        Exact. Moves after the last (r,) that counts then are still to come.
        """
        took_s = np.where(self.took_s > 0, self.took_s, 1.0)
        still = np.where(self.took_s > 0, -np.expm1(-took_s / tau_s) * tau_s / took_s, 1.0)
        there = np.arange(len(self.ended_s)) <= last[:, None]
        since_s = np.where(there, asked_s[:, None] - self.ended_s, 0.0)
        left = np.where(there, np.exp(-since_s / tau_s) * still, 0.0)
        return np.asarray(left - np.concatenate([left[:, 1:], np.zeros((len(left), 1))], axis=1))


@dataclass(frozen=True)
class PronyTerm:
    """A share g of the instantaneous stiffness that relaxes with the time constant τ, s."""

    share: float
    tau_s: float


class Prony:
    """The series of a tissue. Raises ValueError where nothing of its stiffness would last."""

    def __init__(self, terms: Sequence[PronyTerm]) -> None:
        if any(not (term.share > 0 and term.tau_s > 0) for term in terms) or sum(t.share for t in terms) >= 1:
            raise ArgumentError(
                "the shares of a Prony series must be positive and sum to less than 1, and its time "
                "constants must be positive",
                code="bad_series",
            )
        self.shares = np.array([term.share for term in terms])
        self.tau_s = np.array([term.tau_s for term in terms])

    @property
    def lasting(self) -> float:
        """The share of the stiffness that never relaxes."""
        return float(1 - self.shares.sum())

    def relaxed(self, t_s: ArrayLike) -> Array:
        """G at times after a sudden strain, any shape."""
        decays = np.exp(-np.asarray(t_s, dtype=float)[..., None] / self.tau_s)
        return np.asarray(1 - (self.shares * (1 - decays)).sum(axis=-1))


@dataclass(frozen=True)
class RelaxationStep:
    """What a step of time makes of the past: f = stiffness · (p − carried)."""

    stiffness: float  # G as the step has it on average; 1 for a sudden one
    carried: Array  # the p at which nothing would be felt
    _decays: Array
    _weights: Array  # g (τ / Δ) (1 − exp(−Δ / τ))


class Memory:
    """What tissue remembers of its load, any shape: p, and of each term the part of f that is still to relax."""

    def __init__(self, prony: Prony, borne: Array, kept: Array) -> None:
        self._prony, self.borne, self._kept = prony, borne, kept

    @classmethod
    def none(cls, prony: Prony, shape: tuple[int, ...] = ()) -> "Memory":
        """Of tissue that was never touched."""
        return cls(prony, np.zeros(shape), np.zeros((len(prony.shares), *shape)))

    def ahead(self, step_s: float) -> RelaxationStep:
        """A step of time from here; 0 s is a sudden one. Raises ValueError for a step back."""
        if not step_s >= 0 or math.isinf(step_s):
            raise ArgumentError(
                "step_s = {step_s}: must be a finite number of seconds, 0 or more", code="bad_step", step_s=step_s
            )
        tau_s, shares = self._prony.tau_s, self._prony.shares
        decays = np.exp(-step_s / tau_s)
        weights = shares * (-np.expm1(-step_s / tau_s) * tau_s / step_s if step_s > 0 else 1.0)
        stiffness = self._prony.lasting + float(weights.sum())
        past = weights.sum() * self.borne - np.tensordot(decays, self._kept, axes=1)
        return RelaxationStep(stiffness, past / stiffness, decays, weights)

    def released(self, step_s: float) -> "Memory":
        """Let go at once, so much later: f = 0 all the time, exact for any step."""
        let_go = self.ahead(0.0)
        kept = self.after(let_go, let_go.carried)._kept
        tau_s, shares, lasting = self._prony.tau_s, self._prony.shares, self._prony.lasting
        rates = np.linalg.solve(np.eye(len(shares)) + shares[:, None] / lasting, np.diag(1 / tau_s))
        kept = np.tensordot(expm(-step_s * rates), kept, axes=1)
        return Memory(self._prony, -kept.sum(axis=0) / lasting, kept)

    def after(self, ahead: RelaxationStep, borne: ArrayLike) -> "Memory":
        """At the end of that step, p having gone to borne in a straight line."""
        went = np.asarray(borne, dtype=float) - self.borne
        column: Any = (slice(None), *[None] * self.borne.ndim)
        kept = ahead._decays[column] * self._kept + ahead._weights[column] * went
        return Memory(self._prony, self.borne + went, kept)
