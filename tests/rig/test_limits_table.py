"""One table of limits: what lies in range is accepted, what does not is refused, wherever the limit itself is set."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from rig.engine.limits import refuse_height
from rig.errors import BadInputError, LimitError
from rig.plan.config import Config
from rig.protocol import Rig, check
from rig.records import PlannedIndentation, PredictionBand, Target
from rig.settings import SLOWEST_MM_S, RigSettings
from rig.units import GWT_N
from tests.error_codes import has_code, raises
from tests.rig.script_state import StandIn, ready, refused, walked

Tables = dict[str, dict[str, Any]]
Range = tuple[float, float]
NO_NUMBERS = (math.nan, math.inf, -math.inf)
few = settings(max_examples=10, deadline=None)


def _span(low: float, high: float) -> tuple[float, float, float]:
    """Both ends, or one made up where a side is open, and what lies between."""
    width = high - low if math.isfinite(high - low) else 10.0
    return (low if math.isfinite(low) else high - width), (high if math.isfinite(high) else low + width), width


def _edges(low: float, high: float) -> list[float]:
    """The ends, what lies just on either side of them, and what is no number."""
    near, far, width = _span(low, high)
    ends = (float(near), float(far))
    beside = [math.nextafter(end, way) for end in ends for way in (-math.inf, math.inf)]
    beside += [end + way * by for end in ends for way in (-1, 1) for by in (1e-6 * width, 1e-3 * width, 1.0)]
    return [*ends, *beside, 0.0, *NO_NUMBERS]


def _about(low: float, high: float) -> st.SearchStrategy[float]:
    """Within and beyond."""
    near, far, width = _span(low, high)
    return st.floats(near - width, far + width)


# --- pairs of keys of the configuration ---


RELATED: Mapping[str, tuple[Range, Callable[[float, float], Tables], Callable[[float, float], bool]]] = {
    "limits.x_mm": ((-9, 9), lambda a, b: {"limits": {"x_mm": [a, b]}}, lambda a, b: a < b),
    "limits.along_mm": ((-9, 9), lambda a, b: {"limits": {"along_mm": [a, b]}}, lambda a, b: a <= 0 <= b),
    "limits.soft_trip_n, limits.hard_trip_n": (
        (0.01, 5), lambda a, b: {"limits": {"soft_trip_n": a, "hard_trip_n": b}}, lambda a, b: a <= b),
    "habits.touch_increment_mm, habits.increment_mm": (
        (0.001, 0.05), lambda a, b: {"habits": {"touch_increment_mm": a, "increment_mm": b}}, lambda a, b: a <= b),
    "habits.press_speed_mm_s, limits.max_press_speed_mm_s": (
        (0.6, 5), lambda a, b: {"habits": {"press_speed_mm_s": a}, "limits": {"max_press_speed_mm_s": b}},
        lambda a, b: a <= b),
    "habits.approach_speed_mm_s, limits.max_press_speed_mm_s": (
        (0.02, 2),
        lambda a, b: {"habits": {"approach_speed_mm_s": a, "press_speed_mm_s": min(b, 1.0)},
                      "limits": {"max_press_speed_mm_s": b}},
        lambda a, b: a <= b),
}  # fmt: skip
"""Pairs of keys that are accepted together or not: where they lie, the tables, and when they are accepted."""


@pytest.mark.parametrize("name", RELATED)
@few
@given(data=st.data())
def test_two_related_keys_are_accepted_exactly_where_they_agree(name: str, data: st.DataObject) -> None:
    ends, tables, agree = RELATED[name]
    first = data.draw(st.floats(*ends))
    second = data.draw(st.floats(*ends) | st.just(first))
    try:
        Config.model_validate(tables(first, second))
    except ValidationError:
        assert not agree(first, second)
    else:
        assert agree(first, second)


# --- what a script asks for ---


@dataclass(frozen=True)
class Asked:
    """A number of a script and the limit it is held to.

    limit: between what it is set, with the tables of the configuration that set it. ask: the verb with the number.
    range: from where to where the number is accepted under a limit; open_below: the lower end itself is not.
    """

    limit: Range
    tables: Callable[[float], Tables]
    ask: Callable[[Rig, float], object]
    range: Callable[[float], Range]
    finger: Callable[[float], StandIn] = lambda value: StandIn()
    open_below: bool = False


STIFF = StandIn(gwt_mm=1e3)
STRONG = {"soft_trip_n": 5.0, "hard_trip_n": 5.0, "max_pressure_kpa": 600.0, "max_force_gwt": 500.0}
FAR = {"x_mm": [-50.0, 50.0], "along_mm": [-50.0, 50.0]}


def _limits(**keys: float | list[float]) -> Tables:
    return {"limits": keys}


def _strong(**keys: float) -> Tables:
    return {"limits": {**STRONG, **keys}}


ASKED: Mapping[str, Asked] = {
    "move_to: x_mm": Asked(
        (0.1, 12), lambda limit: _limits(x_mm=[-limit, limit / 2]), lambda rig, x_mm: ready(rig).move_to(x_mm=x_mm),
        lambda limit: (-limit, limit / 2)),
    "move_to: along_mm": Asked(
        (0.1, 8), lambda limit: _limits(along_mm=[-limit, limit / 2]),
        lambda rig, along_mm: ready(rig).move_to(x_mm=0, along_mm=along_mm), lambda limit: (-limit, limit / 2)),
    "move_to: x_mm within the travel": Asked(
        (40, 80), lambda limit: {"stage": {"travel_mm": [limit, 30.0, 40.0]}, "limits": FAR},
        lambda rig, x_mm: ready(rig).move_to(x_mm=x_mm), lambda limit: (30.0 - limit, 30.0)),
    "move_to: along_mm within the travel": Asked(
        (20, 40), lambda limit: {"stage": {"travel_mm": [60.0, limit, 40.0]}, "limits": FAR},
        lambda rig, along_mm: ready(rig).move_to(x_mm=0, along_mm=along_mm), lambda limit: (15.0 - limit, 15.0)),
    "indent: doi_mm": Asked(
        (0.1, 2), lambda limit: _limits(max_doi_mm=limit), lambda rig, doi_mm: ready(rig).indent(doi_mm=doi_mm),
        lambda limit: (0, limit), open_below=True),
    "indent: force_gwt": Asked(
        (1, 500), lambda limit: _strong(max_force_gwt=limit),
        lambda rig, force_gwt: ready(rig).indent(force_gwt=force_gwt), lambda limit: (0, limit), lambda value: STIFF,
        open_below=True),
    "indent: the depth that a force means": Asked(
        (0.1, 2), lambda limit: _limits(max_doi_mm=limit), lambda rig, doi_mm: ready(rig).indent(force_gwt=1.0),
        lambda limit: (0, limit), lambda doi_mm: StandIn(gwt_mm=1 / doi_mm), open_below=True),
    "indent: the force that a depth means": Asked(
        (1, 500), lambda limit: _strong(max_force_gwt=limit), lambda rig, gwt_mm: ready(rig).indent(doi_mm=1.0),
        lambda limit: (0, limit), lambda gwt_mm: StandIn(gwt_mm), open_below=True),
    "indent: the newton that a depth means": Asked(
        (0.5, 4), lambda limit: _limits(max_force_gwt=500.0, soft_trip_n=limit, max_pressure_kpa=600.0),
        lambda rig, force_n: ready(rig).indent(doi_mm=1.0), lambda limit: (0, limit),
        lambda force_n: StandIn(force_n / GWT_N), open_below=True),
    "indent: the pressure that a force means": Asked(
        (10, 600), lambda limit: _limits(max_pressure_kpa=limit),
        lambda rig, kpa: ready(rig).indent(force_gwt=10.0), lambda limit: (0, limit),
        lambda kpa: StandIn(area_mm2=10.0 * GWT_N / kpa * 1000), open_below=True),
    "indent: speed_mm_s": Asked(
        (1, 5), lambda limit: _limits(max_press_speed_mm_s=limit),
        lambda rig, speed_mm_s: ready(rig).indent(doi_mm=0.1, speed_mm_s=speed_mm_s),
        lambda limit: (SLOWEST_MM_S, limit)),
    "indent: hold_s": Asked(
        (3600, 3600), lambda limit: _limits(max_contact_s=36000.0),
        lambda rig, hold_s: ready(rig).indent(doi_mm=0.1, hold_s=hold_s), lambda limit: (0, limit)),
    "indent: rest_s": Asked(
        (3600, 3600), lambda limit: _limits(max_contact_s=36000.0),
        lambda rig, rest_s: ready(rig).indent(doi_mm=0.1, rest_s=rest_s), lambda limit: (0, limit)),
    "indent: hold_s in all": Asked(
        (10, 3000), lambda limit: _limits(max_contact_s=limit),
        lambda rig, hold_s: ready(rig).indent(doi_mm=0.1, increments=2, hold_s=hold_s / 2), lambda limit: (0, limit)),
    "ramp: doi_mm": Asked(
        (0.1, 2), lambda limit: _limits(max_doi_mm=limit),
        lambda rig, doi_mm: ready(rig).ramp(doi_mm=doi_mm, speed_mm_s=0.1), lambda limit: (0, limit),
        open_below=True),
    "ramp: speed_mm_s": Asked(
        (1, 5), lambda limit: _limits(max_press_speed_mm_s=limit),
        lambda rig, speed_mm_s: ready(rig).ramp(doi_mm=0.1, speed_mm_s=speed_mm_s),
        lambda limit: (SLOWEST_MM_S, limit)),
    "ramp: hold_s": Asked(
        (3600, 3600), lambda limit: _limits(max_contact_s=36000.0),
        lambda rig, hold_s: ready(rig).ramp(doi_mm=0.1, speed_mm_s=0.1, hold_s=hold_s), lambda limit: (0, limit)),
    "ramp: rest_s": Asked(
        (3600, 3600), lambda limit: _limits(max_contact_s=36000.0),
        lambda rig, rest_s: ready(rig).ramp(doi_mm=0.1, speed_mm_s=0.1, rest_s=rest_s), lambda limit: (0, limit)),
}  # fmt: skip
ROUND_OFF = 1e-9
JUST_BESIDE_MM = (-1e-3, -1e-6, 0.0, 1e-6, 1e-3)
LEFT_OUT = ("indent: doi_mm", "indent: speed_mm_s")


@pytest.mark.parametrize("name", ASKED)
@few
@given(data=st.data())
def test_a_number_in_a_script_is_accepted_exactly_within_its_range(name: str, data: st.DataObject) -> None:
    row = ASKED[name]
    limit = data.draw(st.floats(*row.limit), label="limit")
    low, high = row.range(limit)
    for value in [*_edges(low, high), data.draw(_about(low, high), label="value")]:
        _is_answered_in_range(name, limit, value)


def _is_answered_in_range(name: str, limit: float, value: float) -> None:
    row = ASKED[name]
    low, high = row.range(limit)
    foreseen = row.finger is not Asked.finger and not name.endswith(": force_gwt")
    if foreseen and not (0 < value < 1e6 and abs(value - high) > ROUND_OFF * high):
        return  # what a model foresees is a positive number, reckoned with round-off
    if ("travel" in name or "in all" in name) and 0 < min(abs(value - low), abs(value - high)) < ROUND_OFF:
        return
    accepted = (low < value if row.open_below else low <= value) and value <= high
    try:
        walked(lambda rig: row.ask(rig, value), row.finger(value), **row.tables(limit))
    except BadInputError:
        assert not accepted, f"{name} = {value!r}, {low:g} … {high:g}"
    else:
        assert accepted, f"{name} = {value!r}, {low:g} … {high:g}"


@pytest.mark.parametrize("name", [name for name, row in ASKED.items() if row.finger is Asked.finger])
@pytest.mark.parametrize("value", ["1", True, None, [1.0]], ids=repr)
def test_every_verb_refuses_a_value_that_is_no_number(name: str, value: Any) -> None:
    row = ASKED[name]
    if "in all" in name or (value is None and name in LEFT_OUT):
        return  # divided here; or another number is taken
    with pytest.raises(BadInputError):
        walked(lambda rig: row.ask(rig, value), **row.tables(row.limit[1]))


@few
@given(apex_mm=st.floats(-38.0, -5.0), doi_mm=st.none() | st.sampled_from((0.3, 1.0)), data=st.data())
def test_presses_and_touches_below_the_lowest_z_or_the_travel_are_refused(
    apex_mm: float, doi_mm: float | None, data: st.DataObject
) -> None:
    """Down to limits.search_mm below an expected contact, or to the depth; without a depth it is touched only."""
    rig_settings = RigSettings.model_validate({"frame": {"apex_z_mm": apex_mm}})
    deepest_mm = max(rig_settings.limits.search_mm, doi_mm or 0.0)
    floor_mm = max(-rig_settings.stage.travel_mm[2], rig_settings.bounds.lowest_z_mm)
    script: Callable[[Rig], object] = (
        (lambda rig: ready(rig).touch()) if doi_mm is None else (lambda rig: ready(rig).indent(doi_mm=doi_mm))
    )
    ends_mm = [end + by for end in (floor_mm, 0.0) for by in JUST_BESIDE_MM if by]
    for lowest_mm in [*ends_mm, data.draw(st.floats(floor_mm - 5, 5))]:
        if abs(lowest_mm - floor_mm) > 2 * ROUND_OFF < abs(lowest_mm):
            finger = StandIn(contact_mm=lowest_mm + deepest_mm - apex_mm)
            try:
                walked(script, finger, settings=rig_settings)
            except BadInputError:
                assert not floor_mm <= lowest_mm <= 0
            else:
                assert floor_mm <= lowest_mm <= 0


# --- rules of a script that are no range of one number ---

COUNTS: Mapping[str, Callable[[Rig, Any], object]] = {
    "increments": lambda rig, n: rig.indent(doi_mm=0.5, increments=n, hold_s=0.1),
    "presses": lambda rig, n: rig.precondition(presses=n, doi_mm=0.5, hold_s=0.1),
    "increments of a reference": lambda rig, n: rig.reference(x_mm=0.0, doi_mm=0.5, increments=n, hold_s=0.1),
}


def _counted(what: str, number: object, rig: Rig) -> None:
    COUNTS[what](ready(rig), number)


@pytest.mark.parametrize("what", COUNTS)
def test_every_count_of_a_verb_is_a_whole_number_from_1_to_100(what: str) -> None:
    for number in (1, 100):
        walked(partial(_counted, what, number))
    for number in (0, 101, -1, True, 2.0, "2"):
        has_code(refused(partial(_counted, what, number)), "no_count", value=number, high=100)


def _pressed(x_mm: float = 0.0, **target: float) -> Callable[[Rig], object]:
    return lambda rig: ready(rig, x_mm).indent(**target)  # type: ignore[arg-type]


def _over(x_mm: float, along_mm: float = 0.0) -> Callable[[Rig], object]:
    def script(rig: Rig) -> None:
        rig.home()
        rig.move_to(x_mm=x_mm, along_mm=along_mm)

    return script


def _touched(rig: Rig) -> None:
    ready(rig).touch()


PLANE: Tables = {"stage": {"kind": "leadshine"}}
GIVES = {"compliance_mm_per_n": {"value": 0.5, "date": "2026-01-01", "expires": "2027-01-01"}}
WIDE = StandIn(gwt_mm=100.0, area_mm2=400.0)
RULES: Mapping[str, tuple[Tables, StandIn, Callable[[Rig], object], str | None]] = {
    "no target": ({}, StandIn(), _pressed(), "not_one_target"),
    "two targets": ({}, StandIn(), _pressed(doi_mm=0.5, force_gwt=1.0), "not_one_target"),
    "a target of zero": ({}, StandIn(), _pressed(force_gwt=0.0), "not_positive"),
    "a target of no number": ({}, StandIn(), _pressed(doi_mm=math.nan), "not_positive"),
    "no contact": ({}, StandIn(area_mm2=0.0), _pressed(doi_mm=1.0), "no_contact"),
    "no answer of the model": ({}, StandIn(), _pressed(5.0, doi_mm=0.5), "no_answer"),
    "as deep as the travel": ({"frame": {"apex_z_mm": -38.69}}, WIDE, _pressed(doi_mm=1.0), None),
    "deeper than the travel": ({"frame": {"apex_z_mm": -38.71}}, WIDE, _pressed(doi_mm=1.0), "outside_travel"),
    "a rig that gives": (
        {"frame": {"apex_z_mm": -38.2}, "calibration": GIVES}, WIDE, _pressed(doi_mm=1.0), None),
    "a rig that gives too much": (
        {"frame": {"apex_z_mm": -38.22}, "calibration": GIVES}, WIDE, _pressed(doi_mm=1.0), "outside_travel"),
    "a touch down to the travel": ({"frame": {"apex_z_mm": -39.19}}, StandIn(), _touched, None),
    "a touch below the travel": ({"frame": {"apex_z_mm": -39.21}}, StandIn(), _touched, "outside_travel"),
    "clearance up to the switches": ({"frame": {"apex_z_mm": -2.4}}, StandIn(), _over(0.0), None),
    "clearance above the switches": ({"frame": {"apex_z_mm": -1.9}}, StandIn(), _over(0.0), "outside_travel"),
    "a precondition too deep": (
        {}, StandIn(), lambda rig: ready(rig).precondition(presses=2, doi_mm=1.51), "beyond_limit"),
    "a reference too deep": ({}, StandIn(), lambda rig: ready(rig).reference(x_mm=0, doi_mm=1.51), "beyond_limit"),
    "a reference aside": ({}, StandIn(), lambda rig: ready(rig).reference(x_mm=6.01, doi_mm=0.1), "outside_limits"),
    "no axis along, and not along": (PLANE, StandIn(), _over(1.0), None),
    "no axis along": (PLANE, StandIn(), _over(0.0, 1.0), "no_such_axis"),
}  # fmt: skip


@pytest.mark.parametrize("name", RULES)
def test_each_rule_refuses_its_scripts_with_its_code_and_accepts_others(name: str) -> None:
    tables, finger, script, code = RULES[name]
    if code is None:
        walked(script, finger, **tables)
    else:
        has_code(refused(script, finger, **tables), code)


def test_holds_of_all_verbs_add_up_to_the_longest_contact() -> None:
    def script(rig: Rig) -> None:
        ready(rig).indent(doi_mm=0.5, increments=4, hold_s=2.0)
        rig.precondition(presses=4, doi_mm=0.5, hold_s=2.0)
        rig.reference(x_mm=0.0, doi_mm=0.5, increments=4, hold_s=2.0)

    walked(script, limits={"max_contact_s": 24.0})
    has_code(refused(script, limits={"max_contact_s": 23.5}), "held_too_long", held_s=24.0, high=23.5)


def test_the_limits_apply_to_the_upper_end_of_the_band_of_an_identified_finger() -> None:
    rig_settings = RigSettings()
    limits = rig_settings.limits

    def reach(**band: Any) -> None:
        found = PredictionBand(**{"force_gwt": (4.0, 6.0), "doi_mm": (0.4, 0.6), "highest_gwt": 7.0, **band})
        press = PlannedIndentation(
            "bar", 0.5, Target("doi_mm", 0.5), 0.0, 5.0, 0.5, 40.0, 0.1, increments=1, hold_s=1.0, band=found
        )
        check.refuse_reach("indent", press, rig_settings)

    reach()
    for wide, limit in (
        ({"doi_mm": (0.4, limits.max_doi_mm + 0.1)}, "max_doi_mm"),
        ({"highest_gwt": limits.max_force_gwt + 0.1}, "max_force_gwt"),
    ):
        with raises(BadInputError, "means_beyond_limit", limit=limit):
            reach(**wide)


# --- what is moved ---


@few
@given(
    from_mm=st.floats(-3.62, -3.58) | st.floats(-3.55, 6.0), speed_mm_s=st.floats(0.1, 10.0) | st.just(0.1),
    fastest_mm_s=st.floats(1.0, 5.0),
    free_mm=st.just(math.inf) | st.floats(-1.0, 3.0), data=st.data(),
)  # fmt: skip
def test_vertical_moves_are_limited_in_length_speed_and_travel(
    from_mm: float, speed_mm_s: float, fastest_mm_s: float, free_mm: float, data: st.DataObject
) -> None:
    """Below clearance no longer than an increment beyond what is free, no faster than a finger is pressed."""
    rig_settings = RigSettings.model_validate({"limits": {"max_press_speed_mm_s": fastest_mm_s}})
    habits, apex_mm, floor_mm = rig_settings.habits, rig_settings.frame.apex_z_mm, rig_settings.bounds.lowest_z_mm
    free_from_mm = min(from_mm, free_mm, habits.clearance_mm)
    ends_mm = (free_from_mm - habits.increment_mm, habits.clearance_mm, from_mm, floor_mm - apex_mm, -apex_mm)
    for to_mm in [*(end + by for end in ends_mm for by in JUST_BESIDE_MM), data.draw(st.floats(-5.0, 27.0))]:
        if min(abs(to_mm - end_mm) for end_mm in ends_mm) < 2 * ROUND_OFF:
            continue
        short = to_mm >= free_from_mm - habits.increment_mm
        slow = to_mm >= min(from_mm, habits.clearance_mm) or speed_mm_s <= fastest_mm_s
        reached = floor_mm <= apex_mm + to_mm <= 0
        try:
            refuse_height(rig_settings, from_mm, to_mm, speed_mm_s, free_mm)
        except LimitError:
            assert not (short and slow and reached), to_mm
        else:
            assert (short, slow, reached) == (True, True, True), to_mm
