"""Cold build of the default finger beside the factorization of its matrix alone, and their limits, on one thread.

.venv/bin/python -m studies run cold-build  # one minute
"""

import os
import tempfile
import time
from collections.abc import Callable

import numpy as np
from threadpoolctl import threadpool_limits

from sim.config import FingertipConfig
from sim.fem.dissection import DissectionFactor
from sim.finger.mesh import build_mesh
from sim.finger.surface import FingertipSurface
from sim.models.condensed import FiniteElements, discretise
from sim.models.fingertip import Fingertip
from studies.registry import show
from studies.verification import mkl_condensation
from studies.verification.mkl_condensation import PardisoFactor

REPEATS = 5


def processor_s(action: Callable[[], object]) -> float:
    """Return the shortest processor time of some calls (s)."""
    best = np.inf
    for _ in range(REPEATS):
        start = time.process_time()
        action()
        best = min(best, time.process_time() - start)
    return float(best)


def product_rate(n: int = 3000) -> float:
    """Return the rate of a dense product of order n (flop/s)."""
    a = np.random.default_rng(0).standard_normal((n, n))
    return 2 * n**3 / processor_s(lambda: a @ a)


def copy_rate(n: int = 30_000_000) -> float:
    """Return the rate at which an array is copied (bytes/s, read and written)."""
    a = np.ones(n)
    b = np.empty(n)
    return 16 * n / processor_s(lambda: np.copyto(b, a))


def work(factor: DissectionFactor) -> tuple[float, float]:
    """Return the flops of an elimination, and the bytes that its updates read and write."""
    own, after = (
        np.array([shape[axis] for shape in (front.below.shape for front in factor._fronts)], float) for axis in (1, 0)
    )
    flops = (own**3 / 3 + own**2 * after + own * after**2).sum()
    return float(flops), float((8 * after**2 / 2 * 4).sum())  # cleared, summed into (read and written), read


def cold() -> Fingertip:
    """Build the default finger with an empty cache."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["RIG_CACHE_DIR"] = folder
        try:
            return Fingertip.load()
        finally:
            del os.environ["RIG_CACHE_DIR"]


def problem() -> FiniteElements:
    """Return the matrix of the default finger."""
    config = FingertipConfig()
    return discretise(config, build_mesh(config, FingertipSurface.fit(config.geometry)))


def factorized_alone(matrix: FiniteElements) -> DissectionFactor:
    """Factorize the matrix of a finger and keep one unknown."""
    return DissectionFactor(matrix.upper, matrix.kept[:1], matrix.places)


def difference(matrix: FiniteElements) -> float:
    """Return the largest difference between the compliances of both solvers, relative to the largest compliance."""
    peer = PardisoFactor(matrix.upper, matrix.kept).compliance
    ours = DissectionFactor(matrix.upper, matrix.kept, matrix.places).compliance
    return float(np.abs(ours - peer).max() / np.abs(peer).max())


def main() -> None:
    """Measure, print and write the table."""
    with threadpool_limits(1):
        cold()  # loops are loaded
        matrix = problem()
        rows = []
        rate, copied = product_rate(), copy_rate()
        condensed = DissectionFactor(matrix.upper, matrix.kept, matrix.places)
        flops, moved = work(condensed)
        del condensed
        rows.append((f"limit: {flops / 1e9:.0f} Gflop at the rate of a dense product ({rate / 1e9:.0f} Gflop/s)",
                     f"{flops / rate:.2f}", ""))  # fmt: skip
        rows.append((f"limit: {moved / 1e9:.1f} GB of updates at the rate of a copy ({copied / 1e9:.1f} GB/s)",
                     f"{moved / copied:.2f}", ""))  # fmt: skip
        ours = processor_s(lambda: DissectionFactor(matrix.upper, matrix.kept, matrix.places))
        rows.append(
            ("condensation onto 2 400 unknowns", f"{ours:.2f}", f"{ours / (flops / rate):.2f} of the first limit")
        )
        alone = processor_s(lambda: factorized_alone(matrix))
        rows.append(("the same matrix factorized alone", f"{alone:.2f}", ""))
        if mkl_condensation.available():
            schur = processor_s(lambda: PardisoFactor(matrix.upper, matrix.kept).close())
            rows.append(
                ("condensation by MKL PARDISO", f"{schur:.2f}", f"compliances differ by {difference(matrix):.0e}")
            )
            peer = processor_s(lambda: PardisoFactor(matrix.upper, matrix.kept[:1]).close())
            rows.append(("the same matrix factorized alone by MKL PARDISO", f"{peer:.2f}", ""))
        whole = processor_s(cold)
        beside = f"{whole / alone:.2f} of the factorization alone"
        if mkl_condensation.available():
            beside += f", {whole / peer:.2f} of MKL's"
        rows.append(("cold build, with the cache written", f"{whole:.2f}", beside))
    show(("what", "processor (s)", "beside it"), rows)


if __name__ == "__main__":
    main()
