"""Condensed models on disk, named by a hash of everything that made them."""

import contextlib
import hashlib
import json
import os
import zipfile
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path

import numpy as np
from filelock import FileLock
from numpy.typing import NDArray
from platformdirs import user_cache_path

Arrays = dict[str, NDArray[np.generic]]

_CODE_ROOMS = ("finger", "fem", "measures", "config.py", "contact/patch.py")


def cache_dir() -> Path:
    """Folder of cached models: RIG_CACHE_DIR, or the user's cache folder."""
    chosen = os.environ.get("RIG_CACHE_DIR")
    return Path(chosen) if chosen else user_cache_path("indentation-rig")


def content_key(parameters: object) -> str:
    """Hash of JSON-serialisable parameters, of the published points and of the code that makes a model."""
    digest = hashlib.sha256(json.dumps(parameters, sort_keys=True).encode())
    root = Path(str(files("sim")))
    sources = [root / "data" / "fingertip_surface_points.csv"]
    for room in _CODE_ROOMS:
        place = root / room
        sources += sorted(place.rglob("*.py")) if place.is_dir() else [place]
    for source in sources:
        digest.update(source.relative_to(root).as_posix().encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:32]


def cached_arrays(key: str, make: Callable[[], Arrays]) -> tuple[Arrays, bool]:
    """The arrays stored under the key, and whether they were on disk; made and stored when absent or damaged.

    Every array's checksum (CRC-32, zip) is verified on reading. One process at a time makes a model.
    """
    folder = cache_dir()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{key}.npz"
    found = _read(path, key)
    if found is not None:
        return found, True
    with FileLock(folder / f"{key}.lock"):
        found = _read(path, key)  # another process may have just made it
        if found is not None:
            return found, True
        made = make()
        with _replacing(path) as partial, partial.open("wb") as stream:
            np.savez(stream, key=np.array(key), **made)  # type: ignore[arg-type]
    return made, False


def _read(path: Path, key: str) -> Arrays | None:
    """The stored arrays, or None when there are none or they are not to be trusted."""
    try:
        with np.load(path) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    return arrays if str(arrays.pop("key", "")) == key else None


@contextlib.contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """A path to write to that replaces `path` only when the writing ended well."""
    partial = path.with_suffix(f".{os.getpid()}.part")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
