"""An indentor placed over a model's patch: what it may not touch, and how it is pressed."""

from dataclasses import replace

import pytest

from sim.contact.first_contact import first_touch
from sim.contact.shapes import parse_shape
from sim.contact.solver import ContactState
from sim.models.fingertip import Fingertip
from sim.models.pressing import PlacedIndentor, Pressing, RimError
from tests.error_codes import raises

SHALLOW_MM, DEEP_MM = 0.2, 3.0


@pytest.fixture(scope="module")
def placed(finger: Fingertip) -> PlacedIndentor:
    indentor = parse_shape("cylinder:9")
    touch = first_touch(indentor, (0.0,), finger.surface)
    return PlacedIndentor(indentor, (0.0,), touch.height_mm, touch, finger.model)


@pytest.fixture(scope="module")
def shallow(placed: PlacedIndentor) -> ContactState:
    return Pressing(placed, between_nodes=False, target=1e-10).solve(SHALLOW_MM, None)


def test_contact_well_within_the_patch_is_accepted(placed: PlacedIndentor, shallow: ContactState) -> None:
    placed.refuse_rim(placed.pose(SHALLOW_MM), shallow)
    assert shallow.converged


def test_contact_with_skin_beside_the_patch_is_refused(placed: PlacedIndentor, shallow: ContactState) -> None:
    # No node of the rim bears; a pose that much deeper reaches the skin around the patch, unless that gives way.
    pose = placed.pose(DEEP_MM)
    with raises(RimError, "at_rim"):
        placed.refuse_rim(pose, shallow)
    gone = shallow.displacement.copy()
    gone[-1] -= DEEP_MM
    placed.refuse_rim(pose, replace(shallow, displacement=gone))


def test_a_force_on_a_node_of_the_rim_is_refused(placed: PlacedIndentor, shallow: ContactState) -> None:
    force = shallow.force.copy()
    force[-1, placed.model.patch.rim.argmax()] = -1e-6
    with raises(RimError, "at_rim"):
        placed.refuse_rim(placed.pose(SHALLOW_MM), replace(shallow, force=force))
