"""Nothing that the plan can know is found by the board: at the edge of travel a verb is refused, or it is done.

Each script is planned on a configuration just within and just beyond an end of the stage, and what is not refused is
carried out on a finger of springs, over the wire, by the virtual board or drives that alarm beyond their travel.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rig.cli import main
from rig.devices.base import StageError
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.finger_model import FingerModel
from rig.plan.plan import make_plan
from rig.protocol.script import Script, load_script
from rig.records import Prediction
from rig.session.rehearse import rehearsed
from rig.settings import ZERO_LIFT_MM
from sim.models.fingertip import Fingertip

READY = "rig.mount('cylinder:9'); rig.home(); rig.zero(); "
PRESS = "rig.indent(doi_mm=0.2, hold_s=0); "
SCRIPTS = {
    "retract": READY + "rig.retract(); rig.move_to(x_mm=0.0); " + PRESS,
    "move_to": READY
    + "rig.move_to(x_mm=1.0); rig.move_to(x_mm=-1.0); rig.rest(0.1); rig.move_to(x_mm=0.0); "
    + PRESS,
    "touch": READY + "rig.move_to(x_mm=3.0); rig.touch(); rig.move_to(x_mm=0.0); " + PRESS,
    "indent": READY + "rig.move_to(x_mm=0.0); " + PRESS + "rig.retract()",
    "deep": READY + "rig.move_to(x_mm=0.0); rig.indent(doi_mm=1.0, increments=2, hold_s=0)",
    "by force": READY + "rig.move_to(x_mm=0.0); rig.indent(force_gwt=20.0, hold_s=0)",
    "precondition": READY + "rig.move_to(x_mm=0.0); rig.precondition(presses=2, doi_mm=0.8, hold_s=0); " + PRESS,
    "reference": READY + "rig.reference(x_mm=1.0, doi_mm=0.8, hold_s=0); rig.move_to(x_mm=0.0); " + PRESS,
}
GOES_THERE = {
    "left": ("move_to", "indent", "reference"),
    "right": ("move_to", "touch", "reference"),
    "front": ("indent",),
    "back": ("indent",),
    "top": ("retract", "move_to", "indent"),
    "bottom": ("touch", "indent", "deep", "by force", "precondition"),
}
"""The scripts that come nearest to each end; what has no end of its own is tried with all."""
BY, X_TRAVEL_MM, Y_TRAVEL_MM, Z_TRAVEL_MM = 0.02, 60.0, 30.0, 40.0
CLEARANCE_MM, SEARCH_MM = 0.3, 0.5
HIGH = {"apex_z_mm": -3.0}
"""A short way down where the ends of z are not looked at."""
MEASURED = {"date": "2026-01-05", "expires": "2126-01-05"}


def _configurations() -> Iterator[tuple[str, dict[str, Any]]]:
    """Each with an end of the stage within, at and beyond what some verb needs."""
    for way, by in (("within", BY), ("at", 0.0), ("beyond", -BY)):
        yield f"left {way}", {"frame": {"pad_centre_x_mm": -X_TRAVEL_MM + 1.0 + by, **HIGH}}
        yield f"right {way}", {"frame": {"pad_centre_x_mm": -1.0 - by, **HIGH}}
        yield f"front {way}", {"frame": {"pad_y_mm": -Y_TRAVEL_MM + by, **HIGH}}
        yield f"back {way}", {"frame": {"pad_y_mm": -by, **HIGH}}
        yield f"top {way}", {"frame": {"apex_z_mm": -CLEARANCE_MM - ZERO_LIFT_MM - by}}
        for what, below_mm in (("search", SEARCH_MM), ("1 mm", 1.0)):
            yield f"bottom {way}, {what}", {"frame": {"apex_z_mm": -Z_TRAVEL_MM + below_mm + by}}
        low = {"apex_z_mm": -Z_TRAVEL_MM + 1.0 + by}
        given = {"compliance_mm_per_n": {"value": 0.5, **MEASURED}}
        yield f"bottom {way}, the rig gives", {"frame": low, "calibration": given}
        slack = {"z_backlash_mm": {"value": 0.1, **MEASURED}, "x_backlash_mm": {"value": 0.1, **MEASURED}}
        yield f"bottom {way}, with backlash", {"frame": {"apex_z_mm": -Z_TRAVEL_MM + 1.0 + by}, "calibration": slack}
        yield f"right {way}, with backlash", {"frame": {"pad_centre_x_mm": -1.0 - by, **HIGH}, "calibration": slack}


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Script]:
    folder = tmp_path_factory.mktemp("scripts")
    made = {}
    for name, body in SCRIPTS.items():
        path: Path = folder / f"{name.replace(' ', '_')}.py"
        path.write_text(f"def run(rig):\n    {body}\n", encoding="utf-8")
        made[name] = load_script(str(path))
    return made


@pytest.fixture
def solved_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Predictions depend on no frame: one solve for all configurations."""
    solve = FingerModel._solved

    def kept(model: FingerModel, *asked: Any) -> Prediction:
        if asked not in _SOLVED:
            _SOLVED[asked] = solve(model, *asked)
        return _SOLVED[asked]

    monkeypatch.setattr(FingerModel, "_solved", kept)


_SOLVED: dict[tuple[Any, ...], Prediction] = {}


CONFIGURATIONS = [("grbl", name, tables) for name, tables in _configurations()]
CONFIGURATIONS += [("leadshine", name, tables) for name, tables in _configurations() if " beyond" not in name]


@pytest.mark.quick(
    rows=lambda stage, what, tables: " at" in what and (stage == "grbl" or what in ("left at", "bottom at, 1 mm"))
)
@pytest.mark.parametrize(
    ("stage", "what", "tables"), CONFIGURATIONS, ids=[f"{stage}, {what}" for stage, what, _ in CONFIGURATIONS]
)
@pytest.mark.usefixtures("solved_once")
def test_a_verb_at_the_edge_of_travel_is_refused_by_the_plan_or_carried_out(
    finger: Fingertip, scripts: dict[str, Script], stage: str, what: str, tables: dict[str, Any]
) -> None:
    habits = {"clearance_mm": CLEARANCE_MM, "descent_step_mm": 5.0, "travel_speed_mm_s": 10.0}
    common = {"habits": habits, "limits": {"search_mm": SEARCH_MM}, "stage": {"kind": stage}}
    config = Config.model_validate(common | tables)
    there = GOES_THERE.get(what.split()[0], tuple(SCRIPTS))
    ended = {name: _ended(scripts[name], config, finger) for name in there}
    assert not any("\n" in end for end in ended.values())
    if " within" in what and "backlash" not in what and "gives" not in what:
        assert "done" in ended.values(), ended
    if " beyond" in what:
        assert any(end != "done" for end in ended.values()), ended


def _ended(script: Script, config: Config, finger: Fingertip) -> str:
    try:
        plan = make_plan(script, config, finger)
    except BadInputError as error:
        return str(error)
    try:
        rehearsed(script, config, finger, plan)
    except StageError as error:
        pytest.fail(f"{script.name}: {error}")
    return "done"


@pytest.mark.parametrize("frame", [{"apex_z_mm": -39.6}, {"apex_z_mm": -1.0}, {"pad_centre_x_mm": 0.5}])
def test_calibrating_compliance_on_a_block_beyond_the_travel_is_refused_before_a_port_opens(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    frame: dict[str, float],
) -> None:
    """`rig calibrate compliance` searches for a block as far as for a finger."""
    path = tmp_path / "rig.toml"
    path.write_text(Config.model_validate({"frame": frame}).as_toml(), encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["rig", "calibrate", "compliance", "--config", str(path), "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert json.loads(capsys.readouterr().out)["code"] == "outside_travel"
