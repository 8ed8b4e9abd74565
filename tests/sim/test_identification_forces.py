"""Quick forces over the parameters of a prior: tables, places, heights, relaxation."""

from dataclasses import replace

import numpy as np
import pytest

from sim.config import FingertipConfig
from sim.identification.force_table import ChebyshevAxis, Scope, ShapeTable
from sim.identification.predicted_forces import (
    PressTrajectory,
    RampAndHold,
    finger_of,
    nominal_trajectory,
    tissue_axes,
)
from sim.identification.prior import PARAMETERS, TAU_FAST_S, Prior
from sim.models.relaxation import Memory, Prony, PronyTerm
from sim.models.stiffening import FORCE
from tests.made_up_fingers import SHAPES, STRAIN, lying, made_up
from tests.sim.coarse_mesh import coarse_mesh

PRIOR = Prior()
COARSE = FingertipConfig(mesh=coarse_mesh(0.5, 0.6, patch_x_mm=2.8, patch_z_mm=2.8))


def _finger(**changed: float) -> np.ndarray:
    draw = PRIOR.middle.copy()
    for name, value in changed.items():
        draw[PRIOR.index(name)] = value
    return draw[None]


def _still(**changed: float) -> np.ndarray:
    """One that neither relaxes nor, unless told, stiffens."""
    return _finger(**{"share_fast": 0.0, "share_slow": 0.0, "stiffening": 0.0, **changed})


def _way(x_mm: float, *height_mm: float) -> PressTrajectory:
    t_s = 0.2 * np.arange(len(height_mm))
    return PressTrajectory("sphere:4", x_mm, t_s, np.array(height_mm), t_s, by_depth=True)


def test_draws_of_the_prior_stay_within_its_ranges() -> None:
    draws = PRIOR.draws(4000, np.random.default_rng(0))
    assert draws.shape == (4000, len(PARAMETERS))
    assert PRIOR.within(draws).all()
    assert draws[:, PRIOR.index("ln_stiffness")].mean() == pytest.approx(np.log(0.7), abs=0.03)
    assert draws[:, PRIOR.index("x_mm")].std() == pytest.approx(0.265, abs=0.02)  # 0.3, cut off at two of them
    outside = draws[:1].copy()
    outside[0, PRIOR.index("x_mm")] = 0.61
    assert not PRIOR.within(outside)[0]
    assert PRIOR.off(PRIOR.middle + 2 * PRIOR.sd) == pytest.approx(np.full(len(PARAMETERS), 2.0))


def test_force_tables_span_the_moduli_and_stiffening_is_a_factor() -> None:
    assert [axis.name for axis in tissue_axes(PRIOR)] == ["ln_e_dermis", "ln_e_fat"]
    trajectory = _way(0.4, 0.0, -0.2, -0.7)
    linear, stiffer = (made_up().elastic_gwt(_still(stiffening=a), trajectory)[0] for a in (0.0, 0.6))
    assert stiffer[1:] / linear[1:] == pytest.approx((1 + 0.6 * STRAIN * np.array([0.2, 0.7]) ** 2) ** FORCE.law)
    assert stiffer[0] == linear[0] == 0.0


@pytest.mark.parametrize("shape", SHAPES)
def test_force_tables_reproduce_made_up_forces(shape: str) -> None:
    scale, exponent, by_fat = SHAPES[shape]
    found = made_up().elastic_gwt(_still(ln_stiffness=0.5, ln_e_dermis=-1.5, x_mm=0.25), PressTrajectory(
        shape, 1.0, np.array([0.0]), np.array([-0.4]), np.array([0.0]), by_depth=True
    ))[0, 0]  # fmt: skip
    tissue = (0.8 - by_fat) * -1.5 + by_fat * np.log(0.08) + 2.0
    assert found == pytest.approx(np.exp(0.5 + tissue - 0.08 * 0.75**2) * scale * 0.4**exponent, rel=1e-9)


def test_unknown_height_and_place_shift_the_trajectory_of_a_press() -> None:
    predicted = made_up()
    by_depth = _way(1.0, 0.0, -0.3)
    finger = _still(height_mm=0.2, x_mm=-0.4)
    assert predicted.touches_mm(finger, "sphere:4", 1.0)[0] == pytest.approx(0.2 - 1.4**2 / 8)
    by_height = lying(predicted, finger[0], by_depth)
    assert not by_height.by_depth
    assert predicted.elastic_gwt(finger, by_height) == pytest.approx(predicted.elastic_gwt(finger, by_depth))


def test_predicted_relaxation_follows_the_prony_series_step_by_step() -> None:
    predicted, trajectory = made_up(), nominal_trajectory("sphere:4", 0.0, 0.42, RampAndHold(), (0.5, 1.0))
    soon_s = 0.25 * trajectory.t_s[3] + 0.75 * trajectory.t_s[4]  # after a move, before the next
    trajectory = replace(trajectory, read_s=np.sort([*trajectory.read_s, soon_s]))
    finger = _finger(share_fast=0.25, share_slow=0.15, ln_tau_slow_s=np.log(1.1))
    elastic = predicted.elastic_gwt(finger, trajectory)[0]
    memory, now_s, at, felt = Memory.none(Prony([PronyTerm(0.25, TAU_FAST_S), PronyTerm(0.15, 1.1)])), 0.0, 0, []
    instants = sorted({*trajectory.read_s, *trajectory.t_s, *(0.5 * (trajectory.t_s[1:] + trajectory.t_s[:-1]))})
    for t_s in instants[1:]:
        at = min(int(np.searchsorted(trajectory.t_s, t_s - 1e-9)), len(elastic) - 1)
        ahead = memory.ahead(t_s - now_s)  # the way goes on in the first half of each step of it
        memory, now_s = memory.after(ahead, elastic[at]), t_s
        force = ahead.stiffness * (elastic[at] - float(ahead.carried))
        felt += [force] if np.isclose(trajectory.read_s, t_s).any() else []
    assert predicted.forces_gwt(finger, trajectory)[0] == pytest.approx(felt, rel=2e-3)
    assert felt[-1] < 0.8 * elastic[-1]


def test_a_nominal_trajectory_descends_in_increments_and_is_read_in_its_hold() -> None:
    trajectory = nominal_trajectory("bar:3.0", 0.5, 0.21, RampAndHold(0.05, 0.15, 1.0, 4), (0.5, 1.0))
    assert -trajectory.height_mm == pytest.approx(np.linspace(0, 0.21, 6))
    assert trajectory.t_s == pytest.approx(0.15 * np.arange(6))
    assert trajectory.read_s == pytest.approx([0.3, 0.75, 0.875, 1.125, 1.375, 1.625])
    assert trajectory.lowest.tolist() == [2, 5, 5, 5, 5, 5]
    assert trajectory.ended_s == pytest.approx([0.0, 0.075, 0.225, 0.375, 0.525, 0.675])
    assert replace(trajectory, read_s=np.array([0.22, 0.23, 0.3])).lowest.tolist() == [1, 2, 2]


@pytest.mark.parametrize("stiffening", [0.05, 0.6])
def test_a_force_table_of_the_finite_element_finger_is_near_direct_presses(stiffening: float) -> None:
    """Of one tissue, that costs little; its own error is that of the polynomials in place and depth."""
    scope = Scope((ChebyshevAxis("ln_e_fat", np.log(0.079), np.log(0.081), 1),), 0.6, (0.05, 0.6), places=3, depths=5)
    table = ShapeTable.read_or_make("bar:3.0", scope, lambda values: finger_of(COARSE, values), "a test")
    assert 0 < table.error < 0.03
    finger = finger_of(COARSE, {"ln_e_fat": float(np.log(0.08)), "stiffening": stiffening})
    direct = finger.indent("bar:3.0", 0.3, doi_mm=0.4).force_gwt
    basis = table.tissue_basis([np.log([0.08])])
    found = table.forces_gwt(basis, np.array([stiffening]), np.array([0.3]), np.array([[0.4]]))
    assert found[0, 0] == pytest.approx(direct, rel=0.03)
