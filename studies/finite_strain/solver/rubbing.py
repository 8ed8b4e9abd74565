"""Coulomb friction between an indentor along the finger and the skin of a condensed, linear model.

Small increments from first touch; a node sticks where it met the indentor until its tangential force reaches the
coefficient times the normal one, then slides and sticks anew (a return mapping on penalties for both). Of a whole
finger only friction across it: its patch knows x and y.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.contact.indentor import Indentor
from sim.contact.patch import Patch
from studies.finite_strain.solver.clearance import along, clearance

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NORMAL_MPA_PER_MM, TANGENTIAL_MPA_PER_MM = 1e4, 1e3
"""Of E(epidermis) = 1 MPa: pressures near 1 MPa go 0.1 µm deep, a stuck node creeps by 1 µm."""

INCREMENT_MM, LEAST_MM = 0.02, 1e-4
_TOLERANCE, _MOST_STEPS, _SHORTEST = 1e-7, 60, 1e-3


class StuckError(RuntimeError):
    """No equilibrium within the steps allowed."""


@dataclass(frozen=True)
class Rubbed:
    """Forces (2, n) N on the patch's nodes, for E(epidermis) = 1 MPa, and where each node sticks to the indentor."""

    doi_mm: float
    force: Array
    anchor_mm: Array  # (n,) place along the indentor; nan where nothing touches

    @property
    def normal_force(self) -> float:
        """Downward, N."""
        return -float(self.force[1].sum())


class _Law(NamedTuple):
    """Forces (2, k) at displacements (2, k) of nodes and their derivatives (2, 2, k); anchors after slip (k,)."""

    force: Array
    tangent: Array
    anchor_mm: Array


class _Met(NamedTuple):
    """Of k nodes: gap, its gradient (2, k) and Hessian (2, 2, k), place along the profile and its gradient (2, k)."""

    gap_mm: Array
    normal: Array
    hessian: Array
    along_mm: Array
    growth: Array


@dataclass(frozen=True)
class Rubbing:
    """An indentor at x over a patch, its zero of DOI at a height, and a coefficient of friction."""

    patch: Patch
    indentor: Indentor
    x_mm: float
    touch_mm: float
    friction: float

    def presses(self, deepest_mm: float) -> Iterator[Rubbed]:
        """From first touch down, one an increment, halved at need; ends early below the least."""
        n, nodes = len(self.patch), self._reached(deepest_mm)
        compliance = self._among(nodes)
        u, anchor, doi, step = np.zeros((2, len(nodes))), np.full(len(nodes), np.nan), 0.0, INCREMENT_MM
        ahead = u
        while doi < deepest_mm - 1e-9:
            start, there = self._met(nodes, u, doi).along_mm, min(doi + step, deepest_mm)
            try:
                moved = self._rest(compliance, nodes, u + step * ahead, there, anchor, start)
            except StuckError:
                ahead, step = np.zeros_like(u), 0.5 * step
                if step < LEAST_MM:
                    return
                continue
            law = self._law(nodes, moved, there, anchor, start)
            ahead, u, anchor, doi = (moved - u) / (there - doi), moved, law.anchor_mm, there
            step = min(INCREMENT_MM, 2 * step)
            force, stuck = np.zeros((2, n)), np.full(n, np.nan)
            force[:, nodes], stuck[nodes] = law.force, anchor
            yield Rubbed(doi, force, stuck)

    def _reached(self, deepest_mm: float) -> Ints:
        """Nodes that may come to bear."""
        gap = self.touch_mm + self.indentor.evaluate((self.patch.x - self.x_mm)[None]).height_mm - self.patch.y
        return np.flatnonzero(gap < deepest_mm + 0.1)

    def _among(self, nodes: Ints) -> Array:
        n, k = len(self.patch), len(nodes)
        rows = np.concatenate([nodes, n + nodes])
        return self.patch.compliance[np.ix_(rows, rows)].reshape(2, k, 2, k)

    def _rest(self, compliance: Array, nodes: Ints, u: Array, doi: float, anchor: Array, start: Array) -> Array:
        """Newton's method on u − C f(u) = 0, its steps halved until what is left over falls."""
        k = len(nodes)
        flat = compliance.reshape(2 * k, 2 * k)

        def left(u: Array) -> tuple[Array, _Law]:
            law = self._law(nodes, u, doi, anchor, start)
            return u - (flat @ law.force.ravel()).reshape(2, k), law

        over, law = left(u)
        for _ in range(_MOST_STEPS):
            size = float(np.abs(over).max())
            if size <= _TOLERANCE * doi:
                return u
            step = self._step(flat, over, law.tangent)
            length = 1.0
            while True:
                there, there_law = left(u + length * step)
                if np.abs(there).max() < size * (1 - 1e-3 * length) or length < _SHORTEST:
                    break
                length *= 0.5
            u, over, law = u + length * step, there, there_law
        raise StuckError(f"no equilibrium within {_MOST_STEPS} steps at DOI {doi:g} mm")

    @staticmethod
    def _step(flat: Array, over: Array, tangent: Array) -> Array:
        """−(1 − C ∂f/∂u)⁻¹ what is left over, solved for the nodes that bear alone."""
        k = over.shape[1]
        bears = np.flatnonzero(tangent.any(axis=(0, 1)))
        mine = np.concatenate([bears, k + bears])
        blocks = tangent[:, :, bears]
        m = len(bears)
        scattered = np.zeros((2, m, 2, m))
        at = np.arange(m)
        for i in range(2):
            for j in range(2):
                scattered[i, at, j, at] = blocks[i, j]
        derivative = scattered.reshape(2 * m, 2 * m)
        some = np.linalg.solve(np.eye(2 * m) - flat[np.ix_(mine, mine)] @ derivative, -over.ravel()[mine])
        return (-over.ravel() + flat[:, mine] @ (derivative @ some)).reshape(2, k)

    def _law(self, nodes: Ints, u: Array, doi: float, anchor: Array, start: Array) -> _Law:
        met = self._met(nodes, u, doi)
        bears = met.gap_mm < 0
        stiff = np.where(bears, NORMAL_MPA_PER_MM * self.patch.area_mm2[nodes], 0.0)
        load = -stiff * met.gap_mm
        tangent = load * met.hessian - stiff * met.normal[:, None] * met.normal[None]
        held = np.where(bears, np.where(np.isnan(anchor), start, anchor), np.nan)
        return self._rubbed(nodes, met, bears, _Law(load * met.normal, tangent, held), (load, stiff))

    def _met(self, nodes: Ints, u: Array, doi: float) -> _Met:
        s = self.patch.x[nodes] + u[0] - self.x_mm
        above = self.patch.y[nodes] + u[1] - (self.touch_mm - doi)
        found = clearance(self.indentor, s[None], above)
        normal, hessian = found.gradient[:, :2].T, np.moveaxis(found.hessian[:, :2, :2], 0, -1)
        return _Met(found.mm, normal, hessian, *along(self.indentor, s, above))

    def _rubbed(
        self, nodes: Ints, met: _Met, bears: NDArray[np.bool_], bare: _Law, normal: tuple[Array, Array]
    ) -> _Law:
        """With the tangential force t along the profile; its change with the slope is left out of ∂f/∂u."""
        if self.friction == 0:
            return bare
        load, stiff = normal
        steep = np.hypot(*met.normal)
        spring = np.where(bears, TANGENTIAL_MPA_PER_MM * self.patch.area_mm2[nodes] * steep, 0.0)
        most = self.friction * load * steep
        trial = np.where(bears, -spring * (met.along_mm - np.where(bears, bare.anchor_mm, 0.0)), 0.0)
        slips = np.abs(trial) > most
        t = np.where(slips, np.sign(trial) * most, trial)
        direction = np.stack([-met.normal[1], met.normal[0]]) / steep
        by = np.where(slips, -np.sign(trial) * self.friction * steep * stiff * met.normal, -spring * met.growth)
        tangent = bare.tangent + direction[:, None] * by[None]
        anchor = np.where(slips & bears, met.along_mm + t / np.where(bears, spring, 1.0), bare.anchor_mm)
        return _Law(bare.force + t * direction, tangent, anchor)


def at_force(rubbing: Rubbing, force: float, deepest_mm: float = 2.0) -> Rubbed | None:
    """Between the two increments whose normal forces are around one; None where it is not reached."""
    last = None
    for found in rubbing.presses(deepest_mm):
        if found.normal_force >= force:
            if last is None:
                share, base = force / found.normal_force, np.zeros_like(found.force)
                return replace(found, force=base + share * found.force, doi_mm=share * found.doi_mm)
            share = (force - last.normal_force) / (found.normal_force - last.normal_force)
            between = last.force + share * (found.force - last.force)
            return replace(found, force=between, doi_mm=last.doi_mm + share * (found.doi_mm - last.doi_mm))
        last = found
    return None
