"""A rigid sphere on a viscoelastic half-space: contact that grows, contact that shrinks, and creep.

Sources: Lee & Radok, J. Appl. Mech. 27 (1960) 438–444; Ting, J. Appl. Mech. 33 (1966) 845–854. E = 1 MPa at first,
one term of relaxation, Poisson's ratio constant. Forces are over the elastic one at the deepest: a mesh cancels.
"""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq

from sim.contact.patch import Patch, X, Y, Z
from sim.contact.points import ContactPose
from sim.contact.shapes import parse_shape
from sim.contact.solver import solve_contact
from sim.models.halfspace import surface_compliance
from sim.models.relaxation import Memory, Prony, PronyTerm, held_by

Array = NDArray[np.float64]

TERM = PronyTerm(0.6, 0.5)
SERIES = Prony([TERM])
POISSON, DEEPEST_MM, RAMP_S, HOLD_S = 0.48, 0.006, 0.5, 1.0
_REACH_MM = 0.36  # half the side of the patch; the deepest contact has a radius of 0.245 mm


def flat_skin(nodes: int) -> Patch:
    """A square of so many nodes to a side on a half-space."""
    side = np.linspace(-_REACH_MM, _REACH_MM, nodes)
    x, z = (values.ravel() for values in np.meshgrid(side, side))
    half = np.full((len(x), 2), 0.5 * (side[1] - side[0]))
    shear = 1 / (2 * (1 + POISSON))
    compliance = surface_compliance(np.stack([x, z], axis=1), half, (X, Z, Y), shear, POISSON)
    position = np.stack([x, 0 * x, z], axis=1)
    return Patch(position, 4 * half.prod(axis=1), (nodes, nodes), (X, Z, Y), compliance=compliance)


def pressed_along(skin: Patch, way: Iterable[tuple[float, float]]) -> Array:
    """Forces at (step s, depth mm) after (step, depth), a sphere of 10 mm radius."""
    memory, forces = Memory.none(SERIES, (3, len(skin))), []
    for step_s, doi_mm in way:
        ahead = memory.ahead(step_s)
        pose = ContactPose(parse_shape("sphere:10"), (0.0, 0.0), -doi_mm, DEEPEST_MM)
        state = solve_contact(held_by(skin, ahead.carried), pose, between_nodes=False)
        memory = memory.after(ahead, ahead.carried + state.force)
        forces.append(ahead.stiffness * state.normal_force if state.converged else math.nan)
    return np.array(forces)


def elastic(skin: Patch) -> float:
    """The force of the same mesh at the deepest, at once."""
    return float(pressed_along(skin, [(0.0, DEEPEST_MM)])[0])


def up_and_held(steps: int) -> list[tuple[float, float]]:
    """A ramp in so many steps and a hold in as many."""
    ramp = [(RAMP_S / steps, DEEPEST_MM * k / steps) for k in range(1, steps + 1)]
    return ramp + [(HOLD_S / steps, DEEPEST_MM)] * steps


def up_and_down(steps: int) -> list[tuple[float, float]]:
    """A ramp in so many steps, and back as fast."""
    depths = [1 - abs(k / steps - 1) for k in range(1, 2 * steps + 1)]
    return [(RAMP_S / steps, DEEPEST_MM * depth) for depth in depths]


def growing(t_s: float) -> float:
    """Lee & Radok: F ∝ ∫ G(t − s) d(δ^1.5) over a ramp and a hold."""
    return _hereditary(t_s, min(t_s, RAMP_S))


def shrinking(t_s: float) -> float:
    """Ting: back from the deepest contact is as large as at an earlier t₁ with ∫ of G dδ from t₁ to t = 0.

    F ∝ ∫ to t₁ of G d(δ^1.5); nothing is felt once there is no such t₁.
    """
    down = quad(lambda s: float(SERIES.relaxed(t_s - s)), RAMP_S, t_s)[0]

    def from_then(t1_s: float) -> float:
        return float(quad(lambda s: float(SERIES.relaxed(t_s - s)), t1_s, RAMP_S)[0] - down)

    return 0.0 if from_then(0.0) <= 0 else _hereditary(t_s, float(brentq(from_then, 0.0, RAMP_S)))


def crept(t_s: float) -> float:
    """J(t) E: what a step of force is over the force that would press as deep at once (Lee & Radok)."""
    lasting = SERIES.lasting
    return (1 - TERM.share * math.exp(-lasting * t_s / TERM.tau_s)) / lasting


def _hereditary(t_s: float, until_s: float) -> float:
    def integrand(s: float) -> float:
        return float(SERIES.relaxed(t_s - s)) * 1.5 * math.sqrt(s / RAMP_S) / RAMP_S

    return float(quad(integrand, 0.0, until_s)[0])
