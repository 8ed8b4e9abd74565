"""What a press is read for: force, width, peak pressure and the measures at the receptors."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.measures.measures import MEASURES
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM, place_receptors
from sim.units import PSEUDO_E_EPIDERMIS
from studies.finite_strain.solver.inside import InteriorPoints
from studies.finite_strain.solver.laws import Law
from studies.finite_strain.solver.press import PressedBody
from studies.finite_strain.solver.rigid import Rigid, clearance
from studies.finite_strain.solver.scene import Specimen

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Reader:
    """Reads presses of one specimen; receptors where the source has them."""

    specimen: Specimen

    @cached_property
    def receptors(self) -> InteriorPoints:
        """The source's ten."""
        plane = self.specimen.config.receptor_plane_mm
        places = place_receptors(self.specimen.surface, DEFAULT_X_MM, DEFAULT_DEPTH_MM, plane)
        return InteriorPoints(self.specimen.config, self.specimen.mesh, places.position_mm)

    def read(self, pressed: PressedBody, touch: Rigid, body_law: Law | None, displacement: Array) -> dict[str, Any]:
        """Numbers of one press: force for E(epidermis) = 1 MPa, width in the plane, peak pressure, measures."""
        measures = self.receptors.measures(displacement, body_law)
        return {
            "doi_mm": round(pressed.doi_mm, 6),
            "force": pressed.force,
            "width_mm": self.width_mm(pressed, touch),
            "peak": peak_pressure(pressed, self.specimen.skin.area_mm2),
            "bearing": len(pressed.touched.nodes),
            "measures": {name: measures[name].tolist() for name in MEASURES},
        }

    def width_mm(self, pressed: PressedBody, touch: Rigid) -> float:
        """Lateral extent of what bears in the receptor plane, undeformed; a smooth shape's to where its gap opens."""
        mesh = self.specimen.mesh
        columns = np.arange(mesh.patch_shape[1]) + mesh.receptor_row * mesh.patch_shape[1]
        there = Rigid(touch.indentor, touch.at_mm, touch.height_mm - pressed.doi_mm)
        x = self.specimen.skin.position_mm[columns, 0]
        order = np.argsort(x)
        height = clearance(self.specimen.skin, there, pressed.unknowns).mm[columns][order]
        return extent(x[order], height, opens=not touch.indentor.sharp)


def extent(x_mm: Array, gap_mm: Array, *, opens: bool) -> float:
    """From the first place that bears to the last; if it opens, to where gap^(2/3) beside them comes to zero."""
    bears = np.flatnonzero(gap_mm < 0)
    if not len(bears):
        return 0.0
    first, last = bears[0], bears[-1]
    if not opens:
        return float(x_mm[last] - x_mm[first])
    return _beyond(x_mm, gap_mm, last) + _beyond(-x_mm[::-1], gap_mm[::-1], len(x_mm) - 1 - first)


def _beyond(x_mm: Array, gap_mm: Array, last: int) -> float:
    """Where contact ends to the right of the last node that bears, from the two free ones beside it."""
    if last + 2 >= len(x_mm):
        return float(x_mm[last])
    near, far = np.cbrt(gap_mm[last + 1 : last + 3] ** 2)
    ends = x_mm[last + 1] - (x_mm[last + 2] - x_mm[last + 1]) * near / (far - near) if far > near else -np.inf
    return float(np.clip(ends, x_mm[last], x_mm[last + 1]))


def peak_pressure(pressed: PressedBody, area_mm2: Array) -> float:
    """Highest nodal force over undeformed tributary area, in pseudo-units."""
    size = pressed.touched.load_n * np.linalg.norm(pressed.touched.normal, axis=1)
    return PSEUDO_E_EPIDERMIS * float((size / area_mm2[pressed.touched.nodes]).max(initial=0.0))
