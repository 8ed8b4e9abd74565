"""From what bears on the skin to SED at receptors: by convolution, as the source, or by finite-element influence."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import convolution_matrix

from sim.coding.energy import Energy, squared_parts
from sim.coding.impulse import ImpulseResponses
from sim.coding.sampled_section import FeltSection

Array = NDArray[np.float64]

OperatorName = Literal["convolution", "influence"]
OPERATORS: tuple[OperatorName, ...] = get_args(OperatorName)


@dataclass(frozen=True)
class Operator:
    """SED at m receptors as a sum of squares of what is linear in n pressures; pseudo-units.

    convolution: P∗h, P∗g, P∗f with one h, g, f everywhere (Raju 1998, Fig. 6-6). influence: finite elements for each
    place of the skin and each receptor, under normal pressures and, after all of them, lateral ones.
    """

    name: OperatorName
    energy: Energy
    parts: Array  # (c, m, n)
    place_mm: Array  # (n,) of each pressure on the skin
    receptor_mm: Array  # (m,) places of the skin above the receptors

    def per_receptor(self, change: Callable[[Array], Array]) -> "Operator":
        """With what stands for the receptors, the second axis of (c, m, n), changed."""
        return replace(self, parts=change(self.parts))

    def leaning(self, pressure: Array) -> "Operator":
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


def convolution(responses: ImpulseResponses, samples: int, energy: Energy) -> Operator:
    """Full linear convolution of so many equally spaced pressures: samples + length of h − 1 receptors."""
    full = np.stack([convolution_matrix(response, samples, mode="full") for response in responses.strain])
    spacing = responses.sampling.spacing_mm
    return Operator(
        "convolution",
        energy,
        squared_parts(full, responses.material, energy),
        centred(samples, spacing),
        centred(full.shape[1], spacing),
    )


def influence(section: FeltSection, place_mm: Array, width_mm: Array, energy: Energy) -> Operator:
    """Pressures over widths of skin at any places, normal ones and then lateral ones (rising with x)."""
    strain = section.under_loads(place_mm) * width_mm[:, None]
    by_input = np.concatenate([strain[..., 0], strain[..., 1]], axis=-1)
    parts = squared_parts(by_input, section.material, energy)
    return Operator("influence", energy, parts, np.tile(place_mm, 2), section.place_mm)


def normal_influence(section: FeltSection, place_mm: Array, spacing_mm: float, energy: Energy) -> Operator:
    """Finite elements for n ascending normal pressures with straight lines between them, and none beside them.

    They act on the skin at places no farther apart than the spacing, so that few pressures stand for wide skin.
    """
    span = float(place_mm[-1] - place_mm[0])
    on_skin = np.linspace(place_mm[0], place_mm[-1], max(len(place_mm), round(span / spacing_mm) + 1))
    width = np.full(len(on_skin), span / (len(on_skin) - 1))
    fine = normal_alone(influence(section, on_skin, width, energy))
    between = np.stack([np.interp(on_skin, place_mm, one) for one in np.eye(len(place_mm))], axis=1)
    return Operator("influence", energy, fine.parts @ between, place_mm, section.place_mm)


def normal_alone(operator: Operator) -> Operator:
    """An influence operator without its lateral pressures."""
    n = len(operator.place_mm) // 2
    return replace(operator, parts=operator.parts[:, :, :n], place_mm=operator.place_mm[:n])


def felt_where(operator: Operator, receptors: slice | NDArray[np.bool_]) -> Operator:
    """At some of its receptors alone."""
    felt = operator.per_receptor(lambda parts: parts[:, receptors])
    return replace(felt, receptor_mm=operator.receptor_mm[receptors])


def weighted(operator: Operator, weight: Array) -> Operator:
    """With each receptor's SED times its (m,) weight: readings whose noise differs are then all of one sd."""
    return operator.per_receptor(lambda parts: parts * np.sqrt(weight)[:, None])


def centred(samples: int, spacing_mm: float) -> Array:
    """(samples,) equally spaced places about 0; mm."""
    return np.asarray(spacing_mm * (np.arange(samples) - (samples - 1) / 2))
