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
from rig.errors import RigError

GROUP = "rig.devices"
DEFAULTS: dict[Room, str] = {"stage": "grbl", "force": "mtsics"}
KINDS: tuple[type[Kind], ...] = (StageKind, ForceKind)

K = TypeVar("K", bound=Kind)


class KindError(RigError, ValueError):
    """There is no such kind, or the package that offers it cannot be used; one line."""

    default_code = "no_kind"


def find(of: type[K], name: str) -> K:
    """The entry of a kind, of stages or of force sensors. Raises KindError."""
    if name in built_in(of.room):
        found: K = import_module(f"rig.devices.{of.room}.{name}.{name}_kind").DEVICE
        return found
    offers = _offered().get(f"{of.room}.{name}", ())
    if not offers:
        known = names(of.room)
        raise KindError(
            "input should be {either}",
            code="unknown_kind",
            either=_either([repr(one) for one in known]),
            kinds=known,
            kind=name,
        )
    if len(offers) > 1:
        raise KindError(
            "offered by {packages}: expected one of these packages to be uninstalled",
            code="offered_twice",
            packages=" and ".join(map(package, offers)),
        )
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


def problems() -> Iterator[KindError]:
    """One for each entry point that cannot be used; this imports them all."""
    for point, who in third_party().items():
        room, _, name = point.partition(".")
        of = next((kind for kind in KINDS if kind.room == room), None)
        if of is None or not name:
            yield KindError(
                "{package}: entry point {entry!r} of {group}: expected stage.NAME or force.NAME",
                code="bad_entry_point",
                package=who,
                entry=point,
                group=GROUP,
            )
        elif name in built_in(of.room):
            yield KindError(
                "{package}: {room}.kind = {kind!r} is taken: this program's own is used",
                code="name_taken",
                package=who,
                room=room,
                kind=name,
            )
        else:
            try:
                find(of, name)
            except KindError as problem:
                yield KindError(
                    "{room}.kind = {kind!r}: {problem}",
                    code=problem.code,
                    **{**problem.fields, "problem": str(problem), "room": room, "kind": name},
                )


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
        raise KindError(
            "{package} cannot be used: {error}: {what}",
            code="not_imported",
            package=package(point),
            error=type(error).__name__,
            what=what,
        ) from error
    if not isinstance(found, of):
        raise KindError(
            "{package} cannot be used: {entry} is no {expected}",
            code="wrong_type",
            package=package(point),
            entry=point.value,
            expected=of.__name__,
        )
    if found.name != name:
        raise KindError(
            "{package} cannot be used: {entry} is named {found!r}",
            code="wrong_name",
            package=package(point),
            entry=point.value,
            found=found.name,
        )
    return found


def _either(words: list[str]) -> str:
    return f"{', '.join(words[:-1])} or {words[-1]}"
