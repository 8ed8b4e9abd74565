"""Presses at finite strain of a finger of Ogden's tissue, beside its linear twin's: the kept truth of such strangers.

    OMP_NUM_THREADS=1 nice .venv/bin/python -m studies.meeting.ogden_references FILE [shapes]

The default finger of `studies/stiffening`, at the pad's centre. Each press is written when it is done: an interrupted
run goes on with the next shape. Half a minute of processor time a shape, two of a narrow bar.
"""

import json
import sys
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from studies.finite_strain.solver.ogden import Ogden
from studies.finite_strain.solver.press import presses
from studies.finite_strain.solver.scene import Specimen
from studies.stiffening.fingers import finger
from studies.stiffening.references import read

FINGER = "default"
ALPHA = 9.78
"""Of a human heel's pad, in place, under a sphere (Chokhandre et al. 2012, J. Biomech. Eng. 134, 031002)."""

SHAPES = {
    "sphere:4": 1.1,
    "flat:3": 1.1,
    "bar:3.0": 1.1,
    "cylinder:9": 1.1,
    "sphere:3": 1.1,
    "bar:1.5": 0.7,
    "flat:1.5": 0.5,
}
"""Those that a meeting presses, and those that it is asked for; to which depth, mm."""

_STEP_MM = 0.1


def rows(shape: str) -> Iterator[dict[str, Any]]:
    """One for each depth that converged: forces for E = 1 MPa, seconds of processor time since the last."""
    specimen = Specimen(finger(FINGER))
    body, touch = specimen.body(Ogden.of(ALPHA)), specimen.touch(shape)
    began = time.process_time()
    depths = np.arange(_STEP_MM, SHAPES[shape] + 0.5 * _STEP_MM, _STEP_MM).round(6)
    for found in presses(body, specimen.skin, touch, depths.tolist(), _STEP_MM):
        if specimen.at_the_rim(found.touched.nodes):
            return
        twin = _linear().indent(shape, doi_mm=found.doi_mm).state.normal_force
        told = {"alpha": ALPHA, "x_mm": 0.0, "shape": shape, "doi_mm": round(found.doi_mm, 6)}
        cpu_s = round(time.process_time() - began, 1)
        yield {**told, "force": found.force, "linear": twin, "cpu_s": cpu_s}
        began = time.process_time()


@cache
def _linear() -> Fingertip:
    return load("finger", finger(FINGER), cached=False)


def main(path: str, *only: str) -> None:
    """Append what is missing."""
    file = Path(path)
    done = {row["shape"] for row in read(file)}
    for shape in only or SHAPES:
        if shape in done:
            continue
        for row in rows(shape):
            with file.open("a", encoding="utf-8") as out:
                out.write(json.dumps(row) + "\n")
            print(shape, row["doi_mm"], row["force"], row["linear"], row["cpu_s"], flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
