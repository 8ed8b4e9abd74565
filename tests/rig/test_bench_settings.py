"""Calibrations: their days and their numbers; and what of a bench cannot be true together."""

import datetime
import re
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from pydantic import ValidationError

from rig import settings
from rig.bench import checks
from rig.devices.registry import KnownBench, checked, moves_along, stage_ports
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.settings import Calibration, StageSettings, SyncSettings
from tests.config_keys import TABLE
from tests.error_codes import raises

MEASURED = tuple(name.split(".")[1] for name in TABLE if re.fullmatch(r"calibration\.\w+\.value", name))


def _first(key: str, make: Callable[[], object], begins: str = "") -> None:
    """Expect one complaint, about that key; one of two keys together begins with what it is about."""
    with pytest.raises(ValidationError) as caught:
        make()
    (problem,) = caught.value.errors()
    assert ".".join(map(str, problem["loc"])) == key
    assert problem["msg"].removeprefix("Value error, ").startswith(begins)


# --- calibrations ---

DAY = datetime.date(2026, 5, 1)


def _measured(value: float, **changes: Any) -> dict[str, Any]:
    return {"value": value, "date": DAY, "expires": DAY, **changes}


def test_a_calibration_may_expire_the_day_it_was_measured_and_not_before() -> None:
    assert Calibration.model_validate(_measured(1.0)).sd == 0.0
    Calibration.model_validate(_measured(1.0, sd=0.0, expires=datetime.date(2027, 5, 1)))
    early = _measured(1.0, expires=datetime.date(2026, 4, 30))
    _first("", lambda: Calibration.model_validate(early), "expires: ")
    _first("sd", lambda: Calibration.model_validate(_measured(1.0, sd=-1e-6)))


@pytest.mark.parametrize("name", MEASURED)
def test_a_measured_number_is_one_that_can_be(name: str) -> None:
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
            calibration = settings.CalibrationSettings.model_validate({name: _measured(value)})
            assert calibration.value(name, 7.0) == value
            assert [found for found, _ in calibration.measured()] == [name]
        else:
            tables = {name: _measured(value)}
            _first(name, partial(settings.CalibrationSettings.model_validate, tables), f"value = {value:g}: ")


def test_a_calibration_of_a_day_to_come_has_a_wrong_date_or_the_computer_a_wrong_clock(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Tomorrow may be today elsewhere. With a clock that stands in 1970 nothing would ever expire."""
    config = Config.model_validate({"calibration": {"force_scale": _measured(1.0)}})
    days = [datetime.date(1970, 1, 1), datetime.date(2026, 4, 29), datetime.date(2026, 4, 30), DAY]
    assert [config.calibration.to_come(day) for day in days] == [["force_scale"], ["force_scale"], [], []]
    monkeypatch.setattr(checks, "today", lambda: days[1])
    about: dict[str, Any] = {"key": "calibration.force_scale", "date": DAY, "today": days[1]}
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
def test_drives_are_told_apart_by_id_or_by_port(
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
def test_the_words_of_an_output_are_all_there_or_none(missing: str | None) -> None:
    words = {key: value for key, value in WORDS.items() if key != missing}
    assert SyncSettings.model_validate(words).words == (None if missing else (0x157, 0x80, 0))
    bench = {"stage": {"kind": "leadshine"}, "sync": {"output": "drive", **words}}
    if missing:
        _first("", lambda: KnownBench.model_validate(bench), "sync: ")
    else:
        assert KnownBench.model_validate(bench).sync.words == (0x157, 0x80, 0)


@pytest.mark.parametrize(
    ("kind", "outputs"), [("grbl", ("off", "coolant", "spindle")), ("leadshine", ("off", "drive"))]
)
@pytest.mark.parametrize("words", [{}, WORDS], ids=["without words", "with words"])
def test_an_output_is_one_that_the_stage_has(kind: str, outputs: tuple[str, ...], words: dict[str, int]) -> None:
    for output in ("off", "coolant", "spindle", "drive"):
        bench = {"stage": {"kind": kind}, "sync": {"output": output, **words}}
        if output not in outputs:
            _first("", partial(KnownBench.model_validate, bench), "sync.output: ")
        elif output != "drive" or words:
            assert KnownBench.model_validate(bench).sync.output == output
