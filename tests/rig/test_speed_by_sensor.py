"""The press speed that the age of a force sample allows: what the plan reports, and what it refuses."""

from pathlib import Path
from typing import Any

import pytest

from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.plan import Plan, make_plan, refuse_unseen
from rig.plan.sample_age import SampleAge
from rig.protocol.script import load_script
from rig.session.rehearsal_summary import preflight
from rig.units import GWT_N
from sim.models.fingertip import Fingertip
from tests.error_codes import printed, raises

HX711: dict[str, Any] = {"kind": "text_cell", "baud": 57600, "sample_period_s": 0.1, "latency_s": 0.15}


def _script(folder: Path, verb: str) -> Any:
    path = folder / "one.py"
    path.write_text(
        "from rig.protocol import Rig\n\ndef run(rig: Rig) -> None:\n"
        f'    rig.mount("step:1")\n    rig.home()\n    rig.zero()\n    rig.move_to(x_mm=0.0)\n    rig.{verb}\n',
        encoding="utf-8",
    )
    return load_script(str(path))


@pytest.mark.parametrize(
    ("force", "age_s", "mean_mm_s"),
    [
        ({}, 0.05, 0.05 / (0.05 + 0.05)),
        ({"kind": "net_ft", "sample_period_s": 0.01}, 0.01, 0.05 / (0.05 + 0.01)),
        (HX711, 0.25, 0.05 / (0.05 + 0.25)),
        ({"kind": "text_cell", "sample_period_s": 0.5}, 0.5, 0.05 / (0.05 + 0.5)),
    ],
)
def test_a_slow_sensor_presses_slowly_and_the_plan_reports_it(
    force: dict[str, Any], age_s: float, mean_mm_s: float, finger: Fingertip, tmp_path: Path
) -> None:
    """The reported speed is an upper bound of the rehearsed one."""
    config = Config.model_validate({"force": force})
    script = _script(tmp_path, "indent(doi_mm=0.6, hold_s=0.0)")
    plan = make_plan(script, config, finger)
    found = preflight(script, config, finger, plan).as_json()
    assert found["sample_age_s"] == pytest.approx(age_s)
    assert found["press_speed_mm_s"] == pytest.approx(mean_mm_s)
    step = found["steps"][0]
    stiffness_gwt_mm = 1.5 * step["force_gwt"] / step["doi_mm"]
    assert found["rise_gwt"] == pytest.approx(stiffness_gwt_mm * min(1.0 * age_s, 0.05))
    assert found["contact_s"] >= 0.6 / mean_mm_s * 0.9


def test_a_press_that_could_pass_the_trip_unseen_is_refused(finger: Fingertip, tmp_path: Path) -> None:
    """At and below the speed that the error names it is accepted."""
    config = Config.model_validate({"force": HX711})

    def planned(speed_mm_s: float) -> Plan:
        plan = make_plan(
            _script(tmp_path, f"indent(doi_mm=0.6, hold_s=0.0, speed_mm_s={speed_mm_s})"), config, finger
        )
        plan.first_soft_trip_n = 1.05 * plan.peak_force_gwt * GWT_N
        return plan

    with raises(BadInputError, "too_fast_for_sensor", speed_mm_s=1.0, age_s=0.25) as caught:
        refuse_unseen(planned(1.0), config)
    limit_mm_s = printed(caught.value, "press at most at ", " mm/s")
    assert limit_mm_s == pytest.approx(0.05 * 0.6 / 1.5 / 0.25, rel=0.05)
    refuse_unseen(planned(0.95 * limit_mm_s), config)
    with raises(BadInputError, "too_fast_for_sensor"):
        refuse_unseen(planned(1.05 * limit_mm_s), config)


def test_the_force_rise_between_readings_is_that_of_one_increment_at_most() -> None:
    age = SampleAge.of(Config.model_validate({"force": HX711}))
    assert age.rise_gwt(0.1, 10.0) == pytest.approx(10.0 * 0.1 * 0.25)
    assert age.rise_gwt(5.0, 10.0) == pytest.approx(10.0 * 0.05)
