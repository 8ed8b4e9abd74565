"""The contact solver on half-spaces against closed forms, at a given force; singular contacts by their order.

In plane strain boxes of 40 contact half-widths leave (1/40)² ~ 0.1 %, slopes of 1/50 as much. Of round contact a
quarter of a box is meshed: the pressure hardly knows the box; the depth lacks what lies beyond it, in proportion to
contact radius over size, and is extrapolated from two boxes.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from sim.contact.patch import Patch
from sim.contact.solver import ContactState
from studies.verification.contact import ContactSolution, contact_errors, press_to_force
from studies.verification.line_contact import (
    cylinder,
    punch_edge_pressure,
    punch_errors,
    punched,
    wave,
    wave_cell,
    wedge,
)
from studies.verification.line_contact import half_space as meshed_half_space
from studies.verification.round_contact import cone, doi_error, extrapolated, flat, quarter_space, sphere

PER_HALF_WIDTH = 16
half_space = cache(meshed_half_space)  # several tests press the same boxes


class Problem(NamedTuple):
    """Contact with a closed form; half-width and spread of the pressure agree to 1 %."""

    patch: Callable[[], Patch]
    exact: ContactSolution
    inside: float  # largest error of the pressure inside, of the mean
    reason: str


def of_line() -> Patch:
    return half_space(PER_HALF_WIDTH, 40)


def of_wave() -> Patch:
    return wave_cell(PER_HALF_WIDTH)


def of_round() -> Patch:
    """Ten elements across the contact radius; 1.4 is a coarser grading than the finger's."""
    return quarter_space(10, 10, growth=1.4)


PROBLEMS = {
    "Hertz, cylinder": Problem(of_line, cylinder(), 0.01, "measured 0.26, 0.13 and 0.14 %"),
    "wedge": Problem(of_line, wedge(), 0.015, "second order is lost at the logarithm of the tip: 0.0, 0.10, 1.0 %"),
    "Westergaard, half closed": Problem(of_wave, wave(1.0), 0.01, "a cell without truncation"),
    "Westergaard, 85 % closed": Problem(of_wave, wave(1.5), 0.01, "a cell without truncation"),
    "Hertz, sphere": Problem(of_round, sphere(), 0.01, "measured 0.38, 0.14 and 0.70 %; 0.15, 0.04, 0.44 at 16"),
    "Sneddon, cone": Problem(of_round, cone(), 0.02, "−0.19, 0.21 and 1.2 %, worst beside the logarithm at the tip"),
    **{
        f"Hertz, cylinder, ν = {poisson}": Problem(
            lambda poisson=poisson: half_space(16, 40, poisson), cylinder(poisson), 0.01, "B-bar hardly knows ν"
        )
        for poisson in (0.49, 0.499, 0.4999)
    },
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_contact_agrees_with_its_closed_form_within_one_percent(name: str) -> None:
    problem = PROBLEMS[name]
    errors = contact_errors(problem.patch(), problem.exact)
    assert errors.converged
    assert abs(errors.half_width) < 0.01
    assert abs(errors.spread) < 0.01
    assert errors.inside < problem.inside, problem.reason


def test_hertz_contact_locks_with_full_integration() -> None:
    # ν = 0.4999: contact 26 % too narrow on the mesh on which B-bar errs by 0.1 %.
    assert contact_errors(half_space(16, 40, 0.4999, "full"), cylinder(0.4999)).spread < -0.2


def test_hertz_line_contact_force_agrees_with_its_width() -> None:
    # F = π E* a² / 4R with a from the spread of the pressure, a = 2 √⟨x²⟩ under a semi-ellipse: twice its error.
    exact, patch = cylinder(), of_line()
    _, state = press_to_force(patch, exact.profile, exact.meshed_force)
    half_width = 2 * np.sqrt((-state.force[-1] @ patch.x**2) / state.normal_force)
    assert exact.force * half_width**2 == pytest.approx(2 * state.normal_force, rel=0.01)


def test_the_spread_of_wave_contact_pressure_converges_at_second_order() -> None:
    # The wave's cell has no truncation: 2.7, 0.68 and 0.16 % at 4, 8, 16 elements a half-width.
    errors = [contact_errors(wave_cell(n), wave(1.0)).spread for n in (4, 8, 16)]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.2)


def test_the_truncation_error_of_line_contact_is_of_second_order() -> None:
    # Of a contact pressed to a force: a far boundary adds strain in proportion to F / H² and its gradient. The
    # spread at H = 10, 20, 40 a changes by 0.34 and 0.09 %; extrapolated, it is that of an infinite box.
    spread = [contact_errors(half_space(PER_HALF_WIDTH, size), cylinder()).spread for size in (10, 20, 40, 80)]
    change = np.diff(spread)
    np.testing.assert_allclose(change[:-1] / change[1:], 4.0, atol=0.5)
    assert spread[1] + (spread[1] - spread[0]) / 3 == pytest.approx(spread[3], abs=2e-4)


@pytest.fixture(scope="module")
def punches() -> list[tuple[Patch, ContactState]]:
    """The flat punch on four meshes, 8 to 64 elements a half-width; a node lies on its edge."""
    patches = [half_space(n, 20) for n in (8, 16, 32, 64)]
    return [(patch, punched(patch)) for patch in patches]


class TestFlatPunch:
    """Singular at its edges: judged by order of convergence."""

    def test_every_flat_punch_contact_converges(self, punches: list[tuple[Patch, ContactState]]) -> None:
        assert [state.converged for _, state in punches] == [True] * 4

    def test_flat_punch_force_converges_at_first_order(self, punches: list[tuple[Patch, ContactState]]) -> None:
        # The energy missed around a singularity r^(−1/2) is proportional to h.
        force = [state.normal_force for _, state in punches]
        change = np.diff(force)
        np.testing.assert_allclose(np.log2(change[:-1] / change[1:]), 1.0, atol=0.1)
        assert abs(change[0] / force[0]) < 0.005

    def test_flat_punch_edge_pressure_grows_with_the_root_of_refinement(
        self, punches: list[tuple[Patch, ContactState]]
    ) -> None:
        # p ~ (2 a d)^(−1/2) F/π at a distance d = h: the exponent is ½ for any ν without friction.
        pressure = np.array([punch_edge_pressure(*punch) for punch in punches])
        np.testing.assert_allclose(np.log2(pressure[1:] / pressure[:-1]), 0.5, atol=0.02)

    def test_flat_punch_pressure_inside_converges(self, punches: list[tuple[Patch, ContactState]]) -> None:
        # Measured 5.8, 2.1, 1.1 % of the mean up to 0.8 a: first order, as the force.
        inside = [punch_errors(*punch).inside for punch in punches[:3]]
        assert inside[2] < 0.015
        assert inside[0] > 1.8 * inside[1] > 3 * inside[2]


# --- depth of round contact ---

Boxes = tuple[Patch, Patch]


@pytest.fixture(scope="module")
def eight() -> Boxes:
    return quarter_space(8, 10), quarter_space(8, 20)


@pytest.fixture(scope="module")
def four() -> Boxes:
    return quarter_space(4, 10), quarter_space(4, 20)


def test_the_depth_error_is_of_first_order_in_the_box_size(eight: Boxes) -> None:
    # Boxes of 10 and 20 radii: sphere −8.6 and −4.4 %, cone −6.5 and −3.3 %; extrapolated −0.14 and −0.16 %.
    for shape in (sphere(), cone()):
        small, large = (doi_error(patch, shape) for patch in eight)
        assert small / large == pytest.approx(2.0, abs=0.1)
        assert abs(extrapolated(small, large)) < 0.01


def test_the_depth_of_a_round_flat_punch_converges_at_first_order(four: Boxes, eight: Boxes) -> None:
    # Its edge is a staircase of nodes, its pressure singular there: depth at a given force 11.2, 5.4 % (2.4 % at 16).
    coarse, fine = (extrapolated(*(doi_error(patch, flat()) for patch in boxes)) for boxes in (four, eight))
    assert 0 < fine < 0.06
    assert coarse / fine == pytest.approx(2.0, abs=0.3)
