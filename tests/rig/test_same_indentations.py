"""The same protocol on every stage with every force sensor, and on Modbus with other steps and counts.

A stage knows nothing of the sensor: `make test` takes every stage with one sensor and every sensor on one stage.
"""

from pathlib import Path
from typing import Any

import pytest

from rig.data import Run, read_run
from rig.devices.registry import BUILT_IN
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import NewRun, Session, dry_run
from sim.models.fingertip import Fingertip

pytestmark = pytest.mark.xdist_group("same indentations")  # one worker, one run to compare with

NEAR = {"frame": {"pad_centre_x_mm": -12.0, "apex_z_mm": -12.0}}
"""A short way from the switches."""
SCRIPT = """\
from rig.protocol import Rig

def run(rig: Rig) -> None:
    rig.mount("step:1")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=-0.51)
    rig.indent(force_gwt=2.33, hold_s=0.3)
    rig.move_to(x_mm=0.17)
    rig.indent(doi_mm=0.4, increments=2, hold_s=0.1)
"""
FORCE_TOLERANCE_GWT = 0.05  # a force is held to this, whatever the devices


def _holds(
    folder: Path,
    finger: Fingertip,
    tables: dict[str, Any],
) -> Run:
    path = folder / "press.py"
    path.write_text(SCRIPT, encoding="utf-8")
    script, config = load_script(str(path)), Config.model_validate({**NEAR, **tables})
    plan = make_plan(script, config, finger)
    done = dry_run(Session(script, config, finger, plan, NewRun(folder / "runs")))
    assert done.complete, done.problem
    return read_run(done.folder.path)


def _words(bench: dict[str, Any]) -> list[object]:
    return [word for device in bench.values() for word in device.values() if isinstance(word, str)]


def _modbus(framing: str, **more: Any) -> dict[str, Any]:
    return {
        "stage": {"kind": "leadshine", "framing": framing},
        "force": {"kind": "laumas", "framing": framing, "baud": 38400},
        **more,
    }


@pytest.fixture(scope="module")
def grbl(finger: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """400 steps/mm and 0.01 g."""
    return _holds(tmp_path_factory.mktemp("grbl"), finger, {})


VARIANTS: dict[str, list[dict[str, Any]]] = {
    "leadshine": [{"framing": "rtu"}, {"framing": "tcp"}],
    "laumas": [{"framing": "rtu", "baud": 38400}, {"framing": "tcp"}],
    "zaber": [{"zaber": {axis: {"address": n, "microstep_um": 2.5} for n, axis in enumerate("xz", 1)}}],
    "standa": [{"standa": {axis: {"step_um": 5.0, "microsteps": 2} for axis in "xz"}}],
    "tmcl": [{"tmcl": {axis: {"motor": n, "microstep_um": 2.5} for n, axis in enumerate("xz")}}],
    "text_cell": [{}, {"text_cell": {"poll": "<w>", "zero": "t", "zero_done": "done"}}],
}
"""Ways to configure a device; a kind that is not here has one."""


def _ways(kind: str) -> list[dict[str, Any]]:
    return VARIANTS.get(kind, [{}])


def _way(kind: str, n: int) -> dict[str, Any]:
    """Return the way of this number, the first one where there are fewer."""
    return dict(enumerate(_ways(kind))).get(n, _ways(kind)[0])


BENCHES = [
    {"stage": {"kind": stage, **_way(stage, n)}, "force": {"kind": force, **_way(force, n)}}
    for stage in BUILT_IN["stage"]
    for force in BUILT_IN["force"]
    for n in range(max(len(_ways(stage)), len(_ways(force))))
    if (stage, force) != ("grbl", "mtsics")
]


def _is_quick(bench: dict[str, Any]) -> bool:
    """Every stage with one sensor and every sensor on one stage, Modbus in either framing."""
    stage, force = bench["stage"], bench["force"]
    if stage["kind"] != "grbl":
        return force["kind"] == "mtsics" and stage.get("framing") != "rtu"
    return force.get("framing") != "tcp" and "text_cell" not in force


@pytest.mark.quick(rows=_is_quick)
@pytest.mark.parametrize("bench", BENCHES, ids=lambda bench: "-".join(map(str, _words(bench))))
def test_all_stages_and_sensors_with_equal_steps_and_counts_press_identically(
    grbl: Run, finger: Fingertip, tmp_path: Path, bench: dict[str, Any]
) -> None:
    """All stages make 400 steps a mm, all sensors count 0.01 g: at rest the same steps give the same counts."""
    modbus = _holds(tmp_path, finger, bench)
    for stream, keys in (
        ("hold_end", ("x_mm", "doi_mm", "force_gwt", "force_sd_gwt", "true_x_mm", "true_doi_mm")),
        ("touch", ("contact_height_mm", "height_at_threshold_mm", "fit_points")),
    ):
        ours, theirs = modbus.stream(stream), grbl.stream(stream)
        assert len(ours) == len(theirs) > 0
        for mine, other in zip(ours, theirs, strict=True):
            assert [mine[key] for key in keys] == pytest.approx([other[key] for key in keys], abs=1e-9)


def test_stages_and_sensors_with_other_steps_and_counts_agree_within_their_resolution(
    grbl: Run, finger: Fingertip, tmp_path: Path
) -> None:
    """1000 pulses a mm, z running against its axis, and counts of 0.02 g.

    Depth: half a step of each stage, and what each touch-off may miss, which is the depth that hides below half a
    count, (half a count / k)^(2/3) with k = 9 gwt/mm^1.5 here, plus one touch increment. Force: every reading is the
    model's at the true pose, to half a count.
    """
    calibration = {
        f"{axis}_steps_per_mm": {"value": per_mm, "date": "2026-01-01", "expires": "2027-01-01"}
        for axis, per_mm in (("x", 1000.0), ("z", -1000.0))
    }
    tables = _modbus("rtu", calibration=calibration, virtual={"cell_resolution_gwt": 0.02})
    drives = {"x": {"device_id": 1, "pulses_per_rev": 1000}, "z": {"device_id": 2, "pulses_per_rev": 1000}}
    tables["stage"] |= {"drives": drives, "resolution_mm": 0.001}
    tables["force"] |= {"resolution_gwt": 0.02}
    modbus = _holds(tmp_path, finger, tables)
    hidden_mm = (0.01 / 9) ** (2 / 3)
    depth_mm = 0.5 / 400 + 0.5 / 1000 + hidden_mm + 0.01
    for run, count_gwt in ((grbl, 0.01), (modbus, 0.02)):
        for hold in run.stream("hold_end"):
            model = finger.indent("step:1", hold["true_x_mm"], doi_mm=hold["true_doi_mm"])
            assert hold["force_gwt"] == pytest.approx(model.force_gwt, abs=0.5 * count_gwt + 1e-4)
    for mine, other in zip(modbus.stream("hold_end"), grbl.stream("hold_end"), strict=True):
        assert mine["true_x_mm"] == pytest.approx(other["true_x_mm"], abs=0.5 / 400 + 0.5 / 1000)
        assert mine["true_doi_mm"] == pytest.approx(other["true_doi_mm"], abs=depth_mm)
    for run in (grbl, modbus):
        assert run.stream("hold_end")[0]["force_gwt"] == pytest.approx(2.33, abs=FORCE_TOLERANCE_GWT)
