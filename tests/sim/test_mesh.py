"""The mesh of the fingertip: layers, spacing, orientation, what is held, how good its elements are."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize

from sim.config import FingertipConfig, MeshSpec, Tissue
from sim.finger import mesh as mesh_module
from sim.finger.mesh import (
    BONE,
    DERMIS,
    EPIDERMIS,
    FAT,
    POOR_SCALED_JACOBIAN,
    FingerMesh,
    MeshError,
    build_mesh,
    mesh_quality,
)
from sim.finger.surface import FingertipSurface
from sim.finger.vtk import write_vtk
from tests.error_codes import printed, raises

Array = NDArray[np.float64]


def grid_of(mesh: FingerMesh) -> Array:
    """(n_z, n_phi, n_r, 3) node positions; radial index 0 is the skin."""
    return mesh.nodes.reshape(*mesh.grid, 3)


def distance_to_skin(skin: FingertipSurface, point: Array) -> float:
    """Perpendicular distance, by search."""

    def squared(v: Array) -> float:
        x, y = skin.section(v[0], v[1])
        return float((x - point[0]) ** 2 + (y - point[1]) ** 2 + (v[1] - point[2]) ** 2)

    start = [np.arctan2(point[1], point[0]), point[2]]
    found = minimize(squared, start, method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-14})
    return float(np.sqrt(found.fun))


def interface_index(mesh: FingerMesh, upper: int) -> int:
    """Radial index of the node on the lower face of a layer."""
    return int((mesh.layer.reshape(mesh.element_grid.shape)[0, 0] <= upper).sum())


def test_element_faces_lie_on_the_layer_interfaces(default_mesh: FingerMesh, skin: FingertipSurface) -> None:
    # Raju (1998, ch. 3): epidermis and dermis, here 0.4 and 0.8 mm thick. Depths are laid off along rays from the
    # axis, divided by the cosine to the skin's normal: exact for flat skin. At the apex curvature costs 1e-3 mm; a
    # misplaced interface would be off by an element, 0.2 mm.
    mesh, grid = default_mesh, grid_of(default_mesh)
    k = int(np.argmin(np.abs(mesh.z_mm - FingertipConfig().receptor_plane_mm)))
    j = int(np.argmin(np.abs(mesh.phi - np.pi / 2)))
    assert mesh.phi[j] == pytest.approx(np.pi / 2, abs=1e-7)
    assert distance_to_skin(skin, grid[k, j, interface_index(mesh, EPIDERMIS)]) == pytest.approx(0.4, abs=2e-4)
    assert distance_to_skin(skin, grid[k, j, interface_index(mesh, DERMIS)]) == pytest.approx(1.2, abs=2e-3)


def test_interfaces_follow_the_skin_under_the_whole_pad(default_mesh: FingerMesh, skin: FingertipSurface) -> None:
    # Rays lie in the sections; where the skin slopes axially, its curvature makes the layers thinner than meant.
    # Measured within 2 mm of the apex: epidermis 0.4 mm −1.9 %, epidermis and dermis 1.2 mm −5.4 %.
    mesh, grid = default_mesh, grid_of(default_mesh)
    z0 = FingertipConfig().receptor_plane_mm
    near = [
        n
        for n in mesh.patch_nodes[::11]
        if abs(mesh.nodes[n, 0]) < 2 and abs(mesh.nodes[n, 2] - z0) < 2 and mesh.nodes[n, 1] > 0
    ]
    assert len(near) > 30
    for n in near:
        k, j, _ = np.unravel_index(n, mesh.grid)
        assert distance_to_skin(skin, grid[k, j, interface_index(mesh, EPIDERMIS)]) == pytest.approx(0.4, rel=0.02)
        assert distance_to_skin(skin, grid[k, j, interface_index(mesh, DERMIS)]) == pytest.approx(1.2, rel=0.06)


def test_every_element_has_the_layer_of_its_depth(default_mesh: FingerMesh) -> None:
    # Elements between skin and the first interface are epidermis, to the second dermis, then fat: on every ray.
    mesh, grid = default_mesh, grid_of(default_mesh)
    layer = mesh.layer.reshape(mesh.element_grid.shape)
    assert (layer == layer[0, 0]).all()
    assert list(layer[0, 0, :2]) == [EPIDERMIS, EPIDERMIS]  # two elements through the epidermis
    assert layer[0, 0, 2] == DERMIS
    assert layer[0, 0, -1] == FAT
    depth = np.linalg.norm(grid - grid[:, :, :1], axis=-1)
    assert (np.diff(depth, axis=2) > 0).all()
    ratio = depth[:, :, interface_index(mesh, DERMIS)] / depth[:, :, interface_index(mesh, EPIDERMIS)]
    np.testing.assert_allclose(ratio, 3.0, rtol=1e-12)  # (0.4 + 0.8) / 0.4
    radius = np.linalg.norm(grid[:, :, -1, :2], axis=-1) / np.linalg.norm(grid[:, :, 0, :2], axis=-1)
    np.testing.assert_allclose(radius, Tissue().bone_fraction, rtol=1e-12)


def test_the_patch_elements_are_170_micrometers_wide_across_the_finger(default_mesh: FingerMesh) -> None:
    # Raju (1998, ch. 3): ≤ 170 µm on the top pulp surface. Laterally the arc is divided in the receptor plane, 0.4 µm
    # more where the section is largest. Along the finger 0.315 mm do as well: docs/validation/performance.md.
    mesh = default_mesh
    patch = mesh.nodes[mesh.patch_nodes].reshape(*mesh.patch_shape, 3)
    lateral = np.linalg.norm(np.diff(patch, axis=1), axis=-1)
    assert lateral.max() < 0.1705
    np.testing.assert_allclose(lateral[mesh.receptor_row], 0.17, rtol=1e-3)  # chords of 0.17 mm arcs
    np.testing.assert_allclose(np.diff(patch[:, :, 2], axis=0), 1.855 * 0.17, rtol=1e-9)
    assert patch[mesh.receptor_row, :, 0].max() > 3.3
    assert patch[mesh.receptor_row, :, 0].min() < -3.3
    assert np.ptp(patch[:, 0, 2]) >= 7.0


def test_a_row_of_nodes_lies_in_the_receptor_plane(default_mesh: FingerMesh) -> None:
    # Raju (1998): 5.86 mm from the tip, where site 4 and site 10 are, at z = 6.893.
    mesh = default_mesh
    rows = mesh.nodes[mesh.patch_nodes].reshape(*mesh.patch_shape, 3)
    np.testing.assert_allclose(rows[mesh.receptor_row, :, 2], 6.893, rtol=0, atol=1e-12)


def test_jacobians_are_positive_at_the_gauss_points(default_mesh: FingerMesh) -> None:
    # Independent of the mesh's own check at the corners: triple products of the trilinear map at 2 × 2 × 2 points.
    corner = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)[[0, 1, 3, 2, 4, 5, 7, 6]]
    p = default_mesh.nodes[default_mesh.hexes]
    volume = np.zeros(len(p))
    for g in corner / np.sqrt(3):
        one = 1 + corner * g
        d = np.stack([corner[:, i] * one[:, i - 1] * one[:, i - 2] / 8 for i in range(3)])
        det = np.linalg.det(d @ p)
        assert det.min() > 0
        volume += det
    # The whole is what lies between skin and bone: (1 − 0.32²) of the sections; 1 % for facets.
    grid = grid_of(default_mesh)[:, :, 0]
    x, y = grid[..., 0], grid[..., 1]
    section = 0.5 * np.abs((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1))
    whole = np.trapezoid(section, default_mesh.z_mm) * (1 - Tissue().bone_fraction ** 2)
    assert volume.sum() == pytest.approx(whole, rel=0.01)


def test_the_mesh_fixes_nail_proximal_edge_and_bone_only(default_mesh: FingerMesh) -> None:
    # Raju (1998, ch. 3): every node of the nail and of the proximal edge. Nail: the dorsal 140° from z = 5 mm on.
    mesh, tissue = default_mesh, Tissue()
    z = mesh.nodes[:, 2]
    _, j, i = np.unravel_index(np.arange(len(mesh.nodes)), mesh.grid)
    from_nail = np.abs(np.angle(np.exp(1j * (mesh.phi[j] + np.pi / 2))))
    nail = (i == 0) & (z >= tissue.nail_from_z_mm) & (from_nail <= np.radians(70.0))
    edge, bone = z == 0.0, i == mesh.grid[2] - 1
    np.testing.assert_array_equal(mesh.fixed, nail | edge | bone)
    assert nail.sum() > 100
    assert edge.sum() == mesh.grid[1] * mesh.grid[2]
    assert (mesh.nodes[nail, 1] < 0).all()
    assert not mesh.fixed[mesh.patch_nodes].any()


def test_tributary_areas_tile_the_skin(default_mesh: FingerMesh, skin: FingertipSurface) -> None:
    # Inside the rim each node holds half-way to its neighbours; rows next to the rim count half. Against ∫ |∂φ × ∂z|:
    # facets of 0.17 mm on a radius of 3.5 mm lose (h / R)² / 12 = 2e-4, unequal halves of those rows up to 2e-3.
    mesh = default_mesh
    patch = mesh.nodes[mesh.patch_nodes].reshape(*mesh.patch_shape, 3)
    area = mesh.patch_area_mm2.reshape(mesh.patch_shape)
    j = np.unravel_index(mesh.patch_nodes[: mesh.patch_shape[1]], mesh.grid)[1]
    phi = np.unwrap(mesh.phi[j])
    p, z = np.meshgrid(np.linspace(phi[1], phi[-2], 401), np.linspace(patch[1, 0, 2], patch[-2, 0, 2], 401))
    d_phi, d_z = skin.tangents(p, z)
    density = np.linalg.norm(np.cross(d_phi, d_z), axis=-1)
    inner = abs(np.trapezoid(np.trapezoid(density, p[0], axis=1), z[:, 0]))
    weight = np.ones(mesh.patch_shape)  # of the rows next to the rim, half lies inside their own quadrilaterals
    weight[[0, -1], :] = weight[:, [0, -1]] = 0.0
    weight[[1, -2], :] *= 0.5
    weight[:, [1, -2]] *= 0.5
    assert (area * weight).sum() == pytest.approx(inner, rel=2e-3)
    quads = 0.5 * np.linalg.norm(np.cross(patch[1:, 1:] - patch[:-1, :-1], patch[1:, :-1] - patch[:-1, 1:]), axis=-1)
    np.testing.assert_allclose(
        area[1:-1, 1:-1], 0.25 * (quads[1:, 1:] + quads[1:, :-1] + quads[:-1, 1:] + quads[:-1, :-1]), rtol=1e-12
    )
    assert area.sum() > quads.sum()


def test_an_elastic_bone_adds_an_innermost_layer_of_bone_elements(
    coarse_config: FingertipConfig, skin: FingertipSurface
) -> None:
    tissue = Tissue(bone="elastic")
    mesh = build_mesh(coarse_config.model_copy(update={"tissue": tissue}), skin)
    layer = mesh.layer.reshape(mesh.element_grid.shape)
    assert (layer[:, :, -1] == BONE).all()
    assert (layer[:, :, :-1] != BONE).all()


def test_a_folded_mesh_is_refused_with_its_element(
    coarse_config: FingertipConfig, skin: FingertipSurface, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = mesh_module.nodes_on_rays

    def with_a_fold(*arguments: object) -> tuple[Array, NDArray[np.int64]]:
        nodes, layers = place(*arguments)  # type: ignore[arg-type]
        nodes[5, 6, 2] = nodes[5, 6, 4]  # through two of its neighbours
        return nodes, layers

    monkeypatch.setattr(mesh_module, "nodes_on_rays", with_a_fold)
    with raises(MeshError, "folded") as error:
        build_mesh(coarse_config, skin)
    number = int(printed(error.value, "element ", " is folded"))
    assert printed(error.value, "corner volume ", " mm³") < 0
    monkeypatch.undo()
    good = build_mesh(coarse_config, skin)
    moved = int(np.ravel_multi_index((5, 6, 2), good.grid))
    assert moved in good.hexes[number]


def test_a_patch_longer_than_the_finger_is_refused(skin: FingertipSurface) -> None:
    config = FingertipConfig(mesh=MeshSpec(patch_z_mm=4.5), receptor_plane_from_tip_mm=4.0)
    with raises(MeshError, "patch_leaves_finger", patch_z_mm=4.5):
        build_mesh(config, skin)


# --- quality ---

CUBE = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float
)  # VTK order
ONE = np.arange(8)[None]


def quality(nodes: Array) -> tuple[float, float]:
    found = mesh_quality(nodes, ONE)
    return float(found.scaled_jacobian[0]), float(found.aspect_ratio[0])


def test_mesh_quality_of_a_cube_and_a_box_is_exact() -> None:
    assert quality(CUBE) == (1.0, 1.0)
    assert quality(CUBE * [2.0, 3.0, 0.5]) == pytest.approx((1.0, 6.0), rel=1e-15)


def test_mesh_quality_detects_flat_and_folded_corners() -> None:
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
