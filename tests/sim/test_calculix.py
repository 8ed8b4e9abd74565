"""The same scene in another program: CalculiX (Debian: apt-get install calculix-ccx)."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from sim.config import Contact, FingertipConfig
from sim.finger.mesh import build_mesh
from sim.models.fingertip import Fingertip
from sim.models.full_mesh import MeshedFinger, write_contact_deck, write_load_deck
from sim.models.result import IndentationResult
from tests.sim.coarse_mesh import coarse_mesh

pytestmark = [
    pytest.mark.skipif(shutil.which("ccx") is None, reason="no ccx (Debian package calculix-ccx)"),
    pytest.mark.xdist_group("calculix"),
]

# Like with like: CalculiX's C3D8 is fully integrated, its contact is at nodes. Coarse, so that its jobs take seconds:
# both programs have the same mesh, so that its errors are theirs alike.
CONFIG = FingertipConfig(
    contact=Contact(between_nodes=False),
    mesh=coarse_mesh(0.8, 1.0, patch_x_mm=2.4, patch_z_mm=3.2).model_copy(update={"element": "full"}),
)
DOI_MM = 0.8


@pytest.fixture(scope="module")
def pressed() -> tuple[MeshedFinger, IndentationResult]:
    finger = Fingertip.load(CONFIG)
    meshed = MeshedFinger(CONFIG, build_mesh(CONFIG, finger.model.surface), finger.e_epidermis_mpa)
    return meshed, finger.indent("bar:3.0", 0.0, doi_mm=DOI_MM)


def run_ccx(folder: Path, job: str) -> str:
    ended = subprocess.run(["ccx", "-i", job], cwd=folder, capture_output=True, text=True, timeout=160, check=False)
    assert "Job finished" in ended.stdout, ended.stdout[-500:]
    return (folder / f"{job}.dat").read_text()


def test_calculix_moves_nodes_alike_under_the_same_forces(
    tmp_path: Path, pressed: tuple[MeshedFinger, IndentationResult]
) -> None:
    meshed, result = pressed
    mesh, active = meshed.mesh, result.state.active
    force = np.zeros((int(active.sum()), 3))
    force[:, :2] = result.state.force[:, active].T * meshed.e_epidermis_mpa
    write_load_deck(tmp_path / "load.inp", meshed, mesh.patch_nodes[active], force)
    rows = [line.split() for line in run_ccx(tmp_path, "load").splitlines()]
    u = np.array([[float(v) for v in row[1:]] for row in rows if len(row) == 4 and row[0].isdigit()])
    assert u.shape == mesh.nodes.shape
    # 1e-6 of the largest displacement: CalculiX prints seven digits.
    ours = result.state.displacement.T
    np.testing.assert_allclose(u[mesh.patch_nodes, :2], ours, rtol=0, atol=1e-6 * np.abs(ours).max())


def test_calculix_contact_carries_the_same_force(
    tmp_path: Path, pressed: tuple[MeshedFinger, IndentationResult]
) -> None:
    # Node to surface with a penalty of 2000 MPa/mm; reactions are compared, never pressures: those depend on it.
    meshed, result = pressed
    write_contact_deck(tmp_path / "contact.inp", meshed, result.indentor.profile, 0.0, result.touch_height_mm, DOI_MM)
    printed = run_ccx(tmp_path, "contact")
    totals = re.findall(r"total force.*?\n\s*\n\s*(\S+)\s+(\S+)\s+(\S+)", printed)
    assert float(totals[-1][1]) == pytest.approx(-result.force_n, rel=2e-5)
