"""Cook's membrane: a tapered panel in shear and bending, nearly incompressible, in plane strain.

Geometry: Cook (1974), "Improved two-dimensional finite element", J. Struct. Div. ASCE 100, 1851–1863: corners (0, 0),
(48, 44), (48, 60), (0, 44) mm, held at x = 0, a uniform shear traction at x = 48 mm. Made nearly incompressible
(E = 250 MPa, ν = 0.4999, 100 N/mm) it tests bending and volumetric locking together. There is no closed form; the
reference is another program and another element: scikit-fem (Gustafsson & McBain 2020, JOSS 5, 2369) with Taylor–Hood
triangles.
"""

import numpy as np
import skfem as fem
from numpy.typing import NDArray
from skfem.helpers import ddot, div, sym_grad

from sim.fem.elements import Element
from studies.verification.box import SLAB, Box, BoxBody

Array = NDArray[np.float64]

YOUNG, POISSON, LOAD = 250.0, 0.4999, 100.0
LENGTH, RIGHT_EDGE = 48.0, 16.0


def panel(s: Array, t: Array) -> Array:
    """(2, …) coordinates in mm of the unit square's points, s from left to right, t upwards."""
    return np.stack([LENGTH * s, 44 * s + t * (44 - 28 * s)])


def tip_deflection(n: int, element: Element) -> float:
    """Vertical displacement of the corner (48, 60) in mm on n × n of our elements."""
    unit = np.linspace(0, 1, n + 1)
    box = Box(unit, unit, SLAB)
    nodes = np.column_stack([*panel(box.nodes[:, 0], box.nodes[:, 1]), box.nodes[:, 2]])
    held = np.zeros((*box.number.shape, 3), dtype=bool)
    held[0] = True
    held[..., 2] = True
    body = BoxBody(box, np.full(n * n, YOUNG), POISSON, element, nodes=nodes, held=held.reshape(-1, 3))
    loads = np.zeros((1, len(nodes), 3))
    share = np.full(n + 1, LOAD / n)
    share[[0, -1]] /= 2
    loads[0, box.number[-1, :, 0], 1] = share
    return float(body.solve(loads)[0, box.number[-1, -1, 0], 1])


def tip_deflection_taylor_hood(n: int) -> float:
    """The same by scikit-fem: displacement and pressure by Taylor–Hood triangles, 2 n² and more of them.

    They are halved again and again towards the corners: the stress is singular where the panel is held, and the
    traction does not fit the free edges where it is loaded.
    """
    even = np.linspace(0, 1, n + 1)
    mesh = fem.MeshTri.init_tensor(even, even)
    mesh = fem.MeshTri(panel(*mesh.p), mesh.t)
    corners = panel(*np.array([[0, 0, 1, 1], [0, 1, 0, 1]]))
    for halving in range(8):
        centroid = mesh.p[:, mesh.t].mean(axis=1)
        distance = np.hypot(*(centroid[:, :, None] - corners[:, None])).min(axis=1)
        mesh = mesh.refined(np.flatnonzero(distance < 8 * 0.5**halving))
    mu, lame = YOUNG / (2 * (1 + POISSON)), YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    basis = {
        "u": fem.Basis(mesh, fem.ElementVector(fem.ElementTriP2()), intorder=4),
        "p": fem.Basis(mesh, fem.ElementTriP1(), intorder=4),
    }
    a = fem.BilinearForm(lambda u, v, _: 2 * mu * ddot(sym_grad(u), sym_grad(v))).assemble(basis["u"])
    b = fem.BilinearForm(lambda u, q, _: -div(u) * q).assemble(basis["u"], basis["p"])
    c = fem.BilinearForm(lambda p, q, _: -p * q / lame).assemble(basis["p"])
    right = fem.FacetBasis(mesh, basis["u"].elem, facets=mesh.facets_satisfying(lambda x: np.isclose(x[0], LENGTH)))
    load = fem.LinearForm(lambda v, _: LOAD / RIGHT_EDGE * v[1]).assemble(right)
    held = basis["u"].get_dofs(lambda x: np.isclose(x[0], 0)).all()
    matrix = fem.bmat([[a, b.T], [b, c]], "csr")
    rhs = np.concatenate([load, np.zeros(basis["p"].N)])
    solution = fem.solve(*fem.condense(matrix, rhs, D=held))
    corner = int(np.argmin(((mesh.p - np.array([[48.0], [60.0]])) ** 2).sum(axis=0)))
    return float(solution[basis["u"].nodal_dofs[1, corner]])
