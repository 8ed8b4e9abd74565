"""A simulated point load and everything that is read from it."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.config.units import GWT_N
from sim.models.results.outline import ModelOutline

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class PointLoadResult:
    """A force on one point of the skin, along its inward normal; there is no contact, and no depth is defined."""

    x_mm: float
    z_mm: float
    force_n: float
    receptor_strain: Array  # (n_receptors, 6) engineering
    model: ModelOutline

    @property
    def force_gwt(self) -> float:
        """Force in gram-weight."""
        return self.force_n / GWT_N

    @cached_property
    def receptor_measures(self) -> dict[str, Array]:
        """The 18 measures at the receptors; tension positive, stresses in pseudo-units."""
        return self.model.measures(self.receptor_strain)

    def as_json(self) -> dict[str, Any]:
        """As of an indentation; what a point load does not have is null or empty."""
        return {
            "force_n": self.force_n,
            "force_gwt": self.force_gwt,
            "doi_mm": None,
            "peak_pressure_pseudo": None,
            "contact_regions_mm": [],
            "pressure": {"x_mm": [], "pseudo": []},
            "receptors": self.model.receptors_as_json(self.receptor_measures),
            "solver": {
                "model": self.model.kind,
                "nodes": self.model.nodes,
                "iterations": 0,
                "kkt_residual": 0.0,
                "converged": True,
                "contact_s": 0.0,
            },
        }

    def receptor_table(self) -> dict[str, Array]:
        """Columns x_mm, depth_mm and the 18 measures, one row a receptor."""
        return self.model.receptor_columns(self.receptor_measures)

    def __repr__(self) -> str:
        return f"<PointLoadResult at x = {self.x_mm:g}, z = {self.z_mm:g} mm: {self.force_gwt:.4g} gwt>"
