"""From what bears on the skin to SED at receptors: by convolution, as the source, or by finite-element influence."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import convolution_matrix

from sim.coding.section import Energy, FeltSection, SampledSection, Sampling, sed_of, squared_parts
from sim.measures.measures import Elastic

# --- impulse ---
#
# Impulse responses of the section: e11, e22, e12 at receptors under a point load in the middle (Raju 1998, §6.5).

Array = NDArray[np.float64]

NAMES = ("h", "g", "f")
"""Components of strain with a response: e11, e22 and e12 (Raju 1998, Fig. 6-5)."""


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


OperatorName = Literal["convolution", "influence"]
OPERATORS: tuple[OperatorName, ...] = get_args(OperatorName)


@dataclass(frozen=True)
class ForwardOperator:
    """SED at m receptors as a sum of squares of what is linear in n pressures; pseudo-units.

    convolution: P∗h, P∗g, P∗f with one h, g, f everywhere (Raju 1998, Fig. 6-6). influence: finite elements for each
    place of the skin and each receptor, under normal pressures and, after all of them, lateral ones.
    """

    name: OperatorName
    energy: Energy
    parts: Array  # (c, m, n)
    place_mm: Array  # (n,) of each pressure on the skin
    receptor_mm: Array  # (m,) places of the skin above the receptors

    def per_receptor(self, change: Callable[[Array], Array]) -> "ForwardOperator":
        """With what stands for the receptors, the second axis of (c, m, n), changed."""
        return replace(self, parts=change(self.parts))

    def leaning(self, pressure: Array) -> "ForwardOperator":
        """Quadratic, with forces leaning as they do under these pressures; here they always stand alike."""
        return self

    def unsure(self, pressure: Array) -> Array:
        """(m, m) covariance of SED from what the operator itself does not know of the forces; here nothing."""
        return np.zeros((len(self.receptor_mm), len(self.receptor_mm)))

    def sed(self, pressure: Array) -> Array:
        """(m,) SED under (n,) pressures."""
        return np.asarray(((self.parts @ pressure) ** 2).sum(axis=0))

    def slope(self, pressure: Array) -> Array:
        """(m, n) derivatives of the SED."""
        return 2 * np.einsum("cm,cmn->mn", self.parts @ pressure, self.parts)

    def pulled_back(self, pressure: Array, weight: Array) -> Array:
        """(n,) gradient of Σ weight · SED: the adjoint, with no (m, n) matrix made."""
        return 2 * np.einsum("cm,cmn->n", weight * (self.parts @ pressure), self.parts)


def convolution(responses: ImpulseResponses, samples: int, energy: Energy) -> ForwardOperator:
    """Full linear convolution of so many equally spaced pressures: samples + length of h − 1 receptors."""
    full = np.stack([convolution_matrix(response, samples, mode="full") for response in responses.strain])
    spacing = responses.sampling.spacing_mm
    return ForwardOperator(
        "convolution",
        energy,
        squared_parts(full, responses.material, energy),
        centred(samples, spacing),
        centred(full.shape[1], spacing),
    )


def influence(section: FeltSection, place_mm: Array, width_mm: Array, energy: Energy) -> ForwardOperator:
    """Pressures over widths of skin at any places, normal ones and then lateral ones (rising with x)."""
    strain = section.under_loads(place_mm) * width_mm[:, None]
    by_input = np.concatenate([strain[..., 0], strain[..., 1]], axis=-1)
    parts = squared_parts(by_input, section.material, energy)
    return ForwardOperator("influence", energy, parts, np.tile(place_mm, 2), section.place_mm)


def normal_influence(section: FeltSection, place_mm: Array, spacing_mm: float, energy: Energy) -> ForwardOperator:
    """Finite elements for n ascending normal pressures with straight lines between them, and none beside them.

    They act on the skin at places no farther apart than the spacing, so that few pressures stand for wide skin.
    """
    span = float(place_mm[-1] - place_mm[0])
    on_skin = np.linspace(place_mm[0], place_mm[-1], max(len(place_mm), round(span / spacing_mm) + 1))
    width = np.full(len(on_skin), span / (len(on_skin) - 1))
    fine = normal_alone(influence(section, on_skin, width, energy))
    between = np.stack([np.interp(on_skin, place_mm, one) for one in np.eye(len(place_mm))], axis=1)
    return ForwardOperator("influence", energy, fine.parts @ between, place_mm, section.place_mm)


def normal_alone(operator: ForwardOperator) -> ForwardOperator:
    """An influence operator without its lateral pressures."""
    n = len(operator.place_mm) // 2
    return replace(operator, parts=operator.parts[:, :, :n], place_mm=operator.place_mm[:n])


def felt_where(operator: ForwardOperator, receptors: slice | NDArray[np.bool_]) -> ForwardOperator:
    """At some of its receptors alone."""
    felt = operator.per_receptor(lambda parts: parts[:, receptors])
    return replace(felt, receptor_mm=operator.receptor_mm[receptors])


def weighted(operator: ForwardOperator, weight: Array) -> ForwardOperator:
    """With each receptor's SED times its (m,) weight: readings whose noise differs are then all of one sd."""
    return operator.per_receptor(lambda parts: parts * np.sqrt(weight)[:, None])


def centred(samples: int, spacing_mm: float) -> Array:
    """(samples,) equally spaced places about 0; mm."""
    return np.asarray(spacing_mm * (np.arange(samples) - (samples - 1) / 2))
