"""Just-in-time compilation of loops for this machine, cached on disk.

The cache is a folder beside this module, like Python's byte code, or in the model cache where that folder is
read-only. Where neither can be written, each process compiles. A change of any module with loops begins a new folder.
"""

import hashlib
import os
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import config as numba_config
from numba import njit
from platformdirs import user_cache_path

# --- cache ---


def cache_dir() -> Path:
    """Return the cache folder: RIG_CACHE_DIR, or the user's cache folder."""
    chosen = os.environ.get("RIG_CACHE_DIR")
    return Path(chosen) if chosen else user_cache_path("indentation-rig")


Loops = TypeVar("Loops", bound=Callable[..., Any])

_config: Any = numba_config
_HERE = Path(__file__).parent
_WITH_LOOPS = ("contact/compiled", "contact/lcp.py", "contact/newton.py", "coding/evidence.py", "fem/dissection.py")
_UNUSED_S = 86_400


def compiled(loops: Loops) -> Loops:
    """Return the loops as machine code."""
    before, _config.CACHE_DIR = _config.CACHE_DIR, str(_folder())
    try:
        made = njit(cache=True, error_model="numpy")(loops)
    except (RuntimeError, OSError):  # numba cannot write its cache
        made = njit(error_model="numpy")(loops)
    finally:
        _config.CACHE_DIR = before
    return cast(Loops, made)


@cache
def _folder() -> Path:
    """Return the folder for machine code; remove folders that nobody used for a day."""
    here = _HERE / "__pycache__"
    parent = here if os.access(here if here.exists() else _HERE, os.W_OK) else cache_dir()
    folder = parent / f"loops-{_digest()}"
    with suppress(OSError):
        os.utime(folder)
    for other in parent.glob("loops-*"):
        if other != folder and time.time() - other.stat().st_mtime > _UNUSED_S:
            shutil.rmtree(other, ignore_errors=True)
    return folder


def _digest() -> str:
    """Hash all modules with loops; numba itself checks only the module that defines a function."""
    found = hashlib.sha256()
    for path in (Path(__file__), *(_HERE / name for name in _WITH_LOOPS)):
        for module in sorted(path.glob("*.py")) if path.is_dir() else [path]:
            found.update(module.read_bytes())
    return found.hexdigest()[:16]
