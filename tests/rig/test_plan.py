"""What a plan keeps of a script, and what the model is asked."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.finger_model import FingerModel
from rig.plan.plan import Plan, make_plan
from rig.protocol.check import NoPredictionError
from rig.protocol.script import load_script
from rig.records import PlannedIndentation, Target
from sim.models.fingertip import Fingertip
from tests.error_codes import raises

GWT_N = 9.80665e-3


def _planned(force_gwt: float) -> PlannedIndentation:
    return PlannedIndentation(
        "bar:3.0", 0.0, Target("force_gwt", force_gwt), -0.1, force_gwt, 0.5, 4.0, 0.01, increments=1, hold_s=1.0
    )


# --- the soft trip ---


def test_the_soft_trip_is_twice_the_highest_force_of_any_purpose() -> None:
    plan = Plan()
    plan.presses["data"] += [_planned(5.0), _planned(20.0)]
    plan.presses["reference"].append(_planned(30.0))
    plan.presses["precondition"].append(_planned(10.0))
    assert plan.peak_force_gwt == 30.0
    assert plan.soft_trip_n == pytest.approx(60.0 * GWT_N)
    assert plan.indentations == plan.presses["data"]
    assert sorted(p.predicted_force_gwt for p in plan.all_presses) == [5.0, 10.0, 20.0, 30.0]


@pytest.mark.parametrize("forces_gwt", [[], [1.01]], ids=["no press", "a light one"])
def test_noise_does_not_trip_the_lightest_press(forces_gwt: list[float]) -> None:
    """0.02 N, some 2 gwt, at least."""
    plan = Plan()
    plan.presses["data"] += [_planned(force) for force in forces_gwt]
    assert plan.peak_force_gwt == max(forces_gwt, default=0.0)
    assert plan.soft_trip_n == 0.02


def test_a_resumed_run_keeps_its_soft_trip() -> None:
    plan = Plan(first_soft_trip_n=0.7)
    plan.presses["data"].append(_planned(50.0))
    assert plan.soft_trip_n == 0.7


# --- a script ---


def _plan(tmp_path: Path, finger: Fingertip, body: str, **options: Any) -> Plan:
    path = tmp_path / "mine.py"
    path.write_text(body, encoding="utf-8")
    return make_plan(load_script(str(path)), Config(), finger, **options)


READY = "    rig.mount('sphere:2'); rig.home(); rig.zero(); rig.move_to(x_mm=0.0)\n"


def test_a_plan_lists_presses_by_purpose_and_touches_in_order(tmp_path: Path, finger: Fingertip) -> None:
    body = (
        f"def run(rig):\n{READY}"
        "    rig.precondition(presses=2, doi_mm=0.2)\n"
        "    rig.indent(doi_mm=0.3)\n"
        "    rig.move_to(x_mm=0.5)\n"
        "    rig.indent(doi_mm=0.4)\n"
        "    rig.touch()\n"
        "    rig.move_to(x_mm=-0.5, along_mm=1.0)\n"
        "    rig.touch()\n"
    )
    plan = _plan(tmp_path, finger, body)
    assert [(p.x_mm, p.target.value) for p in plan.presses["precondition"]] == [(0.0, 0.2)] * 2
    assert [(p.x_mm, p.target.value) for p in plan.indentations] == [(0.0, 0.3), (0.5, 0.4)]
    assert len(plan.touches) == 2
    assert len(plan.predictions) == 3
    assert plan.peak_force_gwt == max(p.predicted_force_gwt for p in plan.predictions.values())
    assert plan.first_soft_trip_n is None


def test_while_planning_a_script_receives_the_answers_of_the_model(tmp_path: Path, finger: Fingertip) -> None:
    """It may go by the answer: here it presses half as deep as it did at first."""
    pressed = "    found = rig.indent(doi_mm=0.4)\n    rig.indent(doi_mm=found.holds[0].doi_mm / 2)\n"
    plan = _plan(tmp_path, finger, f"def run(rig):\n{READY}{pressed}")
    assert [p.target.value for p in plan.indentations] == pytest.approx([0.4, 0.2])


@pytest.mark.parametrize(
    ("body", "code", "where", "fields"),
    [
        (f"async def run(rig):\n{READY}", "asynchronous", {"path": "mine.py"}, {}),
        (
            f"def run(rig):\n{READY}    rig.precondition(presses=1, doi_mm=0.2)\n",
            "indents_nowhere", {"path": "mine.py"}, {},
        ),
        (
            f"def run(rig):\n{READY}    1 / 0\n",
            "exception_in_script", {"place": "mine.py, line 3"}, {"exception": "ZeroDivisionError"},
        ),
        (
            f"def run(rig):\n{READY}    raise SystemExit('enough')\n",
            "exception_in_script", {"place": "mine.py, line 3"},
            {"exception": "SystemExit", "problem": "SystemExit: enough"},
        ),
    ],
    ids=["asynchronous", "no data", "an error", "an exit"],
)  # fmt: skip
def test_a_script_that_cannot_be_carried_out_is_refused_with_its_line(
    tmp_path: Path, finger: Fingertip, body: str, code: str, where: dict[str, str], fields: dict[str, Any]
) -> None:
    at = {name: f"{tmp_path}/{one}" for name, one in where.items()}
    with raises(BadInputError, code, **at, **fields):
        _plan(tmp_path, finger, body)


# --- the model ---


@pytest.mark.parametrize(("along_mm", "z_mm"), [(-1.5, 5.393), (0.0, 6.893), (1.5, 8.393)])
def test_positions_along_the_finger_count_from_the_receptor_plane_towards_the_tip(
    finger: Fingertip, along_mm: float, z_mm: float
) -> None:
    """The plane is 6.893 mm from the proximal end: 12.75 − 5.857."""
    height = FingerModel(finger, {}).touch_height_mm("sphere:2", 0.3, along_mm)
    apex = finger.touch_height_mm("sphere:2", 0.3, "apex")
    assert height == pytest.approx(finger.touch_height_mm("sphere:2", 0.3, z_mm=z_mm) - apex, abs=1e-9)


@pytest.mark.parametrize("converged", [True, False])
def test_a_press_that_does_not_converge_gives_no_prediction(finger: Fingertip, converged: bool) -> None:
    state = SimpleNamespace(converged=converged, residual=3e-5)
    result = SimpleNamespace(
        state=state, touch_height_mm=4.0, force_gwt=2.0, doi_mm=0.1, contact_area_mm2=1.0, peak_pressure_mpa=0.1
    )
    stub: Any = SimpleNamespace(indent=lambda *what, **how: result, apex_height_mm=4.5)
    model = FingerModel(stub, {})
    if converged:
        assert model.press("bar:3.0", 0.0, Target("doi_mm", 0.1)).expected_contact_mm == -0.5
        return
    with raises(NoPredictionError, "not_converged", residual=3e-5):
        model.press("bar:3.0", 0.0, Target("doi_mm", 0.1))
