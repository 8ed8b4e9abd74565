"""The finger of elements with 27 nodes: its mesh, its condensation, and what is not to be had with it."""

import numpy as np
import pytest

from sim.config import FingertipConfig, MeshSpec
from sim.fem.elements import symmetric
from sim.finger.mesh import FingerMesh, MeshError, build_mesh, section_mesh
from sim.finger.surface import FingertipSurface
from sim.models.catalogue import load
from sim.models.condensed import discretise, factorise
from sim.models.full_mesh import MeshedFinger
from tests.error_codes import raises
from tests.sim.whole_solve import superlu

COARSE = {
    "spacing_mm": 0.6,
    "axial_spacing_mm": 0.8,
    "patch_x_mm": 1.8,
    "patch_z_mm": 1.6,
    "epidermis_elements": 1,
    "dermis_spacing_mm": 0.4,
    "growth": 1.5,
    "far_growth": 2.0,
    "near_spacing_mm": 1.5,
    "near_width_mm": 0.5,
    "far_spacing_mm": 2.0,
}
CONFIG = FingertipConfig(mesh=MeshSpec.model_validate({**COARSE, "element": "quadratic"}))
HALVED = {"spacing_mm": 0.3, "axial_spacing_mm": 0.4, "epidermis_elements": 2, "dermis_spacing_mm": 0.2}
HALF = FingertipConfig(mesh=MeshSpec.model_validate({**COARSE, **HALVED}))


@pytest.fixture(scope="module")
def mesh(skin: FingertipSurface) -> FingerMesh:
    return build_mesh(CONFIG, skin)


def test_a_quadratic_mesh_has_the_nodes_of_elements_of_half_the_size(
    mesh: FingerMesh, skin: FingertipSurface
) -> None:
    # Corners where the same settings put nodes of eight-node elements, and one node half way in each direction.
    eight = build_mesh(FingertipConfig(mesh=MeshSpec.model_validate(COARSE)), skin)
    assert mesh.order == 2
    assert mesh.hexes.shape == (len(eight.hexes), 27)
    assert mesh.grid == (2 * eight.grid[0] - 1, 2 * eight.grid[1], 2 * eight.grid[2] - 1)
    corners = mesh.nodes.reshape(*mesh.grid, 3)[::2, ::2, ::2]
    np.testing.assert_allclose(corners.reshape(-1, 3), eight.nodes, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(mesh.layer, eight.layer)
    np.testing.assert_array_equal(np.unique(mesh.hexes), np.arange(len(mesh.nodes)))


def test_a_quadratic_finger_is_condensed_exactly(skin: FingertipSurface) -> None:
    # What parts two halves is as thick as an element, not one row of nodes. Against SuperLU; 1e-9 as for eight nodes.
    coarser = {"spacing_mm": 1.0, "axial_spacing_mm": 1.0, "patch_x_mm": 1.0, "patch_z_mm": 1.0, "growth": 2.0}
    coarser |= {"dermis_spacing_mm": 1.0, "dermis_fine_depth_mm": 0.5, "near_spacing_mm": 2.0}
    coarser |= {"far_spacing_mm": 3.0, "far_growth": 3.0}
    config = FingertipConfig(mesh=MeshSpec.model_validate({**COARSE, **coarser, "element": "quadratic"}))
    problem = discretise(config, build_mesh(config, skin))
    unit = np.zeros((problem.upper.shape[0], len(problem.kept)))
    unit[problem.kept, np.arange(len(problem.kept))] = 1.0
    direct = superlu(symmetric(problem.upper)).solve(unit)[problem.kept]
    factor = factorise(problem)
    assert len(factor._fronts) >= 7  # halves of halves
    np.testing.assert_allclose(factor.compliance, direct, rtol=0, atol=1e-9 * np.abs(direct).max())


def test_a_quadratic_finger_presses_like_linear_elements_of_half_the_size() -> None:
    # The same nodes with B-bar; 0.3 mm is coarse for both. Measured 0.6 % of force, 5 % of ep1.
    results = [load("finger", config, cached=False).indent("cylinder:9", doi_mm=0.3) for config in (CONFIG, HALF)]
    assert all(result.state.converged for result in results)
    quadratic, bbar = results
    assert quadratic.force_n == pytest.approx(bbar.force_n, rel=0.03)
    ep1 = [result.receptor_measures["ep1"] for result in results]
    np.testing.assert_allclose(ep1[0], ep1[1], rtol=0, atol=0.1 * np.abs(ep1[1]).max())


def test_a_quadratic_section_presses_like_linear_elements_of_half_the_size(skin: FingertipSurface) -> None:
    mesh = section_mesh(CONFIG, skin)
    assert mesh.grid[0] == 7
    assert mesh.patch_area_mm2.sum() == pytest.approx(3.6, rel=0.25)  # 3.6 mm of a curved line, 1 mm thick
    # Pressed like the section of elements of half the size: measured 0.12 % of force, 2 % of ep1.
    quadratic, bbar = (load("section", config).indent("cylinder:9", doi_mm=0.3) for config in (CONFIG, HALF))
    assert quadratic.state.converged
    assert quadratic.force_n == pytest.approx(bbar.force_n, rel=0.005)
    ep1 = [result.receptor_measures["ep1"] for result in (quadratic, bbar)]
    np.testing.assert_allclose(ep1[0], ep1[1], rtol=0, atol=0.05 * np.abs(ep1[1]).max())


def test_a_calculix_deck_of_a_quadratic_finger_is_refused(mesh: FingerMesh) -> None:
    with raises(MeshError, "quadratic"):
        MeshedFinger(CONFIG, mesh, 0.2)
