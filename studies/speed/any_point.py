"""What strain at new points costs, beside a press and beside building the model again; do both ways agree?

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.speed.any_point    # the default finger, in a cache of its own

Times are processor times of one thread.
"""

import os
import resource
import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from sim.models.field import FEW_POINTS
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult

Done = TypeVar("Done")

SHEET = (50, 20)  # x by depths


def cpu(work: Callable[[], Done]) -> tuple[Done, float]:
    """What was done, and the processor seconds that it took."""
    start = time.process_time()
    done = work()
    return done, time.process_time() - start


def memory_mb() -> float:
    """What this process has in memory now; Linux."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


def presses(finger: Fingertip, n: int = 9) -> tuple[list[IndentationResult], float]:
    """Of a smooth shape from rest, and the median time of one."""
    found = [cpu(partial(finger.indent, "cylinder:9", x, doi_mm=0.6)) for x in np.linspace(-0.4, 0.4, n).tolist()]
    return [result for result, _ in found], statistics.median(seconds for _, seconds in found)


def measured(folder: Path) -> list[tuple[str, float]]:
    """What was done, and its processor seconds; prints sizes and errors on the way."""
    finger, build = cpu(Fingertip.load)
    results, press = presses(finger)
    deeper, other_depth = cpu(lambda: Fingertip.load(receptor_depth_mm=0.9))
    before = memory_mb()
    _, first = cpu(lambda: finger.fields(results[0], finger.points_below(0.03, 0.55)))
    print(f"memory: {memory_mb() - before:.0f} MB for the factor while it is kept")
    row = finger.points_below(np.linspace(-2, 2, FEW_POINTS), 0.61)
    by_columns, columns = cpu(lambda: finger.fields(results, row))
    _, again = cpu(lambda: finger.fields(results, row))
    _, disk = cpu(lambda: Fingertip.load().fields(results, row))
    sheet, placing = cpu(
        lambda: finger.points_below(np.linspace(-2, 2, SHEET[0])[:, None], np.linspace(0.02, 2, SHEET[1]))
    )
    one_press, cloud = cpu(lambda: finger.fields(results[0], sheet))
    _, cloud_of_all = cpu(lambda: finger.fields(results, sheet))
    by_solves = finger.fields(results, np.concatenate([row, row]))
    off = max(
        np.abs(a.strain - b.strain[:FEW_POINTS]).max() / np.abs(a.strain).max()
        for a, b in zip(by_columns, by_solves, strict=True)
    )
    print(f"columns against one solve a press: strains differ by {off:.0e} of the largest")
    assert np.isfinite(one_press.strain).all()
    assert deeper.model.receptors.depth_mm == 0.9
    for kind in ("model", "columns"):
        sizes = sorted(path.stat().st_size / 1e6 for path in folder.glob(f"*.{kind}"))
        print(f"disk: {kind} {', '.join(f'{size:.1f}' for size in sizes)} MB")
    points = SHEET[0] * SHEET[1]
    return [
        ("a press, cylinder 9 at 0.6 mm, median", press),
        ("the model built, ten receptors with it", build),
        ("ten receptors at another depth added by `load`: factor and 60 solves", other_depth),
        ("the first new point of a finger: factor and six solves", first),
        ("a further new point by columns, the factor kept", columns / FEW_POINTS),
        (f"{FEW_POINTS} points known, nine presses, from memory", again),
        (f"{FEW_POINTS} points known, nine presses, from the disk, the model too", disk),
        (f"a sheet of {points} new points under one press, the factor kept", cloud),
        (f"the same under {len(results)} presses", cloud_of_all),
        (f"placing {points} points below the skin", placing),
    ]


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["RIG_CACHE_DIR"] = folder
        rows = measured(Path(folder))
    (_, press), (_, build) = rows[:2]
    print("\n| what | CPU s | in presses | of a build |\n|---|---|---|---|")
    for what, seconds in rows:
        print(f"| {what} | {seconds:.3g} | {seconds / press:.2g} | {seconds / build:.2g} |")


if __name__ == "__main__":
    main()
