"""What a press bears on the skin of the section, as pressures at its nodes or at equally spaced samples."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.coding.sampled_section import SampledSection
from sim.config.units import PSEUDO_E_EPIDERMIS
from sim.contact.patch import X, Y
from sim.models.results.indentation import IndentationResult

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Borne:
    """Pressures at the section's skin nodes; pseudo-units, in axes normal to the undeformed skin and along it."""

    place_mm: Array  # (k,) ascending
    width_mm: Array  # (k,) of skin that belongs to each node
    normal: Array  # (k,) inward
    lateral: Array  # (k,) rising with x

    @property
    def lateral_share(self) -> float:
        """Size of all lateral forces over that of all normal ones."""
        return float((np.abs(self.lateral) * self.width_mm).sum() / (np.abs(self.normal) * self.width_mm).sum())

    @property
    def stacked(self) -> Array:
        """(2 k,) normal, then lateral: what the influence operator takes."""
        return np.concatenate([self.normal, self.lateral])

    def at(self, place_mm: Array) -> Array:
        """(n,) normal pressures at places, linear between the nodes."""
        return np.interp(place_mm, self.place_mm, self.normal)

    def means(self, place_mm: Array) -> Array:
        """(n,) normal pressures on samples about (n,) equally spaced places: the force on each, over its width."""
        half = (place_mm[1] - place_mm[0]) / 2
        between = np.append(place_mm - half, place_mm[-1] + half)
        ends = np.append(self.place_mm - self.width_mm / 2, self.place_mm[-1] + self.width_mm[-1] / 2)
        force = np.append(0.0, np.cumsum(self.normal * self.width_mm))
        return np.asarray(np.diff(np.interp(between, ends, force)) / (2 * half))


def borne_by(section: SampledSection, pressed: IndentationResult) -> Borne:
    """What the indentor presses on the section's skin. Raises ModelRangeError where that is beside the pulp."""
    patch = pressed.model.patch  # off the middle it may be a wider one than the section begins with
    place, (low, high) = section.line.places(patch.x), section.line.reach_mm
    meant = pressed.state.force.any(axis=0) | (place >= low) & (place <= high)
    order = np.flatnonzero(meant)[np.argsort(place[meant])]
    place, width, force = place[order], patch.area_mm2[order], pressed.state.force[:, order]
    pressure = PSEUDO_E_EPIDERMIS * force / width
    normal = section.line.normals(section.line.angles(place)).T
    inward = -(normal * pressure).sum(axis=0)
    along = normal[Y] * pressure[X] - normal[X] * pressure[Y]
    return Borne(place, width, inward, along)
