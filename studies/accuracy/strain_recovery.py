"""Ways to recover strain at a receptor from the elements around it, on the scenes of the study.

.venv/bin/python -m studies.accuracy.strain_recovery              # the default mesh; a minute or two
.venv/bin/python -m studies.accuracy.strain_recovery quadratic    # the same of quadratic elements

Errors are against the reference, as `rig bench` has them. "Jump" is the largest change between receptors 2.5 µm apart
and 0.75 mm under the skin, over the range along the row: under step 1, where strain is steepest.
"""

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.benchmark import FAMILIES, QUADRATIC, SCENES, BenchmarkScene, stored
from sim.config import FingertipConfig, MeshSpec
from sim.fem.elements import local_coordinates, shape_functions
from sim.finger.mesh import FingerMesh, build_mesh
from sim.measures.measures import Elastic, measures_from_strain
from sim.measures.receptors import (
    DEFAULT_DEPTH_MM,
    DEFAULT_X_MM,
    ReceptorSet,
    StrainSamples,
    blended,
    located,
    operator_of,
    patch_around,
    place_receptors,
    quadratic_fit,
    sampled,
)
from sim.models.catalogue import load
from sim.models.condensed import discretise, factorise, young_ratios
from sim.units import PSEUDO_E_EPIDERMIS

Array = NDArray[np.float64]
Way = Callable[[FingerMesh, Array], StrainSamples]

STEP = next(scene for scene in SCENES if scene.family == "step")
ROW_X_MM, ROW_DEPTH_MM = np.arange(-2.4, 1.2, 0.0025), 0.75


def straight(mesh: FingerMesh, point: Array) -> StrainSamples:
    """The strain of the element itself."""
    element = located(mesh, point).element
    local = local_coordinates(mesh.nodes[mesh.hexes[element]], point)
    return StrainSamples(np.array([element]), local[None], np.ones(1))


def inverse_distance(mesh: FingerMesh, point: Array) -> StrainSamples:
    """The samples of 3 × 3 × 3 cells, weighted by the inverse of their distance."""
    elements, local = sampled(mesh, patch_around(mesh, located(mesh, point).cell))
    corners = mesh.nodes[mesh.hexes[elements]]
    position = np.einsum("mk,mki->mi", shape_functions(corners.shape[1], local)[0], corners)
    weights = 1 / np.linalg.norm(position - point, axis=1)
    return StrainSamples(elements, local, weights / weights.sum())


WAYS: Mapping[str, Way] = {
    "straight from the element": straight,
    "inverse distance, 27 samples": inverse_distance,
    "one quadratic fit, 27 samples": lambda mesh, point: quadratic_fit(mesh, located(mesh, point).cell, point),
    "blended quadratic fits": lambda mesh, point: blended(mesh, located(mesh, point), point),
}


@dataclass(frozen=True)
class Solved:
    """Every node's displacement in each scene."""

    config: FingertipConfig
    mesh: FingerMesh
    displacement: Array  # (n_scenes, 3 n_nodes) mm

    def measures(self, way: Way, receptors: ReceptorSet) -> dict[str, Array]:
        """(n_scenes, n_receptors) of each measure, in pseudo-units; the receptors lie in one layer."""
        samples = [way(self.mesh, point) for point in receptors.position_mm]
        strain = (operator_of(self.mesh, samples) @ self.displacement.T).T
        tissue = self.config.tissue
        young = young_ratios(tissue)[self.mesh.layer[located(self.mesh, receptors.position_mm[0]).element]]
        material = Elastic(PSEUDO_E_EPIDERMIS * float(young), tissue.poisson)
        return measures_from_strain(strain.reshape(len(strain), -1, 6), material)


def solved(config: FingertipConfig, scenes: Sequence[BenchmarkScene]) -> Solved:
    """Contact by the condensed model, then its forces on the whole finger."""
    finger = load("finger", config, cached=False)
    mesh = build_mesh(config, finger.surface)
    problem = discretise(config, mesh)
    loads = np.zeros((len(scenes), len(mesh.nodes), 3))
    for load_, scene in zip(loads, scenes, strict=True):
        state = finger.indent(scene.shape, scene.x_mm, doi_mm=scene.doi_mm).state
        load_[mesh.patch_nodes, :2] = state.force.T
    displacement = np.zeros((len(scenes), mesh.nodes.size))
    displacement[:, problem.free] = factorise(problem).solve(loads.reshape(len(scenes), -1)[:, problem.free])
    return Solved(config, mesh, displacement)


def largest_error(found: Array, scenes: Sequence[BenchmarkScene], family: str, quantity: str) -> float:
    """As in `rig bench`, per cent."""
    reference = stored().values
    errors = [
        np.abs(values - reference[scene][quantity]).max() / np.abs(reference[scene][quantity]).max()
        for values, scene in zip(found, scenes, strict=True)
        if scene.family == family
    ]
    return 100 * max(errors)


def jump(values: Array) -> float:
    """Largest change between neighbours over the range, per cent."""
    return float(100 * np.abs(np.diff(values)).max() / np.ptp(values))


def main() -> None:
    """Print the table."""
    config = FingertipConfig(mesh=QUADRATIC if "quadratic" in sys.argv else MeshSpec())
    answer = solved(config, SCENES)
    surface = load("halfspace").surface
    ten = place_receptors(surface, np.array(DEFAULT_X_MM), DEFAULT_DEPTH_MM, config.receptor_plane_mm)
    row = place_receptors(surface, ROW_X_MM, ROW_DEPTH_MM, config.receptor_plane_mm)
    errors_of = [f"{family}: SED / ep1 (%)" for family in FAMILIES]
    head = ["strain", *errors_of, "jump: s33 / SED / ep1 (%)", "CPU ms a receptor"]
    print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}")
    for name, way in WAYS.items():
        start = time.process_time()
        at_ten = answer.measures(way, ten)
        seconds = (time.process_time() - start) / len(ten.position_mm)
        errors = [
            " / ".join(f"{largest_error(at_ten[q], SCENES, family, q):.1f}" for q in ("sed", "ep1"))
            for family in FAMILIES
        ]
        along = answer.measures(way, row)
        jumps = " / ".join(f"{jump(along[q][SCENES.index(STEP)]):.1f}" for q in ("s33", "sed", "ep1"))
        print(f"| {' | '.join([name, *errors, jumps, f'{1e3 * seconds:.1f}'])} |", flush=True)


if __name__ == "__main__":
    main()
