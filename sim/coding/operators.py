"""Operators from pressure on the skin to SED at receptors: convolution, as in the source, or finite elements."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import convolution_matrix

from sim.coding.section import Energy, ReceptorSection, SampledSection, Sampling, sed_of, squared_parts
from sim.measures.measures import Elastic

# --- impulse ---
#
# Impulse responses of the section follow Raju (1998, §6.5): strains at receptors under a point load in the middle.

Array = NDArray[np.float64]

NAMES = ("h", "g", "f")
"""Names of the responses of e11, e22 and e12 (Raju 1998, Fig. 6-5)."""


class Opposite(NamedTuple):
    """Deviation of one response from another's negative: relative L2 and peak of their sum, and Pearson's r."""

    relative_l2: float
    largest: float
    correlation: float


@dataclass(frozen=True)
class ImpulseResponses:
    """Strains at equally spaced receptors per pseudo-unit of pressure on the middle sample of skin."""

    strain: Array  # (3, n) h, g, f: e11, e22 and engineering e12 in the sampling's axes
    sampling: Sampling
    material: Elastic  # at the receptors; E in pseudo-units

    @property
    def opposite(self) -> Opposite:
        """Deviation of g from −h; zero in incompressible tissue."""
        h, g, _ = self.strain
        left = h + g
        return Opposite(
            float(np.linalg.norm(left) / np.linalg.norm(h)),
            float(np.abs(left).max() / np.abs(h).max()),
            float(np.corrcoef(h, g)[0, 1]),
        )

    @property
    def tails(self) -> Array:
        """(3,) larger end of each response / its peak: a bound of what truncation removes."""
        size = np.abs(self.strain)
        return np.asarray(np.maximum(size[:, 0], size[:, -1]) / size.max(axis=1))

    def spectra(self) -> tuple[Array, Array]:
        """Return spatial frequencies (n/2,) in 1/mm, and (3, n/2) amplitudes per pseudo-unit and mm of skin."""
        n, spacing = self.strain.shape[1], self.sampling.spacing_mm
        return np.asarray(np.fft.rfftfreq(n, spacing)), np.abs(np.fft.rfft(self.strain, axis=1))

    def shifted(self, samples: int) -> Array:
        """Return (3, n) responses to a load shifted to the right by a number of samples; nan where unknown."""
        moved = np.full_like(self.strain, np.nan)
        n = moved.shape[1]
        known = slice(max(0, samples), min(n, n + samples))
        moved[:, known] = self.strain[:, max(0, -samples) : min(n, n - samples)]
        return moved


def impulse_responses(section: SampledSection) -> ImpulseResponses:
    """Return h, g and f of a section."""
    strain = section.sampling.spacing_mm * section.under_loads(0.0)[:, :, 0, 0]
    return ImpulseResponses(strain, section.sampling, section.material)


class ShiftErrors(NamedTuple):
    """Errors of convolution for loads away from the middle: relative L2 against finite elements, for each load."""

    place_mm: Array  # (k,) of the loads
    strain: Array  # (3, k) of e11, e22, e12
    sed: Array  # (k,)


def shift_errors(section: SampledSection, energy: Energy, farthest: int) -> ShiftErrors:
    """Return the shift-invariance errors of loads over the middle 2 · farthest + 1 samples, at shared receptors."""
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
    """SED at m receptors as a sum of squares of linear functions of n pressures, in pseudo-units.

    convolution: P∗h, P∗g, P∗f with one h, g, f everywhere (Raju 1998, Fig. 6-6). influence: finite elements for each
    location on the skin and each receptor, under normal pressures, followed by lateral ones.
    """

    name: OperatorName
    energy: Energy
    parts: Array  # (c, m, n)
    place_mm: Array  # (n,) of each pressure on the skin
    receptor_mm: Array  # (m,) places of the skin above the receptors

    def per_receptor(self, change: Callable[[Array], Array]) -> "ForwardOperator":
        """Return the operator with its receptors, the second axis of (c, m, n), changed."""
        return replace(self, parts=change(self.parts))

    def leaning(self, pressure: Array) -> "ForwardOperator":
        """Return the quadratic operator with forces that lean as under these pressures; here they never lean."""
        return self

    def unsure(self, pressure: Array) -> Array:
        """Return the (m, m) covariance of SED from uncertain force directions; here zero."""
        return np.zeros((len(self.receptor_mm), len(self.receptor_mm)))

    def sed(self, pressure: Array) -> Array:
        """Return (m,) SED under (n,) pressures."""
        return np.asarray(((self.parts @ pressure) ** 2).sum(axis=0))

    def slope(self, pressure: Array) -> Array:
        """Return (m, n) derivatives of the SED."""
        return 2 * np.einsum("cm,cmn->mn", self.parts @ pressure, self.parts)

    def pulled_back(self, pressure: Array, weight: Array) -> Array:
        """Return the (n,) gradient of Σ weight · SED, by the adjoint without the (m, n) matrix."""
        return 2 * np.einsum("cm,cmn->n", weight * (self.parts @ pressure), self.parts)


class LeaningOperator(ForwardOperator):
    """SED under normal pressures and the lateral ones that they imply; no longer exactly quadratic."""

    def sed(self, pressure: Array) -> Array:
        return self.leaning(pressure).sed(pressure)

    def slope(self, pressure: Array) -> Array:
        """Return (m, n) derivatives of the SED at fixed leans."""
        return self.leaning(pressure).slope(pressure)

    def pulled_back(self, pressure: Array, weight: Array) -> Array:
        """Return the (n,) gradient of Σ weight · SED at fixed leans."""
        return self.leaning(pressure).pulled_back(pressure, weight)


def convolution(responses: ImpulseResponses, samples: int, energy: Energy) -> ForwardOperator:
    """Return the full linear convolution of equally spaced pressures: samples + length of h − 1 receptors."""
    full = np.stack([convolution_matrix(response, samples, mode="full") for response in responses.strain])
    spacing = responses.sampling.spacing_mm
    return ForwardOperator(
        "convolution",
        energy,
        squared_parts(full, responses.material, energy),
        centred(samples, spacing),
        centred(full.shape[1], spacing),
    )


def influence(section: ReceptorSection, place_mm: Array, width_mm: Array, energy: Energy) -> ForwardOperator:
    """Return the operator of normal and then lateral pressures (rising with x) on given widths of skin."""
    strain = section.under_loads(place_mm) * width_mm[:, None]
    by_input = np.concatenate([strain[..., 0], strain[..., 1]], axis=-1)
    parts = squared_parts(by_input, section.material, energy)
    return ForwardOperator("influence", energy, parts, np.tile(place_mm, 2), section.place_mm)


def normal_influence(section: ReceptorSection, place_mm: Array, spacing_mm: float, energy: Energy) -> ForwardOperator:
    """Return the operator of n ascending normal pressures, linear between them and zero beyond.

    They act on the skin at locations no farther apart than the spacing, so that few pressures cover wide skin.
    """
    span = float(place_mm[-1] - place_mm[0])
    on_skin = np.linspace(place_mm[0], place_mm[-1], max(len(place_mm), round(span / spacing_mm) + 1))
    width = np.full(len(on_skin), span / (len(on_skin) - 1))
    fine = normal_alone(influence(section, on_skin, width, energy))
    between = np.stack([np.interp(on_skin, place_mm, one) for one in np.eye(len(place_mm))], axis=1)
    return ForwardOperator("influence", energy, fine.parts @ between, place_mm, section.place_mm)


def normal_alone(operator: ForwardOperator) -> ForwardOperator:
    """Return an influence operator without its lateral pressures."""
    n = len(operator.place_mm) // 2
    return replace(operator, parts=operator.parts[:, :, :n], place_mm=operator.place_mm[:n])


def at_receptors(operator: ForwardOperator, receptors: slice | NDArray[np.bool_]) -> ForwardOperator:
    """Return the operator at some of its receptors."""
    selected = operator.per_receptor(lambda parts: parts[:, receptors])
    return replace(selected, receptor_mm=operator.receptor_mm[receptors])


def weighted(operator: ForwardOperator, weight: Array) -> ForwardOperator:
    """Return the operator with each receptor's SED times its (m,) weight, which gives readings equal noise."""
    return operator.per_receptor(lambda parts: parts * np.sqrt(weight)[:, None])


def centred(samples: int, spacing_mm: float) -> Array:
    """Return (samples,) equally spaced locations about 0 (mm)."""
    return np.asarray(spacing_mm * (np.arange(samples) - (samples - 1) / 2))
