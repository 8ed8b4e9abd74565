"""Where the commands of encoding and decoding sample skin and receptors, and which energy they mean."""

from typing import Annotated

import typer

from rig.protocol.errors import BadInputError
from sim.coding.energy import ENERGIES, Energy
from sim.coding.sampled_section import Sampling
from sim.coding.skin_line import Axes

SpacingOption = Annotated[float, typer.Option(metavar="MM", help="Between samples of skin and receptors.")]
HalfLengthOption = Annotated[int, typer.Option(metavar="N", help="Samples of a response to each side.")]
DepthOption = Annotated[float, typer.Option(metavar="MM", help="Of the receptors, below the skin.")]
ENERGY_HELP = "SED of incompressible tissue (the source's Eq. 6.1), or finite: with the tissue's own compression."


def sampling_of(spacing_mm: float, half_length: int, depth_mm: float, axes: Axes = "skin") -> Sampling:
    """Raises BadInputError for numbers beyond their bounds."""
    for option, value, low, high in (
        ("--spacing-mm", spacing_mm, 0.05, 0.5),
        ("--half-length", half_length, 4, 100),
        ("--receptor-depth-mm", depth_mm, 0.1, 3.0),
    ):
        if not low <= value <= high:
            raise BadInputError(f"{option} {value:g}: expected {low:g} … {high:g}")
    return Sampling(spacing_mm, half_length, axes, depth_mm)


def checked_energy(text: str) -> Energy:
    """Raises BadInputError for a word that names no energy."""
    for energy in ENERGIES:
        if text == energy:
            return energy
    raise BadInputError(f"--energy {text!r}: expected {' or '.join(ENERGIES)}")
