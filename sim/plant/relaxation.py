"""A finger that relaxes and creeps: a Prony series on its force.

F(t) = ∫ G(t − s) dFe(s), G(t) = 1 − Σ g (1 − exp(−t / τ)): the hereditary integral of linear viscoelasticity acting
on the instantaneous elastic force Fe, which itself need not be linear in depth (quasi-linear viscoelasticity:
Fung, Biomechanics, 2nd ed. 1993, ch. 7). At constant depth the force relaxes; at constant force the finger creeps.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sim.devices.clock import Scheduler

_KEPT = 256


@dataclass(frozen=True)
class PronyTerm:
    """A share g of the instantaneous force that relaxes with the time constant τ, s."""

    share: float
    tau_s: float


class PronyForce:
    """The integral, one internal variable a term; exact where Fe is linear between the instants given.

    Source: Taylor, Pister & Goudreau, Int. J. Numer. Methods Eng. 2 (1970) 45–59.
    """

    def __init__(self, terms: Sequence[PronyTerm]) -> None:
        """Raises ValueError where nothing of the force would last."""
        if any(not (term.share > 0 and term.tau_s > 0) for term in terms) or sum(t.share for t in terms) >= 1:
            raise ValueError("a Prony series needs shares > 0 that sum to less than 1 and time constants > 0")
        self._terms = tuple(terms)
        self._lasting = 1 - sum(term.share for term in terms)
        self._kept = [0.0] * len(terms)
        self._elastic_n = 0.0

    def advance(self, step_s: float, elastic_n: float) -> float:
        """The force step_s (> 0) later, Fe having gone to elastic_n in a straight line; never a pull."""
        rate = (elastic_n - self._elastic_n) / step_s
        for i, term in enumerate(self._terms):
            decay = math.exp(-step_s / term.tau_s)
            self._kept[i] = decay * self._kept[i] + term.share * rate * term.tau_s * (1 - decay)
        self._elastic_n = elastic_n
        # Skin that has not sprung back yet parts from the indentor: contact cannot pull.
        return max(self._lasting * elastic_n + sum(self._kept), 0.0)


class RelaxingForce:
    """force_n(t) with relaxation, sampled every period_s whether anybody asks or not."""

    def __init__(
        self, scheduler: Scheduler, elastic_n: Callable[[float], float], terms: Sequence[PronyTerm], period_s: float
    ) -> None:
        self._scheduler, self._elastic_at, self._period_s = scheduler, elastic_n, period_s
        self._prony = PronyForce(terms)
        self._index = self._index_at(scheduler.monotonic_s())
        self._forces = {self._index: 0.0}
        self._tick()

    def force_n(self, t_s: float) -> float:
        """Force at the last sample instant by t_s, N; NaN where the elastic force has no answer."""
        index = self._index_at(t_s)
        while self._index < index:
            self._step()
        return self._forces.get(index, 0.0)

    def _step(self) -> None:
        self._index += 1
        elastic = self._elastic_at(self._index * self._period_s)
        unknown = math.isnan(elastic)
        self._forces[self._index] = math.nan if unknown else self._prony.advance(self._period_s, elastic)
        self._forces.pop(self._index - _KEPT, None)

    def _tick(self) -> None:
        # One period behind: in real time the newest sample may still be on its way.
        self.force_n(self._scheduler.monotonic_s() - self._period_s)
        self._scheduler.call_at((self._index_at(self._scheduler.monotonic_s()) + 1) * self._period_s, self._tick)

    def _index_at(self, t_s: float) -> int:
        return math.floor(t_s / self._period_s + 1e-6)
