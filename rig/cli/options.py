"""Options that several commands share, and how each is checked."""

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from rig.errors import BadInputError, around
from sim.coding.section import Axes, Sampling
from sim.tables import TableError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rig.report.style import Plot
    from sim.coding.search import CodingError
    from sim.coding.task import SectionPress


ProtocolArgument = Annotated[str, typer.Argument(help="A path, or the name of a shipped protocol.")]
MoreArgument = Annotated[list[str] | None, typer.Argument(metavar="[K=V]...", help="Further settings.")]
SetOption = Annotated[list[str] | None, typer.Option("--set", metavar="K=V", help="A parameter; may be repeated.")]
OutOption = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder in which the run makes its own.")]
SubjectOption = Annotated[str | None, typer.Option(metavar="CODE", help="Who lies under the rig: a code, like S07.")]
FingerConfigOption = Annotated[
    Path | None, typer.Option("--config", metavar="TOML", help="Configuration of rig and finger.")
]
FingertipOption = Annotated[
    Path | None, typer.Option("--config", metavar="TOML", help="Configuration of the finger.")
]
MetFingerOption = Annotated[
    Path | None, typer.Option("--finger", metavar="TOML", help="The finger as `rig meet` found it, with its bands.")
]
ConfigOption = Annotated[Path, typer.Option("--config", metavar="TOML", help="Configuration of the rig.")]
YesOption = Annotated[bool, typer.Option("--yes", help="Begin without a confirmation; the page is printed.")]
_MOST = 1000  # numbers in a range

ExactOption = Annotated[
    bool, typer.Option("--exact", help="Build every finger in full: none is interpolated between others.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")]


def numbers(option: str, text: str) -> tuple[float, ...]:
    """Numbers separated by commas, FROM:TO:STEP standing for several of them. Raises BadInputError."""
    found: list[float] = []
    for part in text.split(","):
        try:
            first, *rest = map(float, part.split(":"))
            found += _range(first, *rest) if rest else [first]
        except (TypeError, ValueError):
            from rig.errors import BadInputError

            raise BadInputError(
                "{option} {value!r}: expected numbers separated by commas, or FROM:TO:STEP with up to {most} of them",
                code="not_numbers",
                option=option,
                value=text,
                most=_MOST,
            ) from None
    return tuple(found)


def _range(first: float, last: float, step: float) -> list[float]:
    """From the first up to the last, which is one of them where the steps lead to it. Raises ValueError."""
    if not (math.isfinite(first) and step > 0 and 0 <= (last - first) / step < _MOST):
        raise ValueError
    return [round(first + k * step, 9) for k in range(int((last - first) / step + 1e-6) + 1)]


def checked_file(option: str, path: Path) -> Path:
    """A file that can be written later, before the work that fills it begins. Raises BadInputError."""
    if path.is_dir() or not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        from rig.errors import BadInputError  # a list of runs does without what scripts are made of

        raise BadInputError(
            "{option} {path}: expected a file in a folder that exists and may be written to",
            code="not_writable", option=option, path=path,
        )  # fmt: skip
    return path


WithoutForceOption = Annotated[
    bool, typer.Option("--without-force", help="Move although no force sensor answers. Nothing stops it at a finger.")
]


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


def pressures_of(text: str) -> "NDArray[np.float64]":
    """(n,) pressures from `20,14` or a CSV with a column pressure; pseudo-units. Raises BadInputError."""
    from sim.coding.readings_file import checked_pressures, read_pressures  # most commands do without
    from sim.coding.search import CodingError

    try:
        values = [float(cell) for cell in text.split(",")]
    except ValueError:
        values = None
    try:
        return read_pressures(Path(text)) if values is None else checked_pressures(values)
    except TableError as error:
        sentence = "--pressure {problem}: expected numbers, as 20,14, or a CSV with a column pressure"
        raise around(BadInputError, sentence, error) from None
    except CodingError as error:
        raise in_options(error) from None


def press_of(shape: str, x_mm: float, doi_mm: float | None) -> "SectionPress":
    """A press of the section. Raises BadInputError without a depth, ShapeError for no shape."""
    from sim.coding.task import SectionPress
    from sim.contact.shapes import parse_shape

    if doi_mm is None:
        raise BadInputError(
            "{option}: expected {needs} beside it", code="needs_option", option="--shape", needs="--doi-mm"
        )
    return SectionPress(parse_shape(shape), x_mm, doi_mm)


_OPTIONS = {"bounds": "--range"}


def in_options(error: "CodingError") -> BadInputError:
    """The same error, its arguments under the names of the options that they came from."""
    named = {name: _OPTIONS.get(name, f"--{name}") for name, value in error.fields.items() if value == name}
    return BadInputError(error.sentence, code=error.code, **{**error.fields, **named})


PictureOption = Annotated[Path | None, typer.Option(metavar="FILE.svg", help="Draw it there; or a .png.")]


def checked_picture(picture: Path | None) -> None:
    """Raises BadInputError for a name that is no picture's, exists, or has no folder."""
    if picture is None:
        return
    if picture.suffix not in (".svg", ".png"):
        raise BadInputError(
            "--picture {path}: expected a name that ends in .svg or .png", code="no_picture_name", path=picture
        )
    if picture.exists():
        raise BadInputError(
            "{option} {path}: exists already, expected a new file",
            code="exists_already", option="--picture", path=picture,
        )  # fmt: skip
    if not picture.parent.is_dir():
        raise BadInputError(
            "{option} {path}: no such folder {folder}",
            code="no_such_folder", option="--picture", path=picture, folder=picture.parent,
        )  # fmt: skip


def write_picture(plot: "Plot", picture: Path) -> None:
    """As its name says."""
    picture.write_bytes(plot.svg.encode() if picture.suffix == ".svg" else plot.png)
