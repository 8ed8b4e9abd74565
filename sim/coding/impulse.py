"""Impulse responses of the section: e11, e22, e12 at receptors under a point load in the middle (Raju 1998, §6.5)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.energy import Energy, sed_of
from sim.coding.sampled_section import SampledSection, Sampling
from sim.measures.measures import Elastic

Array = NDArray[np.float64]

NAMES = ("h", "g", "f")
"""Of the responses of e11, e22 and e12 (Raju 1998, Fig. 6-5)."""


class Opposite(NamedTuple):
    """How nearly one response is the other's negative: their sum in relative L2 and over the peak, Pearson's r."""

    relative_l2: float
    largest: float
    correlation: float


@dataclass(frozen=True)
class ImpulseResponses:
    """Strains at equally spaced receptors per pseudo-unit of pressure on one sample of skin, over the middle one."""

    strain: Array  # (3, n) h, g, f: e11, e22 and engineering e12 in the sampling's axes
    sampling: Sampling
    material: Elastic  # about the receptors; E in pseudo-units

    @property
    def opposite(self) -> Opposite:
        """How nearly g is −h: it would be all of it in an incompressible tissue."""
        h, g, _ = self.strain
        left = h + g
        return Opposite(
            float(np.linalg.norm(left) / np.linalg.norm(h)),
            float(np.abs(left).max() / np.abs(h).max()),
            float(np.corrcoef(h, g)[0, 1]),
        )

    @property
    def tails(self) -> Array:
        """(3,) the larger of a response's two ends over its peak: what is cut off is no larger than about that."""
        size = np.abs(self.strain)
        return np.asarray(np.maximum(size[:, 0], size[:, -1]) / size.max(axis=1))

    def spectra(self) -> tuple[Array, Array]:
        """Spatial frequencies (n/2,) in cycles per mm, and (3, n/2) amplitudes per pseudo-unit and mm of skin."""
        n, spacing = self.strain.shape[1], self.sampling.spacing_mm
        return np.asarray(np.fft.rfftfreq(n, spacing)), np.abs(np.fft.rfft(self.strain, axis=1))

    def shifted(self, samples: int) -> Array:
        """(3, n) the responses to a load so many samples to the right; nan where they say nothing."""
        moved = np.full_like(self.strain, np.nan)
        n = moved.shape[1]
        kept = slice(max(0, samples), min(n, n + samples))
        moved[:, kept] = self.strain[:, max(0, -samples) : min(n, n - samples)]
        return moved


def impulse_responses(section: SampledSection) -> ImpulseResponses:
    """h, g and f of a section."""
    strain = section.sampling.spacing_mm * section.under_loads(0.0)[:, :, 0, 0]
    return ImpulseResponses(strain, section.sampling, section.material)


class ShiftErrors(NamedTuple):
    """What convolution makes of loads away from the middle: relative L2 against finite elements, load by load."""

    place_mm: Array  # (k,)
    strain: Array  # (3, k) of e11, e22, e12
    sed: Array  # (k,)


def shift_errors(section: SampledSection, energy: Energy, farthest: int) -> ShiftErrors:
    """The shift-invariance error map: loads over the middle `2 farthest + 1` samples, at receptors that both have."""
    responses = impulse_responses(section)
    shifts = np.arange(-farthest, farthest + 1)
    errors = [_errors(section, responses, energy, k) for k in shifts.tolist()]
    strain, sed = zip(*errors, strict=True)
    return ShiftErrors(np.asarray(section.sampling.spacing_mm * shifts), np.stack(strain, axis=1), np.array(sed))


def _errors(
    section: SampledSection, responses: ImpulseResponses, energy: Energy, samples: int
) -> tuple[Array, float]:
    moved = responses.shifted(samples)
    there = np.isfinite(moved[0])
    spacing = section.sampling.spacing_mm
    true = spacing * section.under_loads(samples * spacing)[:, there, 0, 0]
    sed, true_sed = (sed_of(strain, section.material, energy) for strain in (moved[:, there], true))
    strain = np.linalg.norm(moved[:, there] - true, axis=1) / np.linalg.norm(true, axis=1)
    return strain, float(np.linalg.norm(sed - true_sed) / np.linalg.norm(true_sed))
