"""Elastic force of one shape over position, depth and tissue: computed at Chebyshev nodes, interpolated between.

The logarithm of force is smooth in the logarithms of depth and moduli, and in the position. Stiffening is no axis: it
enters by the factor of `sim/models/stiffening`, whose parts have polynomials of their own. Linear tissue has none of
the factor, as in the model.
"""

import gzip
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial, reduce
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.contact.shapes import contents
from sim.errors import ModelRangeError
from sim.models.cache import Arrays, cached_arrays, content_key, path_of, simulator_code
from sim.models.fingertip import Fingertip
from sim.models.stiffening import FORCE
from sim.workers import Work, one_by_one

Array = NDArray[np.float64]

Made = Callable[[Mapping[str, float]], Fingertip]
"""Builds the finger of some tissue parameters, at stiffness 1 and any stiffening."""

SHALLOWEST_MM = 0.03
_TOUCH_NODES = 9
_LESS_DEEP = 0.9  # factor for a table that cannot reach its depth
LEAST_DEEP_MM = 0.3
"""Least depth of a table: a shape that cannot be pressed so deep has none."""

_SHALLOW_EXPONENT = 1.5  # below the shallowest node: Hertz


@dataclass(frozen=True)
class ChebyshevAxis:
    """Axis with n Chebyshev nodes between low and high."""

    name: str
    low: float
    high: float
    n: int

    @cached_property
    def nodes(self) -> Array:
        """(n,) Chebyshev nodes of the first kind."""
        t = np.cos(np.pi * (np.arange(self.n) + 0.5) / self.n)
        return np.asarray(0.5 * (self.low + self.high) + 0.5 * (self.high - self.low) * t)

    def basis(self, value: Array) -> Array:
        """Return the (…, n) weights of the nodes; values outside the range are clipped."""
        t = np.clip((2 * np.asarray(value) - self.low - self.high) / (self.high - self.low), -1.0, 1.0)
        return np.asarray(self._polynomials(t) @ self._inverse)

    @cached_property
    def _inverse(self) -> Array:
        t = np.cos(np.pi * (np.arange(self.n) + 0.5) / self.n)
        return np.asarray(np.linalg.inv(self._polynomials(t)))

    def _polynomials(self, t: Array) -> Array:
        return np.asarray(np.polynomial.chebyshev.chebvander(t, self.n - 1))


@dataclass(frozen=True)
class Scope:
    """Range of a table: tissue, positions and depths (mm)."""

    tissue: tuple[ChebyshevAxis, ...]
    farthest_mm: float  # largest distance from the pad center
    depth_mm: tuple[float, float]
    places: int = 7
    depths: int = 9

    @cached_property
    def x(self) -> ChebyshevAxis:
        """Axis of the positions of the indentor."""
        return ChebyshevAxis("x_mm", -self.farthest_mm, self.farthest_mm, self.places)

    @cached_property
    def touch_x(self) -> ChebyshevAxis:
        """Finer axis of positions, for the height of first touch."""
        return ChebyshevAxis("x_mm", -self.farthest_mm, self.farthest_mm, _TOUCH_NODES)

    @cached_property
    def depth(self) -> ChebyshevAxis:
        """Axis of the logarithm of depth."""
        low, high = np.log(self.depth_mm)
        return ChebyshevAxis("ln_doi_mm", float(low), float(high), self.depths)

    def down_to(self, deepest_mm: float) -> "Scope":
        """Return the range with a smaller depth."""
        return replace(self, depth_mm=(self.depth_mm[0], deepest_mm))

    @property
    def about(self) -> list[list[str | float]]:
        """Name, bounds and number of nodes of all axes."""
        return [[axis.name, axis.low, axis.high, axis.n] for axis in (*self.tissue, self.x, self.depth)]


class ShapeTable:
    """Forces of one indentor on the fingers of a scope."""

    def __init__(self, indentor: str, scope: Scope, arrays: Arrays) -> None:
        self.indentor, self.arrays = indentor, arrays
        self.scope = scope.down_to(float(arrays["deepest_mm"]))
        # arrays (*tissue, positions, depths)
        self.ln_force = np.asarray(arrays["ln_force"], dtype=float)  # ln gwt of linear tissue
        self.ln_geometric = np.asarray(arrays["ln_geometric"], dtype=float)  # ln of the factor of finite strain
        self.ln_strain = np.asarray(arrays["ln_strain"], dtype=float)  # strain of the stiffening law
        self.touch_mm = np.asarray(arrays["touch_mm"], dtype=float)  # (9,) above the apex
        self.error = float(arrays["error"])  # rms error of ln force between the nodes

    @classmethod
    def read_or_make(
        cls, indentor: str, scope: Scope, made: Made, made_of: object, work: Work = one_by_one
    ) -> "ShapeTable":
        """Return the table from the cache, or compute it; made_of: key of the fingers. Raises ModelRangeError."""
        key = _key(indentor, scope, made_of)
        return cls(indentor, scope, cached_arrays(key, lambda: _pressed(indentor, scope, made, work), "answers")[0])

    @staticmethod
    def kept(indentor: str, scope: Scope, made_of: object) -> bool:
        """Return whether the table is cached."""
        return path_of(_key(indentor, scope, made_of), "answers").exists()

    def tissue_basis(self, values: Sequence[Array]) -> Array:
        """Return the (n, tissue nodes) weights of (n,) parameters, in the order of the axes."""
        each = [axis.basis(value) for axis, value in zip(self.scope.tissue, values, strict=True)]
        return reduce(lambda a, b: (a[:, :, None] * b[:, None, :]).reshape(len(a), -1), each)

    def touches_mm(self, x_mm: Array) -> Array:
        """Return the (n,) heights of the indentor at first touch, above the apex (mm)."""
        return np.asarray(self.scope.touch_x.basis(x_mm) @ self.touch_mm)

    def forces_gwt(self, tissue: Array, stiffening: Array, x_mm: Array, depth_mm: Array) -> Array:
        """Return (n, m) forces at stiffness 1 (gwt) for (n, tissue nodes) weights and (n, m) depths; 0 in air.

        A stiffening of 0 is linear tissue.
        """
        x, depth = self.scope.x.basis(x_mm), self.scope.depth
        shallow_mm = self.scope.depth_mm[0]
        ln_d = np.log(np.maximum(depth_mm, 1e-6))
        by_depth = depth.basis(ln_d)
        ln_f, ln_geometric, ln_strain = (
            self._between(one, tissue, x, by_depth) for one in (self.ln_force, self.ln_geometric, self.ln_strain)
        )
        stiffens = stiffening[:, None] > 0
        ln_f = ln_f + np.where(stiffens, FORCE.log(ln_geometric, np.exp(ln_strain), stiffening[:, None]), 0.0)
        ln_f = ln_f + _SHALLOW_EXPONENT * np.minimum(ln_d - np.log(shallow_mm), 0.0)
        return np.where(depth_mm > 0, np.exp(ln_f), 0.0)

    def _between(self, at_nodes: Array, tissue: Array, x: Array, depth: Array) -> Array:
        """Return the (n, m) values from nodes, by weights of tissue (n, t), position (n, x) and depth (n, m, d)."""
        flat = at_nodes.reshape(tissue.shape[1], -1)
        by_depth = np.einsum("nxd,nx->nd", (tissue @ flat).reshape(len(tissue), self.scope.places, -1), x)
        return np.asarray(np.einsum("nmd,nd->nm", depth, by_depth))


def _key(indentor: str, scope: Scope, made_of: object) -> str:
    return content_key(["meeting", indentor, *contents([indentor]), scope.about, made_of, simulator_code()])


def _pressed(indentor: str, scope: Scope, made: Made, work: Work) -> Arrays:
    """Return the arrays to the depth of the scope, or to the largest that the mesh allows. Raises ModelRangeError."""
    while True:
        try:
            return _pressed_to_depth(indentor, scope, made, work)
        except ModelRangeError:
            scope = scope.down_to(_LESS_DEEP * scope.depth_mm[1])
            if scope.depth_mm[1] < LEAST_DEEP_MM:
                raise


def _pressed_to_depth(indentor: str, scope: Scope, made: Made, work: Work) -> Arrays:
    axes = np.meshgrid(*(axis.nodes for axis in scope.tissue), indexing="ij")
    names, nodes = [axis.name for axis in scope.tissue], np.stack(axes, axis=-1).reshape(-1, len(axes))
    tissues = [dict(zip(names, node, strict=True)) for node in nodes.tolist()]
    pressed = work(f"fingers under {indentor}", partial(_responses_at_positions, indentor, scope, made), tissues)
    found = np.array(list(pressed)).reshape(*axes[0].shape, scope.places, len(_RESPONSES), scope.depths)
    finger = made(tissues[0])
    touch_mm = [finger.touch_height_mm(indentor, x) - finger.apex_height_mm for x in scope.touch_x.nodes.tolist()]
    arrays: Arrays = {**dict(zip(_RESPONSES, np.moveaxis(found, -2, 0), strict=True)), "touch_mm": np.array(touch_mm)}
    arrays |= {"error": np.array(0.0), "deepest_mm": np.array(scope.depth_mm[1])}
    arrays["error"] = np.array(_own_error(ShapeTable(indentor, scope, arrays), made))
    return arrays


def _responses_at_positions(indentor: str, scope: Scope, made: Made, tissue: Mapping[str, float]) -> Array:
    """Return (positions, 3, depths) of `_responses` on one finger. Raises ModelRangeError."""
    finger, doi_mm = made(tissue), np.exp(scope.depth.nodes)
    return np.array([_responses(finger, indentor, x, doi_mm) for x in scope.x.nodes.tolist()])


_RESPONSES = ("ln_force", "ln_geometric", "ln_strain")


def _responses(finger: Fingertip, indentor: str, x_mm: float, doi_mm: Array) -> Array:
    """Return (3, m): ln force of linear tissue, ln of the factor of finite strain, ln of the strain of the law."""
    answers, state = np.empty((len(_RESPONSES), len(doi_mm))), None
    for k in np.argsort(doi_mm):
        found = finger.indent(indentor, x_mm, doi_mm=float(doi_mm[k]), start=state)
        if not found.state.converged:
            raise ModelRangeError(
                f"{indentor} at x = {x_mm:.2f} mm, DOI {float(doi_mm[k]):.2f} mm: the solver did not converge, so "
                "nothing can be learned",
                "nothing_to_learn",
            )
        press, linear_gwt, state = found.strained.press, found.force_gwt / found.strained.force, found.state
        answers[:, k] = np.log(linear_gwt), FORCE.geometric(press), np.log(FORCE.strained(press))
    return answers


_TRIED, _MOST_STIFFENING = 6, 1.0


def _own_error(table: ShapeTable, made: Made) -> float:
    """Return the rms error of ln force at positions, depths and tissues between the nodes."""
    chance, scope, off = np.random.default_rng(0), table.scope, []
    for _ in range(_TRIED):
        tissue = {axis.name: float(chance.uniform(axis.low, axis.high)) for axis in scope.tissue}
        x_mm = float(chance.uniform(-1, 1) * scope.farthest_mm)
        doi_mm = np.array([np.exp(chance.uniform(*np.log((0.1, scope.depth_mm[1]))))])
        basis = table.tissue_basis([np.array([tissue[axis.name]]) for axis in scope.tissue])
        stiffening = float(chance.uniform(0.0, _MOST_STIFFENING))
        predicted = table.forces_gwt(basis, np.array([stiffening]), np.array([x_mm]), doi_mm[None])
        ln_force, ln_geometric, ln_strain = _responses(made(tissue), table.indentor, x_mm, doi_mm)
        direct = ln_force + FORCE.log(ln_geometric, np.exp(ln_strain), stiffening)
        off.append(float(np.log(predicted[0, 0]) - direct[0]))
    return float(np.sqrt(np.mean(np.square(off))))


# --- shipped ---
#
# Tables of the default finger under common shapes, which are part of the package.
#
# `python -m studies.identification.shipped` makes them; `tests/rig/test_identification_shipped.py` compares them with
# direct presses.

FILE = "meeting_tables.json.gz"
_DIGITS = 5  # digits of ln force, and of a height in mm


def shipped(indentor: str, scope: Scope) -> ShapeTable | None:
    """Return the packaged table of the default finger; None for another shape or scope."""
    kept = _content()
    if indentor not in kept["tables"] or not _alike(kept["scope"], scope.about):
        return None
    arrays: Arrays = {name: np.array(values) for name, values in kept["tables"][indentor].items()}
    return ShapeTable(indentor, scope, arrays)


def as_json(tables: Iterable[ShapeTable]) -> str:
    """Return the content of the file, for tables of one scope."""
    tables = list(tables)
    arrays = {table.indentor: {name: _rounded(values) for name, values in table.arrays.items()} for table in tables}
    return json.dumps({"scope": tables[0].scope.about, "tables": arrays})


def _rounded(values: NDArray[np.generic]) -> Any:
    return np.round(np.asarray(values, dtype=float), _DIGITS).tolist()


def _alike(kept: list[list[Any]], about: list[list[Any]]) -> bool:
    """Return whether two scopes are equal except for rounding."""
    names = [[axis[0], axis[3]] for axis in kept] == [[axis[0], axis[3]] for axis in about]
    return names and bool(np.allclose([axis[1:3] for axis in kept], [axis[1:3] for axis in about], rtol=1e-9))


@cache
def _content() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(gzip.decompress((files("sim") / "data" / FILE).read_bytes()))
    return content
