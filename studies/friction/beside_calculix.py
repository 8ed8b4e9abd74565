"""Presses with friction in CalculiX and here: force, shear and SED. Needs `ccx`; minutes a scene.

    .venv/bin/python -m studies.friction.beside_calculix

Fully integrated elements and contact at nodes in both. CalculiX lets the skin slip and sink in elastically; strain at
the receptors is recovered from its displacements as from ours.
"""

import re
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.config import Contact, FingertipConfig, MeshSpec
from sim.contact.indentor import Prismatic
from sim.finger.mesh import FingerMesh, build_mesh, section_mesh
from sim.finger.surface import FingertipSurface
from sim.measures.measures import measures_in_layers
from sim.measures.receptors import strain_operator
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.full_mesh import MeshedFinger, write_contact_deck
from sim.models.section import prismatic

Array = NDArray[np.float64]

FRICTION = 0.3
LONGEST_S = 3600


@dataclass(frozen=True)
class Scene:
    """A press, and a slide after it."""

    model: Literal["section", "finger"]
    shape: str
    doi_mm: float
    slide_mm: float
    mesh: MeshSpec


@dataclass(frozen=True)
class Answer:
    """Force (N, of a section N/mm), shear along x, and SED at the receptors."""

    force: float
    shear: float
    sed: Array


_SECTION = MeshSpec(spacing_mm=0.3, element="full", epidermis_elements=1, dermis_spacing_mm=0.3, growth=1.5)
_FINGER = MeshSpec(
    spacing_mm=0.5,
    axial_spacing_mm=0.8,
    element="full",
    epidermis_elements=1,
    dermis_spacing_mm=0.4,
    dermis_fine_depth_mm=0.5,
    growth=2.0,
    patch_z_mm=3.0,
    near_spacing_mm=1.5,
    near_width_mm=0.5,
    far_spacing_mm=3.0,
    far_growth=2.0,
)
SCENES = (
    Scene("section", "bar:3.0", 0.6, 0.0, _SECTION),
    Scene("section", "cylinder:9", 0.5, 0.2, _SECTION),
    Scene("finger", "bar:3.0", 0.6, 0.0, _FINGER),
)


def here(scene: Scene, increment_mm: float = 0.01) -> tuple[Fingertip, Answer]:
    """Return this program's finger and answer; a slide goes on at the height of the press."""
    config = FingertipConfig(contact=Contact(between_nodes=False), mesh=scene.mesh)
    finger = load(scene.model, config)
    if not scene.slide_mm:
        result = finger.indent(scene.shape, doi_mm=scene.doi_mm, friction=FRICTION, increment_mm=increment_mm)
        shear = float(result.state.force[0].sum()) * finger.e_epidermis_mpa
        return finger, Answer(result.force_n, shear, result.receptor_measures["sed"])
    slid = finger.with_friction(FRICTION).drag(
        scene.shape, [0.0, scene.slide_mm], scene.doi_mm, increment_mm, level=True
    )[-1]
    return finger, Answer(slid.force_n, slid.shear_force_n[0], slid.receptor_measures["sed"])


def calculix(scene: Scene, finger: Fingertip) -> Answer:
    """Return CalculiX's answer."""
    config, mesh = finger.config, _mesh(scene, finger)
    meshed = MeshedFinger(config, mesh, finger.e_epidermis_mpa, plane_strain=scene.model == "section")
    smooth = finger.indent(scene.shape, doi_mm=scene.doi_mm)
    assert isinstance(smooth.indentor, Prismatic)
    with tempfile.TemporaryDirectory() as folder:
        write_contact_deck(
            Path(folder) / "press.inp",
            meshed,
            smooth.indentor.profile,
            0.0,
            smooth.touch_height_mm,
            scene.doi_mm,
            friction=FRICTION,
            slide_mm=scene.slide_mm,
        )
        ended = subprocess.run(
            ["ccx", "-i", "press"], cwd=folder, capture_output=True, text=True, timeout=LONGEST_S, check=False
        )
        assert "Job finished" in ended.stdout, ended.stdout[-500:]
        printed = (Path(folder) / "press.dat").read_text()
    totals = re.findall(r"total force.*?\n\s*\n\s*(\S+)\s+(\S+)\s+(\S+)", printed)
    rows = [line.split() for line in printed.split("displacements")[-1].splitlines()]
    u = np.array([[float(v) for v in row[1:]] for row in rows if len(row) == 4 and row[0].isdigit()])
    operator, _ = strain_operator(mesh, finger.model.receptors.position_mm)
    strain = (operator @ u[: len(mesh.nodes)].ravel()).reshape(-1, 6)
    sed = measures_in_layers(strain, finger.model.columns.young_ratio, config.tissue.poisson)["sed"]
    return Answer(-float(totals[-1][1]), float(totals[-1][0]), sed)


def _mesh(scene: Scene, finger: Fingertip) -> FingerMesh:
    skin = FingertipSurface.fit(finger.config.geometry)
    if scene.model == "finger":
        return build_mesh(finger.config, skin)
    return section_mesh(finger.config, prismatic(skin, finger.config.receptor_plane_mm))


def largest_sed_error(ours: Answer, its: Answer) -> float:
    """Return the largest difference of SED at the receptors, relative to the largest SED."""
    return float(np.abs(ours.sed - its.sed).max() / its.sed.max())


def main() -> None:
    """Print the table."""
    print("| scene | CalculiX: force | here | error | CalculiX: shear | here | SED, largest error |")
    print("|---|---|---|---|---|---|---|")
    for scene in SCENES:
        finger, ours = here(scene)
        its = calculix(scene, finger)
        name = f"{scene.model}, {scene.shape}, {scene.doi_mm:g} mm"
        name += f", then {scene.slide_mm:g} mm along x" if scene.slide_mm else ""
        print(
            f"| {name} | {its.force:.6f} | {ours.force:.6f} | {ours.force / its.force - 1:+.3%} | {its.shear:.6f} | "
            f"{ours.shear:.6f} | {largest_sed_error(ours, its):.2%} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
