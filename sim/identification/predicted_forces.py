"""The force of any finger of a prior under any of a few shapes, of thousands of fingers at once."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.contact.indentor import ALONG
from sim.contact.shapes import parse_shape
from sim.identification.force_table import SHALLOWEST_MM, ChebyshevAxis, Scope, ShapeTable, shipped
from sim.identification.prior import LEAST_STIFFENING, TAU_FAST_S, TISSUE, Prior, tissue_of
from sim.measures.receptors import ReceptorPlaces
from sim.models.fingertip import Fingertip
from sim.models.interpolation import make_node, nodes_for
from sim.models.relaxation import Moves
from sim.workers import Work, one_by_one

# --- given ---
#
# What one press gave: where the indentor was when, and the forces read; and what relaxation makes of them.

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PressTrajectory:
    """An indentor on its way down, and when its force is asked for.

    It moves evenly in the first half of the time from one height to the next, and stays where it came to.
    """

    indentor: str
    x_mm: float  # as the stage has it
    t_s: Array  # (p,) until when it stays there
    height_mm: Array  # (p,) above where the apex is believed to be; of a way by depth, less the depth
    asked_s: Array  # (r,) when a force is asked for
    by_depth: bool = False  # heights are counted from first touch

    @property
    def lowest(self) -> NDArray[np.intp]:
        """(r,) which height it has then, or goes from."""
        return np.searchsorted(self.ended_s, self.asked_s + 1e-9, side="right") - 1

    @property
    def ended_s(self) -> Array:
        """(p,) when it came to the heights."""
        return np.asarray(self.t_s - 0.5 * np.diff(self.t_s, prepend=self.t_s[:1]))

    def fading(self, tau_s: float) -> Array:
        """(r, p) what a term of relaxation has left of elastic forces at the heights."""
        return Moves(self.ended_s, self.t_s - self.ended_s).fading(tau_s, self.asked_s, self.lowest)


@dataclass(frozen=True)
class Given:
    """A press as it was read: forces less the zero, gwt, and how well one reading is known."""

    way: PressTrajectory
    force_gwt: Array  # (r,)
    noise_gwt: float  # sd of a reading
    zero_sd_gwt: float  # of what was taken off all of them
    zero_gwt: float = 0.0  # that
    contact_mm: float = 0.0  # height at which the touch found the skin

    @property
    def by_depth(self) -> PressTrajectory:
        """The way from where the touch found the skin."""
        return replace(self.way, height_mm=self.way.height_mm - self.contact_mm, by_depth=True)


def nominal_way(
    indentor: str, x_mm: float, doi_mm: float, pace: "RampAndHold", shares: Sequence[float]
) -> PressTrajectory:
    """A press to a depth past first touch, asked for at shares of its ramp, and over its hold at the end."""
    steps = max(int(np.ceil(doi_mm / pace.increment_mm - 1e-9)), 1)
    heights = np.array([-doi_mm * k / steps for k in range(steps + 1)])
    t_s = np.array([pace.step_s * k for k in range(steps + 1)])
    at = np.unique([max(round(share * steps), 1) for share in shares])
    held = [float(t_s[-1]) + pace.hold_s * (k + 0.5) / pace.readings for k in range(pace.readings)]
    return PressTrajectory(indentor, x_mm, t_s, heights, np.array([*t_s[at], *held]), by_depth=True)


@dataclass(frozen=True)
class RampAndHold:
    """How the bench presses: so far in so long, then held."""

    increment_mm: float = 0.05
    step_s: float = 0.15
    hold_s: float = 1.0
    readings: int = 6  # of a hold, that are foreseen


_NODES = 4
"""Ranges of the parameters of a table."""

_TAU_NODES = 4


def tissue_axes(prior: Prior) -> tuple[ChebyshevAxis, ...]:
    """Those of the prior that a model of the finger is made anew for."""
    return tuple(ChebyshevAxis(p.name, p.low, p.high, _NODES) for p in map(prior.parameter, TISSUE))


def finger_of(config: FingertipConfig, values: Mapping[str, float]) -> Fingertip:
    """The finger of some tissue parameters, interpolated, at the stiffness that was calibrated; it stiffens."""
    tissue = config.tissue.model_copy(update={"stiffening": LEAST_STIFFENING, **tissue_of(values)})
    no_larger = config.contact.model_copy(update={"patch_gb": 0.0})  # a patch for each finger would take hours
    return Fingertip.load(config.model_copy(update={"tissue": tissue, "contact": no_larger}), exact=False)


class Foreseen:
    """Forces by tables of shapes, which are read or made when a shape is first asked for."""

    def __init__(
        self, config: FingertipConfig, prior: Prior, scope: Scope, tables: Mapping[str, ShapeTable] | None = None
    ) -> None:
        """config: the finger's geometry, layers and mesh; its moduli are the prior's. tables: some that there are."""
        self.config, self.prior, self.scope = config, prior, scope
        self._tables = dict(tables or {})

    @classmethod
    def over(cls, config: FingertipConfig, prior: Prior, farthest_mm: float, deepest_mm: float) -> "Foreseen":
        """For presses so far from the pad's centre and so deep."""
        return cls(config, prior, Scope(tissue_axes(prior), farthest_mm, (SHALLOWEST_MM, deepest_mm)))

    def have(self, indentors: Sequence[str], work: Work) -> None:
        """Have tables of all these shapes, what is not kept being made; work: how. Raises ModelRangeError."""
        slopes = {parse_shape(name).axes for name in indentors if not self._kept(name)}
        slopes |= {ALONG} if slopes else set()  # every finger is loaded with it
        nodes = [node for axes in sorted(slopes) for node in nodes_for(self.config, ReceptorPlaces(), axes)]
        for _ in work("full builds", make_node, [node for node in nodes if not node.kept]):
            pass
        for name in indentors:
            self.table(name, work)

    def table(self, indentor: str, work: Work = one_by_one) -> ShapeTable:
        """Of a shape. Raises ModelRangeError."""
        if indentor not in self._tables:
            made = partial(finger_of, self.config)
            self._tables[indentor] = self._shipped(indentor) or ShapeTable.read_or_made(
                indentor, self.scope, made, self._made_of, work
            )
        return self._tables[indentor]

    def _kept(self, indentor: str) -> bool:
        there = indentor in self._tables or self._shipped(indentor) is not None
        return there or ShapeTable.kept(indentor, self.scope, self._made_of)

    def _shipped(self, indentor: str) -> ShapeTable | None:
        return shipped(indentor, self.scope) if self._made_of == made_of(FingertipConfig()) else None

    @property
    def _made_of(self) -> object:
        return made_of(self.config)

    def forces_gwt(self, draws: Array, way: PressTrajectory) -> Array:
        """(n, r) on the way, of (n, p) fingers."""
        elastic = self.elastic_gwt(draws, way)
        fast, slow = (self._column(draws, name) for name in ("share_fast", "share_slow"))
        faded = elastic @ way.fading(TAU_FAST_S).T
        tau = self._tau
        weights = tau.basis(self._column(draws, "ln_tau_slow_s"))
        slowly = sum(weights[:, [k]] * (elastic @ way.fading(float(np.exp(ln))).T) for k, ln in enumerate(tau.nodes))
        lasting = self.lasting(draws)[:, None] * elastic[:, way.lowest]
        return np.asarray(lasting + fast[:, None] * faded + slow[:, None] * slowly)

    def lasting(self, draws: Array) -> Array:
        """(n,) share of a force that never relaxes."""
        return np.asarray(1 - self._column(draws, "share_fast") - self._column(draws, "share_slow"))

    def elastic_gwt(self, draws: Array, way: PressTrajectory) -> Array:
        """(n, p) at the heights, were there no relaxation."""
        table = self.table(way.indentor)
        x_mm = way.x_mm - self._column(draws, "x_mm")
        contact_mm = np.zeros(len(draws)) if way.by_depth else self.touches_mm(draws, way.indentor, way.x_mm)
        tissue = table.tissue_basis([self._column(draws, axis.name) for axis in self.scope.tissue])
        stiffening = self._column(draws, "stiffening")
        forces = table.forces_gwt(tissue, stiffening, x_mm, contact_mm[:, None] - way.height_mm)
        return np.asarray(np.exp(self._column(draws, "ln_stiffness"))[:, None] * forces)

    def touches_mm(self, draws: Array, indentor: str, x_mm: float) -> Array:
        """(n,) height of first touch from where the apex is believed to be."""
        touch_mm = self.table(indentor).touches_mm(x_mm - self._column(draws, "x_mm"))
        return np.asarray(touch_mm + self._column(draws, "height_mm"))

    @property
    def _tau(self) -> ChebyshevAxis:
        p = self.prior.parameter("ln_tau_slow_s")
        return _tau_axis(p.low, p.high)

    def _column(self, draws: Array, name: str) -> Array:
        return draws[:, self.prior.index(name)]


def made_of(config: FingertipConfig) -> object:
    """What says which fingers are interpolated."""
    return config.model_dump(
        mode="json", exclude={"tissue": {"e_dermis", "e_fat", "stiffness", "stiffening"}, "contact": True}
    )


@lru_cache
def _tau_axis(low: float, high: float) -> ChebyshevAxis:
    return ChebyshevAxis("ln_tau_slow_s", low, high, _TAU_NODES)
