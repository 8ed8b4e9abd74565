"""A finger of Ogden's tissue under a bench: its linear twin's forces times what the kept references found."""

import numpy as np
import pytest

from rig.identify.adaptive_presses import SHAPES as PRESSED
from sim.carriage import Pose
from sim.contact.shapes import parse_shape
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.models.relaxation import PronyTerm
from sim.plant import RelaxingPress
from studies.identification.ogden import OgdenFinger, factor, references
from studies.identification.proof import GOALS

BAR = parse_shape("bar:3.0")
ROWS = references()
RATIOS = {(row["shape"], row["doi_mm"]): row["force"] / row["linear"] for row in ROWS}


def test_the_ogden_references_cover_every_pressed_and_requested_depth() -> None:
    deepest_mm = {row["shape"]: row["doi_mm"] for row in ROWS}
    assert {(row["alpha"], row["x_mm"]) for row in ROWS} == {(9.78, 0.0)}
    assert all(deepest_mm[goal.indentor] >= goal.doi_mm for goal in GOALS)
    assert all(deepest_mm[shape] > 1 for shape in PRESSED)


def test_the_ogden_factor_is_that_of_the_references_and_begins_at_one() -> None:
    for (shape, depth_mm), ratio in RATIOS.items():
        assert factor(parse_shape(shape), depth_mm) == pytest.approx(ratio, rel=1e-12)
    assert factor(BAR, 0.0) == 1.0
    for depth_mm in (0.05, 0.45, 0.85):
        low, high = sorted(factor(BAR, depth_mm + way) for way in (-0.05, 0.05))
        assert low < factor(BAR, depth_mm) < high


def test_the_ogden_factor_continues_straight_below_the_deepest_reference() -> None:
    once, twice, thrice = (np.log(factor(BAR, depth_mm)) for depth_mm in (1.1, 1.2, 1.3))
    assert thrice - twice == pytest.approx(twice - once, rel=1e-9)
    assert twice - once > 0.05


def test_an_ogden_finger_has_the_linear_force_times_the_factor(finger: Fingertip) -> None:
    ogden = OgdenFinger.load(finger.config)
    expected = factor(BAR, 0.4)
    assert abs(expected - 1) > 0.1
    pressed = [one.indent("bar:3.0", 0.3, doi_mm=0.4).force_n for one in (ogden, finger)]
    assert pressed[0] == pytest.approx(expected * pressed[1], rel=1e-9)
    at = Pose(0.3, finger.touch_height_mm("bar:3.0", 0.3) - finger.apex_height_mm - 0.4)
    held = []
    for one in (ogden, finger):
        press = RelaxingPress(one, "bar:3.0", (PronyTerm(0.3, 0.5),))
        held.append([press.moved_to(at, step_s) for step_s in (0.1, 0.4)])
    # Its skin is held by what tissue of its own has borne: alike while the depth, and with it the factor, stays.
    assert held[0] == pytest.approx([expected * force_n for force_n in held[1]], rel=1e-6)
    assert held[0][1] < held[0][0]


def test_an_ogden_finger_refuses_a_shape_without_references(finger: Fingertip) -> None:
    ogden = OgdenFinger.load(finger.config)
    with pytest.raises(ModelRangeError, match="flat:2: no references"):
        ogden.indent("flat:2", doi_mm=0.2)
