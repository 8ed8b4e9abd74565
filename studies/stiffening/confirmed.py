"""Presses of fingers that stiffen, by CalculiX: its equilibrium of Yeoh's tissue where our contact holds the skin.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.stiffening.confirmed FILE     # needs ccx; minutes

On the meshes of the references, with bricks that are fully integrated on both sides. What our contact touches is held
where we have it: CalculiX's displacements everywhere else are to be ours, and its reactions the loads of our
contact, square to the indentor. (Under the same loads as dead ones a deep press has other states of rest, too.)
"""

import json
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from sim.models.full_mesh import MeshedFinger, write_displacement_deck
from studies.finite_strain.confirmed import MISSING, displacements, run
from studies.finite_strain.solver.laws import Yeoh
from studies.finite_strain.solver.press import presses
from studies.finite_strain.solver.scene import Specimen
from studies.stiffening.fingers import finger
from studies.stiffening.references import StiffeningPress, read

CASES = (
    (StiffeningPress("default", "flat", 0.3), 2.0),
    (StiffeningPress("default", "bar:3.0", 0.3), 2.0),
    (StiffeningPress("default", "sphere:3", 0.3), 1.5),
    (StiffeningPress("default", "cylinder:4", 0.3), 1.25),
    (StiffeningPress("default", "flat", 1.0), 1.5),
    (StiffeningPress("human", "flat", 0.3), 2.5),
    (StiffeningPress("human", "bar:3.0", 0.3), 2.0),
    (StiffeningPress("human", "sphere:3", 0.3), 1.5),
    (StiffeningPress("human", "cylinder:4", 0.3), 1.25),
)
"""Both geometries and every kind of shape, as deep as most of the references."""

_STEP_MM = 0.25


def confirmed(scene: StiffeningPress, doi_mm: float) -> dict[str, Any]:
    """Largest differences of a displacement, over the largest, and of a touched node's force, over the largest.

    Raises ValueError where our press does not converge, RuntimeError where CalculiX does not.
    """
    one, law = Specimen(finger(scene.finger, stiffening=scene.stiffening)), Yeoh(scene.stiffening)
    body, touch = one.body(law, "full"), one.touch(scene.shape)
    (pressed,) = presses(body, one.skin, touch, [doi_mm], _STEP_MM)
    u, touched = body.displacement(pressed.unknowns), pressed.touched
    nodes = one.mesh.patch_nodes[touched.nodes]
    load = touched.load_n[:, None] * touched.normal
    with tempfile.TemporaryDirectory() as folder:
        deck = Path(folder) / "held.inp"
        write_displacement_deck(deck, MeshedFinger(one.config, one.mesh, 1.0, finite_strain=True), nodes, u[nodes])
        printed, _, reactions = run(deck).rpartition("forces (fx,fy,fz)")
    moved = np.abs(displacements(printed, len(u)) - u).max() / np.abs(u).max()
    pushed = np.abs(displacements(reactions, len(nodes)) - load[np.argsort(nodes)]).max() / np.abs(load).max()
    off = {"displacements_off": float(f"{moved:.2g}"), "loads_off": float(f"{pushed:.2g}")}
    return {**scene._asdict(), "doi_mm": doi_mm, **off, "force": pressed.force, "touched": len(nodes)}


def main(path: str) -> None:
    """Append what is missing; what does not converge is said, and not kept."""
    if shutil.which("ccx") is None:
        print(MISSING)
        return
    file = Path(path)
    done = {(StiffeningPress(row["finger"], row["shape"], row["stiffening"]), row["doi_mm"]) for row in read(file)}
    for scene, doi_mm in CASES:
        if (scene, doi_mm) in done:
            continue
        try:
            row = confirmed(scene, doi_mm)
        except (RuntimeError, ValueError) as error:
            print(scene.name, doi_mm, error, flush=True)
            continue
        print(row, flush=True)
        with file.open("a", encoding="utf-8") as out:
            out.write(json.dumps(row) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
