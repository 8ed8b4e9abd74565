"""Readings as seen from pressures nearby: linear, so that all of a few contacts is normal, prior and posterior."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from sim.coding.profiles.contact import Contact, table_of_contacts
from sim.coding.profiles.evidence import explained

Array = NDArray[np.float64]

Model = tuple[Contact, ...]
"""Contacts side by side, ascending, at least one free sample between them."""


class _Together(NamedTuple):
    """Models on the k samples that the largest presses: p = mean + root · u beforehand, u of variance 1."""

    at: NDArray[np.intp]  # (b, k) samples; one beyond the last where a model has none left
    mean: Array  # (b, k)
    root: Array  # (b, k, k)
    precision: Array  # (b, k, k) by which readings see them
    towards: Array  # (b, k) gradient of the readings' log likelihood, from the mean


class Posterior(NamedTuple):
    """Of b models, each on its own samples; the rest of the k that the largest presses are nothing, for sure."""

    at: NDArray[np.intp]  # (b, k) samples; n, beyond the last, for nothing
    mean: Array  # (b, k)
    covariance: Array  # (b, k, k)

    def over(self, samples: int) -> tuple[Array, Array]:
        """(b, samples) means and variances, 0 outside a model's contacts."""
        found = np.zeros((2, len(self.at), samples + 1))
        row = np.arange(len(self.at))[:, None]
        found[0, row, self.at] = self.mean
        found[1, row, self.at] = np.diagonal(self.covariance, axis1=1, axis2=2)
        return found[0, :, :samples], found[1, :, :samples]


@dataclass(frozen=True)
class Seen:
    """Log likelihood −½ pᵀ `precision` p + `towards` · p + `nothing` of (n,) pressures p over typical."""

    precision: Array  # (n, n)
    towards: Array  # (n,)
    typical: float
    nothing: float  # of no pressure

    def log_evidence(self, models: Sequence[Model]) -> Array:
        """(b,) log probabilities of the readings and the model, but for what is the same of all readings."""
        count = np.array([len(model) for model in models])
        at = np.zeros((len(models), count.max(), 3), np.int64)
        for row, model in enumerate(models):
            at[row, : len(model)] = model
        n = len(self.towards)
        mean, root, log_kind = table_of_contacts(n)
        log_prior = log_kind - np.log(n * (n + 1) / 2)
        there = np.arange(at.shape[1]) < count[:, None]
        beyond = explained(at, count, mean, root, self.precision, self.towards)
        return np.asarray(self.nothing + (log_prior[at[:, :, 2]] * there).sum(axis=1) + beyond)

    def posterior(self, models: Sequence[Model]) -> Posterior:
        """Of the pressures over typical."""
        one = self._together(models)
        inside = np.eye(one.mean.shape[1]) + one.root.swapaxes(1, 2) @ one.precision @ one.root
        spread = one.root @ np.linalg.solve(inside, one.root.swapaxes(1, 2))
        return Posterior(one.at, one.mean + (spread @ one.towards[..., None])[..., 0], spread)

    def _together(self, models: Sequence[Model]) -> _Together:
        n, k = len(self.towards), max(map(_pressed, models))
        at = np.full((len(models), k), n)
        mean, root = np.zeros((len(models), k)), np.zeros((len(models), k, k))
        for row, model in enumerate(models):
            begin = 0
            for contact in model:
                end = begin + contact.stop - contact.first
                at[row, begin:end] = range(contact.first, contact.stop)
                mean[row, begin:end], root[row, begin:end, begin:end] = contact.mean, contact.root
                begin = end
        precision = np.pad(self.precision, (0, 1))[at[:, :, None], at[:, None]]
        towards = np.append(self.towards, 0.0)[at] - (precision @ mean[..., None])[..., 0]
        return _Together(at, mean, root, precision, towards)


def _pressed(model: Model) -> int:
    return sum(contact.stop - contact.first for contact in model)


def linearised(slope: Array, value: Array, covariance: Array, typical: float) -> Seen:
    """From (m, n) slopes, (m,) values that slope · pressure should have, and the (m, m) covariance of their noise."""
    lower = cholesky(covariance, lower=True)
    white = solve_triangular(lower, np.column_stack([typical * slope, value]), lower=True)
    seen, said = white[:, :-1], white[:, -1]
    nothing = -0.5 * said @ said - np.log(np.diag(lower)).sum()
    return Seen(seen.T @ seen, seen.T @ said, typical, float(nothing))
