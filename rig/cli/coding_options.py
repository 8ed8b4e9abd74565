"""Options of the commands of encoding and decoding, with their checks: sampling, noise, pressures."""

from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from rig.cli.options import option
from rig.cli.request import Needs
from rig.errors import BadInputError
from rig_shared.number_text import read_number
from rig_shared.plural import number_of
from sim.coding.decoder_results import CodingError
from sim.coding.encoding import NoisePlace
from sim.coding.readings_file import checked_pressures, read_pressures
from sim.coding.section import Energy
from sim.coding.task import SectionPress
from sim.contact.shapes import parse_shape, with_size
from sim.tables import TableError

INPUT, SAMPLING, NOISE = "Input", "Sampling", "Noise and receptor"
"""Panels of options."""

AcrossOption = Annotated[float, option("x of the indentor from the pad center, in mm.", "X", INPUT)]
DoiOption = Annotated[float | None, option("DOI, in mm. Default: none; --shape needs it.", "D", INPUT)]
SeedOption = Annotated[int, option("Seed of the random generator, 0 to 2^32.", "N", NOISE, within=(0, 2**32))]
SpacingOption = Annotated[float, option("Spacing of the samples, {within} mm.", "MM", SAMPLING, within=(0.05, 0.5))]
HalfLengthOption = Annotated[int, option("Number of samples on each side, {within}.", "N", SAMPLING, within=(4, 100))]
DepthOption = Annotated[float, option("Receptor depth below skin, {within} mm.", "MM", SAMPLING, within=(0.1, 3.0))]
EnergyOption = Annotated[
    Energy,
    option("Strain energy density (SED): incompressible (source, Eq. 6.1) or finite (compressible).", "E", SAMPLING),
]
SnrOption = Annotated[
    float | None,
    option("Signal-to-noise ratio of added noise, {within} dB. Default: no noise.", "DB", NOISE, within=(-40, 100)),
]
NoisePlaceOption = Annotated[NoisePlace, option("Add noise to: receptor (SED) or output (rate).", "AT", NOISE)]


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
    ends = f"first {source[0]:g}, last {source[-1]:g}, sum {source.sum():.6g}"
    return f"{number_of(len(source), 'pressures')}, {span} ({ends}), {spacing_mm:g} mm apart"


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
