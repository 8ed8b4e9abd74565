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
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from sim.benchmark import reference_s
from sim.contact.indentor import ACROSS, ALONG, BOTH
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.models.many_indentations import indent_many
from studies.accuracy.random_poses import ON_ITS_PATCH, PosedShape, draw
from studies.posix import os
from studies.registry import ROOT, show
from studies.speed.timing import SCENES, factorized_alone, problem

ON_S = 0.3
"""Time of the reference computation on the machine for which aims are given (s)."""

POSES, ROUNDS, STARTS = 1000, 3, 5
COLUMNS = ("figure", "processor (s)", "wall (s)", "reference units", "aim (s)", "aim (units)", "load")
DEMO = ("dry-run", "protocols/steps.py", "--set", "step=1", "force_gwt=2.33")


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
    found = indent_many(
        finger,
        [scene.indentor for scene in scenes],
        [scene.x_mm for scene in scenes],
        z_mm=[np.nan if scene.z_mm is None else scene.z_mm for scene in scenes],
        doi_mm=[scene.doi_mm for scene in scenes],
        cores=cores,
    )
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
        subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)


def cold() -> Fingertip:
    """Build the default finger with an empty cache."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["RIG_CACHE_DIR"] = folder
        try:
            return Fingertip.load()
        finally:
            del os.environ["RIG_CACHE_DIR"]


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
        matrix = problem()
        with threadpool_limits(1):
            alone = least(lambda: factorized_alone(matrix))
            whole = least(cold)
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
    parser.add_argument("names", nargs="*", choices=[[], *NAMES], metavar="FIGURE")
    parser.add_argument("--poses", type=int, default=POSES)
    options = parser.parse_args()
    began, figures = time.perf_counter(), Figures(options.poses)
    show(COLUMNS, figures.run(options.names or NAMES))
    print(f"\n{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
