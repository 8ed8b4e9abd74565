"""What others rely on, as lists under tests/frozen: commands with their options, and the names of the two doors.

The keys of the configuration with defaults and bounds: tests/data/config_keys.txt. `FROZEN=write pytest -n 0
tests/rig/test_public_interface.py` writes the lists anew: read the difference.
"""

import inspect
import os
import re
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import pytest
import typer
from typer.models import ArgumentInfo, ParameterInfo

from tests.program import functions

FROZEN = Path(__file__).parents[1] / "frozen"
DOORS = ("sim", "rig.protocol")


def _commands() -> Iterator[str]:
    """Each command, and each argument and option: kind, default, range, and the words that its metavar offers."""
    for words, function in functions():
        yield from _options(" ".join(words), function)


def _options(command: str, function: Callable[..., Any]) -> Iterator[str]:
    hints = get_type_hints(function, include_extras=True)
    yield command
    for name, parameter in inspect.signature(function).parameters.items():
        if hints[name] is typer.Context:
            continue
        kind, info = get_args(hints[name])[:2]
        assert isinstance(info, ParameterInfo)
        given = [word for word in (info.default, *(info.param_decls or ())) if isinstance(word, str)]
        usual = f"{name.upper()}" if isinstance(info, ArgumentInfo) else f"--{name.replace('_', '-')}"
        optional = parameter.default is not inspect.Parameter.empty
        told = [f"{command} {', '.join(given) or usual}", _kind(kind)]
        told += [f"default {_value(parameter.default)}" if optional else "required"]
        told += [f"{info.min} … {info.max}"] if (info.min, info.max) != (None, None) else []
        told += [info.metavar] if "|" in (info.metavar or "") else []
        yield "  ".join(map(str, told))


def _kind(kind: Any) -> str:
    if get_origin(kind) is Literal:
        return "|".join(get_args(kind))
    return re.sub(r"pathlib\.", "", kind.__name__ if isinstance(kind, type) and not get_args(kind) else str(kind))


def _value(value: Any) -> str:
    return str(value.value if hasattr(value, "value") else value) or '""'


def _names() -> Iterator[str]:
    for door in DOORS:
        yield from (f"{door} {name}" for name in sorted(import_module(door).__all__))


LISTS: Mapping[str, Callable[[], Iterator[str]]] = {"commands.txt": _commands, "names.txt": _names}


@pytest.mark.parametrize("name", LISTS)
def test_the_public_interface_equals_its_frozen_lists(name: str) -> None:
    path, found = FROZEN / name, list(LISTS[name]())
    if os.environ.get("FROZEN") == "write":
        path.write_text("".join(f"{line}\n" for line in found), encoding="utf-8")
    assert found == path.read_text(encoding="utf-8").splitlines()
    assert all(hasattr(import_module(door), name) for door, name in map(str.split, _names()))
