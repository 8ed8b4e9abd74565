"""Each check of a script's step at its limit: what is just allowed, and what is just refused."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import pytest

from rig.errors import BadInputError
from rig.protocol import check
from rig.records import PlannedIndentation, PredictionBand, PressId, Target
from rig.settings import SLOWEST_MM_S, ZERO_LIFT_MM, RigSettings
from rig.units import GWT_N
from tests.error_codes import raises
from tests.rig.script_walk import StandIn

SETTINGS = RigSettings()
LIMITS = SETTINGS.limits
TRAVEL_MM, FRAME = SETTINGS.stage.travel_mm, SETTINGS.frame
ZABER = RigSettings.model_validate({"stage": {"kind": "zaber"}})
COMPLIANCE = {"value": 1.0, "date": "2026-01-01", "expires": "2036-01-01"}
SOFT = RigSettings.model_validate({"limits": {"max_force_gwt": 500.0, "soft_trip_n": 2.0, "hard_trip_n": 5.0}})
GIVES = RigSettings.model_validate({"calibration": {"compliance_mm_per_n": COMPLIANCE}})
ROOM_MM, SOFT_ROOM_MM = (FRAME.apex_z_mm - bench.bounds.lowest_z_mm for bench in (SETTINGS, GIVES))
"""Below the nominal apex, down to the floor."""


def planned(doi_mm: float = 0.5, force_gwt: float = 5.0, area_mm2: float = 40.0, **more: Any) -> PlannedIndentation:
    return PlannedIndentation(
        "bar", 0.5, Target("doi_mm", doi_mm), more.pop("contact_mm", 0.0), force_gwt, doi_mm, area_mm2, 0.1,
        increments=1, hold_s=1.0, **more,
    )  # fmt: skip


def _habits(**habits: float) -> RigSettings:
    found = RigSettings()
    return found.model_copy(update={"habits": found.habits.model_copy(update=habits)})


def _speeds(value: float | None, settings: RigSettings = SETTINGS) -> None:
    check.refuse_speeds("indent", value, settings)


def _reach(settings: RigSettings = SETTINGS, **press: Any) -> None:
    check.refuse_reach("indent", planned(**press), settings)


def _target(kind: Any, value: float) -> None:
    check.refuse_target("indent", Target(kind, value), LIMITS)


def _pressure(kpa: float) -> None:
    """Over one mm², so that the quotient is exact."""
    press = planned(force_gwt=kpa / 1000 / GWT_N, area_mm2=1.0)
    check.refuse_pressure("indent", press, LIMITS.model_copy(update={"max_pressure_kpa": PRESSURE_KPA}))


PRESSURE_KPA = planned(force_gwt=40.0 / 1000 / GWT_N, area_mm2=1.0).mean_pressure_kpa

Row = tuple[Callable[[float], object], float | None, float | None, str, Mapping[str, Any]]
"""A check of one number; its lowest and highest allowed values; code and fields of the refusal."""

MEANS = {"verb": "indent", "key": "doi_mm", "x_mm": 0.5}
FASTEST = LIMITS.max_press_speed_mm_s
CHECKS: dict[str, Row] = {
    "seconds": (lambda v: check.refuse_seconds("rest", "seconds", v), 0.0, 3600.0, "outside_range",
                {"verb": "rest", "key": "seconds", "low": 0.0, "high": 3600.0}),
    "a speed": (_speeds, SLOWEST_MM_S, FASTEST, "outside_range",
                {"key": "speed_mm_s", "low": SLOWEST_MM_S, "high": FASTEST}),
    "the speed of a press": (lambda v: _speeds(None, _habits(press_speed_mm_s=v)), SLOWEST_MM_S, FASTEST,
                             "outside_range", {"key": "habits.press_speed_mm_s"}),
    "the speed of an approach": (lambda v: _speeds(1.0, _habits(approach_speed_mm_s=v)), SLOWEST_MM_S, FASTEST,
                                 "outside_range", {"key": "habits.approach_speed_mm_s"}),
    "the speed of a touch": (
        lambda v: check.refuse_approach("find", 0.0, _habits(approach_speed_mm_s=v)), SLOWEST_MM_S, FASTEST,
        "outside_range", {"verb": "find", "key": "habits.approach_speed_mm_s"}),
    "a depth": (lambda v: _target("doi_mm", v), None, LIMITS.max_doi_mm, "beyond_limit",
                {"key": "doi_mm", "limit": "max_doi_mm", "high": LIMITS.max_doi_mm}),
    "a force": (lambda v: _target("force_gwt", v), None, LIMITS.max_force_gwt, "beyond_limit",
                {"key": "force_gwt", "limit": "max_force_gwt", "high": LIMITS.max_force_gwt}),
    "a predicted depth": (lambda v: _reach(doi_mm=v), None, LIMITS.max_doi_mm, "means_beyond_limit",
                          {**MEANS, "limit": "max_doi_mm", "high": LIMITS.max_doi_mm}),
    "a predicted force": (lambda v: _reach(force_gwt=v), None, LIMITS.max_force_gwt, "means_beyond_limit",
                          {**MEANS, "value": 0.5, "limit": "max_force_gwt"}),
    "a predicted force and the trip": (lambda v: _reach(SOFT, force_gwt=v), None, 2.0 / GWT_N * (1 - 1e-12),
                                       "means_beyond_limit", {**MEANS, "limit": "soft_trip_n", "high": 2.0}),
    "a predicted pressure": (_pressure, None, 40.0, "means_beyond_limit",
                             {**MEANS, "limit": "max_pressure_kpa", "area_mm2": 1.0}),
    "the lowest a touch is looked for": (
        lambda v: check.refuse_approach("find", -v, SETTINGS), None, ROOM_MM - LIMITS.search_mm, "below_floor",
        {"axis": "z", "low": SETTINGS.bounds.lowest_z_mm}),
    "the lowest a press looks for a touch": (
        lambda v: _reach(contact_mm=-v), None, ROOM_MM - LIMITS.search_mm, "below_floor", {"axis": "z"}),
    "the lowest a press goes": (
        lambda v: _reach(contact_mm=-v, doi_mm=1.2), None, ROOM_MM - max(1.2, LIMITS.search_mm), "below_floor",
        {"axis": "z"}),
    "the lowest a press goes on a rig that gives": (
        lambda v: _reach(GIVES, contact_mm=-v, doi_mm=1.2, force_gwt=0.5 / GWT_N), None,
        SOFT_ROOM_MM - max(1.7, LIMITS.search_mm), "below_floor", {"axis": "z"}),
    "x of the stage": (lambda v: check.refuse_travel("x", v, SETTINGS), -TRAVEL_MM[0], 0.0, "outside_travel",
                       {"axis": "x", "low": -TRAVEL_MM[0], "high": 0.0}),
    "y of the stage": (lambda v: check.refuse_travel("y", v, SETTINGS), -TRAVEL_MM[1], 0.0, "outside_travel",
                       {"axis": "y", "low": -TRAVEL_MM[1]}),
    "x of a place": (lambda v: check.refuse_place(v, 0.0, SETTINGS), -TRAVEL_MM[0] - FRAME.pad_centre_x_mm,
                     -FRAME.pad_centre_x_mm, "outside_travel", {"axis": "x"}),
    "y of a place": (lambda v: check.refuse_place(0.0, v, SETTINGS), -TRAVEL_MM[1] - FRAME.pad_y_mm,
                     -FRAME.pad_y_mm, "outside_travel", {"axis": "y"}),
    "clearance of a place": (lambda v: check.refuse_place(0.0, 0.0, _habits(clearance_mm=v)), None,
                             -FRAME.apex_z_mm - ZERO_LIFT_MM, "outside_travel", {"axis": "z"}),
    "along the finger": (lambda v: check.refuse_along(v, SETTINGS), *LIMITS.along_mm, "outside_limits",
                         {"verb": "move_to", "key": "along_mm"}),
}  # fmt: skip


@pytest.mark.parametrize("name", CHECKS)
def test_a_number_is_allowed_up_to_its_limits_and_refused_beyond(name: str) -> None:
    ask, low, high, code, fields = CHECKS[name]
    for edge, away in ((low, -1), (high, 1)):
        if edge is None:
            continue
        beside = max(abs(edge), 1.0) * 1e-8
        ask(edge if name.startswith(EXACT) else edge - away * beside)
        with raises(BadInputError, code, **fields):
            ask(edge + away * beside)


EXACT = ("seconds", "a speed", "a depth", "a force", "a predicted depth", "a predicted pressure", "x of the stage",
         "y of the stage", "a frequency", "an amplitude", "along")  # fmt: skip
"""These compare the number itself; others compare a sum."""


def test_a_touch_without_an_area_is_none() -> None:
    for area_mm2 in (0.0, -1.0):
        with raises(BadInputError, "no_contact", value=0.5, **MEANS):
            check.refuse_pressure("indent", planned(area_mm2=area_mm2), LIMITS)
    check.refuse_pressure("indent", planned(force_gwt=1e-9, area_mm2=1e-6), LIMITS)


def test_the_upper_ends_of_the_bands_of_an_identified_finger_are_compared() -> None:
    band = PredictionBand((4.0, 6.0), (0.4, 0.6), 7.0)
    deep = replace(band, doi_mm=(0.4, LIMITS.max_doi_mm + 0.1))
    strong = replace(band, highest_gwt=LIMITS.max_force_gwt + 0.1)
    check.refuse_reach("indent", planned(band=band), SETTINGS)
    for wide, limit in ((deep, "max_doi_mm"), (strong, "max_force_gwt")):
        with raises(BadInputError, "means_beyond_limit", limit=limit):
            check.refuse_reach("indent", planned(band=wide), SETTINGS)


@pytest.mark.parametrize("value", [1, 100])
def test_a_count_is_a_whole_number_up_to_a_hundred(value: int) -> None:
    check.refuse_count("indent", "increments", value)
    for other in (0, 101, -1, True, 1.0, "1", None):
        with raises(BadInputError, "no_count", verb="indent", key="increments", value=other, high=100):
            check.refuse_count("indent", "increments", other)


@pytest.mark.parametrize("value", [True, "1", None, [1.0], 1j])
def test_a_number_is_an_integer_or_a_float(value: Any) -> None:
    for number in (1, 1.5, math.nan):
        check.refuse_no_number("rest", "seconds", number)
    with raises(BadInputError, "no_number", verb="rest", key="seconds", value=value):
        check.refuse_no_number("rest", "seconds", value)
    with raises(BadInputError, "no_number", key="speed_mm_s" if value is not None else "doi_mm"):
        _speeds(value) if value is not None else check.refuse_no_number("indent", "doi_mm", value)
    with raises(BadInputError, "no_number", key="along_mm"):
        check.refuse_along(value, SETTINGS)


def test_a_target_is_one_positive_depth_or_force() -> None:
    assert check.checked_target("indent", 0.5, None) == Target("doi_mm", 0.5)
    assert check.checked_target("indent", None, 3) == Target("force_gwt", 3.0)
    for both in ((None, None), (0.5, 3.0)):
        with raises(BadInputError, "not_one_target", verb="indent"):
            check.checked_target("indent", *both)
    for value in (0.0, -0.5, math.inf, math.nan):
        for key, pair in (("doi_mm", (value, None)), ("force_gwt", (None, value))):
            with raises(BadInputError, "not_positive", key=key):
                check.checked_target("indent", *pair)


def test_a_stage_without_the_axis_stays_in_the_plane_of_the_receptors() -> None:
    plane = RigSettings.model_validate({"stage": {"kind": "leadshine"}})
    check.refuse_along(0.0, plane)
    with raises(BadInputError, "no_such_axis", key="along_mm", value=0.5, kind="leadshine"):
        check.refuse_along(0.5, plane)
    check.refuse_along(0.5, SETTINGS)


def test_the_floor_of_the_bench_counts_for_the_vertical_axis_alone() -> None:
    floor = SETTINGS.bounds.lowest_z_mm
    assert -TRAVEL_MM[2] < floor < 0.0
    for mm in (floor, floor - 5e-10):
        check.refuse_travel("z", mm, SETTINGS)
    for axis in ("x", "y"):
        if floor - 0.1 >= -TRAVEL_MM["xy".index(axis)]:
            check.refuse_travel(axis, floor - 0.1, SETTINGS)  # type: ignore[arg-type]
    with raises(BadInputError, "below_floor", axis="z", low=floor):
        check.refuse_travel("z", floor - 2e-9, SETTINGS)


def test_a_ramp_needs_a_stage_that_makes_it() -> None:
    check.refuse_no_ramps("ramp", SETTINGS.stage)


# --- a walk ---


def test_a_walk_begins_with_nothing_done() -> None:
    walk = check.Walk(SETTINGS, StandIn())
    assert (walk.indentor, walk.homed, walk.zeroed, walk.held_s) == (None, False, False, 0.0)
    assert (math.isnan(walk.x_mm), walk.along_mm, walk.checkpoints) == (True, 0.0, set())
    assert walk.reference_request is None
    assert walk.spot() == check.Spot("", walk.x_mm, 0.0, ())


def test_what_must_come_first_comes_first() -> None:
    walk = check.Walk(SETTINGS, StandIn())
    for before, do in (("mount()", ("indentor", "bar")), ("zero()", ("zeroed", True)), ("move_to()", ("x_mm", 0.0))):
        with raises(BadInputError, "comes_too_early", verb="indent", before=before):
            walk.need_ready("indent")
        setattr(walk, *do)
    walk.need_ready("indent")


def test_holds_are_summed_up_to_the_longest_contact() -> None:
    walk = check.Walk(SETTINGS, StandIn())
    longest_s = LIMITS.max_contact_s
    walk.hold("indent", 0.25 * longest_s)
    walk.hold("indent", 0.75 * longest_s)
    with raises(BadInputError, "held_too_long", verb="indent", held_s=longest_s + 1.0, high=longest_s):
        walk.hold("indent", 1.0)


def test_presses_are_numbered_by_their_purpose() -> None:
    walk = check.Walk(SETTINGS, StandIn())
    walk.indentor, walk.x_mm, walk.along_mm = "bar", 0.5, -1.0
    assert walk.spot("data", 2).ids == (PressId(0), PressId(1))
    assert walk.spot("reference", 1).ids == (PressId(0, "reference"),)
    assert walk.spot("data", 1, {"trial": 3}) == check.Spot("bar", 0.5, -1.0, (PressId(2, "data", {"trial": 3}),))
    assert walk.spot("data").ids == ()
