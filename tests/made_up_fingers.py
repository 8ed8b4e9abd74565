"""Fingers whose forces are closed forms, for meetings that need no model: each shape with an exponent of its own."""

from collections.abc import Mapping

import numpy as np

from sim.config import FingertipConfig
from sim.identification.force_table import Scope, ShapeTable
from sim.identification.predicted_forces import MeasuredPress, PredictedForces, PressTrajectory, tissue_axes
from sim.identification.prior import Prior

SHAPES: Mapping[str, tuple[float, float, float]] = {  # gwt at 1 mm, exponent of depth, exponent of the fat's modulus
    "sphere:4": (11.0, 1.5, 0.3),
    "flat:3": (16.0, 1.7, 0.45),
    "bar:3.0": (15.0, 1.6, 0.35),
    "cylinder:9": (13.0, 1.55, 0.4),
}
GEOMETRIC = 0.0  # ln of the factor of finite strain at small depths; it grows with depth
_ROUND_MM = 4.0  # of the pad, under all of them
STRAIN = 0.4  # that the law stiffens with, at 1 mm
_BESIDE = 0.08  # of force, lost for each mm² beside the middle


def made_up(prior: Prior | None = None, deepest_mm: float = 1.1) -> PredictedForces:
    """Tables of closed forms, at their nodes."""
    prior = Prior() if prior is None else prior
    scope = Scope(tissue_axes(prior), 1.8, (0.03, deepest_mm), places=3, depths=4)
    dermis, fat = (axis.nodes for axis in scope.tissue)
    x, ln_d = scope.x.nodes, scope.depth.nodes
    touch_mm = -(scope.touch_x.nodes**2) / (2 * _ROUND_MM)
    tables = {}
    for name, (scale, exponent, by_fat) in SHAPES.items():
        tissue = (0.8 - by_fat) * dermis[:, None] + by_fat * fat + 2.0
        ln_force = np.log(scale) + tissue[:, :, None, None] + exponent * ln_d - _BESIDE * x[:, None] ** 2
        ln_strain = np.broadcast_to(np.log(STRAIN * np.exp(ln_d) ** 2), ln_force.shape)
        about = {"error": np.array(0.0), "deepest_mm": np.array(deepest_mm)}
        ln_geometric = np.broadcast_to(GEOMETRIC * (1 - 1.5 * np.exp(ln_d)), ln_force.shape)
        arrays = {
            "ln_force": ln_force,
            "ln_geometric": ln_geometric,
            "ln_strain": ln_strain,
            "touch_mm": touch_mm,
            **about,
        }
        tables[name] = ShapeTable(name, scope, arrays)
    return PredictedForces(FingertipConfig(), prior, scope, tables)


def lying(predicted: PredictedForces, draw: np.ndarray, trajectory: PressTrajectory) -> PressTrajectory:
    """A way by depth as a stage goes it that finds the skin of a finger by touch."""
    contact_mm = float(predicted.touches_mm(draw[None], trajectory.indentor, trajectory.x_mm)[0])
    return PressTrajectory(
        trajectory.indentor, trajectory.x_mm, trajectory.t_s, trajectory.height_mm + contact_mm, trajectory.read_s
    )


def pressed(
    predicted: PredictedForces,
    draw: np.ndarray,
    trajectory: PressTrajectory,
    chance: np.random.Generator,
    noise_gwt: float,
) -> MeasuredPress:
    """A press on a finger, read by a cell with noise."""
    contact_mm = float(predicted.touches_mm(draw[None], trajectory.indentor, trajectory.x_mm)[0])
    trajectory = lying(predicted, draw, trajectory)
    force = predicted.forces_gwt(draw[None], trajectory)[0]
    return MeasuredPress(
        trajectory, force + chance.normal(0.0, noise_gwt, len(force)), noise_gwt, 0.003, 0.0, contact_mm
    )
