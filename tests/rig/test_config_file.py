"""Configuration files: every key known, every value checked, and written back as they were read."""

from datetime import date
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rig.plan.config import Config, load_config
from rig.protocol.errors import BadInputError


@pytest.fixture
def toml(tmp_path: Path) -> Path:
    return tmp_path / "rig.toml"


def _complaint(path: Path) -> str:
    with pytest.raises(BadInputError) as caught:
        load_config(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(f"config {path}: ")
    return text.removeprefix(f"config {path}: ")


def test_no_file_means_the_defaults() -> None:
    assert load_config(None) == Config()


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[limits]\nmax_dio_mm = 1.0\n", "limits.max_dio_mm: there is no such key"),
        ("[limit]\nmax_doi_mm = 1.0\n", "limit: there is no such key"),
        ("[finger.mesh]\nspacing = 0.2\n", "finger.mesh.spacing: there is no such key"),
        ('[habits]\nclearance_mm = "high"\n', "habits.clearance_mm = 'high': input should be a valid number"),
        ("[limits]\nmax_force_gwt = nan\n", "limits.max_force_gwt = nan: input should be a finite number"),
        ("[limits]\nsoft_trip_n = inf\n", "limits.soft_trip_n = inf: input should be"),
        ("[limits]\nmax_doi_mm = 3.0\n", "limits.max_doi_mm = 3.0: input should be less than or equal to 2"),
        ("[habits]\nincrement_mm = 0.1\n", "habits.increment_mm = 0.1: input should be less than or equal to 0.05"),
        ('[stage]\nkind = "rack"\n', "stage.kind = 'rack': input should be 'grbl' or 'leadshine'"),
        ('[force]\nkind = "scale"\n', "force.kind = 'scale': input should be 'mtsics' or 'laumas'"),
        ('[stage]\nframing = "ascii"\n', "stage.framing = 'ascii': input should be 'rtu' or 'tcp'"),
        ("[stage.drives.x]\npulses_per_rev = 400\n", "stage.drives.x.device_id: field required"),
        ("[stage.drives.x]\ndevice_id = 2\n", "stage: drives.x and drives.z: expected different device ids"),
        (
            "[stage.drives.x]\ndevice_id = 32\n",
            "stage.drives.x.device_id = 32: input should be less than or equal to 31",
        ),
        ("[force.laumas]\ncount_g = 0\n", "force.laumas.count_g = 0: input should be greater than 0"),
        (
            '[stage]\nkind = "leadshine"\n[sync]\noutput = "coolant"\n',
            "sync.output: expected off or drive with a leads",
        ),
        ('[sync]\noutput = "drive"\n', "sync.output: expected off or coolant or spindle with a grbl stage"),
        (
            '[stage]\nkind = "leadshine"\n[sync]\noutput = "drive"\nregister_address = 343\non_word = 1\n',
            "sync: expected register_address, on_word and off_word, from the manual of the drive",
        ),
        (
            '[sync]\noutput = "drive"\nregister_address = 0x6002\n',
            "sync.register_address = 24578: input should be less than or equal to 4095",
        ),
        ('[stage]\nport = "tcp://10.0.0.7"\n', "stage.port = 'tcp://10.0.0.7': expected tcp://HOST:PORT or the name"),
        ('[force]\nport = ""\n', "force.port = '': expected tcp://HOST:PORT or the name of a serial port"),
        ("[limits]\nx_mm = [-6.0]\n", "limits.x_mm.1"),
        (
            "[limits]\nmax_press_speed_mm_s = 0.8\n",
            "limits.max_press_speed_mm_s = 0.8: expected no less than habits.press_speed_mm_s = 1",
        ),
        (
            "[limits]\nmax_press_speed_mm_s = 0.3\n[habits]\npress_speed_mm_s = 0.2\n",
            "limits.max_press_speed_mm_s = 0.3: expected no less than habits.approach_speed_mm_s = 0.5",
        ),
        ("[virtual]\nz_screw_steps_per_mm = 0\n", "virtual.z_screw_steps_per_mm = 0: input should be greater than 1"),
    ],
)
def test_what_where_and_what_was_expected(toml: Path, text: str, complaint: str) -> None:
    toml.write_text(text, encoding="utf-8")
    assert complaint in _complaint(toml)


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


def test_calibrations_have_a_date_and_an_end(toml: Path) -> None:
    toml.write_text(CALIBRATED, encoding="utf-8")
    calibration = load_config(toml).calibration
    assert [name for name, _ in calibration.measured()] == ["z_steps_per_mm", "force_scale"]
    assert calibration.value("z_steps_per_mm", 400.0) == -401.3
    assert calibration.value("x_steps_per_mm", 400.0) == 400.0
    assert calibration.expired(date(2026, 9, 2)) == []
    assert calibration.expired(date(2026, 9, 3)) == ["force_scale"]
    toml.write_text(load_config(toml).as_toml(), encoding="utf-8")
    assert load_config(toml).calibration == calibration


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (("-401.3", "0"), "value = 0: expected a number other than zero"),
        (("1.004", "-1.0"), "value = -1: expected a positive number"),
        (("2027-03-01", "2025-03-01"), "expires: expected a day not before date"),
        (("expires = 2027-03-01\n", ""), "calibration.z_steps_per_mm.expires"),
    ],
)
def test_a_calibration_that_cannot_be(toml: Path, change: tuple[str, str], complaint: str) -> None:
    toml.write_text(CALIBRATED.replace(*change), encoding="utf-8")
    assert complaint in _complaint(toml)


def test_not_toml(toml: Path) -> None:
    toml.write_text("[limits\nmax_doi_mm 1.0\n", encoding="utf-8")
    assert _complaint(toml).startswith("not valid TOML: ")
    assert "line 1" in _complaint(toml)


def test_a_byte_order_mark_is_no_mistake(toml: Path) -> None:
    """As editors on Windows write it."""
    toml.write_text("[limits]\nmax_doi_mm = 1.0\n", encoding="utf-8-sig")
    assert load_config(toml).limits.max_doi_mm == 1.0


def test_not_text(toml: Path) -> None:
    toml.write_bytes(b"\xff\xfe\x00")
    assert _complaint(toml).startswith("not valid TOML: ")


def test_a_key_given_twice(toml: Path) -> None:
    toml.write_text("[limits]\nmax_doi_mm = 1.0\nmax_doi_mm = 1.2\n", encoding="utf-8")
    assert _complaint(toml).startswith("not valid TOML: ")


def test_no_such_file_and_a_folder(toml: Path) -> None:
    assert _complaint(toml) == "No such file or directory"
    toml.mkdir()
    assert _complaint(toml) == "Is a directory"


def test_a_file_changes_only_what_it_names(toml: Path) -> None:
    toml.write_text("[limits]\nmax_doi_mm = 1.0\n[virtual]\nz_screw_steps_per_mm = 408\n", encoding="utf-8")
    config = load_config(toml)
    assert config.limits.max_doi_mm == 1.0
    assert config.virtual.z_screw_steps_per_mm == 408.0
    assert config.limits.max_force_gwt == Config().limits.max_force_gwt
    assert config.finger == Config().finger


def test_modbus_devices_read_back_the_same(toml: Path) -> None:
    toml.write_text(
        '[stage]\nkind = "leadshine"\nport = "tcp://10.0.0.7:502"\n'
        '[stage.drives.x]\ndevice_id = 5\nport = "/dev/ttyUSB3"\npulses_per_rev_register = 0x0001\n'
        '[force]\nkind = "laumas"\nframing = "rtu"\n'
        "[force.laumas]\nunits_word = 0x010C\n[force.laumas.bits]\nstable = 12\n",
        encoding="utf-8",
    )
    config = load_config(toml)
    assert (config.stage.framing, config.force.framing) == (None, "rtu")
    assert (config.stage.drives.x.device_id, config.stage.drives.z.device_id) == (5, 2)
    assert config.force.laumas.bits.stable == 12
    toml.write_text(config.as_toml(), encoding="utf-8")
    assert load_config(toml) == config


NUMBERS = {
    ("limits", "max_doi_mm"): (0.001, 2.0),
    ("limits", "max_force_gwt"): (0.001, 500.0),
    ("habits", "clearance_mm"): (0.21, 20.0),
    ("frame", "apex_z_mm"): (-40.0, 0.0),
    ("virtual", "finger_z_offset_mm"): (-2.0, 2.0),
    ("virtual", "x_screw_steps_per_mm"): (1.1, 9e5),
}
CHANGES = st.fixed_dictionaries({}, optional={place: st.floats(*ends) for place, ends in NUMBERS.items()})


@given(
    changes=CHANGES,
    port=st.text(st.characters(codec="utf-8"), min_size=1, max_size=20).filter(str.strip),
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_written_reads_back_the_same(toml: Path, changes: dict[tuple[str, str], float], port: str) -> None:
    tables: dict[str, dict[str, object]] = {"stage": {"port": port}, "finger": {"tissue": {"e_bone": 1e9}}}
    for (table, key), value in changes.items():
        tables.setdefault(table, {})[key] = value
    config = Config.model_validate(tables)
    toml.write_text(config.as_toml(), encoding="utf-8")
    assert load_config(toml) == config
