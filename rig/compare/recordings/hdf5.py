"""Numbers from foreign HDF5 files: only small datasets that are stored in the file itself are read.

A file of a few kilobytes can declare 10¹² numbers, unpack to gigabytes, or name other files in links and virtual
datasets. Its declarations are therefore examined before anything is read.
"""

import math
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.column_units import same_name
from rig.compare.recordings.file_kinds import is_hdf5, kind_of
from rig.compare.recordings.recording import finite_times
from rig_shared.number_text import read_number
from rig_shared.user_files import open_file

MOST_VALUES = 10_000_000
MOST_CHUNK_BYTES = 256_000_000
_MOST_LINKS = 16
_MOST_TEXTS, _MOST_MEMBERS = 100_000, 1_000


class Hdf5File(NamedTuple):
    """An open HDF5 file and its path. All methods raise RecordingError, naming the place in the file."""

    path: Path
    file: h5py.File

    def numbers(self, place: str, *, columns: int = 1) -> h5py.Dataset | None:
        """Return the numbers of a dataset, or its rows of numbers, also from text; None without one.

        A list may be stored as a column (n, 1), as MATLAB does.
        """
        found = self._dataset(place)
        if found is None:
            return None
        if found.dtype.kind not in "iufbS":
            raise self.refused(
                place, "no_numbers", f"the values have type {found.dtype}; they must be times as numbers"
            )
        if found.shape[1:] not in ((), (1,)) if columns == 1 else found.shape[1:] != (columns,):
            shape = " × ".join(map(str, found.shape))
            raise self.refused(place, "no_list", f"must be a list of numbers, but has the shape {shape}")
        if math.prod(found.chunks or (0,)) * found.dtype.itemsize > MOST_CHUNK_BYTES:
            raise self.refused(place, "chunk_too_large", f"chunks must be at most {MOST_CHUNK_BYTES / 1e6:g} MB")
        return found

    def times(
        self, numbers: h5py.Dataset, begin: int = 0, end: int | None = None, name: str = ""
    ) -> NDArray[np.float64]:
        """Return the finite numbers of a dataset, or those in a range of rows. `name`: the dataset, in words."""
        values, name = self.values(numbers, begin, end), name or str(numbers.name).lstrip("/")
        try:
            if values.dtype.kind in "SO":
                each = (one.decode() if isinstance(one, bytes) else str(one) for one in values.ravel().tolist())
                found = np.array([read_number(one) for one in each], dtype=np.float64).reshape(values.shape)
            else:
                found = np.asarray(values if values.dtype.kind in "iuf" else [None], dtype=np.float64)
        except (ValueError, TypeError):
            raise self.refused(
                name, "no_numbers", f"the values have type {values.dtype}; they must be times as numbers"
            ) from None
        finite_times(self.path, name, found.ravel())
        return found

    def values(
        self, dataset: h5py.Dataset, begin: int = 0, end: int | None = None, *, most: int = MOST_VALUES
    ) -> NDArray[Any]:
        """Return the values of a dataset, or those in a range of rows; refuse more than `most`."""
        first, last, _ = slice(begin, end).indices(len(dataset))
        if last - first > most or (last - first) * dataset.dtype.itemsize > MOST_CHUNK_BYTES:
            problem = f"{last - first} values; at most {most} are allowed"
            raise self.refused(str(dataset.name), "too_many_values", problem)
        found = self.part(dataset, slice(first, last))
        return found[:, 0] if found.shape[1:] == (1,) else found

    def part(self, dataset: h5py.Dataset, rows: slice) -> NDArray[Any]:
        """Return some rows of a dataset; refuse values that a missing filter compressed."""
        try:
            return np.asarray(dataset[rows])
        except OSError:
            stored = dataset.id.get_create_plist()
            for number, _, _, name in (stored.get_filter(n) for n in range(stored.get_nfilters())):
                if not h5py.h5z.filter_avail(number):
                    text = name.decode("utf-8", "replace").strip("\0 ") or "unnamed"
                    raise self.refused(
                        str(dataset.name),
                        "unknown_filter",
                        f"its values are compressed with filter {number} ({text}), which is not installed; repack "
                        "the file with h5repack -f GZIP=4 OLD NEW",
                    ) from None
            raise

    def texts(self, place: str) -> list[str] | None:
        """Return the texts of a dataset, or None without one."""
        found = self._dataset(place)
        if found is None or h5py.check_string_dtype(found.dtype) is None or len(found.shape) != 1:
            return None
        if len(found) > _MOST_TEXTS:
            raise self.refused(place, "too_many_values", f"{len(found)} values; at most {_MOST_TEXTS} are allowed")
        return [same_name(_text(one)) for one in found[:]]

    def text(self, place: str) -> str:
        """Return a single text, "" without one."""
        found = self._dataset(place)
        if found is None or found.shape != () or h5py.check_string_dtype(found.dtype) is None:
            return ""
        return _text(found[()])

    def members(self, place: str) -> list[str]:
        """Return the names in a group, without following links to other files; none if there is no group."""
        found = self._at(place, outside=False)
        return [same_name(name) for name in islice(found, _MOST_MEMBERS)] if isinstance(found, h5py.Group) else []

    def dataset(self, place: str) -> h5py.Dataset | None:
        """Return a dataset of any kind, or None if this file has none."""
        found = self._at(place, outside=False)
        return found if isinstance(found, h5py.Dataset) and not (found.is_virtual or found.external) else None

    def rows(self, place: str) -> int | None:
        """Return the number of rows of a dataset, or None if this file has none."""
        found = self.dataset(place)
        return int(found.shape[0]) if found is not None and found.shape else None

    def attribute(self, place: str, name: str) -> float | None:
        """Return a number among the attributes of a dataset, or None."""
        found = self._at(place, outside=False)
        try:
            return None if found is None else float(found.attrs[name])
        except (KeyError, TypeError, ValueError):
            return None

    def refused(self, place: str, code: str, problem: str) -> RecordingError:
        """Return the error for something that cannot be read."""
        return RecordingError(f"{self.path}, {place}: {problem}", code)

    def _dataset(self, place: str) -> h5py.Dataset | None:
        found = self._at(place)
        if not isinstance(found, h5py.Dataset):
            return None
        if found.is_virtual or found.external:
            raise self.refused(place, "elsewhere", "its values are in another file; copy them into this one")
        return found

    def _at(self, place: str, *, outside: bool = True) -> Any:
        """Return what is at a place, or None, without opening other files: HDF5 would follow links by itself.

        A link to another file is refused, or is nothing if not `outside`.
        """
        group, names, links = self.file["/"], [name for name in place.split("/") if name], 0
        while names:
            name = _stored_name(group, names.pop(0))
            link = group.get(name, getlink=True) if isinstance(group, h5py.Group) else None
            if isinstance(link, h5py.ExternalLink):
                if not outside:
                    return None
                raise self.refused(place, "elsewhere", "is a link to another file; copy it into this one")
            if isinstance(link, h5py.SoftLink):
                links += 1
                group = self.file["/"] if link.path.startswith("/") else group
                names = [*(part for part in link.path.split("/") if part not in ("", ".")), *names]
            elif link is None:
                return None
            else:
                group = group[name]
            if links > _MOST_LINKS:
                raise self.refused(place, "link_cycle", "its links lead in a circle")
        return group


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _stored_name(group: Any, name: str) -> str:
    """Return a name as a group has it, which may store its accents in another way."""
    if name.isascii() or not isinstance(group, h5py.Group) or group.get(name, getlink=True) is not None:
        return name
    return next((one for one in islice(group, _MOST_MEMBERS) if same_name(one) == same_name(name)), name)


_LOCKED = ("unable to lock", "resource temporarily unavailable", "already open")
_START_BYTES = 4096


def trouble(path: Path, error: Exception, kind: str) -> RecordingError:
    """Return the error for a file that HDF5 cannot open or read: not HDF5, truncated, in use, or damaged.

    `kind` is what the file should be, e.g. "an NWB file".
    """
    reason = (str(error).strip() or type(error).__name__).splitlines()[0]
    with open_file(path) as file:
        start = file.read(_START_BYTES)
    if not is_hdf5(start):
        found = kind_of(start) or "of an unknown kind"
        return RecordingError(f"{path}: not {kind} (HDF5); it is {found}", "no_hdf5")
    if isinstance(error, BlockingIOError) or any(word in reason.casefold() for word in _LOCKED):
        return RecordingError(
            f"{path}: another program has this file open and has locked it; close it there, or copy the file",
            "locked_hdf5",
        )
    if "truncated" in reason:
        return RecordingError(
            f"{path}: {kind} (HDF5) that is truncated: it ends before its content does; copy or download it again",
            "truncated_hdf5",
        )
    return RecordingError(f"{path}: {kind} (HDF5) that is damaged: {reason}", "damaged_hdf5")
