"""Quasi-linear relaxation at finite strain: a block against closed forms, forces as derivatives, a held step."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad

from sim.config import Contact, FingertipConfig, MeshSpec
from sim.fem.elements import lame
from sim.models.relaxation import Prony, PronyTerm
from studies.finite_strain.solver.bricks import Bricks, Dilatation, Moduli, bricks
from studies.finite_strain.solver.laws import Law, Yeoh
from studies.finite_strain.solver.ogden import Ogden
from studies.finite_strain.solver.press import presses
from studies.finite_strain.solver.relaxing import PressInTime, RelaxingBricks, elastic_stress
from studies.finite_strain.solver.scene import Specimen

SERIES = Prony([PronyTerm(0.2, 0.07), PronyTerm(0.2, 1.4)])
LAW, POISSON, RAMP_S, STRETCH = Yeoh(0.3), 0.48, 0.5, 0.7
CUBE = np.array([(x, y, z) for z in (0.0, 1.0) for x, y in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))])


def block() -> Bricks:
    """One cube of side 1 mm."""
    moduli = Moduli(*lame(np.ones(1), POISSON))
    return bricks(CUBE, np.arange(8)[None], moduli, LAW)


def at(stretch: float, aside: float) -> np.ndarray:
    return np.asarray(CUBE * (np.array([aside, stretch, aside]) - 1))


def face_forces(tissue: RelaxingBricks, u: np.ndarray) -> np.ndarray:
    """(3,) on the faces at 1 mm: first Piola-Kirchhoff stress, the area being 1 mm²."""
    force = tissue.tangent(u)[0].reshape(8, 3)
    return np.array([force[CUBE[:, i] == 1, i].sum() for i in range(3)])


def history(t_s: float, at_once: Callable[[float], float]) -> float:
    """∫ G(t − s) df(s) of a stress that hangs on a ramp in RAMP_S and a hold, by parts."""

    def faded(s: float) -> float:
        rate = 0.2 / 0.07 * math.exp(-(t_s - s) / 0.07) + 0.2 / 1.4 * math.exp(-(t_s - s) / 1.4)
        return rate * at_once(s)

    ramp, hold = (quad(faded, *ends, epsabs=1e-10)[0] for ends in ((0.0, min(t_s, RAMP_S)), (min(t_s, RAMP_S), t_s)))
    return at_once(t_s) - float(ramp) - float(hold)


def test_a_block_that_cannot_be_compressed_ramped_along_one_axis_and_held() -> None:
    """Free sides take the pressure off: σ = λ² ∫ G dΠ_along − λ⁻¹ ∫ G dΠ_across. Of second order in the steps."""
    tissue, n, mu = RelaxingBricks(block(), SERIES), 100, float(lame(np.ones(1), POISSON)[0][0])

    def stretch(t_s: float) -> float:
        return 1 + (STRETCH - 1) * min(t_s / RAMP_S, 1.0)

    def pi(k: float, axis: int) -> float:
        """μ (1 + 2 a (I₁ − 3)) (1 − I₁ / (3 λ²)) at principal stretches k, k^−½, k^−½."""
        i1 = k**2 + 2 / k
        return mu * (1 + 2 * LAW.a * (i1 - 3)) * (1 - i1 / (3 * (k**2, 1 / k)[axis]))

    for step in range(1, 2 * n + 1):
        t_s = step * RAMP_S / n
        k = stretch(t_s)
        u = at(k, k**-0.5)
        tissue.begin(RAMP_S / n)
        if step in (n // 2, n, 2 * n):
            across, along, _ = face_forces(tissue, u)
            h_along, h_across = (history(t_s, lambda s, axis=axis: pi(stretch(s), axis)) for axis in (0, 1))
            assert k * along - k**-0.5 * across == pytest.approx(k**2 * h_along - h_across / k, rel=1e-4)
        tissue.end(u)
    assert k == STRETCH


def test_a_swollen_block_is_its_closed_form_at_any_step() -> None:
    """p = κ (J − 1), and J goes evenly: exact. ∫ G of a ramp and a hold, by hand."""
    tissue, kappa, most, t_s = RelaxingBricks(block(), SERIES), float(lame(np.ones(1), POISSON)[1][0]), 0.2, 0.0

    def whole(t_s: float) -> float:
        return 0.6 * t_s + sum(0.2 * tau_s * (1 - math.exp(-t_s / tau_s)) for tau_s in (0.07, 1.4))

    for step_s in (0.1, 0.15, 0.25, 0.05, 1.0):
        t_s += step_s
        side = np.cbrt(1 + most * min(t_s / RAMP_S, 1.0))
        tissue.begin(step_s)
        pressure = kappa * most * (whole(t_s) - whole(max(t_s - RAMP_S, 0.0))) / RAMP_S
        np.testing.assert_allclose(face_forces(tissue, at(side, side)), side**2 * pressure, rtol=1e-12)
        tissue.end(at(side, side))


def test_held_it_relaxes_as_g_whatever_the_steps() -> None:
    tissue, u = RelaxingBricks(block(), SERIES), at(STRETCH, 1.1)
    at_once = face_forces(tissue, u)
    tissue.end(u)
    t_s = 0.0
    for step_s in (0.01, 0.3, 2.0):
        t_s += step_s
        tissue.begin(step_s)
        np.testing.assert_allclose(face_forces(tissue, u), float(SERIES.relaxed(t_s)) * at_once, rtol=1e-12)
        tissue.end(u)


def skewed(dilatation: Dilatation, law: Law = LAW) -> Bricks:
    """One brick, no cube."""
    nodes = CUBE + 0.1 * np.random.default_rng(3).normal(size=(8, 3))
    return bricks(nodes, np.arange(8)[None], Moduli(*lame(np.ones(1), POISSON)), law, dilatation)


@pytest.mark.parametrize("dilatation", ["bbar", "full"])
def test_forces_and_stiffness_are_derivatives_of_its_energy(dilatation: Dilatation) -> None:
    rng = np.random.default_rng(5)
    tissue = RelaxingBricks(skewed(dilatation), SERIES)
    tissue.end(0.1 * rng.normal(size=(8, 3)))
    tissue.begin(0.2)
    u, aside, h = 0.1 * rng.normal(size=(8, 3)), np.zeros((8, 3)), 1e-6
    aside[3, 1] = h
    force, matrix = tissue.tangent(u)
    assert (tissue.energy(u + aside) - tissue.energy(u - aside)) / (2 * h) == pytest.approx(force[0, 10], abs=1e-7)
    column = (tissue.tangent(u + aside)[0][0] - tissue.tangent(u - aside)[0][0]) / (2 * h)
    np.testing.assert_allclose(column, matrix[0, :, 10], atol=1e-7 * np.abs(matrix).max())


@pytest.mark.parametrize("law", [LAW, Ogden.of(6.0)])
@pytest.mark.parametrize("dilatation", ["bbar", "full"])
def test_the_stress_of_the_points_is_the_elements_force(dilatation: Dilatation, law: Law) -> None:
    """∫ F S ∂N/∂X, S = J^{−2/3} DEV[Π] + J p C⁻¹: what the history is made of is what the bricks bear."""
    one, rng = skewed(dilatation, law), np.random.default_rng(4)
    u = 0.1 * rng.normal(size=(8, 3))
    f = np.einsum("ni,gnj->gij", u, one.gradient[0]) + np.eye(3)
    c, j = f.swapaxes(1, 2) @ f, np.linalg.det(f)
    stress, pressure = (values[0] for values in elastic_stress(one, u))
    inverse = np.linalg.inv(c)
    deviator = stress - np.einsum("gij,gij->g", stress, c)[:, None, None] / 3 * inverse
    second = (j ** (-2 / 3))[:, None, None] * deviator + (j * pressure)[:, None, None] * inverse
    expected = np.einsum("g,gij,gjk,gnk->ni", one.weight[0], f, second, one.gradient[0])
    np.testing.assert_allclose(one.tangent(u)[0].reshape(8, 3), expected, atol=1e-13)


# --- pressed ---

COARSE = FingertipConfig(
    contact=Contact(between_nodes=False), mesh=MeshSpec(spacing_mm=0.4, epidermis_elements=1, dermis_spacing_mm=0.4)
)


def test_a_section_is_pressed_held_let_back_and_held_by_its_force() -> None:
    """Held for long the elastic contact bears what lasts; just after a way back it bears less, then as much again."""
    specimen = Specimen(COARSE, "section")
    body, touch = specimen.body(LAW), specimen.touch("cylinder:9")
    shallow, deep = presses(body, specimen.skin, touch, [0.12, 0.15], 0.15)
    press = PressInTime(body, SERIES, specimen.skin, touch)
    assert press.to_depth(0.0, 0.15).force == pytest.approx(deep.force, rel=1e-5)
    assert press.to_depth(60.0, 0.15).force == pytest.approx(SERIES.lasting * deep.force, rel=1e-5)
    back = press.to_depth(0.1, 0.12)
    assert 0.2 * shallow.force < back.force < 0.95 * SERIES.lasting * shallow.force
    lifted = press.to_force(1.0, back.force)
    assert lifted.force == pytest.approx(back.force, rel=1e-5)
    assert lifted.doi_mm < 0.118, "what comes back pushes up"
    press.to_depth(0.0, 0.12)
    assert press.to_depth(60.0, 0.12).force == pytest.approx(SERIES.lasting * shallow.force, rel=1e-5)
