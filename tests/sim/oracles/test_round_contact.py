"""Our contact solver on half-spaces in three dimensions: Hertz's sphere, Sneddon's cone and flat punch.

A quarter of a box is meshed. At a given force the pressure hardly knows the box; the depth lacks what lies beyond it,
in proportion to contact radius over size, and is extrapolated from two boxes.
"""

import pytest

from sim.contact.patch import Patch
from studies.verification.contact import contact_errors
from studies.verification.round_contact import cone, doi_error, extrapolated, flat, quarter_space, sphere

Boxes = tuple[Patch, Patch]


@pytest.fixture(scope="module")
def ten() -> Patch:
    """Ten elements across the contact radius; 1.4 is a coarser grading than the finger's."""
    return quarter_space(10, 10, growth=1.4)


@pytest.fixture(scope="module")
def eight() -> Boxes:
    return quarter_space(8, 10), quarter_space(8, 20)


@pytest.fixture(scope="module")
def four() -> Boxes:
    return quarter_space(4, 10), quarter_space(4, 20)


def test_hertz_sphere_contact_agrees_within_one_percent(ten: Patch) -> None:
    # Measured contact radius 0.38 %, spread 0.14 %, pressure inside 0.70 % of the mean;
    # at 16 elements 0.15, −0.04 and 0.44 %.
    errors = contact_errors(ten, sphere())
    assert errors.converged
    assert abs(errors.half_width) < 0.01
    assert abs(errors.spread) < 0.01
    assert errors.inside < 0.01


def test_sneddon_cone_contact_agrees_within_one_percent(ten: Patch) -> None:
    # Measured contact radius −0.19 %, spread 0.21 %; the pressure, 1.2 %, is worst next to the logarithm at the tip.
    errors = contact_errors(ten, cone())
    assert errors.converged
    assert abs(errors.half_width) < 0.01
    assert abs(errors.spread) < 0.01
    assert errors.inside < 0.02


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
