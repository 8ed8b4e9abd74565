"""What a bench is where nothing is said, what each number may be, and what cannot be true together."""

import datetime
from typing import Any

import pytest
from pydantic import BaseModel, ValidationError

from rig.devices import bench_settings as room
from rig.devices.bench_settings import BenchSettings, Calibration, DriveSettings, StageSettings, SyncSettings

DRIVE = {
    "port": None, "pulses_per_rev": 400, "pulses_per_rev_register": 1, "ramp_ms": 333, "ramp_rpm": 1000.0,
    "homing_mode": 1, "homing_high_rpm": 300, "homing_low_rpm": 25, "homing_ramp_ms": 333, "jog_rpm_register": 0x1E1,
}  # fmt: skip
STAGE = {
    "kind": "grbl", "port": "/dev/ttyUSB0", "baud": 115200, "character": "8N1", "dtr": True,
    "travel_mm": (60.0, 30.0, 40.0), "resolution_mm": 0.0025,
    "acceleration_mm_s2": 50.0, "framing": None,
    "drives": {"x": {"device_id": 1, **DRIVE}, "z": {"device_id": 2, **DRIVE}},
}  # fmt: skip
BITS = {
    "cell_error": 0, "converter_error": 1, "over_max": 2, "over_full_scale": 3, "gross_out_of_range": 4,
    "net_out_of_range": 5, "gross_negative": 7, "net_negative": 8, "stable": 11,
}  # fmt: skip
LAUMAS = {
    "device_id": 1, "weight": "gross", "count_g": 0.01, "units_word": 0x10C, "signs": "status", "filter_samples": 1,
    "tare_command": 7, "zero_command": 8, "gross_command": 9, "bits": BITS,
}  # fmt: skip
FORCE = {
    "kind": "mtsics", "port": "/dev/ttyUSB1", "baud": 9600, "character": "8N1", "dtr": True, "sample_period_s": 0.05,
    "latency_s": 0.0,
    "resolution_gwt": 0.01, "framing": None, "laumas": LAUMAS,
}  # fmt: skip
SYNC = {"output": "off", "width_s": 0.01, "drive": "z", "register_address": None, "on_word": None, "off_word": None}
FRAME = {"pad_centre_x_mm": -30.0, "pad_y_mm": -15.0, "apex_z_mm": -25.0, "roll_deg": 0.0, "tilt_deg": 0.0}
MEASURED = ("x_steps_per_mm", "y_steps_per_mm", "z_steps_per_mm", "x_backlash_mm", "y_backlash_mm", "z_backlash_mm",
            "force_scale", "compliance_mm_per_n")  # fmt: skip

JUST_ABOVE_0 = 1e-6
# By model and key: the lowest and the highest that may be; None where there is no end.
BOUNDS: dict[str, dict[str, tuple[float, float | None]]] = {
    "DriveSettings": {
        "device_id": (1, 31), "pulses_per_rev": (200, 51200), "pulses_per_rev_register": (0, 0xFFFF),
        "ramp_ms": (1, 10_000), "ramp_rpm": (JUST_ABOVE_0, None), "homing_mode": (0, 0xFFFF),
        "homing_high_rpm": (1, 600), "homing_low_rpm": (1, 100), "homing_ramp_ms": (1, 10_000),
        "jog_rpm_register": (0, 0xFFFF),
    },
    "StageSettings": {
        "baud": (300, 1_000_000), "resolution_mm": (JUST_ABOVE_0, 0.05), "acceleration_mm_s2": (JUST_ABOVE_0, 1e4),
    },
    "StatusBits": dict.fromkeys(BITS, (0, 15)),
    "LaumasSettings": {
        "device_id": (1, 99), "count_g": (JUST_ABOVE_0, 10.0), "units_word": (0, 0xFFFF), "filter_samples": (1, 64),
        "tare_command": (0, 0xFFFF), "zero_command": (0, 0xFFFF), "gross_command": (0, 0xFFFF),
    },
    "ForceSettings": {
        "baud": (300, 1_000_000), "sample_period_s": (0.01, 10.0), "latency_s": (0.0, 2.0),
        "resolution_gwt": (JUST_ABOVE_0, 1.0),
    },
    "SyncSettings": {
        "width_s": (0.001, 1.0), "register_address": (0, 0xFFF), "on_word": (0, 0xFFFF), "off_word": (0, 0xFFFF),
    },
    "FrameSettings": {"roll_deg": (-20.0, 20.0), "tilt_deg": (-20.0, 20.0)},
}  # fmt: skip


def test_a_bench_of_which_nothing_is_said_has_these_numbers() -> None:
    assert BenchSettings().model_dump() == {
        "stage": STAGE, "force": FORCE, "sync": SYNC, "frame": FRAME, "calibration": dict.fromkeys(MEASURED),
    }  # fmt: skip


@pytest.mark.parametrize("name", BOUNDS)
def test_a_number_may_be_as_low_and_as_high_as_this_and_no_more(name: str) -> None:
    assert BenchSettings()
    for key, (lowest, highest) in BOUNDS[name].items():
        step = 1 if isinstance(lowest, int) else 1e-6
        _accepts(name, key, lowest)
        _refuses(name, key, lowest - step)
        _accepts(name, key, 1e9 if highest is None else highest)
        if highest is not None:
            _refuses(name, key, highest + step)


def _made(name: str, key: str, value: float) -> BaseModel:
    needed = {"device_id": 1} if name == "DriveSettings" else {}
    model: type[BaseModel] = getattr(room, name)
    return model.model_validate({**needed, key: value})


def _accepts(name: str, key: str, value: float) -> None:
    assert getattr(_made(name, key, value), key) == value


def _refuses(name: str, key: str, value: float) -> None:
    with pytest.raises(ValidationError, match=f"{name}\n{key}\n"):
        _made(name, key, value)


# What their names say whole; every other key is explained.
PLAIN: dict[str, set[str]] = {
    "Calibration": {"value", "date", "expires"},
    "DriveSettings": {"device_id", "homing_high_rpm", "homing_low_rpm", "homing_ramp_ms"},
    "StageSettings": {"kind", "port", "baud", "character", "travel_mm", "drives"},
    "LaumasSettings": {"device_id", "weight", "tare_command", "zero_command", "gross_command", "bits"},
    "ForceSettings": {"kind", "port", "baud", "character", "sample_period_s", "laumas"},
    "SyncSettings": {"width_s", "on_word", "off_word"},
    "FrameSettings": set(),
}


def test_a_key_whose_name_does_not_say_it_all_is_explained() -> None:
    assert BenchSettings()
    for name, plain in PLAIN.items():
        model: type[BaseModel] = getattr(room, name)
        assert {key for key, field in model.model_fields.items() if field.description is None} == plain


def test_a_drive_has_to_be_given_its_device_id() -> None:
    with pytest.raises(ValidationError, match="device_id"):
        DriveSettings.model_validate({})


def test_a_travel_is_three_positive_lengths() -> None:
    for travel_mm in [(0.0, 1.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, 0.0), (1.0, 1.0)]:
        with pytest.raises(ValidationError, match="travel_mm"):
            StageSettings.model_validate({"travel_mm": travel_mm})


# --- calibrations ---

DAY = datetime.date(2026, 5, 1)


def _measured(value: float, **changes: Any) -> dict[str, Any]:
    return {"value": value, "date": DAY, "expires": DAY, **changes}


def test_a_calibration_may_expire_the_day_it_was_measured_and_not_before() -> None:
    assert Calibration.model_validate(_measured(1.0)).sd == 0.0
    Calibration.model_validate(_measured(1.0, sd=0.0, expires=datetime.date(2027, 5, 1)))
    with pytest.raises(ValidationError, match="expires: expected a day not before date"):
        Calibration.model_validate(_measured(1.0, expires=datetime.date(2026, 4, 30)))
    with pytest.raises(ValidationError, match="sd"):
        Calibration.model_validate(_measured(1.0, sd=-1e-6))


@pytest.mark.parametrize("name", MEASURED)
def test_a_measured_number_is_one_that_can_be(name: str) -> None:
    """Steps run either way, a length has no sign, and a scale is not nothing."""
    kind = name.removeprefix("x_").removeprefix("y_").removeprefix("z_")
    refused, expected = {
        "steps_per_mm": ([0.0], "a number other than zero"),
        "backlash_mm": ([-400.0, -1.0, -1e-6], "a number ≥ 0"),
        "compliance_mm_per_n": ([-400.0, -1.0, -1e-6], "a number ≥ 0"),
        "force_scale": ([-400.0, -1.0, -1e-6, 0.0], "a positive number"),
    }[kind]
    for value in (-400.0, -1.0, -1e-6, 0.0, 1e-6, 0.5, 1.0, 400.0):
        if value not in refused:
            calibration = room.CalibrationSettings.model_validate({name: _measured(value)})
            assert calibration.value(name, 7.0) == value
            assert [found for found, _ in calibration.measured()] == [name]
        else:
            with pytest.raises(ValidationError, match=f"{name}\n.*value = {value:g}: expected {expected}"):
                room.CalibrationSettings.model_validate({name: _measured(value)})


@pytest.mark.parametrize("name", MEASURED)
def test_what_was_not_measured_is_what_was_said_instead(name: str) -> None:
    nothing = room.CalibrationSettings()
    assert nothing.value(name, 7.0) == 7.0
    assert list(nothing.measured()) == []
    assert nothing.expired(datetime.date(2999, 1, 1)) == []


def test_a_calibration_may_be_used_on_its_last_day() -> None:
    both = room.CalibrationSettings.model_validate(
        {"force_scale": _measured(1.0), "x_backlash_mm": _measured(0.0, expires=datetime.date(2026, 5, 3))}
    )
    assert [both.expired(datetime.date(2026, 5, day)) for day in (1, 2, 3, 4)] == [
        [], ["force_scale"], ["force_scale"], ["x_backlash_mm", "force_scale"],
    ]  # fmt: skip


# --- together ---


def _stage(kind: str, x: dict[str, Any], z: dict[str, Any]) -> StageSettings:
    return StageSettings.model_validate({"kind": kind, "port": "/dev/a", "drives": {"x": x, "z": z}})


@pytest.mark.parametrize(
    ("x_port", "z_port", "ports"),
    [
        (None, None, ("/dev/a",)), ("/dev/b", None, ("/dev/b", "/dev/a")), (None, "/dev/b", ("/dev/a", "/dev/b")),
        ("/dev/b", "/dev/b", ("/dev/b",)), ("/dev/b", "/dev/c", ("/dev/b", "/dev/c")), ("/dev/a", None, ("/dev/a",)),
        (None, "/dev/a", ("/dev/a",)),
    ],
)  # fmt: skip
@pytest.mark.parametrize("same_id", [True, False])
def test_drives_are_told_apart_by_id_or_by_port(
    x_port: str | None, z_port: str | None, ports: tuple[str, ...], same_id: bool
) -> None:
    x, z = {"device_id": 5, "port": x_port}, {"device_id": 5 if same_id else 6, "port": z_port}
    if same_id and len(ports) == 1:
        with pytest.raises(ValidationError, match="expected different device ids on one port"):
            _stage("leadshine", x, z)
    else:
        stage = _stage("leadshine", x, z)
        assert stage.ports == ports
        assert stage.moves_along is False


def test_a_board_is_on_one_port_and_moves_along_the_finger() -> None:
    stage = _stage("grbl", {"device_id": 1, "port": "/dev/b"}, {"device_id": 2})
    assert stage.ports == ("/dev/a",)
    assert stage.moves_along is True


WORDS = {"register_address": 0x157, "on_word": 0x80, "off_word": 0}


@pytest.mark.parametrize("missing", [None, *WORDS])
def test_the_words_of_an_output_are_all_there_or_none(missing: str | None) -> None:
    words = {key: value for key, value in WORDS.items() if key != missing}
    assert SyncSettings.model_validate(words).words == (None if missing else (0x157, 0x80, 0))
    bench = {"stage": {"kind": "leadshine"}, "sync": {"output": "drive", **words}}
    if missing:
        with pytest.raises(ValidationError, match="expected register_address, on_word and off_word"):
            BenchSettings.model_validate(bench)
    else:
        assert BenchSettings.model_validate(bench).sync.words == (0x157, 0x80, 0)


@pytest.mark.parametrize(
    ("kind", "outputs"), [("grbl", ("off", "coolant", "spindle")), ("leadshine", ("off", "drive"))]
)
@pytest.mark.parametrize("words", [{}, WORDS], ids=["without words", "with words"])
def test_an_output_is_one_that_the_stage_has(kind: str, outputs: tuple[str, ...], words: dict[str, int]) -> None:
    for output in ("off", "coolant", "spindle", "drive"):
        bench = {"stage": {"kind": kind}, "sync": {"output": output, **words}}
        if output not in outputs:
            with pytest.raises(ValidationError, match=f"expected {' or '.join(outputs)} with a {kind} stage"):
                BenchSettings.model_validate(bench)
        elif output != "drive" or words:
            assert BenchSettings.model_validate(bench).sync.output == output
