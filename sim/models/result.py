"""One simulated indentation and everything that is read from it."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.config.units import GWT_N, PSEUDO_E_EPIDERMIS
from sim.contact.indentor import Indentor
from sim.contact.patch import X
from sim.contact.solver import ContactState
from sim.measures.measures import Elastic, measures_from_strain
from sim.models.condensed import CondensedModel

Array = NDArray[np.float64]

REGION_GAP_MM = 0.3
"""Contact regions are separate when the free stretch between them is wider than this."""

FILTER_SPACING_MM = 0.17


def median_of_four(x_mm: Array, pressure: Array) -> Array:
    """The source's 4×1 filter: values resampled linearly to 170 µm, the mean of the middle two of each four.

    For display and for comparing peaks with Raju (1998); stored pressures are unfiltered.
    """
    even = np.interp(np.arange(x_mm[0], x_mm[-1], FILTER_SPACING_MM), x_mm, pressure)
    return np.sort(np.lib.stride_tricks.sliding_window_view(even, 4), axis=1)[:, 1:3].mean(axis=1)


def _opens_beyond(x_mm: Array, gap_mm: Array, last_mm: float) -> float:
    """Where contact ends beyond the last node that bears, from two free nodes: there gap ∝ distance^1.5."""
    free = int(np.searchsorted(x_mm, last_mm, side="right"))
    if free + 1 >= len(x_mm):
        return last_mm
    near, far = np.cbrt(gap_mm[free : free + 2] ** 2)
    if far <= near:
        return last_mm
    return float(max(last_mm, x_mm[free] - (x_mm[free + 1] - x_mm[free]) * near / (far - near)))


@dataclass(frozen=True)
class IndentationResult:
    """One simulated indentation; pressures and stresses in pseudo-units (E(epidermis) = 10 000)."""

    indentor: Indentor
    x_mm: float
    z_mm: float
    doi_mm: float
    touch_height_mm: float
    force_n: float
    state: ContactState
    model: CondensedModel
    e_epidermis_mpa: float
    contact_s: float  # processor time of the one thread that solves
    poisson: float

    @property
    def force_gwt(self) -> float:
        """Force in gram-weight."""
        return self.force_n / GWT_N

    @cached_property
    def nodal_pressure_pseudo(self) -> Array:
        """(n_patch,) normal nodal force over tributary undeformed area."""
        normal = np.linalg.norm(self.state.force, axis=0)
        return PSEUDO_E_EPIDERMIS * normal / self.model.patch.area_mm2

    @property
    def contact_area_mm2(self) -> float:
        """Undeformed area of the nodes that carry force: known to a ring of nodes around it."""
        carrying = np.linalg.norm(self.state.force, axis=0) > 0
        return float(self.model.patch.area_mm2[carrying].sum())

    @property
    def peak_pressure_mpa(self) -> float:
        """Highest nodal pressure of the whole contact, on the calibrated stiffness scale."""
        return self.peak_pressure_pseudo * self.e_epidermis_mpa / PSEUDO_E_EPIDERMIS

    @property
    def peak_pressure_pseudo(self) -> float:
        """Highest nodal pressure of the whole contact."""
        return float(self.nodal_pressure_pseudo.max())

    @property
    def plane(self) -> slice:
        """The patch nodes that lie in the receptor plane."""
        columns = self.model.patch.shape[1]
        return slice(self.model.receptor_row * columns, (self.model.receptor_row + 1) * columns)

    @cached_property
    def _across(self) -> NDArray[np.int64]:
        """The patch nodes that lie in the receptor plane, by ascending x."""
        nodes = np.arange(len(self.model.patch))[self.plane]
        return nodes[np.argsort(self.model.patch.x[nodes])]

    @property
    def pressure_profile(self) -> tuple[Array, Array]:
        """Undeformed x (mm, ascending) and pressure (pseudo-units) in the receptor plane."""
        return self.model.patch.x[self._across], self.nodal_pressure_pseudo[self._across]

    @property
    def skin_profile(self) -> tuple[Array, Array]:
        """Deformed x and y (mm) of the skin in the receptor plane, in the order of `pressure_profile`."""
        patch, u = self.model.patch, self.state.displacement[:, self._across]
        x = patch.x[self._across] + (u[0] if patch.axes[0] == X else 0.0)
        return x, patch.y[self._across] + u[-1]

    @property
    def axial_profile(self) -> tuple[Array, Array]:
        """Undeformed z and downward deflection (mm) of the skin along the pad's centre line."""
        columns = self.model.patch.shape[1]
        centre = int(np.argmin(np.abs(self.model.patch.x[self.plane])))
        line = slice(centre, None, columns)
        return self.model.patch.position_mm[line, 2], -self.state.displacement[-1][line]

    @cached_property
    def touching_mm(self) -> tuple[Array, Array]:
        """Undeformed (ascending) and deformed x of the places in the receptor plane that carry force; mm.

        Of a shape that lies across the finger, all places.
        """
        patch, held = self.model.patch, self.state.held
        nodes, share = held.on(patch).carriers
        rows = nodes // patch.shape[1]
        here = (rows == self.model.receptor_row).all(axis=0) if patch.axes[0] == X else np.full(len(held), True)
        x = (share * patch.x[nodes]).sum(axis=0)[here]
        moved = x + ((share * self.state.displacement[0][nodes]).sum(axis=0)[here] if patch.axes[0] == X else 0.0)
        order = np.argsort(x)
        return x[order], moved[order]

    @property
    def contact_regions_mm(self) -> list[tuple[float, float]]:
        """[x0, x1] of the runs of places that carry force in the receptor plane, undeformed.

        Under smooth shapes they end where the gap opens, between two nodes.
        """
        touching, _ = self.touching_mm
        if not len(touching):
            return []
        ends = np.flatnonzero(np.diff(touching) > REGION_GAP_MM)
        starts = np.concatenate([[0], ends + 1])
        stops = np.concatenate([ends, [len(touching) - 1]])
        regions = [(float(touching[a]), float(touching[b])) for a, b in zip(starts, stops, strict=True)]
        return regions if self.indentor.sharp else [self._opened(*region) for region in regions]

    def _opened(self, low_mm: float, high_mm: float) -> tuple[float, float]:
        x, gap = self.model.patch.x[self._across], self.state.gap[self._across]
        return -_opens_beyond(-x[::-1], gap[::-1], -low_mm), _opens_beyond(x, gap, high_mm)

    @cached_property
    def receptor_strain(self) -> Array:
        """(n_receptors, 6) engineering strains e11 e22 e33 e12 e23 e13."""
        return (self.model.strain_per_force @ self.state.force.ravel()).reshape(-1, 6)

    @cached_property
    def receptor_measures(self) -> dict[str, Array]:
        """The 18 measures at the receptors; tension positive, stresses in pseudo-units."""
        return measures_in_layers(self.receptor_strain, self.model.receptor_e, self.poisson)

    def as_json(self) -> dict[str, Any]:
        """What `rig indent --json` prints, without the model's build time."""
        x, p = self.pressure_profile
        return {
            "force_n": self.force_n,
            "force_gwt": self.force_gwt,
            "doi_mm": self.doi_mm,
            "peak_pressure_pseudo": self.peak_pressure_pseudo,
            "contact_regions_mm": [list(region) for region in self.contact_regions_mm],
            "pressure": {"x_mm": x.tolist(), "pseudo": p.tolist()},
            "receptors": _receptors_as_json(self.model, self.receptor_measures),
            "solver": {
                "model": self.model.kind,
                "nodes": self.model.nodes,
                "iterations": self.state.passes,
                "kkt_residual": self.state.residual,
                "converged": self.state.converged,
                "contact_s": self.contact_s,
            },
        }


@dataclass(frozen=True)
class PointLoadResult:
    """A force on one point of the skin, along its inward normal; there is no contact, and no depth is defined."""

    x_mm: float
    z_mm: float
    force_n: float
    receptor_strain: Array  # (n_receptors, 6) engineering
    model: CondensedModel
    poisson: float

    @property
    def force_gwt(self) -> float:
        """Force in gram-weight."""
        return self.force_n / GWT_N

    @cached_property
    def receptor_measures(self) -> dict[str, Array]:
        """The 18 measures at the receptors; tension positive, stresses in pseudo-units."""
        return measures_in_layers(self.receptor_strain, self.model.receptor_e, self.poisson)

    def as_json(self) -> dict[str, Any]:
        """As of an indentation; what a point load does not have is null or empty."""
        return {
            "force_n": self.force_n,
            "force_gwt": self.force_gwt,
            "doi_mm": None,
            "peak_pressure_pseudo": None,
            "contact_regions_mm": [],
            "pressure": {"x_mm": [], "pseudo": []},
            "receptors": _receptors_as_json(self.model, self.receptor_measures),
            "solver": {
                "model": "finger",
                "nodes": self.model.nodes,
                "iterations": 0,
                "kkt_residual": 0.0,
                "converged": True,
                "contact_s": 0.0,
            },
        }


def measures_in_layers(strain: Array, young_ratio: Array, poisson: float) -> dict[str, Array]:
    """The 18 measures (n,) from (n, 6) strains and (n,) E / E(epidermis); stresses in pseudo-units."""
    values: dict[str, Array] = {}
    for ratio in np.unique(young_ratio):
        here = young_ratio == ratio
        material = Elastic(PSEUDO_E_EPIDERMIS * float(ratio), poisson)
        for name, value in measures_from_strain(strain[here], material).items():
            values.setdefault(name, np.empty(len(here)))[here] = value
    return values


def _receptors_as_json(model: CondensedModel, measures: dict[str, Array]) -> dict[str, list[float]]:
    return {
        "x_mm": model.receptors.position_mm[:, 0].tolist(),
        **{name: value.tolist() for name, value in measures.items()},
    }
