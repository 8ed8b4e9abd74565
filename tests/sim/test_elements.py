"""The hexahedron: patch tests, zero modes, locking.

Sources: the patch test of Irons & Razzaque (1972) on the mesh and with the field of MacNeal & Harder (1985), "A
proposed standard set of problems to test finite element accuracy"; from the same paper, the thick-walled cylinder.
"""

from typing import Literal, get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.fem.elements import Element, hex8_centroid_strain, hex8_stiffness, lame
from sim.finger.mesh import FingerMesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

ELEMENTS = get_args(Element)

# MacNeal & Harder (1985), Fig. 3: a unit cube around eight inner nodes, seven hexahedra.
CUBE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float)
INNER = np.array(
    [
        [0.249, 0.342, 0.192],
        [0.826, 0.288, 0.288],
        [0.850, 0.649, 0.263],
        [0.273, 0.750, 0.230],
        [0.320, 0.186, 0.643],
        [0.677, 0.305, 0.683],
        [0.788, 0.693, 0.644],
        [0.165, 0.745, 0.702],
    ]
)
PATCH_NODES = np.concatenate([CUBE, INNER])
PATCH_HEXES = np.array(
    [
        [8, 9, 10, 11, 12, 13, 14, 15],
        [0, 1, 2, 3, 8, 9, 10, 11],
        [12, 13, 14, 15, 4, 5, 6, 7],
        [0, 1, 9, 8, 4, 5, 13, 12],
        [1, 2, 10, 9, 5, 6, 14, 13],
        [2, 3, 11, 10, 6, 7, 15, 14],
        [3, 0, 8, 11, 7, 4, 12, 15],
    ]
)
FIELD = 1e-3 * np.array([[1, 0.5, 0.5], [0.5, 1, 0.5], [0.5, 0.5, 1]])
"""du/dx of MacNeal & Harder: all six engineering strains are 1e-3."""

ROUND_OFF = 1e-12
"""Relative: 24-term sums of well-scaled numbers, about 1e-15 each, with room for a solve of condition ~ 1e2."""


def dense(stiffness: Array, hexes: Ints, n_nodes: int) -> Array:
    """Naive assembly, which also takes elements with coinciding nodes."""
    out = np.zeros((3 * n_nodes, 3 * n_nodes))
    for k, element in zip(stiffness, hexes, strict=True):
        dof = (3 * element[:, None] + np.arange(3)).ravel()
        for a in range(24):
            for b in range(24):
                out[dof[a], dof[b]] += k[a, b]
    return out


def patch_test(nodes: Array, hexes: Ints, inner: Ints, element: Element, poisson: float) -> None:
    """Zero residual inside under the linear field, and the field itself when only the outside is prescribed."""
    stiffness = hex8_stiffness(nodes, hexes, np.full(len(hexes), 1e6), poisson, element)
    k = dense(stiffness, hexes, len(nodes))
    exact = (nodes @ FIELD).ravel()
    inside = (3 * inner[:, None] + np.arange(3)).ravel()
    outside = np.setdiff1d(np.arange(len(k)), inside)
    forces = k @ exact
    assert np.abs(forces[inside]).max() <= ROUND_OFF * np.abs(forces).max()
    solved = np.linalg.solve(k[np.ix_(inside, inside)], -k[np.ix_(inside, outside)] @ exact[outside])
    np.testing.assert_allclose(solved, exact[inside], rtol=0, atol=ROUND_OFF * np.abs(exact).max())


@pytest.mark.parametrize("poisson", [0.25, 0.48])
@pytest.mark.parametrize("element", ELEMENTS)
def test_patch_test_to_round_off(element: Element, poisson: float) -> None:
    patch_test(PATCH_NODES, PATCH_HEXES, np.arange(8, 16), element, poisson)


def test_centroid_strain_of_a_linear_field_is_exact() -> None:
    gradient = np.arange(1.0, 10.0).reshape(3, 3) * 1e-3  # ∂u_i/∂x_j, not symmetric: a rotation must not show
    u = PATCH_NODES @ gradient.T
    strain = np.einsum("nrk,nk->nr", hex8_centroid_strain(PATCH_NODES, PATCH_HEXES), u[PATCH_HEXES].reshape(-1, 24))
    g = gradient
    expected = [g[0, 0], g[1, 1], g[2, 2], g[0, 1] + g[1, 0], g[1, 2] + g[2, 1], g[0, 2] + g[2, 0]]
    np.testing.assert_allclose(strain, np.tile(expected, (7, 1)), rtol=ROUND_OFF)


@pytest.mark.parametrize("element", ELEMENTS)
def test_stress_of_the_patch_is_that_of_the_source(element: Element) -> None:
    # MacNeal & Harder: E = 1e6, ν = 0.25, exact stresses 2000 (normal) and 400 (shear). The strain energy of a unit
    # cube in that state is ½ (3 · 2000 + 3 · 400) · 1e-3 = 3.6.
    stiffness = hex8_stiffness(PATCH_NODES, PATCH_HEXES, np.full(7, 1e6), 0.25, element)
    u = (PATCH_NODES @ FIELD)[PATCH_HEXES].reshape(-1, 24)
    energy = 0.5 * np.einsum("na,nab,nb->", u, stiffness, u)
    assert energy == pytest.approx(3.6, rel=ROUND_OFF)


@pytest.mark.parametrize("element", ELEMENTS)
def test_wedges_by_collapsed_hexahedra_pass_the_patch_test(element: Element) -> None:
    # 2 × 2 × 2 cubes with the middle node displaced, each cut into two wedges: VTK nodes 2 = 3 and 6 = 7.
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 3)] * 3, indexing="ij"), -1).reshape(-1, 3)
    grid[13] += [0.11, -0.07, 0.09]
    number = np.arange(27).reshape(3, 3, 3)
    wedges = []
    for i, j, k in np.ndindex(2, 2, 2):
        a, b, c, d = (number[i + p, j + q, k] for p, q in ((0, 0), (1, 0), (1, 1), (0, 1)))
        wedges += [[a, b, c, c, a + 1, b + 1, c + 1, c + 1], [a, c, d, d, a + 1, c + 1, d + 1, d + 1]]
    patch_test(grid, np.array(wedges), np.array([13]), element, 0.3)


@pytest.mark.parametrize("flat", [(1, 1 / 50, 1), (1 / 50, 1, 1), (1 / 50, 1, 1 / 50)])
@pytest.mark.parametrize("element", ELEMENTS)
def test_elements_fifty_times_longer_than_thick_pass_the_patch_test(
    element: Element, flat: tuple[float, float, float]
) -> None:
    # The distorted patch squeezed to plates and needles; measured 1e-14, the condition is still ~ 1e2.
    patch_test(PATCH_NODES * flat, PATCH_HEXES, np.arange(8, 16), element, 0.48)


@pytest.mark.parametrize("element", ELEMENTS)
def test_six_zero_modes_of_a_wedge(element: Element) -> None:
    # A collapsed hexahedron has 18 displacements of its own: six are rigid motions, twelve deform it. The softest of
    # those is 2e-3 of the stiffest, a lost one would be at 1e-16.
    wedge = np.array([[0, 0, 0], [1, 0.1, 0], [0.3, 0.8, 0.1], [0, 0.1, 1.2], [1, 0, 1], [0.4, 0.9, 1.1]], float)
    corners = np.array([[0, 1, 2, 2, 3, 4, 5, 5]])
    k = dense(hex8_stiffness(wedge, corners, np.ones(1), 0.48, element), corners, 6)
    values = np.linalg.eigvalsh(k)
    assert np.abs(values[:6]).max() < 1e-13 * values[-1]
    assert values[6] > 1e-4 * values[-1]


@pytest.mark.parametrize("element", ELEMENTS)
def test_six_zero_modes_and_symmetry(element: Element) -> None:
    for k in hex8_stiffness(PATCH_NODES, PATCH_HEXES, np.ones(7), 0.48, element):
        np.testing.assert_allclose(k, k.T, rtol=0, atol=1e-15 * np.abs(k).max())
        values = np.linalg.eigvalsh(k)
        # Rigid motions only. The softest deforming mode of these distorted elements is 5e-4 of the stiffest one
        # (ν = 0.48 puts a factor 25 between κ and μ); rigid motions are at 1e-16, where an hourglass mode would be.
        assert np.abs(values[:6]).max() < 1e-13 * values[-1]
        assert values[6] > 1e-4 * values[-1]


def test_bbar_is_full_integration_where_dilatation_is_constant() -> None:
    # Pure shear of a rectangular brick has no dilatation: both kinds give τ = Gγ, and W = ½ G γ² V.
    brick = CUBE * [0.3, 0.2, 0.5]
    shear = np.zeros((8, 3))
    shear[:, 0] = 0.01 * brick[:, 1]
    forces = []
    for element in ELEMENTS:
        k = hex8_stiffness(brick, np.arange(8)[None], np.array([3.0]), 0.48, element)[0]
        forces.append(k @ shear.ravel())
        modulus = lame(np.array(3.0), 0.48)[0]
        work = 0.5 * shear.ravel() @ forces[-1]
        assert work == pytest.approx(0.5 * modulus * 0.01**2 * 0.3 * 0.2 * 0.5, rel=ROUND_OFF)
    np.testing.assert_allclose(forces[0], forces[1], rtol=0, atol=ROUND_OFF * np.abs(forces[0]).max())


def test_chunks_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    young = np.linspace(1, 2, 7)
    whole = hex8_stiffness(PATCH_NODES, PATCH_HEXES, young, 0.48, "bbar")
    monkeypatch.setattr("sim.fem.elements._CHUNK", 3)
    np.testing.assert_allclose(hex8_stiffness(PATCH_NODES, PATCH_HEXES, young, 0.48, "bbar"), whole, rtol=1e-13)


def thick_cylinder(element: Literal["bbar", "full"], poisson: float, wedges: bool = False) -> float:
    """Radial displacement at the bore over the exact one; MacNeal & Harder (1985), mesh and load as there.

    With `wedges` each hexahedron is cut in two along a diagonal of its section.
    """
    radius = np.array([3.0, 3.5, 4.2, 5.2, 6.75, 9.0])
    angle = np.linspace(0, np.pi / 2, 10)
    r, t, z = np.meshgrid(radius, angle, [0.0, 1.0], indexing="ij")
    nodes = np.stack([r * np.cos(t), r * np.sin(t), z], -1).reshape(-1, 3)
    number = np.arange(len(nodes)).reshape(r.shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    hexes = np.stack([a[..., 0], b[..., 0], c[..., 0], d[..., 0], a[..., 1], b[..., 1], c[..., 1], d[..., 1]], -1)
    hexes = hexes.reshape(-1, 8)
    if wedges:
        hexes = np.concatenate([hexes[:, [0, 1, 2, 2, 4, 5, 6, 6]], hexes[:, [0, 2, 3, 3, 4, 6, 7, 7]]])
    k = dense(hex8_stiffness(nodes, hexes, np.full(len(hexes), 1000.0), poisson, element), hexes, len(nodes))
    load = np.zeros((len(nodes), 3))
    for first, second in zip(number[0, :-1], number[0, 1:], strict=True):
        edge = nodes[second[0], :2] - nodes[first[0], :2]
        push = np.array([edge[1], -edge[0], 0.0])  # unit pressure on the chord, away from the axis, thickness 1
        for node in (*first, *second):
            load[node] += push / 4
    held = np.zeros((len(nodes), 3), dtype=bool)
    held[:, 2] = True  # plane strain
    held[number[:, 0].ravel(), 1] = True
    held[number[:, -1].ravel(), 0] = True
    free = np.flatnonzero(~held.ravel())
    u = np.zeros(3 * len(nodes))
    u[free] = np.linalg.solve(k[np.ix_(free, free)], load.ravel()[free])
    exact = (1 + poisson) * 9 / (1000 * (81 - 9)) * (81 / 3 + (1 - 2 * poisson) * 3)
    return float(u[3 * number[0, 0, 0]] / exact)


def test_nearly_incompressible_bbar_does_not_lock_where_full_does() -> None:
    # Exact by Lamé (5.0623e-3 for ν = 0.4999, as MacNeal & Harder print). Measured: full integration 0.845 of it at
    # ν = 0.49, 0.053 at 0.4999; B-bar 0.993 at both. 1.5 %: ten-degree facets, five elements in the radius.
    ratio = {(e, p): thick_cylinder(e, p) for e in ELEMENTS for p in (0.49, 0.4999)}
    assert ratio["bbar", 0.49] == pytest.approx(1.0, abs=0.015), ratio
    assert ratio["bbar", 0.4999] == pytest.approx(1.0, abs=0.015), ratio
    assert ratio["full", 0.49] == pytest.approx(0.85, abs=0.02), ratio
    assert ratio["full", 0.4999] < 0.1, ratio


@pytest.mark.parametrize("element", ELEMENTS)
def test_wedges_lock_where_hexahedra_of_bbar_do_not(element: Element) -> None:
    # In plane strain a wedge is a triangle of constant strain: its mean dilatation is its dilatation, B-bar changes
    # nothing. Measured 0.903 of the exact displacement at ν = 0.3, 0.574 at 0.48, 0.047 at 0.4999, in both; 1 % of
    # it tells them from anything else. Wedges are right in the limit (patch test) but of no use in nearly
    # incompressible tissue: the finger's mesh has none.
    assert thick_cylinder(element, 0.3, wedges=True) == pytest.approx(0.903, rel=0.01)
    assert thick_cylinder(element, 0.48, wedges=True) == pytest.approx(0.574, rel=0.01)
    assert thick_cylinder(element, 0.4999, wedges=True) < 0.06


def test_the_mesh_of_the_finger_has_no_wedges(default_mesh: FingerMesh) -> None:
    corners = np.sort(default_mesh.hexes, axis=1)
    assert (np.diff(corners, axis=1) > 0).all()
