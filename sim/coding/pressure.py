"""Pressures without friction, each normal to the deformed skin.

Without friction an indentor pushes along its own normal, and in contact the skin follows its surface. So the
pressures themselves determine the direction of the forces: they move the skin (the section's compliance), its slope
is their lean, and a leaning force has a part along the undeformed skin. SED agrees with that of presses to 1 %, under
corners sharper than a sample to 1 to 6 %; normal pressures alone differ by 3 to 14 % (docs/validation/coding.md).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.coding.operators import ForwardOperator, LeaningOperator, influence
from sim.coding.section import Energy, ReceptorSection, SampledSection
from sim.contact.patch import X, Y
from sim.errors import ModelRangeError
from sim.models.result import IndentationResult
from sim.units import PSEUDO_E_EPIDERMIS

# --- contact pressure ---

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ContactPressure:
    """Pressures at the section's skin nodes in pseudo-units, normal to the undeformed skin and along it."""

    place_mm: Array  # (k,) ascending
    width_mm: Array  # (k,) tributary width of each node
    normal: Array  # (k,) inward
    lateral: Array  # (k,) rising with x

    @property
    def lateral_share(self) -> float:
        """Sum of lateral force magnitudes / that of normal ones."""
        return float((np.abs(self.lateral) * self.width_mm).sum() / (np.abs(self.normal) * self.width_mm).sum())

    @property
    def stacked(self) -> Array:
        """(2 k,) normal, then lateral pressures: input of the influence operator."""
        return np.concatenate([self.normal, self.lateral])

    def at(self, place_mm: Array) -> Array:
        """Return (n,) normal pressures, interpolated linearly between the nodes."""
        return np.interp(place_mm, self.place_mm, self.normal)

    def means(self, place_mm: Array) -> Array:
        """Return (n,) mean normal pressures on samples about (n,) equally spaced locations."""
        half = (place_mm[1] - place_mm[0]) / 2
        between = np.append(place_mm - half, place_mm[-1] + half)
        ends = np.append(self.place_mm - self.width_mm / 2, self.place_mm[-1] + self.width_mm[-1] / 2)
        force = np.append(0.0, np.cumsum(self.normal * self.width_mm))
        return np.asarray(np.diff(np.interp(between, ends, force)) / (2 * half))


def contact_pressure(section: SampledSection, pressed: IndentationResult) -> ContactPressure:
    """Return the contact pressures of a press on the section. Raises ModelRangeError beside the pulp."""
    patch = pressed.model.patch  # away from the middle, the patch may be wider than the section's own
    location, (low, high) = section.line.places(patch.x), section.line.reach_mm
    selected = pressed.state.force.any(axis=0) | (location >= low) & (location <= high)
    order = np.flatnonzero(selected)[np.argsort(location[selected])]
    location, width, force = location[order], patch.area_mm2[order], pressed.state.force[:, order]
    pressure = PSEUDO_E_EPIDERMIS * force / width
    normal = section.line.normals(section.line.angles(location)).T
    inward = -(normal * pressure).sum(axis=0)
    along = normal[Y] * pressure[X] - normal[X] * pressure[Y]
    return ContactPressure(location, width, inward, along)


_ROUNDS = 4  # leaning pressures move the skin: the fourth round changes SED by less than 0.1 %
_LEAN_SD = 0.15  # error of leans at corners sharper than a sample, correlated over a length of skin
_LEAN_LENGTH_MM = 0.2
_STEEPEST = 1.0  # a lean by more than 45° is no contact


@dataclass(frozen=True)
class SectionSkin:
    """Skin at the ends of n samples, and its displacement by their pressures, in mm and pseudo-units."""

    at_rest_mm: Array  # (2, n + 1) x and y
    moved_mm: Array  # (2, n + 1, 2 n) per unit of normal, then of lateral pressure
    normal: Array  # (n, 2) outward normals of the undeformed skin in the middle of each sample

    def pressed(self, pressure: Array, lateral: Array) -> Array:
        """Return (2, n + 1) the samples' ends under (n,) normal and lateral pressures (mm)."""
        return np.asarray(self.at_rest_mm + self.moved_mm @ np.concatenate([pressure, lateral]))

    def lean(self, pressure: Array) -> Array:
        """Return (n,) lateral / normal pressure of each sample."""
        lean = np.zeros_like(pressure)
        for _ in range(_ROUNDS):
            along = np.diff(self.pressed(pressure, lean * pressure), axis=1)
            across = along[X] * self.normal[:, X] + along[Y] * self.normal[:, Y]
            lean = across / (along[X] * self.normal[:, Y] - along[Y] * self.normal[:, X])
            lean = np.clip(lean, -_STEEPEST, _STEEPEST)
        return lean


@dataclass(frozen=True)
class Frictionless(LeaningOperator):
    """SED under normal pressures and the lateral ones that they imply; no longer exactly quadratic."""

    lateral: Array  # (c, m, n) like `parts`, of pressures along the skin
    skin: SectionSkin

    def per_receptor(self, change: Callable[[Array], Array]) -> ForwardOperator:
        return replace(self, parts=change(self.parts), lateral=change(self.lateral))

    def leaning(self, pressure: Array) -> ForwardOperator:
        parts = self.parts + self.lateral * self.skin.lean(pressure)
        return ForwardOperator(self.name, self.energy, parts, self.place_mm, self.receptor_mm)

    def unsure(self, pressure: Array) -> Array:
        """Return the (m, m) covariance of SED from uncertain leans."""
        linear = self.leaning(pressure).parts @ pressure
        by_lean = 2 * np.einsum("cm,cmn->mn", linear, self.lateral) * pressure
        apart = np.subtract.outer(self.place_mm, self.place_mm) / _LEAN_LENGTH_MM
        return np.asarray(_LEAN_SD**2 * by_lean @ np.exp(-0.5 * apart**2) @ by_lean.T)


def frictionless(section: ReceptorSection, ends_mm: Array, energy: Energy) -> Frictionless:
    """Return the operator of skin samples between (n + 1,) ascending ends. Raises ModelRangeError off the patch."""
    middle, width = 0.5 * (ends_mm[1:] + ends_mm[:-1]), np.diff(ends_mm)
    both = influence(section, middle, width, energy)
    normal, lateral = np.split(both.parts, 2, axis=2)
    return Frictionless(both.name, energy, normal, middle, both.receptor_mm, lateral, _skin(section, ends_mm))


def _skin(section: ReceptorSection, ends_mm: Array) -> SectionSkin:
    patch = section.model.patch
    location = section.line.places(patch.x)
    order = np.argsort(location)
    location, width = location[order], patch.area_mm2[order]
    if not (location[0] <= ends_mm[0] and ends_mm[-1] <= location[-1]):
        raise ModelRangeError(
            f"samples from {float(ends_mm[0]):.2f} to {float(ends_mm[-1]):.2f} mm: must lie within "
            f"{float(location[0]):.2f} to {float(location[-1]):.2f} mm",
            "samples_beside_patch",
        )
    low, high = location - width / 2, location + width / 2
    shared = np.minimum(high[:, None], ends_mm[1:]) - np.maximum(low[:, None], ends_mm[:-1])
    area = np.maximum(0.0, shared)  # (k, n) of each node's skin in each sample
    normal = section.line.normals(section.line.angles(location)).T[:, :, None]
    along = np.stack([normal[Y], -normal[X]])
    force = np.concatenate([-normal * area, along * area], axis=-1)  # (2, k, 2 n)
    compliance = patch.compliance.reshape(2, len(patch), 2, len(patch))[:, order][:, :, :, order]
    moved = np.einsum("akbl,bln->akn", compliance, force) / PSEUDO_E_EPIDERMIS
    position = patch.position_mm[order].T
    at_rest = np.stack([np.interp(ends_mm, location, position[axis]) for axis in (X, Y)])
    between = _interpolation(ends_mm, location)
    middle = section.line.angles(0.5 * (ends_mm[1:] + ends_mm[:-1]))
    return SectionSkin(at_rest, between @ moved, section.line.normals(middle))


def _interpolation(at: Array, knots: Array) -> Array:
    """Return (len(at), len(place)) weights of linear interpolation."""
    return np.stack([np.interp(at, knots, row) for row in np.eye(len(knots))], axis=1)
