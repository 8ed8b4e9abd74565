"""Where the commands of encoding and decoding sample skin and receptors, and which energy they mean."""

from collections.abc import Sequence
from typing import Annotated, TypeVar

import typer

from rig.errors import BadInputError
from sim.coding.section import Axes, Sampling

SpacingOption = Annotated[float, typer.Option(metavar="MM", help="Between samples of skin and receptors.")]
HalfLengthOption = Annotated[int, typer.Option(metavar="N", help="Samples of a response to each side.")]
DepthOption = Annotated[float, typer.Option(metavar="MM", help="Of the receptors, below the skin.")]
EnergyOption = Annotated[
    str,
    typer.Option(
        metavar="E",
        help="SED of incompressible tissue (the source's Eq. 6.1), or finite: with the tissue's own compression.",
    ),
]
SnrOption = Annotated[float | None, typer.Option(metavar="DB", help="Adds noise of this ratio.")]
NoisePlaceOption = Annotated[str, typer.Option(metavar="AT", help="receptor (before it, on SED) or output.")]


_Word = TypeVar("_Word", bound=str)


def bounded(option: str, value: float, low: float, high: float) -> float:
    """The value; raises BadInputError beyond its bounds."""
    if not low <= value <= high:
        raise BadInputError(
            "{option} {value:g}: expected {low:g} … {high:g}",
            code="outside_range", option=option, value=value, low=low, high=high,
        )  # fmt: skip
    return value


def named(option: str, text: str, words: Sequence[_Word]) -> _Word:
    """The word of that name; raises BadInputError for no such word."""
    for word in words:
        if text == word:
            return word
    raise BadInputError(
        "{option} {value!r}: expected {expected}",
        code="unknown_choice", option=option, value=text, expected=" or ".join(words),
    )  # fmt: skip


def sampling_of(spacing_mm: float, half_length: int, depth_mm: float, axes: Axes = "skin") -> Sampling:
    """Raises BadInputError for numbers beyond their bounds."""
    bounded("--spacing-mm", spacing_mm, 0.05, 0.5)
    bounded("--half-length", half_length, 4, 100)
    bounded("--receptor-depth-mm", depth_mm, 0.1, 3.0)
    return Sampling(spacing_mm, half_length, axes, depth_mm)
