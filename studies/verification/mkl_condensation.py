"""Static condensation by MKL PARDISO's Schur complement (iparm(36)); x86-64 only.

Source: oneMKL Developer Reference, PARDISO, iparm(36) and phases 331/333.
"""

import ctypes
from collections.abc import Callable
from functools import cache, cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sim.errors import SimError
from sim.fem.dissection import inverse_spd

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_ANALYSE_FACTORISE, _FORWARD, _BACKWARD, _RELEASE = 12, 331, 333, -1
_SYMMETRIC_POSITIVE_DEFINITE = 2


@cache
def _routine() -> Callable[..., None]:
    """Load MKL's `pardiso` once; pypardiso searches the disk for it, which takes a quarter of a second."""
    import pypardiso

    return pypardiso.PyPardisoSolver()._mkl_pardiso


def available() -> bool:
    """Return whether MKL can be loaded."""
    try:
        _routine()
    except (ImportError, OSError):
        return False
    return True


class PardisoError(SimError, RuntimeError):
    """Error of PARDISO, with its error number."""

    default_code = "pardiso_failed"


class PardisoFactor:
    """Factor of a symmetric positive definite matrix, condensed onto some of its unknowns."""

    def __init__(self, upper: sp.csr_array, kept: Ints) -> None:
        """Factor an upper triangle (n, n) in CSR, given the ascending numbers of the unknowns to keep."""
        self._routine = _routine()
        self._n = upper.shape[0]
        self.kept = kept
        upper.sort_indices()
        self._ia, self._ja = upper.indptr.astype(np.int32), upper.indices.astype(np.int32)
        self._a = np.ascontiguousarray(upper.data)
        self._perm = np.zeros(self._n, np.int32)
        self._perm[kept] = 1
        self._pt = np.zeros(64, np.int64)
        self._iparm = np.zeros(64, np.int32)
        self._iparm[[0, 1, 34, 35]] = (
            1,
            2,
            1,
            2,
        )  # own settings, METIS, zero-based, Schur with the factor kept
        self._iparm[23] = 1  # two-level parallel factorization
        self._schur = np.zeros((len(kept), len(kept)))
        self._call(_ANALYSE_FACTORISE, np.zeros(self._n), self._schur)

    @cached_property
    def compliance(self) -> Array:
        """(n_kept, n_kept) inverse of the Schur complement."""
        return inverse_spd(self._schur)

    def solve(self, loads: Array) -> Array:
        """Return (k, n) displacements under (k, n) loads."""
        reduced = self._reduce(loads)
        reduced[:, self.kept] = reduced[:, self.kept] @ self.compliance
        out = np.zeros_like(reduced)
        self._call(_BACKWARD, reduced, out)
        return out

    def _reduce(self, loads: Array) -> Array:
        """Eliminate forward: the kept columns become the loads on the Schur complement."""
        loads = np.ascontiguousarray(loads, dtype=float)
        out = np.zeros_like(loads)
        self._call(_FORWARD, loads, out)
        return out

    def close(self) -> None:
        """Free MKL's memory."""
        if self._pt.any():
            self._call(_RELEASE, np.zeros(1), np.zeros(1))
            self._pt[:] = 0

    def __enter__(self) -> "PardisoFactor":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _call(self, phase: int, b: Array, x: Array) -> None:
        n_loads = b.shape[0] if b.ndim == 2 else 1
        error = ctypes.c_int32(0)
        self._routine(
            self._pt.ctypes.data_as(ctypes.POINTER(ctypes.c_int64)),
            _int(1),
            _int(1),
            _int(_SYMMETRIC_POSITIVE_DEFINITE),
            _int(phase),
            _int(self._n),
            self._a.ctypes.data_as(ctypes.c_void_p),
            _ints(self._ia),
            _ints(self._ja),
            _ints(self._perm),
            _int(n_loads),
            _ints(self._iparm),
            _int(0),
            b.ctypes.data_as(ctypes.c_void_p),
            x.ctypes.data_as(ctypes.c_void_p),
            ctypes.byref(error),
        )
        if error.value:
            raise PardisoError("PARDISO phase {phase} failed with error {number}", phase=phase, number=error.value)


def _int(value: int) -> object:
    return ctypes.byref(ctypes.c_int32(value))


def _ints(values: NDArray[np.int32]) -> object:
    return values.ctypes.data_as(ctypes.POINTER(ctypes.c_int32))
