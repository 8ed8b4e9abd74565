"""What `rig encode` and `rig decode` work on: an operator, pressures, and finite elements' own answer to a press."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.protocol.errors import BadInputError
from sim.coding.operators import Operator, OperatorName, centred, convolution, impulse_responses, influence
from sim.coding.pressure import borne_by
from sim.coding.section import Energy, SampledSection, sed_of
from sim.contact.indentor import Indentor
from sim.contact.shapes import parse_shape
from sim.models.small_strain import SmallStrain

Array = NDArray[np.float64]


class Scene(NamedTuple):
    """One press of the section."""

    indentor: Indentor
    x_mm: float
    doi_mm: float


@dataclass(frozen=True)
class Told:
    """What is encoded; of a press also SED by finite elements and how far the operator is from it."""

    operator: Operator
    pressure: Array
    true: tuple[Array, Array] | None = None  # places of receptors in mm, SED
    missed: dict[str, float] | None = None
    small_strain: SmallStrain | None = None


def pressed(shape: str, x_mm: float, doi_mm: float | None) -> Scene:
    """Raises BadInputError without a depth, ShapeError for no shape."""
    if doi_mm is None:
        raise BadInputError(
            "{option}: expected {needs} beside it", code="needs_option", option="--shape", needs="--doi-mm"
        )
    return Scene(parse_shape(shape), x_mm, doi_mm)


def told(section: SampledSection, name: OperatorName, energy: Energy, pressure: Array) -> Told:
    """Equally spaced normal pressures about the middle of the pad."""
    if name == "convolution":
        return Told(convolution(impulse_responses(section), len(pressure), energy), pressure)
    spacing = section.sampling.spacing_mm
    place = centred(len(pressure), spacing)
    operator = influence(section, place, np.full(len(place), spacing), energy)
    return Told(operator, np.concatenate([pressure, np.zeros(len(place))]))


def told_of_press(section: SampledSection, name: OperatorName, energy: Energy, scene: Scene) -> Told:
    """What a press bears on the skin: for convolution normal pressures at samples, for influence all at the nodes."""
    found = section.finger.indent(scene.indentor, scene.x_mm, doi_mm=scene.doi_mm)
    borne = borne_by(section, found)
    angle = section.line.angles(section.sampling.place_mm)
    true = sed_of(section.line.in_axes(found.receptor_strain, angle), section.material, energy)
    if name == "influence":
        operator, pressure = influence(section, borne.place_mm, borne.width_mm, energy), borne.stacked
    else:
        half = int(min(-borne.place_mm[0], borne.place_mm[-1]) / section.sampling.spacing_mm)
        operator = convolution(impulse_responses(section), 2 * half + 1, energy)
        pressure = borne.at(operator.place_mm)
    said = np.interp(section.sampling.place_mm, operator.receptor_mm, operator.sed(pressure))
    missed = {
        "relative_l2": float(np.linalg.norm(said - true) / np.linalg.norm(true)),
        "peak": float(said.max() / true.max() - 1),
        "lateral_share": borne.lateral_share,
    }
    return Told(operator, pressure, (section.sampling.place_mm, true), missed, found.small_strain)
