"""What a guard makes of forces while a person moves the stage: gwt by gwt, with nothing that moves."""

import math
from typing import Any

import pytest

from rig.devices.base import ForceOverload, ForceReading
from rig.engine.motion import InterruptedMotionError
from rig.engine.sensing import MotionForce, NoReadingError, Sensing
from rig.errors import LimitError
from rig.manual.guard import Guard
from rig.settings import RigSettings
from rig.units import GWT_N
from tests.error_codes import has_code, raises

TOUCH_GWT, STEP_MM = 0.05, 0.05
SOFT_GWT = 2.0 / GWT_N


class Told:
    """A sensing that shows what it is told, counts from what it is given, and may have nothing to say."""

    touch_gwt, resolution_gwt, zeroed = TOUCH_GWT, 0.01, True

    def __init__(self) -> None:
        self.gwt, self.ways, self.zero_of = 0.0, list[bool](), list[float]()
        self.absolute = True
        self.error: NoReadingError | None = None

    def settled(self) -> ForceReading:
        if self.error:
            raise self.error
        return ForceReading(self.gwt * GWT_N, True, 0.0)

    raw = settled

    def read_in_motion(self, begun: MotionForce) -> ForceReading:
        return self.settled()

    def begin_motion(self, *, away: bool) -> MotionForce:
        self.ways.append(away)
        return MotionForce(away=away, before_gwt=math.inf if self.error else self.gwt)

    unloads = Sensing.unloads

    def take_zero(self, readings_gwt: list[float], *, provisional: bool) -> None:
        self.zero_of, self.zeroed, self.absolute = readings_gwt, True, not provisional


class Feeling:
    """A guard, told force by force."""

    def __init__(self, **limits: Any) -> None:
        self.told = Told()
        self.guard = Guard(RigSettings.model_validate({"limits": limits}), self.told)  # type: ignore[arg-type]

    def begin(self, gwt: float, way: str) -> "Feeling":
        self.told.gwt = gwt
        self.guard.begin(up=way == "up", down=way == "down")
        return self

    def rest(self, gwt: float, z_mm: float = -1.0, step_mm: float = STEP_MM) -> str:
        """The code of what ends the motion at a rest, or nothing."""
        self.told.gwt = gwt
        return self._ended(lambda: self.guard.rest(z_mm, step_mm))

    def glance(self, gwt: float, z_mm: float = -1.0) -> str:
        self.told.gwt = gwt
        return self._ended(lambda: self.guard.glance(z_mm))

    def _ended(self, act: Any) -> str:
        try:
            act()
        except InterruptedMotionError as felt:
            self.felt = felt
            return felt.code
        return ""


@pytest.mark.parametrize("air_gwt", [0.0, 3.0, -3.0])
@pytest.mark.parametrize("look", ["rest", "glance"])
def test_a_touch_is_so_much_more_than_before_the_motion(air_gwt: float, look: str) -> None:
    for more_gwt, touched in ((0.04, False), (0.051, True)):
        feeling = Feeling().begin(air_gwt, "down")
        assert getattr(feeling, look)(air_gwt + more_gwt) == ("touched" if touched else "")
        if touched:
            has_code(feeling.felt, "touched", more_gwt=pytest.approx(more_gwt))
        assert feeling.guard.force_gwt == pytest.approx(air_gwt + more_gwt)


@pytest.mark.parametrize(("between", "again"), [("down", False), ("up", True), ("aside", True)])
def test_a_touch_is_told_once_until_it_goes_another_way(between: str, again: bool) -> None:
    feeling = Feeling().begin(0.0, "down")
    assert feeling.rest(0.2)
    feeling.begin(0.2, "down")
    assert feeling.rest(0.4, -1.05) == ""
    feeling.begin(0.3, between).begin(0.3, "down")
    assert bool(feeling.rest(0.4, -1.1)) is again


def test_less_than_before_a_motion_is_a_sensor_that_reads_backwards() -> None:
    feeling = Feeling().begin(1.0, "down")
    assert feeling.rest(0.96) == ""
    assert feeling.rest(0.94) == "reads_backwards"
    has_code(feeling.felt, "reads_backwards", force_gwt=0.94)


def test_the_room_left_is_nine_tenths_of_the_soft_trip_at_the_last_stiffness() -> None:
    feeling = Feeling().begin(0.0, "down")
    assert feeling.guard.room_mm == math.inf
    feeling.rest(0.004)  # less than half a step of the sensor tells nothing
    assert feeling.guard.room_mm == math.inf
    feeling.rest(0.024)
    assert feeling.guard.room_mm == pytest.approx((0.9 * SOFT_GWT - 0.024) / (0.02 / STEP_MM))
    feeling.rest(0.02)
    assert feeling.guard.room_mm == pytest.approx((0.9 * SOFT_GWT - 0.02) / (0.02 / STEP_MM))
    feeling.begin(0.0, "up").begin(0.0, "down")
    assert feeling.guard.room_mm == math.inf


def test_a_rest_without_a_step_tells_no_stiffness() -> None:
    """A key pressed and let go at once."""
    feeling = Feeling().begin(0.0, "down")
    assert feeling.rest(0.03, step_mm=0.0) == ""
    assert feeling.guard.room_mm == math.inf


def test_there_is_no_room_beyond_it() -> None:
    feeling = Feeling(soft_trip_n=1.0 * GWT_N).begin(0.0, "down")
    feeling.rest(0.95)
    assert feeling.guard.room_mm == 0.0


@pytest.mark.parametrize(("z_mm", "lost"), [(-1.09, False), (-1.12, True)])
def test_two_increments_below_a_touch_the_finger_is_felt(z_mm: float, lost: bool) -> None:
    feeling = Feeling().begin(0.0, "down")
    feeling.rest(0.2)
    feeling.begin(0.0, "down")
    assert feeling.rest(0.04, z_mm) == ("lost_finger" if lost else "")
    if lost:
        has_code(feeling.felt, "lost_finger", force_gwt=0.04, below_mm=-1.0 - z_mm)
    assert feeling.rest(0.06, z_mm) == ""


@pytest.mark.parametrize(("first", "frozen_at"), [("rest", 3), ("glance", 3)])
def test_the_same_force_for_three_steps_is_a_frozen_reading(first: str, frozen_at: int) -> None:
    """The touch had 0.2 gwt in a step of 0.05 mm, or was felt in motion: then a touch's force in an increment."""
    feeling = Feeling().begin(0.0, "down")
    assert getattr(feeling, first)(0.2)
    feeling.begin(0.2, "down")
    said = [feeling.rest(0.2, -1.0 - k * STEP_MM) for k in range(1, 4)]
    assert said == ["frozen" if k >= frozen_at else "" for k in range(1, 4)]
    has_code(feeling.felt, "frozen", force_gwt=0.2)
    feeling.begin(0.2, "down")
    assert [feeling.rest(0.2) for _ in range(2)] == ["", ""], "a new motion counts anew"


@pytest.mark.parametrize(("first", "frozen_at"), [("rest", 4), ("glance", 13)])
def test_small_steps_are_to_have_shown_five_steps_of_the_sensor(first: str, frozen_at: int) -> None:
    """0.004 mm at 4 gwt/mm, 0.016 gwt each, or at 1 gwt/mm: more than 0.05 gwt together."""
    feeling = Feeling().begin(0.0, "down")
    assert getattr(feeling, first)(0.2)
    feeling.begin(0.2, "down")
    said = [feeling.rest(0.2, -1.0 - k * 0.004, 0.004) for k in range(1, frozen_at + 1)]
    assert said == ["frozen" if k == frozen_at else "" for k in range(1, frozen_at + 1)]


def test_before_a_touch_nothing_need_change() -> None:
    feeling = Feeling().begin(0.0, "down")
    assert [feeling.rest(0.0) for _ in range(20)] == [""] * 20


@pytest.mark.parametrize("way", ["down", "aside"])
@pytest.mark.parametrize("sign", [1, -1])
def test_above_a_trip_only_up(way: str, sign: int) -> None:
    with raises(LimitError, "soft_trip", force_gwt=sign * 210.0, limit_gwt=SOFT_GWT):
        Feeling().begin(sign * 210.0, way)
    feeling = Feeling().begin(sign * 210.0, "up")
    assert feeling.guard.above_trip is not None
    has_code(feeling.guard.above_trip, "soft_trip")
    Feeling().begin(sign * 200.0, way)


@pytest.mark.parametrize("sign", [1, -1])
def test_up_only_a_force_that_grows_beyond_a_trip_ends_it(sign: int) -> None:
    feeling = Feeling().begin(sign * 300.0, "up")
    assert feeling.glance(sign * 300.04) == ""
    assert feeling.glance(sign * 300.06) == "soft_trip"
    feeling = Feeling().begin(0.0, "up")
    assert feeling.glance(sign * 200.0) == ""
    assert feeling.glance(sign * 210.0) == "soft_trip"
    assert feeling.glance(sign * 520.0) == "hard_trip"


@pytest.mark.parametrize("look", ["rest", "glance"])
def test_a_trip_ends_every_other_way(look: str) -> None:
    feeling = Feeling().begin(190.0, "aside" if look == "glance" else "down")
    assert getattr(feeling, look)(204.5) == "soft_trip"
    assert feeling.guard.above_trip


SILENT, OVER = NoReadingError("silent", "silent"), NoReadingError("over", "over")
OVER.__cause__ = ForceOverload("over")


@pytest.mark.parametrize(("way", "error", "moves"), [
    ("up", OVER, True), ("up", SILENT, False), ("down", OVER, False), ("aside", OVER, False),
    ("aside", SILENT, False),
])  # fmt: skip
def test_what_is_not_felt_moves_nothing_but_up_from_beyond_the_range(
    way: str, error: NoReadingError, moves: bool
) -> None:
    feeling = Feeling()
    feeling.told.error = error
    if moves:
        feeling.begin(0.0, way)
        assert feeling.guard.force_gwt is None
        assert feeling.guard.above_trip is None
        feeling.told.error = None
        assert feeling.glance(400.0) == "", "it began beyond any force"
    else:
        with raises(LimitError, error.code):
            feeling.begin(0.0, way)


def test_a_sensor_that_falls_silent_ends_all_but_the_way_up() -> None:
    for way, look, ended in (("up", "glance", ""), ("aside", "glance", "silent"), ("down", "rest", "silent")):
        feeling = Feeling().begin(1.0, way)
        feeling.told.error = SILENT
        assert getattr(feeling, look)(1.0) == ended
        assert feeling.guard.force_gwt is None
        feeling.guard.look()
        assert feeling.guard.force_gwt is None


def test_after_a_way_out_of_range_a_touch_is_told_again() -> None:
    feeling = Feeling().begin(0.0, "down")
    feeling.rest(0.2)
    feeling.told.error = OVER
    feeling.begin(0.0, "up")
    feeling.told.error = None
    feeling.begin(0.0, "down")
    assert feeling.rest(0.2)


def test_without_a_zero_twelve_readings_are_taken_for_it_and_the_way_up_is_told() -> None:
    feeling = Feeling()
    feeling.told.zeroed = False  # type: ignore[misc]
    feeling.begin(80.0, "up").begin(80.0, "down")
    assert feeling.told.zero_of == pytest.approx([80.0] * 12)
    assert feeling.told.ways == [True, False]
    feeling.told.zero_of = []
    feeling.begin(0.0, "down")
    assert feeling.told.zero_of == []


def test_a_look_between_motions_shows_what_is_felt() -> None:
    feeling = Feeling().begin(0.0, "down")
    feeling.told.gwt = 7.0
    feeling.guard.look()
    assert feeling.guard.force_gwt == pytest.approx(7.0)
    feeling.told.error = SILENT
    feeling.guard.look()
    assert feeling.guard.force_gwt is None
