"""Coulomb friction under the indentor: limits, certificate, history, and what it refuses."""

import pickle
from typing import Any

import numpy as np
import pytest

from sim.config import FingertipConfig
from sim.contact.friction import FrictionState, at_rest, residual_of, solve_increment
from sim.contact.indentor import BOTH
from sim.contact.patch import Patch
from sim.contact.planes import Gathered
from sim.contact.points import ContactPose
from sim.contact.shapes import parse_shape
from sim.errors import SimError
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.friction import FrictionResult

SHAPES: dict[str, dict[str, float]] = {
    "cylinder:9": {"doi_mm": 0.4},
    "bar:3.0": {"doi_mm": 0.5},
    "step:1": {"doi_mm": 0.4},
    "line": {"doi_mm": 0.3},
    "sphere:4": {"doi_mm": 0.4},
    "flat:1.5": {"doi_mm": 0.3},
    "wedge:45": {"doi_mm": 0.4},
    "grating:1,2": {"doi_mm": 0.3},
    "bar:2.0,turn_deg=30": {"doi_mm": 0.3},
}


def certified(result: FrictionResult) -> tuple[float, float]:
    """Errors of normal contact and of Coulomb's law at the nodes, from forces and displacements alone."""
    state, patch = result.state, result.model.patch
    assert isinstance(state, FrictionState)
    points = state.points.on(patch)
    moved = points.interpolate(state.displacement)
    gap = state.pose.gap(points.tangential_mm + moved[:-1], points.y + moved[-1])
    normal = np.concatenate([gap.slope, -np.ones_like(gap.slope[:1])])
    normal /= np.linalg.norm(normal, axis=0)
    p = (normal * state.pushing).sum(axis=0)
    tangential = np.linalg.norm(state.pushing - normal * p, axis=0)
    loaded = p > 1e-9 * p.max()
    gap_mm = gap.height_mm / np.sqrt(1 + (gap.slope**2).sum(axis=0))
    apart = np.abs(gap_mm[loaded]).max() / result.doi_mm
    through = max(0.0, -gap_mm.min()) / result.doi_mm
    tension = max(0.0, -p.min()) / p.max()
    below = loaded & (tangential < result.friction * p * (1 - 1e-6))
    slipping_below = state.slip_mm[below].max(initial=0.0) / result.doi_mm
    beyond = max(0.0, float((tangential - result.friction * p).max())) / p.max()
    return max(apart, through, tension), max(slipping_below, beyond)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("friction", [0.05, 0.3, 0.6, 10.0])
def test_every_press_obeys_coulombs_law(coarse_finger: Fingertip, shape: str, friction: float) -> None:
    result = coarse_finger.indent(shape, friction=friction, **SHAPES[shape])
    assert isinstance(result, FrictionResult)
    assert result.state.converged
    # forces and displacements obey it to the residual, whose root is the slip of a force 1e-6 below the cone
    assert max(certified(result)) < 1e-6
    force = result.state.force.reshape(-1)
    model = coarse_finger._with_all_axes[result.indentor.axes].model_for(BOTH)
    np.testing.assert_allclose(
        (model.patch.compliance @ force).reshape(3, -1), result.state.displacement, atol=1e-9, rtol=0
    )


@pytest.mark.parametrize("shape", ["step:1", "line", "sphere:4", "bar:2.0,turn_deg=30"])
def test_vanishing_friction_equals_frictionless_contact(coarse_finger: Fingertip, shape: str) -> None:
    smooth = coarse_finger.indent(shape, **SHAPES[shape])
    result = coarse_finger.indent(shape, friction=1e-11, **SHAPES[shape])
    assert result.force_n == pytest.approx(smooth.force_n, rel=1e-9)
    strain = smooth.receptor_strain
    np.testing.assert_allclose(result.receptor_strain, strain, rtol=0, atol=1e-9 * np.abs(strain).max())


def test_zero_friction_equals_a_frictionless_press_and_builds_no_model(coarse_config: FingertipConfig) -> None:
    fresh = load("finger", coarse_config, cached=False)
    one, other = fresh.indent("bar:1.5", doi_mm=0.2), fresh.indent("bar:1.5", doi_mm=0.2, friction=0.0)
    assert type(other) is type(one)
    assert (other.force_n, other.receptor_strain.tobytes()) == (one.force_n, one.receptor_strain.tobytes())
    assert not fresh._with_all_axes


def bonded(patch: Patch, pose: ContactPose, before: FrictionState) -> np.ndarray:
    """Displacements of skin that is held wherever it touches, by the set that neither pulls nor is through."""
    move = np.array([*np.subtract(pose.at_mm, before.pose.at_mm), pose.height_mm - before.pose.height_mm])
    m, n = before.displacement.shape
    start = held = before.displacement + move[:, None]
    along = np.zeros(n)
    for _ in range(60):  # what has not touched before lands along the normal there
        surface = pose.gap(patch.tangential_mm + held[:-1], patch.y + held[-1])
        normal = np.concatenate([-surface.slope, np.ones((1, n))]) / np.sqrt(1 + surface.slope**2)
        along += surface.height_mm * normal[-1]
        held = start + along * normal
    stuck = before.active.copy()
    for _ in range(4 * n):
        rows = (n * np.arange(m)[:, None] + np.flatnonzero(stuck)).ravel()
        force = np.zeros(m * n)
        force[rows] = np.linalg.solve(patch.compliance[np.ix_(rows, rows)], held.ravel()[rows]) if len(rows) else 0.0
        u = (patch.compliance @ force).reshape(m, n)
        gap = pose.gap(patch.tangential_mm + u[:-1], patch.y + u[-1])
        pull = (np.concatenate([surface.slope, -np.ones((1, n))]) * force.reshape(m, n)).sum(axis=0) < 0
        wrong = (stuck & pull) | (~stuck & (gap.height_mm < -1e-12))
        if not wrong.any():
            return u
        stuck[np.flatnonzero(wrong)[0]] ^= True
    raise AssertionError("no set of nodes bonds")


def test_unlimited_friction_equals_bonded_contact(coarse_finger: Fingertip) -> None:
    section = load("section", coarse_finger.config)
    patch, shape = section.model.patch, parse_shape("cylinder:9")
    height = section.touch_height_mm(shape, 0.0)
    state = at_rest(patch, ContactPose(shape, (0.0,), height, 1e-3), 1e9)
    for k in range(1, 7):
        pose = ContactPose(shape, (0.02 * max(k - 3, 0),), height - 0.05 * k, 0.05 * k)
        u = bonded(patch, pose, state)
        state = solve_increment(patch, pose, state, between_nodes=False, gathered=Gathered(patch))
        assert state.converged
        np.testing.assert_allclose(state.displacement, u, rtol=0, atol=1e-9)


@pytest.mark.parametrize("shape", ["bar:3.0", "cylinder:9", "sphere:4"])
def test_a_press_with_friction_does_not_depend_on_the_increment(coarse_finger: Fingertip, shape: str) -> None:
    long, short = (coarse_finger.indent(shape, doi_mm=0.3, friction=0.3, increment_mm=s) for s in (0.05, 0.002))
    assert short.state.converged
    assert short.force_n == pytest.approx(long.force_n, rel=2e-3)
    np.testing.assert_allclose(short.receptor_measures["sed"], long.receptor_measures["sed"], rtol=0.02)


def test_a_press_with_friction_continues_from_a_stored_state(coarse_finger: Fingertip) -> None:
    whole = coarse_finger.indent("bar:3.0", doi_mm=0.5, friction=0.3)
    half = pickle.loads(pickle.dumps(coarse_finger.indent("bar:3.0", doi_mm=0.25, friction=0.3)))
    rest = coarse_finger.indent("bar:3.0", doi_mm=0.5, friction=0.3, start=half.state)
    assert rest.force_n == pytest.approx(whole.force_n, rel=1e-9)
    np.testing.assert_allclose(rest.receptor_strain, whole.receptor_strain, rtol=0, atol=1e-8)


def test_unloading_with_friction_takes_another_path_than_loading(coarse_finger: Fingertip) -> None:
    # less force where the skin, on its way out, is held by friction the other way; none after the last touch
    up = [coarse_finger.indent("sphere:4", doi_mm=d, friction=0.3) for d in (0.2, 0.4)]
    down = coarse_finger.indent("sphere:4", doi_mm=0.2, friction=0.3, start=up[1].state)
    assert down.state.converged
    assert abs(down.force_n / up[0].force_n - 1) > 1e-3
    off = coarse_finger.indent("sphere:4", doi_mm=1e-6, friction=0.3, start=up[1].state)
    assert off.force_n < 1e-6 * up[0].force_n


def test_force_control_with_friction_reaches_the_force(coarse_finger: Fingertip) -> None:
    by_force = coarse_finger.indent("cylinder:9", force_gwt=4.0, friction=0.3)
    by_depth = coarse_finger.indent("cylinder:9", doi_mm=by_force.doi_mm, friction=0.3)
    assert by_force.force_gwt == pytest.approx(4.0, rel=1e-9)
    assert by_depth.force_gwt == pytest.approx(4.0, rel=2e-3)  # in increments of another length


def test_a_dragged_indentor_shears_the_skin_by_the_friction_force(coarse_finger: Fingertip) -> None:
    pressed = coarse_finger.with_friction(0.3)
    from_left, from_right = (pressed.drag("cylinder:9", [sign * 0.8, 0.0, sign * 0.2], 0.3) for sign in (-1, 1))
    assert all(one.state.converged for one in (*from_left, *from_right))
    arrived, other = from_left[1], from_right[1]
    assert arrived.sticking_share == other.sticking_share == 0.0
    sheared = 0.5 * (arrived.shear_force_n[0] - other.shear_force_n[0])
    assert sheared == pytest.approx(0.3 * 0.5 * (arrived.force_n + other.force_n), rel=0.05)
    assert from_left[2].shear_force_n[0] < arrived.shear_force_n[0]  # sideways unloading


def test_the_order_of_presses_with_friction_matters_only_without_lifting(coarse_finger: Fingertip) -> None:
    pressed, where = coarse_finger.with_friction(0.3), [-0.2, 0.1, 0.4]
    lifted, back = ([pressed.indent("cylinder:9", x, doi_mm=0.3) for x in order] for order in (where, where[::-1]))
    assert [r.force_n for r in lifted] == [r.force_n for r in back[::-1]]
    up, down = (pressed.drag("cylinder:9", order, 0.3) for order in (where, where[::-1]))
    assert [r.x_mm for r in up] == [r.x_mm for r in down[::-1]] == where
    assert up[1].shear_force_n[0] > 0 > down[1].shear_force_n[0]
    assert up[0].force_n == lifted[0].force_n  # where the row begins


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"friction": -0.1}, "bad_friction"),
        ({"friction": float("nan")}, "bad_friction"),
        ({"friction": 11.0}, "bad_friction"),
        ({"friction": 0.3, "other_paths": True}, "friction_with_other_paths"),
    ],
)
def test_an_impossible_friction_coefficient_is_refused(
    coarse_finger: Fingertip, options: dict[str, Any], code: str
) -> None:
    with pytest.raises(SimError) as caught:
        coarse_finger.indent("bar:3.0", doi_mm=0.3, **options)
    assert caught.value.code == code


def test_a_start_state_of_another_friction_is_refused(coarse_finger: Fingertip) -> None:
    smooth = coarse_finger.indent("bar:3.0", doi_mm=0.3).state
    other = coarse_finger.indent("bar:3.0", doi_mm=0.3, friction=0.6).state
    for start in (smooth, other):
        with pytest.raises(SimError) as caught:
            coarse_finger.indent("bar:3.0", doi_mm=0.4, friction=0.3, start=start)
        assert caught.value.code == "other_start"


def test_the_friction_residual_detects_each_violation_of_coulombs_law() -> None:
    p, gap, none = np.array([1.0, 0.5]), np.zeros(2), np.zeros((2, 2))
    against = np.array([[-0.3, 0.0], [0.0, 0.0]])
    slip = np.array([[0.01, 0.0], [0.0, 0.0]])
    assert max(residual_of(p, against, gap, slip, 0.3, 1.0)) < 1e-15
    assert residual_of(p, -against, gap, slip, 0.3, 1.0).slip > 1e-3  # along the slip
    assert residual_of(p, none, gap, slip, 0.3, 1.0).slip > 1e-3  # slip without force
    assert residual_of(p, 1.1 * against, gap, none, 0.3, 1.0).cone == pytest.approx(0.03)
    assert residual_of(p, none, gap + 0.1, none, 0.3, 1.0).normal == pytest.approx(0.1)
    assert residual_of(np.array([1.0, -0.2]), none, gap, none, 0.3, 1.0).normal == pytest.approx(0.2)
