"""Portable static condensation: nested dissection and dense fronts, on LAPACK alone.

A separator, the unknowns of one half that touch the other, splits a set in two, recursively. From the leaves up
each set is eliminated as one dense front (multifrontal Cholesky). BLAS does nearly all of the arithmetic.

Sources: A. George, SIAM J. Numer. Anal. 10 (1973) 345–363; J. W. H. Liu, SIAM Rev. 34 (1992) 82–109.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

from sim.compiling import compiled
from sim.errors import SimError

# --- dense ---
#
# Dense symmetric algebra by LAPACK.

Array = NDArray[np.float64]

_TILE = 512


class IndefiniteError(SimError, ValueError):
    """Error of a matrix that is not positive definite, with the order of the failing leading minor."""

    default_code = "not_positive_definite"

    def __init__(self, minor: int) -> None:
        super().__init__(f"the matrix is not positive definite (leading minor {minor})")


def inverse_spd(matrix: Array) -> Array:
    """Return the (n, n) inverse of a symmetric positive definite matrix. Raises IndefiniteError."""
    factor, info = lapack.dpotrf(matrix.T, lower=1, clean=0)
    if info:
        raise IndefiniteError(info)
    inverse, info = lapack.dpotri(factor, lower=1, overwrite_c=1)
    return mirror_lower(inverse).T


def mirror_lower(matrix: Array) -> Array:
    """Copy the lower triangle over the upper one, in place, tile by tile."""
    n = len(matrix)
    for i in range(0, n, _TILE):
        rows = slice(i, min(i + _TILE, n))
        matrix[rows, rows] = np.tril(matrix[rows, rows]) + np.tril(matrix[rows, rows], -1).T
        matrix[rows, rows.stop :] = matrix[rows.stop :, rows].T
    return matrix


Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Places = NDArray[Any]

# --- elimination ---
#
# Arrays are stored by rows. BLAS reads the same memory by columns: an upper triangle here is a lower one there.

_LEAF_PLACES = 80
_PANEL = 64  # columns solved at once; the rest of a triangular solution is matrix products


@dataclass(frozen=True)
class _Front:
    """Unknowns eliminated together, in elimination order, and the later ones that they touch."""

    own: slice
    after: Ints
    triangle: Array  # (n_own, n_own) Cholesky factor
    below: Array  # (n_after, n_own) of the factor


@dataclass(frozen=True)
class _Update:
    """Update matrix that an elimination passes to the later unknowns that it touched."""

    after: Ints
    matrix: Array  # (n_after, n_after), upper triangle


class DissectionFactor:
    """Factor of a symmetric positive definite matrix, condensed onto some of its unknowns."""

    def __init__(self, upper: sp.csr_array, kept: Ints, places: Places) -> None:
        """Factor an upper triangle (n, n), given ascending kept unknowns and positions (n, d) to cut by."""
        self.kept = kept
        n = upper.shape[0]
        free = np.ones(n, bool)
        free[kept] = False
        sites, site = np.unique(places, axis=0, return_inverse=True)
        parts = _cut(_touching(upper, site, len(sites)), sites, np.unique(site[free]))
        part = np.full(len(sites), len(parts))
        for k, (members, _) in enumerate(parts):
            part[members] = k
        part_of = np.where(free, part[site], len(parts))
        self._order = np.argsort(part_of, kind="stable")
        bounds = np.searchsorted(part_of[self._order], np.arange(len(parts) + 2))
        rank = np.empty(n, np.int64)
        rank[self._order] = np.arange(n)
        assembly = _Assembly(*_ordered(upper.indptr, upper.indices, upper.data, rank))
        self._fronts: list[_Front] = []
        waiting: list[_Update] = []
        for (start, stop), (_, children) in zip(pairwise(bounds[:-1]), parts, strict=True):
            mine = [waiting.pop() for _ in range(children)]
            waiting.append(self._eliminate(slice(start, stop), assembly, mine))
        last = slice(bounds[-2], bounds[-1])
        self._schur = assembly.front(last, np.zeros(0, np.int64), waiting)[0]

    @cached_property
    def compliance(self) -> Array:
        """(n_kept, n_kept) inverse of the Schur complement."""
        return inverse_spd(self._schur)

    def solve(self, loads: Array, at: Ints | None = None) -> Array:
        """Return (k, n) displacements under (k, n) loads, or those of the unknowns `at` alone."""
        x = np.asarray(loads, dtype=float).T[self._order]
        for front in self._fronts:
            if x[front.own].any():  # most parts have no load
                x[front.own] = blas.dtrsm(1.0, front.triangle, x[front.own], lower=1)
                x[front.after] -= front.below @ x[front.own]
        kept = slice(len(x) - len(self.kept), None)
        x[kept] = self.compliance @ x[kept]
        for front in self._needed_for(at):
            right = x[front.own] - front.below.T @ x[front.after]
            x[front.own] = blas.dtrsm(1.0, front.triangle, right, lower=1, trans_a=1)
        out = np.empty_like(x)
        out[self._order] = x
        return out.T if at is None else out[at].T

    def _needed_for(self, at: Ints | None) -> list[_Front]:
        """Return the fronts from the last to the first; a front without wanted unknowns may be needed by another."""
        if at is None:
            return self._fronts[::-1]
        wanted = np.zeros(len(self._order), bool)
        wanted[at] = True
        wanted = wanted[self._order]
        needed = []
        for front in self._fronts:
            if wanted[front.own].any():
                needed.append(front)
                wanted[front.after] = True
        return needed[::-1]

    def _eliminate(self, own: slice, assembly: "_Assembly", children: list[_Update]) -> _Update:
        after = assembly.later_than(own, children)
        rows, right, rest = assembly.front(own, after, children)
        triangle, info = lapack.dpotrf(rows.T, lower=1, overwrite_a=1)
        if info:
            raise IndefiniteError(own.start + info)
        below = right.T
        if len(after):
            _divide(below, triangle)
            rest = blas.dsyrk(-1.0, below, beta=1.0, c=rest.T, lower=1, overwrite_c=1).T
        self._fronts.append(_Front(own, after, triangle, below))
        return _Update(after, rest)


class _Assembly:
    """Sums of the matrix's entries and of updates, front by front; each entry belongs to the earlier unknown."""

    def __init__(self, first: Ints, later: Ints, value: Array) -> None:
        self._first = first  # (n + 1,) of each unknown's entries
        self._later = later  # the other unknown of each entry
        self._value = value
        self._place = np.zeros(len(first) - 1, np.int64)  # of each unknown in the present front
        self._squares = _Squares()

    def later_than(self, own: slice, children: list[_Update]) -> Ints:
        """Return the later unknowns that a front touches."""
        first, last = self._first[[own.start, own.stop]]
        touched = np.concatenate([self._later[first:last], *(child.after for child in children)])
        return np.unique(touched[touched >= own.stop])

    def front(self, own: slice, after: Ints, children: list[_Update]) -> tuple[Array, Array, Array]:
        """Return the front's own square, its rows right of it, and the children's square of the later unknowns."""
        n, m = own.stop - own.start, len(after)
        self._place[own], self._place[after] = np.arange(n), n + np.arange(m)
        rows, right, rest = np.zeros((n, n)), np.zeros((n, m)), self._squares.take(m)
        _add_entries(self._first, self._later, self._value, own.start, self._place, rows, right)
        for child in children:
            _add_update(child.matrix, self._place[child.after], rows, right, rest)
            self._squares.give_back(child.matrix)
        return rows, right, rest


class _Squares:
    """Memory of update matrices, used again: new memory costs more time than the sums in it."""

    def __init__(self) -> None:
        self._free: list[Array] = []

    def take(self, m: int) -> Array:
        """Return an (m, m) array with zeros in its upper triangle."""
        fitting = [k for k, one in enumerate(self._free) if one.size >= m * m]
        best = min(fitting, key=lambda k: self._free[k].size, default=None)
        memory = np.empty(m * m) if best is None else self._free.pop(best)
        square = memory[: m * m].reshape(m, m)
        _clear_upper(square)
        return square

    def give_back(self, square: Array) -> None:
        """Take the memory of an array that nobody needs any more."""
        while square.base is not None:
            square = square.base
        self._free.append(square.reshape(-1))


def _divide(below: Array, triangle: Array) -> None:
    """Overwrite B (m, n), stored by columns, with B L⁻ᵀ, some columns at a time."""
    for start in range(0, len(triangle), _PANEL):
        some = slice(start, start + _PANEL)
        if start:
            product = {"beta": 1.0, "trans_b": 1, "overwrite_c": 1}
            blas.dgemm(-1.0, below[:, :start], triangle[some, :start], c=below[:, some], **product)
        blas.dtrsm(1.0, triangle[some, some], below[:, some], side=1, lower=1, trans_a=1, overwrite_b=1)


@compiled
def _ordered(first: Ints, column: Ints, value: Array, rank: Ints) -> tuple[Ints, Ints, Array]:
    """Return the entries of an upper triangle in CSR in the order given by each unknown's rank."""
    n = len(rank)
    begin = np.zeros(n + 1, np.int64)
    for i in range(n):
        for entry in range(first[i], first[i + 1]):
            begin[min(rank[i], rank[column[entry]]) + 1] += 1
    begin = np.cumsum(begin)
    at, other, moved = begin[:-1].copy(), np.empty(len(value), np.int64), np.empty(len(value))
    for i in range(n):
        for entry in range(first[i], first[i + 1]):
            a, b = rank[i], rank[column[entry]]
            k = at[min(a, b)]
            at[min(a, b)] += 1
            other[k], moved[k] = max(a, b), value[entry]
    return begin, other, moved


@compiled
def _clear_upper(square: Array) -> None:
    for i in range(len(square)):
        square[i, i:] = 0.0


@compiled
def _add_entries(first: Ints, other: Ints, value: Array, start: int, place: Ints, rows: Array, right: Array) -> None:
    """Add the matrix's entries of a front's own unknowns, the first of which is `start`."""
    n = len(rows)
    for i in range(n):
        for entry in range(first[start + i], first[start + i + 1]):
            at = place[other[entry]]
            if at < n:
                rows[i, at] += value[entry]
            else:
                right[i, at - n] += value[entry]


@compiled
def _add_update(update: Array, at: Ints, rows: Array, right: Array, rest: Array) -> None:
    """Add an upper triangle at ascending positions of a front, whose three parts are stored separately."""
    n, own = len(rows), np.searchsorted(at, len(rows))
    for a in range(own):
        for b in range(a, own):
            rows[at[a], at[b]] += update[a, b]
        for b in range(own, len(at)):
            right[at[a], at[b] - n] += update[a, b]
    for a in range(own, len(at)):
        for b in range(a, len(at)):
            rest[at[a] - n, at[b] - n] += update[a, b]


# --- order ---


def _touching(upper: sp.csr_array, site: Ints, n_sites: int) -> sp.csr_array:
    """Return the (n_sites, n_sites) graph of sites with coupled unknowns."""
    entries = upper.tocoo()
    there = (np.ones(entries.nnz, bool), (site[entries.row], site[entries.col]))
    graph = sp.csr_array(there, shape=(n_sites, n_sites))
    return sp.csr_array(graph + graph.T)


def _cut(graph: sp.csr_array, places: Places, chosen: Ints) -> list[tuple[Ints, int]]:
    """Return sets in elimination order, each with the number of waiting earlier sets that it absorbs."""
    found = _halves(graph, places, chosen) if len(chosen) > _LEAF_PLACES else iter(())
    best = min(found, key=lambda cut: cut[0], default=None)
    if best is None:
        return [(chosen, 0)]
    _, low, between = best
    halves = (_cut(graph, places, chosen[half]) for half in (low & ~between, ~low))
    return [*next(halves), *next(halves), (chosen[between], 2)]


def _halves(graph: sp.csr_array, places: Places, chosen: Ints) -> Iterator[tuple[float, Bools, Bools]]:
    """Yield, for each axis, a cut's cost, its lower half, and the separator: the part that touches the upper half."""
    rows = graph[chosen]
    for here in places[chosen].T:
        low = here < np.median(here) if here.min() < np.median(here) else here == here.min()
        upper_half = np.zeros(graph.shape[0], bool)
        upper_half[chosen[~low]] = True
        between = low & (rows @ upper_half)
        if low.any() and not between.any():
            between[np.argmax(low)] = True  # the halves do not touch, so any site separates them
        larger, smaller = sorted([int((low & ~between).sum()), int((~low).sum())], reverse=True)
        if smaller:
            yield float(between.sum()) * (0.5 + larger / len(chosen)), low, between
