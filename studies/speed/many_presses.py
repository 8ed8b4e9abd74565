"""Many mixed presses by one call on all cores, beside the same presses one by one on one; are they the same?

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.speed.many_presses [N] [SEED]    # 1000 poses

The poses are those of `studies.accuracy.random_poses`; such as leave the patch are drawn anew. Models are cached;
starting processes and loading models there is part of the time.
"""

import os
import sys
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from sim.contact.indentor import ACROSS, ALONG, BOTH
from sim.models.fingertip import Fingertip
from sim.models.many_indentations import indent_many
from sim.models.result import IndentationResult, Indentations
from studies.accuracy.random_poses import ON_ITS_PATCH, PosedShape, solved

Done = TypeVar("Done")


def timed(work: Callable[[], Done]) -> tuple[Done, float]:
    """What was done, and the seconds on the wall that it took."""
    start = time.perf_counter()
    done = work()
    return done, time.perf_counter() - start


def one_by_one(finger: Fingertip, scenes: list[PosedShape], *, measures: bool) -> list[IndentationResult]:
    """Each pressed from rest, as a loop would."""
    results = []
    for scene in scenes:
        results.append(finger.indent(scene.indentor, scene.x_mm, z_mm=scene.z_mm, doi_mm=scene.doi_mm))
        if measures:
            _ = results[-1].receptor_measures
    return results


def at_once(finger: Fingertip, scenes: list[PosedShape], cores: int, *, measures: bool) -> Indentations:
    """All by one call."""
    found = indent_many(
        finger,
        [scene.indentor for scene in scenes],
        [scene.x_mm for scene in scenes],
        z_mm=[np.nan if scene.z_mm is None else scene.z_mm for scene in scenes],
        doi_mm=[scene.doi_mm for scene in scenes],
        cores=cores,
    )
    if measures:
        found.receptor_table()
    return found


def main() -> None:
    """Print the table."""
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    finger, cores = Fingertip.load(ON_ITS_PATCH), os.cpu_count() or 1
    for slopes in (ALONG, ACROSS, BOTH):
        finger.model_for(slopes)
    scenes = [scene for scene, _ in solved(finger, n, seed)]
    print(f"{n} poses, seed {seed}; {cores} cores\n")
    print("| | contact alone (s) | with measures (s) |\n|---|---|---|")
    alone, alone_s = timed(lambda: one_by_one(finger, scenes, measures=False))
    _, measured_s = timed(lambda: one_by_one(finger, scenes, measures=True))
    print(f"| one by one, one core | {alone_s:.1f} | {measured_s:.1f} |", flush=True)
    many, contact_s = timed(lambda: at_once(finger, scenes, cores, measures=False))
    _, measured_s = timed(lambda: at_once(finger, scenes, cores, measures=True))
    print(f"| `indent_many`, {cores} cores | {contact_s:.1f} | {measured_s:.1f} |")
    same = sum(m is not None and m.force_n == a.force_n for m, a in zip(many, alone, strict=True))
    print(f"\n{same} of {n} forces are the same to the last bit; {alone_s / contact_s:.2f} times as fast")
    spent = 1e3 * np.array([result.contact_s for result in alone])
    median, p95 = np.percentile(spent, [50, 95])
    print(f"one contact: median {median:.1f} ms, mean {spent.mean():.1f} ms, p95 {p95:.0f} ms")


if __name__ == "__main__":
    main()
