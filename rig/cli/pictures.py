"""A picture that a command writes: refused before the work begins, or written at its end."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.protocol.errors import BadInputError

if TYPE_CHECKING:
    from rig.report.style import Plot  # matplotlib: only where a picture is wanted

PictureOption = Annotated[Path | None, typer.Option(metavar="FILE.svg", help="Draw it there; or a .png.")]


def checked_picture(picture: Path | None) -> None:
    """Raises BadInputError for a name that is no picture's, exists, or has no folder."""
    if picture is None:
        return
    if picture.suffix not in (".svg", ".png"):
        raise BadInputError(f"--picture {picture}: expected a name that ends in .svg or .png")
    if picture.exists():
        raise BadInputError(f"--picture {picture}: exists already, expected a new file")
    if not picture.parent.is_dir():
        raise BadInputError(f"--picture {picture}: no such folder {picture.parent}")


def write_picture(plot: "Plot", picture: Path) -> None:
    """As its name says."""
    picture.write_bytes(plot.svg.encode() if picture.suffix == ".svg" else plot.png)
