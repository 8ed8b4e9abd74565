"""Times that were asked for, in seconds of this machine and in units of the reference computation of `rig bench`.

    .venv/bin/python -m studies run speed-in-units                           # ten minutes
    .venv/bin/python -m studies.speed.figures_in_units [--poses N] [FIGURE …]   # fewer poses, some figures

Processor times of one thread, the least of a few rounds (of the poses: one round). The reference computation is
measured before and after each figure; the shorter time is its unit. Aims in units are for a machine that needs 0.3 s
for the reference computation, two cores at 2.6 GHz. The unit is arithmetic by LAPACK; where Python is slow, a figure
takes more of them.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from sim.benchmark import reference_s
from sim.contact import lcp
from sim.contact.indentor import ACROSS, ALONG, BOTH
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from studies.accuracy.random_poses import ON_ITS_PATCH, PosedShape, draw
from studies.posix import os
from studies.registry import show
from studies.speed import cold_build
from studies.speed.demo import DEMO, HERE
from studies.speed.many_presses import at_once
from studies.speed.timing import SCENES

ON_S = 0.3
"""Time of the reference computation on the machine for which aims are given (s)."""

POSES, ROUNDS, STARTS = 1000, 3, 5
COLUMNS = ("figure", "processor (s)", "wall (s)", "reference units", "aim (s)", "aim (units)", "load")
WORK = ("of one pose, mean", "count", "at the machine's rate (ms)")

Ints = NDArray[np.int64]


class Spent(NamedTuple):
    """Times of a figure (s)."""

    processor_s: float
    wall_s: float


def spent(action: Callable[[], object]) -> Spent:
    """Return the times of this process and of those that it started and that have ended."""
    before = os.times()
    action()
    after = os.times()
    return Spent(sum(after[:4]) - sum(before[:4]), after.elapsed - before.elapsed)


def least(action: Callable[[], object], rounds: int = ROUNDS) -> Spent:
    """Return the shortest times of some rounds."""
    found = [spent(action) for _ in range(rounds)]
    return Spent(*(min(times) for times in zip(*found, strict=True)))


def drawn(finger: Fingertip, n: int) -> tuple[list[PosedShape], list[float], Spent]:
    """Return poses of `studies.accuracy.random_poses` that lie on the patch, their forces (N), and their times."""
    rng, scenes, forces, processor_s, wall_s = np.random.default_rng(0), list[PosedShape](), list[float](), 0.0, 0.0
    while len(scenes) < n:
        scene, began, wall = draw(rng), time.process_time(), time.perf_counter()
        try:
            forces.append(finger.indent(scene.indentor, scene.x_mm, z_mm=scene.z_mm, doi_mm=scene.doi_mm).force_n)
        except ModelRangeError:
            continue
        processor_s, wall_s = processor_s + time.process_time() - began, wall_s + time.perf_counter() - wall
        scenes.append(scene)
    return scenes, forces, Spent(processor_s, wall_s)


def many(finger: Fingertip, scenes: list[PosedShape], cores: int) -> list[float]:
    """Return the forces of all poses by one call (N)."""
    found = at_once(finger, scenes, cores, measures=False)
    return [result.force_n for result in found if result is not None]


def p95_s(finger: Fingertip, scene: int) -> float:
    """Return the 95th percentile of processor times from rest under a shape (s), each the least of some rounds."""
    _, shape, xs, dois = SCENES[scene]
    times = [min(finger.indent(shape, x, doi_mm=doi).contact_s for _ in range(ROUNDS)) for x in xs for doi in dois]
    return float(np.percentile(times, 95))


def started(*words: str) -> None:
    """Run a command of the program."""
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-m", "rig", *(word.replace("OUT", out) for word in words)]
        subprocess.run(command, cwd=HERE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)


class Counts:
    """Flops of factors and solves, and bytes of compliance read, in the convex problems of contacts."""

    def __init__(self) -> None:
        self.flops = self.moved_bytes = 0.0
        self.passes = self.pivots = 0

    @contextmanager
    def counted(self) -> Iterator[None]:
        """Count what is solved within."""
        held, slack = lcp._held, lcp._slack

        def solved(problem: lcp._Problem, active: Ints) -> object:
            n, known = len(active), int((problem.place >= 0).sum())
            found = held(problem, active)  # fills in the entries of W that are new
            entries = (int((problem.place >= 0).sum()) ** 2 - known**2) / 2
            self.pivots += 1
            self.flops += n**3 / 3 + 2 * n**2 + 2 * len(problem.normal) ** 2 * entries
            self.moved_bytes += 8 * (len(problem.normal) ** 2 * entries + n**2)
            return found

        def loosened(problem: lcp._Problem, multipliers: NDArray[np.float64], active: Ints) -> object:
            entries = len(active) * len(problem.normal) ** 2 * problem.skin.nodes
            self.flops += 2 * entries
            self.moved_bytes += 8 * entries
            return slack(problem, multipliers, active)

        python = {name: getattr(lcp, name).py_func for name in ("_solved", "_by_blocks", "_one_by_one", "_feasible")}
        with patch.multiple(lcp, _held=solved, _slack=loosened, **python):
            yield


def work(finger: Fingertip, scenes: list[PosedShape]) -> list[tuple[str, str, str]]:
    """Return what a pose is made of, beside the rates of a dense product and of a copy."""
    counts, solves = Counts(), lcp.solve_lcp

    def one(*problem: object) -> object:
        counts.passes += 1
        return solves(*problem)  # type: ignore[arg-type]

    with counts.counted(), patch("sim.contact.planes.solve_lcp", one):
        for scene in scenes:
            finger.indent(scene.indentor, scene.x_mm, z_mm=scene.z_mm, doi_mm=scene.doi_mm)
    flops, moved, n = counts.flops / len(scenes), counts.moved_bytes / len(scenes), len(scenes)
    rate, copied = cold_build.product_rate(), cold_build.copy_rate()
    return [
        ("convex problems", f"{counts.passes / n:.0f}", ""),
        ("factorizations", f"{counts.pivots / n:.0f}", ""),
        (f"Mflop of these problems (dense product: {rate / 1e9:.0f} Gflop/s)", f"{flops / 1e6:.0f}",
         f"{1e3 * flops / rate:.1f}"),
        (f"MB of matrices read (copy: {copied / 1e9:.0f} GB/s)", f"{moved / 1e6:.0f}", f"{1e3 * moved / copied:.1f}"),
    ]  # fmt: skip


class Figures:
    """The figures, each by its name; a figure yields what it is, its times and its aim (s)."""

    def __init__(self, poses: int) -> None:
        self.poses = poses
        self.finger = Fingertip.load(ON_ITS_PATCH)
        for slopes in (ALONG, ACROSS, BOTH):
            self.finger.model_for(slopes)

    def run(self, names: list[str]) -> Iterator[tuple[str, ...]]:
        """Yield the rows of the table."""
        for name in names:
            unit_s = reference_s()
            rows = [(*row, os.getloadavg()[0]) for row in getattr(self, name)()]
            unit_s = min(unit_s, reference_s())
            for what, times, aim_s, load in rows:
                aim = ("", "") if aim_s is None else (f"{aim_s:g}", f"{aim_s / ON_S:.2g}")
                in_units = f"{times.processor_s / unit_s:.3g}"
                wall = "" if np.isnan(times.wall_s) else f"{times.wall_s:.3g}"
                yield what, f"{times.processor_s:.3g}", wall, in_units, *aim, f"{load:.0f}"
            yield "reference computation then", f"{unit_s:.3g}", "", "1", "", f"{ON_S:g}", f"{os.getloadavg()[0]:.0f}"

    def many(self) -> Iterator[tuple[str, Spent, float | None]]:
        """Mixed poses on one core and on two."""
        scenes, alone, times = drawn(self.finger, self.poses)
        yield f"{self.poses} mixed poses, 1 core", times, None
        found: list[float] = []
        times = spent(lambda: found.extend(many(self.finger, scenes, 2)))
        yield f"{self.poses} mixed poses, 2 cores", times, 10.0 if self.poses == POSES else None
        if found != alone:
            raise ArithmeticError("the forces of one core and of two differ")

    def press(self) -> Iterator[tuple[str, Spent, float | None]]:
        """95th percentile of a press from rest."""
        for scene, (name, *_) in enumerate(SCENES):
            yield f"p95 from rest, {name.split(', DOI')[0]}", Spent(p95_s(self.finger, scene), np.nan), 0.03

    def build(self) -> Iterator[tuple[str, Spent, float | None]]:
        """Cold build, and the factorization alone."""
        matrix = cold_build.problem()
        with threadpool_limits(1):
            alone = least(lambda: cold_build.factorized_alone(matrix))
            whole = least(cold_build.cold)
        yield "factorization alone", alone, None
        yield f"cold build, {whole.processor_s / alone.processor_s:.2f} of that", whole, 1.6 * alone.processor_s

    def commands(self) -> Iterator[tuple[str, Spent, float | None]]:
        """The demo and the help."""
        yield "make demo, warm", least(lambda: started(*DEMO, "--out", "OUT")), 5.0
        yield "rig --help", least(lambda: started("--help"), STARTS), 0.25


NAMES = ["commands", "press", "many", "build"]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[[], "work", *NAMES], metavar="FIGURE")
    parser.add_argument("--poses", type=int, default=POSES)
    options = parser.parse_args()
    names = options.names or [*NAMES, "work"]
    began, figures = time.perf_counter(), Figures(options.poses)
    show(COLUMNS, figures.run([name for name in names if name != "work"]))
    if "work" in names:
        print()
        show(WORK, work(figures.finger, drawn(figures.finger, min(options.poses, 100))[0]))
    print(f"\n{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
