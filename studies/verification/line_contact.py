"""Line contact in plane strain: Hertz's cylinder, a wedge, a flat punch, Westergaard's wave.

Equations of Johnson, *Contact Mechanics* (1985).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.contact.patch import Patch
from sim.contact.profiles import Bar, Cylinder, IndentorProfile, Wedge
from sim.contact.solver import ContactState
from sim.fem.elements import Element
from studies.verification.box import SLAB, Box, BoxBody, condense, graded
from studies.verification.contact import (
    POISSON,
    SLOPE,
    ContactErrors,
    ContactSolution,
    compared,
    plane_modulus,
    press,
)

Array = NDArray[np.float64]

REACH = 1.5
"""Half-width of the evenly meshed top, in contact half-widths."""

PUNCH_DOI_MM = 0.005


def half_space(per_half_width: int, size: float, poisson: float = POISSON, element: Element = "bbar") -> Patch:
    """Half of a plane-strain box of `size` × `size` contact half-widths, so many elements across one of them."""
    x = graded(REACH, 1 / per_half_width, size, growth=1.1)
    box = Box(x, -x[::-1], SLAB)
    body = BoxBody(box, np.ones(len(box.hexes)), poisson, element)
    return condense(box, body, REACH)


@dataclass(frozen=True)
class Wave(IndentorProfile):
    """Wavy surface, a crest at s = 0; Johnson §13.2."""

    wavelength_mm: float
    amplitude_mm: float
    name = "wave"
    sharpest_radius_mm = np.inf  # the mesh resolves it

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Height, slope and curvature."""
        k = 2 * np.pi / self.wavelength_mm
        height = self.amplitude_mm * (1 - np.cos(k * s_mm))
        return height, self.amplitude_mm * k * np.sin(k * s_mm), self.amplitude_mm * k * k * np.cos(k * s_mm)


def cylinder(poisson: float = POISSON) -> ContactSolution:
    """Hertz line contact, Johnson Eq. 4.43–4.45: F = π a² E*/4R, p = (E* a / 2R) √(1 − x²/a²)."""
    modulus = plane_modulus(poisson)
    return ContactSolution(
        Cylinder(2 / SLOPE), 1.0, 0.25 * np.pi * modulus * SLOPE, lambda x: 0.5 * modulus * SLOPE * np.sqrt(1 - x * x)
    )


def wedge(poisson: float = POISSON) -> ContactSolution:
    """Wedge of slope cot α, Johnson §5.2: F = a E* cot α, p = (E* cot α / π) arcosh(a/x)."""
    modulus = plane_modulus(poisson)
    profile = Wedge(float(np.degrees(np.arctan(1 / SLOPE))), tip_radius_mm=0.0)
    return ContactSolution(profile, 1.0, modulus * SLOPE, lambda x: modulus * SLOPE / np.pi * np.arccosh(1 / x))


def flat_punch(force: float) -> ContactSolution:
    """Flat punch under a force per mm, Johnson Eq. 2.64: p = F / π √(a² − x²)."""
    return ContactSolution(Bar(2.0, 0.0), 1.0, force, lambda x: force / (np.pi * np.sqrt(1 - x * x)))


def punched(patch: Patch) -> ContactState:
    """The flat punch at a given depth. In plane strain its force depends on the box: it serves to compare meshes."""
    return press(patch, flat_punch(1.0).profile, PUNCH_DOI_MM)


def punch_errors(patch: Patch, state: ContactState) -> ContactErrors:
    """Against the closed form of the force found."""
    return compared(patch, state, flat_punch(2 * state.normal_force))


def punch_edge_pressure(patch: Patch, state: ContactState) -> float:
    """Pressure one node inside the edge of the flat punch, over the mean pressure."""
    node = int(np.argmin(np.abs(patch.x - 1.0))) - 1
    return float(-state.force[-1, node] / patch.area_mm2[node] / state.normal_force)


WAVELENGTH_MM = 4.0


def wave(half_width_mm: float, poisson: float = POISSON) -> ContactSolution:
    """Westergaard (1939), Johnson Eq. 13.7–13.8: mean pressure π E* Δ/λ sin²(πa/λ) over the whole wavelength."""
    amplitude = SLOPE * WAVELENGTH_MM / (2 * np.pi)
    full = np.pi * plane_modulus(poisson) * amplitude / WAVELENGTH_MM
    k = np.pi / WAVELENGTH_MM
    share = np.sin(k * half_width_mm)

    def pressure(x: Array) -> Array:
        return 2 * full * np.cos(k * x) * np.sqrt(share**2 - np.sin(k * x) ** 2)

    return ContactSolution(Wave(WAVELENGTH_MM, amplitude), half_width_mm, full * share**2 * WAVELENGTH_MM, pressure)


def wave_cell(per_mm: int, poisson: float = POISSON) -> Patch:
    """Half a wavelength between planes of symmetry, two wavelengths deep: the rest of depth feels only the mean."""
    x = np.linspace(0, WAVELENGTH_MM / 2, round(per_mm * WAVELENGTH_MM / 2) + 1)
    box = Box(x, -graded(REACH, 1 / per_mm, 2 * WAVELENGTH_MM, growth=1.1)[::-1], SLAB)
    return condense(box, BoxBody(box, np.ones(len(box.hexes)), poisson), WAVELENGTH_MM / 2)
