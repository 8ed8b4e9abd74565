"""Discretization error of the default mesh over the schedules of the source, against the level `fine`.

    .venv/bin/python -m studies.accuracy.source_scenes    # five minutes

Schedules: Raju (1998, ch. 4 and 5). Bars every 0.17 mm, 25 and 34 positions, to 1 mm; cylinders at the middle; steps
from x = 2.0 to −3.7 mm at 2.33 and 8 gwt. Force is compared at a depth, depth at a force.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from sim.config import FingertipConfig, MeshSpec
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult

SPACING_MM = 0.17


class Scene(NamedTuple):
    """One indentation of the source: a depth in mm or a force in gwt."""

    shape: str
    x_mm: float
    doi_mm: float | None = None
    force_gwt: float | None = None

    def pressed(self, finger: Fingertip) -> IndentationResult:
        """Press it into a finger."""
        return finger.indent(self.shape, self.x_mm, doi_mm=self.doi_mm, force_gwt=self.force_gwt)


def scenes() -> Iterator[Scene]:
    """Yield the indentations of the source."""
    for shape, count in (("bar:1.5", 25), ("bar:3.0", 34)):
        for k in range(count):
            for doi in (0.33, 0.67, 1.0):
                yield Scene(shape, SPACING_MM * (k - 0.5 * (count - 1)), doi)
    for shape in ("cylinder:3", "cylinder:9"):
        yield from (Scene(shape, 0.0, doi) for doi in (0.33, 1.0, 1.33))
    for shape in ("step:1", "step:3", "step:5"):
        for x in np.arange(2.0, -3.71, -2 * SPACING_MM):
            yield from (Scene(shape, float(x), force_gwt=gwt) for gwt in (2.33, 8.0))


def main() -> None:
    """Print the largest errors of each shape and where they are."""
    meshes = [
        Fingertip.load(FingertipConfig(mesh=MeshSpec.model_validate({"level": n}))) for n in ("default", "fine")
    ]
    worst: dict[str, list[tuple[float, Scene]]] = {}
    for scene in scenes():
        ours, finer = (scene.pressed(finger) for finger in meshes)
        load = ours.force_n / finer.force_n if scene.doi_mm else ours.doi_mm / finer.doi_mm
        sed, exact = (result.receptor_measures["sed"] for result in (ours, finer))
        errors = [abs(load - 1), float(np.abs(sed - exact).max() / np.abs(exact).max())]
        before = worst.setdefault(scene.shape, [(0.0, scene)] * 2)
        worst[scene.shape] = [max(one, (error, scene)) for one, error in zip(before, errors, strict=True)]
    print("| shape | force, of steps depth (%) | at | receptor SED (%) | at |\n|---|---|---|---|---|")
    for shape, found in worst.items():
        cells = [cell for error, scene in found for cell in (f"{100 * error:.1f}", _place(scene))]
        print(f"| {shape} | {' | '.join(cells)} |")


def _place(scene: Scene) -> str:
    load = f"{scene.doi_mm:g} mm" if scene.doi_mm else f"{scene.force_gwt:g} gwt"
    return f"x = {scene.x_mm:.2f}, {load}"


if __name__ == "__main__":
    main()
