"""The hexahedron: patch tests, zero modes, locking.

Sources: the patch test of Irons & Razzaque (1972) on the mesh and with the field of MacNeal & Harder (1985), "A
proposed standard set of problems to test finite element accuracy"; from the same paper, the thick-walled cylinder.
"""

from typing import get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.fem.elements import (
    HEX8,
    HEX27,
    NODES,
    Element,
    lame,
    local_coordinates,
    shape_functions,
    stiffness,
    strain_matrix,
)

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

ELEMENTS: tuple[Element, ...] = get_args(Element)

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
"""Relative: sums of up to 81 well-scaled numbers, about 1e-15 each, with room for a solve of condition ~ 1e2."""


def mesh_for(element: Element, bent: float = 0.03) -> tuple[Array, Ints, Ints]:
    """Nodes, elements and inner nodes of the patch; of 27 nodes with faces that are bent inside the cube."""
    if NODES[element] == 8:
        return PATCH_NODES, PATCH_HEXES, np.arange(8, 16)
    corners = shape_functions(8, HEX27)[0] @ PATCH_NODES[PATCH_HEXES]
    nodes, number = np.unique(corners.reshape(-1, 3).round(12), axis=0, return_inverse=True)
    inner = np.flatnonzero(((nodes > 1e-9) & (nodes < 1 - 1e-9)).all(axis=1))
    nodes[inner] += bent * np.random.default_rng(3).uniform(-1, 1, (len(inner), 3))
    return nodes, number.reshape(-1, 27), inner


def dense(matrices: Array, hexes: Ints, n_nodes: int) -> Array:
    """Naive assembly, which also takes elements with coinciding nodes."""
    out = np.zeros((3 * n_nodes, 3 * n_nodes))
    for k, element in zip(matrices, hexes, strict=True):
        dof = (3 * element[:, None] + np.arange(3)).ravel()
        np.add.at(out, np.ix_(dof, dof), k)
    return out


def patch_test(nodes: Array, hexes: Ints, inner: Ints, element: Element, poisson: float) -> None:
    """Zero residual inside under the linear field, and the field itself when only the outside is prescribed."""
    k = dense(stiffness(nodes, hexes, np.full(len(hexes), 1e6), poisson, element), hexes, len(nodes))
    exact = (nodes @ FIELD).ravel()
    inside = (3 * inner[:, None] + np.arange(3)).ravel()
    outside = np.setdiff1d(np.arange(len(k)), inside)
    forces = k @ exact
    assert np.abs(forces[inside]).max() <= ROUND_OFF * np.abs(forces).max()
    solved = np.linalg.solve(k[np.ix_(inside, inside)], -k[np.ix_(inside, outside)] @ exact[outside])
    np.testing.assert_allclose(solved, exact[inside], rtol=0, atol=ROUND_OFF * np.abs(exact).max())


@pytest.mark.parametrize("poisson", [0.25, 0.48])
@pytest.mark.parametrize("element", ELEMENTS)
def test_every_element_passes_the_patch_test_to_round_off(element: Element, poisson: float) -> None:
    patch_test(*mesh_for(element), element, poisson)


@pytest.mark.parametrize("element", ["bbar", "quadratic"])
def test_strain_of_a_linear_field_is_exact(element: Element) -> None:
    nodes, hexes, _ = mesh_for(element)
    local = np.random.default_rng(4).uniform(-1, 1, (7, 3))
    gradient = np.arange(1.0, 10.0).reshape(3, 3) * 1e-3  # ∂u_i/∂x_j, not symmetric: a rotation must not show
    u = (nodes @ gradient.T)[hexes].reshape(7, -1)
    strain = np.einsum("nrk,nk->nr", strain_matrix(nodes[hexes], local), u)
    g = gradient
    expected = [g[0, 0], g[1, 1], g[2, 2], g[0, 1] + g[1, 0], g[1, 2] + g[2, 1], g[0, 2] + g[2, 0]]
    np.testing.assert_allclose(strain, np.tile(expected, (7, 1)), rtol=ROUND_OFF)


@pytest.mark.parametrize("element", ELEMENTS)
def test_the_energy_of_the_patch_test_is_that_of_macneal_and_harder(element: Element) -> None:
    # MacNeal & Harder: E = 1e6, ν = 0.25, exact stresses 2000 (normal) and 400 (shear). The strain energy of a unit
    # cube in that state is ½ (3 · 2000 + 3 · 400) · 1e-3 = 3.6.
    nodes, hexes, _ = mesh_for(element)
    u = (nodes @ FIELD)[hexes].reshape(7, -1)
    energy = 0.5 * np.einsum("na,nab,nb->", u, stiffness(nodes, hexes, np.full(7, 1e6), 0.25, element), u)
    assert energy == pytest.approx(3.6, rel=ROUND_OFF)


@pytest.mark.parametrize("flat", [(1, 1 / 50, 1), (1 / 50, 1, 1), (1 / 50, 1, 1 / 50)])
@pytest.mark.parametrize("element", ELEMENTS)
def test_elements_fifty_times_longer_than_thick_pass_the_patch_test(
    element: Element, flat: tuple[float, float, float]
) -> None:
    # The distorted patch squeezed to plates and needles; measured 1e-14, the condition is still ~ 1e2.
    nodes, hexes, inner = mesh_for(element)
    patch_test(nodes * flat, hexes, inner, element, 0.48)


@pytest.mark.parametrize("element", ELEMENTS)
def test_every_element_stiffness_is_symmetric_with_six_zero_modes(element: Element) -> None:
    # Rigid motions only. The softest deforming mode of the distorted elements is 5e-4 of the stiffest one (of 27
    # nodes 2e-5; ν = 0.48 puts a factor 25 between κ and μ); rigid motions are at 1e-16, where an hourglass mode
    # would be. Bubbles with the mean dilatation alone have three of these on a brick, and none when it is distorted.
    nodes, hexes, _ = mesh_for(element)
    brick = (1 + HEX27[: NODES[element]]) * [0.1, 0.15, 0.1]
    matrices = stiffness(nodes, hexes, np.ones(7), 0.48, element)
    for k in (*matrices, stiffness(brick, np.arange(len(brick))[None], np.ones(1), 0.48, element)[0]):
        np.testing.assert_allclose(k, k.T, rtol=0, atol=1e-15 * np.abs(k).max())
        values = np.linalg.eigvalsh(k)
        assert np.abs(values[:6]).max() < 1e-13 * values[-1]
        assert values[6] > 1e-5 * values[-1]


@pytest.mark.parametrize("element", ELEMENTS)
def test_each_element_bends_with_its_theoretical_stiffness(element: Element) -> None:
    # Plane strain, e11 = y, side faces free: ½ E/(1 − ν²) a unit of y². Eight nodes shear instead of bending
    # (e12 = x) and cannot bulge: full integration has (λ + 2μ) y² + μ x², B-bar 4/3 μ y² + μ x². Bubbles and 27
    # nodes are exact.
    poisson = 0.48
    mu, kappa = (float(v) for v in lame(np.array(1.0), poisson))
    nodes = HEX27[: NODES[element]] * [1.0, 1.0, 0.5]
    k = stiffness(nodes, np.arange(len(nodes))[None], np.ones(1), poisson, element)[0]
    x, y, _ = nodes.T
    bent = np.stack([x * y, -0.5 * x * x - 0.5 * poisson / (1 - poisson) * y * y, 0 * x], axis=1).ravel()
    exact = 1 / (1 - poisson**2)
    modulus = {"full": kappa + 4 / 3 * mu + mu, "bbar": 4 / 3 * mu + mu}.get(element, exact)
    assert bent @ k @ bent == pytest.approx(modulus * 4 / 3, rel=ROUND_OFF)


def thick_cylinder(element: Element, poisson: float, wedges: bool = False) -> float:
    """Radial displacement at the bore over the exact one; MacNeal & Harder (1985), mesh and load as there.

    With `wedges` each hexahedron is cut in two along a diagonal of its section.
    """
    order = 1 if NODES[element] == 8 else 2
    radius, angle, height = (between(v, order) for v in (RADII, np.linspace(0, np.pi / 2, 10), np.array([0.0, 1.0])))
    r, t, z = np.meshgrid(radius, angle, height, indexing="ij")
    nodes = np.stack([r * np.cos(t), r * np.sin(t), z], -1).reshape(-1, 3)
    number = np.arange(len(nodes)).reshape(r.shape)
    offset = (order * (1 + HEX27[: NODES[element]]) / 2).astype(int)
    first = np.stack(np.meshgrid(*(range(0, n - 1, order) for n in r.shape), indexing="ij"), -1).reshape(-1, 1, 3)
    hexes = number[tuple(np.moveaxis(first + offset, -1, 0))]
    if wedges:
        hexes = np.concatenate([hexes[:, [0, 1, 2, 2, 4, 5, 6, 6]], hexes[:, [0, 2, 3, 3, 4, 6, 7, 7]]])
    k = dense(stiffness(nodes, hexes, np.full(len(hexes), 1000.0), poisson, element), hexes, len(nodes))
    load = np.zeros((len(nodes), 3))
    # unit pressure on the bore, away from the axis: ∫ Na dNb/ds along an edge, shares along the thickness of 1
    along, share = {
        1: (np.array([[-1, 1], [-1, 1]]) / 2, np.array([1, 1]) / 2),
        2: (np.array([[-3, 4, -1], [-4, 0, 4], [1, -4, 3]]) / 6, np.array([1, 4, 1]) / 6),
    }[order]
    for start in range(0, number.shape[1] - 1, order):
        edge = number[0, start : start + order + 1]
        push = along @ (nodes[edge[:, 0], :2] @ np.array([[0, -1], [1, 0]]))
        load[edge, :2] += share[:, None] * push[:, None]
    held = np.zeros((len(nodes), 3), dtype=bool)
    held[:, 2] = True  # plane strain
    held[number[:, 0].ravel(), 1] = True
    held[number[:, -1].ravel(), 0] = True
    free = np.flatnonzero(~held.ravel())
    u = np.zeros(3 * len(nodes))
    u[free] = np.linalg.solve(k[np.ix_(free, free)], load.ravel()[free])
    exact = (1 + poisson) * 9 / (1000 * (81 - 9)) * (81 / 3 + (1 - 2 * poisson) * 3)
    return float(u[3 * number[0, 0, 0]] / exact)


RADII = np.array([3.0, 3.5, 4.2, 5.2, 6.75, 9.0])


def between(ends: Array, order: int) -> Array:
    """The places of nodes: the ends of elements and, of order 2, their middles."""
    return np.interp(np.arange(order * (len(ends) - 1) + 1) / order, np.arange(len(ends)), ends)


def test_bbar_elements_do_not_lock_near_incompressibility_where_full_integration_does() -> None:
    # Exact by Lamé (5.0623e-3 for ν = 0.4999, as MacNeal & Harder print). Measured: full integration 0.845 of it at
    # ν = 0.49, 0.053 at 0.4999; B-bar 0.993 at both, with bubbles 0.986. 1.5 %: ten-degree facets, five elements in
    # the radius. Of 27 nodes 0.99997 at both: the facets are parabolas.
    ratio = {(e, p): thick_cylinder(e, p) for e in ELEMENTS for p in (0.49, 0.4999)}
    for poisson in (0.49, 0.4999):
        assert ratio["bbar", poisson] == pytest.approx(1.0, abs=0.015), ratio
        assert ratio["incompatible", poisson] == pytest.approx(1.0, abs=0.015), ratio
        assert ratio["quadratic", poisson] == pytest.approx(1.0, abs=2e-4), ratio
    assert ratio["full", 0.49] == pytest.approx(0.85, abs=0.02), ratio
    assert ratio["full", 0.4999] < 0.1, ratio


@pytest.mark.parametrize("at", [HEX8, HEX27])
def test_shape_functions_are_one_at_their_node_and_have_exact_gradients(at: Array) -> None:
    # 1 at their own node and 0 at the others; gradients against central differences, whose error is h² ~ 1e-10 times
    # third derivatives of order one, and round-off 1e-16 / h.
    np.testing.assert_allclose(shape_functions(len(at), at)[0], np.eye(len(at)), rtol=0, atol=1e-15)
    points = np.random.default_rng(6).uniform(-1, 1, (5, 3))
    h = 1e-5
    for axis, step in enumerate(h * np.eye(3)):
        up, down = (shape_functions(len(at), points + sign * step)[0] for sign in (1, -1))
        np.testing.assert_allclose(
            shape_functions(len(at), points)[1][..., axis], (up - down) / (2 * h), rtol=0, atol=1e-9
        )


@pytest.mark.parametrize("element", ["bbar", "quadratic"])
def test_local_coordinates_of_a_point_in_an_element_are_recovered(element: Element) -> None:
    nodes, hexes, _ = mesh_for(element)
    for corners, local in zip(nodes[hexes], np.random.default_rng(7).uniform(-1, 1, (7, 3)), strict=True):
        point = shape_functions(len(corners), local)[0] @ corners
        np.testing.assert_allclose(local_coordinates(corners, point), local, rtol=0, atol=1e-10)
