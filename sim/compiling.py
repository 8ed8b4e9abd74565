"""Just-in-time compilation of loops for this machine, cached in a folder of the user that others cannot change.

numba unpickles what it finds there, which runs any code. Where there is no such folder, each process compiles. A
change of any module with loops begins a new folder.
"""

import hashlib
import logging
import os
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from multiprocessing import parent_process
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import config as numba_config
from numba import njit
from platformdirs import user_cache_path

from rig_shared.accounts import only_ours

# --- cache ---


def cache_dir() -> Path:
    """Return the cache folder: RIG_CACHE_DIR, or the user's cache folder."""
    chosen = os.environ.get("RIG_CACHE_DIR")
    return Path(chosen) if chosen else user_cache_path("indentation-rig")


Loops = TypeVar("Loops", bound=Callable[..., Any])

_config: Any = numba_config
_HERE = Path(__file__).parent
_WITH_LOOPS = (
    "contact/compiled",
    "contact/lcp.py",
    "contact/newton.py",
    "coding/evidence.py",
    "fem/dissection.py",
    "nerve/integrator.py",
)
_UNUSED_S = 86_400
_log = logging.getLogger(__name__)


def compiled(loops: Loops) -> Loops:
    """Return the loops as machine code."""
    folder = _folder()
    made = None if folder is None else _cached(loops, folder)
    return cast(Loops, njit(error_model="numpy")(loops) if made is None else made)


def _cached(loops: Loops, folder: Path) -> Any:
    """Return loops that are cached in a folder, or None where they would be elsewhere."""
    before, _config.CACHE_DIR = _config.CACHE_DIR, str(folder)
    try:
        made = njit(cache=True, error_model="numpy")(loops)
    except (RuntimeError, OSError):  # numba cannot write its cache
        return None
    finally:
        _config.CACHE_DIR = before
    # Where numba cannot write to the folder it chooses another one, which others may be able to change.
    return made if Path(f"{made.stats.cache_path}").is_relative_to(folder) else None


@cache
def _folder() -> Path | None:
    """Return the folder for machine code; remove folders that nobody used for a day."""
    folder = user_cache_path("indentation-rig") / f"loops-{_digest()}"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.utime(folder)
        private = only_ours(folder)
    except OSError as error:
        private, problem = False, error.strerror
    else:
        problem = "can be changed by other accounts"
    if not private:
        if parent_process() is None:
            _log.warning(
                "%s %s, so every process compiles its own machine code, for up to a minute; make it a folder that "
                "only you can write to",
                folder,
                problem,
            )
        return None
    for other in folder.parent.glob("loops-*"):
        with suppress(OSError):
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
