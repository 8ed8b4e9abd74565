"""Pressure inside a contact as a function of depth and curvature, and curvature estimated from pressure.

P = K2 (d − d0) + K3 C with d0 = DOI (1 − K1/K2), Raju (1998), Eq. 4.1 and 4.2: d is the skin's own downward
displacement, C the curvature of the indentor relative to the finger, K1 the slope of peak pressure against DOI.
This is linear in its constants: P = K1·DOI − K2·(DOI − d) + K3·C. Pressures in pseudo-units, lengths in mm.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.contact.indentor import Indentor
from sim.contact.patch import Z
from sim.finger import surface as section
from sim.finger.surface import FingertipSurface
from sim.models.result import FILTER_SPACING_MM, REGION_GAP_MM, IndentationResult

Array = NDArray[np.float64]
Nodes = Literal["row", "patch"]

FROM_EDGE_MM = 0.35
"""Distance from an edge (mm), two elements, within which the formula is not evaluated."""

RESAMPLES, SEED = 2000, 1998
_COVERED = (2.5, 97.5)
_EDGES_WITHIN_MM, _EDGES_STEP_MM = 5.0, 0.01


class Constants(NamedTuple):
    """K1 and K2 in pseudo-units per mm, K3 in pseudo-units · mm."""

    k1: float
    k2: float
    k3: float


@dataclass(frozen=True)
class ContactSamples:
    """Contact nodes (n,): DOI and displacement (mm), C (1/mm), pressure, and distances to edges (mm).

    `from_end_mm` is the distance to the end of the contact across the finger; `from_edge_mm` that to the indentor's
    nearest edge, infinite if it has none.
    """

    doi_mm: Array
    displacement_mm: Array
    curvature_per_mm: Array
    pressure: Array
    from_end_mm: Array
    from_edge_mm: Array

    @property
    def inside(self) -> "ContactSamples":
        """Samples away from the ends of their contact regions."""
        return self.where(self.from_end_mm >= FROM_EDGE_MM)

    @property
    def off_edges(self) -> "ContactSamples":
        """Samples away from the indentor's edges; smooth ends of a contact are included."""
        return self.where(self.from_edge_mm >= FROM_EDGE_MM)

    def where(self, chosen: NDArray[np.bool_]) -> "ContactSamples":
        """Return some of the samples."""
        return ContactSamples(*(np.asarray(value)[chosen] for value in vars(self).values()))


def together(parts: list[ContactSamples]) -> ContactSamples:
    """Return the samples of several indentations as one."""
    return ContactSamples(
        *(np.concatenate(values) for values in zip(*(vars(p).values() for p in parts), strict=True))
    )


def places(result: IndentationResult, surface: FingertipSurface, nodes: Nodes = "row") -> ContactSamples:
    """Return the nodes that carry force under a prismatic shape, in the receptor plane or on the patch."""
    patch, number = result.model.patch, np.arange(len(result.model.patch)).reshape(result.model.patch.shape)
    rows = [result.model.across] if nodes == "row" else [row[np.argsort(patch.x[row])] for row in number]
    return together([_on_row(result, surface, row) for row in rows])


def _on_row(result: IndentationResult, surface: FingertipSurface, row: NDArray[np.int64]) -> ContactSamples:
    """Return the samples of one row of nodes across the finger, by ascending x."""
    x, z_mm = result.model.patch.x[row], float(result.model.patch.position_mm[row[0], Z])
    pressure = result.nodal_pressure_pseudo[row]
    offset = x + result.state.displacement[0, row] - result.x_mm
    _, (slope,), ((bend,),) = result.indentor.evaluate(offset[None])
    relative = bend / np.hypot(1.0, slope) ** 3 + finger_curvature(surface, x, z_mm)
    here = z_mm == result.model.plane_mm
    regions = result.contact_regions_mm if here else _runs(x[pressure > 0])
    found = ContactSamples(
        np.full(len(x), result.doi_mm),
        -result.state.displacement[-1, row],
        relative,
        pressure,
        _from_end(x, regions),
        np.abs(offset - edges_mm(result.indentor)[:, None]).min(axis=0, initial=np.inf),
    )
    return found.where(pressure > 0)


def edges_mm(indentor: Indentor) -> Array:
    """Return (k,) offsets at which a prismatic indentor turns, convex, within less than one element: its edges."""
    s = np.arange(-_EDGES_WITHIN_MM, _EDGES_WITHIN_MM, _EDGES_STEP_MM)
    _, (slope,), ((bend,),) = indentor.evaluate(s[None])
    return s[bend / np.hypot(1.0, slope) ** 3 > 1 / FILTER_SPACING_MM]


def _runs(touching_mm: Array) -> list[tuple[float, float]]:
    """Return the ends of runs of adjacent nodes (n,), ascending, as contact regions are separated."""
    parts = np.split(touching_mm, np.flatnonzero(np.diff(touching_mm) > REGION_GAP_MM) + 1)
    return [(float(part[0]), float(part[-1])) for part in parts if len(part)]


def finger_curvature(surface: FingertipSurface, x_mm: Array, z_mm: float) -> Array:
    """Return (n,) curvature (1/mm) of the undeformed skin in an axial plane, positive where convex."""
    phi, ratio = surface.angle_at(x_mm, z_mm), surface.geometry.nail_depth_ratio
    parameters = surface.parameters(z_mm)
    x1, y1 = section.first_derivative(phi, parameters, ratio)
    x2, y2 = section.second_derivative(phi, parameters, ratio)
    return np.asarray((x1 * y2 - y1 * x2) / np.hypot(x1, y1) ** 3)


def _from_end(x_mm: Array, regions_mm: Sequence[tuple[float, float]]) -> Array:
    """Return (n,) distance to the nearer end of the contact region around each x; negative outside all."""
    ends = np.array(regions_mm).reshape(-1, 2, 1)
    return np.asarray(np.minimum(x_mm - ends[:, 0], ends[:, 1] - x_mm).max(axis=0, initial=-np.inf))


def _terms(at: ContactSamples) -> Array:
    """Return the (n, 3) factors of K1, K2 and K3."""
    return np.stack([at.doi_mm, at.displacement_mm - at.doi_mm, at.curvature_per_mm], axis=1)


def fit(at: ContactSamples) -> Constants:
    """Return the least-squares constants; NaN if the samples do not determine all three."""
    solution, _, rank, _ = np.linalg.lstsq(_terms(at), at.pressure, rcond=None)
    return Constants(*(float(k) if rank == 3 else np.nan for k in solution))


@dataclass(frozen=True)
class BootstrapConstants:
    """Constants refitted on resampled indentations: `of` (resamples, 3)."""

    of: Array

    @property
    def intervals(self) -> tuple[tuple[float, float], ...]:
        """95 % intervals of the constants."""
        return tuple((float(low), float(high)) for low, high in np.percentile(self.of, _COVERED, axis=0).T)

    @property
    def k2_over_k1(self) -> tuple[float, float]:
        """95 % interval of K2 − K1."""
        low, high = np.percentile(self.of[:, 1] - self.of[:, 0], _COVERED)
        return float(low), float(high)


def refitted(parts: Sequence[ContactSamples], resamples: int = RESAMPLES) -> BootstrapConstants:
    """Refit on bootstrap samples of whole indentations, since the nodes of one are not independent."""
    terms = [_terms(part) for part in parts]
    squares = np.array([t.T @ t for t in terms])
    rights = np.array([t.T @ part.pressure for t, part in zip(terms, parts, strict=True)])
    drawn = np.random.default_rng(SEED).multinomial(len(parts), np.full(len(parts), 1 / len(parts)), resamples)
    inverse = np.linalg.pinv(np.tensordot(drawn, squares, 1), hermitian=True)
    return BootstrapConstants(np.einsum("rij,rj->ri", inverse, drawn @ rights))


def predicted(constants: Constants, at: ContactSamples) -> Array:
    """Return the (n,) pressures of the formula."""
    return np.asarray(_terms(at) @ np.array(constants))


def residual(constants: Constants, at: ContactSamples) -> tuple[float, float]:
    """Return the root mean square of the residuals (pseudo-units), and R²."""
    left = predicted(constants, at) - at.pressure
    spread = at.pressure - at.pressure.mean()
    return float(np.sqrt(np.mean(left**2))), float(1 - left @ left / (spread @ spread))
