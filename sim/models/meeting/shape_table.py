"""Elastic force of one shape over place, depth and tissue: direct presses at Chebyshev's nodes, polynomials between.

The logarithm of force is smooth in the logarithms of depth and moduli, and in the place.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from sim.models.cache import Arrays, cached_arrays, content_key, simulator_code
from sim.models.errors import ModelRangeError
from sim.models.fingertip import Fingertip

Array = NDArray[np.float64]

Made = Callable[[Mapping[str, float]], Fingertip]
"""The finger of some tissue parameters, at stiffness 1."""

SHALLOWEST_MM = 0.03
_TOUCH_NODES = 9
_SHALLOW_EXPONENT = 1.5  # below the shallowest node: Hertz


@dataclass(frozen=True)
class Axis:
    """A range with Chebyshev's nodes."""

    name: str
    low: float
    high: float
    n: int

    @cached_property
    def nodes(self) -> Array:
        """(n,) of the first kind."""
        return self._scaled(np.cos(np.pi * (np.arange(self.n) + 0.5) / self.n))

    def basis(self, value: Array) -> Array:
        """(…, n) how much the value at each node counts; beyond the range as at its end."""
        t = np.clip((2 * np.asarray(value) - self.low - self.high) / (self.high - self.low), -1.0, 1.0)
        return np.asarray(self._polynomials(t) @ self._inverse)

    @cached_property
    def _inverse(self) -> Array:
        t = np.cos(np.pi * (np.arange(self.n) + 0.5) / self.n)
        return np.asarray(np.linalg.inv(self._polynomials(t)))

    def _polynomials(self, t: Array) -> Array:
        return np.asarray(np.polynomial.chebyshev.chebvander(t, self.n - 1))

    def _scaled(self, t: Array) -> Array:
        return np.asarray(0.5 * (self.low + self.high) + 0.5 * (self.high - self.low) * t)


@dataclass(frozen=True)
class Scope:
    """Where a table holds: tissue, places and depths."""

    tissue: tuple[Axis, ...]
    farthest_mm: float  # from the pad's centre
    depth_mm: tuple[float, float]
    places: int = 7
    depths: int = 9

    @property
    def x(self) -> Axis:
        """Places of the indentor."""
        return Axis("x_mm", -self.farthest_mm, self.farthest_mm, self.places)

    @property
    def touch_x(self) -> Axis:
        """The same, closer together: of first touch, which is geometry alone."""
        return Axis("x_mm", -self.farthest_mm, self.farthest_mm, _TOUCH_NODES)

    @property
    def depth(self) -> Axis:
        """Logarithm of depth."""
        low, high = np.log(self.depth_mm)
        return Axis("ln_doi_mm", float(low), float(high), self.depths)


class ShapeTable:
    """One indentor's forces on the fingers of a scope."""

    def __init__(self, indentor: str, scope: Scope, arrays: Arrays) -> None:
        self.indentor, self.scope = indentor, scope
        self.ln_force = np.asarray(arrays["ln_force"], dtype=float)  # (*tissue, places, depths), ln gwt
        self.touch_mm = np.asarray(arrays["touch_mm"], dtype=float)  # (9,) from the apex
        self.error = float(arrays["error"])  # rms of ln force, of direct presses between the nodes

    @classmethod
    def read_or_made(cls, indentor: str, scope: Scope, made: Made, made_of: object) -> "ShapeTable":
        """From the cache, or pressed; made_of: what says which fingers these are. Raises ModelRangeError."""
        about = [(axis.name, axis.low, axis.high, axis.n) for axis in (*scope.tissue, scope.x, scope.depth)]
        key = content_key(["meeting", indentor, about, made_of, simulator_code()])
        return cls(indentor, scope, cached_arrays(key, lambda: _pressed(indentor, scope, made), "answers")[0])

    def tissue_basis(self, values: Sequence[Array]) -> Array:
        """(n, tissue nodes) of (n,) parameters, in the order of the scope's axes."""
        each = [axis.basis(value) for axis, value in zip(self.scope.tissue, values, strict=True)]
        return reduce(lambda a, b: (a[:, :, None] * b[:, None, :]).reshape(len(a), -1), each)

    def touches_mm(self, x_mm: Array) -> Array:
        """(n,) height of the indentor at first touch, from the apex."""
        return np.asarray(self.scope.touch_x.basis(x_mm) @ self.touch_mm)

    def forces_gwt(self, tissue: Array, x_mm: Array, depth_mm: Array) -> Array:
        """(n, m) at stiffness 1, of (n, tissue nodes), (n,) places and (n, m) depths; none above the skin."""
        x, depth = self.scope.x.basis(x_mm), self.scope.depth
        flat = self.ln_force.reshape(tissue.shape[1], -1)
        by_depth = np.einsum("nxd,nx->nd", (tissue @ flat).reshape(len(tissue), self.scope.places, -1), x)
        shallow_mm = self.scope.depth_mm[0]
        ln_d = np.log(np.maximum(depth_mm, 1e-6))
        ln_f = np.einsum("nmd,nd->nm", depth.basis(ln_d), by_depth)
        ln_f = ln_f + _SHALLOW_EXPONENT * np.minimum(ln_d - np.log(shallow_mm), 0.0)
        return np.where(depth_mm > 0, np.exp(ln_f), 0.0)


def _pressed(indentor: str, scope: Scope, made: Made) -> Arrays:
    nodes = np.stack(np.meshgrid(*(axis.nodes for axis in scope.tissue), indexing="ij"), axis=-1)
    names = [axis.name for axis in scope.tissue]
    doi_mm = np.exp(scope.depth.nodes)
    ln_force = np.empty((*nodes.shape[:-1], scope.places, scope.depths))
    finger = None
    for at in np.ndindex(nodes.shape[:-1]):
        finger = made(dict(zip(names, nodes[at].tolist(), strict=True)))
        ln_force[at] = [_way(finger, indentor, x, doi_mm) for x in scope.x.nodes.tolist()]
    assert finger is not None
    touch_mm = [finger.touch_height_mm(indentor, x) - finger.apex_height_mm for x in scope.touch_x.nodes.tolist()]
    arrays: Arrays = {"ln_force": ln_force, "touch_mm": np.array(touch_mm), "error": np.array(0.0)}
    arrays["error"] = np.array(_own_error(ShapeTable(indentor, scope, arrays), made))
    return arrays


def _way(finger: Fingertip, indentor: str, x_mm: float, doi_mm: Array) -> Array:
    """(m,) ln force on the way down."""
    forces, state = np.empty(len(doi_mm)), None
    for k in np.argsort(doi_mm):
        found = finger.indent(indentor, x_mm, doi_mm=float(doi_mm[k]), start=state)
        if not found.state.converged:
            raise ModelRangeError(f"{indentor} at x = {x_mm:.2f} mm, DOI {doi_mm[k]:.2f} mm: no answer to learn from")
        forces[k], state = found.force_gwt, found.state
    return np.log(forces)


_TRIED = 6


def _own_error(table: ShapeTable, made: Made) -> float:
    """Rms of ln force at places, depths and tissues between the nodes."""
    chance, scope, off = np.random.default_rng(0), table.scope, []
    for _ in range(_TRIED):
        tissue = {axis.name: float(chance.uniform(axis.low, axis.high)) for axis in scope.tissue}
        x_mm = float(chance.uniform(-1, 1) * scope.farthest_mm)
        doi_mm = np.array([np.exp(chance.uniform(*np.log((0.1, scope.depth_mm[1]))))])
        basis = table.tissue_basis([np.array([tissue[axis.name]]) for axis in scope.tissue])
        foreseen = table.forces_gwt(basis, np.array([x_mm]), doi_mm[None])
        off.append(float(np.log(foreseen[0, 0]) - _way(made(tissue), table.indentor, x_mm, doi_mm)[0]))
    return float(np.sqrt(np.mean(np.square(off))))
