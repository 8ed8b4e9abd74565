"""`rig export-deck`: a scene as a CalculiX input deck."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from rig.cli.options import FingertipOption
from rig.cli.output import err, out, told_in_one_line
from rig.plan.config import load_config
from rig.protocol.errors import BadInputError
from sim.config import Contact
from sim.contact.indentor import Indentor, Prismatic
from sim.contact.shapes import parse_shape
from sim.finger.mesh import build_mesh
from sim.models.fingertip import Fingertip
from sim.models.full_mesh import MeshedFinger, write_contact_deck, write_load_deck


def command(
    shape: Annotated[str, typer.Option(metavar="S", help="As for `rig indent`; one that lies along the finger.")],
    x_mm: Annotated[float, typer.Option(metavar="X", help="Indentor's reference point from the pad's centre.")],
    doi_mm: Annotated[float, typer.Option(metavar="D", help="Depth past first contact.")],
    out_file: Annotated[Path, typer.Option("--out", metavar="FILE.inp", help="The deck to write.")],
    loads: Annotated[
        bool, typer.Option("--loads", help="Our contact forces as loads, instead of a contact job.")
    ] = False,
    config: FingertipOption = None,
) -> None:
    """Solve the scene here, write it for CalculiX, and say what its answer should be compared with."""
    with told_in_one_line(as_json=False):
        if out_file.exists():
            raise BadInputError(
                "{option} {path}: exists already, expected a new file",
                code="exists_already", option="--out", path=out_file,
            )  # fmt: skip
        indentor = parse_shape(shape)
        if not (isinstance(indentor, Prismatic) and indentor == Indentor.along(indentor.profile)):
            raise BadInputError(
                "--shape {shape}: a deck has shapes that lie along the finger only", code="not_along", shape=shape
            )
        settings = load_config(config).finger.model_copy(update={"contact": Contact(between_nodes=False, patch_gb=0)})
        finger = Fingertip.load(settings)
        result = finger.indent(indentor, x_mm, doi_mm=doi_mm)
        meshed = MeshedFinger(settings, build_mesh(settings, finger.model.surface), finger.e_epidermis_mpa)
        if loads:
            active = result.state.active
            force = np.zeros((int(active.sum()), 3))
            force[:, :2] = result.state.force[:, active].T * finger.e_epidermis_mpa
            write_load_deck(out_file, meshed, meshed.mesh.patch_nodes[active], force)
        else:
            write_contact_deck(out_file, meshed, indentor.profile, x_mm, result.touch_height_mm, doi_mm)
        if settings.mesh.element != "full":
            err.print('rig: CalculiX\'s C3D8 is fully integrated: compare with mesh.element = "full"')
        out.print(
            f"{out_file}: expect a total reaction of {-result.force_n:.6g} N along y; {result.small_strain.note}"
        )
