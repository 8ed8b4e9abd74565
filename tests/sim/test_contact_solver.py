"""Contact on the condensed patch: first touch, and a residual that is what it says."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.contact import solver
from sim.contact.first_contact import first_touch
from sim.contact.force_control import ForceNotReachedError, TooDeepError, solve_for_force
from sim.contact.indentor import Indentor
from sim.contact.patch import Patch, X, Y
from sim.contact.points import ContactPoints, ContactPose, Survey, displaced_gap
from sim.contact.profiles import Bar, SinusoidalStep
from sim.contact.shapes import parse_shape
from sim.contact.solver import ContactState, solve_contact
from sim.finger.surface import FingertipSurface
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult
from tests.error_codes import raises

Array = NDArray[np.float64]


def pose_of(result: IndentationResult) -> ContactPose:
    """The pose of a result."""
    height = result.touch_height_mm - result.doi_mm
    return ContactPose(result.indentor, (result.x_mm,), height, max(result.doi_mm, 1e-3))


def residual_by_definition(finger: Fingertip, pose: ContactPose, state: ContactState) -> float:
    """Largest of mismatch of u, penetration, complementarity |min(λN / max λN, g / (N D))| and tension / peak.

    D = max(DOI, 1 µm), N = √(1 + h′²): g / N and λN are along the unit normal. Everything at the final u, over all
    patch nodes and the points between nodes that carry force.
    """
    patch, points = finger.model.patch, state.points
    n = len(patch)
    at = np.zeros((len(points), n))
    nodes, share = points.on(patch).carriers
    np.add.at(at, (np.arange(len(points)), nodes), share)
    h, slope, _ = pose.indentor.profile.evaluate(at @ (patch.x + state.displacement[0]) - pose.at_mm[0])
    gap = pose.height_mm + h - at @ (patch.y + state.displacement[1])
    norm, depth = np.sqrt(1 + slope**2), pose.scale_mm
    fx, fy = at.T @ (slope * state.multiplier), -at.T @ state.multiplier
    c, (ux, uy) = patch.compliance, state.displacement
    mismatch = max(
        np.abs(c[:n, :n] @ fx + c[:n, n:] @ fy - ux).max(), np.abs(c[n:, :n] @ fx + c[n:, n:] @ fy - uy).max()
    )
    normal = state.multiplier * norm
    peak = normal.max()
    complementarity = np.abs(np.minimum(normal / peak, gap / (norm * depth))).max()
    h, slope, _ = pose.indentor.profile.evaluate(patch.x + ux - pose.at_mm[0])
    everywhere = (pose.height_mm + h - patch.y - uy) / np.sqrt(1 + slope**2)
    penetration = np.maximum(0.0, -everywhere).max()
    tension = np.maximum(0.0, -normal).max()
    return float(max(mismatch / depth, penetration / depth, complementarity, tension / peak))


SCENES = [
    ("step:1", -1.63, 0.73),
    ("step:3", -1.0, 0.6),
    ("bar:3.0", 0.0, 1.33),
    ("bar:1.5", 0.3, 0.67),
    ("cylinder:3", -0.4, 1.0),
]


@pytest.mark.parametrize(("shape", "x", "doi"), SCENES)
def test_the_contact_residual_equals_its_definition(finger: Fingertip, shape: str, x: float, doi: float) -> None:
    # Both are the same sums in another order: 1e-13 is their round-off (u / D of order one, 2 000 terms).
    result = finger.indent(shape, x, doi_mm=doi)
    again = residual_by_definition(finger, pose_of(result), result.state)
    assert result.state.residual == pytest.approx(again, rel=1e-6, abs=1e-13)
    assert result.state.converged
    assert (result.state.multiplier >= 0).all()


def test_an_unfinished_contact_solve_reports_that_it_did_not_converge(
    finger: Fingertip, monkeypatch: pytest.MonkeyPatch
) -> None:
    # This scene takes some 30 passes: after one the residual is large and equals the definition, not a wish.
    monkeypatch.setattr(solver, "MAX_PASSES", 1)
    height = finger.touch_height_mm("bar:3.0", 0.0) - 1.33
    done = ContactPose(parse_shape("bar:3.0"), (0.0,), height, 1.33)
    state = solve_contact(finger.model.patch, done, between_nodes=False)
    assert state.passes == 1
    assert not state.converged
    assert state.residual > 1e-6
    assert state.residual == pytest.approx(residual_by_definition(finger, done, state), rel=1e-9)


@pytest.mark.parametrize("shape", ["cylinder:9", "bar:3.0"])
def test_skin_that_the_solver_left_out_counts_in_the_contact_residual(
    finger: Fingertip, monkeypatch: pytest.MonkeyPatch, shape: str
) -> None:
    # Cut off after one pass over the few nodes deeper than 0.35 mm: the nodes around them lie within the indentor.
    monkeypatch.setattr(solver, "_CANDIDATE_GAP_MM", -0.35)
    monkeypatch.setattr(solver, "MAX_PASSES", 1)
    pose = ContactPose(parse_shape(shape), (0.0,), finger.touch_height_mm(shape, 0.0) - 0.4, 0.4)
    state = solve_contact(finger.model.patch, pose, between_nodes=False)
    patch, u = finger.model.patch, state.displacement
    there = pose.gap(patch.tangential_mm + u[:-1], patch.y + u[-1])
    depth = -there.height_mm / np.sqrt(1 + (there.slope**2).sum(axis=0))
    outside = ~np.isin(np.arange(len(patch)), state.points.nodes)
    assert depth[outside].max() > 0.02
    assert depth[outside].max() == depth.max()
    assert state.residual == pytest.approx(depth.max() / 0.4, rel=1e-12)
    assert not state.converged


@pytest.mark.parametrize("factor", [0.99, 1.001, 1.0 + 1e-6])
def test_a_perturbed_contact_force_has_a_large_residual(finger: Fingertip, factor: float) -> None:
    # One force off by δ moves its node by δ times its own compliance: seen at once by the mismatch of u.
    result = finger.indent("step:1", -1.63, doi_mm=0.73)
    multiplier = result.state.multiplier.copy()
    multiplier[np.argmax(multiplier)] *= factor
    wrong = replace(result.state, multiplier=multiplier)
    assert residual_by_definition(finger, pose_of(result), wrong) > max(1e-3 * abs(factor - 1), 2e-10)


def test_contact_forces_balance_and_point_into_the_skin(finger: Fingertip) -> None:
    result = finger.indent("step:1", -1.63, doi_mm=0.73)
    state = result.state
    fx, fy = state.force
    assert (fy <= 0).all()
    assert state.normal_force == pytest.approx(-fy.sum(), rel=1e-15)
    places = state.points.on(finger.model.patch)
    slope = displaced_gap(pose_of(result), places, state.displacement).slope[0]
    across = places.to_nodes((slope * state.multiplier)[None])[0]
    np.testing.assert_allclose(fx, across, rtol=0, atol=1e-8 * np.abs(fy).max())  # frictionless: along (h′, −1)
    assert (fx[state.active] >= -1e-12 * np.abs(fy).max()).all()  # the flank faces +x: its skin is pushed to +x


def test_an_indentor_above_the_skin_has_no_contact(finger: Fingertip) -> None:
    height = finger.touch_height_mm("bar:3.0", 0.0)
    state = solve_contact(
        finger.model.patch, ContactPose(parse_shape("bar:3.0"), (0.0,), height + 0.01, 1e-3), between_nodes=True
    )
    assert state.normal_force == 0.0
    assert state.converged
    assert not state.displacement.any()


@pytest.fixture(scope="module")
def sampled_skin(skin: FingertipSurface) -> tuple[Array, Array]:
    """Highest skin over a fine grid of z, at x 2 µm apart."""
    x = np.arange(-3.6, 3.6, 0.002)
    z = np.arange(5.5, 8.5, 0.005)
    return x, np.max([skin.height(x, at) for at in z], axis=0)


@pytest.mark.parametrize("shape", ["bar:1.5", "cylinder:9", "step:1", "step:5"])
def test_first_touch_is_where_a_dense_sampling_of_the_skin_finds_it(
    skin: FingertipSurface, sampled_skin: tuple[Array, Array], shape: str
) -> None:
    # Sampling misses the true touch by h″ dx² / 8, 6e-6 mm on step 1 (h″ = 12/mm) and 1e-5 on a bar's edge
    # (h″ = 20 … 60/mm there), and the skin by 1e-6: brute force is lower by at most 3e-5 and never higher than 1e-6.
    x, top = sampled_skin
    indentor = parse_shape(shape)
    profile = indentor.profile
    for position in (-2.4, -1.63, -0.333, 0.0, 0.111, 1.0, 2.0):
        brute = float((top - profile.evaluate(x - position)[0]).max())
        height, (at,) = first_touch(indentor, (position,), skin)
        assert brute - 1e-6 <= height <= brute + 3e-5
        where = float(skin.ridge(at) - profile.evaluate(np.array([at - position]))[0][0])
        assert where == pytest.approx(height, abs=1e-12)


def test_depth_zero_is_first_touch_with_the_continuous_skin(finger: Fingertip) -> None:
    # A flat shape over the apex touches at the ridge's top, not at a node. 1.5e-5 mm: the apex is the highest of
    # samples 0.02 mm apart on a radius of 3.5 mm.
    assert finger.touch_height_mm("bar:3.0", 0.0) == pytest.approx(finger.apex_height_mm, abs=1.5e-5)
    assert finger.touch_height_mm("step:1", 3.0) == pytest.approx(finger.apex_height_mm, abs=1.5e-5)
    assert finger.touch_height_mm("step:1", -3.0) == pytest.approx(finger.apex_height_mm - 0.5, abs=1.5e-5)
    assert finger.touch_height_mm("bar:3.0", 2.0, "apex") == finger.apex_height_mm
    lower = finger.touch_height_mm("bar:3.0", 2.0)
    assert 0 < finger.apex_height_mm - lower < 0.3  # Raju (1998) measures from the topmost point: up to 0.3 mm apart


@pytest.mark.parametrize("lower_mm", [0.0, 0.05, 0.2, 0.5])
@pytest.mark.parametrize("profile", [Bar(0.8), SinusoidalStep("1")])
def test_contact_candidates_found_at_one_height_hold_for_lower_ones(
    profile: Bar | SinusoidalStep, lower_mm: float
) -> None:
    # Of a grid of nodes; beyond 0.3 mm what was not looked at may be touched: then it looks again.
    z, x = (v.ravel() for v in np.meshgrid(np.arange(4) * 0.3, np.arange(6) * 0.17, indexing="ij"))
    position = np.stack([x, -2.0 * (x - 0.4) ** 2, z], axis=1)
    patch = Patch(position, np.ones(24), (4, 6), (X, Y), compliance=np.eye(48))
    u = 0.01 * np.random.default_rng(2).normal(size=(2, len(patch)))
    pose = ContactPose(Indentor.along(profile), (0.4,), -0.02, 0.1)
    lower = replace(pose, height_mm=pose.height_mm - lower_mm)
    kept = Survey.of(pose, patch, u, between=True).near(lower, 0.03)
    anew = Survey.of(lower, patch, u, between=True).near(lower, 0.03)
    assert np.array_equal(kept.nodes, anew.nodes)
    assert np.array_equal(kept.between, anew.between)
    assert len(anew.between) or lower_mm < 0.5


class Spring:
    """F = k d^p, and a count of what it was asked."""

    def __init__(self, exponent: float, jump_at: float = np.inf) -> None:
        self.exponent, self.jump_at, self.asked = exponent, jump_at, 0

    def __call__(self, doi: float, _: ContactState | None) -> ContactState:
        self.asked += 1
        force = 3.0 * doi**self.exponent * (1.0 if doi < self.jump_at else 1.1)
        empty = np.zeros(0)
        return ContactState(ContactPoints.none(), empty, empty, np.array([[0.0], [-force]]), empty, 0.0, 1)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.2])
@pytest.mark.parametrize("depth", [0.001, 0.31, 1.999])
def test_force_control_finds_the_depth_of_a_power_law(exponent: float, depth: float) -> None:
    spring = Spring(exponent)
    doi, state = solve_for_force(3.0 * depth**exponent, 0.3, 2.0, spring)
    assert doi == pytest.approx(depth, rel=1e-10)  # 1e-11 in force
    assert state.normal_force == pytest.approx(3.0 * depth**exponent, rel=1.01e-11)
    assert spring.asked <= 20


def test_a_force_beyond_the_deepest_depth_is_refused() -> None:
    with raises(ForceNotReachedError, "force_not_reached", deepest_mm=2.0):
        solve_for_force(100.0, 0.3, 2.0, Spring(1.5))


class Rim:
    """A spring that refuses depths beyond its reach, where it is `fickle` only on the first few asks."""

    def __init__(self, reach: float, fickle: int | None = None) -> None:
        self.reach, self.left, self.spring = reach, fickle, Spring(1.5)

    def __call__(self, doi: float, start: ContactState | None) -> ContactState:
        if doi > self.reach and (self.left is None or self.left > 0):
            self.left = None if self.left is None else self.left - 1
            raise TooDeepError(f"rim beyond {self.reach:g}")
        return self.spring(doi, start)


@pytest.mark.parametrize("depth", [0.2, 0.69, 0.6999])
def test_force_control_finds_a_force_just_short_of_the_rim(depth: float) -> None:
    # The first secants look beyond 0.7 mm, are refused and come back.
    doi, _ = solve_for_force(3.0 * depth**1.5, 0.3, 2.0, Rim(0.7))
    assert doi == pytest.approx(depth, rel=1e-10)


@pytest.mark.parametrize("fickle", [None, 1, 2, 5])
def test_force_control_refuses_a_force_beyond_the_rim(fickle: int | None) -> None:
    # Whether a depth is refused may depend on the start: the search still ends in a refusal, not short of the force.
    with raises(TooDeepError, "too_deep", reach_mm=0.7):
        solve_for_force(3.0 * 1.2**1.5, 0.3, 2.0, Rim(0.7, fickle))


def test_force_control_ends_unconverged_at_a_jump_over_the_force() -> None:
    # The target lies inside the jump at 0.5 mm: the search must end, at the jump.
    spring = Spring(1.5, jump_at=0.5)
    doi, state = solve_for_force(3.0 * 0.5**1.5 * 1.05, 0.3, 2.0, spring)
    assert doi == pytest.approx(0.5, abs=1e-3)
    assert abs(state.normal_force / (3.0 * 0.5**1.5 * 1.05) - 1) < 0.06
    assert not state.converged
    assert spring.asked <= 40
