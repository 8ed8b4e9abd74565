"""Each layer of force, the time of contact, and which heights are refused: numbers by hand from the settings.

1 gwt is 9.80665 mN: 2 N are 203.943 gwt, 5 N are 509.858 gwt. Clearance is 2 mm, an increment 0.05 mm, the apex 25 mm
below the top of a travel of 40 mm.
"""

import math
from collections.abc import Callable
from typing import Any

import pytest

from rig.engine import LimitError, TripError
from rig.engine.limits import (
    ContactTime,
    FingerStiffness,
    TouchLimit,
    Trips,
    late_reading_s,
    refuse_height,
    trip_height_mm,
)
from rig.records import PlannedIndentation, Target
from rig.settings import SLOWEST_MM_S, LimitSettings, RigSettings
from rig.units import GWT_N
from sim.devices.clock import VirtualClock
from tests.error_codes import has_code, raises

SETTINGS = RigSettings()


def _settings(**tables: Any) -> RigSettings:
    return RigSettings.model_validate(tables)


# --- forces ---


@pytest.mark.parametrize(
    ("plan_n", "soft_gwt"), [(None, 203.943), (0.5, 50.986), (2.5, 203.943)], ids=["no plan", "lower", "higher"]
)
def test_a_plan_only_lowers_the_soft_trip_and_leaves_the_hard_one(plan_n: float | None, soft_gwt: float) -> None:
    trips = Trips(LimitSettings(), plan_n)
    assert (trips.soft_gwt, trips.hard_gwt) == pytest.approx((soft_gwt, 509.858), abs=1e-3)
    assert (trips.lowest_gwt, trips.lowest) == (trips.soft_gwt, "soft trip")  # nothing is pressed on yet


@pytest.mark.parametrize(
    ("area_mm2", "lowest_gwt", "name"),
    [(10.0, 203.943, "soft trip"), (5.0, 152.957, "pressure limit"), (0.1, 3.05915, "pressure limit")],
)
def test_the_lowest_trip_of_a_press_is_the_soft_trip_or_the_pressure_limit(
    area_mm2: float, lowest_gwt: float, name: str
) -> None:
    """300 kPa over 10 mm² are 3 N, more than the soft trip; over 5 mm² 1.5 N, less."""
    trips = Trips(LimitSettings(), None)
    trips.press_on(area_mm2)
    assert trips.lowest_gwt == pytest.approx(lowest_gwt, rel=1e-5)
    assert trips.lowest == name
    trips.press_on(math.inf)
    assert trips.lowest_gwt == pytest.approx(203.943, rel=1e-5)


@pytest.mark.parametrize("sign", [1, -1])
def test_each_trip_acts_on_push_and_pull_alike(sign: int) -> None:
    trips = Trips(LimitSettings(), None)
    _passes(trips.passed, sign, 203.9, 204.0, "soft_trip", 2.0 / GWT_N)
    trips.press_on(5.0)
    _passes(trips.passed, sign, 152.9, 153.0, "pressure_limit", 1.5 / GWT_N)
    _passes(trips.passed_hard, sign, 509.8, 510.0, "hard_trip", 5.0 / GWT_N)


def _passes(
    passed: Callable[[float], TripError | None], sign: int, below: float, above: float, code: str, limit_gwt: float
) -> None:
    for force_gwt in (0.0, 100.0, below):
        assert passed(sign * force_gwt) is None
    found = passed(sign * above)
    assert found is not None
    has_code(found, code, force_gwt=sign * above, limit_gwt=limit_gwt)


@pytest.mark.parametrize("gwt_at_1_mm", [6.0, 40.0, 400.0, 4000.0])
@pytest.mark.parametrize("trip_gwt", [2.0, 16.0, 204.0])
def test_the_speed_of_a_move_sideways_keeps_a_collision_below_half_the_trip(
    trip_gwt: float, gwt_at_1_mm: float
) -> None:
    """Never faster than it travels, nor slower than any stage goes."""
    limit = TouchLimit.of(SETTINGS, trip_gwt, 0.05, FingerStiffness(gwt_at_1_mm))
    assert SLOWEST_MM_S <= limit.speed_mm_s <= SETTINGS.habits.travel_speed_mm_s
    if limit.speed_mm_s == SETTINGS.habits.travel_speed_mm_s:
        assert limit.force_gwt < trip_gwt / 2
    elif limit.speed_mm_s > SLOWEST_MM_S:
        assert limit.force_gwt == pytest.approx(trip_gwt / 2)
    assert limit.force_gwt == pytest.approx(gwt_at_1_mm * limit.in_contact_mm**1.5)


@pytest.mark.parametrize("latency_s", [0.0, 0.2])
@pytest.mark.parametrize("trip_gwt", [16.0, 204.0])
def test_the_way_of_a_move_sideways_in_contact_is_the_touch_and_the_stop(latency_s: float, trip_gwt: float) -> None:
    """After the touch threshold: sensor, two samples and a look unread (0.2 s), controller (0.11 s), 250 mm/s²."""
    settings = _settings(force={"latency_s": latency_s}, stage={"acceleration_mm_s2": 250.0})
    limit = TouchLimit.of(settings, trip_gwt, 0.05, FingerStiffness(400.0))
    touch_mm, v = (0.05 / 400.0) ** (2 / 3), limit.speed_mm_s
    assert limit.in_contact_mm == pytest.approx(touch_mm + v * (latency_s + 0.2 + 0.11) + v**2 / 500.0)


def test_the_stiffness_of_a_finger_is_that_of_its_stiffest_press() -> None:
    """40 gwt at 1 mm where nothing is predicted."""
    presses = [
        PlannedIndentation(
            "bar", 0.0, Target("doi_mm", doi_mm), 0.0, gwt, doi_mm, 40.0, 0.1, increments=1, hold_s=1.0
        )
        for gwt, doi_mm in ((8.0, 1.0), (4.0, 0.25), (1.0, 0.5))
    ]
    assert FingerStiffness.of(presses).gwt_at_1_mm == pytest.approx(4.0 / 0.25**1.5)
    assert FingerStiffness.of([]).gwt_at_1_mm == 40.0
    assert FingerStiffness(32.0).depth_mm(4.0) == pytest.approx(0.25)


def test_a_reading_of_a_move_sideways_is_late_after_two_samples_and_one_poll() -> None:
    assert late_reading_s(SETTINGS) == pytest.approx(2 * 0.05 + 0.1)


# --- the time of contact ---


def _contact(before_s: float | None = None, longest_s: float = 3600.0) -> tuple[VirtualClock, ContactTime]:
    clock = VirtualClock(1.7e9, 100.0)
    limits = LimitSettings(max_contact_s=longest_s)
    return clock, ContactTime(clock, limits) if before_s is None else ContactTime(clock, limits, before_s)


@pytest.mark.parametrize("before_s", [None, 12.5])
def test_contact_time_adds_up_over_touches_and_parts_of_a_run(before_s: float | None) -> None:
    clock, contact = _contact(before_s)
    start_s = before_s or 0.0
    clock.wait_s(7.0)  # in the air
    assert contact.total_s == start_s
    contact.begin()
    clock.wait_s(2.0)
    contact.begin()  # the next reading of the same touch
    clock.wait_s(1.0)
    assert contact.total_s == start_s + 3.0
    contact.end()
    clock.wait_s(7.0)
    assert contact.total_s == start_s + 3.0
    contact.begin()
    clock.wait_s(0.25)
    assert contact.total_s == start_s + 3.25


def test_contact_beyond_the_longest_contact_time_is_refused() -> None:
    clock, contact = _contact(longest_s=10.0)
    contact.begin()
    clock.wait_s(9.9)
    contact.refuse_more()
    clock.wait_s(0.2)
    with raises(LimitError, "contact_time", contact_s=pytest.approx(10.1), limit_s=10.0):
        contact.refuse_more()


# --- where a trip lifts to ---


@pytest.mark.parametrize(
    ("on_trip", "from_mm", "to_mm"),
    [
        ("retract", -1.0, 2.0),
        ("retract", 1.97, 2.0),
        ("retract", 1.985, 10.0),  # at clearance, and clearance is not clear
        ("retract", 2.01, 10.0),
        ("retract", 3.0, 10.0),
        ("retract", 9.0, 11.0),  # a clearance farther
        ("retract", 15.0, 17.0),
        ("retract", 24.0, 25.0),  # the top of the travel
        ("park", -1.0, 10.0),
        ("park", 1.97, 10.0),
        ("park", 9.0, 11.0),
    ],
)
def test_a_trip_lifts_to_the_height_that_on_trip_configures(on_trip: str, from_mm: float, to_mm: float) -> None:
    assert trip_height_mm(_settings(limits={"on_trip": on_trip}), from_mm) == pytest.approx(to_mm)


# --- heights ---


@pytest.mark.parametrize(
    ("from_mm", "to_mm", "speed_mm_s"),
    [
        (10.0, 2.0, 10.0),  # to clearance, as fast as it travels
        (10.0, 3.0, 10.0),
        (10.0, 1.95, 5.0),  # past clearance by an increment
        (2.0, 2.0 - 0.05, 5.0),
        (1.0, 1.0 - 0.05, 0.5),
        (-1.0, -1.0 - 0.05, 0.5),
        (1.0, 1.5, 10.0),  # up it may as fast as it travels
        (-1.0, 25.0, 10.0),  # to the top of the travel
        (-3.55, -3.6, 0.5),  # to the floor: limits.fall_mm, search_mm and max_doi_mm below the apex
    ],
)
def test_vertical_moves_within_length_speed_and_travel_limits_are_accepted(
    from_mm: float, to_mm: float, speed_mm_s: float
) -> None:
    refuse_height(SETTINGS, from_mm, to_mm, speed_mm_s)


@pytest.mark.parametrize(
    ("from_mm", "to_mm", "speed_mm_s", "code", "fields"),
    [
        (10.0, 1.949, 0.5, "longer_than_an_increment", {"to_mm": 1.949}),
        (2.0, 1.949, 0.5, "longer_than_an_increment", {"to_mm": 1.949}),
        (1.0, 0.949, 0.5, "longer_than_an_increment", {"to_mm": 0.949}),
        (10.0, 1.96, 5.1, "too_fast", {"speed_mm_s": 5.1, "limit_mm_s": 5.0}),
        (1.0, 0.96, 5.1, "too_fast", {"speed_mm_s": 5.1, "limit_mm_s": 5.0}),
        (2.0, 25.001, 0.5, "outside_travel", {"z_mm": pytest.approx(0.001), "lowest_mm": -40.0}),
        (-3.6, -3.601, 0.5, "below_floor", {"z_mm": -28.601, "floor_mm": -28.6}),
    ],
)
def test_vertical_moves_beyond_length_speed_or_travel_limits_are_refused(
    from_mm: float, to_mm: float, speed_mm_s: float, code: str, fields: dict[str, Any]
) -> None:
    with raises(LimitError, code, **fields):
        refuse_height(SETTINGS, from_mm, to_mm, speed_mm_s)


def test_vertical_moves_are_limited_by_the_travel_of_the_z_axis() -> None:
    settings = _settings(stage={"travel_mm": (1.0, 2.0, 30.0)}, frame={"apex_z_mm": -28.0})
    refuse_height(settings, 2.0, 28.0, 0.5)
    refuse_height(settings, -1.95, -2.0, 0.5)
    for from_mm, to_mm in ((2.0, 28.01), (-2.0, -2.01)):
        with raises(LimitError, "outside_travel", z_mm=to_mm - 28.0, lowest_mm=-30.0):
            refuse_height(settings, from_mm, to_mm, 0.5)
