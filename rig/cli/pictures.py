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
