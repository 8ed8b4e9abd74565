"""Predicted forces of many fingers of a prior under several shapes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.contact.indentor import ALONG
from sim.contact.shapes import parse_shape
from sim.errors import ModelRangeError
from sim.identification.force_table import LEAST_DEEP_MM, SHALLOWEST_MM, ChebyshevAxis, Scope, ShapeTable, shipped
from sim.identification.prior import LEAST_STIFFENING, TAU_FAST_S, TISSUE, Prior, tissue_of
from sim.measures.receptors import ReceptorPlaces
from sim.models.fingertip import Fingertip
from sim.models.interpolation import make_node, nodes_for
from sim.models.relaxation import Moves
from sim.workers import Work, one_by_one

# --- measured ---
#
# Trajectory and forces of one press, and the effect of relaxation.

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PressTrajectory:
    """Trajectory of an indentor (p heights) and the times of r force readings.

    The indentor moves evenly in the first half of the time from one height to the next, and stays there.
    """

    indentor: str
    x_mm: float  # position of the stage
    t_s: Array  # (p,) time at which it leaves a height
    height_mm: Array  # (p,) above the nominal apex; by depth: minus the depth
    read_s: Array  # (r,) times of the force readings
    by_depth: bool = False  # whether heights are relative to first touch
    _fading: dict[float, Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    @cached_property
    def lowest(self) -> NDArray[np.intp]:
        """(r,) index of the height at each reading, or of the last one before a move."""
        return np.searchsorted(self.ended_s, self.read_s + 1e-9, side="right") - 1

    @cached_property
    def ended_s(self) -> Array:
        """(p,) arrival times at the heights (s)."""
        return np.asarray(self.t_s - 0.5 * np.diff(self.t_s, prepend=self.t_s[:1]))

    def fading(self, tau_s: float) -> Array:
        """Return the (r, p) remaining shares of the elastic forces for one relaxation term."""
        if tau_s not in self._fading:
            self._fading[tau_s] = Moves(self.ended_s, self.t_s - self.ended_s).fading(tau_s, self.read_s, self.lowest)
        return self._fading[tau_s]


@dataclass(frozen=True)
class MeasuredPress:
    """Measured press: trajectory, forces minus the zero (gwt), and their noise."""

    trajectory: PressTrajectory
    force_gwt: Array  # (r,)
    noise_gwt: float  # standard deviation of a reading
    zero_sd_gwt: float  # standard deviation of the zero
    zero_gwt: float = 0.0  # zero that was subtracted
    contact_mm: float = 0.0  # height of the skin at the touch

    @property
    def by_depth(self) -> PressTrajectory:
        """Trajectory relative to the height of the touch."""
        return replace(self.trajectory, height_mm=self.trajectory.height_mm - self.contact_mm, by_depth=True)


def nominal_trajectory(
    indentor: str, x_mm: float, doi_mm: float, pace: "RampAndHold", shares: Sequence[float]
) -> PressTrajectory:
    """Return the trajectory of a press past first touch, with readings at shares of the ramp and in the hold."""
    steps = max(int(np.ceil(doi_mm / pace.increment_mm - 1e-9)), 1)
    heights = np.array([-doi_mm * k / steps for k in range(steps + 1)])
    t_s = np.array([pace.step_s * k for k in range(steps + 1)])
    at = np.unique([max(round(share * steps), 1) for share in shares])
    held = [float(t_s[-1]) + pace.hold_s * (k + 0.5) / pace.readings for k in range(pace.readings)]
    return PressTrajectory(indentor, x_mm, t_s, heights, np.array([*t_s[at], *held]), by_depth=True)


@dataclass(frozen=True)
class RampAndHold:
    """Ramp and hold of a press: increment (mm), its duration (s), hold (s) and predicted readings."""

    increment_mm: float = 0.05
    step_s: float = 0.15
    hold_s: float = 1.0
    readings: int = 6  # predicted readings of the hold


_NODES = 4
"""Chebyshev nodes of each tissue parameter of a table."""

_TAU_NODES = 4


def tissue_axes(prior: Prior) -> tuple[ChebyshevAxis, ...]:
    """Return the axes of the tissue parameters, which require a new model of the finger."""
    return tuple(ChebyshevAxis(p.name, p.low, p.high, _NODES) for p in map(prior.parameter, TISSUE))


def finger_of(config: FingertipConfig, values: Mapping[str, float]) -> Fingertip:
    """Return the interpolated finger of tissue parameters, at the calibrated stiffness and with stiffening."""
    stiff = {"strain": "finite", "stiffening": LEAST_STIFFENING}
    tissue = config.tissue.model_copy(update={**stiff, **tissue_of(values)})
    return Fingertip.load(_no_larger(config.model_copy(update={"tissue": tissue})), exact=False)


def _refusal(config: FingertipConfig, farthest_mm: float, indentor: str) -> str | None:
    """Return why the configured finger cannot be pressed with a shape to the least depth; None if it can."""
    finger = Fingertip.load(_no_larger(config), slopes=parse_shape(indentor).axes)
    try:
        for x_mm in (0.0, -farthest_mm, farthest_mm):
            finger.indent(indentor, x_mm, doi_mm=LEAST_DEEP_MM)
    except ModelRangeError as error:
        return str(error)
    return None


def _no_larger(config: FingertipConfig) -> FingertipConfig:
    """Return the finger with its mesh's own patch: a patch for each finger of a table would take hours."""
    return config.model_copy(update={"contact": config.contact.model_copy(update={"patch_gb": 0.0})})


class PredictedForces:
    """Predicted forces from one table per shape, which is read or computed at first use."""

    def __init__(
        self, config: FingertipConfig, prior: Prior, scope: Scope, tables: Mapping[str, ShapeTable] | None = None
    ) -> None:
        """Prepare the predictions. config: geometry, layers and mesh of the finger; the prior has its moduli. tables:
        existing tables.
        """
        self.config, self.prior, self.scope = config, prior, scope
        self._tables = dict(tables or {})

    @classmethod
    def over(cls, config: FingertipConfig, prior: Prior, farthest_mm: float, deepest_mm: float) -> "PredictedForces":
        """Return the forces for presses up to a distance from the pad center and up to a depth (mm)."""
        return cls(config, prior, Scope(tissue_axes(prior), farthest_mm, (SHALLOWEST_MM, deepest_mm)))

    def have(self, indentors: Sequence[str], work: Work) -> dict[str, str]:
        """Load or compute the tables of these shapes; work: executes the computations.

        Returns the shapes that cannot be pressed on this finger, with the reason; they are tried before the many
        builds.
        """
        missing = [name for name in indentors if not self._kept(name)]
        tried = work("shapes tried on this finger", partial(_refusal, self.config, self.scope.farthest_mm), missing)
        refused = {name: why for name, why in zip(missing, tried, strict=True) if why is not None}
        usable = [name for name in indentors if name not in refused]
        slopes = {parse_shape(name).axes for name in usable if name in missing}
        slopes |= {ALONG} if slopes else set()  # every finger is loaded with this axis
        nodes = [node for axes in sorted(slopes) for node in nodes_for(self.config, ReceptorPlaces(), axes)]
        for _ in work("full builds", make_node, [node for node in nodes if not node.kept]):
            pass
        for name in usable:
            try:
                self.table(name, work)
            except ModelRangeError as error:  # at other moduli than the finger's own
                refused[name] = str(error)
        return refused

    def table(self, indentor: str, work: Work = one_by_one) -> ShapeTable:
        """Return the table of a shape. Raises ModelRangeError."""
        if indentor not in self._tables:
            made = partial(finger_of, self.config)
            self._tables[indentor] = self._shipped(indentor) or ShapeTable.read_or_make(
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

    def forces_gwt(self, draws: Array, trajectory: PressTrajectory) -> Array:
        """Return the (n, r) forces at the readings for (n, p) fingers (gwt)."""
        elastic = self.elastic_gwt(draws, trajectory)
        fast, slow = (self._column(draws, name) for name in ("share_fast", "share_slow"))
        faded = elastic @ trajectory.fading(TAU_FAST_S).T
        tau = self._tau
        weights = tau.basis(self._column(draws, "ln_tau_slow_s"))
        slowly = sum(
            weights[:, [k]] * (elastic @ trajectory.fading(float(np.exp(ln))).T) for k, ln in enumerate(tau.nodes)
        )
        lasting = self.lasting(draws)[:, None] * elastic[:, trajectory.lowest]
        return np.asarray(lasting + fast[:, None] * faded + slow[:, None] * slowly)

    def lasting(self, draws: Array) -> Array:
        """Return the (n,) shares of the force that do not relax."""
        return np.asarray(1 - self._column(draws, "share_fast") - self._column(draws, "share_slow"))

    def elastic_gwt(self, draws: Array, trajectory: PressTrajectory) -> Array:
        """Return the (n, p) forces at the heights without relaxation (gwt)."""
        table = self.table(trajectory.indentor)
        x_mm = trajectory.x_mm - self._column(draws, "x_mm")
        contact_mm = (
            np.zeros(len(draws))
            if trajectory.by_depth
            else self.touches_mm(draws, trajectory.indentor, trajectory.x_mm)
        )
        tissue = table.tissue_basis([self._column(draws, axis.name) for axis in self.scope.tissue])
        stiffening = self._column(draws, "stiffening")
        forces = table.forces_gwt(tissue, stiffening, x_mm, contact_mm[:, None] - trajectory.height_mm)
        return np.asarray(np.exp(self._column(draws, "ln_stiffness"))[:, None] * forces)

    def touches_mm(self, draws: Array, indentor: str, x_mm: float) -> Array:
        """Return the (n,) heights of first touch above the nominal apex (mm)."""
        touch_mm = self.table(indentor).touches_mm(x_mm - self._column(draws, "x_mm"))
        return np.asarray(touch_mm + self._column(draws, "height_mm"))

    @property
    def _tau(self) -> ChebyshevAxis:
        p = self.prior.parameter("ln_tau_slow_s")
        return _tau_axis(p.low, p.high)

    def _column(self, draws: Array, name: str) -> Array:
        return draws[:, self.prior.index(name)]


def made_of(config: FingertipConfig) -> object:
    """Return the part of the configuration that identifies the interpolated fingers."""
    return config.model_dump(
        mode="json", exclude={"tissue": {"e_dermis", "e_fat", "stiffness", "strain", "stiffening"}, "contact": True}
    )


@lru_cache
def _tau_axis(low: float, high: float) -> ChebyshevAxis:
    return ChebyshevAxis("ln_tau_slow_s", low, high, _TAU_NODES)
