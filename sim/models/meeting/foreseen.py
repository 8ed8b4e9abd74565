"""The force of any finger of a prior under any of a few shapes, of thousands of fingers at once."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sim.config.fingertip_config import FingertipConfig
from sim.models.fingertip import Fingertip
from sim.models.meeting.given import Way
from sim.models.meeting.prior import TAU_FAST_S, Prior
from sim.models.meeting.shape_table import SHALLOWEST_MM, Axis, Scope, ShapeTable

Array = NDArray[np.float64]

_NODES = {"ln_e_dermis": 4, "ln_e_fat": 4, "stiffening": 4}
"""Parameters that a table is made over, where the prior has them, and how many of each."""

_TAU_NODES = 4


def tissue_axes(prior: Prior) -> tuple[Axis, ...]:
    """Those of the prior that change more than the scale of force."""
    named = [prior.parameter(name) for name in _NODES if name in prior.names]
    return tuple(Axis(p.name, p.low, p.high, _NODES[p.name]) for p in named)


def finger_of(config: FingertipConfig, values: Mapping[str, float]) -> Fingertip:
    """The finger of some tissue parameters, interpolated, at the stiffness that was calibrated."""
    changed = {name.removeprefix("ln_"): np.exp(v) if name.startswith("ln_") else v for name, v in values.items()}
    tissue = config.tissue.model_copy(update={name: float(v) for name, v in changed.items()})
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

    def table(self, indentor: str) -> ShapeTable:
        """Of a shape. Raises ModelRangeError."""
        if indentor not in self._tables:
            about = self.config.model_dump(
                mode="json", exclude={"tissue": {"e_dermis", "e_fat", "stiffness"}, "contact": True}
            )
            self._tables[indentor] = ShapeTable.read_or_made(
                indentor, self.scope, lambda values: finger_of(self.config, values), about
            )
        return self._tables[indentor]

    def forces_gwt(self, draws: Array, way: Way) -> Array:
        """(n, r) on the way, of (n, p) fingers."""
        elastic = self.elastic_gwt(draws, way)
        fast, slow = (self._column(draws, name) for name in ("share_fast", "share_slow"))
        faded = elastic @ way.fading(TAU_FAST_S).T
        tau = self._tau
        weights = tau.basis(self._column(draws, "ln_tau_slow_s"))
        slowly = sum(weights[:, [k]] * (elastic @ way.fading(float(np.exp(ln))).T) for k, ln in enumerate(tau.nodes))
        lasting = (1 - fast - slow)[:, None] * elastic[:, way.lowest]
        return np.asarray(lasting + fast[:, None] * faded + slow[:, None] * slowly)

    def elastic_gwt(self, draws: Array, way: Way) -> Array:
        """(n, p) at the heights, were there no relaxation."""
        table = self.table(way.indentor)
        x_mm = way.x_mm - self._column(draws, "x_mm")
        contact_mm = np.zeros(len(draws)) if way.by_depth else self.touches_mm(draws, way.indentor, way.x_mm)
        tissue = table.tissue_basis([self._column(draws, axis.name) for axis in self.scope.tissue])
        forces = table.forces_gwt(tissue, x_mm, contact_mm[:, None] - way.height_mm)
        return np.asarray(np.exp(self._column(draws, "ln_stiffness"))[:, None] * forces)

    def touches_mm(self, draws: Array, indentor: str, x_mm: float) -> Array:
        """(n,) height of first touch from where the apex is believed to be."""
        touch_mm = self.table(indentor).touches_mm(x_mm - self._column(draws, "x_mm"))
        return np.asarray(touch_mm + self._column(draws, "height_mm"))

    @property
    def _tau(self) -> Axis:
        p = self.prior.parameter("ln_tau_slow_s")
        return _tau_axis(p.low, p.high)

    def _column(self, draws: Array, name: str) -> Array:
        return draws[:, self.prior.index(name)]


@lru_cache
def _tau_axis(low: float, high: float) -> Axis:
    return Axis("ln_tau_slow_s", low, high, _TAU_NODES)
