"""Every limit of a script, to its edge: what lies within is allowed, what lies a little beyond is refused by name."""

from collections.abc import Callable
from typing import Any

import pytest

from rig.protocol import Rig
from tests.error_codes import has_code
from tests.rig.script_walk import StandIn, ready, refused, walked

Asked = Callable[[Rig, Any], object]
Fields = dict[str, Any]
LONG: dict[str, Any] = {"limits": {"max_contact_s": 36_000.0}}
COUNTS: dict[str, Asked] = {
    "indent: increments": lambda rig, n: rig.indent(doi_mm=0.5, increments=n, hold_s=0.1),
    "precondition: presses": lambda rig, n: rig.precondition(presses=n, doi_mm=0.5, hold_s=0.1),
    "reference: increments": lambda rig, n: rig.reference(x_mm=0.0, doi_mm=0.5, increments=n, hold_s=0.1),
}
TIMES: dict[str, Asked] = {
    "indent: hold_s": lambda rig, s: rig.indent(doi_mm=0.5, hold_s=s),
    "precondition: hold_s": lambda rig, s: rig.precondition(presses=1, doi_mm=0.5, hold_s=s),
    "reference: hold_s": lambda rig, s: rig.reference(x_mm=0.0, doi_mm=0.5, hold_s=s),
    "rest: seconds": lambda rig, s: rig.rest(s),
}
NUMBERS: dict[str, Asked] = {
    **TIMES,
    "move_to: x_mm": lambda rig, mm: rig.move_to(x_mm=mm),
    "move_to: along_mm": lambda rig, mm: rig.move_to(x_mm=0.0, along_mm=mm),
    "indent: doi_mm": lambda rig, mm: rig.indent(doi_mm=mm),
    "indent: force_gwt": lambda rig, gwt: rig.indent(force_gwt=gwt),
    "indent: speed_mm_s": lambda rig, mm_s: rig.indent(doi_mm=0.5, speed_mm_s=mm_s),
    "precondition: doi_mm": lambda rig, mm: rig.precondition(presses=1, doi_mm=mm),
    "reference: doi_mm": lambda rig, mm: rig.reference(x_mm=0.0, doi_mm=mm),
}


def _as(value: float) -> Any:
    """Equal to it, also where it is no number."""
    return pytest.approx(value, nan_ok=True)


# --- numbers ---


@pytest.mark.parametrize("what", NUMBERS)
@pytest.mark.parametrize("given", [True, "1"])
def test_a_number_is_neither_text_nor_a_truth(what: str, given: object) -> None:
    verb, key = what.split(": ")
    has_code(refused(lambda rig: NUMBERS[what](ready(rig), given)), "no_number", verb=verb, key=key, value=given)


@pytest.mark.parametrize("what", NUMBERS)
def test_a_number_may_be_whole(what: str) -> None:
    walked(lambda rig: NUMBERS[what](ready(rig), 1))


@pytest.mark.parametrize("what", COUNTS)
@pytest.mark.parametrize("given", [0, 101, -1, True, 2.0, "2"])
def test_a_count_is_a_whole_number_up_to_100(what: str, given: object) -> None:
    verb, key = what.split(": ")
    error = refused(lambda rig: COUNTS[what](ready(rig), given))
    has_code(error, "no_count", verb=verb, key=key, value=given, high=100)


@pytest.mark.parametrize("what", COUNTS)
@pytest.mark.parametrize("given", [1, 100])
def test_one_and_100_are_counts(what: str, given: int) -> None:
    walked(lambda rig: COUNTS[what](ready(rig), given))


@pytest.mark.parametrize("what", TIMES)
@pytest.mark.parametrize("given", [-0.001, 3600.5, float("inf"), float("nan")])
def test_nobody_waits_longer_than_an_hour(what: str, given: float) -> None:
    verb, key = what.split(": ")
    error = refused(lambda rig: TIMES[what](ready(rig), given), **LONG)
    has_code(error, "outside_range", verb=verb, key=key, value=_as(given), low=0.0, high=3600.0)


@pytest.mark.parametrize("what", TIMES)
@pytest.mark.parametrize("given", [0, 0.5, 3600])
def test_up_to_an_hour_is_waited(what: str, given: float) -> None:
    walked(lambda rig: TIMES[what](ready(rig), given), **LONG)


@pytest.mark.parametrize("kind", ["doi_mm", "force_gwt"])
@pytest.mark.parametrize("given", [0, -1.0, float("inf"), float("nan")])
def test_a_target_is_finite_and_positive(kind: str, given: float) -> None:
    error = refused(lambda rig: ready(rig).indent(**{kind: given}))  # type: ignore[arg-type]
    has_code(error, "not_positive", verb="indent", key=kind, value=_as(given))


@pytest.mark.parametrize("targets", [{}, {"doi_mm": 0.5, "force_gwt": 1.0}])
def test_one_target_is_given(targets: dict[str, float]) -> None:
    error = refused(lambda rig: ready(rig).indent(**targets))  # type: ignore[arg-type]
    has_code(error, "not_one_target", verb="indent")


@pytest.mark.parametrize(("speed", "allowed"), [(0.016, False), (0.017, True), (5, True), (5.01, False)])
def test_speeds_from_what_a_board_can_to_what_a_finger_may_have(speed: float, allowed: bool) -> None:
    def script(rig: Rig) -> None:
        ready(rig).indent(doi_mm=0.5, speed_mm_s=speed)

    if allowed:
        walked(script)
    else:
        fields = {"low": pytest.approx(0.017, rel=0.03), "high": 5.0}
        has_code(refused(script), "outside_range", verb="indent", key="speed_mm_s", value=float(speed), **fields)


# --- limits of place, depth, force and pressure: (configuration, finger, what is asked, code and fields) ---

STRONG = {"limits": {"max_force_gwt": 500.0}}
GIVES = {"compliance_mm_per_n": {"value": 0.5, "date": "2026-01-01", "expires": "2027-01-01"}}


def _beyond(limit: str, high: float, key: str, value: float) -> tuple[str, Fields]:
    return "beyond_limit", {"verb": "indent", "limit": limit, "high": high, "key": key, "value": value}


def _means(limit: str, high: float, key: str, value: float, **found: float) -> tuple[str, Fields]:
    """What the model says of a target at x = 0; measures to three digits."""
    asked = {"verb": "indent", "limit": limit, "high": high, "key": key, "value": value, "x_mm": 0.0}
    return "means_beyond_limit", asked | {name: pytest.approx(one, rel=2e-3) for name, one in found.items()}


def _travel(axis: str, machine_mm: float, low: float) -> tuple[str, Fields]:
    return "outside_travel", {"axis": axis, "machine_mm": machine_mm, "low": low, "high": 0.0}


def _limits(key: str, value: float, high: float) -> tuple[str, Fields]:
    return "outside_limits", {"verb": "move_to", "key": key, "value": value, "low": -high, "high": high}


def _doi(mm: float) -> Callable[[Rig], object]:
    return lambda rig: ready(rig).indent(doi_mm=mm)


def _force(gwt: float) -> Callable[[Rig], object]:
    return lambda rig: ready(rig).indent(force_gwt=gwt)


def _over(x_mm: float, along_mm: float = 0.0) -> Callable[[Rig], object]:
    def script(rig: Rig) -> None:
        rig.home()
        rig.move_to(x_mm=x_mm, along_mm=along_mm)

    return script


def _touch(rig: Rig) -> None:
    ready(rig).touch()


WIDE = StandIn(gwt_mm=100.0, area_mm2=400.0)
ALLOWED: dict[str, tuple[dict[str, Any], StandIn, Callable[[Rig], object]]] = {
    "the deepest DOI": ({}, StandIn(), _doi(1.5)),
    "the deepest DOI by force": ({}, StandIn(), _force(15.0)),
    "the largest force": ({}, WIDE, _force(100.0)),
    "the largest force by DOI": ({}, WIDE, _doi(1.0)),
    "just short of the soft trip": (STRONG, StandIn(203.0, area_mm2=400.0), _doi(1.0)),
    "just short of the highest pressure": ({}, StandIn(100.0, area_mm2=3.27), _doi(1.0)),
    "a light press on a small contact": ({}, StandIn(area_mm2=0.5), _doi(0.5)),
    "down to the end of travel": ({"frame": {"apex_z_mm": -38.69}}, WIDE, _doi(1.0)),
    "a search down to the end of travel": ({"frame": {"apex_z_mm": -39.19}}, StandIn(), _doi(0.2)),
    "a rig that gives": ({"frame": {"apex_z_mm": -38.2}, "calibration": GIVES}, WIDE, _doi(1.0)),
    "a touch down to the end of travel": ({"frame": {"apex_z_mm": -39.19}}, StandIn(), _touch),
    "clearance up to the switches": ({"frame": {"apex_z_mm": -2.4}}, StandIn(), _over(0.0)),
    "the lowest x": ({}, StandIn(), _over(-6)),
    "the highest x": ({}, StandIn(), _over(6)),
    "near the end of x": ({"frame": {"pad_centre_x_mm": -57.0}}, StandIn(), _over(-2.99)),
    "near the switch of x": ({"frame": {"pad_centre_x_mm": -3.0}}, StandIn(), _over(2.99)),
    "near the end of y": ({"frame": {"pad_y_mm": -27.0}}, StandIn(), _over(0.0, -2.99)),
    "near the switch of y": ({"frame": {"pad_y_mm": -3.0}}, StandIn(), _over(0.0, 2.99)),
    "as far along as may be": ({}, StandIn(), _over(0.0, 4)),
    "as far back as may be": ({}, StandIn(), _over(0.0, -4)),
    "no axis along, and not along": ({"stage": {"kind": "leadshine"}}, StandIn(), _over(1.0)),
}
REFUSED: dict[str, tuple[dict[str, Any], StandIn, Callable[[Rig], object], tuple[str, Fields]]] = {
    "DOI": ({}, StandIn(), _doi(1.51), _beyond("max_doi_mm", 1.5, "doi_mm", 1.51)),
    "DOI by force": ({}, StandIn(), _force(16.0), _means("max_doi_mm", 1.5, "force_gwt", 16.0, doi_mm=1.6)),
    "force": ({}, WIDE, _force(100.5), _beyond("max_force_gwt", 100.0, "force_gwt", 100.5)),
    "force by DOI": (
        {},
        StandIn(101.0, area_mm2=400.0),
        _doi(1.0),
        _means("max_force_gwt", 100.0, "doi_mm", 1.0, force_gwt=101.0),
    ),
    "soft trip": (
        STRONG,
        StandIn(205.0, area_mm2=400.0),
        _doi(1.0),
        _means("soft_trip_n", 2.0, "doi_mm", 1.0, force_n=2.01),
    ),
    "pressure": (
        {},
        StandIn(100.0, area_mm2=3.26),
        _doi(1.0),
        _means("max_pressure_kpa", 300.0, "doi_mm", 1.0, pressure_kpa=301.0, area_mm2=3.26),
    ),
    "no contact": (
        {},
        StandIn(area_mm2=0.0),
        _doi(1.0),
        ("no_contact", {"verb": "indent", "value": 1.0, "x_mm": 0.0}),
    ),
    "no answer": (
        {},
        StandIn(),
        lambda rig: ready(rig, 5.0).indent(doi_mm=0.5),
        ("no_answer", {"verb": "indent", "problem": "the stand-in does not know"}),
    ),
    "depth": ({"frame": {"apex_z_mm": -38.71}}, WIDE, _doi(1.0), _travel("z", -40.01, -40.0)),
    "search": ({"frame": {"apex_z_mm": -39.21}}, StandIn(), _doi(0.2), _travel("z", -40.01, -40.0)),
    "give": (
        {"frame": {"apex_z_mm": -38.22}, "calibration": GIVES},
        WIDE,
        _doi(1.0),
        ("outside_travel", {"axis": "z", "machine_mm": pytest.approx(-40.01, abs=5e-4)}),
    ),
    "touch": ({"frame": {"apex_z_mm": -39.21}}, StandIn(), _touch, _travel("z", -40.01, -40.0)),
    "clearance": ({"frame": {"apex_z_mm": -1.9}}, StandIn(), _over(0.0), _travel("z", 0.4, -40.0)),
    "low x": ({}, StandIn(), _over(-6.01), _limits("x_mm", -6.01, 6.0)),
    "no x": ({}, StandIn(), _over(float("nan")), ("outside_limits", {"key": "x_mm", "value": _as(float("nan"))})),
    "high x": ({}, StandIn(), _over(6.01), _limits("x_mm", 6.01, 6.0)),
    "end of x": ({"frame": {"pad_centre_x_mm": -57.0}}, StandIn(), _over(-3.01), _travel("x", -60.01, -60.0)),
    "switch of x": ({"frame": {"pad_centre_x_mm": -3.0}}, StandIn(), _over(3.01), _travel("x", 0.01, -60.0)),
    "end of y": ({"frame": {"pad_y_mm": -27.0}}, StandIn(), _over(0.0, -3.01), _travel("y", -30.01, -30.0)),
    "switch of y": ({"frame": {"pad_y_mm": -3.0}}, StandIn(), _over(0.0, 3.01), _travel("y", 0.01, -30.0)),
    "along": ({}, StandIn(), _over(0.0, 4.01), _limits("along_mm", 4.01, 4.0)),
    "back": ({}, StandIn(), _over(0.0, -4.01), _limits("along_mm", -4.01, 4.0)),
    "no axis along": (
        {"stage": {"kind": "leadshine"}},
        StandIn(),
        _over(0.0, 1.0),
        ("no_such_axis", {"verb": "move_to", "key": "along_mm", "value": 1.0, "kind": "leadshine"}),
    ),
}


@pytest.mark.parametrize("name", ALLOWED)
def test_what_lies_within_a_limit_is_allowed(name: str) -> None:
    tables, finger, script = ALLOWED[name]
    walked(script, finger, **tables)


@pytest.mark.parametrize("name", REFUSED)
def test_what_lies_beyond_a_limit_is_refused_with_its_name(name: str) -> None:
    tables, finger, script, (code, fields) = REFUSED[name]
    has_code(refused(script, finger, **tables), code, **fields)


# --- how long a finger is held ---

HELD: dict[str, Asked] = {  # 8 s each, whichever way a hold is repeated
    "indent": lambda rig, hold_s: rig.indent(doi_mm=0.5, increments=4, hold_s=hold_s),
    "precondition": lambda rig, hold_s: rig.precondition(presses=4, doi_mm=0.5, hold_s=hold_s),
    "reference": lambda rig, hold_s: rig.reference(x_mm=0.0, doi_mm=0.5, increments=4, hold_s=hold_s),
}


@pytest.mark.parametrize("verb", HELD)
def test_holds_add_up_to_the_limit_and_no_further(verb: str) -> None:
    def script(rig: Rig) -> None:
        HELD[verb](ready(rig), 2.0)
        HELD["indent"](rig, 2.0)

    walked(script, limits={"max_contact_s": 16.0})
    error = refused(script, limits={"max_contact_s": 15.5})
    has_code(error, "held_too_long", verb="indent", held_s=16.0, high=15.5)
