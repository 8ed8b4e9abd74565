"""The catalogue: every kind of device, by the name that a configuration says.

The kinds of this program are the folders beside this file: `stage/NAME/NAME_kind.py` holds DEVICE. A package that is
installed adds one by an entry point of the group rig.devices: `"force.NAME" = "its_module:DEVICE"`. A list of names
imports nothing, and the use of a kind imports that one alone.
"""

import pkgutil
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TypeVar

from rig.devices.kinds import ForceKind, Kind, Room, StageKind

GROUP = "rig.devices"
DEFAULTS: dict[Room, str] = {"stage": "grbl", "force": "mtsics"}
KINDS: tuple[type[Kind], ...] = (StageKind, ForceKind)

K = TypeVar("K", bound=Kind)


class KindError(ValueError):
    """There is no such kind, or the package that offers it cannot be used; one line."""


def find(of: type[K], name: str) -> K:
    """The entry of a kind, of stages or of force sensors. Raises KindError."""
    if name in built_in(of.room):
        found: K = import_module(f"rig.devices.{of.room}.{name}.{name}_kind").DEVICE
        return found
    offers = _offered().get(f"{of.room}.{name}", ())
    if not offers:
        raise KindError(f"input should be {_either([repr(known) for known in names(of.room)])}")
    if len(offers) > 1:
        both = " and ".join(map(package, offers))
        raise KindError(f"offered by {both}: expected one of these packages to be uninstalled")
    return _loaded(of, name, offers[0])


def names(room: Room) -> list[str]:
    """The kinds of stage or force sensor that there are, the default first."""
    there = [point.partition(".")[2] for point in _offered() if point.startswith(f"{room}.")]
    return list(dict.fromkeys([*built_in(room), *there]))


@cache
def built_in(room: Room) -> tuple[str, ...]:
    """The kinds of this program, the default first."""
    there = (info.name for info in pkgutil.iter_modules([str(Path(__file__).parent / room)]) if info.ispkg)
    return tuple(sorted(there, key=lambda name: (name != DEFAULTS[room], name)))


def third_party() -> dict[str, str]:
    """What packages add, such as force.NAME: the package that does."""
    return {point: " and ".join(map(package, offers)) for point, offers in _offered().items()}


def problems() -> Iterator[str]:
    """One line for each entry point that cannot be used; this imports them all."""
    for point, who in third_party().items():
        room, _, name = point.partition(".")
        of = next((kind for kind in KINDS if kind.room == room), None)
        if of is None or not name:
            yield f"{who}: entry point {point!r} of {GROUP}: expected stage.NAME or force.NAME"
        elif name in built_in(of.room):
            yield f"{who}: {room}.kind = {name!r} is taken: this program's own is used"
        else:
            try:
                find(of, name)
            except KindError as problem:
                yield f"{room}.kind = {name!r}: {problem}"


@cache
def _offered() -> dict[str, tuple[EntryPoint, ...]]:
    """Entry points by name, in the order of names."""
    found: dict[str, tuple[EntryPoint, ...]] = {}
    for point in sorted(entry_points(group=GROUP), key=lambda point: (point.name, package(point))):
        found[point.name] = (*found.get(point.name, ()), point)
    return found


def package(point: EntryPoint) -> str:
    """Name and version of the package that an entry point is of."""
    return "a package" if point.dist is None else f"{point.dist.name} {point.dist.version}"


def _loaded(of: type[K], name: str, point: EntryPoint) -> K:
    try:
        found = point.load()
    except (Exception, SystemExit) as error:  # whatever a package does when it is imported
        what = " ".join(str(error).split())
        raise KindError(f"{package(point)} cannot be used: {type(error).__name__}: {what}") from error
    if not isinstance(found, of):
        raise KindError(f"{package(point)} cannot be used: {point.value} is no {of.__name__}")
    if found.name != name:
        raise KindError(f"{package(point)} cannot be used: {point.value} is named {found.name!r}")
    return found


def _either(words: list[str]) -> str:
    return f"{', '.join(words[:-1])} or {words[-1]}"
