"""What a candidate answers in each scene, and what that costs."""

import resource
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack
from threadpoolctl import threadpool_limits

from sim.fem import pardiso
from sim.fem.pardiso import PardisoFactor
from sim.finger.mesh import build_mesh
from sim.finger.surface import FingertipSurface
from sim.models.catalogue import load
from sim.models.discretised import discretise
from sim.models.processes.workers import in_processes
from sim.models.results.indentation import IndentationResult
from sim.speed_and_error.candidates import Candidate
from sim.speed_and_error.scenes import Scene

Array = NDArray[np.float64]

QUANTITIES = ("force", "width", "sed", "ep1")
_FEW = 5  # repetitions of the limit, of which the fastest counts


@dataclass(frozen=True)
class Answer:
    """What one scene came to."""

    force_mm2: float  # over E(epidermis), of which no error depends; of a section in mm
    width_mm: float
    sed: tuple[float, ...]
    ep1: tuple[float, ...]
    residual: float
    passes: int
    seconds: float
    limit_s: float  # one dense Cholesky factorisation of the order of the points in contact

    def value(self, quantity: str) -> Array:
        """(k,) the quantity: one number, or one for each receptor."""
        values = {"force": (self.force_mm2,), "width": (self.width_mm,), "sed": self.sed, "ep1": self.ep1}
        return np.array(values[quantity])


@dataclass(frozen=True)
class Measured:
    """A candidate with its answers and costs."""

    candidate: Candidate
    nodes: int
    patch_nodes: int
    build_s: float  # from nothing, without the cache
    timing_s: dict[str, float]
    memory_mb: float  # peak of a process that does nothing else
    factor_s: float | None  # one sparse factorisation of the same matrix, without its Schur complement
    answers: dict[Scene, Answer]

    @property
    def contact_s(self) -> float:
        """Median time of one indentation."""
        return float(np.median([answer.seconds for answer in self.answers.values()]))

    @property
    def limit_s(self) -> float:
        """Median limit of an indentation."""
        return float(np.median([answer.limit_s for answer in self.answers.values()]))


def measure(candidates: Iterable[Candidate], scenes: Sequence[Scene]) -> Iterator[Measured]:
    """Each candidate in a process of its own, one after the other."""
    measured = partial(_measured, scenes=tuple(scenes))
    for candidate in candidates:
        yield from in_processes(measured, [candidate], 1)


def _measured(candidate: Candidate, scenes: tuple[Scene, ...]) -> Measured:
    start = time.perf_counter()
    finger = load(candidate.model, candidate.config, cached=False)
    model = finger.model
    build_s = time.perf_counter() - start
    answers = {scene: answered(finger.indent(scene.shape, scene.x_mm, doi_mm=scene.doi_mm)) for scene in scenes}
    memory_mb = peak_memory_mb()
    factor_s = sparse_factor_s(candidate) if candidate.model == "finger" else None
    return Measured(candidate, model.nodes, len(model.patch), build_s, model.timing_s, memory_mb, factor_s, answers)


def answered(result: IndentationResult) -> Answer:
    measures = result.receptor_measures
    return Answer(
        force_mm2=result.state.normal_force,
        width_mm=float(sum(right - left for left, right in result.contact_regions_mm)),
        sed=tuple(measures["sed"].tolist()),
        ep1=tuple(measures["ep1"].tolist()),
        residual=result.state.residual,
        passes=result.state.passes,
        seconds=result.contact_s,
        limit_s=dense_cholesky_s(max(1, len(result.state.held))),
    )


def peak_memory_mb() -> float:
    """Of this process; on Linux the kernel's own record, since getrusage begins with the parent's peak."""
    status = Path("/proc/self/status")
    if status.exists():
        lines = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return float(lines["VmHWM"].split()[0]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1024**2 if sys.platform == "darwin" else 1024)


def sparse_factor_s(candidate: Candidate) -> float | None:
    """Seconds of one PARDISO factorisation of the finger's matrix with one unknown kept; None without MKL."""
    if not pardiso.available():
        return None
    config = candidate.config
    problem = discretise(config, build_mesh(config, FingertipSurface.fit(config.geometry)))
    start = time.perf_counter()
    PardisoFactor(problem.upper, problem.kept[:1]).close()
    return time.perf_counter() - start


def dense_cholesky_s(order: int) -> float:
    """Seconds of one dense Cholesky factorisation by LAPACK on one thread."""
    rows = np.random.default_rng(0).standard_normal((order, order + 8))
    spd = rows @ rows.T
    times = []
    with threadpool_limits(1):
        for _ in range(_FEW):
            start = time.perf_counter()
            lapack.dpotrf(spd, lower=1, clean=0)
            times.append(time.perf_counter() - start)
    return min(times)
