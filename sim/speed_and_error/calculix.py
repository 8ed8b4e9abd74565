"""One contact job by CalculiX on a mesh of ours, and the same contact here.

Debian: apt-get install calculix-ccx. The deck and its settings are `sim/models/uncondensed/deck.py`'s.
"""

import re
import resource
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from sim.config.fingertip_config import Contact, FingertipConfig, MeshSpec
from sim.contact.indentor import Prismatic
from sim.finger.mesh import build_mesh
from sim.models.catalogue import load
from sim.models.uncondensed.deck import CONTACT_STIFFNESS_MPA_PER_MM, MeshedFinger, write_contact_deck

CONFIG = FingertipConfig(
    contact=Contact(between_nodes=False),
    mesh=MeshSpec(
        spacing_mm=0.5, axial_spacing_mm=0.5, element="full", epidermis_elements=1, dermis_spacing_mm=0.4, growth=1.5
    ),
)
"""Like with like: CalculiX's C3D8 is fully integrated, its contact at nodes. Coarse, so that its job is short."""

SHAPE, DOI_MM = "bar:3.0", 0.8
_REPEATS = 20
_LONGEST_S = 3600


@dataclass(frozen=True)
class Comparison:
    """Forces in N and CPU seconds of both."""

    scene: str
    nodes: int
    stiffness_mpa_per_mm: float
    force_n: float
    cpu_s: float
    our_force_n: float
    our_build_s: float
    our_cpu_s: float


def available() -> bool:
    """Whether CalculiX can be called."""
    return shutil.which("ccx") is not None


def compare(config: FingertipConfig = CONFIG, shape: str = SHAPE, doi_mm: float = DOI_MM) -> Comparison:
    """Solve one scene, from rest at x = 0, with both; seconds on the coarse mesh."""
    finger = load("finger", config, cached=False)
    result = finger.indent(shape, 0.0, doi_mm=doi_mm)
    start = time.process_time()
    for _ in range(_REPEATS):
        finger.indent(shape, 0.0, doi_mm=doi_mm)
    our_cpu_s = (time.process_time() - start) / _REPEATS
    meshed = MeshedFinger(config, build_mesh(config, finger.surface), finger.e_epidermis_mpa)
    with tempfile.TemporaryDirectory() as folder:
        deck = Path(folder) / "contact.inp"
        assert isinstance(result.indentor, Prismatic)
        write_contact_deck(deck, meshed, result.indentor.profile, 0.0, result.touch_height_mm, doi_mm)
        force_n, cpu_s = _job(deck)
    return Comparison(
        f"{shape}, DOI {doi_mm} mm", finger.model.nodes, CONTACT_STIFFNESS_MPA_PER_MM, force_n, cpu_s,
        result.force_n, finger.build_s, our_cpu_s,
    )  # fmt: skip


def _job(deck: Path) -> tuple[float, float]:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = ["ccx", "-i", deck.stem]
    subprocess.run(command, cwd=deck.parent, capture_output=True, timeout=_LONGEST_S, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    printed = deck.with_suffix(".dat").read_text()
    total = re.findall(r"total force.*?\n\s*\n\s*(\S+)\s+(\S+)\s+(\S+)", printed)[-1]
    return -float(total[1]), after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
