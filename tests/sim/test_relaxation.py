"""Tissue that relaxes: the series against its closed forms, contact against Lee & Radok (1960) and Ting (1966)."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from sim.config import FingertipConfig, MeshSpec
from sim.contact.patch import Patch
from sim.devices.clock import VirtualClock
from sim.errors import ArgumentError
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.pressing import RimError
from sim.models.relaxation import Memory, Prony, PronyTerm
from sim.models.viscoelastic import InTime
from sim.plant import SampledForce
from tests.error_codes import raises
from tests.sim import relaxing_contact
from tests.sim.coarse_mesh import coarse_mesh

TERMS = (PronyTerm(0.3, 0.5), PronyTerm(0.15, 4.0))
SERIES = Prony(TERMS)


def relaxed(t_s: float) -> float:
    """G(t), written out."""
    return 1 - sum(term.share * (1 - math.exp(-t_s / term.tau_s)) for term in TERMS)


class Stress:
    """f of a single number p, by steps of time."""

    def __init__(self) -> None:
        self.memory = Memory.none(SERIES)

    def after(self, step_s: float, p: float) -> float:
        ahead = self.memory.ahead(step_s)
        self.memory = self.memory.after(ahead, p)
        return float(ahead.stiffness * (p - ahead.carried))


# --- the series ---


@pytest.mark.parametrize("step_s", [0.001, 0.05, 0.7])
def test_a_sudden_strain_relaxes_as_the_prony_series(step_s: float) -> None:
    """Exact at any step: nothing moves after the first instant."""
    stress = Stress()
    assert stress.after(0.0, 2.0) == 2.0
    for n in range(1, 101):
        assert stress.after(step_s, 2.0) == pytest.approx(2.0 * relaxed(n * step_s), rel=1e-12)


@pytest.mark.parametrize("step_s", [0.001, 0.05, 0.7])
def test_relaxation_after_a_ramp_agrees_with_the_closed_form(step_s: float) -> None:
    """∫ G over a ramp of one step: Σ g τ / Δ (e^(Δ/τ) − 1) e^(−t/τ) for each term, by hand."""
    stress = Stress()
    for n in range(1, 101):
        t_s, force = n * step_s, stress.after(step_s, 2.0)
        kept = sum(
            g.share * g.tau_s / step_s * math.expm1(step_s / g.tau_s) * math.exp(-t_s / g.tau_s) for g in TERMS
        )
        assert force == pytest.approx(2.0 * (0.55 + kept), rel=1e-12)


def test_relaxation_does_not_depend_on_the_time_step_for_piecewise_linear_strain() -> None:
    """A ramp, a hold and a ramp back, by their corners and finely: exact, so no tolerance but that of rounding."""
    corners = [(0.4, 1.0), (2.0, 1.0), (0.3, 0.4), (1.0, 0.4)]

    def end(pieces: int) -> float:
        stress, before, force = Stress(), 0.0, 0.0
        for length_s, to in corners:
            for k in range(1, pieces + 1):
                force = stress.after(length_s / pieces, before + (to - before) * k / pieces)
            before = to
        return force

    assert end(1) == pytest.approx(end(50), rel=1e-12)


def test_a_sinusoid_has_the_storage_and_loss_of_the_series() -> None:
    """Ferry, Viscoelastic Properties of Polymers, 3rd ed. 1980, ch. 3: G' and G'' of a generalised Maxwell body."""
    omega, step_s = 2 * math.pi * 0.5, 0.005  # straight pieces lie within (ω Δ)² / 8 = 3e-5 of the sinusoid
    t = np.arange(1, 16_001) * step_s
    stress = Stress()
    force = np.array([stress.after(step_s, 1 + 0.5 * math.sin(omega * s)) for s in t])[8_000:]
    last = t[8_000:]  # 40 s on: the slow term (4 s) has settled to e^-10
    basis = np.stack([np.ones_like(last), np.sin(omega * last), np.cos(omega * last)], axis=1)
    _, storage, loss = np.linalg.lstsq(basis, force, rcond=None)[0] / 0.5
    products = [(g.share, omega * g.tau_s) for g in TERMS]
    assert storage == pytest.approx(0.55 + sum(g * p * p / (1 + p * p) for g, p in products), abs=1e-4)
    assert loss == pytest.approx(sum(g * p / (1 + p * p) for g, p in products), abs=1e-4)


def test_recovery_after_release_equals_that_in_many_small_steps() -> None:
    """f = 0: by steps in which p goes straight, of a hundredth of the shorter τ, 1e-5 remain; at once it is exact."""
    stress = Stress()
    stress.after(0.0, 1.0)
    stress.after(1.0, 1.0)
    at_once = stress.memory.released(0.6)
    in_two = stress.memory.released(0.2).released(0.4)
    assert at_once.borne == pytest.approx(in_two.borne, rel=1e-12)
    memory = stress.memory
    for step_s in (0.0, *[0.005] * 120):
        ahead = memory.ahead(step_s)
        memory = memory.after(ahead, ahead.carried)
    assert at_once.borne == pytest.approx(memory.borne, rel=1e-5)
    assert 0 < at_once.borne < 1 - relaxed(1.0), "a jump back by f, and from there on less"
    assert stress.memory.released(200.0).borne == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("terms", [[(1.0, 1.0)], [(0.6, 1.0), (0.4, 2.0)], [(-0.1, 1.0)], [(0.1, 0.0)], [(0.0, 1.0)]])
def test_impossible_relaxation_series_are_refused(terms: list[tuple[float, float]]) -> None:
    with raises(ArgumentError, "bad_series"):
        Prony([PronyTerm(*term) for term in terms])


@pytest.mark.parametrize("step_s", [-0.1, math.nan, math.inf])
def test_relaxation_refuses_an_impossible_time_step(step_s: float) -> None:
    with raises(ArgumentError, "bad_step"):
        Memory.none(SERIES).ahead(step_s)


# --- a sphere on a half-space: tests/sim/relaxing_contact.py has the sources ---

STEPS = 20


@pytest.fixture(scope="module")
def flat() -> Patch:
    """16 nodes across the deepest contact."""
    return relaxing_contact.flat_skin(25)


def test_contact_in_a_ramp_and_hold_agrees_with_lee_and_radok(flat: Patch) -> None:
    """By steps of a twentieth of τ 0.04 % of the elastic force is left (docs/validation/tissue.md)."""
    way = relaxing_contact.up_and_held(STEPS)
    forces = relaxing_contact.pressed_along(flat, way) / relaxing_contact.elastic(flat)
    expected = [relaxing_contact.growing(t_s) for t_s in np.cumsum([step_s for step_s, _ in way])]
    assert forces == pytest.approx(expected, abs=1e-3)
    assert expected[-1] < 0.7 * max(expected), "it relaxes"


def test_contact_while_unloading_agrees_with_ting(flat: Patch) -> None:
    """Less than the force alone would be, which goes on pulling back what contact has left."""
    way = relaxing_contact.up_and_down(STEPS)
    forces = relaxing_contact.pressed_along(flat, way)[STEPS:] / relaxing_contact.elastic(flat)
    times_s = np.cumsum([step_s for step_s, _ in way])[STEPS:]
    expected = [relaxing_contact.shrinking(t_s) for t_s in times_s]
    assert forces == pytest.approx(expected, abs=1e-3)
    assert sum(force > 0.01 for force in expected) > 5
    assert forces[-3:] == pytest.approx(0.0, abs=0), "the skin has not sprung back to where the indentor left it"


# --- a finger ---


@pytest.fixture(scope="module")
def finger() -> Fingertip:
    """The cheapest that has curved skin; what is asserted holds for any."""
    return load("halfspace", FingertipConfig(mesh=coarse_mesh(0.25, 0.4)))


@pytest.mark.parametrize("shape", ["cylinder:9", "bar:3.0", "step:5", "grating:1,2"])
def test_at_constant_depth_every_shape_relaxes_as_the_prony_series(finger: Fingertip, shape: str) -> None:
    """One series for all layers: the contact stays, and f = G p. To what contact is solved to."""
    press, elastic = InTime(finger, shape, SERIES), finger.indent(shape, doi_mm=0.4)
    at_once = press.to_depth(0.0, 0.4)
    assert at_once.force_n == pytest.approx(elastic.force_n, rel=1e-9)
    assert press.strain() == pytest.approx(elastic.receptor_strain, abs=1e-9)
    for t_s in (0.1, 0.5, 2.5):
        now = press.to_depth(t_s - press.now.t_s, 0.4)
        assert now.converged
        assert now.t_s == pytest.approx(t_s)
        assert now.force_n == pytest.approx(relaxed(t_s) * elastic.force_n, rel=1e-7)
        assert press.strain() == pytest.approx(elastic.receptor_strain, abs=1e-7), "the skin stays where it is"


def test_at_constant_force_the_contact_creeps_as_the_creep_compliance(finger: Fingertip) -> None:
    """A growing contact under a step of force is the elastic one under J F; steps of a twentieth of τ leave 1e-5."""
    press, force_gwt = InTime(finger, "cylinder:9", relaxing_contact.SERIES), 1.0
    press.to_force(0.0, force_gwt)
    for _ in range(40):
        now = press.to_force(relaxing_contact.TERM.tau_s / 20, force_gwt)
        assert now.force_gwt == pytest.approx(force_gwt, rel=1e-9)
    as_if_gwt = relaxing_contact.crept(now.t_s) * force_gwt
    assert now.doi_mm == pytest.approx(finger.indent("cylinder:9", force_gwt=as_if_gwt).doi_mm, rel=1e-4)


def test_a_repeated_press_meets_recovering_skin_deeper_and_recovered_skin_as_at_first(finger: Fingertip) -> None:
    def second(rest_s: float) -> list[float]:
        press = InTime(finger, "cylinder:9", relaxing_contact.SERIES)
        press.to_depth(0.0, 0.4)
        press.to_depth(2.0, 0.4)
        lifted = press.to_depth(rest_s, -0.1)
        assert (lifted.force_n, lifted.contact) == (0.0, None)
        return [press.to_depth(0.0, doi_mm).force_n for doi_mm in (0.1, 0.4)]

    at_first = [finger.indent("cylinder:9", doi_mm=doi_mm).force_n for doi_mm in (0.1, 0.4)]
    soon, late = second(0.1), second(60.0)
    assert soon[0] == 0.0
    assert 0.2 * at_first[1] < soon[1] < 0.8 * at_first[1]
    assert late == pytest.approx(at_first, rel=1e-6)


def test_a_relaxing_press_larger_than_its_patch_is_refused() -> None:
    """What the skin remembers lies on one patch; there is none larger meanwhile."""
    small = load("halfspace", FingertipConfig(mesh=MeshSpec(patch_x_mm=2.0, patch_z_mm=2.0)))
    press = InTime(small, "flat", SERIES)
    before = press.to_depth(1.0, 0.1)
    with raises(RimError, "at_rim", size="mesh.patch_x_mm / patch_z_mm"):
        press.to_depth(1.0, 1.5)
    assert press.now is before, "what is refused is not remembered"
    assert small.indent("flat", doi_mm=1.5).state.converged, "skin at rest has a larger patch"


# --- on a clock ---


def recorded(clock: VirtualClock, legs: list[tuple[float, float]]) -> SampledForce:
    def moved(t_s: float, step_s: float) -> float:
        legs.append((t_s, step_s))
        return 10 * t_s

    return SampledForce(clock, moved, 0.05)


def test_the_relaxation_of_the_virtual_finger_does_not_depend_on_when_it_is_read() -> None:
    def legs_after(looks_s: Sequence[float]) -> list[tuple[float, float]]:
        clock, legs = VirtualClock(), list[tuple[float, float]]()
        force = recorded(clock, legs)
        for look_s in looks_s:
            clock.wait_until(lambda: False, look_s)
            force.force_n(look_s)
        clock.wait_until(lambda: False, 6.0)
        assert force.force_n(6.0) == pytest.approx(60.0)
        return legs

    asked = legs_after([0.5, 1.0, 1.02, 3.3])
    assert asked == legs_after([])
    assert [t_s for t_s, _ in asked] == pytest.approx([0.05 * k for k in range(1, 121)])
    assert {step_s for _, step_s in asked} == {0.05}
