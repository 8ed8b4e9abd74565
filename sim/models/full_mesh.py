"""CalculiX input decks, for comparison with another program, and strain maps of the receptor plane.

CalculiX's C3D8 is fully integrated: compare with `mesh.element = "full"`. Format: CalculiX CrunchiX user's manual.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import griddata

from sim.config import FingertipConfig
from sim.contact.profiles import IndentorProfile
from sim.fem.elements import strain_matrix
from sim.finger.mesh import FingerMesh, MeshError, build_mesh
from sim.finger.surface import FingertipSurface
from sim.measures.measures import measures_in_layers
from sim.measures.receptors import sampled
from sim.models.condensed import discretise, factorise, meshed_for, young_ratios
from sim.models.factored_interior import displaced
from sim.models.result import IndentationResult
from sim.models.sources import widened
from sim.models.stiffening import refuse_stiffening

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_PER_LINE = 12
_INDENTOR_HALF_MM = 3.4
_INDENTOR_TOP_MM = 1.0
_STEEP = 20.0
_NO_HIGHER_POWER = 1e20  # 1/MPa: CalculiX divides powers of J − 1 by it, and replaces 0 by a default of its own
CONTACT_STIFFNESS_MPA_PER_MM = 2000.0
FRICTION_STIFFNESS_MPA_PER_MM = 200.0, 20.0
"""Penalties of the normal gap and of the slip with friction; stiffer ones cycle between stick and slip."""


@dataclass(frozen=True)
class MeshedFinger:
    """Finger mesh and the stiffness of its layers, E(epidermis) in MPa. Raises MeshError for quadratic elements.

    At finite strain the layers follow Yeoh's law, neo-Hookean where tissue does not stiffen, with the same
    small-strain moduli. At small strain, tissue that stiffens raises ModelRangeError. In plane strain nothing moves
    along z.
    """

    config: FingertipConfig
    mesh: FingerMesh
    e_epidermis_mpa: float
    finite_strain: bool = False
    plane_strain: bool = False

    def __post_init__(self) -> None:
        if not self.finite_strain:
            refuse_stiffening(self.config.tissue, "a deck")
        if self.mesh.order > 1:
            raise MeshError(
                'mesh.element = "quadratic": a deck supports elements of eight nodes only; set mesh.element = "full"',
                "quadratic",
            )


def write_load_deck(path: Path, finger: MeshedFinger, nodes: Ints, force_n: Array) -> None:
    """Write the finger under (n, 3) N on n nodes; it prints all displacements and the sum of the reactions."""
    with path.open("w", encoding="ascii") as file:
        _write_finger(file, finger)
        file.write(_step(finger, "*STEP") + "*STATIC,SOLVER=SPOOLES\n*CLOAD\n")
        for node, force in zip(nodes + 1, force_n, strict=True):
            file.writelines(f"{node},{axis},{value:.12g}\n" for axis, value in enumerate(force, 1) if value)
        file.write("*NODE PRINT,NSET=NALL\nU\n*NODE PRINT,NSET=NFIX,TOTALS=ONLY\nRF\n*END STEP\n")


def write_contact_deck(
    path: Path,
    finger: MeshedFinger,
    profile: IndentorProfile,
    x_mm: float,
    touch_mm: float,
    doi_mm: float,
    *,
    friction: float = 0.0,
    slide_mm: float = 0.0,
) -> None:
    """Write a rigid indentor pressed from first touch to a depth, node to surface; it prints its total reaction.

    With friction it then slides along x, and all displacements are printed too.
    """
    mesh = finger.mesh
    corners, bricks, faces = _indentor(profile, x_mm, touch_mm, mesh.nodes[:, 2].min(), mesh.nodes[:, 2].max())
    n_nodes, n_elements = len(mesh.nodes), len(mesh.hexes)
    with path.open("w", encoding="ascii") as file:
        _write_finger(file, finger)
        file.write("*NODE,NSET=NIND\n")
        _write_nodes(file, corners, n_nodes)
        file.write("*ELEMENT,TYPE=C3D8,ELSET=EIND\n")
        _write_elements(file, bricks + n_nodes, n_elements)
        file.write("*MATERIAL,NAME=RIGID\n*ELASTIC\n1.E5,0.3\n*SOLID SECTION,ELSET=EIND,MATERIAL=RIGID\n")
        layers = np.arange(mesh.grid[0] if finger.plane_strain else 1) * mesh.grid[1] * mesh.grid[2]
        _write_set(file, "*NSET,NSET=NSKIN", np.unique(mesh.patch_nodes + layers[:, None]))
        file.write("*SURFACE,NAME=SKIN,TYPE=NODE\nNSKIN\n*SURFACE,NAME=TOOL,TYPE=ELEMENT\n")
        file.writelines(f"{n_elements + element + 1},{face}\n" for element, face in faces)
        file.write("*SURFACE INTERACTION,NAME=CONTACT\n*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR\n")
        file.write(f"{FRICTION_STIFFNESS_MPA_PER_MM[0] if friction else CONTACT_STIFFNESS_MPA_PER_MM:.9g},1.E-6\n")
        if friction:
            file.write(f"*FRICTION\n{friction:.9g},{FRICTION_STIFFNESS_MPA_PER_MM[1]:.9g}\n")
        file.write("*CONTACT PAIR,INTERACTION=CONTACT,TYPE=NODE TO SURFACE\nSKIN,TOOL\n")
        file.write(_step(finger, "*STEP,INC=200") + "*STATIC,SOLVER=SPOOLES\n")
        small = finger.finite_strain or friction > 0
        file.write("0.1,1.,1.E-5,0.1\n*BOUNDARY\n" if small else "0.25,1.,1.E-5,0.25\n*BOUNDARY\n")
        file.write(f"NIND,1,1\nNIND,3,3\nNIND,2,2,{-doi_mm:.12g}\n")
        printed = "*NODE PRINT,NSET=NIND,TOTALS=ONLY\nRF\n"
        if friction:
            printed += "*NODE PRINT,NSET=NALL\nU\n"
        if slide_mm:
            file.write(f"*NODE PRINT,NSET=NIND,TOTALS=ONLY\nRF\n*END STEP\n{_step(finger, '*STEP,INC=200')}")
            file.write(f"*STATIC,SOLVER=SPOOLES\n0.1,1.,1.E-5,0.1\n*BOUNDARY\nNIND,1,1,{slide_mm:.12g}\n")
        file.write(f"{printed}*END STEP\n")


def _write_finger(file: TextIO, finger: MeshedFinger) -> None:
    mesh, tissue = finger.mesh, finger.config.tissue
    file.write("*NODE,NSET=NALL\n")
    _write_nodes(file, mesh.nodes, 0)
    file.write("*ELEMENT,TYPE=C3D8,ELSET=EALL\n")
    _write_elements(file, mesh.hexes, 0)
    for layer, ratio in enumerate(young_ratios(tissue)):
        elements = np.flatnonzero(mesh.layer == layer)
        if not len(elements):
            continue
        _write_set(file, f"*ELSET,ELSET=LAYER{layer}", elements)
        file.write(f"*MATERIAL,NAME=TISSUE{layer}\n")
        file.write(_law(finger, finger.e_epidermis_mpa * float(ratio)))
        file.write(f"*SOLID SECTION,ELSET=LAYER{layer},MATERIAL=TISSUE{layer}\n")
    _write_set(file, "*NSET,NSET=NFIX", np.flatnonzero(mesh.fixed))
    file.write("*BOUNDARY\nNFIX,1,3\n")
    if finger.plane_strain:
        file.write("NALL,3,3\n")


def _law(finger: MeshedFinger, young_mpa: float) -> str:
    """Return Hooke's law, or CalculiX's U = C10 (Ī₁ − 3) + C20 (Ī₁ − 3)² + (J − 1)² / D1."""
    poisson, stiffening = finger.config.tissue.poisson, finger.config.tissue.stiffening
    if not finger.finite_strain:
        return f"*ELASTIC\n{young_mpa:.12g},{poisson:.12g}\n"
    mu, kappa = young_mpa / (2 * (1 + poisson)), young_mpa / (3 * (1 - 2 * poisson))
    if stiffening == 0:
        return f"*HYPERELASTIC,NEO HOOKE\n{0.5 * mu:.12g},{2 / kappa:.12g}\n"
    higher = f"{_NO_HIGHER_POWER:.0e},{_NO_HIGHER_POWER:.0e}"
    return f"*HYPERELASTIC,YEOH\n{0.5 * mu:.12g},{0.5 * mu * stiffening:.12g},0.,{2 / kappa:.12g},{higher}\n"


def _step(finger: MeshedFinger, card: str) -> str:
    return f"{card}{',NLGEOM' if finger.finite_strain else ''}\n"


def _indentor(
    profile: IndentorProfile, x_mm: float, lowest_mm: float, z0: float, z1: float
) -> tuple[Array, Ints, list[tuple[int, str]]]:
    """Return nodes, bricks and contact faces of the profile extruded along z, without its steep flanks."""
    s = np.unique(np.concatenate([np.linspace(-_INDENTOR_HALF_MM, _INDENTOR_HALF_MM, 137), *_bends(profile)]))
    height, slope, _ = profile.evaluate(s)
    s, height = s[np.abs(slope) < _STEEP], height[np.abs(slope) < _STEEP]
    below = np.stack([s + x_mm, lowest_mm + height], axis=1)
    above = np.stack([s + x_mm, np.full(len(s), lowest_mm + height.max() + _INDENTOR_TOP_MM)], axis=1)
    flat = np.concatenate([below, above])
    corners = np.concatenate([np.insert(flat, 2, z, axis=1) for z in (z0, z1)])
    n = len(s)
    k = np.arange(n - 1)
    front = np.stack([k, k + 1, k + 1 + n, k + n], axis=1)
    bricks = np.concatenate([front, front + 2 * n], axis=1)
    return corners, bricks, [(int(element), "S3") for element in k]


def _bends(profile: IndentorProfile) -> Iterable[Array]:
    """Return extra stations where the profile curves, so that facets follow it within a micrometer or so."""
    s = np.linspace(-_INDENTOR_HALF_MM, _INDENTOR_HALF_MM, 40001)
    _, slope, curvature = profile.evaluate(s)
    bent = (np.abs(curvature) > 0) & (np.abs(slope) < _STEEP)
    turned = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(np.arctan(slope))))])
    stations = np.searchsorted(turned, np.arange(0.0, turned[-1], 0.05))
    return (s[np.unique(stations[stations < len(s)])], s[np.flatnonzero(np.diff(bent.astype(int)))])


def _write_nodes(file: TextIO, nodes: Array, offset: int) -> None:
    file.writelines(f"{offset + k},{x:.12g},{y:.12g},{z:.12g}\n" for k, (x, y, z) in enumerate(nodes, 1))


def _write_elements(file: TextIO, elements: Ints, offset: int) -> None:
    file.writelines(f"{offset + k},{','.join(map(str, row))}\n" for k, row in enumerate((elements + 1).tolist(), 1))


def _write_set(file: TextIO, card: str, numbers: Ints) -> None:
    file.write(f"{card}\n")
    file.writelines(f"{','.join(map(str, part))},\n" for part in _parts((numbers + 1).tolist()))


def _parts(numbers: Sequence[int]) -> Iterator[Sequence[int]]:
    for start in range(0, len(numbers), _PER_LINE):
        yield numbers[start : start + _PER_LINE]


# --- strain map ---


@dataclass(frozen=True)
class StrainMap:
    """Strain measures in the receptor plane's elements, from the skin inwards and once around.

    `corner_mm` and `moved_mm` (n_phi + 1, n_r, 2) are x and y of the corners, undeformed and deformed; `measures` the
    18, each (n_phi, n_r − 1), tension positive, stresses in pseudo-units.
    """

    corner_mm: Array
    moved_mm: Array
    measures: dict[str, Array]

    def carried(self, points_mm: Array) -> Array:
        """Return the (n, 2) deformed positions of points of the undeformed section (mm)."""
        corner, by = self.corner_mm[:-1].reshape(-1, 2), (self.moved_mm - self.corner_mm)[:-1].reshape(-1, 2)
        return np.asarray(points_mm + griddata(corner, by, points_mm))


def strain_maps(config: FingertipConfig, results: Sequence[IndentationResult]) -> list[StrainMap]:
    """Return one map for each indentation, by one factorization (seconds) per mesh and one solve each.

    The strain is taken where each cell's is most accurate, averaged over the cells on both sides of the plane, and
    not smoothed.
    """
    found: dict[int, StrainMap] = {}
    kinds = [(r.model.patch.axes, r.model.widened_mm, r.indentor.axes) for r in results]
    for kind in set(kinds):
        mine = [k for k, other in enumerate(kinds) if other == kind]
        mesh = mesh_of(config, results[mine[0]])
        moved = displacements(config, mesh, [results[k] for k in mine])
        found |= zip(mine, _in_plane(config, mesh, moved), strict=True)
    return [found[k] for k in range(len(results))]


def mesh_of(config: FingertipConfig, result: IndentationResult) -> FingerMesh:
    """Rebuild the mesh of an indentation, from the axes along which the indentor slopes and its patch."""
    config = result.meshed_by(config)
    meshed = meshed_for(widened(config, result.model.widened_mm), result.model.patch.axes[:-1])
    return build_mesh(meshed, FingertipSurface.fit(config.geometry))


def _in_plane(config: FingertipConfig, mesh: FingerMesh, displacement: Array) -> Iterator[StrainMap]:
    plane = int(np.argmin(np.abs(mesh.z_mm - config.receptor_plane_mm)))
    cells = np.stack(np.meshgrid([plane - 1, plane], *(np.arange(n) for n in (mesh.grid[1], mesh.grid[2] - 1)),
                                 indexing="ij"), -1)  # fmt: skip
    elements, local = sampled(mesh, cells.reshape(-1, 3))
    nodes = mesh.hexes[elements]
    strains = strain_matrix(mesh.nodes[nodes], local)
    ratio = young_ratios(config.tissue)[mesh.layer[elements]].reshape(cells.shape[:3])[1]
    section = np.arange(len(mesh.nodes)).reshape(mesh.grid)[plane]
    corner = mesh.nodes[section, :2]
    for u in displacement:
        strain = np.einsum("mij,mj->mi", strains, u[nodes].reshape(len(nodes), -1)).reshape(2, -1, 6).mean(axis=0)
        measures = measures_in_layers(strain, ratio.ravel(), config.tissue.poisson)
        by_cell = {name: values.reshape(ratio.shape) for name, values in measures.items()}
        yield StrainMap(_closed(corner), _closed(corner + u[section, :2]), by_cell)


def _closed(corner: Array) -> Array:
    return np.concatenate([corner, corner[:1]])


def displacements(config: FingertipConfig, mesh: FingerMesh, results: Sequence[IndentationResult]) -> Array:
    """Return (n_results, n_nodes, 3) displacements in mm of every node under the contact forces of indentations."""
    problem = discretise(config, mesh)
    factor = factorise(replace(problem, kept=problem.kept[:1]))  # a single unknown, since nothing needs condensing
    return displaced(problem, factor, results)
