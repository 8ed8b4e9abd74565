"""A virtual bench that differs from what the rig believes: stiffer, relaxing, noisy, late, coarse."""

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.bench.virtual import virtual_bench
from rig.data import Run
from rig.engine.bench import NO_PAUSE
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import NewRun, Session, dry_run
from sim.devices.clock import VirtualClock
from sim.models.fingertip import Fingertip

NEAR = {"frame": {"pad_centre_x_mm": -12.0, "apex_z_mm": -12.0}}
"""A short way from the switches."""
PRESS = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.0)
    rig.indent({how})
"""


def pressed(folder: Path, finger: Fingertip, how: str, **virtual: Any) -> Run:
    return carried_out(folder, finger, PRESS.format(how=how), {"virtual": virtual})


def carried_out(folder: Path, finger: Fingertip, source: str, tables: dict[str, Any]) -> Run:
    path = folder / "press.py"
    path.write_text(source, encoding="utf-8")
    script, config = load_script(str(path)), Config.model_validate({**NEAR, **tables})
    plan = make_plan(script, config, finger)
    done = dry_run(Session(script, config, finger, plan, NewRun(folder / "runs")))
    assert done.problem is None
    return done.run


def calibrated(**values: float) -> dict[str, Any]:
    return {name: {"value": value, "date": "2026-01-01", "expires": "2099-01-01"} for name, value in values.items()}


def holding(run: Run) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(n, 2) time in s and force in gwt of the readings of the hold."""
    return np.array([(s["t_s"], s["force_gwt"]) for s in run.stream("sample") if s["phase"] == "hold"])


def model_gwt(finger: Fingertip, run: Run) -> float:
    hold = run.stream("hold_end")[0]
    return finger.indent("bar:3.0", hold["true_x_mm"], doi_mm=hold["true_doi_mm"]).force_gwt


@pytest.mark.quick(rows=lambda x_port, port, framing: framing is None or (x_port is None and port == "/dev/both"))
@pytest.mark.parametrize("x_port", ["/dev/x", "tcp://gateway:503", None])
@pytest.mark.parametrize("port", ["/dev/both", "tcp://gateway:502"])
@pytest.mark.parametrize("framing", ["rtu", "tcp", None])
def test_a_virtual_bench_works_with_any_port_names_and_framing(
    finger: Fingertip, port: str, x_port: str | None, framing: str | None
) -> None:
    """Modbus is framed by the name of its port where nobody says how; virtual devices have none."""
    drives = {} if x_port is None else {"drives": {"x": {"device_id": 1, "port": x_port}, "z": {"device_id": 2}}}
    stage = {"kind": "leadshine", "port": port, "framing": framing, **drives}
    force = {"kind": "laumas", "port": port + "1", "framing": framing, "baud": 115200}
    config = Config.model_validate({"stage": stage, "force": force})
    bench = virtual_bench(config, finger, io.StringIO(), VirtualClock(0.0), NO_PAUSE)
    assert "drive" in bench.stage.connect()
    assert bench.force.read().stable is not None


def test_the_force_on_a_relaxing_virtual_finger_follows_its_prony_series(finger: Fingertip, tmp_path: Path) -> None:
    """Held at a depth for ten seconds, the force falls as the series says; the fall before the hold is counted in the
    time of the last move, which is short beside the time constant."""
    share, tau_s = 0.4, 2.0
    run = pressed(tmp_path, finger, "doi_mm=0.4, hold_s=10.0", relaxation=[[share, tau_s]])
    t_s, force = holding(run).T
    elastic = model_gwt(finger, run)
    assert force[0] < elastic
    assert force[-1] == pytest.approx((1 - share) * elastic, rel=0.01)
    # What is left to fall falls with the one time constant, whatever came before.
    left = force - (1 - share) * elastic
    early = t_s - t_s[0] < 4.0
    slope = np.polyfit(t_s[early], np.log(left[early]), 1)[0]
    assert -1 / slope == pytest.approx(tau_s, rel=0.03)


def test_a_noisy_virtual_load_cell_has_the_configured_standard_deviation(finger: Fingertip, tmp_path: Path) -> None:
    run = pressed(tmp_path, finger, "doi_mm=0.3, hold_s=20.0", cell_noise_gwt=0.02, noise_seed=3)
    _, force = holding(run).T
    # 400 readings: the standard error of their sd is sd / √800; the display's 0.01 gwt adds 0.01/√12 in quadrature.
    expected = math.hypot(0.02, 0.01 / math.sqrt(12))
    assert force.std() == pytest.approx(expected, abs=4 * expected / math.sqrt(800))
    assert force.mean() == pytest.approx(model_gwt(finger, run), abs=4 * expected / math.sqrt(400) + 0.02)


def test_a_late_load_cell_finds_the_touch_too_deep(finger: Fingertip, tmp_path: Path) -> None:
    """With a sensor as late as four of its periods, and readings after one, touch is found too deep."""
    prompt = pressed(tmp_path, finger, "doi_mm=0.3, hold_s=0.2").stream("touch")[0]
    (tmp_path / "b").mkdir()
    late = pressed(tmp_path / "b", finger, "doi_mm=0.3, hold_s=0.2", cell_latency_s=0.2).stream("touch")[0]
    assert late["true_doi_bias_mm"] > prompt["true_doi_bias_mm"] + 0.005


# --- a rig that is not quite what it seems ---

BACK_AND_FORTH = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for x_mm in (-0.5, 0.0, 0.5, 0.0):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.2, hold_s=0.1)
"""
BACKLASH_MM = 0.1
STAGES = [{"kind": "grbl"}, {"kind": "leadshine"}]


def x_errors_mm(run: Run) -> list[float]:
    return [hold["true_x_mm"] - hold["x_mm"] for hold in run.stream("hold_end")]


@pytest.mark.quick(rows=lambda stage: stage["kind"] == "leadshine")
@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage["kind"])
def test_unmeasured_backlash_shows_as_an_error_of_position(
    finger: Fingertip, tmp_path: Path, stage: dict[str, Any]
) -> None:
    """From the switches to −0.5 is a way down the axis; 0.0 and 0.5 are reached upwards, 0.1 mm short."""
    run = carried_out(
        tmp_path, finger, BACK_AND_FORTH, {"stage": stage, "virtual": {"x_screw_backlash_mm": BACKLASH_MM}}
    )
    assert x_errors_mm(run) == pytest.approx([0.0, -BACKLASH_MM, -BACKLASH_MM, 0.0], abs=1e-9)


@pytest.mark.quick(rows=lambda stage: stage["kind"] == "grbl")
@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage["kind"])
def test_arriving_in_one_direction_compensates_measured_backlash(
    finger: Fingertip, tmp_path: Path, stage: dict[str, Any]
) -> None:
    """On both axes: x goes back and forth, and z goes up to back off after each coarse touch."""
    run = carried_out(
        tmp_path,
        finger,
        BACK_AND_FORTH,
        {
            "stage": stage,
            "virtual": {"x_screw_backlash_mm": BACKLASH_MM, "z_screw_backlash_mm": BACKLASH_MM},
            "calibration": calibrated(x_backlash_mm=BACKLASH_MM, z_backlash_mm=BACKLASH_MM),
        },
    )
    (tmp_path / "b").mkdir()
    exact = carried_out(tmp_path / "b", finger, BACK_AND_FORTH, {"stage": stage})
    assert x_errors_mm(run) == pytest.approx([0.0] * 4, abs=1e-9)
    for mine, other in zip(run.stream("hold_end"), exact.stream("hold_end"), strict=True):
        assert mine["true_doi_mm"] == pytest.approx(other["true_doi_mm"], abs=1e-9)
        assert mine["force_gwt"] == other["force_gwt"]


@pytest.mark.quick(rows=lambda measured, missing: measured is not None)
@pytest.mark.parametrize(("measured", "missing"), [(0.5, 0.0), (None, 1.0)])
def test_measured_compliance_corrects_the_depth_of_a_press(
    finger: Fingertip, tmp_path: Path, measured: float | None, missing: float
) -> None:
    """0.5 mm/N under some 7 gwt is 0.03 mm: with the compliance measured the depth is as said, else less by it.

    What touch-off itself misses, up to an increment of 0.01 mm, is in the journal and taken off.
    """
    compliance = 0.5
    tables: dict[str, Any] = {"virtual": {"compliance_mm_per_n": compliance}}
    if measured is not None:
        tables["calibration"] = calibrated(compliance_mm_per_n=measured)
    run = carried_out(tmp_path, finger, PRESS.format(how="doi_mm=0.8, hold_s=0.2"), tables)
    (hold,), (touch,) = run.stream("hold_end"), run.stream("touch")
    given_mm = compliance * hold["force_gwt"] * 9.80665e-3
    assert given_mm > 0.025
    bias_mm = touch["true_doi_bias_mm"]
    # The board rounds every height to a step of 0.0025 mm: half of it, at the touch and at the hold.
    assert hold["true_doi_mm"] - hold["doi_mm"] == pytest.approx(bias_mm - missing * given_mm, abs=0.0025)
    assert hold["doi_mm"] == pytest.approx(0.8, abs=0.0025)
    assert hold["force_gwt"] == pytest.approx(model_gwt(finger, run), abs=0.006)
