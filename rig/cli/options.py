"""Options that several commands share, with their checks."""

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.errors import BadInputError
from rig_shared.number_text import read_number

if TYPE_CHECKING:
    from rig.report.plot import Plot


def option(
    what: str,
    metavar: str | None = None,
    panel: str | None = None,
    *,
    name: str | None = None,
    within: tuple[float, float] | None = None,
    **settings: Any,
) -> Any:
    """Return an option with its help, the name of its value there, and the panel of the help that lists it.

    name: name on the command line, if it is not that of the field. within: lowest and highest value, for which
    `{within}` stands in the help; `refuse` of the request checks them. settings: of typer.
    """
    low, high = within or (0.0, 0.0)
    shown = what.replace("{within}", f"{low:g} to {high:g}")
    found: Any = typer.Option(*filter(None, [name]), help=shown, metavar=metavar, rich_help_panel=panel, **settings)
    found.within = within
    return found


ProtocolArgument = Annotated[str, typer.Argument(help="Path of a protocol, or the name of a shipped one.")]
MoreArgument = Annotated[list[str] | None, typer.Argument(metavar="K=V", help="Protocol parameters, KEY=VALUE.")]
RunArgument = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of the run.")]
SetOption = Annotated[
    list[str] | None, option("Protocol parameter, KEY=VALUE. May be repeated.", "K=V", name="--set")
]
OutOption = Annotated[Path, option("Parent folder of the run folder.", "DIR", name="--out")]
SubjectOption = Annotated[str | None, option("Pseudonym of the subject, e.g. S07.", "CODE")]
FingerConfigOption = Annotated[
    Path | None, option("Rig and finger configuration. Default: built-in.", "TOML", name="--config")
]
FingertipOption = Annotated[
    Path | None, option("Finger configuration. Default: built-in values.", "TOML", name="--config")
]
FingerFileOption = Annotated[
    Path | None, option("Finger file from rig identify. Default: the configured finger.", "TOML", name="--finger")
]
ForceFingerOption = Annotated[bool, option("Use a finger file that rig identify flagged.", name="--accept-flagged")]
_OPERATOR = "Operator"
MountedOption = Annotated[
    str | None,
    option(
        "Indentor that is already mounted, e.g. bar:3.0. Default: the program asks for each one.", "SHAPE", _OPERATOR
    ),
]
ConfigOption = Annotated[Path, option("Configuration file of the rig.", "TOML", name="--config")]
YesOption = Annotated[bool, option("Begin without asking for confirmation.", panel=_OPERATOR, name="--yes")]
_MOST = 1000  # numbers in a range

ExactOption = Annotated[bool, option("Build a full model of each finger instead of interpolating.", name="--exact")]
MOST_FRICTION = 10.0


def bounded(option: str, value: float, low: float, high: float) -> float:
    """Return the value; raise BadInputError if it is out of bounds."""
    if not low <= value <= high:
        raise BadInputError(f"{option} {value:g}: must be {low:g} to {high:g}{unit_of(option)}", "outside_range")
    return value


JsonOption = Annotated[bool, option("Print one JSON object on standard output.", name="--json")]


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
    bool, option("Move without a force sensor. Nothing stops the stage at a finger.", name="--without-force")
]

PictureOption = Annotated[Path | None, option("Plot the result to a new .svg or .png file.", "FILE.svg")]


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
