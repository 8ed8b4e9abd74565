"""Every driver there is, found by walking the packages: its source, its errors, its twin, its tests."""

import ast
import importlib
import inspect
import pkgutil
import re
from pathlib import Path
from types import ModuleType

import pytest

import rig.devices
from rig.devices.base import ForceError, StageError
from rig.devices.registry import (
    BUILT_IN,
    ForceKind,
    StageKind,
    find,
)
from rig.errors import RigError
from rig.transport.modbus import ModbusError

ALLOWED = (StageError, ForceError, ValueError)


def _modules(package: ModuleType) -> list[ModuleType]:
    there = pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    return [importlib.import_module(info.name) for info in there]


BESIDE = ("rig.devices.stop_key", "rig.devices.sync_line")
"""They have errors of their own: what they drive neither moves nor senses."""
MODULES = [module for module in _modules(rig.devices) if module.__name__ not in BESIDE]
CLASSES = [
    member
    for module in MODULES
    for _, member in inspect.getmembers(module, inspect.isclass)
    if member.__module__ == module.__name__
]
DRIVERS = [kind for kind in CLASSES if hasattr(kind, "connect") and not getattr(kind, "_is_protocol", False)]
ids = pytest.mark.parametrize("driver", DRIVERS, ids=lambda driver: driver.__name__)


def test_the_walk_finds_every_kind_of_device() -> None:
    modules = {f"rig.devices.{name}" for names in BUILT_IN.values() for name in names}
    assert modules <= {driver.__module__ for driver in DRIVERS}


@ids
def test_every_driver_cites_the_manual_of_its_device(driver: type) -> None:
    package = inspect.getmodule(driver)
    assert package is not None
    texts = [package.__doc__ or ""]
    texts += [m.__doc__ or "" for m in MODULES if m.__name__.startswith(f"{package.__package__}.")]
    assert any("Source:" in text or "Sources:" in text for text in texts)


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_a_driver_raises_only_stage_errors_force_errors_and_value_errors(module: ModuleType) -> None:
    """Stage and force errors, and ValueError before any byte; nothing of the libraries below gets through."""
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and isinstance(node.exc.func, ast.Name):
            raised = getattr(module, node.exc.func.id, None) or getattr(__builtins__, node.exc.func.id, ValueError)
            if inspect.isclass(raised):
                assert issubclass(raised, ALLOWED), f"{module.__name__}, line {node.lineno}: {node.exc.func.id}"


@pytest.mark.parametrize("root", [StageError, ModbusError])
def test_every_driver_error_class_has_its_own_code(root: type[RigError]) -> None:
    """One that a driver raises with plain text is told apart by it."""
    kinds = [root, *(kind for kind in root.__subclasses__() if kind.__module__.startswith("rig."))]
    codes = [kind.default_code for kind in kinds]
    assert RigError.default_code not in codes
    assert len(set(codes)) == len(codes) > 3
    assert all(re.fullmatch(r"[a-z_]+", code) for code in codes)


@pytest.mark.parametrize("name", [name for names in BUILT_IN.values() for name in names])
def test_every_device_of_the_registry_has_a_twin_and_tests(name: str) -> None:
    entry = find(StageKind if name in BUILT_IN["stage"] else ForceKind, name)
    module, _, function = entry.twin.partition(":")
    assert callable(getattr(importlib.import_module(module), function))
    assert entry.tests
    assert all((Path(__file__).parents[2] / test).is_file() for test in entry.tests)
