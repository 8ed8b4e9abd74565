"""Which locked packages have no wheel for a system: there pip has to build them.

    python -m studies.supply.wheels    # a minute, and the network

Prints one row per package without a wheel, and ends with 1 if `KNOWN` does not name one of them. `make check-wheels`
tests the same.
"""

import shutil
import sys
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from packaging.markers import Marker
from packaging.tags import Tag, compatible_tags, cpython_tags, mac_platforms
from packaging.utils import parse_wheel_filename

from studies.registry import show
from studies.release_check import NotFitError
from studies.supply import lock
from studies.supply.locked import LOCKS, REQUIREMENTS, Pin, all_locked, read_lock, required

PYTHONS = ("3.11", "3.12", "3.13", "3.14")
SYSTEMS: Mapping[str, tuple[str, ...]] = {
    "Linux x86-64": (  # glibc 2.35 or newer, which zaber-motion requires
        *(f"manylinux_2_{minor}_x86_64" for minor in range(35, 4, -1)),
        *("manylinux2014_x86_64", "manylinux1_x86_64", "linux_x86_64"),
    ),
    "Windows x86-64": ("win_amd64",),
    "macOS arm64": tuple(mac_platforms((14, 0), "arm64")),
    "macOS x86-64": tuple(mac_platforms((14, 0), "x86_64")),
}
_MARKERS: Mapping[str, Mapping[str, str]] = {
    "Linux x86-64": {"sys_platform": "linux", "platform_system": "Linux", "platform_machine": "x86_64"},
    "Windows x86-64": {"sys_platform": "win32", "platform_system": "Windows", "platform_machine": "AMD64"},
    "macOS arm64": {"sys_platform": "darwin", "platform_system": "Darwin", "platform_machine": "arm64"},
    "macOS x86-64": {"sys_platform": "darwin", "platform_system": "Darwin", "platform_machine": "x86_64"},
}
KNOWN: Mapping[str, tuple[str, ...]] = {
    "nixio": tuple(SYSTEMS),  # pure Python, published as source only
    "numba": ("macOS x86-64",),
    "llvmlite": ("macOS x86-64",),
}
"""Systems for which a package has no wheel at all, and that is accepted."""


class NoIndexError(Exception):
    """The index does not answer, or lacks a locked version."""


def main() -> None:
    """Print the table."""
    try:
        files = published()
    except NoIndexError as error:
        sys.exit(f"check-wheels: {error}")
    found = missing(all_locked().values(), files)
    main_set = required(read_lock(REQUIREMENTS / "setup.txt"))
    show(
        ("package", "installed by", "system", "Python without a wheel"),
        (
            (name, "make setup" if name in main_set else "an extra", system, ", ".join(pythons))
            for (name, system), pythons in found.items()
        ),
    )
    if more := unexpected(found):
        sys.exit(f"check-wheels: no wheel: {', '.join(f'{name} ({system})' for name, system in more)}")


def published() -> dict[str, list[str]]:
    """Return the names of the wheels of every locked version, as the index lists them.

    Raises
    ------
    NoIndexError
        Of what pip or uv printed, the last line.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name in LOCKS:
            shutil.copy(REQUIREMENTS / f"{name}.txt", folder)
        try:
            packages = lock.published(lock.scratch(Path(folder)))
        except NotFitError as error:
            raise NoIndexError(f"the package index does not list the locked versions: {error}") from None
    return {one["name"]: [lock.filename(wheel) for wheel in one.get("wheels", ())] for one in packages}


def missing(pins: Iterable[Pin], files: Mapping[str, Iterable[str]]) -> dict[tuple[str, str], list[str]]:
    """Return the versions of Python for which a package has no wheel, by package and system."""
    tags = {name: frozenset[Tag]().union(*(parse_wheel_filename(one)[3] for one in files[name])) for name in files}
    found: dict[tuple[str, str], list[str]] = {}
    for pin in pins:
        for system in SYSTEMS:
            for python in PYTHONS:
                if wanted(pin, system, python) and not tags.get(pin.name, frozenset()) & accepted(system, python):
                    found.setdefault((pin.name, system), []).append(python)
    return found


def wanted(pin: Pin, system: str, python: str) -> bool:
    """Return whether a package is installed there at all."""
    named = {"python_version": python, "python_full_version": f"{python}.9", "os_name": "posix"}
    named |= {"platform_python_implementation": "CPython", "implementation_name": "cpython"}
    if system.startswith("Windows"):
        named["os_name"] = "nt"
    return not pin.marker or Marker(pin.marker).evaluate({**named, **_MARKERS[system]})


def accepted(system: str, python: str) -> frozenset[Tag]:
    """Return the tags of the wheels that pip installs there."""
    version, platforms = tuple(int(part) for part in python.split(".")), SYSTEMS[system]
    interpreter = f"cp{version[0]}{version[1]}"
    return frozenset((*cpython_tags(version, platforms=platforms), *compatible_tags(version, interpreter, platforms)))


def unexpected(found: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return the packages and systems without a wheel that `KNOWN` does not name."""
    return [(name, system) for name, system in found if system not in KNOWN.get(name, ())]


if __name__ == "__main__":
    main()
