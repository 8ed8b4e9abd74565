"""One place's response moved to where another force is: convolution on the whole finger, and what it misses.

Places are compared along the skin: by the length of the chord between two of them, in the direction of its
projection onto the plane that touches the skin under the force. Strains are those across the finger, outward and
along it, each at its own receptor.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CloughTocher2DInterpolator

from sim.coding.point_spread.loaded_finger import Load, LoadedFinger, energy_density
from sim.coding.point_spread.spreads import Sheet, Spread
from sim.config.units import GWT_N
from sim.contact.patch import Z
from sim.models.inside.interior import Recovery
from sim.models.results.indentation import IndentationResult

Array = NDArray[np.float64]

_PAIRS = np.array([[0, 0], [1, 1], [2, 2], [0, 1], [1, 2], [0, 2]])  # e11 e22 e33 e12 e23 e13
_IN_PLANE_MM = 1e-6
_ENGINEERING = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])


def in_frames(strain: Array, frames: Array) -> Array:
    """(…, n, 6) engineering strains in (n, 3, 3) frames, from Cartesian ones."""
    tensor = np.empty((*strain.shape[:-1], 3, 3))
    for (i, j), one in zip(_PAIRS.tolist(), np.moveaxis(strain / _ENGINEERING, -1, 0), strict=True):
        tensor[..., i, j] = tensor[..., j, i] = one
    turned = np.einsum("nai,...nij,nbj->...nab", frames, tensor, frames)
    return np.asarray(turned[..., _PAIRS[:, 0], _PAIRS[:, 1]] * _ENGINEERING)


class MissedOfPress(NamedTuple):
    """Of SED: relative L2, the peak; the share of lateral forces, and relative L2 without these in the truth."""

    relative_l2: float
    peak: float
    lateral_share: float
    normal_alone: float


@dataclass(frozen=True)
class MovedResponse:
    """Strain in the skin's axes about a unit normal force in the middle of the pad, to be moved elsewhere."""

    finger: LoadedFinger
    sheet: Sheet
    recovery: Recovery
    strain_at: CloughTocher2DInterpolator  # of (…, 2) offsets across and along, mm; 0 beyond what was seen

    @classmethod
    def of(cls, finger: LoadedFinger, sheet: Sheet) -> "MovedResponse":
        """By one solve. Raises ModelRangeError."""
        middle = Load(0.0, finger.config.receptor_plane_mm)
        recovery = finger.recovery(sheet.at_mm)
        strain = recovery.strain(finger.moved([middle]))[0]
        offset = _offsets(finger, finger.foot_mm(middle)[None], sheet.skin_mm)[0]
        turned = in_frames(strain, finger.frames(sheet.skin_mm))
        return cls(finger, sheet, recovery, CloughTocher2DInterpolator(offset, turned, fill_value=0.0))

    def convolved(self, place_mm: Array, force_n: Array, skin_mm: Array) -> Array:
        """(n, 6) strains in the skin's axes below (n, 3) places of skin: k inward forces, each with this response."""
        by_force = self.strain_at(_offsets(self.finger, place_mm, skin_mm))
        return np.einsum("k,knc->nc", force_n, by_force)

    def missed(self, spread: Spread, force_gwt: float) -> float:
        """Relative L2 of the SED about a site: this response moved there against finite elements of that load."""
        force = np.array([force_gwt * GWT_N / self.finger.config.tissue.e_epidermis_mpa])
        strain = self.convolved(spread.load_mm[None], force, spread.sheet.skin_mm)
        sed = energy_density(strain, spread.young_ratio, self.finger.config.tissue.poisson)
        return _relative_l2(sed, spread.sed)

    def missed_of_press(self, pressed: IndentationResult) -> MissedOfPress:
        """What convolution makes of a press at the receptors of the receptor plane."""
        patch = pressed.model.patch
        force = np.zeros((len(patch), 3))
        force[:, list(patch.axes)] = pressed.state.force.T
        touched = np.abs(force).max(axis=1) > 0
        place, force = patch.position_mm[touched], force[touched]
        outward = self.finger.normals(place)
        inward = -(force * outward).sum(axis=1)
        lateral = np.linalg.norm(force + inward[:, None] * outward, axis=1)
        row = np.abs(self.sheet.skin_mm[:, Z] - self.finger.config.receptor_plane_mm) < _IN_PLANE_MM
        loads = [self.finger.on_nodes(place, one) for one in (force, -inward[:, None] * outward)]
        true = self.recovery.strain(self.finger.interior.moved(np.stack(loads)))[:, row]
        found = self.convolved(place, inward, self.sheet.skin_mm[row])
        poisson, young = self.finger.config.tissue.poisson, self.recovery.young_ratio[row]
        sed, all_of_it, normal_alone = (energy_density(strain, young, poisson) for strain in (found, *true))
        return MissedOfPress(
            _relative_l2(sed, all_of_it),
            float(sed.max() / all_of_it.max() - 1),
            float(lateral.sum() / np.abs(inward).sum()),
            _relative_l2(sed, normal_alone),
        )


def _relative_l2(found: Array, true: Array) -> float:
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))


def _offsets(finger: LoadedFinger, from_mm: Array, to_mm: Array) -> Array:
    """(k, n, 2) from k places of the skin to n others, across and along."""
    chord = to_mm[None] - from_mm[:, None]
    across, _, along = np.moveaxis(finger.frames(from_mm), -2, 0)
    flat = np.stack([np.einsum("knc,kc->kn", chord, axis) for axis in (across, along)], axis=-1)
    length, projected = np.linalg.norm(chord, axis=-1), np.linalg.norm(flat, axis=-1)
    return flat * (length / np.maximum(projected, 1e-12))[..., None]
