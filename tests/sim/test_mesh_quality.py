"""Scaled Jacobian and aspect ratio of single hexahedra whose values are known by hand, and of the finger."""

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.finger.mesh import POOR_SCALED_JACOBIAN, FingerMesh, mesh_quality
from sim.finger.vtk import write_vtk

Array = NDArray[np.float64]

CUBE = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float
)  # VTK order
ONE = np.arange(8)[None]


def quality(nodes: Array) -> tuple[float, float]:
    found = mesh_quality(nodes, ONE)
    return float(found.scaled_jacobian[0]), float(found.aspect_ratio[0])


def test_a_cube_and_a_box() -> None:
    assert quality(CUBE) == (1.0, 1.0)
    assert quality(CUBE * [2.0, 3.0, 0.5]) == pytest.approx((1.0, 6.0), rel=1e-15)


def test_a_sheared_cube() -> None:
    # Sheared by 60° in one plane: det = 1, one edge 1 / cos 60° = 2 long: cos 60° = 1/2 at every corner.
    sheared = CUBE + np.tan(np.pi / 3) * CUBE[:, [2]] * [1, 0, 0]
    assert quality(sheared) == pytest.approx((0.5, 2.0), rel=1e-14)


def test_flat_and_folded_corners() -> None:
    flat, folded = CUBE.copy(), CUBE.copy()
    flat[6] = 0.67  # its three neighbours' plane passes through (2/3, 2/3, 2/3)
    folded[6] = [0.2, 0.2, 0.2]
    assert 0 <= quality(flat)[0] < POOR_SCALED_JACOBIAN
    assert quality(folded)[0] < 0
    assert quality(CUBE * [1, 1, -1])[0] == -1.0  # inside out


def test_the_default_mesh_has_no_poor_element(default_mesh: FingerMesh) -> None:
    # Measured: smallest 0.65, at the tip; largest aspect ratio 45, there too. In the elements of the patch, where
    # contact is solved, 2.1: 0.17 mm by 0.2 mm, and thicker where the skin slopes.
    found = mesh_quality(default_mesh.nodes, default_mesh.hexes)
    assert found.scaled_jacobian.min() > 0.5
    assert found.aspect_ratio.max() < 60
    patch = np.isin(default_mesh.hexes, default_mesh.patch_nodes).any(axis=1)
    assert found.aspect_ratio[patch].max() < 4


def test_the_vtk_file_holds_the_mesh(default_mesh: FingerMesh, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("vtk") / "finger.vtk"
    write_vtk(path, default_mesh, mesh_quality(default_mesh.nodes, default_mesh.hexes))
    lines = path.read_text(encoding="ascii").splitlines()
    n_nodes, n = len(default_mesh.nodes), len(default_mesh.hexes)
    assert lines[:5] == [
        "# vtk DataFile Version 3.0", "finger mesh, mm", "ASCII", "DATASET UNSTRUCTURED_GRID",
        f"POINTS {n_nodes} double",
    ]  # fmt: skip
    np.testing.assert_allclose(np.loadtxt(lines[5 : 5 + n_nodes]), default_mesh.nodes, rtol=1e-8, atol=1e-8)
    cells = lines.index(f"CELLS {n} {9 * n}") + 1
    np.testing.assert_array_equal(np.loadtxt(lines[cells : cells + n], int)[:, 1:], default_mesh.hexes)
    layer = lines.index("SCALARS layer double 1") + 2
    np.testing.assert_array_equal(np.loadtxt(lines[layer : layer + n]), default_mesh.layer)
