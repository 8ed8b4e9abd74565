"""Pages and figures of runs, comparisons and speed against error: HTML that fetches nothing, and PDF."""

from importlib import import_module
from typing import Any

from matplotlib import artist as artists


def _no_help(artist: Any) -> str:
    return ""


def _load_library() -> None:
    """Import matplotlib without the help texts of its artists, which take two fifths of the import time."""
    help_of, artists.kwdoc = artists.kwdoc, _no_help
    try:
        import_module("matplotlib.figure")
    finally:
        artists.kwdoc = help_of


_load_library()
