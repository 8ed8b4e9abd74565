"""How wrong round shapes and the line are on the default and the fine mesh: against a mesh of 0.1 mm both ways.

    .venv/bin/python -m studies.accuracy.round_shapes    # docs/validation/performance.md; 12 GB, some ten minutes

The reference is the family of `sim/benchmark.py` with the same spacing along the finger as across;
its bars are the largest changes from the level before. There is no further level: it would not fit into the memory
of a desk.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from sim.benchmark import BenchmarkScene, SceneResult, answered, nested
from sim.config import FingertipConfig, MeshSpec
from sim.contact.shapes import parse_shape
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult

TO_NAIL_MM = FingertipConfig().receptor_plane_mm - FingertipConfig().tissue.nail_from_z_mm - 1e-6
OFFSETS_MM = (0.0, 0.0425, 0.085, 0.1275)
SHAPES = {
    "sphere": (("sphere:5", 0.4), ("sphere:5", 0.67), ("sphere:2", 0.67)),
    "flat, cone": (("flat:1", 0.5), ("cone:60", 0.5)),
    "line": (("line", 0.5), ("line", 1.0)),
}
SCENES = [
    BenchmarkScene(family, shape, x, doi)
    for family, all_of in SHAPES.items()
    for shape, doi in all_of
    for x in OFFSETS_MM
]
QUANTITIES = ("force", "sed", "ep1")
PATCH = {"patch_x_mm": 3.3, "patch_z_mm": 2.0, "round_patch_mm": 2.0}


def even(n: int) -> MeshSpec:
    """Level n of the family, as fine along the finger as across it."""
    return nested(n, axial_spacing_mm=TO_NAIL_MM / round(TO_NAIL_MM * n / 0.4), **PATCH)


def answers(mesh: MeshSpec) -> tuple[list[int], dict[BenchmarkScene, SceneResult]]:
    """The nodes of its meshes, and all scenes; round shapes and the line have a model each."""
    nodes: list[int] = []
    found: dict[BenchmarkScene, SceneResult] = {}
    for families in (("sphere", "flat, cone"), ("line",)):
        mine = [scene for scene in SCENES if scene.family in families]
        axes = parse_shape(mine[0].shape).axes
        finger = load("finger", FingertipConfig(mesh=mesh), slopes=axes, cached=False)
        nodes.append(finger.model_for(axes).nodes)
        found |= {scene: answered(_pressed(finger, scene)) for scene in mine}
    return nodes, found


def _pressed(finger: Fingertip, scene: BenchmarkScene) -> IndentationResult:
    """A line lies across the finger: its positions are along it."""
    if scene.family == "line":
        return finger.indent(scene.shape, z_mm=finger.config.receptor_plane_mm + scene.x_mm, doi_mm=scene.doi_mm)
    return finger.indent(scene.shape, scene.x_mm, doi_mm=scene.doi_mm)


def errors(found: dict[BenchmarkScene, SceneResult], reference: dict[BenchmarkScene, SceneResult]) -> Iterator[str]:
    """For each family the largest error of each quantity over the largest value, per cent."""
    for family in SHAPES:
        mine = [scene for scene in SCENES if scene.family == family]
        yield " / ".join(f"{100 * max(_error(found[s], reference[s], q) for s in mine):.1f}" for q in QUANTITIES)


def _error(answer: SceneResult, reference: SceneResult, quantity: str) -> float:
    value = reference.value(quantity)
    return float(np.abs(answer.value(quantity) - value).max() / np.abs(value).max())


def row(name: str, nodes: Sequence[int], cells: Iterator[str]) -> None:
    """Print as it comes."""
    print(f"| {name} | {', '.join(map(str, nodes))} | {' | '.join(cells)} |", flush=True)


def main() -> None:
    """Print the table."""
    print(f"| mesh | nodes | {' | '.join(SHAPES)} |\n|{'---|' * (2 + len(SHAPES))}", flush=True)
    nodes, reference = answers(even(4))
    for name, mesh in (("n = 3, the bars", even(3)), ("n = 2", even(2)), ("default", MeshSpec())):
        made, found = answers(mesh)
        row(name, made, errors(found, reference))
    print(f"| reference, n = 4 | {', '.join(map(str, nodes))} |" + " – |" * len(SHAPES))


if __name__ == "__main__":
    main()
