"""Hyperelastic bricks in time, quasi-linear: pressure and isochoric stress are ∫ G(t − s) d(those of the law).

The isochoric history is that of Π = DEV[2 ∂w̄/∂C̄], and S = J^{−2/3} DEV[∫ G dΠ] + J p C⁻¹ at what C is by then, so
that a pressure stays one. The same G for both: Poisson's ratio stays. Exact where both are linear in a step. Sources:
Simo, Comput. Methods Appl. Mech. Eng. 60 (1987) 153–173; Simo & Hughes, *Computational Inelasticity*, 1998, ch. 10.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim.models.relaxation import Memory, Prony
from studies.finite_strain.solver.body import Body
from studies.finite_strain.solver.bricks import Bricks, deformation, outer, summed, swapped
from studies.finite_strain.solver.equilibrium import NotFoundError, followed, rest
from studies.finite_strain.solver.inside import isochoric
from studies.finite_strain.solver.press import NOTHING, PressedBody
from studies.finite_strain.solver.rigid import Rigid, Skin

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_FINEST = 6  # halvings of a step
_MOST_TRIES, _CLOSE, _ASIDE_MM = 12, 1e-5, 1e-3


class RelaxingBricks:
    """Bricks at the end of a step of time: α times the law's stress less what is carried; it has an energy, too."""

    def __init__(self, bricks: Bricks, prony: Prony) -> None:
        """Tissue that was never strained, before a sudden step."""
        self.elements, self._bricks = bricks.elements, bricks
        points = bricks.weight.shape
        self._stress, self._pressure = Memory.none(prony, (*points, 3, 3)), Memory.none(prony, points)
        self.begin(0.0)

    def begin(self, step_s: float) -> None:
        """A step of time from what is remembered."""
        self._ahead, self._ahead_p = self._stress.ahead(step_s), self._pressure.ahead(step_s)

    def end(self, u: Array) -> None:
        """Remember the step, having come to (n_nodes, 3) mm."""
        stress, pressure = elastic_stress(self._bricks, u)
        self._stress = self._stress.after(self._ahead, stress)
        self._pressure = self._pressure.after(self._ahead_p, pressure)

    def energy(self, u: Array) -> float:
        """N·mm at (n_nodes, 3) mm, whose derivatives are the forces: α (W − ½ C̄ : carried Π − J carried p)."""
        elastic = self._bricks.energy(u)
        if not np.isfinite(elastic):
            return elastic
        f = self._deformation(u)
        j = np.linalg.det(f)
        past = 0.5 * j ** (-2 / 3) * ((f @ self._ahead.carried) * f).sum(axis=(-2, -1)) + j * self._ahead_p.carried
        return self._ahead.stiffness * (elastic - float((self._bricks.weight * past).sum()))

    def tangent(self, u: Array) -> tuple[Array, Array]:
        """(n, 24) forces and (n, 24, 24) stiffness; rows (a, i) as in `bricks`, with r = F Π ∂N/∂X."""
        force, stiffness = self._bricks.tangent(u)
        gradient, weight, n = self._bricks.gradient, self._bricks.weight, len(self.elements)
        carried, alpha = self._ahead.carried, self._ahead.stiffness
        f = self._deformation(u)
        j = np.linalg.det(f)
        g = (gradient @ np.linalg.inv(f)).reshape(n, -1, 24)
        r = (gradient @ (f @ carried).swapaxes(-1, -2)).reshape(n, -1, 24)
        c = weight * j ** (-2 / 3)
        spread = c * ((f @ carried) * f).sum(axis=(-2, -1)) / 3
        pushed = weight * j * self._ahead_p.carried
        past = summed(c, r) + summed(pushed - spread, g)
        gr = outer(c, g, r)
        bent = outer((2 / 3) * spread + pushed, g, g) - (2 / 3) * (gr + gr.swapaxes(1, 2))
        bent += swapped(outer(spread - pushed, g, g))
        blocks = bent.reshape(n, 8, 3, 8, 3)
        laplace = np.einsum("ng,ngai,ngij,ngbj->nab", c, gradient, carried, gradient, optimize=True)
        for i in range(3):
            blocks[:, :, i, :, i] += laplace
        return alpha * (force - past), alpha * (stiffness - bent)

    def _deformation(self, u: Array) -> Array:
        return deformation(self._bricks.gradient, u[self.elements][:, None])


def elastic_stress(bricks: Bricks, u: Array) -> tuple[Array, Array]:
    """(n, 8, 3, 3) Π and (n, 8) pressures of the law at the points, MPa, at (n_nodes, 3) mm."""
    f = deformation(bricks.gradient, u[bricks.elements][:, None])
    j, inverse = np.linalg.det(f), np.linalg.inv(f)
    mean = (bricks.weight * j).sum(axis=1, keepdims=True) / bricks.weight.sum(axis=1, keepdims=True)
    dilated = np.broadcast_to(mean, j.shape) if bricks.dilatation == "bbar" else j
    deviator = isochoric(f.reshape(-1, 3, 3), bricks.law)[1].reshape(f.shape)
    shear = bricks.mu[:, None] * j ** (2 / 3)
    stress = shear[..., None, None] * (inverse @ deviator @ inverse.swapaxes(-1, -2))
    return stress, bricks.kappa[:, None] * (dilated - 1)


class PressInTime:
    """An indentor over a body of relaxing bricks, from its first touch on."""

    def __init__(self, body: Body, prony: Prony, skin: Skin, touch: Rigid) -> None:
        """A body of hyperelastic bricks, never touched."""
        assert isinstance(body.elements, Bricks)
        self._tissue = RelaxingBricks(body.elements, prony)
        self._body, self._skin, self._touch = replace(body, elements=self._tissue), skin, touch
        self.now = PressedBody(0.0, np.zeros(body.size), NOTHING)

    def to_depth(self, step_s: float, doi_mm: float) -> PressedBody:
        """So much later at a depth, in shorter steps where a long one finds no rest. Raises NotFoundError."""
        return self._to_depth(step_s, doi_mm, _FINEST)

    def to_force(self, step_s: float, force: float) -> PressedBody:
        """So much later at the depth near this one that carries a force, N of E = 1 MPa. Raises NotFoundError."""
        self._tissue.begin(step_s)
        found = self._found(self.now.doi_mm, self.now)
        doi_mm = found.doi_mm + _ASIDE_MM
        for _ in range(_MOST_TRIES):
            if abs(found.force - force) <= _CLOSE * force:
                return self._arrived(found)
            last, found = found, self._found(doi_mm, found)
            per_mm = (found.force - last.force) / (found.doi_mm - last.doi_mm)
            doi_mm = found.doi_mm + (force - found.force) / per_mm
        raise NotFoundError(f"no depth that carries {force:g} N")

    def _to_depth(self, step_s: float, doi_mm: float, halvings: int) -> PressedBody:
        try:
            self._tissue.begin(step_s)
            return self._arrived(self._found(doi_mm, self.now))
        except NotFoundError:
            if not halvings:
                raise
        self._to_depth(0.5 * step_s, 0.5 * (self.now.doi_mm + doi_mm), halvings - 1)
        return self._to_depth(0.5 * step_s, doi_mm, halvings - 1)

    def _found(self, doi_mm: float, start: PressedBody) -> PressedBody:
        there = replace(self._touch, height_mm=self._touch.height_mm - doi_mm)
        ahead = followed(self._body, self._skin, there, start.unknowns, start.touched.nodes)
        return PressedBody(doi_mm, *rest(self._body, self._skin, there, ahead))

    def _arrived(self, found: PressedBody) -> PressedBody:
        self._tissue.end(self._body.displacement(found.unknowns))
        self.now = found
        return found
