"""Finding the finger: a sphere touches it at several places; its frame comes out within the stated uncertainty."""

import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rig.identify.frame import FittedFrame, find
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import NewRun, Session, dry_run
from sim.carriage import Pose, Truth, Turn
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.plant import PressedFinger
from tests.error_codes import raises

TRUTH = {"pad_centre_x_mm": 0.4, "apex_z_mm": -0.15, "pad_y_mm": 0.5, "roll_deg": 4.0, "tilt_deg": -3.0}
WAS = {"pad_centre_x_mm": -30.0, "apex_z_mm": -25.0, "pad_y_mm": -15.0, "roll_deg": 0.0, "tilt_deg": 0.0}


def _within_what_is_stated(lie: FittedFrame, truth: dict[str, float]) -> None:
    """Twice the standard deviation is said to hold 95 %; three of them, 99.7 %, for several keys at once."""
    assert set(lie.value) <= set(truth)
    for name, value in lie.value.items():
        assert abs(value - WAS[name] - truth[name]) < 3 * lie.sd[name], name


# --- on exact geometry ---


def _touched(finger: Fingertip, truth: dict[str, float], along: tuple[float, ...]) -> Any:
    """A run's touches of a sphere, from the simulator's own first touch: nothing of it is used by the fit."""
    plane, turn, events = finger.config.receptor_plane_mm, Turn(truth["roll_deg"], truth["tilt_deg"]), []
    for x in (-2.0, -1.0, 0.0, 1.0, 2.0):
        for a in along:
            height = 0.0
            for _ in range(5):  # the place under a turned finger hangs on the height; it converges tenfold a step
                pose = Pose(x - truth["pad_centre_x_mm"], height - truth["apex_z_mm"], a - truth["pad_y_mm"])
                seen = turn.seen_from_finger(pose, 2.0)
                touch = finger.touch_height_mm("sphere:2", seen.x_mm, z_mm=plane + seen.along_mm)
                height -= seen.above_apex_mm - (touch - finger.apex_height_mm)
            place = {"indentor": "sphere:2", "x_mm": x, "along_mm": a}
            events.append({**place, "contact_height_mm": height})
    return _run_of(events)


def _run_of(events: list[dict[str, Any]]) -> Any:
    return SimpleNamespace(stream=lambda name: {"find": events}[name], folder=SimpleNamespace(path="here"))


@pytest.fixture(scope="module")
def touched(finger: Fingertip) -> Any:
    """Fifteen touches of a turned finger, each sought five times."""
    return _touched(finger, TRUTH, (-2.0, 0.0, 2.0))


@pytest.mark.quick(rows=lambda noise_mm: not noise_mm)  # noise: tests/rig/test_found_frame.py
@pytest.mark.parametrize("noise_mm", [0.0, 0.005])
def test_the_frame_of_a_turned_finger_is_found(finger: Fingertip, touched: Any, noise_mm: float) -> None:
    """As a table of the configuration, too."""
    chance = np.random.default_rng(3)
    noisy = [
        {**event, "contact_height_mm": event["contact_height_mm"] + chance.normal(0.0, noise_mm)}
        for event in touched.stream("find")
    ]
    lie = find(_run_of(noisy), Config(), finger)
    _within_what_is_stated(lie, TRUTH)
    assert lie.residual_mm < max(2 * noise_mm, 0.001)  # the skin's points are 0.3 µm off at most
    assert lie.sd["apex_z_mm"] < 0.03
    # The pad is nearly round across: a roll looks like a step to the side, and the correlation says so.
    assert abs(lie.correlation[0, 3]) > 0.9
    config = Config.model_validate(tomllib.loads(lie.as_toml()))
    assert config.frame.pad_centre_x_mm == pytest.approx(lie.value["pad_centre_x_mm"], abs=1e-4)
    assert config.frame.roll_deg == pytest.approx(lie.value["roll_deg"], abs=1e-4)
    assert "roll_deg" in config.as_toml()  # so that it is stored with every run


def test_without_an_axis_along_the_finger_tilt_and_place_along_stay_as_they_were(finger: Fingertip) -> None:
    truth = {**TRUTH, "pad_y_mm": 0.0, "tilt_deg": 0.0}
    lie = find(_touched(finger, truth, (0.0,)), Config(), finger)
    assert list(lie.value) == ["pad_centre_x_mm", "apex_z_mm", "roll_deg"]
    _within_what_is_stated(lie, truth)


# --- on the virtual bench ---


def test_the_finger_is_found_by_touching_it(finger: Fingertip, tmp_path: Path) -> None:
    """Off-centre and turned, over the wire: nine touches; their bias is in the residual."""
    virtual = {
        "finger_x_offset_mm": TRUTH["pad_centre_x_mm"],
        "finger_z_offset_mm": TRUTH["apex_z_mm"],
        "finger_along_offset_mm": TRUTH["pad_y_mm"],
        "finger_roll_deg": TRUTH["roll_deg"],
        "finger_tilt_deg": TRUTH["tilt_deg"],
    }
    # Each sample on the way to a turned finger asks for a first touch of its own, of 30 ms: a slow balance takes few.
    config = Config.model_validate(
        {
            "virtual": virtual,
            "limits": {"search_mm": 1.2},
            "habits": {"clearance_mm": 1.3},
            "force": {"sample_period_s": 0.15},
        }
    )
    script = load_script("find_finger", ["across=3", "along=3"])
    plan = make_plan(script, config, finger)
    done = dry_run(Session(script, config, finger, plan, NewRun(tmp_path)))
    assert done.complete, done.problem
    lie = find(done.run, config, finger)
    assert lie.touches == 9
    _within_what_is_stated(lie, TRUTH)
    assert lie.residual_mm < 0.01


# --- the turned finger itself ---


def test_a_turn_by_hand() -> None:
    """Roll 90°: +x of the machine is −y of the finger, its +y is +x. A sphere over the apex lies beside it."""
    seen = Turn(roll_deg=90.0).seen_from_finger(Pose(0.0, 1.0, 0.5), 2.0)
    assert (seen.x_mm, seen.above_apex_mm, seen.along_mm) == pytest.approx((3.0, -2.0, 0.5))
    tilted = Turn(tilt_deg=90.0).seen_from_finger(Pose(0.0, 1.0, 0.5), 2.0)
    assert (tilted.x_mm, tilted.above_apex_mm, tilted.along_mm) == pytest.approx((0.0, -1.5, -3.0))


def test_only_a_sphere_presses_a_turned_finger(finger: Fingertip) -> None:
    with raises(ModelRangeError, "turned_finger", indentor="bar:3.0"):
        PressedFinger(finger, "bar:3.0", Truth(turn=Turn(roll_deg=2.0)))
