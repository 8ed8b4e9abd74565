"""Pressures on the skin from noisy receptors: not negative, within a few contacts, with a band.

It begins with a smooth fit, and a table of imagined pressures is weighed by how well they explain the readings.
Where noise is loud that is the answer. Else SED is made linear about the smooth fit, and the likeliest contacts of
each sort that may be (how many, with sharp ends or without) are climbed to. Then, for each sort, SED is made linear
about its own answer, round by round, until that stays; pressures are averaged over them all, and over the table by
how much of the readings it could take in (`profiles`). Where too few pressures are asked for to tell contacts apart,
the smooth fit is the answer.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from sim.coding.decoded import checked_readings
from sim.coding.operators import Operator
from sim.coding.profiles.climb import Sort, alone, climbed, runs, sort_of
from sim.coding.profiles.mixture import Mixture, mixed, pooled, together
from sim.coding.profiles.seen import Model, Seen, linearised
from sim.coding.profiles.smooth_fit import chi2, smooth_fit, smooth_start, spread
from sim.coding.profiles.table import Weighed, table_of
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
_POSSIBLE = 8.0  # log evidence below the best at the first look
_STILL_POSSIBLE = 4.0  # the same of the first round, which later ones move by less than 1
_MOST_ROUNDS = 8
_AS_GOOD = 0.5  # power at which the table is as good as a search beside it; below, its share falls with it
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


CONTACTS_ERROR = ModelError(0.02, 0.5)
"""Of pressures within contacts, beside that of leans: round ones miss less, corners more, alike over less skin
(docs/coding.md)."""


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
        """(n,) lower and upper bounds, of 90 % by default; not below 0, and never without the pressure itself.

        Of a mixture they are quantiles. Its mean may lie outside them, where a few models have a contact and the rest
        has none: the band reaches to it.
        """
        if self.mixture is None:
            low, high = -z * self.sd, z * self.sd
        else:
            mean, sd = self.mixture.moments()
            wider = np.divide(self.sd, sd, out=np.ones_like(sd), where=sd > 0)
            low, high = (wider * (self.mixture.quantile(float(ndtr(k))) - mean) for k in (-z, z))
        return np.maximum(0.0, self.pressure + np.minimum(0.0, low)), self.pressure + np.maximum(0.0, high)


def decode_profile(
    operator: Operator,
    readings: Readings,
    error: ModelError | None = None,
    seed: int = 0,
    *,
    prior: Prior | None = None,
    table: bool = True,
) -> Profile:
    """Pressures and how sure they are. Raises DecodingError for readings that cannot be meant.

    Within `contacts` the mean over all that may be, of `smooth` ones the likeliest; by default within contacts,
    unless there are few pressures. Without the table, which is made once for an operator, it is by the search alone.
    """
    if (prior or ("contacts" if operator.parts.shape[2] >= FEWEST_FOR_CONTACTS else "smooth")) == "contacts":
        checked_readings(operator, readings.sed, FEWEST_READINGS)
        return _within_contacts(operator, readings, CONTACTS_ERROR if error is None else error, table=table)
    checked_readings(operator, readings.sed)
    return _smooth(operator, readings, ModelError() if error is None else error, seed)


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

    def begun(self, seen: Seen, model: Model) -> "_Round":
        """Models of one sort, seen from the mean of one of them."""
        return self.next_of(_Round(sort_of(model), mixed(seen, {model: 0.0}), [model], moved=np.inf, at_top=False))

    def next_of(self, last: "_Round") -> "_Round":
        """Seen from the last round's mean."""
        pressure, _ = last.mixture.moments()
        near = self.seen_from(pressure)
        climb = climbed(near, last.models, sort=last.sort)
        mixture = mixed(near, climb.known)
        moved = float(np.linalg.norm(mixture.moments()[0] - pressure) / np.linalg.norm(pressure))
        return _Round(last.sort, mixture, climb.best(_KEPT), moved, climb.at_top)

    def settled(self, begun: "_Round") -> "_Round":
        """Round by round, until the pressures stay."""
        last = begun
        for _ in range(_MOST_ROUNDS - 1):
            if last.settled:
                break
            last = self.next_of(last)
        return last


class _Round(NamedTuple):
    """Models of one sort, seen from where the round before left them."""

    sort: Sort
    mixture: Mixture
    models: list[Model]
    moved: float  # relative L2
    at_top: bool

    @property
    def settled(self) -> bool:
        return self.at_top and self.moved <= _SETTLED


def _within_contacts(operator: Operator, readings: Readings, error: ModelError, *, table: bool) -> Profile:
    """By the table where it takes in most of what readings tell; else averaged over it and all sorts of answers."""
    start = smooth_start(operator.leaning(np.zeros(operator.parts.shape[2])), readings)
    weighed = _by_table(operator, readings, error, start.pressure) if table else None
    share = 0.0 if weighed is None else weighed.power / _AS_GOOD
    if weighed is not None and share >= 1:
        mixture, converged = weighed.mixture, True
    else:
        mixture, converged = _by_search(operator, readings, error, start.pressure)
        if weighed is not None:
            mixture = pooled(weighed.mixture, mixture, share)
    pressure, sd = mixture.moments()
    return Profile(pressure, sd, start.smoothing, chi2(operator, readings, pressure), converged, mixture)


def _by_table(operator: Operator, readings: Readings, error: ModelError, begun: Array) -> Weighed:
    """A silent receptor by Newton's step, as a reading that noise makes uncertain."""
    sed = operator.sed(begun)
    _, first, second = readings.cost(sed)
    second = np.maximum(second, _DEAF / readings.sd**2)
    variance = 1 / second + np.diag(error.covariance(operator, sed))
    return table_of(operator).weighed(sed - first / second, variance, float(np.linalg.norm(sed)))


def _by_search(operator: Operator, readings: Readings, error: ModelError, begun: Array) -> tuple[Mixture, bool]:
    """Each sort of answer that a first look and a first round leave possible; and whether all settled."""
    within = _Within(operator, readings, error, float(begun @ begun / begun.sum()))
    seen = within.seen_from(begun, _LOOSENED)
    look = climbed(seen, [*runs(begun), *alone(len(begun))], _STARTS)
    rounds = [within.begun(seen, model) for model in look.best_of_sorts(_POSSIBLE).values()]
    best = max(one.mixture.log_weight.max() for one in rounds)
    found = [within.settled(one) for one in rounds if one.mixture.log_weight.max() > best - _STILL_POSSIBLE]
    return together([one.mixture for one in found]), all(one.settled for one in found)
