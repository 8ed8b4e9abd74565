"""From first touch down to a depth in small steps, each from the last, halved where Newton's method finds nothing."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.contact.patch import Y
from studies.finite_strain.solver.body import Body
from studies.finite_strain.solver.equilibrium import NotFoundError, rest
from studies.finite_strain.solver.rigid import Rigid, Skin, Touching

Array = NDArray[np.float64]

SHORTEST_MM = 5e-4
"""A press whose steps get shorter than that has not converged."""


@dataclass(frozen=True)
class PressedBody:
    """A body at rest under an indentor: DOI in mm, the unknowns, what bears; forces for E(epidermis) = 1 MPa."""

    doi_mm: float
    unknowns: Array
    touched: Touching

    @property
    def force(self) -> float:
        """The downward force, N for E(epidermis) = 1 MPa; of a section per mm."""
        return -float(self.touched.load_n @ self.touched.normal[:, Y])


def presses(
    body: Body, skin: Skin, touch: Rigid, depths_mm: Sequence[float], step_mm: float = 0.05
) -> Iterator[PressedBody]:
    """One at each of ascending depths below first touch. Ends early where nothing more converges."""
    last, before = PressedBody(0.0, np.zeros(body.size), NOTHING), None
    for depth in depths_mm:
        step = step_mm
        while last.doi_mm < depth - 1e-12:
            doi = min(last.doi_mm + step, depth)
            there = replace(touch, height_mm=touch.height_mm - doi)
            try:
                found = PressedBody(doi, *rest(body, skin, there, _ahead(last, before, doi)))
            except NotFoundError:
                step *= 0.5
                before = None
                if step < SHORTEST_MM:
                    return
                continue
            last, before = found, last
            step = min(step_mm, 1.5 * step)
        yield last


NOTHING = Touching(np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3, 3)))


def _ahead(last: PressedBody, before: PressedBody | None, doi_mm: float) -> Array:
    """Unknowns that go on as they went."""
    if before is None or before.doi_mm == 0.0:
        return last.unknowns
    along = (doi_mm - last.doi_mm) / (last.doi_mm - before.doi_mm)
    return last.unknowns + along * (last.unknowns - before.unknowns)
