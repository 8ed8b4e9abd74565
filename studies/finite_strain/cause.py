"""Why linear force is too high on a finger: what is changed of the default finger, and what that does to the sign.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.finite_strain.cause FILE     # some ten minutes of processor time

Each row is pressed at small and at finite strain on one mesh. Finite strain in some layers alone leaves the others
linear, on the same mesh: whose geometry it is that counts.
"""

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.config import Contact, FingertipConfig, MeshSpec, Tissue
from sim.fem.elements import lame
from sim.finger.mesh import DERMIS, EPIDERMIS, FAT
from sim.finger.surface import FingertipSurface
from sim.models.condensed import young_ratios
from sim.models.section import prismatic
from studies.finite_strain.solver.body import Body, LinearBricks
from studies.finite_strain.solver.bricks import Dilatation, Moduli, bricks
from studies.finite_strain.solver.laws import NeoHookean
from studies.finite_strain.solver.press import presses
from studies.finite_strain.solver.scene import Kind, Specimen
from studies.finite_strain.states import LONGEST_MM, MESHES, read

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

DEPTHS_MM = (0.15, 0.33, 0.45, 0.6)
ALL = (EPIDERMIS, DERMIS, FAT)


class StrainCase(NamedTuple):
    """What differs from the default finger under cylinder 9."""

    what: str
    mesh: str = "finger 0.35"
    shape: str = "cylinder:9"
    tissue: Tissue = Tissue()
    finite: tuple[int, ...] = ALL
    straight: bool = False


CASES = (
    StrainCase("nothing"),
    StrainCase("finite strain in the epidermis alone", finite=(EPIDERMIS,)),
    StrainCase("finite strain below the epidermis alone", finite=(DERMIS, FAT)),
    StrainCase("all layers as stiff as the epidermis", tissue=Tissue(e_dermis=1.0, e_fat=1.0)),
    StrainCase("layers below a third as stiff as the epidermis", tissue=Tissue(e_dermis=1 / 3, e_fat=1 / 3)),
    StrainCase("epidermis 0.1 mm thick", tissue=Tissue(epidermis_mm=0.1)),
    StrainCase("Poisson's ratio 0.3", tissue=Tissue(poisson=0.3)),
    StrainCase("full integration", "finger 0.35 full"),
    StrainCase("full integration, Poisson's ratio 0.3", "finger 0.35 full", tissue=Tissue(poisson=0.3)),
    StrainCase("3 mm cylinder along", shape="cylinder:3"),
    StrainCase("3 mm cylinder across", shape="cylinder:3,across"),
    StrainCase("3 mm cylinder across, finger straight", shape="cylinder:3,across", straight=True),
    StrainCase("3 mm cylinder across, 0.7 mm mesh", "finger 0.7", "cylinder:3,across"),
    StrainCase("3 mm cylinder across, 0.7 mm mesh, full integration", "finger 0.7 full", "cylinder:3,across"),
    StrainCase("3 mm cylinder along, 0.7 mm mesh, full integration", "finger 0.7 full", "cylinder:3"),
    StrainCase("section", "section 0.17"),
    StrainCase("section, finite strain in the epidermis alone", "section 0.17", finite=(EPIDERMIS,)),
    StrainCase("section, finite strain below the epidermis alone", "section 0.17", finite=(DERMIS, FAT)),
    StrainCase(
        "section, all layers as stiff as the epidermis", "section 0.17", tissue=Tissue(e_dermis=1.0, e_fat=1.0)
    ),
)


@dataclass(frozen=True)
class Parts:
    """Elements of which some are at finite strain and the others linear."""

    elements: Ints
    finite: NDArray[np.bool_]
    kinds: tuple[LinearBricks, Any]

    @classmethod
    def of(cls, specimen: Specimen, layers: Sequence[int], dilatation: Dilatation) -> "Parts":
        """A specimen's, at finite strain in those layers."""
        mesh, one, poisson = specimen.mesh, specimen.one_slice, specimen.config.tissue.poisson
        layer, hexes, law = mesh.layer[one], mesh.hexes[one], NeoHookean()
        young, finite = young_ratios(specimen.config.tissue)[layer], np.isin(layer, layers)
        soft, hard = (
            bricks(mesh.nodes, hexes[some], Moduli(*lame(young[some], poisson)), law, dilatation)
            for some in (finite, ~finite)
        )
        return cls(hexes, finite, (LinearBricks.like(hard, mesh.nodes, poisson), soft))

    def energy(self, u: Array) -> float:
        """N·mm at (n_nodes, 3) mm."""
        return sum(float(one.energy(u)) for one in self.kinds)

    def tangent(self, u: Array) -> tuple[Array, Array]:
        """(n, 24) forces and (n, 24, 24) stiffness."""
        n = len(self.elements)
        force, stiffness = np.empty((n, 24)), np.empty((n, 24, 24))
        for mine, one in zip((~self.finite, self.finite), self.kinds, strict=True):
            force[mine], stiffness[mine] = one.tangent(u)
        return force, stiffness


class Straight(Specimen):
    """Curved across alone: the receptor plane's outline all along."""

    @cached_property
    def surface(self) -> FingertipSurface:
        """Its skin."""
        return prismatic(FingertipSurface.fit(self.config.geometry), self.config.receptor_plane_mm)


def rows(case: StrainCase) -> Iterator[dict[str, Any]]:
    """One a depth: linear force over that at finite strain, less one."""
    kind: Kind = "section" if case.mesh.startswith("section") else "finger"
    mesh = MeshSpec.model_validate(MESHES[case.mesh])
    config = FingertipConfig(tissue=case.tissue, mesh=mesh, contact=Contact(between_nodes=False))
    one = (Straight if case.straight else Specimen)(config, kind)
    dilatation: Dilatation = "full" if case.mesh.endswith("full") else "bbar"
    linear = one.body(None, dilatation)
    finite = one.body(NeoHookean(), dilatation)
    if case.finite != ALL:
        finite = Body(Parts.of(one, case.finite, dilatation), one.unknown, finite.share)
    touch = one.touch(case.shape)
    found = [presses(body, one.skin, touch, DEPTHS_MM, LONGEST_MM[kind]) for body in (linear, finite)]
    for ours, theirs in zip(*found, strict=False):
        off = round(ours.force / theirs.force - 1, 4)
        yield {"what": case.what, "mesh": case.mesh, "shape": case.shape, "doi_mm": theirs.doi_mm, "off": off}


def markdown(kept: Sequence[dict[str, Any]]) -> Iterator[str]:
    """The table of causes in `docs/validation/small_strain.md`."""
    yield f"| changed | {' | '.join(f'{doi:g} mm' for doi in DEPTHS_MM)} |"
    yield f"|---|{'---|' * len(DEPTHS_MM)}"
    for case in CASES:
        at = {row["doi_mm"]: f"{100 * row['off']:+.1f} %" for row in kept if row["what"] == case.what}
        yield f"| {case.what} | {' | '.join(at.get(doi, '–') for doi in DEPTHS_MM)} |"


def main(path: str) -> None:
    """Append what is missing and print the table."""
    file = Path(path)
    for case in CASES:
        if case.what not in {row["what"] for row in read(file)}:
            with file.open("a", encoding="utf-8") as out:
                out.writelines(json.dumps(row) + "\n" for row in rows(case))
    for line in markdown(read(file)):
        print(line)


if __name__ == "__main__":
    main(*sys.argv[1:])
