"""How loops over the points of a contact are compiled: for the machine at hand, when first called, and then kept.

Kept beside these modules as Python keeps its own byte code, or in the cache's folder where that cannot be written;
what cannot be kept at all is compiled in each process. A change of any of the modules begins a folder anew.
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

# --- kept ---
#
# Where this project keeps what took long to make.


def cache_dir() -> Path:
    """Folder of all that is kept: RIG_CACHE_DIR, or the user's cache folder."""
    chosen = os.environ.get("RIG_CACHE_DIR")
    return Path(chosen) if chosen else user_cache_path("indentation-rig")


Loops = TypeVar("Loops", bound=Callable[..., Any])

_config: Any = numba_config
_HERE = Path(__file__).parent
_ALSO = ("lcp.py", "newton.py")
_UNUSED_S = 86_400


def compiled(loops: Loops) -> Loops:
    """The same loops as machine code."""
    before, _config.CACHE_DIR = _config.CACHE_DIR, str(_folder())
    try:
        made = njit(cache=True, error_model="numpy")(loops)
    except (RuntimeError, OSError):  # numba has no place to keep it
        made = njit(error_model="numpy")(loops)
    finally:
        _config.CACHE_DIR = before
    return cast(Loops, made)


@cache
def _folder() -> Path:
    """Where machine code of the modules as they are now is kept; what nobody used for a day is removed."""
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
    """Of all modules with loops: numba looks at changes of the one alone in which it finds a function."""
    found = hashlib.sha256()
    for module in (*sorted(_HERE.glob("*.py")), *(_HERE.parent / name for name in _ALSO)):
        found.update(module.read_bytes())
    return found.hexdigest()[:16]
