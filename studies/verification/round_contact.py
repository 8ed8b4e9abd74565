"""Frictionless contact of rigid round shapes with a half-space: sphere, cone, flat punch.

Sources: Hertz (1882), Johnson, *Contact Mechanics* (1985), Eq. 4.22–4.24; Sneddon (1965), Int. J. Eng. Sci. 3, 47–57,
for the cone and the punch. E = 1 MPa, contact radius 1 mm, slopes of at most 1/50 as in `contact`.
"""

import numpy as np

from sim.contact.patch import Patch
from sim.contact.profiles import Bar, Cylinder, Wedge
from studies.verification.box import Box, BoxBody, condense, graded
from studies.verification.contact import POISSON, SLOPE, ContactSolution, plane_modulus, press_to_force

FINE, REACH = 1.25, 1.6
"""Half-width of the evenly meshed top and of the patch, in contact radii."""
MODULUS = plane_modulus(POISSON)


def quarter_space(per_radius: int, size: float, growth: float = 1.25) -> Patch:
    """A quarter of a box of `size` contact radii to every side and below, so many elements across one radius."""
    x, y = (graded(fine, 1 / per_radius, size, growth) for fine in (FINE, 0.25))
    box = Box(x, -y[::-1], x)
    return condense(box, BoxBody(box, np.ones(len(box.hexes)), POISSON), REACH)


def sphere() -> ContactSolution:
    """Hertz: F = 4 E* a³ / 3R, p = (2 E* a / πR) √(1 − r²/a²), δ = a²/R."""
    return ContactSolution(
        Cylinder(2 / SLOPE),
        1.0,
        4 / 3 * MODULUS * SLOPE,
        lambda r: 2 * MODULUS * SLOPE / np.pi * np.sqrt(1 - r * r),
        doi_mm=SLOPE,
    )


def cone() -> ContactSolution:
    """Sneddon: F = ½ π E* a² cot α, p = ½ E* cot α arcosh(a/r), δ = ½ π a cot α."""
    return ContactSolution(
        Wedge(float(np.degrees(np.arctan(1 / SLOPE))), tip_radius_mm=0.0),
        1.0,
        0.5 * np.pi * MODULUS * SLOPE,
        lambda r: 0.5 * MODULUS * SLOPE * np.arccosh(1 / r),
        doi_mm=0.5 * np.pi * SLOPE,
    )


def flat() -> ContactSolution:
    """Flat punch: F = 2 E* a δ, p = F / 2πa √(a² − r²)."""
    force = 2 * MODULUS * SLOPE
    return ContactSolution(
        Bar(2.0, 0.0), 1.0, force, lambda r: force / (2 * np.pi * np.sqrt(1 - r * r)), doi_mm=SLOPE
    )


def doi_error(patch: Patch, exact: ContactSolution) -> float:
    """Of the depth at the force of the closed form, relative to it: first order in 1 / size, by the missing rest."""
    return press_to_force(patch, exact.profile, exact.meshed_force)[0] / exact.doi_mm - 1


def extrapolated(small: float, large: float) -> float:
    """The error in an endless box from those in one box and in one of twice its size."""
    return 2 * large - small
