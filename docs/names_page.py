"""The public names of Python's two doors, `sim` and `rig.protocol`, as a page, read off what they say they offer."""

import inspect
from importlib import import_module

_HEAD = """\
# Names in Python

Two doors: `sim` to press fingers from a program ([gallery](gallery/index.rst)), `rig.protocol` to write a
script ([how](your_own_protocol.md)). What stands nowhere here is not public: it may change between versions.
"""
DOORS = ("sim", "rig.protocol")
_OTHERS = {
    "Field": "A parameter's default, bounds and description, as "
    "[pydantic has it](https://docs.pydantic.dev/latest/concepts/fields/).",
    "__version__": "The version of what is installed, as text.",
}
"""What no docstring of ours tells."""


def public(door: str) -> list[str]:
    """What a door offers, in the order of the alphabet, whatever the case."""
    return sorted(import_module(door).__all__, key=str.casefold)


def names_page() -> str:
    """Every public name with its docstring."""
    return _HEAD + "".join(
        f"\n## `{door}`\n" + "".join(one_name(door, name) for name in public(door)) for door in DOORS
    )


def one_name(door: str, name: str) -> str:
    """Return a public name with its docstring."""
    if name in _OTHERS:
        return f"\n`{name}`\n: {_OTHERS[name]}\n"
    found = getattr(import_module(door), name)
    if not callable(found):
        return f"\n`{name}`\n: {', '.join(f'`{one}`' for one in found)}\n"
    kind = "autofunction" if inspect.isroutine(found) else "autoclass"
    if isinstance(found, type) and issubclass(found, Exception):
        kind = "autoexception"
    members = "   :members:\n   :exclude-members: model_config\n" if kind == "autoclass" else ""
    return f"\n```{{eval-rst}}\n.. {kind}:: {door}.{name}\n{members}```\n"
