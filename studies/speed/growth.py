"""How the finger grows: cold build, memory and a press against nodes; presses over cores; a study over dask workers.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.speed.growth [FINEST]    # down to 0.55 of the default's elements
    OMP_NUM_THREADS=1 .venv/bin/python -m studies.speed.growth --cores     # over 1 and 2 cores, then dask workers

Every size is refined or coarsened alike, across, along and in depth. Processor seconds of one thread, each mesh in a
process that does nothing else; memory is its peak.
"""

import os
import resource
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from rig.compare.workers import spread
from sim.benchmark import peak_memory_mb
from sim.config import AXIAL_STRETCH, FingertipConfig, MeshSpec, Tissue
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.many import indent_many
from sim.workers import in_processes

SIZES = (1.8, 1.5, 1.25, 1.0, 0.85, 0.7, 0.6, 0.55)
"""Of the default's elements."""

PRESSES = tuple(
    (shape, x, doi) for shape in ("cylinder:9", "bar:3.0", "step:5") for x in (-0.3, 0.2) for doi in (0.3, 0.6)
)
_MANY, _FINGERS = 120, 8


class Grown(NamedTuple):
    """One mesh: processor seconds, MB."""

    size: float
    nodes: int
    patch_nodes: int
    build_s: float
    memory_mb: float
    press_s: float
    kept_mb: float  # the compliance, which a press needs


def scaled(size: float) -> MeshSpec:
    """The default mesh with elements so many times as large, everywhere."""
    usual = MeshSpec()
    return MeshSpec(
        spacing_mm=size * usual.spacing_mm,
        axial_spacing_mm=size * AXIAL_STRETCH * usual.spacing_mm,
        epidermis_elements=max(1, round(usual.epidermis_elements / size)),
        dermis_spacing_mm=size * usual.dermis_spacing_mm,
        growth=usual.growth**size,
        far_growth=usual.far_growth**size,
        near_spacing_mm=size * usual.near_spacing_mm,
        far_spacing_mm=size * usual.far_spacing_mm,
    )


def grown(size: float) -> Grown:
    """Built from nothing, and pressed."""
    began = time.process_time()
    with threadpool_limits(1):
        finger = load("finger", FingertipConfig(mesh=scaled(size)), cached=False)
        built_s, memory_mb = time.process_time() - began, peak_memory_mb()
        finger.indent("cylinder:9", doi_mm=0.2)
        presses = [finger.indent(shape, x, doi_mm=doi).contact_s for shape, x, doi in PRESSES]
    model = finger.model
    kept_mb = model.patch.compliance.nbytes / 1e6
    return Grown(size, model.nodes, len(model.patch), built_s, memory_mb, float(np.median(presses)), kept_mb)


def exponent(found: Sequence[Grown], name: str) -> float:
    """Of the nodes, by least squares of the logarithms."""
    nodes, values = (np.log([getattr(one, key) for one in found]) for key in ("nodes", name))
    return float(np.polyfit(nodes, values, 1)[0])


def sizes(finest: float) -> Iterator[str]:
    """The table, line by line as it is measured, and the exponents."""
    columns = ("elements over the default's", "nodes", "patch nodes", "cold build (s)", "peak memory (GB)",
               "kept (MB)", "a press, median (ms)")  # fmt: skip
    yield f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}"
    found: list[Grown] = []
    for size in [size for size in SIZES if size >= finest]:
        for one in in_processes(grown, [size], 1):
            found.append(one)
            yield (
                f"| {one.size:g} | {one.nodes} | {one.patch_nodes} | {one.build_s:.1f} | {one.memory_mb / 1e3:.2f} | "
                f"{one.kept_mb:.0f} | {1e3 * one.press_s:.0f} |"
            )
    names = {"build_s": "cold build", "memory_mb": "peak memory", "press_s": "a press"}
    told = (f"{what} nodes^{exponent(found, name):.2f}" for name, what in names.items())
    yield "\n" + ", ".join(told)


def _spent(work: Callable[[], object]) -> tuple[float, float]:
    """Seconds on the wall, and of all processors, children's counted."""

    def processors() -> float:
        used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        return sum(one.ru_utime + one.ru_stime for one in used)

    began, before = time.perf_counter(), processors()
    work()
    return time.perf_counter() - began, processors() - before


def _press_many(finger: Fingertip, cores: int) -> None:
    indent_many(finger, "bar:3.0", np.linspace(-0.5, 0.5, _MANY), doi_mm=0.5, cores=cores)


def build_softer(e_fat: float) -> float:
    """Force in gwt of a finger that is built for it: a case of a study without a cache."""
    finger = load("finger", FingertipConfig(tissue=Tissue(e_fat=e_fat)), cached=False)
    return finger.indent("bar:3.0", doi_mm=0.5).force_gwt


def _build_over(address: str, moduli: Sequence[float]) -> None:
    list(spread(build_softer, moduli, scheduler=address))


def cores() -> Iterator[str]:
    """The same presses over one core and two, and the same builds over one dask worker and two."""
    finger = Fingertip.load()
    yield "| work | on | wall (s) | processors (s) |\n|---|---|---|---|"
    for n in (1, 2):
        wall, processors = _spent(partial(_press_many, finger, n))
        yield f"| {_MANY} presses | {n} {'core' if n == 1 else 'cores'} | {wall:.1f} | {processors:.1f} |"
    from distributed import LocalCluster

    moduli = np.geomspace(0.05, 0.3, _FINGERS).tolist()
    for n in (1, 2):
        with LocalCluster(n_workers=n, threads_per_worker=1, dashboard_address=None) as cluster:  # type: ignore[no-untyped-call]
            address = cluster.scheduler_address
            wall, _ = _spent(partial(_build_over, address, moduli))
        yield f"| {_FINGERS} fingers built and pressed | {n} of dask's workers | {wall:.1f} | |"


def main() -> None:
    """Print."""
    os.environ["OMP_NUM_THREADS"] = "1"
    asked = sys.argv[1:] or ["0.55"]
    for line in cores() if asked == ["--cores"] else sizes(float(asked[0])):
        print(line, flush=True)


if __name__ == "__main__":
    main()
