"""Every press behind the tables, each written when it is done: an interrupted run goes on where it was.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.finite_strain.states FILE ["finger 0.35, bar" …]

Hours of processor time on one thread; a file that has a scene's rows is not pressed again.
"""

import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from sim.config import Contact, FingertipConfig, MeshSpec, Tissue
from studies.finite_strain.reading import Reader
from studies.finite_strain.solver.bricks import Dilatation
from studies.finite_strain.solver.laws import Law, NeoHookean
from studies.finite_strain.solver.press import presses
from studies.finite_strain.solver.scene import Kind, Specimen

DEPTHS_MM = (0.1, 0.2, 0.33, 0.5, 0.67, 0.83, 1.0, 1.17, 1.33, 1.6, 2.0)
SHAPES = ("cylinder:9", "sphere:3", "flat", "step:1", "bar:3.0")
LAWS: dict[str, Law | None] = {"linear": None, "neo-Hookean": NeoHookean()}

LONGEST_MM: dict[Kind, float] = {"section": 0.05, "finger": 0.1}
"""The longest step down."""

_FEW = {"epidermis_elements": 1, "growth": 1.5, "far_growth": 2.0, "near_width_mm": 0.5, "near_spacing_mm": 0.8}

MESHES: dict[str, dict[str, Any]] = {
    "section 0.17": {},
    "section 0.085": {"spacing_mm": 0.085, "epidermis_elements": 4, "dermis_spacing_mm": 0.1},
    "section 0.17 full": {"element": "full"},
    "finger 0.35": {"spacing_mm": 0.35, "axial_spacing_mm": 0.6, **_FEW, "dermis_spacing_mm": 0.4},
    "finger 0.35 full": {"spacing_mm": 0.35, "axial_spacing_mm": 0.6, **_FEW, "dermis_spacing_mm": 0.4},
    "finger 0.7": {"spacing_mm": 0.7, "axial_spacing_mm": 1.0, **_FEW, "dermis_spacing_mm": 0.4},
    "finger 0.7 full": {"spacing_mm": 0.7, "axial_spacing_mm": 1.0, **_FEW, "dermis_spacing_mm": 0.4},
    "finger 0.4": {"spacing_mm": 0.4, "axial_spacing_mm": 0.55, "dermis_spacing_mm": 0.3},
    "finger 0.25": {"spacing_mm": 0.25, "axial_spacing_mm": 0.45, **_FEW, "epidermis_elements": 2},
}
"""What each mesh sets; its first word is the specimen's kind."""


class PressedShape(NamedTuple):
    """One shape pressed at one place of one mesh."""

    mesh: str
    shape: str
    x_mm: float = 0.0
    poisson: float = Tissue().poisson
    deepest_mm: float = DEPTHS_MM[-1]


def scenes() -> Iterator[PressedShape]:
    """In the order in which they matter."""
    along = tuple(shape for shape in SHAPES if shape != "sphere:3")
    for shape in SHAPES:
        yield PressedShape("finger 0.35", shape, deepest_mm=1.33)
    for mesh in ("section 0.17", "section 0.17 full", "section 0.085"):
        for shape in along:
            yield PressedShape(mesh, shape)
    for poisson in (0.45, 0.49, 0.499):
        for shape in along:
            yield PressedShape("section 0.17", shape, poisson=poisson)
    for poisson in (0.45, 0.499):
        yield PressedShape("finger 0.35", "cylinder:9", poisson=poisson, deepest_mm=1.0)
    yield PressedShape("finger 0.25", "cylinder:9", deepest_mm=0.67)
    yield PressedShape("finger 0.25", "bar:3.0", deepest_mm=1.0)


def specimen(scene: PressedShape) -> Specimen:
    """The finger or section that is pressed."""
    kind: Kind = "section" if scene.mesh.startswith("section") else "finger"
    mesh = MeshSpec.model_validate(MESHES[scene.mesh])
    config = FingertipConfig(tissue=Tissue(poisson=scene.poisson), mesh=mesh, contact=Contact(between_nodes=False))
    return Specimen(config, kind)


def rows(scene: PressedShape, law: str) -> Iterator[dict[str, Any]]:
    """One for each depth that converged, with seconds of processor time since the last."""
    pressed = specimen(scene)
    dilatation: Dilatation = "full" if scene.mesh.endswith("full") else "bbar"
    body, reader, touch = pressed.body(LAWS[law], dilatation), Reader(pressed), pressed.touch(scene.shape, scene.x_mm)
    depths = [depth for depth in DEPTHS_MM if depth <= scene.deepest_mm]
    began = time.process_time()
    for found in presses(body, pressed.skin, touch, depths, LONGEST_MM[pressed.kind]):
        if pressed.at_the_rim(found.touched.nodes):
            return
        numbers = reader.read(found, touch, LAWS[law], body.displacement(found.unknowns))
        yield {**scene._asdict(), "law": law, **numbers, "cpu_s": round(time.process_time() - began, 1)}
        began = time.process_time()


def main(path: str, *only: str) -> None:
    """Append what is missing."""
    file = Path(path)
    done = {_key(row) for row in read(file)}
    for scene in scenes():
        for law in LAWS:
            if (only and not any(word in f"{scene.mesh}, {scene.shape}" for word in only)) or (*scene, law) in done:
                continue
            for row in rows(scene, law):
                with file.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(row) + "\n")
                print(scene, law, row["doi_mm"], row["force"], row["cpu_s"], flush=True)


def read(file: Path) -> list[dict[str, Any]]:
    """The rows that are there."""
    return [json.loads(line) for line in file.read_text("utf-8").splitlines()] if file.exists() else []


def _key(row: dict[str, Any]) -> tuple[Any, ...]:
    return (*(row[name] for name in PressedShape._fields), row["law"])


if __name__ == "__main__":
    main(*sys.argv[1:])
