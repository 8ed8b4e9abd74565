"""Pages and figures of runs, comparisons and speed against error: HTML that fetches nothing, and prints well."""

import logging
import os
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

_OF_THE_USER = ("MPLBACKEND", "MATPLOTLIBRC")
"""Settings of matplotlib for the user's own figures; some of them end its import."""


def _no_help(artist: Any) -> str:
    return ""


def _without_settings(exists: Callable[[Any], bool]) -> Callable[[Any], bool]:
    """Return `exists` for a world in which matplotlib's own file of settings is the only one."""

    def exists_here(path: Any) -> bool:
        there = Path(path) if isinstance(path, str) else None
        of_the_user = there is not None and there.name == "matplotlibrc" and there.parent.name != "mpl-data"
        return not of_the_user and exists(path)

    return exists_here


def _load_library() -> None:
    """Import matplotlib without the user's settings, and without help texts, which take two fifths of the time."""
    kept = {name: os.environ.pop(name) for name in _OF_THE_USER if name in os.environ}
    log = logging.getLogger("matplotlib")
    level = log.level
    log.setLevel(logging.CRITICAL)  # of a cache that cannot be written
    exists = os.path.exists
    os.path.exists = _without_settings(exists)  # type: ignore[assignment]  # in working and home folder
    try:
        from matplotlib import artist as artists

        help_of, artists.kwdoc = artists.kwdoc, _no_help
        try:
            import_module("matplotlib.figure")
        finally:
            artists.kwdoc = help_of
    finally:
        os.path.exists = exists
        log.setLevel(level)
        os.environ.update(kept)


_load_library()
