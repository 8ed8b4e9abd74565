"""Condensed models on disk, named by a hash of their configuration and code."""

import contextlib
import hashlib
import io
import json
import logging
import math
import os
import zipfile
from collections.abc import Callable, Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from typing import IO, BinaryIO, Literal, NamedTuple, get_args

import numpy as np
from filelock import FileLock
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from rig_shared.number_text import read_number
from rig_shared.user_files import open_file
from sim.announce import taking_long
from sim.compiling import cache_dir as cache_dir
from sim.errors import SimError
from sim.finger.surface import FingertipSurface

Arrays = dict[str, NDArray[np.generic]]
Kind = Literal["model", "node", "columns", "skin", "answers", "sites"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""Condensed models, builds for interpolation, columns of strain, apex lines of skins, simulated responses to runs,
and SED around the source's 24 sites."""

MOST_BYTES = 5e9
"""Largest size of the cache unless RIG_CACHE_GB is set; the least recently read files are deleted first."""

Layout = Mapping[str, tuple[str, str]]
"""Names of arrays, each with the kind of its numbers (f, i) and a letter or number for the length of each axis."""

_LARGEST_BYTES = 2_000_000_000
_log = logging.getLogger(__name__)
_SEAL_BYTES = hashlib.sha256().digest_size
_CODE = (
    *(
        "announce.py",
        "compiling.py",
        "errors.py",
        "units.py",
        "tables.py",
        "config.py",
        "contact/patch.py",
        "fem",
        "finger",
        "measures",
    ),
    *("models/adjoint.py", "models/condensed.py", "models/finger_3d.py"),
)
"""Folders and modules of `sim` that determine a finger's model; what they share with `rig` is in `rig_shared`."""


class CacheError(SimError, ValueError):
    """Error of a cache that cannot be written or has a wrong size."""

    default_code = "bad_cache"


class CacheEntry(NamedTuple):
    """File of the cache."""

    path: Path
    kind: Kind
    size: int  # bytes
    read_ns: int  # last time it was read or made, ns since 1970


def most_bytes() -> float:
    """Return the largest size of the cache in bytes. Raises CacheError."""
    setting = os.environ.get("RIG_CACHE_GB")
    if setting is None:
        return MOST_BYTES
    try:
        most = 1e9 * read_number(setting)
    except ValueError:
        most = math.nan
    if not 0 <= most < math.inf:
        raise CacheError(
            f"RIG_CACHE_GB = {setting!r}: must be the largest size of the cache in GB, 0 or more", "bad_size"
        )
    return most


def entries() -> list[CacheEntry]:
    """List the files of the cache, most recently read first."""
    found = []
    for kind in KINDS:
        for path in cache_dir().glob(f"*.{kind}"):
            with contextlib.suppress(OSError):  # another process may have removed it
                stat = path.stat()
                found.append(CacheEntry(path, kind, stat.st_size, stat.st_mtime_ns))
    return sorted(found, key=lambda entry: -entry.read_ns)


def prune(most: float) -> list[CacheEntry]:
    """Delete the least recently read files until the rest fits into `most` bytes; return the deleted entries."""
    listed = entries()
    up_to_here = np.cumsum([entry.size for entry in listed])
    return [entry for entry, size in zip(listed, up_to_here, strict=True) if size > most and _removed(entry.path)]


def _removed(path: Path) -> bool:
    """Delete a file and its lock; return whether that succeeded."""
    try:
        path.unlink()
    except OSError:  # another process may be deleting it too
        return False
    with contextlib.suppress(OSError):
        path.with_suffix(".lock").unlink()
    return True


def path_of(key: str, kind: Kind) -> Path:
    """Return the path of a file in the cache, whether or not it exists."""
    return cache_dir() / f"{key}.{kind}"


def content_key(parameters: object) -> str:
    """Hash JSON-serializable parameters, the published points and the code that makes a model.

    The code is hashed as text, so that a changed comment or docstring builds models anew.
    """
    digest = hashlib.sha256(json.dumps(parameters, sort_keys=True).encode())
    root = Path(str(files("sim")))
    for source in (root / "data" / "fingertip_surface_points.csv", *model_code(root)):
        digest.update(source.relative_to(root.parent).as_posix().encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:32]


def simulator_code() -> str:
    """Hash the text of all modules of `sim`."""
    code = hashlib.sha256()
    for source in sorted(Path(str(files("sim"))).rglob("*.py")):
        code.update(source.read_bytes())
    return code.hexdigest()


def model_code(root: Path) -> list[Path]:
    """Return the modules of `sim`, at `root`, and of `rig_shared` beside it that determine a finger's model."""
    names = ("accounts.py", "errors.py", "number_text.py", "summary_rows.py", "user_files.py")
    shared = [root.parent / "rig_shared" / name for name in names]
    paths = [*shared, *(root / code for code in _CODE)]
    return [source for path in paths for source in (sorted(path.rglob("*.py")) if path.is_dir() else [path])]


def cached_arrays(
    key: str, make: Callable[[], Arrays], kind: Kind = "model", layout: Layout | None = None
) -> tuple[Arrays, bool]:
    """Return the arrays stored under a key, and whether they were on disk; make and store them if not.

    `kind` is the file's suffix. A file counts only if it is whole: it begins with the SHA-256 of the key and of all
    that follows. It must have the arrays of `layout`. One process at a time makes it.
    """
    folder, path = cache_dir(), path_of(key, kind)
    found = _read(path, key, layout)
    if found is not None:
        return found, True
    most = most_bytes()
    with _alone(folder, key):
        found = _read(path, key, layout, True)  # another process may have just made it
        if found is not None:
            return found, True
        with taking_long("building a model, once; later it comes from the cache …"):
            made = make()
        _log.debug("made: %s", kind, extra={"made": True})
        content = _packed(made)
        try:
            with _replacing(path) as partial, partial.open("wb") as stream:
                stream.write(_seal(key, content))
                stream.write(content)
        except OSError as error:  # a full disk does not cost the answer
            _log.warning(
                "cache folder %s (RIG_CACHE_DIR): %s; the result is not stored and will be computed again; free disk "
                "space or choose another folder",
                folder,
                error.strerror or error,
            )
            return made, False
    prune(max(most, _SEAL_BYTES + len(content)))  # what was just made stays
    return made, False


@contextlib.contextmanager
def _alone(folder: Path, key: str) -> Iterator[None]:
    """Lock a key against other processes, where this account may. Raises CacheError."""
    lock = FileLock(folder / f"{key}.lock")
    try:
        folder.mkdir(mode=0o755, parents=True, exist_ok=True)
    except OSError as error:
        raise CacheError(
            f"cache folder {folder} (RIG_CACHE_DIR): {error.strerror}; choose a folder that you may write to",
            "bad_folder",
        ) from None
    try:
        with contextlib.suppress(OSError):  # the folder may only be read, or the lock is another account's
            lock.acquire()
        yield
    finally:
        lock.release()


def _read(path: Path, key: str, layout: Layout | None, report: bool = False) -> Arrays | None:
    """Return the stored arrays, or None if they are missing or damaged."""
    try:
        with open_file(path) as stream:
            arrays = _unsealed(stream, key)
            with contextlib.suppress(OSError):  # a folder that may only be read
                os.utime(stream.fileno() if os.utime in os.supports_fd else path)
        if layout is None or _fits(arrays, layout):
            return arrays
        problem = "does not have the expected arrays"
    except FileNotFoundError:
        return None
    except OSError as error:
        problem = f"cannot be read: {error.strerror}"
    except Exception:  # numpy reads a header as Python text, and text that is none raises anything
        problem = "is damaged"
    if report and path.parent not in _reported:
        _reported.add(path.parent)
        _log.warning(
            "cache folder %s (RIG_CACHE_DIR): %s %s, and is computed again; this may apply to other files there",
            path.parent,
            path.name,
            problem,
        )
    return None


_reported: set[Path] = set()


def _unsealed(stream: BinaryIO, key: str) -> Arrays:
    """Return the arrays of a file. Raises OSError, and any other error for a damaged file."""
    if os.fstat(stream.fileno()).st_size > _LARGEST_BYTES:
        raise ValueError
    stored = memoryview(stream.read())
    seal, content = stored[:_SEAL_BYTES], stored[_SEAL_BYTES:]
    if bytes(seal) != _seal(key, content):
        raise ValueError
    file = io.BytesIO(content)
    with zipfile.ZipFile(file) as archive:
        parts = archive.infolist()
        # Stored parts that together fill no more than the file cannot unpack to more.
        if any(part.compress_type for part in parts) or sum(part.file_size for part in parts) > len(content):
            raise ValueError
        for part in parts:
            with archive.open(part) as member:
                _expect_whole(member, part.file_size)
    file.seek(0)
    with np.load(file, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def _expect_whole(member: IO[bytes], size: int) -> None:
    """Raise ValueError where the header of an array promises other than what follows: numpy would allocate it all."""
    if np.lib.format.read_magic(member) != (1, 0):
        raise ValueError
    shape, _, dtype = np.lib.format.read_array_header_1_0(member)
    if member.tell() + math.prod(shape) * dtype.itemsize != size:
        raise ValueError


def _fits(arrays: Arrays, layout: Layout) -> bool:
    """Return whether arrays have the names, kinds and axes of a layout; equal letters are equal lengths."""
    lengths: dict[str, int] = {}
    for name, (kind, axes) in layout.items():
        if name not in arrays or arrays[name].dtype.kind != kind or arrays[name].ndim != len(axes):
            return False
        for axis, length in zip(axes, arrays[name].shape, strict=True):
            if lengths.setdefault(axis, length) != length or (axis.isdigit() and length != int(axis)):
                return False
    return True


def _packed(arrays: Arrays) -> memoryview:
    stream = io.BytesIO()
    np.savez(stream, **arrays)  # type: ignore[arg-type]
    return stream.getbuffer()


def _seal(key: str, content: memoryview) -> bytes:
    digest = hashlib.sha256(key.encode())
    digest.update(content)
    return digest.digest()


@contextlib.contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path that replaces `path` after a write without errors."""
    partial = path.with_suffix(f".{os.getpid()}.part")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


# --- apex lines ---
#
# Apex lines are cached with the models because computing them takes 0.1 s.

_APEX_LINES = ("ridge", "crest")
_APEX_LAYOUT: Layout = {"ridge_c": ("f", "4r"), "ridge_x": ("f", "R"), "crest_c": ("f", "4c"), "crest_x": ("f", "C")}


def keep_tops(surface: FingertipSurface) -> None:
    """Read a surface's apex lines from the cache, or compute and cache them; both are equal to the last bit."""

    def find() -> Arrays:
        splines = {name: getattr(surface, name) for name in _APEX_LINES}
        return {f"{name}_{part}": getattr(spline, part) for name, spline in splines.items() for part in "cx"}

    key = content_key(["tops", surface.geometry.model_dump(mode="json")])
    found, _ = cached_arrays(key, find, "skin", _APEX_LAYOUT)
    for name in _APEX_LINES:
        c, x = (np.asarray(found[f"{name}_{part}"]) for part in "cx")
        vars(surface)[name] = CubicSpline.construct_fast(c, x, extrapolate=False)  # as cached_property stores them
