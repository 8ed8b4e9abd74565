"""Numbers from foreign HDF5 files: only small datasets that are stored in the file itself are read.

A file of a few kilobytes can declare 10¹² numbers, unpack to gigabytes, or name other files in links and virtual
datasets. Its declarations are therefore examined before anything is read.
"""

import math
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError

MOST_VALUES = 10_000_000
MOST_CHUNK_BYTES = 256_000_000
_MOST_LINKS = 16


def numbers_in(file: h5py.File, path: Path, place: str) -> h5py.Dataset | None:
    """Return a list of numbers, or of numbers as text; None if there is none. Raises RecordingError."""
    found = _at(file, path, place)
    if not isinstance(found, h5py.Dataset):
        return None
    if found.is_virtual or found.external:
        raise _refused(path, place, "elsewhere", "its values are in another file; copy them into this one")
    if found.dtype.kind not in "iufS":
        raise RecordingError(
            "{path}, {dataset}: the values have type {dtype}; they must be times as numbers",
            code="no_numbers",
            path=str(path),
            dataset=place,
            dtype=str(found.dtype),
        )
    if len(found.shape) != 1:
        shape = " × ".join(map(str, found.shape))
        raise _refused(path, place, "no_list", "must be a list of numbers, but has the shape {shape}", shape=shape)
    if math.prod(found.chunks or (0,)) * found.dtype.itemsize > MOST_CHUNK_BYTES:
        raise _refused(path, place, "chunk_too_large", "chunks must be at most {most_mb:g} MB",
                       most_mb=MOST_CHUNK_BYTES / 1e6)  # fmt: skip
    return found


def values_of(
    dataset: h5py.Dataset, path: Path, begin: int = 0, end: int | None = None, *, most: int = MOST_VALUES
) -> NDArray[Any]:
    """Return the numbers of a dataset, or those in a range. Raises RecordingError beyond the limit."""
    first, last, _ = slice(begin, end).indices(len(dataset))
    if last - first > most or (last - first) * dataset.dtype.itemsize > MOST_CHUNK_BYTES:
        raise _refused(path, str(dataset.name), "too_many_values", "{values} values; at most {most} are allowed",
                       values=last - first, most=most)  # fmt: skip
    return np.asarray(dataset[first:last])


def _at(file: h5py.File, path: Path, place: str) -> Any:
    """Return what is at a place, or None, without opening other files: HDF5 would follow links by itself."""
    group, names, links = file["/"], [name for name in place.split("/") if name], 0
    while names:
        name = names.pop(0)
        link = group.get(name, getlink=True) if isinstance(group, h5py.Group) else None
        if isinstance(link, h5py.ExternalLink):
            raise _refused(path, place, "elsewhere", "is a link to another file; copy it into this one")
        if isinstance(link, h5py.SoftLink):
            links += 1
            group = file["/"] if link.path.startswith("/") else group
            names = [*(part for part in link.path.split("/") if part not in ("", ".")), *names]
        elif link is None:
            return None
        else:
            group = group[name]
        if links > _MOST_LINKS:
            raise _refused(path, place, "link_cycle", "its links lead in a circle")
    return group


def _refused(path: Path, place: str, code: str, problem: str, **fields: Any) -> RecordingError:
    return RecordingError("{path}, {dataset}: " + problem, code=code, path=str(path), dataset=place, **fields)
