"""The finger's frame from touches, against the simulator's own first touch: what is found, and what is said of it.

The fit knows the skin as points, the simulator as a surface; they share nothing but the finger.
"""

import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import t as student

from rig.errors import BadInputError
from rig.identify.frame import NAMES, FittedFrame, find
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import NewRun, Session, dry_run
from sim.carriage import Pose, Truth, Turn
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.plant import PressedFinger
from tests.error_codes import raises

RADIUS_MM = 2.4
Above = Callable[[float, float, float, tuple[float, ...]], float]
Places = list[tuple[float, float]]

WIDE = [(x, a) for x in (-2.5, 0.0, 2.5) for a in (-2.0, 0.0, 2.0)]
ACROSS = [(x, 0.0) for x in (-2.5, -1.5, -0.5, 0.5, 1.5, 2.5)]
FRAME = np.array([-30.0, -25.0, -15.0, 0.0, 0.0])  # by default
LEAST_SD_MM = 0.003  # a touch is known no better


@pytest.fixture(scope="module")
def above(finger: Fingertip) -> Above:
    """How far a sphere at a place and height is above the skin of a finger moved and turned by so much, mm."""

    @cache
    def at(x: float, a: float, height: float, moved: tuple[float, ...]) -> float:
        dx, dy, along, *turn = moved
        seen = Turn(*turn).seen_from_finger(Pose(x - dx, height - dy, a - along), RADIUS_MM)
        z_mm = finger.config.receptor_plane_mm + seen.along_mm
        touch = finger.touch_height_mm(f"sphere:{RADIUS_MM:g}", seen.x_mm, z_mm=z_mm)
        return seen.above_apex_mm - (touch - finger.apex_height_mm)

    return at


def _heights(above: Above, places: Places, moved: tuple[float, ...]) -> list[float]:
    """Where a sphere over each place touches, mm above the nominal apex."""
    heights = [0.0] * len(places)
    for _ in range(5 if any(moved[3:]) else 1):  # under a turned finger the place hangs on the height
        heights = [h - above(x, a, h, moved) for (x, a), h in zip(places, heights, strict=True)]
    return heights


def _run(places: Places, heights: list[float], indentor: str = f"sphere:{RADIUS_MM:g}") -> Any:
    events = [
        {"indentor": indentor, "x_mm": x, "along_mm": a, "contact_height_mm": h}
        for (x, a), h in zip(places, heights, strict=True)
    ]
    return SimpleNamespace(stream=lambda name: {"find": events}[name], folder=SimpleNamespace(path="here"))


def _found(finger: Fingertip, above: Above, places: Places, moved: tuple[float, ...], off: Any = 0.0) -> FittedFrame:
    return find(_run(places, list(np.add(_heights(above, places, moved), off))), Config(), finger)


def _slopes(above: Above, places: Places, moved: tuple[float, ...], free: list[int]) -> Any:
    """(touches, free): what each does to how far they are off, by central differences of 0.1 mm and half a degree."""
    heights, columns = _heights(above, places, moved), []
    for i in free:
        step = np.zeros(5)
        step[i] = 0.1 if i < 3 else 0.5
        up, down = (tuple(np.add(moved, sign * step)) for sign in (1, -1))
        at = [(x, a, h) for (x, a), h in zip(places, heights, strict=True)]
        columns.append([(above(*p, up) - above(*p, down)) / (2 * step[i]) for p in at])
    return np.array(columns).T


MOVED, TURNED = (0.4, -0.15, 0.3, 0.0, 0.0), (0.2, 0.1, -0.3, 3.0, -2.0)
TRUTH = {"pad_centre_x_mm": 0.4, "apex_z_mm": -0.15, "pad_y_mm": 0.5, "roll_deg": 4.0, "tilt_deg": -3.0}


def test_exact_touches_give_the_finger_frame_within_a_fraction_of_a_micrometer(
    finger: Fingertip, above: Above
) -> None:
    lie = _found(finger, above, WIDE, TURNED)
    assert lie.touches == 9
    assert list(lie.value) == list(NAMES)
    assert lie.residual_mm < 0.0003
    off = np.abs(np.array(list(lie.value.values())) - FRAME - TURNED)
    assert off[:3].max() < 0.01
    assert off[3:].max() < 0.15
    # The pad is nearly round across: a roll looks like a step to the side, and the correlation says so.
    assert abs(lie.correlation[0, 3]) > 0.9
    config = Config.model_validate(tomllib.loads(lie.as_toml()))
    assert config.frame.roll_deg == pytest.approx(lie.value["roll_deg"], abs=1e-4)
    assert "roll_deg" in config.as_toml()  # so that it is stored with every run


@pytest.mark.parametrize("indentor", ["sphere:0.8", "sphere:r=0.8", "sphere:d=1.6"])
def test_find_accepts_a_small_sphere_given_by_radius_or_diameter(finger: Fingertip, indentor: str) -> None:
    plane, apex = finger.config.receptor_plane_mm, finger.apex_height_mm
    heights = [finger.touch_height_mm("sphere:0.8", x, z_mm=plane + a) - apex for x, a in WIDE]
    lie = find(_run(WIDE, heights, indentor), Config(), finger)
    assert lie.residual_mm < 0.001
    assert list(lie.value.values())[:3] == pytest.approx(FRAME[:3], abs=0.03)


@pytest.mark.quick(rows=lambda off_mm, places, free: (places is WIDE) is (off_mm > 0))
@pytest.mark.parametrize("off_mm", [0.0, 0.006], ids=["exact", "off by 6 µm"])
@pytest.mark.parametrize(("places", "free"), [(WIDE, [0, 1, 2, 3, 4]), (ACROSS, [0, 1, 3])], ids=["wide", "across"])
def test_the_stated_uncertainty_of_a_found_frame_is_that_of_a_least_squares_fit(
    finger: Fingertip, above: Above, places: Places, free: list[int], off_mm: float
) -> None:
    """s² (JᵀJ)⁻¹ with s of what is left over, 3 µm at least; twice what is stated holds 95 % by Student's t."""
    moved = (0.1, -0.1, 0.0, 0.0, 0.0)
    slopes = _slopes(above, places, moved, free)
    off = np.random.default_rng(5).standard_normal(len(places))
    off -= slopes @ np.linalg.lstsq(slopes, off, rcond=None)[0]  # what no frame explains
    off *= off_mm / np.sqrt(np.mean(off**2))
    lie = _found(finger, above, places, moved, off)
    assert lie.residual_mm == pytest.approx(off_mm, rel=0.02, abs=0.0003)
    spare = len(places) - len(free)
    s_mm = max(off_mm * np.sqrt(len(places) / spare), LEAST_SD_MM)
    covariance = s_mm**2 * np.linalg.inv(slopes.T @ slopes)
    sd = np.sqrt(np.diag(covariance))
    assert list(lie.sd) == list(lie.value) == [NAMES[i] for i in free]
    assert list(lie.sd.values()) == pytest.approx(sd * student.ppf(0.975, spare) / 2, rel=0.2)
    if not off_mm:  # else it is that of the place found, where roll and tilt are others
        assert lie.correlation == pytest.approx(covariance / np.outer(sd, sd), abs=0.05)


def test_find_corrects_the_position_of_the_configured_frame_and_replaces_its_rotation(
    finger: Fingertip, above: Above
) -> None:
    """Place and height are corrected; a turn of the configured frame is not in the touches, and is told anew."""
    frame = {"pad_centre_x_mm": -20.0, "apex_z_mm": -12.0, "pad_y_mm": -9.0, "roll_deg": 5.0, "tilt_deg": 2.0}
    moved = MOVED
    run = _run(WIDE, _heights(above, WIDE, moved))
    lie = find(run, Config.model_validate({"frame": frame}), finger)
    expected = np.array([-20.0, -12.0, -9.0, 0.0, 0.0]) + moved
    assert list(lie.value.values())[:3] == pytest.approx(expected[:3], abs=0.01)
    assert list(lie.value.values())[3:] == pytest.approx([0.0, 0.0], abs=0.15)


@pytest.mark.parametrize(
    ("places", "enough"),
    [
        ([(x, 0.0) for x in (-2.0, 0.0, 1.0, 2.0)], False),
        ([(x, 0.0) for x in (-2.0, -1.0, 0.0, 1.0, 2.0)], True),
        ([(x, a) for x in (-2.0, 0.0, 2.0) for a in (-1.0, 1.0)], False),
        ([(0.5, a / 4) for a in range(-6, 7)], False),
    ],
    ids=["4 across", "5 across", "6 over the pad", "13 at one x"],
)
def test_find_needs_two_touches_more_than_unknowns(
    finger: Fingertip, above: Above, places: Places, enough: bool
) -> None:
    run = _run(places, _heights(above, places, (0.0,) * 5))
    if enough:
        assert find(run, Config(), finger).touches == len(places)
        return
    with raises(BadInputError, "too_few_touches", path="here", touches=len(places)):
        find(run, Config(), finger)


@pytest.mark.parametrize("indentors", [[], ["bar:3.0"], ["sphere:2", "sphere:3"], ["flat:2"]], ids=str)
def test_find_refuses_touches_made_with_anything_but_one_sphere(finger: Fingertip, indentors: list[str]) -> None:
    runs = [_run([(0.0, 0.0)] * 9, [0.0] * 9, indentor).stream("find") for indentor in indentors]
    run = SimpleNamespace(stream=lambda name: [e for r in runs for e in r], folder=SimpleNamespace(path="here"))
    with raises(BadInputError, "not_one_sphere", path="here"):
        find(run, Config(), finger)


def test_find_uses_touches_on_the_flank_and_tolerates_one_beside_the_finger(finger: Fingertip, above: Above) -> None:
    """At x = ± 5 the skin is steep; at 40 there is none, and a sphere its radius below the apex is not off."""
    moved = (0.0,) * 5
    places = [*WIDE, (-5.0, 0.0), (5.0, 0.0)]
    heights = [*_heights(above, places, moved), -RADIUS_MM]
    lie = find(_run([*places, (40.0, 0.0)], heights), Config(), finger)
    assert lie.touches == 12
    assert lie.residual_mm < 0.0003


# --- on the virtual bench ---


def test_find_locates_a_displaced_and_rotated_finger_by_nine_touches(finger: Fingertip, tmp_path: Path) -> None:
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
    off = np.array(list(lie.value.values())) - FRAME - list(TRUTH.values())
    assert np.all(np.abs(off) < 3 * np.array(list(lie.sd.values()))), "twice the standard deviation holds 95 %"
    assert lie.residual_mm < 0.01


# --- the turned finger itself ---


def test_a_rotation_by_90_degrees_maps_a_pose_as_calculated_on_paper() -> None:
    """Roll 90°: +x of the machine is −y of the finger, its +y is +x. A sphere over the apex lies beside it."""
    seen = Turn(roll_deg=90.0).seen_from_finger(Pose(0.0, 1.0, 0.5), 2.0)
    assert (seen.x_mm, seen.above_apex_mm, seen.along_mm) == pytest.approx((3.0, -2.0, 0.5))
    tilted = Turn(tilt_deg=90.0).seen_from_finger(Pose(0.0, 1.0, 0.5), 2.0)
    assert (tilted.x_mm, tilted.above_apex_mm, tilted.along_mm) == pytest.approx((0.0, -1.5, -3.0))


def test_only_a_sphere_presses_a_turned_finger(finger: Fingertip) -> None:
    with raises(ModelRangeError, "turned_finger", indentor="bar:3.0"):
        PressedFinger(finger, "bar:3.0", Truth(turn=Turn(roll_deg=2.0)))
