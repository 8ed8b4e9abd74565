"""Indentation rig controller: protocols, engine, drivers, data and reports."""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

from rig import _moved


def door(package: str, homes: Mapping[str, Sequence[str]]) -> Callable[[str], Any]:
    """A package's `__getattr__` that imports a name when it is first used.

    homes: names by the modules that have them. What reads a run, or lists a hundred, waits for no device or library
    that it has no use for.
    """
    home = {name: module for module, names in homes.items() for name in names}

    def imported(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(home[name]), name)

    return imported


_moved.answer()
