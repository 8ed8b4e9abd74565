"""Condensed models on disk, named by a hash of everything that made them."""

import contextlib
import hashlib
import io
import json
import logging
import math
import os
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np
from filelock import FileLock
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sim.contact.compiled.compiling import cache_dir as cache_dir
from sim.errors import SimError
from sim.finger.surface import FingertipSurface

Arrays = dict[str, NDArray[np.generic]]
Kind = Literal["model", "node", "columns", "skin", "answers", "sites"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""Condensed models, builds for interpolation, columns of strain, apex lines of skins, simulated responses to runs,
and SED around the source's 24 sites."""

MOST_BYTES = 5e9
"""Largest size of the cache unless RIG_CACHE_GB is set; the least recently read files are deleted first."""

_log = logging.getLogger(__name__)
_SEAL_BYTES = hashlib.sha256().digest_size
_CODE = (
    *("errors.py", "units.py", "tables.py", "config.py", "contact/patch.py", "fem", "finger", "measures"),
    *("models/adjoint.py", "models/condensed.py", "models/finger.py"),
)
"""Folders and modules of `sim` that determine a finger's model."""


class CacheError(SimError, ValueError):
    """Models cannot be stored where they should be."""

    default_code = "bad_cache"


class CacheEntry(NamedTuple):
    """A file of the cache."""

    path: Path
    kind: Kind
    size: int  # bytes
    read_ns: int  # when it was last read, or else made; since 1970


def most_bytes() -> float:
    """How much is kept. Raises CacheError."""
    given = os.environ.get("RIG_CACHE_GB")
    if given is None:
        return MOST_BYTES
    try:
        most = 1e9 * float(given)
    except ValueError:
        most = math.nan
    if not 0 <= most < math.inf:
        raise CacheError(
            "RIG_CACHE_GB = {value!r}: must be the largest size of the cache in GB, 0 or more",
            code="bad_size",
            value=given,
        )
    return most


def entries() -> list[CacheEntry]:
    """What is kept, what was read last first."""
    found = []
    for kind in KINDS:
        for path in cache_dir().glob(f"*.{kind}"):
            with contextlib.suppress(OSError):  # another process may have removed it
                stat = path.stat()
                found.append(CacheEntry(path, kind, stat.st_size, stat.st_mtime_ns))
    return sorted(found, key=lambda entry: -entry.read_ns)


def prune(most: float) -> list[CacheEntry]:
    """Remove what was not read for longest until the rest takes so many bytes or less; what was removed."""
    kept = entries()
    up_to_here = np.cumsum([entry.size for entry in kept])
    return [entry for entry, size in zip(kept, up_to_here, strict=True) if size > most and _removed(entry.path)]


def _removed(path: Path) -> bool:
    """Whether it could be; the lock of its making goes with it."""
    try:
        path.unlink()
    except OSError:  # another process may be at it too
        return False
    with contextlib.suppress(OSError):
        path.with_suffix(".lock").unlink()
    return True


def path_of(key: str, kind: Kind) -> Path:
    """Where it is stored, if it is."""
    return cache_dir() / f"{key}.{kind}"


def content_key(parameters: object) -> str:
    """Hash of JSON-serialisable parameters, of the published points and of the code that makes a model."""
    digest = hashlib.sha256(json.dumps(parameters, sort_keys=True).encode())
    root = Path(str(files("sim")))
    for source in (root / "data" / "fingertip_surface_points.csv", *model_code(root)):
        digest.update(source.relative_to(root).as_posix().encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:32]


def simulator_code() -> str:
    """Hash of all that makes an answer besides the model."""
    code = hashlib.sha256()
    for source in sorted(Path(str(files("sim"))).rglob("*.py")):
        code.update(source.read_bytes())
    return code.hexdigest()


def model_code(root: Path) -> list[Path]:
    """The modules below `sim` that make a finger's model."""
    places = [root / code for code in _CODE]
    return [source for place in places for source in (sorted(place.rglob("*.py")) if place.is_dir() else [place])]


def cached_arrays(key: str, make: Callable[[], Arrays], kind: Kind = "model") -> tuple[Arrays, bool]:
    """The arrays stored under the key, and whether they were on disk; made and stored when absent or damaged.

    The kind is the file's suffix. A file is believed only if it is whole: it begins with the SHA-256 of the key
    and of all that follows. One process at a time makes it.
    """
    folder, path = cache_dir(), path_of(key, kind)
    found = _read(path, key)
    if found is not None:
        return found, True
    most = most_bytes()
    with _alone(folder, key):
        found = _read(path, key)  # another process may have just made it
        if found is not None:
            return found, True
        made = make()
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
    """Nobody else makes what the key names meanwhile. Raises CacheError."""
    lock = FileLock(folder / f"{key}.lock")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except OSError as error:
        raise CacheError(
            "cache folder {folder} (RIG_CACHE_DIR): {problem}; choose a folder that you may write to",
            code="bad_folder",
            folder=str(folder),
            problem=error.strerror,
        ) from None
    try:
        yield
    finally:
        lock.release()


def _read(path: Path, key: str) -> Arrays | None:
    """The stored arrays, or None when there are none or they are not to be trusted."""
    try:
        stored = memoryview(path.read_bytes())
    except OSError:
        return None
    seal, content = stored[:_SEAL_BYTES], stored[_SEAL_BYTES:]
    if bytes(seal) != _seal(key, content):
        return None
    with contextlib.suppress(OSError):  # a folder that may only be read
        path.touch()
    with np.load(io.BytesIO(content)) as arrays:
        return {name: arrays[name] for name in arrays.files}


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
    """A path to write to that replaces `path` only when the writing ended well."""
    partial = path.with_suffix(f".{os.getpid()}.part")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


# --- tops ---
#
# Ridge and crest of the skin, which indentors touch first: kept with the models, since to find them takes 0.1 s.

_TOPS = ("ridge", "crest")


def keep_tops(surface: FingertipSurface) -> None:
    """Give a surface its ridge and crest as they are in the cache, or put them there; the same to the last bit."""

    def find() -> Arrays:
        splines = {name: getattr(surface, name) for name in _TOPS}
        return {f"{name}_{part}": getattr(spline, part) for name, spline in splines.items() for part in "cx"}

    found, _ = cached_arrays(content_key(["tops", surface.geometry.model_dump(mode="json")]), find, "skin")
    for name in _TOPS:
        c, x = (np.asarray(found[f"{name}_{part}"]) for part in "cx")
        vars(surface)[name] = CubicSpline.construct_fast(c, x, extrapolate=False)  # where cached_property looks
