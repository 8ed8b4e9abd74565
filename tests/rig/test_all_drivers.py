"""Every driver there is, found by walking the packages: docstrings, units in names, documented errors, sources."""

import ast
import importlib
import inspect
import pkgutil
import re
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import rig.devices
from rig.devices import measured
from rig.devices.base import DeadManStage, ForceError, ForceSensor, Stage, StageError
from rig.devices.measured import COLUMNS, DeviceTimes, Spread
from rig.devices.registry import (
    BUILT_IN,
    ForceKind,
    KnownBench,
    NumberedIdentity,
    StageKind,
    find,
    moves_along,
    ramps,
    stage_ports,
)
from rig.errors import RigError
from rig.transport.modbus import ModbusError
from sim.devices.clock import VirtualClock

UNITS = ("_mm", "_mm_s", "_mm_s2", "_s", "_n", "_gwt", "_g", "_steps", "_rpm", "_ms")
# A ratio of two forces has no unit; this one is pulses in each mm.
NO_UNIT = {"scale", "pulses_per_mm"}
QUIET = {"close", "steps_per_mm"}  # send nothing and cannot fail
ALLOWED = (StageError, ForceError, ValueError)


def _modules(package: ModuleType) -> list[ModuleType]:
    there = pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    return [importlib.import_module(info.name) for info in there]


MODULES = [module for module in _modules(rig.devices) if module.__name__ != "rig.devices.stop_key"]
CLASSES = [
    member
    for module in MODULES
    for _, member in inspect.getmembers(module, inspect.isclass)
    if member.__module__ == module.__name__
]
DRIVERS = [kind for kind in CLASSES if hasattr(kind, "connect") and not getattr(kind, "_is_protocol", False)]
PROTOCOLS: list[Any] = [Stage, ForceSensor, DeadManStage]
ids = pytest.mark.parametrize("driver", DRIVERS, ids=lambda driver: driver.__name__)


def _public(driver: type) -> Iterator[tuple[str, Callable[..., Any]]]:
    for name, member in vars(driver).items():
        if not name.startswith("_"):
            yield name, member.fget if isinstance(member, property) else member


def _told(driver: type, name: str) -> str:
    """What is said about a method: by the driver, and by the protocol that it fulfils."""
    protocols = [p for p in PROTOCOLS if name in vars(p)]
    texts = [getattr(vars(driver)[name], "__doc__", None), *(getattr(p, name).__doc__ for p in protocols)]
    return " ".join(text for text in texts if text)


def test_the_walk_finds_every_kind_of_device() -> None:
    assert {driver.__name__ for driver in DRIVERS} == {
        "GrblStage", "LeadshineStage", "LeadshineDrive", "MtSicsForce", "LaumasForce", "TextCellForce",
        "ZaberStage", "ZaberAxis",
        "TwoAxisStage", "StandaStage", "StandaAxis", "TmclStage", "TmclAxis", "NetFtForce",
    }  # fmt: skip
    assert BUILT_IN["stage"] == ("grbl", "leadshine", "zaber", "standa", "tmcl")
    assert BUILT_IN["force"] == ("mtsics", "laumas", "text_cell", "net_ft")


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_modules_say_what_they_are(module: ModuleType) -> None:
    assert module.__doc__
    assert len(module.__doc__.splitlines()[0]) < 120


@ids
def test_a_driver_names_its_source(driver: type) -> None:
    package = inspect.getmodule(driver)
    assert package is not None
    texts = [package.__doc__ or ""]
    texts += [m.__doc__ or "" for m in MODULES if m.__name__.startswith(f"{package.__package__}.")]
    assert any("Source:" in text or "Sources:" in text for text in texts)


@ids
def test_every_public_name_has_a_docstring(driver: type) -> None:
    assert driver.__doc__
    for name, _ in _public(driver):
        assert _told(driver, name), f"{driver.__name__}.{name} has no docstring"


@ids
def test_whatever_touches_the_wire_says_how_it_fails(driver: type) -> None:
    for name, member in _public(driver):
        if (
            name not in QUIET
            and not isinstance(vars(driver)[name], property)
            and "self._" in inspect.getsource(member)
        ):
            assert "Raises" in _told(driver, name), f"{driver.__name__}.{name} does not say what it raises"


@ids
def test_numbers_carry_their_unit_in_the_name(driver: type) -> None:
    for name, member in [("__init__", driver.__init__), *_public(driver)]:
        signature = inspect.signature(member)
        for parameter in signature.parameters.values():
            if re.match(r"(float|float \| None|tuple.*float.*|<class 'float'>)$", str(parameter.annotation)):
                good = parameter.name.endswith(UNITS) or parameter.name in NO_UNIT
                assert good, f"{driver.__name__}.{name}({parameter.name})"
        if isinstance(vars(driver).get(name), property) and signature.return_annotation is float:
            assert name.endswith(UNITS), f"{driver.__name__}.{name}"


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_what_is_raised_is_what_is_documented(module: ModuleType) -> None:
    """Stage and force errors, and ValueError before any byte; nothing of the libraries below gets through."""
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and isinstance(node.exc.func, ast.Name):
            raised = getattr(module, node.exc.func.id, None) or getattr(__builtins__, node.exc.func.id, ValueError)
            if inspect.isclass(raised):
                assert issubclass(raised, ALLOWED), f"{module.__name__}, line {node.lineno}: {node.exc.func.id}"


@pytest.mark.parametrize("root", [StageError, ForceError])
def test_every_error_has_a_meaning(root: type[Exception]) -> None:
    kinds = [root, *root.__subclasses__()]
    assert len(kinds) > 4
    assert all(kind.__doc__ and not kind.__doc__.startswith("Common base class") for kind in kinds)


@pytest.mark.parametrize("root", [StageError, ModbusError])
def test_every_error_has_a_code_of_its_own(root: type[RigError]) -> None:
    """One that a driver raises with plain text is told apart by it."""
    kinds = [root, *(kind for kind in root.__subclasses__() if kind.__module__.startswith("rig."))]
    codes = [kind.default_code for kind in kinds]
    assert RigError.default_code not in codes
    assert len(set(codes)) == len(codes) > 3
    assert all(re.fullmatch(r"[a-z_]+", code) for code in codes)


USUAL_ENTRY = {
    "table": "", "datagrams": False, "page_port": "", "further_ports": (), "serial_keys": (), "axes": "xz",
    "outputs": ("off",), "inputs": (), "ramps": True, "probe": True, "also": 0,
}  # fmt: skip
ENTRIES: dict[str, tuple[dict[str, object], set[str]]] = {
    "grbl": ({"axes": "xyz", "outputs": ("off", "coolant", "spindle"), "inputs": ("door", "hold")},
             {"manual", "firmware"}),
    "leadshine": ({"table": "drives", "outputs": ("off", "drive"), "inputs": tuple(f"di{n}" for n in range(1, 8))},
                  {"manual", "client"}),
    "zaber": ({}, {"manual", "client"}),
    "standa": ({"further_ports": ("x_port",), "serial_keys": ("z.serial", "x.serial")}, {"manual", "client"}),
    "tmcl": ({}, {"manual", "client"}),
    "mtsics": ({}, {"manual"}),
    "laumas": ({}, {"manual", "client"}),
    "text_cell": ({"probe": False}, {"manual"}),
    "net_ft": ({"datagrams": True, "page_port": "http_port", "also": 9}, {"manual", "client"}),
}  # fmt: skip
"""What an entry of the registry says that is not usual, and what its evidence names. None drove a real device yet."""


@pytest.mark.parametrize("name", ENTRIES)
def test_an_entry_of_the_registry_says_what_its_device_can_do(name: str) -> None:
    of = StageKind if name in BUILT_IN["stage"] else ForceKind
    entry, (unusual, evidence) = find(of, name), ENTRIES[name]
    found = {field.name: getattr(entry, field.name) for field in fields(entry) if field.name in USUAL_ENTRY}
    found |= {key: bool(found[key]) for key in ("probe",) if key in found}
    found |= {key: len(found[key]) for key in ("also",) if key in found}
    assert found == {**{key: usual for key, usual in USUAL_ENTRY.items() if key in found}, **unusual}
    assert {one.name for one in fields(entry.evidence) if getattr(entry.evidence, one.name)} == evidence
    module, _, function = entry.twin.partition(":")
    assert callable(getattr(importlib.import_module(module), function))
    assert entry.name == name
    assert all((Path(__file__).parents[2] / test).is_file() for test in entry.tests)
    assert entry.tests


@pytest.mark.parametrize("kind", BUILT_IN["stage"])
def test_what_a_stage_can_do_is_asked_of_its_entry(kind: str) -> None:
    """A stage of two ports names both."""
    stage = KnownBench.model_validate({"stage": {"kind": kind, "port": "/dev/a"}}).stage
    assert ramps(stage)
    assert moves_along(stage) is (kind == "grbl")
    assert stage_ports(stage)[0] == "/dev/a"
    assert len(stage_ports(stage)) == (2 if kind == "standa" else 1)


def test_an_identity_may_have_a_number() -> None:
    named = NumberedIdentity("a controller", 4711)
    assert (named, named.serial) == ("a controller", 4711)


def test_an_entry_that_says_little_claims_nothing() -> None:
    """One of a package: the stage has three axes on its own port, and may not press in one motion."""
    named: Any = {"name": "n", "device": "d", "tests": (), "driver": None}
    bench = KnownBench()
    nothing = {**USUAL_ENTRY, "axes": "xyz", "ramps": False, "probe": None, "also": ()}
    for entry in (StageKind(**named), ForceKind(**named)):
        found = {field.name: getattr(entry, field.name) for field in fields(entry) if field.name in USUAL_ENTRY}
        assert found == {key: value for key, value in nothing.items() if key in found}
        assert (entry.twin, entry.settings, entry.place) == ("", None, "n")
        assert not any(getattr(entry.evidence, one.name) for one in fields(entry.evidence))
    assert StageKind(**named).ports(bench.stage) == (bench.stage.port,)
    assert StageKind(**named).steps_per_mm(bench.stage, "x") == 400.0
    assert ForceKind(**named).max_age_s(bench.force) == 1.0


def test_measured_times_are_read_in_seconds(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A sensor has no stops; a kind that was not measured has no rows."""
    rows = ["force.mtsics,pty,100,20.5,1,2,3,,,,,,,", "stage.grbl,tcp,50,10,1.5,2,3,7,4,5,6,7,8,9",
            "stage.grbl,pty,60,11,1,2,3,8,4,5,6,,,"]  # fmt: skip
    (tmp_path / "measured.csv").write_text("\n".join([",".join(COLUMNS), *rows]) + "\n", encoding="utf-8")
    assert measured.table().is_file()
    monkeypatch.setattr(measured, "table", lambda: tmp_path / "measured.csv")
    read = measured.measured.__wrapped__
    (balance,) = read("force", "mtsics")
    assert balance == DeviceTimes("pty", 100, 20.5, Spread(0.001, 0.002, 0.003))
    assert read("stage", "grbl") == (
        DeviceTimes("tcp", 50, 10.0, Spread(0.0015, 0.002, 0.003), 7, Spread(0.004, 0.005, 0.006),
                    Spread(0.007, 0.008, 0.009)),
        DeviceTimes("pty", 60, 11.0, Spread(0.001, 0.002, 0.003), 8, Spread(0.004, 0.005, 0.006), None),
    )  # fmt: skip
    assert read("stage", "mtsics") == ()


@pytest.mark.parametrize("kind", BUILT_IN["force"])
def test_a_sensor_is_as_it_is_configured(kind: str, scripted: Callable[..., Any], clock: VirtualClock) -> None:
    """Its period and its step, this one in true force: 1.5 times what it shows."""
    scale = {"value": 1.5, "sd": 0.01, "date": "2026-01-01", "expires": "2027-01-01"}
    force = {"kind": kind, "sample_period_s": 0.2, "resolution_gwt": 0.03}
    settings = KnownBench.model_validate({"force": force, "calibration": {"force_scale": scale}})
    driver = find(ForceKind, kind).driver(lambda port: scripted([]), clock, settings)
    assert (driver.sample_period_s, driver.resolution_gwt) == pytest.approx((0.2, 0.045))
