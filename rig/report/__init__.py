"""Pages and figures of runs, comparisons and speed against error: HTML that fetches nothing, and PDF."""

from importlib import import_module
from typing import Any

from matplotlib import artist as artists


def _no_help(artist: Any) -> str:
    return ""


def _load_library() -> None:
    """matplotlib without the help texts of its artists: to make them takes two fifths of the time that it takes."""
    help_of, artists.kwdoc = artists.kwdoc, _no_help
    try:
        import_module("matplotlib.figure")
    finally:
        artists.kwdoc = help_of


_load_library()
