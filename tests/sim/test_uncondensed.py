"""Contact forces put back into the stiffness of all nodes: the condensed answer is the whole one."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.finger.mesh import FingerMesh, build_mesh
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import strain_operator
from sim.models.condensed import discretise
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult
from tests.sim.coarse_mesh import coarse_mesh
from tests.sim.whole_solve import everywhere

Array = NDArray[np.float64]

SCENES = (("step:1", -1.63, 0.73), ("bar:3.0", 0.0, 1.33), ("cylinder:9", -0.4, 1.0))


@dataclass(frozen=True)
class Whole:
    """Condensed answers, and every node's displacement under their forces."""

    mesh: FingerMesh
    results: list[IndentationResult]
    displacement: Array  # (n_scenes, n_nodes, 3)
    imbalance: Array  # (n_scenes,) ‖Ku − f‖ / ‖f‖


@pytest.fixture(scope="module", params=["coarse", "default"])
def whole(request: pytest.FixtureRequest, skin: FingertipSurface) -> Whole:
    """Nothing is condensed: one unknown only is kept, and K·u is formed by the whole symmetric matrix."""
    config = FingertipConfig() if request.param == "default" else FingertipConfig(mesh=coarse_mesh(0.4, 0.6))
    finger, mesh = Fingertip.load(config), build_mesh(config, skin)
    results = [finger.indent(shape, x, doi_mm=doi) for shape, x, doi in SCENES]
    return Whole(mesh, results, *everywhere(discretise(config, mesh), results))


def test_the_uncondensed_solution_is_in_equilibrium(whole: Whole) -> None:
    # Whatever found u, K·u = f says that it is right: 1e-9 is far above round-off (condition ~ 1e6 times 1e-16).
    assert (whole.imbalance <= 1e-9).all(), whole.imbalance


def test_condensed_and_uncondensed_patch_displacements_agree(whole: Whole) -> None:
    # The Schur complement's inverse equals the direct solution to about 1e-13 of the largest displacement.
    for result, u in zip(whole.results, whole.displacement, strict=True):
        there = u[whole.mesh.patch_nodes, :2].T
        here = result.state.displacement
        np.testing.assert_allclose(here, there, rtol=0, atol=1e-10 * np.abs(there).max())


def test_the_contact_conditions_hold_on_the_uncondensed_solution(whole: Whole) -> None:
    # Non-penetration of every skin node of the pulp, not only of the patch, and touching where there is force: to
    # 1e-8 of the depth along the normal, as required of a solve.
    mesh = whole.mesh
    skin = np.arange(len(mesh.nodes)).reshape(mesh.grid)[:, :, 0].ravel()
    skin = skin[mesh.nodes[skin, 1] > 0]
    for result, u in zip(whole.results, whole.displacement, strict=True):
        x, y, _ = (mesh.nodes + u).T
        h, slope, _ = result.indentor.profile.evaluate(x - result.x_mm)
        gap = (result.touch_height_mm - result.doi_mm + h - y) / np.hypot(1, slope)
        assert gap[skin].min() >= -1e-8 * result.doi_mm
        touching = mesh.patch_nodes[result.state.held.nodes]
        assert np.abs(gap[touching]).max() <= 1e-8 * result.doi_mm


def test_condensed_and_uncondensed_receptor_strain_agree(whole: Whole) -> None:
    # The adjoint right-hand sides of the condensed model against the operator on all displacements.
    operator, _ = strain_operator(whole.mesh, whole.results[0].model.receptors.position_mm)
    for result, u in zip(whole.results, whole.displacement, strict=True):
        strain = (operator @ u.ravel()).reshape(-1, 6)
        np.testing.assert_allclose(result.receptor_strain, strain, rtol=0, atol=1e-10 * np.abs(strain).max())
