"""Pages and figures of runs, comparisons and speed against error: HTML that fetches nothing, and prints well."""

import logging
import os
from importlib import import_module
from typing import Any

_OF_THE_USER = ("MPLBACKEND", "MATPLOTLIBRC")
"""Settings of matplotlib for the user's own figures; some of them end its import."""


def _no_help(artist: Any) -> str:
    return ""


def _load_library() -> None:
    """Import matplotlib without the user's settings, and without help texts, which take two fifths of the time."""
    kept = {name: os.environ.pop(name) for name in _OF_THE_USER if name in os.environ}
    log = logging.getLogger("matplotlib")
    level = log.level
    log.setLevel(logging.CRITICAL)  # of a settings file in the working folder
    try:
        from matplotlib import artist as artists

        help_of, artists.kwdoc = artists.kwdoc, _no_help
        try:
            import_module("matplotlib.figure")
        finally:
            artists.kwdoc = help_of
    finally:
        log.setLevel(level)
        os.environ.update(kept)


_load_library()
