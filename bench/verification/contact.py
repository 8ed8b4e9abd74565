"""Frictionless contact of rigid profiles with a half-space, in plane strain: closed forms and our solver's answer.

Source: Johnson, *Contact Mechanics* (1985); the equations are named at each problem. E = 1 MPa, half-width 1 mm. Our
gap is taken at the displaced nodes (large slip), the theory's at the undisplaced ones: slopes are kept at or below
1/50: a tenth of that changes no error by 1e-3.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.contact.control import solve_for_force
from sim.contact.indentors import Bar, Cylinder, Profile, Wedge
from sim.contact.patch import Patch
from sim.contact.solver import ContactState, Pose, solve_contact
from sim.fem.elements import Element
from verification.box import SLAB, Body, Box, condense, graded

Array = NDArray[np.float64]

POISSON = 0.48
SLOPE = 0.02
REACH = 1.5
"""Half-width of the evenly meshed top, in contact half-widths."""


def plane_modulus(poisson: float) -> float:
    """E* = E / (1 − ν²) for E = 1 MPa."""
    return 1 / (1 - poisson**2)


def half_space(per_half_width: int, size: float, poisson: float = POISSON, element: Element = "bbar") -> Patch:
    """Half of a plane-strain box of `size` × `size` contact half-widths, so many elements across one of them."""
    x = graded(REACH, 1 / per_half_width, size, growth=1.1)
    box = Box(x, -x[::-1], SLAB)
    body = Body.of_box(box, np.ones(len(box.hexes)), poisson, element)
    return condense(box, body, REACH)


def press(patch: Patch, profile: Profile, doi_mm: float, start: ContactState | None = None) -> ContactState:
    """The profile above the axis of a patch whose top is at 0, its lowest point pressed in by so much."""
    return solve_contact(patch, Pose(profile, 0.0, -doi_mm, max(doi_mm, 1e-3)), start)


def press_to_force(patch: Patch, profile: Profile, force: float, deepest_mm: float = 0.5) -> ContactState:
    """As `press`, to the force (N) that the meshed half or quarter carries."""
    return solve_for_force(force, 0.1 * deepest_mm, deepest_mm, lambda doi, start: press(patch, profile, doi, start))[
        1
    ]


@dataclass(frozen=True)
class Wave(Profile):
    """Wavy surface, a crest at s = 0; Johnson §13.2."""

    wavelength_mm: float
    amplitude_mm: float
    name = "wave"

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Height, slope and curvature."""
        k = 2 * np.pi / self.wavelength_mm
        height = self.amplitude_mm * (1 - np.cos(k * s_mm))
        return height, self.amplitude_mm * k * np.sin(k * s_mm), self.amplitude_mm * k * k * np.cos(k * s_mm)


@dataclass(frozen=True)
class Pressed:
    """A profile, the force per mm that makes its contact `half_width_mm` wide, and the pressure then."""

    profile: Profile
    half_width_mm: float
    force: float  # N/mm, of both halves
    pressure: Callable[[Array], Array]  # MPa at 0 < |x| < half_width_mm

    @property
    def spread_mm(self) -> float:
        """√(∫ p x² dx / ∫ p dx) inside the contact."""
        angle = (np.arange(20_000) + 0.5) * np.pi / 40_000
        x = self.half_width_mm * np.sin(angle)
        weight = self.pressure(x) * np.cos(angle)
        return float(np.sqrt((weight @ x**2) / weight.sum()))


def cylinder(poisson: float = POISSON) -> Pressed:
    """Hertz line contact, Johnson Eq. 4.43–4.45: F = π a² E*/4R, p = (E* a / 2R) √(1 − x²/a²)."""
    modulus = plane_modulus(poisson)
    return Pressed(
        Cylinder(2 / SLOPE), 1.0, 0.25 * np.pi * modulus * SLOPE, lambda x: 0.5 * modulus * SLOPE * np.sqrt(1 - x * x)
    )


def wedge(poisson: float = POISSON) -> Pressed:
    """Wedge of slope cot α, Johnson §5.2: F = a E* cot α, p = (E* cot α / π) arcosh(a/x)."""
    modulus = plane_modulus(poisson)
    profile = Wedge(float(np.degrees(np.arctan(1 / SLOPE))), tip_radius_mm=0.0)
    return Pressed(profile, 1.0, modulus * SLOPE, lambda x: modulus * SLOPE / np.pi * np.arccosh(1 / x))


def flat_punch() -> Pressed:
    """Flat punch under 0.01 N/mm, Johnson Eq. 2.64: p = F / π √(a² − x²)."""
    return Pressed(Bar(2.0, 0.0), 1.0, 0.01, lambda x: 0.01 / (np.pi * np.sqrt(1 - x * x)))


WAVELENGTH_MM = 4.0


def wave(half_width_mm: float, poisson: float = POISSON) -> Pressed:
    """Westergaard (1939), Johnson Eq. 13.7–13.8: mean pressure π E* Δ/λ sin²(πa/λ) over the whole wavelength."""
    amplitude = SLOPE * WAVELENGTH_MM / (2 * np.pi)
    full = np.pi * plane_modulus(poisson) * amplitude / WAVELENGTH_MM
    k = np.pi / WAVELENGTH_MM
    share = np.sin(k * half_width_mm)

    def pressure(x: Array) -> Array:
        return 2 * full * np.cos(k * x) * np.sqrt(share**2 - np.sin(k * x) ** 2)

    return Pressed(Wave(WAVELENGTH_MM, amplitude), half_width_mm, full * share**2 * WAVELENGTH_MM, pressure)


def wave_cell(per_mm: int, poisson: float = POISSON) -> Patch:
    """Half a wavelength between planes of symmetry, two wavelengths deep: the rest of depth feels only the mean."""
    x = np.linspace(0, WAVELENGTH_MM / 2, round(per_mm * WAVELENGTH_MM / 2) + 1)
    box = Box(x, -graded(REACH, 1 / per_mm, 2 * WAVELENGTH_MM, growth=1.1)[::-1], SLAB)
    return condense(box, Body.of_box(box, np.ones(len(box.hexes)), poisson), WAVELENGTH_MM / 2)


@dataclass(frozen=True)
class ContactErrors:
    """Of a contact pressed to the force of a closed form, relative to it."""

    half_width: float
    spread: float  # root mean square distance of the pressure from the axis
    inside: float  # largest of the pressure at 0.1 a < x < 0.8 a, over the mean pressure


def contact_errors(patch: Patch, exact: Pressed) -> ContactErrors:
    """Press to the force of the closed form and compare."""
    state = press_to_force(patch, exact.profile, 0.5 * exact.force)
    x, a = patch.x, exact.half_width_mm
    pressure = -state.force[1] / patch.area_mm2
    inside = (x > 0.1 * a) & (x < 0.8 * a)
    off = pressure[inside] - exact.pressure(x[inside])
    spread = float(np.sqrt((-state.force[1] @ x**2) / state.normal_force))
    return ContactErrors(
        half_width=half_width_mm(x, state) / a - 1,
        spread=spread / exact.spread_mm - 1,
        inside=float(np.abs(off).max() / (exact.force / (2 * a))),
    )


def half_width_mm(x: Array, state: ContactState) -> float:
    """Where the gap, which opens as (x − a)^{3/2}, is zero by the first two open nodes along x."""
    first = int(np.flatnonzero(state.active[: len(x)])[-1]) + 1
    (x0, x1), (g0, g1) = x[first : first + 2], state.gap[first : first + 2] ** (2 / 3)
    return float(x0 - (x1 - x0) * g0 / (g1 - g0))


def punch_force(patch: Patch, doi_mm: float = 0.02) -> float:
    """N/mm of the flat punch at a given DOI, which in plane strain depends on the box: for comparing meshes only."""
    return 2 * press(patch, flat_punch().profile, doi_mm).normal_force


def punch_edge_pressure(patch: Patch) -> float:
    """MPa one node inside the edge of the flat punch under its 0.01 N/mm."""
    state = press_to_force(patch, flat_punch().profile, 0.5 * flat_punch().force)
    before = int(np.flatnonzero(state.active)[-1]) - 1
    return float(-state.force[1, before] / patch.area_mm2[before])
