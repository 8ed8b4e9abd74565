"""Presses at finite strain of fingers that stiffen: what the quick answer is fitted to and checked against.

    OMP_NUM_THREADS=1 nice .venv/bin/python -m studies.stiffening.references FILE [words that a scene's name has]

Every layer is Yeoh's (`studies/finite_strain`'s solver), each press written when it is done: an interrupted run goes
on where it was. Some minutes of processor time a scene.
"""

import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from studies.finite_strain.reading import Reader
from studies.finite_strain.solver.laws import Yeoh
from studies.finite_strain.solver.press import presses
from studies.finite_strain.solver.scene import Specimen
from studies.stiffening.fingers import FINGERS, deepest_mm, finger

DEPTHS_MM = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0)
PATHS = (
    *(("flat", 0.3), ("sphere:3", 0.3), ("flat", 0.0), ("cylinder:4", 0.3), ("flat", 1.0), ("cylinder:4", 0.0)),
    *(("bar:3.0", 0.3), ("sphere:3", 0.0), ("cylinder:4", 1.0), ("bar:3.0", 0.0), ("sphere:3", 1.0)),
)
"""Shapes and stiffening in the order in which they matter; 1 lies beyond the prior's range."""

_STEP_MM = 0.25


class StiffeningPress(NamedTuple):
    """One shape pressed into one finger."""

    finger: str
    shape: str
    stiffening: float

    @property
    def name(self) -> str:
        """In words."""
        return f"{self.finger}, {self.shape}, {self.stiffening:g}"


def scenes() -> Iterator[StiffeningPress]:
    """In the order in which they matter."""
    for shape, stiffening in PATHS:
        for name in FINGERS:
            yield StiffeningPress(name, shape, stiffening)


def rows(scene: StiffeningPress) -> Iterator[dict[str, Any]]:
    """One for each depth that converged, with seconds of processor time since the last; forces for E = 1 MPa."""
    config = finger(scene.finger)
    specimen, law = Specimen(config), Yeoh(scene.stiffening)
    body, reader, touch = specimen.body(law), Reader(specimen), specimen.touch(scene.shape)
    depths = [depth for depth in DEPTHS_MM if depth <= deepest_mm(scene.finger)]
    began = time.process_time()
    for found in presses(body, specimen.skin, touch, depths, _STEP_MM):
        if specimen.at_the_rim(found.touched.nodes):
            return
        told = reader.read(found, touch, law, body.displacement(found.unknowns))
        measures = told.pop("measures")
        kept = {name: [float(f"{value:.5g}") for value in measures[name]] for name in ("sed", "ep1")}
        yield {**scene._asdict(), **told, **kept, "cpu_s": round(time.process_time() - began, 1)}
        began = time.process_time()


def main(path: str, *only: str) -> None:
    """Append what is missing."""
    file = Path(path)
    done = {StiffeningPress(row["finger"], row["shape"], row["stiffening"]) for row in read(file)}
    for scene in scenes():
        if scene in done or not all(word in scene.name for word in only):
            continue
        for row in rows(scene):
            with file.open("a", encoding="utf-8") as out:
                out.write(json.dumps(row) + "\n")
            print(scene.name, row["doi_mm"], row["force"], row["cpu_s"], flush=True)


def read(file: Path) -> list[dict[str, Any]]:
    """The rows that are there."""
    return [json.loads(line) for line in file.read_text("utf-8").splitlines()] if file.exists() else []


if __name__ == "__main__":
    main(*sys.argv[1:])
