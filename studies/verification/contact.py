"""Frictionless contact of rigid profiles with an elastic body: our solver's answer against a closed form.

E = 1 MPa, half-width of contact 1 mm. Our gap is taken at the displaced nodes (large slip), the theory's at the
undisplaced ones: slopes are kept at or below 1/50; a tenth of that changes no error by 1e-3.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.contact.force_control import solve_for_force
from sim.contact.indentor import Indentor, Revolved
from sim.contact.patch import Patch
from sim.contact.points import ContactPose
from sim.contact.profiles import IndentorProfile
from sim.contact.solver import ContactState, solve_contact

Array = NDArray[np.float64]

POISSON = 0.48
SLOPE = 0.02


def plane_modulus(poisson: float) -> float:
    """E* = E / (1 − ν²) for E = 1 MPa."""
    return 1 / (1 - poisson**2)


def press(patch: Patch, profile: IndentorProfile, doi_mm: float, start: ContactState | None = None) -> ContactState:
    """The profile above the axis of a patch whose top is at 0, its lowest point pressed in by so much.

    It is prismatic on a slab and turned about the axis on a quarter.
    """
    indentor = Indentor.along(profile) if len(patch.axes) == 2 else Revolved(profile.name, profile)
    return solve_contact(
        patch,
        ContactPose(indentor, (0.0,) * len(indentor.axes), -doi_mm, max(doi_mm, 1e-3)),
        start,
        between_nodes=False,
    )


def press_to_force(patch: Patch, profile: IndentorProfile, force: float) -> tuple[float, ContactState]:
    """The depth in mm, and the state, at a force (N) on the meshed half or quarter."""
    return solve_for_force(force, 0.05, 0.5, lambda doi, start: press(patch, profile, doi, start))


@dataclass(frozen=True)
class ContactSolution:
    """A closed form: a profile, the force that makes its contact `half_width_mm` wide, and the pressure then."""

    profile: IndentorProfile
    half_width_mm: float
    force: float  # N/mm of both halves, or N of all quarters
    pressure: Callable[[Array], Array]  # MPa at a distance 0 < x < half_width_mm from the axis
    doi_mm: float = np.nan  # in plane strain it depends on the box

    @property
    def round(self) -> bool:
        """Whether the profile is turned about the axis."""
        return bool(np.isfinite(self.doi_mm))

    @property
    def meshed_force(self) -> float:
        """Force in N on the half or quarter that is meshed."""
        return self.force / (4 if self.round else 2)

    @property
    def mean_pressure(self) -> float:
        """MPa."""
        return self.force / (np.pi * self.half_width_mm**2 if self.round else 2 * self.half_width_mm)

    @property
    def spread_mm(self) -> float:
        """Root mean square distance of the pressure from the axis."""
        angle = (np.arange(20_000) + 0.5) * np.pi / 40_000
        x = self.half_width_mm * np.sin(angle)
        weight = self.pressure(x) * np.cos(angle) * (x if self.round else 1.0)
        return float(np.sqrt((weight @ x**2) / weight.sum()))


@dataclass(frozen=True)
class ContactErrors:
    """Of a contact that carries the force of a closed form, relative to it."""

    half_width: float
    spread: float
    inside: float  # largest of the pressure at 0.1 a < x < 0.8 a, over the mean pressure
    converged: bool


def contact_errors(patch: Patch, exact: ContactSolution) -> ContactErrors:
    """Press to the force of the closed form and compare."""
    return compared(patch, press_to_force(patch, exact.profile, exact.meshed_force)[1], exact)


def compared(patch: Patch, state: ContactState, exact: ContactSolution) -> ContactErrors:
    """A state that carries the force of the closed form, against it."""
    x = np.hypot(*patch.tangential_mm) if exact.round else patch.x
    pressure = -state.force[-1] / patch.area_mm2
    inside = (x > 0.1 * exact.half_width_mm) & (x < 0.8 * exact.half_width_mm)
    off = pressure[inside] - exact.pressure(x[inside])
    spread = float(np.sqrt((-state.force[-1] @ x**2) / state.normal_force))
    return ContactErrors(
        half_width=half_width_mm(patch, state) / exact.half_width_mm - 1,
        spread=spread / exact.spread_mm - 1,
        inside=float(np.abs(off).max() / exact.mean_pressure),
        converged=state.converged,
    )


def half_width_mm(patch: Patch, state: ContactState) -> float:
    """Where the gap, which opens as (x − a)^{3/2} beside a smooth contact, is zero: by the first two open nodes."""
    x = patch.x[: patch.shape[1]]
    first = int(np.flatnonzero(state.active[: len(x)])[-1]) + 1
    (x0, x1), (g0, g1) = x[first : first + 2], np.maximum(state.gap[first : first + 2], 0.0) ** (2 / 3)
    return float(x0 - (x1 - x0) * g0 / (g1 - g0))
