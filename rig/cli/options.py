"""Options that several commands share, with their checks."""

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.errors import BadInputError
from rig_shared.number_text import read_number

if TYPE_CHECKING:
    from rig.report.plot import Plot


ProtocolArgument = Annotated[str, typer.Argument(help="Path of a protocol, or the name of a shipped one.")]
MoreArgument = Annotated[list[str] | None, typer.Argument(metavar="K=V", help="Protocol parameters, KEY=VALUE.")]
RunArgument = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of the run.")]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="K=V", help="Protocol parameter, KEY=VALUE. May be repeated.")
]
OutOption = Annotated[Path, typer.Option("--out", metavar="DIR", help="Parent folder of the run folder.")]
SubjectOption = Annotated[str | None, typer.Option(metavar="CODE", help="Pseudonym of the subject, e.g. S07.")]
FingerConfigOption = Annotated[
    Path | None, typer.Option("--config", metavar="TOML", help="Rig and finger configuration. Default: built-in.")
]
FingertipOption = Annotated[
    Path | None, typer.Option("--config", metavar="TOML", help="Finger configuration. Default: built-in values.")
]
FingerFileOption = Annotated[
    Path | None,
    typer.Option("--finger", metavar="TOML", help="Finger file from rig identify. Default: the configured finger."),
]
ForceFingerOption = Annotated[
    bool, typer.Option("--accept-flagged", help="Use a finger file that rig identify flagged.")
]
_OPERATOR = "Operator"
MountedOption = Annotated[
    str | None,
    typer.Option(
        metavar="SHAPE",
        help="Indentor that is already mounted, e.g. bar:3.0. Default: the program asks for each one.",
        rich_help_panel=_OPERATOR,
    ),
]
ConfigOption = Annotated[Path, typer.Option("--config", metavar="TOML", help="Configuration file of the rig.")]
YesOption = Annotated[
    bool, typer.Option("--yes", help="Begin without asking for confirmation.", rich_help_panel=_OPERATOR)
]
_MOST = 1000  # numbers in a range

ExactOption = Annotated[
    bool, typer.Option("--exact", help="Build a full model of each finger instead of interpolating.")
]
MOST_FRICTION = 10.0


def bounded(option: str, value: float, low: float, high: float) -> float:
    """Return the value; raise BadInputError if it is out of bounds."""
    if not low <= value <= high:
        raise BadInputError(f"{option} {value:g}: must be {low:g} to {high:g}{unit_of(option)}", "outside_range")
    return value


JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]


def numbers(option: str, text: str) -> tuple[float, ...]:
    """Return numbers separated by commas or given as FROM:TO:STEP; raise BadInputError if invalid."""
    found: list[float] = []
    for part in text.split(","):
        try:
            first, *rest = map(read_number, part.split(":"))
            found += _range(first, *rest) if rest else [first]
            if not all(map(math.isfinite, found)):
                raise ValueError
        except (TypeError, ValueError):
            raise BadInputError(
                f"{option} {text!r}: must be numbers separated by commas, or FROM:TO:STEP with at most {_MOST} "
                "values",
                "not_numbers",
            ) from None
    return tuple(found)


def _range(first: float, last: float, step: float) -> list[float]:
    """Return the numbers from the first to the last, which is included if the steps reach it. Raises ValueError."""
    if not (math.isfinite(first) and step > 0 and 0 <= (last - first) / step < _MOST):
        raise ValueError
    return [round(first + k * step, 9) for k in range(int((last - first) / step + 1e-6) + 1)]


_ENDINGS = (".py", ".toml", ".html", ".htm", ".csv", ".xlsx", ".pdf", ".inp", ".json", ".svg", ".png", ".nwb", ".mat")


HTML = (".html", ".htm")
"""Endings of pages."""


def checked_file(option: str, path: Path, *endings: str) -> Path:
    """Return a path that can be written later; raise BadInputError before the work that fills it begins.

    A name with the ending of another kind of file is refused: it may be the user's script or data.
    """
    if endings and path.suffix.casefold() in set(_ENDINGS) - set(endings):
        raise BadInputError(f"{option} {path}: must end in {' or '.join(endings)}", "other_ending")
    if path.is_dir() or not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise BadInputError(
            f"{option} {path}: must be a file in an existing folder that you may write to", "not_writable"
        )
    return path


WithoutForceOption = Annotated[
    bool, typer.Option("--without-force", help="Move without a force sensor. Nothing stops the stage at a finger.")
]

PictureOption = Annotated[
    Path | None, typer.Option(metavar="FILE.svg", help="Plot the result to a new .svg or .png file.")
]


def checked_picture(picture: Path | None) -> None:
    """Raise BadInputError unless the name is that of an image, new, and in an existing folder."""
    if picture is None:
        return
    if picture.suffix not in (".svg", ".png"):
        raise BadInputError(f"--picture {picture}: the name must end in .svg or .png", "no_picture_name")
    if picture.exists():
        raise BadInputError(f"--picture {picture}: the file already exists; choose another name", "exists_already")
    if not picture.parent.is_dir():
        raise BadInputError(
            f"--picture {picture}: the folder {picture.parent} does not exist; create it first", "no_such_folder"
        )
    checked_file("--picture", picture)


def write_picture(plot: "Plot", picture: Path) -> None:
    """Write the figure as SVG or PNG, by the name of the file."""
    picture.write_bytes(plot.svg.encode() if picture.suffix == ".svg" else plot.png)


_UNITS = {"-mm-s": " mm/s", "-mm": " mm", "-gwt": " gwt", "-db": " dB", "-gb": " GB", "-s": " s", "-g": " g"}


def unit_of(option: str) -> str:
    """Return the unit that the name of an option ends with, after a space; empty if it has none."""
    return next((unit for ending, unit in _UNITS.items() if option.endswith(ending)), "")
