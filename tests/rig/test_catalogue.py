"""The catalogue of devices: every entry is whole, and a package that offers a bad one harms nobody else."""

import io
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import tomlkit
from pydantic import ValidationError

from rig.bench.served import ServedBench
from rig.bench.virtual import (
    bench_around,
    refuse_twinless,
    stage_opener,
    virtual_force,
    virtual_stage,
    with_kinds,
    with_stand_ins,
)
from rig.control.stage_alone import NoStageError, stage_alone
from rig.data import RunFolder
from rig.devices import registry
from rig.devices.make_drivers import force_driver, stage_driver
from rig.devices.registry import (
    DeviceKind,
    ForceKind,
    KindError,
    KnownBench,
    StageKind,
    as_kind,
    checked,
    find,
    kind_of,
    moves_along,
    names,
    stage_ports,
)
from rig.errors import BadInputError, first_problem
from rig.plan.config import Config, load_config
from rig.session.rehearse import SpringPlant
from rig.settings import BenchSettings, DrivesSettings, ForceSettings, StageSettings
from rig.transport import LoopbackTransport
from sim.devices.clock import VirtualClock
from sim.devices.line import Load, SerialLine
from tests.device_packages import EXAMPLE, forget, offer
from tests.error_codes import has_code, raises

ROOT = Path(__file__).parents[2]
WORDS = {"register_address": 0x157, "on_word": 0x80, "off_word": 0}
BUILT_IN: list[tuple[type[DeviceKind], str]] = [
    (of, name) for of in registry.KINDS for name in registry.BUILT_IN[of.room]
]
EVERY = [*BUILT_IN, (ForceKind, "line_scale")]
every_kind = pytest.mark.parametrize(("of", "name"), EVERY, ids=lambda it: it if isinstance(it, str) else it.room)

Offer = Callable[..., None]


@pytest.fixture
def offered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Offer]:
    """Offers devices in the words of tests/device_packages.py; forgotten after the test."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    registry._offered.cache_clear()

    def put(name: str, points: dict[str, str], **modules: str) -> None:
        offer(folder, name, points, modules)
        registry._offered.cache_clear()

    yield put
    registry._offered.cache_clear()
    forget("odd_")


@pytest.fixture
def example(offered: Offer, monkeypatch: pytest.MonkeyPatch) -> None:
    """The example package, known as if it were installed."""
    monkeypatch.syspath_prepend(EXAMPLE)
    offered("rig-line-scale", {"force.line_scale": "rig_line_scale.entry:DEVICE"})


def _config(of: type[DeviceKind], name: str, **tables: object) -> Config:
    return Config.model_validate({of.room: {"kind": name}, **tables})


def _project(name: str) -> tuple[Path, Path]:
    """Where an entry's tests lie, and the page that tells of it."""
    inside = name in (name for _, name in BUILT_IN)
    own = next((page for one in (name, f"{name}s") if (page := ROOT / "docs" / f"{one}.md").exists()), None)
    page = own or ROOT / "docs" / "devices.md"
    return (ROOT, page) if inside else (EXAMPLE, EXAMPLE / "README.md")


# --- every entry ---


@every_kind
def test_every_device_kind_has_a_description_settings_tests_and_a_page(
    of: type[DeviceKind], name: str, example: None
) -> None:
    entry = find(of, name)
    project, page = _project(name)
    assert type(entry) is of
    assert entry.name == name in names(of.room)
    assert entry.device
    assert entry.tests
    for path in entry.tests:
        assert "def test_" in (project / path).read_text(encoding="utf-8")
    assert f"`{name}`" in page.read_text(encoding="utf-8") or f'"{name}"' in page.read_text(encoding="utf-8")
    assert not [twin for twin in [entry.twin] if twin.startswith("rig.")]
    assert not entry.table or entry.settings


@every_kind
def test_every_driver_connects_to_its_twin_as_configured(of: type[DeviceKind], name: str, example: None) -> None:
    """The twin is found and answers the driver, both as configured."""
    config, clock = _config(of, name), VirtualClock()
    refuse_twinless(config.stage, config.force)
    line = SerialLine(clock, 115200)
    wire = LoopbackTransport(line, clock, "wire")
    if of is StageKind:
        virtual_stage(clock, line, config)
        opener = stage_opener(config, line, lambda one, name: LoopbackTransport(one, clock, name))
        assert stage_driver(opener, clock, config).connect()
    else:
        virtual_force(clock, line, config, Load(lambda t_s: 0.02))
        force = force_driver(lambda _: wire, clock, config)
        assert force.connect()
        assert force.read().force_n == pytest.approx(0.02, abs=1e-4)


@pytest.mark.parametrize("name", registry.BUILT_IN["stage"])
def test_every_stage_kind_has_the_ports_axes_and_outputs_that_it_declares(name: str) -> None:
    entry, stage = find(StageKind, name), checked(StageSettings, {"kind": name, "port": "/dev/a"})
    assert stage_ports(stage) == entry.ports(stage)
    assert stage_ports(stage)[0] == "/dev/a"
    assert len(set(stage_ports(stage))) == 1 + len(entry.further_ports)
    assert moves_along(stage) is (entry.axes == "xyz")
    assert entry.outputs[0] == "off"
    for output in entry.outputs:
        assert _config(StageKind, name, sync={"output": output, **WORDS}).sync.output == output


# --- a package's own kind ---


def test_the_settings_table_of_a_packaged_device_is_read_from_and_written_to_the_configuration(
    example: None, tmp_path: Path
) -> None:
    toml = tmp_path / "rig.toml"
    toml.write_text('[force]\nkind = "line_scale"\nbaud = 4800\n[force.line_scale]\naddress = 7\n', encoding="utf-8")
    config = load_config(toml)
    assert config.model_dump()["force"]["line_scale"] == {"address": 7}
    toml.write_text(config.as_toml(), encoding="utf-8")
    assert load_config(toml) == config
    other = as_kind(ForceSettings, config.force, "mtsics")
    assert (other.kind, other.baud, hasattr(other, "line_scale")) == ("mtsics", 4800, False)
    assert as_kind(ForceSettings, config.force, "line_scale") is config.force
    assert as_kind(ForceSettings, other, "line_scale").model_dump()["line_scale"] == {"address": 1}
    with pytest.raises(TypeError, match="line_scale has no BenchSettings"):
        config.force.own(BenchSettings)  # type: ignore[type-var]


# --- every way to a configuration ---

Tables = dict[str, dict[str, Any]]
MADE = {"stage": StageSettings, "force": ForceSettings}


def _filed(tables: Tables, path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(tomlkit.dumps(tables), encoding="utf-8")
    return path


WAYS: dict[str, Callable[[Tables, Path], KnownBench]] = {
    "a file": lambda tables, folder: load_config(_filed(tables, folder / "rig.toml")),
    "the folder of a run": lambda tables, folder: load_config(_filed(tables, RunFolder(folder / "run").config)),
    "tables": lambda tables, folder: Config.model_validate(tables),
    "tables in JSON": lambda tables, folder: Config.model_validate_json(json.dumps(tables)),
    "keywords": lambda tables, folder: Config(**tables),  # type: ignore[arg-type]
    "a bench alone": lambda tables, folder: KnownBench.model_validate(tables),
    "devices made in code": lambda tables, folder: Config.model_validate(
        {name: MADE[name].model_validate(table) if name in MADE else table for name, table in tables.items()}
    ),
}
"""Every other one is a copy of one of these; `rig stop` and the kinds that `rig serve` is told have a test below."""
each_way = pytest.mark.parametrize("way", WAYS)


@each_way
@pytest.mark.parametrize(
    ("tables", "code", "key"),
    [
        ({"stage": {"kind": "odd"}}, "unknown_kind", "stage.kind"),
        ({"force": {"kind": "odd"}}, "unknown_kind", "force.kind"),
        ({"stage": {"kind": "leadshine"}, "sync": {"output": "coolant"}}, "no_such_output", ""),
        ({"stage": {"kind": "leadshine"}, "sync": {"output": "drive"}}, "incomplete_sync", ""),
        ({"stop": {"kind": "board", "input": "di1"}}, "no_such_input", ""),
        (
            {"force": {"kind": "line_scale", "line_scale": {"address": 100}}},
            "invalid_value",
            "force.line_scale.address",
        ),
        ({"force": {"line_scale": {"address": 7}}}, "invalid_table", "force"),
    ],
)
def test_settings_that_a_device_kind_does_not_have_are_refused_from_every_source(
    way: str, tables: Tables, code: str, key: str, example: None, tmp_path: Path
) -> None:
    if way == "devices made in code" and "line_scale" in tables.get("force", {}):
        code, key = "unknown_key", "line_scale"  # before the configuration is made: no table of a kind can be given
    with pytest.raises((BadInputError, ValidationError)) as caught:
        WAYS[way](tables, tmp_path)
    found = caught.value if isinstance(caught.value, BadInputError) else first_problem("", caught.value)
    has_code(found, code, key=key)


@each_way
def test_settings_of_a_device_kind_are_complete_from_every_source(way: str, example: None, tmp_path: Path) -> None:
    own = {} if way == "devices made in code" else {"line_scale": {"address": 7}}
    made = WAYS[way]({"force": {"kind": "line_scale", **own}, "stage": {"kind": "leadshine"}}, tmp_path)
    for device, table in ((made.force, {"address": 7 if own else 1}), (made.stage, DrivesSettings().model_dump())):
        entry = kind_of(device)
        assert entry.settings
        assert device.own(entry.settings).model_dump() == table


def test_a_device_kind_given_on_the_command_line_or_to_rig_stop_is_checked(example: None, tmp_path: Path) -> None:
    for kinds in ((None, "odd"), ("odd", None)):
        with raises(BadInputError, "unknown_kind", kind="odd"):
            with_kinds(Config(), *kinds)
    assert with_kinds(Config(), None, "line_scale").force.model_dump()["line_scale"] == {"address": 1}
    with raises(NoStageError, "invalid_value", key="stage.kind"):
        stage_alone(_filed({"stage": {"kind": "odd"}}, tmp_path / "rig.toml"))


# --- what cannot be used ---

ENTRY = """
from rig.devices.registry import ForceKind
from rig.settings import Settings

class Table(Settings):
    may: int = 1

DEVICE = ForceKind(name="odd", device="odd", driver=None, settings=Table, tests=(), twin="")
"""


@pytest.mark.parametrize(
    ("place", "text", "code", "fields"),
    [
        ("odd_there:DEVICE", "import no_such_module", "not_imported", {"error": "ModuleNotFoundError"}),
        ("odd_nowhere:DEVICE", "", "not_imported", {"what": "No module named 'odd_nowhere'"}),
        ("odd_there:DEVICE", "raise RuntimeError('two\\nlines')", "not_imported", {"what": "two lines"}),
        ("odd_there:DEVICE", "raise SystemExit(3)", "not_imported", {"error": "SystemExit", "what": "3"}),
        ("odd_there:OTHER", ENTRY, "not_imported", {"error": "AttributeError"}),
        ("odd_there:DEVICE", "DEVICE = 3", "wrong_type", {"expected": "ForceKind"}),
        ("odd_there:DEVICE", ENTRY.replace('"odd", device', '"even", device'), "wrong_name", {"found": "even"}),
    ],
)
def test_a_broken_device_package_is_named_and_other_devices_keep_working(
    offered: Offer, place: str, text: str, code: str, fields: dict[str, Any]
) -> None:
    offered("odd", {"force.odd": place}, odd_there=text)
    with raises(KindError, code, package="odd 1.0", **fields) as caught:
        find(ForceKind, "odd")
    assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match=re.escape(str(caught.value))):
        _config(ForceKind, "odd")
    (problem,) = registry.problems()
    has_code(problem, code, room="force", kind="odd", problem=str(caught.value), **fields)
    for of, name in BUILT_IN:
        assert getattr(_config(of, name), of.room).kind == name


def test_a_device_name_offered_twice_is_reported_and_the_built_in_kind_is_used(offered: Offer) -> None:
    """This program's own kind is used; of two packages none is."""
    offered("odd-one", {"stage.grbl": "odd_there:DEVICE", "force.odd": "odd_there:DEVICE"}, odd_there=ENTRY)
    assert find(StageKind, "grbl").device.startswith("GRBL")
    assert find(ForceKind, "odd").name == "odd"
    offered("odd-two", {"force.odd": "odd_there:DEVICE", "force": "odd_there:DEVICE", "camera.x": "odd_there:DEVICE"})
    with raises(KindError, "offered_twice", packages="odd-one 1.0 and odd-two 1.0"):
        find(ForceKind, "odd")
    camera, nameless, twice, taken = registry.problems()
    has_code(camera, "bad_entry_point", package="odd-two 1.0", entry="camera.x")
    has_code(nameless, "bad_entry_point", package="odd-two 1.0", entry="force")
    has_code(twice, "offered_twice", room="force", kind="odd", packages="odd-one 1.0 and odd-two 1.0")
    has_code(taken, "name_taken", package="odd-one 1.0", room="stage", kind="grbl")
    assert names("stage") == [*registry.BUILT_IN["stage"]]


# --- twins ---


@pytest.mark.parametrize(
    ("twin", "told"),
    [
        ("", "this device has no virtual twin; use one that has, such as force.kind = 'mtsics'"),
        (
            "odd_twin:make",
            "its virtual twin odd_twin:make cannot be loaded: ModuleNotFoundError: No module named 'odd_twin'",
        ),
        ("odd_there:make", "its virtual twin odd_there:make cannot be loaded: AttributeError: "),
    ],
)
def test_a_device_without_a_twin_is_refused_in_one_line(offered: Offer, twin: str, told: str) -> None:
    told = f"force.kind = 'odd': {told}"
    offered("odd", {"force.odd": "odd_there:DEVICE"}, odd_there=ENTRY.replace('twin=""', f"twin={twin!r}"))
    config = _config(ForceKind, "odd", force={"kind": "odd", "resolution_gwt": 0.02})
    with pytest.raises(BadInputError, match=re.escape(told)):
        refuse_twinless(config.stage, config.force)
    with pytest.raises(BadInputError, match=re.escape(told)):
        bench_around(SpringPlant, config, VirtualClock(), io.StringIO())


def test_only_a_device_that_is_served_needs_a_twin(offered: Offer) -> None:
    offered("odd", {"force.odd": "odd_there:DEVICE"}, odd_there=ENTRY)
    config = _config(ForceKind, "odd")
    refuse_twinless(config.stage)
    with pytest.raises(BadInputError, match=r"force\.kind = 'odd': this device has no virtual twin"):
        ServedBench(Config(), stage="grbl", force="odd")
    with pytest.raises(BadInputError, match=r"--force-sensor: kind = 'even': must be"):
        ServedBench(Config(), stage=None, force="even")


def test_a_dry_run_replaces_a_device_without_a_twin_by_the_default_kind(offered: Offer) -> None:
    offered("odd", {"force.odd": "odd_there:DEVICE"}, odd_there=ENTRY)
    config = Config.model_validate({
        "stage": {"kind": "leadshine"}, "force": {"kind": "odd", "baud": 4800}, "sync": {"output": "drive", **WORDS},
    })  # fmt: skip
    stood_in = with_stand_ins(config)
    assert (stood_in.stage, stood_in.sync) == (config.stage, config.sync)
    assert (stood_in.force.kind, stood_in.force.baud) == ("mtsics", 4800)
    assert with_stand_ins(Config()) == Config()
