"""Pressures on the skin from noisy receptors: not negative, within a few contacts, with a band.

It begins with a smooth fit. SED is made linear about it, and the likeliest contacts of each sort that may be (how
many, with sharp ends or without) are climbed to. Then, for each sort, SED is made linear about its own answer, round
by round, until that stays; pressures are averaged over them all (`profiles`). Where too few pressures are asked for
to tell contacts apart, the smooth fit is the answer.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from sim.coding.decoded import checked_readings
from sim.coding.operators import Operator
from sim.coding.profiles.climb import alone, climbed, runs, sort_of
from sim.coding.profiles.mixture import Mixture, mixed, together
from sim.coding.profiles.seen import Model, Seen, linearised
from sim.coding.profiles.smooth_fit import chi2, smooth_fit, smooth_start, spread
from sim.coding.readings import Readings

Array = NDArray[np.float64]

Prior = Literal["contacts", "smooth"]
PRIORS: tuple[Prior, ...] = get_args(Prior)

FEWEST_FOR_CONTACTS = 8
"""Pressures; fewer are decoded as smooth."""

FEWEST_READINGS = 5
"""Of pressures within contacts, which may be more than the readings."""

_LOOSENED = 3.0
"""The model's error at the first look, over what it is: far from the answer linear SED is wrong too."""

_STARTS = 3
_POSSIBLE = 12.0  # log evidence below the best at the first look
_MOST_ROUNDS = 8
_SETTLED = 0.02  # of the pressures, in relative L2
_KEPT = 20  # models of a round that the next begins with
_DEAF = 1e-6  # least weight of a reading, over that of one that is not silent


@dataclass(frozen=True)
class ModelError:
    """How wrong SED of the model is: a share of it, alike over a length of skin; measured between meshes."""

    share: float = 0.04
    length_mm: float = 1.0

    def covariance(self, operator: Operator, sed: Array) -> Array:
        """(m, m) of SEDs."""
        apart = np.subtract.outer(operator.receptor_mm, operator.receptor_mm) / self.length_mm
        return np.asarray(self.share**2 * np.outer(sed, sed) * np.exp(-0.5 * apart**2))


@dataclass(frozen=True)
class Profile:
    """Decoded pressures with a standard deviation each; `converged` is false where a search was cut off."""

    pressure: Array  # (n,) pseudo-units, none below 0
    sd: Array  # (n,) of noise, of what the prior leaves open, and of the model's error
    smoothing: float  # λ of the smooth fit
    misfit: float  # Σ ((SED − reading) / sd)² over receptors that are not silent
    converged: bool
    mixture: Mixture | None = None  # where pressures lie within contacts

    def band(self, z: float = 1.645) -> tuple[Array, Array]:
        """(n,) lower and upper bounds, of 90 % by default; not below 0."""
        if self.mixture is None:
            low, high = -z * self.sd, z * self.sd
        else:
            mean, sd = self.mixture.moments()
            wider = np.divide(self.sd, sd, out=np.ones_like(sd), where=sd > 0)
            low, high = (wider * (self.mixture.quantile(float(ndtr(k))) - mean) for k in (-z, z))
        return np.maximum(0.0, self.pressure + low), self.pressure + high


def decode_profile(
    operator: Operator,
    readings: Readings,
    error: ModelError | None = None,
    seed: int = 0,
    *,
    prior: Prior | None = None,
) -> Profile:
    """Pressures and how sure they are. Raises DecodingError for readings that cannot be meant.

    Within `contacts` the mean over all that may be, of `smooth` ones the likeliest; by default within contacts,
    unless there are few pressures.
    """
    error = ModelError() if error is None else error
    if (prior or ("contacts" if operator.parts.shape[2] >= FEWEST_FOR_CONTACTS else "smooth")) == "contacts":
        checked_readings(operator, readings.sed, FEWEST_READINGS)
        return _within_contacts(operator, readings, error)
    checked_readings(operator, readings.sed)
    return _smooth(operator, readings, error, seed)


def _smooth(operator: Operator, readings: Readings, error: ModelError, seed: int) -> Profile:
    fit = smooth_fit(operator, readings, seed)
    sd = spread(operator, readings, fit, error.covariance(operator, operator.sed(fit.pressure)))
    return Profile(fit.pressure, sd, fit.smoothing, chi2(operator, readings, fit.pressure), fit.converged)


@dataclass(frozen=True)
class _Within:
    """Pressures within contacts, to be found from readings."""

    operator: Operator
    readings: Readings
    error: ModelError
    typical: float  # of pressures in contact

    def seen_from(self, pressure: Array, loosened: float = 1.0) -> Seen:
        """Readings as linear in the pressures, about these; a silent receptor's by Newton's step."""
        there = self.operator.leaning(pressure)
        sed, slope = there.sed(pressure), there.slope(pressure)
        _, first, second = self.readings.cost(sed)
        second = np.maximum(second, _DEAF / self.readings.sd**2)
        wrong = self.error.covariance(self.operator, sed) + self.operator.unsure(pressure)
        covariance = np.diag(1 / second) + loosened**2 * wrong
        return linearised(slope, slope @ pressure - first / second, covariance, self.typical)

    def settled(self, seen: Seen, model: Model) -> tuple[Mixture, bool]:
        """Models of one sort, seen from their own mean until it stays; and whether it did."""
        mixture, models = mixed(seen, {model: 0.0}), [model]
        for _ in range(_MOST_ROUNDS):
            pressure, _ = mixture.moments()
            near = self.seen_from(pressure)
            climb = climbed(near, models, sort=sort_of(model))
            mixture, models = mixed(near, climb.known), climb.best(_KEPT)
            moved = np.linalg.norm(mixture.moments()[0] - pressure)
            if climb.at_top and moved <= _SETTLED * np.linalg.norm(pressure):
                return mixture, True
        return mixture, False


def _within_contacts(operator: Operator, readings: Readings, error: ModelError) -> Profile:
    """Each sort of answer that a first look leaves possible, and the mean over them all."""
    start = smooth_start(operator.leaning(np.zeros(operator.parts.shape[2])), readings)
    begun = start.pressure
    within = _Within(operator, readings, error, float(begun @ begun / begun.sum()))
    seen = within.seen_from(begun, _LOOSENED)
    look = climbed(seen, [*runs(begun), *alone(len(begun))], _STARTS)
    found = [within.settled(seen, model) for model in look.best_of_sorts(_POSSIBLE).values()]
    mixture = together([mixture for mixture, _ in found])
    pressure, sd = mixture.moments()
    misfit = chi2(operator, readings, pressure)
    return Profile(pressure, sd, start.smoothing, misfit, all(settled for _, settled in found), mixture)
