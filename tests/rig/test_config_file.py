"""Configuration files: every key known, every value checked, what cannot be true together, written as read."""

import datetime
import errno
import os
import re
from collections.abc import Callable
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from rig.bench import checks
from rig.devices.registry import KnownBench, checked, moves_along, names, stage_ports
from rig.errors import BadInputError, first_problem
from rig.plan.config import Config, load_config
from rig.printable import either
from rig.settings import Calibration, CalibrationSettings, StageSettings, SyncSettings
from tests.config_keys import TABLE as KEYS
from tests.error_codes import has_code, raises


@pytest.fixture
def toml(tmp_path: Path) -> Path:
    return tmp_path / "rig.toml"


def _refused(path: Path) -> BadInputError:
    """What is wrong with a configuration, in one line about that file."""
    with pytest.raises(BadInputError) as caught:
        load_config(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"config {path}: ")
    return caught.value


VALUE, TABLE = "invalid_value", "invalid_table"


@pytest.mark.parametrize(
    ("text", "code", "fields"),
    [
        ("[limits]\nmax_dio_mm = 1.0\n", "unknown_key", {"key": "limits.max_dio_mm", "near": ["max_doi_mm"]}),
        ("[limit]\nmax_doi_mm = 1.0\n", "unknown_key", {"key": "limit", "near": ["limits"]}),
        ('[habits]\nclearance_mm = "high"\n', VALUE,
         {"key": "habits.clearance_mm", "value": "high", "rule": "must be a number"}),
        ("[limits]\nmax_force_gwt = nan\n", VALUE,
         {"key": "limits.max_force_gwt", "rule": "must be a finite number"}),
        ("[limits]\nmax_doi_mm = 2.5\n", VALUE,
         {"key": "limits.max_doi_mm", "value": 2.5, "rule": "must be less than or equal to 2"}),
        ('[stage]\nkind = "rack"\n', "unknown_kind",
         {"key": "stage.kind", "value": "rack", "either": either([*map(repr, names("stage"))])}),
        ('[force]\nkind = "scale"\n', "unknown_kind",
         {"key": "force.kind", "value": "scale", "either": either([*map(repr, names("force"))])}),
        ("[stage.drives.x]\npulses_per_rev = 400\n", "missing_key", {"key": "stage.drives.x.device_id"}),
        ("[stage.drives.x]\ndevice_id = 2\n", "one_id_for_two", {"key": "stage"}),
        ('[sync]\noutput = "drive"\nregister_address = 0x6002\n', VALUE,
         {"key": "sync.register_address", "value": 24578, "le": 4095}),
        ('[stage]\nport = "tcp://10.0.0.7"\n', "no_port_name", {"key": "stage.port", "value": "tcp://10.0.0.7"}),
        ('[force]\nport = "gateway:502"\n', "no_port_name", {"key": "force.port", "value": "gateway:502"}),
        ('[force]\nport = ""\n', "no_port_name", {"key": "force.port", "value": ""}),
        ("[limits]\nx_mm = [-6.0]\n", "missing_key", {"key": "limits.x_mm", "value": [-6.0]}),
        ("a = = 1", "no_toml", {}),
        ("[limits\nmax_doi_mm 1.0\n", "no_toml", {}),
        ("[limits]\nmax_doi_mm = 1.0\nmax_doi_mm = 1.2\n", "no_toml", {}),
        (b"\xff\xfe\x00", "no_toml", {}),
    ],
)  # fmt: skip
def test_a_faulty_configuration_file_is_refused_with_key_problem_and_expectation(
    toml: Path, text: str | bytes, code: str, fields: dict[str, Any]
) -> None:
    toml.write_bytes(text if isinstance(text, bytes) else text.encode())
    has_code(_refused(toml), code, **fields)


def test_a_missing_configuration_file_and_a_folder_are_refused(toml: Path) -> None:
    has_code(_refused(toml), "unreadable", problem=os.strerror(errno.ENOENT))
    toml.mkdir()
    has_code(_refused(toml), "unreadable", problem=os.strerror(errno.EISDIR))


# --- what two keys must be to each other; the complaint begins with the key ---

LESS = "limits.max_press_speed_mm_s"
CODES = {"sync.output: ": "no_such_output", "sync: ": "incomplete_sync"}


@pytest.mark.parametrize(
    ("tables", "begins"),
    [
        ({"limits": {"x_mm": [-6.0, 6.0]}}, ""),
        ({"limits": {"x_mm": [1.0, 3.0]}}, ""),
        ({"limits": {"x_mm": [2.0, 2.0]}}, "x_mm: "),
        ({"limits": {"x_mm": [6.0, -6.0]}}, "x_mm: "),
        ({"limits": {"along_mm": [0.0, 0.0]}}, ""),
        ({"limits": {"along_mm": [0.1, 4.0]}}, "along_mm: "),
        ({"limits": {"along_mm": [-4.0, -0.1]}}, "along_mm: "),
        ({"limits": {"soft_trip_n": 2.0, "hard_trip_n": 2.0}}, ""),
        ({"limits": {"soft_trip_n": 2.1, "hard_trip_n": 2.0}}, "soft_trip_n: "),
        ({"habits": {"touch_increment_mm": 0.05, "increment_mm": 0.05}}, ""),
        ({"habits": {"touch_increment_mm": 0.03, "increment_mm": 0.02}}, "touch_increment_mm: "),
        ({"limits": {"max_press_speed_mm_s": 1.0}}, ""),  # that of habits.press_speed_mm_s
        ({"limits": {"max_press_speed_mm_s": 0.99}}, f"{LESS} = 0.99: "),
        ({"limits": {"max_press_speed_mm_s": 1.5}, "habits": {"approach_speed_mm_s": 1.6}}, f"{LESS} = 1.5: "),
        ({"limits": {"max_press_speed_mm_s": 0.3}, "habits": {"press_speed_mm_s": 0.2}}, f"{LESS} = 0.3: "),
        ({"limits": {"max_press_speed_mm_s": 1.5}, "habits": {"travel_speed_mm_s": 9.0}}, ""),
        ({"sync": {"output": "drive"}}, "sync.output: "),
        ({"stage": {"kind": "leadshine"}, "sync": {"output": "coolant"}}, "sync.output: "),
        (
            {"stage": {"kind": "leadshine"}, "sync": {"output": "drive", "register_address": 343, "on_word": 1}},
            "sync: ",
        ),
    ],
    ids=str,
)
def test_keys_that_contradict_each_other_are_refused(tables: dict[str, dict[str, object]], begins: str) -> None:
    """Equal is allowed where it says "no more"."""
    if begins:
        with pytest.raises(ValidationError) as caught:
            Config.model_validate(tables)
        problem = first_problem("", caught.value)
        has_code(problem, CODES.get(begins, TABLE))
        assert f": {begins}" in f": {problem}"
    else:
        _takes(tables)


@pytest.mark.parametrize(
    ("series", "lasts"),
    [
        ([], True),
        ([[0.99, 0.5]], True),
        ([[1.0, 1.0]], False),
        ([[0.5, 1.0], [0.5, 2.0]], False),
        ([[0.0, 1.0]], False),
        ([[0.3, 0.0]], False),
        ([[0.3, 1.0], [0.3, -1.0]], False),
    ],
    ids=str,
)
def test_the_prony_series_of_the_virtual_finger_has_shares_below_one_and_positive_times(
    series: list[list[float]], lasts: bool
) -> None:
    """Shares above 0 that sum to less than 1, and time constants above 0."""
    if lasts:
        _takes({"virtual": {"relaxation": series}})
    else:
        with pytest.raises(ValidationError) as caught:
            Config.model_validate({"virtual": {"relaxation": series}})
        has_code(first_problem("", caught.value), "no_prony_series", key="virtual")


@pytest.mark.parametrize(
    ("series", "code", "shown"),
    [
        ([[0.2, 70.0], [0.2, 1400.0]], "tau_too_long", ["70 s", "70 ms", "0.07", "60 s"]),
        ([[0.2, 0.07], [0.2, 1400.0]], "tau_too_long", ["1400 ms", "1.4"]),
        ([[0.2, 0.07], [0.2, 1.4], [0.4, 1.47]], "summary_row", ["sum"]),
        ([[0.2, 0.07], [0.2, 1.4], [0.2, 0.735]], "summary_row", ["mean"]),
        ([[0.2, 0.07], [0.2, 1.4]], "", []),
        ([[0.1, 2.0], [0.1, 60.0]], "", []),
    ],
    ids=str,
)
def test_a_relaxation_in_milliseconds_or_with_a_row_of_totals_is_refused(
    series: list[list[float]], code: str, shown: list[str]
) -> None:
    if not code:
        _takes({"virtual": {"relaxation": series}})
        return
    with pytest.raises(ValidationError) as caught:
        Config.model_validate({"virtual": {"relaxation": series}})
    has_code(first_problem("", caught.value), code, shown=shown)


def _takes(tables: dict[str, dict[str, object]]) -> None:
    config = Config.model_validate(tables)
    for table, keys in config.model_dump(
        mode="json", include={name: set(keys) for name, keys in tables.items()}
    ).items():
        assert keys == tables[table]


# --- calibrations ---

CALIBRATED = """
[calibration.z_steps_per_mm]
value = -401.3
date = 2026-03-01
expires = 2027-03-01

[calibration.force_scale]
value = 1.004
date = "2026-03-02"
expires = "2026-09-02"
"""


def test_a_calibration_expires_after_its_last_day(toml: Path) -> None:
    toml.write_text(CALIBRATED, encoding="utf-8")
    calibration = load_config(toml).calibration
    assert [name for name, _ in calibration.measured()] == ["z_steps_per_mm", "force_scale"]
    assert calibration.value("z_steps_per_mm", 400.0) == -401.3
    assert calibration.value("x_steps_per_mm", 400.0) == 400.0
    assert calibration.expired(date(2026, 9, 2)) == []
    assert calibration.expired(date(2026, 9, 3)) == ["force_scale"]
    toml.write_text(load_config(toml).as_toml(), encoding="utf-8")
    assert load_config(toml).calibration == calibration


# --- files ---


def test_a_configuration_file_with_a_byte_order_mark_is_read(toml: Path) -> None:
    """As editors on Windows write it."""
    toml.write_text("[limits]\nmax_doi_mm = 1.0\n", encoding="utf-8-sig")
    assert load_config(toml).limits.max_doi_mm == 1.0


def test_a_configuration_file_changes_only_the_keys_that_it_names(toml: Path) -> None:
    toml.write_text("[limits]\nmax_doi_mm = 1.0\n[virtual]\nz_screw_steps_per_mm = 408\n", encoding="utf-8")
    config = load_config(toml)
    assert config.limits.max_doi_mm == 1.0
    assert config.virtual.z_screw_steps_per_mm == 408.0
    assert config.limits.max_force_gwt == Config().limits.max_force_gwt
    assert config.finger == Config().finger


NUMBERS = {
    ("limits", "max_doi_mm"): (0.001, 2.0),
    ("limits", "max_force_gwt"): (0.001, 500.0),
    ("habits", "clearance_mm"): (0.21, 20.0),
    ("frame", "apex_z_mm"): (-40.0, 0.0),
    ("virtual", "finger_z_offset_mm"): (-2.0, 2.0),
    ("virtual", "x_screw_steps_per_mm"): (1.1, 9e5),
}
ODD_CHARACTERS = "aZ0 /\\\"'#=[]{},.\t\n\r\x01\x7f\x85\u2028äß中😀"
"""What TOML writes otherwise, or Python takes for the end of a line, among others."""
CHANGES = st.fixed_dictionaries({}, optional={place: st.floats(*ends) for place, ends in NUMBERS.items()})


@given(
    changes=CHANGES,
    port=st.text(ODD_CHARACTERS, min_size=1, max_size=20).filter(str.strip),
)
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_configuration_written_as_toml_reads_back_the_same(
    toml: Path, changes: dict[tuple[str, str], float], port: str
) -> None:
    tables: dict[str, dict[str, object]] = {"stage": {"port": port}, "finger": {"tissue": {"e_bone": 1e9}}}
    for (table, key), value in changes.items():
        tables.setdefault(table, {})[key] = value
    config = Config.model_validate(tables)
    toml.write_text(config.as_toml(), encoding="utf-8")
    assert load_config(toml) == config


# --- a bench ---

MEASURED = tuple(name.split(".")[1] for name in KEYS if re.fullmatch(r"calibration\.\w+\.value", name))


def _first(key: str, make: Callable[[], object], begins: str = "") -> None:
    """Expect one complaint, about that key; one of two keys together begins with what it is about."""
    with pytest.raises(ValidationError) as caught:
        make()
    (problem,) = caught.value.errors()
    assert ".".join(map(str, problem["loc"])) == key
    assert problem["msg"].removeprefix("Value error, ").startswith(begins)


DAY = datetime.date(2026, 5, 1)


def _measured(value: float, **changes: Any) -> dict[str, Any]:
    return {"value": value, "date": DAY, "expires": DAY, **changes}


def test_a_calibration_that_expires_before_the_day_it_was_measured_is_refused() -> None:
    assert Calibration.model_validate(_measured(1.0)).sd == 0.0
    Calibration.model_validate(_measured(1.0, sd=0.0, expires=datetime.date(2027, 5, 1)))
    early = _measured(1.0, expires=datetime.date(2026, 4, 30))
    _first("", lambda: Calibration.model_validate(early), "expires: ")
    _first("sd", lambda: Calibration.model_validate(_measured(1.0, sd=-1e-6)))


@pytest.mark.parametrize("name", MEASURED)
def test_a_calibration_value_that_is_physically_impossible_is_refused(name: str) -> None:
    """Steps run either way, a length has no sign, and a scale is not nothing."""
    kind = name.removeprefix("x_").removeprefix("y_").removeprefix("z_")
    refused = {
        "steps_per_mm": [0.0],
        "backlash_mm": [-400.0, -1.0, -1e-6],
        "compliance_mm_per_n": [-400.0, -1.0, -1e-6],
        "force_scale": [-400.0, -1.0, -1e-6, 0.0],
    }[kind]
    for value in (-400.0, -1.0, -1e-6, 0.0, 1e-6, 0.5, 1.0, 400.0):
        if value not in refused:
            calibration = CalibrationSettings.model_validate({name: _measured(value)})
            assert calibration.value(name, 7.0) == value
            assert [found for found, _ in calibration.measured()] == [name]
        else:
            tables = {name: _measured(value)}
            _first(name, partial(CalibrationSettings.model_validate, tables), f"value = {value:g}: ")


def test_a_calibration_dated_in_the_future_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Tomorrow may be today elsewhere. With a clock that stands in 1970 nothing would ever expire."""
    config = Config.model_validate({"calibration": {"force_scale": _measured(1.0)}})
    days = [datetime.date(1970, 1, 1), datetime.date(2026, 4, 29), datetime.date(2026, 4, 30), DAY]
    assert [config.calibration.to_come(day) for day in days] == [["force_scale"], ["force_scale"], [], []]
    monkeypatch.setattr(checks, "today", lambda: days[1])
    about: dict[str, Any] = {"key": "calibration.force_scale", "date": str(DAY), "today": str(days[1])}
    with raises(BadInputError, "of_a_day_to_come", **about):
        checks.refuse_expired(config)
    (warning,) = checks.expired_calibrations(config)
    assert warning.startswith("calibration.force_scale was measured on 2026-05-01, but today is 2026-04-29")
    monkeypatch.setattr(checks, "today", lambda: DAY)
    checks.refuse_expired(config)


# --- together ---


def _stage(kind: str, x: dict[str, Any], z: dict[str, Any]) -> StageSettings:
    return checked(StageSettings, {"kind": kind, "port": "/dev/a", "drives": {"x": x, "z": z}})


@pytest.mark.parametrize(
    ("x_port", "z_port", "ports"),
    [
        (None, None, ("/dev/a",)), ("/dev/b", None, ("/dev/b", "/dev/a")), (None, "/dev/b", ("/dev/a", "/dev/b")),
        ("/dev/b", "/dev/b", ("/dev/b",)), ("/dev/b", "/dev/c", ("/dev/b", "/dev/c")), ("/dev/a", None, ("/dev/a",)),
        (None, "/dev/a", ("/dev/a",)),
    ],
)  # fmt: skip
@pytest.mark.parametrize("same_id", [True, False])
def test_two_drives_need_different_ids_or_different_ports(
    x_port: str | None, z_port: str | None, ports: tuple[str, ...], same_id: bool
) -> None:
    x, z = {"device_id": 5, "port": x_port}, {"device_id": 5 if same_id else 6, "port": z_port}
    if same_id and len(ports) == 1:
        _first("", lambda: _stage("leadshine", x, z), "drives.x and drives.z: ")
    else:
        stage = _stage("leadshine", x, z)
        assert stage_ports(stage) == ports
        assert moves_along(stage) is False


WORDS = {"register_address": 0x157, "on_word": 0x80, "off_word": 0}


@pytest.mark.parametrize("missing", [None, *WORDS])
def test_the_registers_of_a_drive_output_are_given_all_or_none(missing: str | None) -> None:
    words = {key: value for key, value in WORDS.items() if key != missing}
    assert SyncSettings.model_validate(words).words == (None if missing else (0x157, 0x80, 0))
    bench = {"stage": {"kind": "leadshine"}, "sync": {"output": "drive", **words}}
    if missing:
        _first("", lambda: KnownBench.model_validate(bench), "sync: ")
    else:
        assert KnownBench.model_validate(bench).sync.words == (0x157, 0x80, 0)
