"""Times of the finger model on this machine, each beside a limit measured in the same run.

.venv/bin/python -m studies.speed.timing            # the tables of the README, about a minute and a half
.venv/bin/python -m studies.speed.timing --contact  # the second of them alone
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack
from threadpoolctl import threadpool_limits

from sim.config import FingertipConfig
from sim.contact.measured_profile import MeasuredProfile
from sim.fem.dissection import DissectionFactor
from sim.finger.mesh import build_mesh
from sim.finger.surface import FingertipSurface
from sim.models.cache import cache_dir
from sim.models.condensed import FiniteElements, discretise
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult
from studies.posix import resource

Shape = str | MeasuredProfile
Array = NDArray[np.float64]

SPLINE = MeasuredProfile("two ridges", (-1.2, -0.6, 0.0, 0.6, 1.2), (0.4, 0.0, 0.25, 0.0, 0.4))
_BARS_X_MM, _STEPS_X_MM = (-0.3, 0.0, 0.25), (2.0, 0.5, -0.5, -1.0, -1.63, -2.25, -3.69)
_FIVE_MM, _FOUR_MM = (0.2, 0.4, 0.6, 0.8, 1.0), (0.2, 0.4, 0.73, 1.0)
SCENES: list[tuple[str, Shape, tuple[float, ...], tuple[float, ...]]] = [
    ("bar 3.0, DOI 0.2–1.0", "bar:3.0", _BARS_X_MM, _FIVE_MM),
    ("bar 1.5, DOI 0.2–1.0", "bar:1.5", _BARS_X_MM, _FIVE_MM),
    ("step 1, DOI 0.2–1.0", "step:1", _STEPS_X_MM, _FOUR_MM),
    ("step 5, DOI 0.2–1.0", "step:5", _STEPS_X_MM, _FOUR_MM),
    ("cylinder 9, DOI 0.2–1.0", "cylinder:9", (0.0,), _FIVE_MM),
    ("grating 0.5, 1.2, DOI 0.2–1.0", "grating:0.5,1.2", _BARS_X_MM, _FIVE_MM),
    ("wedge 45, DOI 0.2–1.0", "wedge:45", _BARS_X_MM, _FIVE_MM),
    ("spline, two ridges, DOI 0.2–1.0", SPLINE, _BARS_X_MM, _FIVE_MM),
]


def seconds(action: Callable[[], object], repeats: int = 1) -> float:
    """The best wall time of several calls."""
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        best = min(best, time.perf_counter() - start)
    return float(best)


def dense_cholesky_s(n: int, repeats: int = 3) -> float:
    """One dense Cholesky factorisation of order n, LAPACK."""
    a = np.random.default_rng(0).standard_normal((n, n + 8))
    spd = a @ a.T
    return seconds(lambda: lapack.dpotrf(spd, lower=1, clean=0), repeats)


def problem() -> FiniteElements:
    """Return the matrix of the default finger."""
    config = FingertipConfig()
    return discretise(config, build_mesh(config, FingertipSurface.fit(config.geometry)))


def factorized_alone(matrix: FiniteElements) -> DissectionFactor:
    """Factorize the matrix of a finger and keep one unknown."""
    return DissectionFactor(matrix.upper, matrix.kept[:1], matrix.places)


def cold() -> Fingertip:
    """Build with an empty cache, then load from it."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["RIG_CACHE_DIR"] = folder
        start = time.perf_counter()
        finger = Fingertip.load()
        whole = time.perf_counter() - start
        warm = seconds(Fingertip.load, 3)
        size = sum(p.stat().st_size for p in cache_dir().glob("*.model"))
        del os.environ["RIG_CACHE_DIR"]
    n_patch, matrix = 2 * len(finger.model.patch), problem()
    alone = f"the same matrix factorized alone {seconds(lambda: factorized_alone(matrix)):.1f} s"
    laps = finger.model.timing_s
    print(f"{finger.model.nodes} nodes, patch of {len(finger.model.patch)} nodes, {os.cpu_count()} cores\n")
    print("| step | seconds | beside it |\n|---|---|---|")
    print(f"| mesh | {laps['mesh']:.2f} | |")
    print(f"| assembly | {laps['assembly']:.2f} | |")
    print(f"| condensation (factor and Schur complement) | {laps['condensation']:.2f} | {alone} |")
    print(f"| inverse of order {n_patch} | {laps['inverse']:.2f} | dense Cholesky of that order "
          f"{dense_cholesky_s(n_patch, 1):.2f} s |")  # fmt: skip
    print(f"| receptors | {laps['recovery'] + laps['receptors']:.2f} | |")
    print(f"| **cold, everything with the cache written ({size / 1e6:.0f} MB)** | **{whole:.1f}** | |")
    print(f"| **warm start, checksums verified** | **{warm:.2f}** | |")
    return finger


def indentations(finger: Fingertip) -> None:
    """Median and 95th percentile by DOI, of another depth at a place, and by force, one BLAS thread."""
    columns = ("scene", "active nodes", "by DOI, median / p95 (ms)", "another depth there (ms)",
               "by force 2.33 gwt (ms)", "passes, median / max", "residual, max",
               "dense Cholesky of the active set (ms)", "by DOI over that")  # fmt: skip
    print(f"\n| {' | '.join(columns)} |\n|{'---|' * len(columns)}")
    everything = []
    for name, shape, xs, dois in SCENES:
        results = [finger.indent(shape, x, doi_mm=doi) for x in xs for doi in dois]
        there = [_after(finger, shape, x, *pair) for x in xs for pair in zip(dois, np.roll(dois, 1), strict=True)]
        forced = [finger.indent(shape, x, force_gwt=2.33) for x in xs]
        active = int(np.median([r.state.active.sum() for r in results]))
        passes = [r.state.passes for r in results]
        with threadpool_limits(1):
            limit = 1e3 * dense_cholesky_s(active, 20)
        ms = [1e3 * r.contact_s for r in results]
        everything += ms
        print(f"| {name} | {active} | {_spent(results)} | {_spent(there)} | {_spent(forced)} | "
              f"{np.median(passes):.0f} / {max(passes)} | {max(r.state.residual for r in results):.0e} | "
              f"{limit:.2f} | {np.median(ms) / limit:.0f} |")  # fmt: skip
    print(f"\nall by DOI: median {np.median(everything):.0f} ms, p95 {np.percentile(everything, 95):.0f} ms")


def _after(
    finger: Fingertip, shape: str | MeasuredProfile, x_mm: float, doi: float, first: float
) -> IndentationResult:
    """A depth at a place where another one was pressed just before."""
    kept = finger.keeping_ways()
    kept.indent(shape, x_mm, doi_mm=first)
    return kept.indent(shape, x_mm, doi_mm=doi)


def _spent(results: list[IndentationResult]) -> str:
    """Median and 95th percentile of the processor times, ms."""
    ms = 1e3 * np.array([r.contact_s for r in results])
    return f"{np.median(ms):.0f} / {np.percentile(ms, 95):.0f}"


def main() -> None:
    """Print the tables."""
    indentations(Fingertip.load() if "--contact" in sys.argv else cold())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"peak memory: {peak:.0f} MB")


if __name__ == "__main__":
    main()
