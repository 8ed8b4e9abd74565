"""The interface of devices and the classes of settings as pages, read off their docstrings and fields."""

import inspect
from importlib import import_module
from typing import Any

from names_page import one_name
from pydantic import BaseModel

from rig.units import unit_of_key

_DEVICES = """\
# Device interface

What a driver implements and what the engine calls. [How to add a device](adding_a_device.md).
"""
_SETTINGS = """\
# Settings in Python

The tables of a configuration as classes; [every key with its range](configuration.md).
"""
KINDS = ("DeviceKind", "StageKind", "ForceKind", "KindError", "KnownBench")


def device_interface_page() -> str:
    """Stages, force sensors, their errors, and the entry of a device."""
    names = own_names("rig.devices.base")
    parts = [_DEVICES, "\n## `rig.devices.base`\n", *(one_name("rig.devices.base", name) for name in names)]
    parts += ["\n## `rig.devices.registry`\n", *(one_name("rig.devices.registry", name) for name in KINDS)]
    return "".join(parts)


def settings_page() -> str:
    """Every class of settings with a table of its fields."""
    module = import_module("rig.settings")
    names = [name for name in own_names("rig.settings") if inspect.isclass(getattr(module, name))]
    return _SETTINGS + "".join(one_name("rig.settings", name) + _fields(getattr(module, name)) for name in names)


def own_names(module: str) -> list[str]:
    """Public names that a module defines, in its order."""
    found = vars(import_module(module)).items()
    return [name for name, one in found if not name.startswith("_") and getattr(one, "__module__", "") == module]


def _fields(settings: Any) -> str:
    if not issubclass(settings, BaseModel) or not settings.model_fields:
        return ""
    rows = [
        f"| `{name}` | {unit_of_key(name)} | {(field.description or '').replace('|', chr(92) + '|')} |\n"
        for name, field in settings.model_fields.items()
    ]
    return "".join(["\n| field | unit | what it is |\n|---|---|---|\n", *rows])
