"""Indentation rig controller: protocols, engine, drivers, data and reports."""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any


def door(package: str, homes: Mapping[str, Sequence[str]]) -> Callable[[str], Any]:
    """Return a package's `__getattr__` that imports a name when it is first used.

    A program that only reads runs then loads no driver and no library that it does not use.

    Parameters
    ----------
    package : str
        Name of the package, for errors.
    homes : mapping of str to sequence of str
        Names by the module that defines them.

    Returns
    -------
    callable
        Function from a name to the imported object; it raises AttributeError for a name that is not in `homes`.

    Raises
    ------
    AttributeError
        By the returned function, for an unknown name.
    """
    home = {name: module for module, names in homes.items() for name in names}

    def imported(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(home[name]), name)

    return imported
