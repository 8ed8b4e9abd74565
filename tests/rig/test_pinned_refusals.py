"""Every limit of a script, to its edge: what lies within is allowed, what lies a little beyond is refused by name."""

from collections.abc import Callable
from typing import Any

import pytest

from rig.protocol import Rig
from tests.rig.walked import StandIn, complaint, ready, walked

Asked = Callable[[Rig, Any], object]
LONG = {"limits": {"max_contact_s": 36_000.0}}
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


# --- numbers ---


@pytest.mark.parametrize("what", NUMBERS)
@pytest.mark.parametrize("given", [True, "1"])
def test_a_number_is_neither_text_nor_a_truth(what: str, given: object) -> None:
    assert complaint(lambda rig: NUMBERS[what](ready(rig), given)) == f"{what} = {given!r}: expected a number"


@pytest.mark.parametrize("what", NUMBERS)
def test_a_number_may_be_whole(what: str) -> None:
    walked(lambda rig: NUMBERS[what](ready(rig), 1))


@pytest.mark.parametrize("what", COUNTS)
@pytest.mark.parametrize("given", [0, 101, -1, True, 2.0, "2"])
def test_a_count_is_a_whole_number_up_to_100(what: str, given: object) -> None:
    said = complaint(lambda rig: COUNTS[what](ready(rig), given))
    assert said == f"{what} = {given!r}: expected a whole number, 1 … 100"


@pytest.mark.parametrize("what", COUNTS)
@pytest.mark.parametrize("given", [1, 100])
def test_one_and_100_are_counts(what: str, given: int) -> None:
    walked(lambda rig: COUNTS[what](ready(rig), given))


@pytest.mark.parametrize("what", TIMES)
@pytest.mark.parametrize("given", [-0.001, 3600.5, float("inf"), float("nan")])
def test_nobody_waits_longer_than_an_hour(what: str, given: float) -> None:
    said = complaint(lambda rig: TIMES[what](ready(rig), given), **LONG)
    assert said == f"{what} = {given!r}: expected 0 … 3600 s"


@pytest.mark.parametrize("what", TIMES)
@pytest.mark.parametrize("given", [0, 0.5, 3600])
def test_up_to_an_hour_is_waited(what: str, given: float) -> None:
    walked(lambda rig: TIMES[what](ready(rig), given), **LONG)


@pytest.mark.parametrize("kind", ["doi_mm", "force_gwt"])
@pytest.mark.parametrize("given", [0, -1.0, float("inf"), float("nan")])
def test_a_target_is_finite_and_positive(kind: str, given: float) -> None:
    said = complaint(lambda rig: ready(rig).indent(**{kind: given}))  # type: ignore[arg-type]
    assert said == f"indent: {kind} = {float(given)}: expected a positive number"


@pytest.mark.parametrize("targets", [{}, {"doi_mm": 0.5, "force_gwt": 1.0}])
def test_one_target_is_given(targets: dict[str, float]) -> None:
    assert complaint(lambda rig: ready(rig).indent(**targets)) == (  # type: ignore[arg-type]
        "indent: expected either doi_mm or force_gwt"
    )


@pytest.mark.parametrize(("speed", "allowed"), [(0.016, False), (0.017, True), (5, True), (5.01, False)])
def test_speeds_from_what_a_board_can_to_what_a_finger_may_have(speed: float, allowed: bool) -> None:
    def script(rig: Rig) -> None:
        ready(rig).indent(doi_mm=0.5, speed_mm_s=speed)

    if allowed:
        walked(script)
    else:
        assert complaint(script) == f"indent: speed_mm_s = {speed!r}: expected 0.017 … 5 mm/s"


# --- limits of place, depth, force and pressure: (configuration, finger, what is asked, what is said) ---

DEEP = "indent: force_gwt = 16 at x = 0 mm means a DOI of 1.6 mm, beyond limits.max_doi_mm = 1.5"
HARD = "indent: doi_mm = 1 at x = 0 mm means a force of 101 gwt, beyond limits.max_force_gwt = 100"
SOFT = "indent: doi_mm = 1 at x = 0 mm means 2.01 N, beyond limits.soft_trip_n = 2"
SMALL = (
    "indent: doi_mm = 1 at x = 0 mm means 30.1 N/cm² over a contact of 3.3 mm², beyond limits.max_pressure_n_cm2 = 30"
)
NONE = "indent: doi_mm = 1 at x = 0 mm means no contact that the model could tell from none: expected a larger target"
STRONG = {"limits": {"max_force_gwt": 500.0}}
GIVES = {"compliance_mm_per_n": {"value": 0.5, "date": "2026-01-01", "expires": "2027-01-01"}}


def _z(lowest: str) -> str:
    return f"machine z = {lowest} mm is outside the stage's travel, -40 … 0 mm"


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
    "clearance up to the switches": ({"frame": {"apex_z_mm": -2.1}}, StandIn(), _over(0.0)),
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
REFUSED: dict[str, tuple[dict[str, Any], StandIn, Callable[[Rig], object], str]] = {
    "DOI": ({}, StandIn(), _doi(1.51), "indent: doi_mm = 1.51 is beyond limits.max_doi_mm = 1.5"),
    "DOI by force": ({}, StandIn(), _force(16.0), DEEP),
    "force": ({}, WIDE, _force(100.5), "indent: force_gwt = 100.5 is beyond limits.max_force_gwt = 100"),
    "force by DOI": ({}, StandIn(101.0, area_mm2=400.0), _doi(1.0), HARD),
    "soft trip": (STRONG, StandIn(205.0, area_mm2=400.0), _doi(1.0), SOFT),
    "pressure": ({}, StandIn(100.0, area_mm2=3.26), _doi(1.0), SMALL),
    "no contact": ({}, StandIn(area_mm2=0.0), _doi(1.0), NONE),
    "no answer": (
        {},
        StandIn(),
        lambda rig: ready(rig, 5.0).indent(doi_mm=0.5),
        "indent: the stand-in does not know",
    ),
    "depth": ({"frame": {"apex_z_mm": -38.71}}, WIDE, _doi(1.0), _z("-40.010")),
    "search": ({"frame": {"apex_z_mm": -39.21}}, StandIn(), _doi(0.2), _z("-40.010")),
    "give": ({"frame": {"apex_z_mm": -38.22}, "calibration": GIVES}, WIDE, _doi(1.0), _z("-40.010")),
    "touch": ({"frame": {"apex_z_mm": -39.21}}, StandIn(), _touch, _z("-40.010")),
    "clearance": ({"frame": {"apex_z_mm": -1.9}}, StandIn(), _over(0.0), _z("0.100")),
    "low x": ({}, StandIn(), _over(-6.01), "move_to: x_mm = -6.01 is outside limits.x_mm = -6 … 6"),
    "high x": ({}, StandIn(), _over(6.01), "move_to: x_mm = 6.01 is outside limits.x_mm = -6 … 6"),
    "end of x": (
        {"frame": {"pad_centre_x_mm": -57.0}},
        StandIn(),
        _over(-3.01),
        "machine x = -60.010 mm is outside the stage's travel, -60 … 0 mm",
    ),
    "switch of x": (
        {"frame": {"pad_centre_x_mm": -3.0}},
        StandIn(),
        _over(3.01),
        "machine x = 0.010 mm is outside the stage's travel, -60 … 0 mm",
    ),
    "end of y": (
        {"frame": {"pad_y_mm": -27.0}},
        StandIn(),
        _over(0.0, -3.01),
        "machine y = -30.010 mm is outside the stage's travel, -30 … 0 mm",
    ),
    "switch of y": (
        {"frame": {"pad_y_mm": -3.0}},
        StandIn(),
        _over(0.0, 3.01),
        "machine y = 0.010 mm is outside the stage's travel, -30 … 0 mm",
    ),
    "along": ({}, StandIn(), _over(0.0, 4.01), "move_to: along_mm = 4.01 is outside limits.along_mm = -4 … 4"),
    "back": ({}, StandIn(), _over(0.0, -4.01), "move_to: along_mm = -4.01 is outside limits.along_mm = -4 … 4"),
    "no axis along": (
        {"stage": {"kind": "leadshine"}},
        StandIn(),
        _over(0.0, 1.0),
        "move_to: along_mm = 1: a leadshine stage has no axis along the finger",
    ),
}


@pytest.mark.parametrize("name", ALLOWED)
def test_what_lies_within_a_limit_is_allowed(name: str) -> None:
    tables, finger, script = ALLOWED[name]
    walked(script, finger, **tables)


@pytest.mark.parametrize("name", REFUSED)
def test_what_lies_beyond_a_limit_is_refused_with_its_name(name: str) -> None:
    tables, finger, script, said = REFUSED[name]
    assert complaint(script, finger, **tables) == said


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
    assert complaint(script, limits={"max_contact_s": 15.5}) == (
        "indent: the finger would be held for 16 s in all, beyond limits.max_contact_s = 15.5"
    )
