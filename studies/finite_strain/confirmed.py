"""The same states by CalculiX: its equilibrium under our contact forces, and its own contact where that converges.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.finite_strain.confirmed FILE     # needs ccx; minutes

Equilibrium: fully integrated neo-Hookean bricks with NLGEOM on our mesh, our contact's forces as dead loads. If its
displacements are ours, ours is a state of CalculiX's body; that it satisfies the contact is read off the gap.
"""

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.contact.indentor import Prismatic
from sim.models.full_mesh import MeshedFinger, write_contact_deck, write_load_deck
from studies.finite_strain.solver.laws import NeoHookean
from studies.finite_strain.solver.press import PressedBody, presses
from studies.finite_strain.solver.scene import Specimen
from studies.finite_strain.states import LONGEST_MM, PressedShape, specimen

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MISSING = "CalculiX (ccx) is not installed (Debian: apt-get install calculix-ccx): its confirmation is left out"
LONGEST_S = 3600
FACES = np.array([1, 2, 2, 1]) / 6
"""Of a section's load, what each of its slices' faces carries."""

EQUILIBRIA = (
    (PressedShape("section 0.17 full", "bar:3.0"), 1.33),
    (PressedShape("section 0.17 full", "cylinder:9"), 1.33),
    (PressedShape("section 0.17 full", "step:1"), 1.33),
    (PressedShape("finger 0.4", "cylinder:9"), 1.0),
    (PressedShape("finger 0.35", "bar:3.0"), 1.0),
)
CONTACTS = (
    (PressedShape("finger 0.7 full", "cylinder:3"), 0.15),
    (PressedShape("finger 0.7 full", "cylinder:3"), 0.45),
)


def equilibrium(scene: PressedShape, doi_mm: float) -> dict[str, Any]:
    """Largest difference of any node's displacement, over the largest displacement."""
    one = specimen(scene)
    body, touch = one.body(NeoHookean(), "full"), one.touch(scene.shape, scene.x_mm)
    (pressed,) = presses(body, one.skin, touch, [doi_mm], LONGEST_MM[one.kind])
    u = body.displacement(pressed.unknowns)
    nodes, force = loads(one, pressed)
    with tempfile.TemporaryDirectory() as folder:
        deck = Path(folder) / "load.inp"
        write_load_deck(deck, _meshed(one, finite=True), nodes, force)
        theirs = displacements(run(deck), len(u))
    off = float(np.abs(theirs - u).max() / np.abs(u).max())
    return {**scene._asdict(), "doi_mm": doi_mm, "what": "equilibrium", "off": off, "force": pressed.force}


def contact(scene: PressedShape, doi_mm: float) -> dict[str, Any]:
    """CalculiX's force at finite strain over its own linear one, beside ours; its deck's penalty and increments."""
    one = specimen(scene)
    touch = one.touch(scene.shape, scene.x_mm)
    assert isinstance(touch.indentor, Prismatic)
    force, ours = [], []
    for finite in (True, False):
        with tempfile.TemporaryDirectory() as folder:
            deck = Path(folder) / "contact.inp"
            profile = touch.indentor.profile
            write_contact_deck(deck, _meshed(one, finite=finite), profile, scene.x_mm, touch.height_mm, doi_mm)
            force.append(-last_total(run(deck))[1])
        body = one.body(NeoHookean() if finite else None, "full")
        ours += [pressed.force for pressed in presses(body, one.skin, touch, [doi_mm], LONGEST_MM[one.kind])]
    found = {"theirs": force[0] / force[1], "ours": ours[0] / ours[1], "linear_off": force[1] / ours[1] - 1}
    return {**scene._asdict(), "doi_mm": doi_mm, "what": "contact", **found}


def loads(one: Specimen, pressed: PressedBody) -> tuple[Ints, Array]:
    """Nodes of the mesh and (n, 3) N on them; a section's over its four faces."""
    touched = pressed.touched
    force = touched.load_n[:, None] * touched.normal
    nodes = one.mesh.patch_nodes[touched.nodes]
    if one.kind == "finger":
        return nodes, force
    face = int(np.prod(one.mesh.grid[1:]))
    everywhere = nodes % face + face * np.arange(len(FACES))[:, None]
    return everywhere.ravel(), (FACES[:, None, None] * force).reshape(-1, 3)


def _meshed(one: Specimen, *, finite: bool) -> MeshedFinger:
    return MeshedFinger(one.config, one.mesh, 1.0, finite_strain=finite, plane_strain=one.kind == "section")


def run(deck: Path) -> str:
    """What CalculiX prints; raises RuntimeError where it does not finish, as it does not where contact diverges."""
    command = ["ccx", "-i", deck.stem]
    ended = subprocess.run(command, cwd=deck.parent, capture_output=True, text=True, timeout=LONGEST_S, check=False)
    if "Job finished" not in ended.stdout:
        raise RuntimeError(f"CalculiX: {ended.stdout.strip()[-200:]}")
    return deck.with_suffix(".dat").read_text()


def displacements(printed: str, n_nodes: int) -> Array:
    """(n_nodes, 3) mm, the last that were printed."""
    rows = [line.split() for line in printed.splitlines()]
    found = [[float(v) for v in row[1:]] for row in rows if len(row) == 4 and row[0].isdigit()]
    return np.array(found[-n_nodes:])


def last_total(printed: str) -> Array:
    """(3,) N, the last sum of reactions."""
    lines = printed.splitlines()
    last = max(k for k, line in enumerate(lines) if "total force" in line)
    return np.array([float(v) for v in lines[last + 2].split()])


def main(path: str) -> None:
    """Append what is missing."""
    if shutil.which("ccx") is None:
        print(MISSING)
        return
    file = Path(path)
    done = [json.loads(line) for line in file.read_text("utf-8").splitlines()] if file.exists() else []
    for make, cases in ((equilibrium, EQUILIBRIA), (contact, CONTACTS)):
        for scene, doi_mm in cases:
            if any(
                (*(row[n] for n in PressedShape._fields), row["doi_mm"], row["what"])
                == (*scene, doi_mm, make.__name__)
                for row in done
            ):
                continue
            try:
                row = make(scene, doi_mm)
            except RuntimeError as error:
                row = {**scene._asdict(), "doi_mm": doi_mm, "what": make.__name__, "failed": str(error)}
            print(row, flush=True)
            with file.open("a", encoding="utf-8") as out:
                out.write(json.dumps(row) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
