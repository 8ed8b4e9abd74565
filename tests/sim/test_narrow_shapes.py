"""Narrow shapes: their force rises with depth and is continuous in place, or they are refused.

`studies/accuracy/narrow_shapes.py` walks 30 shapes on the default mesh; these are as narrow on elements of 0.3 mm.
"""

import numpy as np
import pytest

from sim.config import MeshSpec
from sim.contact.indentor import Indentor
from sim.contact.shapes import parse_shape
from sim.errors import ModelRangeError
from sim.models.condensed import meshed_for
from sim.models.fingertip import Fingertip, FingertipConfig
from studies.accuracy.narrow_shapes import FALL, JUMP, dots, places, walk
from tests.error_codes import raises

ELEMENT_MM = 0.3

CARRIED: dict[str, Indentor] = {
    **{name: parse_shape(name) for name in ("flat:0.22", "flat:0.3", "sphere:0.25", "cone:60", "cone:75")},
    **{name: parse_shape(name) for name in ("wedge:45", "wedge:45,turn_deg=30", "bar:0.2,across")},
    "a dot": dots(0.35),
    "an array of pins": dots(0.35, 1.4, 2),
}


@pytest.mark.parametrize("shape", CARRIED.values(), ids=CARRIED)
def test_force_of_a_narrow_shape_rises_with_depth_and_is_continuous_in_place(
    coarse_finger: Fingertip, shape: Indentor
) -> None:
    found = walk(coarse_finger, shape, places(2, 2 * ELEMENT_MM), np.linspace(0.06, 0.45, 6))
    assert not found.refused
    assert found.residual <= 1e-10
    assert found.fall <= FALL
    assert found.jump <= JUMP
    assert (found.force > 0).all()


@pytest.mark.parametrize(
    ("shape", "radius_mm"),
    [
        ("flat:0.1", 0.1),
        ("flat:0.167", 0.167),
        ("cone:5", 0.05),
        ("cone:45", 0.12),
        (dots(0.1), 0.1),
        (dots(0.1, 0.5, 3), 0.1),
    ],
    ids=str,
)
def test_a_shape_narrower_than_the_mesh_carries_is_refused_with_the_least_radius(
    coarse_finger: Fingertip, shape: Indentor | str, radius_mm: float
) -> None:
    least_mm = pytest.approx(0.7 * ELEMENT_MM, abs=0.02)
    with raises(
        ModelRangeError, "narrower_than_mesh", radius_mm=pytest.approx(radius_mm, abs=0.03), least_mm=least_mm
    ):
        coarse_finger.indent(shape, 0.05, z_mm=6.95, doi_mm=0.1)


@pytest.mark.parametrize("level", ["coarse", "default", "fine"])
def test_elements_of_every_level_are_even_under_shapes_placed_by_x_and_z(level: str) -> None:
    config = FingertipConfig(mesh=MeshSpec.model_validate({"level": level}))
    mesh = meshed_for(config, (0, 2)).mesh
    assert mesh.axial_mm == pytest.approx(mesh.spacing_mm, rel=0.05)
    coarser = meshed_for(FingertipConfig(mesh=MeshSpec.model_validate({"level": "coarse"})), (0, 2)).mesh
    assert mesh.axial_mm <= coarser.axial_mm


def test_spacings_of_the_configuration_hold_under_shapes_placed_by_x_and_z() -> None:
    config = FingertipConfig(mesh=MeshSpec.model_validate({"level": "fine", "axial_spacing_mm": 0.4}))
    assert meshed_for(config, (0, 2)).mesh.axial_mm == 0.4
