"""Strain, stress and the 18 measures at any points inside a pressed finger."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.config.units import PSEUDO_E_EPIDERMIS
from sim.measures.measures import MEASURES, Elastic, measures_in_layers, stress_from_strain

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Fields:
    """What one press does at points in the undeformed finger, in the shape in which they were asked for."""

    points_mm: Array  # (…, 3)
    strain: Array  # (…, 6) engineering e11 e22 e33 e12 e23 e13
    young_ratio: Array  # (…) E / E(epidermis)
    poisson: float

    @cached_property
    def stress(self) -> Array:
        """(…, 6) s11 s22 s33 s12 s23 s13 in pseudo-units."""
        of_unit = stress_from_strain(self.strain, Elastic(PSEUDO_E_EPIDERMIS, self.poisson))
        return self.young_ratio[..., None] * of_unit

    @cached_property
    def measures(self) -> dict[str, Array]:
        """The 18 measures, each (…); tension positive, stresses in pseudo-units."""
        found = measures_in_layers(self.strain.reshape(-1, 6), self.young_ratio.ravel(), self.poisson)
        return {name: values.reshape(self.young_ratio.shape) for name, values in found.items()}

    def table(self) -> dict[str, Array]:
        """Columns x_mm, y_mm, z_mm and the 18 measures, one row a point."""
        places = dict(zip(("x_mm", "y_mm", "z_mm"), self.points_mm.reshape(-1, 3).T, strict=True))
        return places | {name: self.measures[name].ravel() for name in MEASURES}

    def __repr__(self) -> str:
        return f"<Fields at {self.young_ratio.size} points, SED to {self.measures['sed'].max(initial=0.0):.3g}>"
