"""Files that shapes name (`profile:mine.csv`): a run has its own copies, and all about it is read from them."""

import hashlib
from pathlib import Path

from rig.data.folder import SHAPE_COPY, replace_bytes
from sim.contact import shapes


def named_file(indentor: str) -> str | None:
    """The file that an indentor's name names, as the script wrote it."""
    return shapes.named_file(indentor) if isinstance(indentor, str) else None


def copy_name(file: str) -> str:
    """What a file is called in a run folder: told from another one of the same name elsewhere."""
    return f"{SHAPE_COPY}{hashlib.sha256(file.encode()).hexdigest()[:8]}_{Path(file).name}"


def from_copy(folder: Path, indentor: str) -> str:
    """The same shape, read from the run's own copy where there is one; runs of earlier versions have none."""
    file = named_file(indentor)
    if file is None or not (folder / copy_name(file)).is_file():
        return indentor
    return shapes.with_file(indentor, str(folder / copy_name(file)))


def kept_in(folder: Path, indentor: str) -> str:
    """The same, copying a file that the run meets for the first time. Raises OSError."""
    file = named_file(indentor)
    if file is not None and Path(file).is_file() and not (folder / copy_name(file)).is_file():
        replace_bytes(folder / copy_name(file), Path(file).read_bytes())
    return from_copy(folder, indentor)
