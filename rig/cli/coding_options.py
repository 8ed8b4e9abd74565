"""Options of the commands of encoding and decoding, with their checks: sampling, noise, pressures."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
import typer
from numpy.typing import NDArray

from rig.cli.options import bounded
from rig.cli.request import Needs
from rig.errors import BadInputError
from rig.printable import either
from rig_shared.number_text import read_number
from rig_shared.plural import number_of
from sim.coding.decoder_results import CodingError
from sim.coding.encoding import Noise, NoisePlace
from sim.coding.readings_file import checked_pressures, read_pressures
from sim.coding.section import Sampling
from sim.coding.task import SectionPress
from sim.contact.shapes import parse_shape, with_size
from sim.tables import TableError

INPUT, SAMPLING, NOISE = "Input", "Sampling", "Noise and receptor"
"""Panels of options."""

AcrossOption = Annotated[
    float, typer.Option(metavar="X", help="x of the indentor from the pad center, in mm.", rich_help_panel=INPUT)
]
DoiOption = Annotated[
    float | None,
    typer.Option(metavar="D", help="DOI, in mm. Default: none; --shape needs it.", rich_help_panel=INPUT),
]
SeedOption = Annotated[
    int, typer.Option(metavar="N", help="Seed of the random generator, 0 to 2^32.", rich_help_panel=NOISE)
]
SpacingOption = Annotated[
    float, typer.Option(metavar="MM", help="Spacing of the samples, 0.05 to 0.5 mm.", rich_help_panel=SAMPLING)
]
HalfLengthOption = Annotated[
    int, typer.Option(metavar="N", help="Number of samples on each side, 4 to 100.", rich_help_panel=SAMPLING)
]
DepthOption = Annotated[
    float, typer.Option(metavar="MM", help="Receptor depth below skin, 0.1 to 3 mm.", rich_help_panel=SAMPLING)
]
EnergyOption = Annotated[
    str,
    typer.Option(
        metavar="E",
        help="Strain energy density (SED): incompressible (source, Eq. 6.1) or finite (compressible).",
        rich_help_panel=SAMPLING,
    ),
]
SnrOption = Annotated[
    float | None,
    typer.Option(
        metavar="DB",
        help="Signal-to-noise ratio of added noise, -40 to 100 dB. Default: no noise.",
        rich_help_panel=NOISE,
    ),
]
NoisePlaceOption = Annotated[
    str, typer.Option(metavar="AT", help="Add noise to: receptor (SED) or output (rate).", rich_help_panel=NOISE)
]


_Word = TypeVar("_Word", bound=str)


def named(option: str, text: str, words: Sequence[_Word]) -> _Word:
    """Return the choice with that name. Raises BadInputError for an unknown name."""
    for word in words:
        if text == word:
            return word
    raise BadInputError(f"{option} {text!r}: must be {either(words)}", "unknown_choice")


def sampling_of(spacing_mm: float, half_length: int, depth_mm: float) -> Sampling:
    """Return the sampling; raise BadInputError for numbers out of bounds."""
    bounded("--spacing-mm", spacing_mm, 0.05, 0.5)
    bounded("--half-length", half_length, 4, 100)
    bounded("--receptor-depth-mm", depth_mm, 0.1, 3.0)
    return Sampling(spacing_mm, half_length, "skin", depth_mm)


def noise_of(snr_db: float | None, at: NoisePlace, seed: int) -> Noise | None:
    """Return the noise to add, None without a ratio; raise BadInputError for numbers out of bounds."""
    drawn = int(bounded("--seed", seed, 0, 2**32))
    return None if snr_db is None else Noise(bounded("--snr-db", snr_db, -40, 100), at, drawn)


def pressures_of(text: str, spacing_mm: float) -> NDArray[np.float64]:
    """Return (n,) pressures (pseudo-units) from `20,14` or a CSV column; raise BadInputError if invalid."""
    try:
        values = [read_number(cell) for cell in text.split(",")]
    except ValueError:
        values = None
    try:
        return read_pressures(Path(text), spacing_mm) if values is None else checked_pressures(values)
    except TableError as error:
        hint = "; give numbers such as 20,14, or a CSV with a column pressure" * (error.code == "unreadable")
        raise BadInputError(f"--pressure {error}{hint}", error.code) from None
    except CodingError as error:
        raise in_options(error) from None


def source_in_words(source: NDArray[np.float64] | SectionPress, spacing_mm: float) -> str:
    """Return what was read as pressures or as an indentor."""
    if isinstance(source, SectionPress):
        return with_size(source.shape if isinstance(source.shape, str) else source.shape.name)
    span = f"{source.min():g} to {source.max():g} pseudo-units"
    return f"{number_of(len(source), 'pressures')}, {span}, {spacing_mm:g} mm apart"


SHARED_RULES = (Needs("--shape", ("--doi-mm",)), Needs("--gain", ("--threshold",)))
"""Rules that encoding and decoding share."""


def press_of(shape: str, x_mm: float, doi_mm: float | None) -> SectionPress:
    """Return a press of the section; raise ShapeError for an unknown shape."""
    assert doi_mm is not None
    return SectionPress(parse_shape(shape), x_mm, doi_mm)


_OPTIONS = {"bounds": "--range"}


def in_options(error: CodingError) -> BadInputError:
    """Return the same error with the names of options for its arguments."""
    sentence = str(error)
    for name in error.arguments:
        sentence = sentence.replace(name, _OPTIONS.get(name, f"--{name}"), 1)
    return BadInputError(sentence, error.code)
