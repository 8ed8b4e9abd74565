"""`rig home`, `zero`, `status`, `stop` and `doctor` on devices in real time."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.bench.served import ServedBench
from rig.transport import open_port

pytest.importorskip("pty", reason="needs pseudo-terminals")

Rig = Callable[..., Any]
Apart = tuple[str, str, Path]


def test_home_status_and_zero(rig: Rig, apart: Apart) -> None:
    stage, force, config = apart
    assert rig("status", "--config", config, "--json").json["stage"]["state"] == "Alarm"
    homed = rig("home", "--config", config, "--json")
    assert homed.code == 0, homed.err
    at = {"state": "Idle", "x_mm": -1.0, "y_mm": -1.0, "z_mm": -1.0}
    assert homed.json.items() >= {**at, "contact": "raised", "may_touch": True, "force_gwt": None}.items()
    assert rig("zero", "--config", config, "--json").json == {
        "identity": "MT-SICS balance 0123456789",
        "force_n": 0.0,
    }
    wire = open_port(force, 115200)
    wire.write(b"TA 2.50 g\r\n")
    wire.close()
    after = rig("status", "--config", config, "--json").json
    assert after["stage"] == {"kind": "grbl", "ports": [stage], **at, "z_mm": pytest.approx(-0.7, abs=0.003)}
    assert after["force"]["force_n"] == pytest.approx(-2.5 * 9.80665e-3), "as its display shows it"
    assert after["force"]["stable"]
    contact = {"contact": "lifted", "may_touch": False, "force_gwt": 0.0}
    assert after["contact"].items() >= contact.items(), "counted from the zero on record, whatever was tared since"
    assert rig("doctor", "--config", config).code == 0
    people = rig("status", "--config", config)
    assert people.code == 0
    assert f"stage       kind grbl, port {stage}, state Idle, x_mm -1.0" in people.out


def test_status_of_ports_that_are_not_there_and_of_one_that_is_owned(
    rig: Rig, served: Callable[..., ServedBench], rig_toml: Callable[..., Path]
) -> None:
    bench = served(stage="grbl")
    wire = open_port(bench.ports["stage"], 115200)
    try:
        ended = rig("status", "--config", rig_toml(**bench.ports), "--json")
    finally:
        wire.close()
    assert ended.code == 1
    assert ended.json["stage"] == {"kind": "grbl", "ports": [bench.ports["stage"]], "owner": os.getpid()}
    force = ended.json["force"]
    assert "/dev/ttyNOWHERE7" in force["problem_text"]
    assert force["code"] == "no_port"
    assert ended.complaint == force["problem_text"]


def test_a_stage_is_owned_by_whoever_has_the_port_of_one_of_its_drives(
    rig: Rig, served: Callable[..., ServedBench], tmp_path: Path
) -> None:
    """The stage's own port, on which there is no drive then, does not count."""
    port = served(stage="leadshine").ports["stage"]
    config = tmp_path / "rig.toml"
    drives = "".join(f'[stage.drives.{axis}]\ndevice_id = {n}\nport = "{port}"\n' for axis, n in (("x", 1), ("z", 2)))
    config.write_text(f'[stage]\nkind = "leadshine"\nport = "/dev/ttyNOWHERE7"\n{drives}', encoding="utf-8")
    wire = open_port(port, 115200)
    try:
        owned = rig("status", "--config", config, "--json").json["stage"]
    finally:
        wire.close()
    assert owned == {"kind": "leadshine", "ports": [port], "owner": os.getpid()}
    free = rig("status", "--config", config, "--json").json["stage"]
    assert free["state"] == "Idle"
    stopped = rig("stop", "--config", config, "--json")
    assert stopped.json == {"stopped": [port], "owner": None, "sent": True, "state": "Idle"}


def test_doctor_looks_at_the_devices_of_a_configuration(
    rig: Rig, served: Callable[..., ServedBench], tmp_path: Path
) -> None:
    stage, force = served(stage="grbl").ports["stage"], served(force="mtsics").ports["force"]
    config = tmp_path / "rig.toml"
    config.write_text(
        f'[stage]\nport = "{stage}"\ntravel_mm = [70, 30, 40]\n[force]\nport = "{force}"\n'
        "[calibration.force_scale]\nvalue = 1.02\ndate = 2019-01-01\nexpires = 2020-01-01\n",
        encoding="utf-8",
    )
    found = rig("doctor", "--config", config, "--json").json
    assert found["stage"]["state"] == "Alarm"
    assert "$130=70 (found 60)" in found["stage"]["problem_text"]
    assert found["stage"]["code"]
    assert found["force"]["identity"] == "MT-SICS balance 0123456789"
    (scale,) = found["calibrated"]
    assert (scale["name"], scale["value"], scale["expires"], scale["expired"]) == (
        "force_scale", 1.02, "2020-01-01", True,
    )  # fmt: skip
    assert "calibrated" not in rig("doctor", "--json").json
