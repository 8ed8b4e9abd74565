"""Pressure inside a contact as a formula of depth and curvature, and curvature read back from a pressure profile.

P = K2 (d − d0) + K3 C with d0 = DOI (1 − K1/K2), Raju (1998), Eq. 4.1 and 4.2: d is the skin's own downward
displacement, C the curvature of the indentor relative to the finger, K1 the slope of peak pressure against DOI.
Written out it is linear in its constants: P = K1·DOI − K2·(DOI − d) + K3·C. Pressures in pseudo-units, lengths in mm.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.finger import section
from sim.finger.surface import FingertipSurface
from sim.models.results.indentation import IndentationResult

Array = NDArray[np.float64]

FROM_EDGE_MM = 0.35
"""Places nearer to an end of their contact region, two elements, are not what the formula is for."""


class Constants(NamedTuple):
    """K1 and K2 in pseudo-units per mm, K3 in pseudo-units · mm."""

    k1: float
    k2: float
    k3: float


@dataclass(frozen=True)
class Places:
    """Places in contact, (n,) each: DOI, displacement and distance to the contact's end (mm), C (1/mm), pressure."""

    doi_mm: Array
    displacement_mm: Array
    curvature_per_mm: Array
    pressure: Array
    from_end_mm: Array

    @property
    def inside(self) -> "Places":
        """Those away from the ends of their contact regions."""
        return self.where(self.from_end_mm >= FROM_EDGE_MM)

    def where(self, chosen: NDArray[np.bool_]) -> "Places":
        """Some of them."""
        return Places(*(np.asarray(value)[chosen] for value in vars(self).values()))


def together(parts: list[Places]) -> Places:
    """All places of several indentations."""
    return Places(*(np.concatenate(values) for values in zip(*(vars(p).values() for p in parts), strict=True)))


def places(result: IndentationResult, surface: FingertipSurface) -> Places:
    """The nodes in the receptor plane that carry force, under an indentor prismatic along the finger."""
    x, pressure = result.pressure_profile
    order = np.argsort(result.model.patch.x[result.plane])
    moved, down = (result.state.displacement[k, result.plane][order] for k in (0, -1))
    _, (slope,), ((bend,),) = result.indentor.evaluate((x + moved - result.x_mm)[None])
    relative = bend / np.hypot(1.0, slope) ** 3 + finger_curvature(surface, x, result.z_mm)
    found = Places(np.full(len(x), result.doi_mm), -down, relative, pressure, _from_end(x, result))
    return found.where(pressure > 0)


def finger_curvature(surface: FingertipSurface, x_mm: Array, z_mm: float) -> Array:
    """(n,) curvature in 1/mm of the undeformed skin in an axial plane, positive where it is convex."""
    phi, ratio = surface.angle_at(x_mm, z_mm), surface.geometry.nail_depth_ratio
    parameters = surface.parameters(z_mm)
    x1, y1 = section.first_derivative(phi, parameters, ratio)
    x2, y2 = section.second_derivative(phi, parameters, ratio)
    return np.asarray((x1 * y2 - y1 * x2) / np.hypot(x1, y1) ** 3)


def _from_end(x_mm: Array, result: IndentationResult) -> Array:
    """(n,) distance to the nearer end of the contact region that holds each x; negative outside all."""
    ends = np.array(result.contact_regions_mm).reshape(-1, 2, 1)
    return np.asarray(np.minimum(x_mm - ends[:, 0], ends[:, 1] - x_mm).max(axis=0, initial=-np.inf))


def _terms(at: Places) -> Array:
    """(n, 3) what K1, K2 and K3 are multiplied by."""
    return np.stack([at.doi_mm, at.displacement_mm - at.doi_mm, at.curvature_per_mm], axis=1)


def fit(at: Places) -> Constants:
    """Least squares; NaN where the places do not determine all three."""
    solution, _, rank, _ = np.linalg.lstsq(_terms(at), at.pressure, rcond=None)
    return Constants(*(float(k) if rank == 3 else np.nan for k in solution))


def predicted(constants: Constants, at: Places) -> Array:
    """(n,) pressures by the formula."""
    return np.asarray(_terms(at) @ np.array(constants))


def residual(constants: Constants, at: Places) -> tuple[float, float]:
    """Root mean square of what the formula leaves, in pseudo-units, and R²."""
    left = predicted(constants, at) - at.pressure
    spread = at.pressure - at.pressure.mean()
    return float(np.sqrt(np.mean(left**2))), float(1 - left @ left / (spread @ spread))


def recover_curvature(x_mm: Array, pressure: Array, doi_mm: float, constants: Constants) -> float:
    """Curvature C (1/mm, relative to the finger) of a round object from (n,) pressures inside one contact.

    Inside, d = DOI − ½ C (x − x₀)² with x₀ the middle of the places, which makes the formula linear in C.
    """
    weight = constants.k3 - 0.5 * constants.k2 * (x_mm - 0.5 * (x_mm[0] + x_mm[-1])) ** 2
    return float(weight @ (pressure - constants.k1 * doi_mm) / (weight @ weight))
