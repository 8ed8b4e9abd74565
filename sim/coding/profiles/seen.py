"""Readings as seen from pressures nearby: linear, whitened, and cut down to what noise leaves visible."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from sim.coding.profiles.contact import Contact, alike, side_by_side

Array = NDArray[np.float64]

Model = tuple[Contact, ...]
"""Contacts side by side, ascending, at least one free sample between them."""

VISIBLE = 0.2
"""Singular values below this, over noise and for typical pressures, are dropped: they tell next to nothing."""


@dataclass(frozen=True)
class Seen:
    """`value` = `matrix` · pressure over typical + noise of variance 1."""

    matrix: Array  # (r, n)
    value: Array  # (r,)
    typical: float
    unexplained: float  # log density of what no pressure can explain, so that evidence compares from afar
    _terms: dict[Contact, Array] = field(default_factory=dict, compare=False)

    def log_evidence(self, models: Sequence[Model]) -> Array:
        """(len(models),) log probabilities of the values and the model, but for what is the same of all readings.

        With the values as one more row of the covariance, its Cholesky factor ends in the values whitened.
        """
        bordered, log_prior = self._together(models)
        r = len(self.value)
        bordered[:, range(r), range(r)] += 1.0
        bordered[:, r, :r] = self.value - bordered[:, r, :r]
        bordered[:, r, r] = 1.0 + (bordered[:, r, :r] ** 2).sum(axis=1)
        factor = np.linalg.cholesky(bordered)
        white, size = factor[:, r, :r], np.diagonal(factor, axis1=1, axis2=2)[:, :r]
        return np.asarray(self.unexplained + log_prior - 0.5 * (white**2).sum(axis=1) - np.log(size).sum(axis=1))

    def _together(self, models: Sequence[Model]) -> tuple[Array, Array]:
        """(k, r + 1, r + 1) what the models' contacts give the values, and the (k,) log priors."""
        contacts = list({contact for model in models for contact in model})
        number = {contact: k for k, contact in enumerate(contacts)}
        most = max(map(len, models))
        of = np.array([[number[c] for c in model] + [len(contacts)] * (most - len(model)) for model in models])
        places = self.matrix.shape[1] * (self.matrix.shape[1] + 1) / 2
        self._meet([contact for contact in contacts if contact not in self._terms])
        terms = np.stack([*(self._terms[contact] for contact in contacts), np.zeros((len(self.value) + 1,) * 2)])
        log_prior = np.array([*(contact.log_prior - np.log(places) for contact in contacts), 0.0])
        return np.asarray(sum(terms[of[:, k]] for k in range(most))), log_prior[of].sum(axis=1)

    def _meet(self, contacts: list[Contact]) -> None:
        """The (r + 1, r + 1) covariance that each gives the values, and their mean as its last row."""
        if not contacts:
            return
        r, samples = self.matrix.shape
        mean, alone = side_by_side(contacts, samples)
        weighed = mean[:, None] * self.matrix  # (k, r, n)
        terms = np.zeros((len(contacts), r + 1, r + 1))
        terms[:, :r, :r] = (weighed @ alike(samples)) @ weighed.swapaxes(1, 2)
        terms[:, :r, :r] += (alone[:, None] * self.matrix) @ self.matrix.T
        terms[:, r, :r] = mean @ self.matrix.T
        self._terms.update(zip(contacts, terms, strict=True))

    def posterior(self, models: Sequence[Model]) -> tuple[Array, Array]:
        """(k, n) means and (k, n, n) covariances of the pressures over typical; 0 outside a model's contacts."""
        samples, most = self.matrix.shape[1], max(map(len, models))
        contacts = [contact for model in models for contact in model]
        each, alone = np.zeros((2, len(models), most, samples))
        at = [(k, c) for k, model in enumerate(models) for c in range(len(model))]
        row, column = np.array(at).T
        each[row, column], alone[row, column] = side_by_side(contacts, samples)
        mean = each.sum(axis=1)
        prior = (each.swapaxes(1, 2) @ each) * alike(samples)
        prior[:, range(samples), range(samples)] += alone.sum(axis=1)
        seen = self.matrix @ prior  # (k, r, n)
        gain = np.linalg.solve(np.eye(len(self.value)) + seen @ self.matrix.T, seen).swapaxes(1, 2)
        left = self.value - mean @ self.matrix.T
        return mean + (gain @ left[..., None])[..., 0], prior - gain @ seen


def linearised(slope: Array, value: Array, covariance: Array, typical: float, visible: float | None = None) -> Seen:
    """From (m, n) slopes, (m,) values that slope · pressure should have, and the (m, m) covariance of their noise.

    Singular values below `visible` are dropped, by default `VISIBLE`.
    """
    lower = cholesky(covariance, lower=True)
    left, size, right = np.linalg.svd(solve_triangular(lower, slope * typical, lower=True), full_matrices=False)
    kept = size > (VISIBLE if visible is None else visible)
    white = solve_triangular(lower, value, lower=True)
    inside = left.T[kept] @ white
    unexplained = -0.5 * (white @ white - inside @ inside) - np.log(np.diag(lower)).sum()
    return Seen(size[kept, None] * right[kept], inside, typical, float(unexplained))
