"""An indentation as a whole: what it does unless told otherwise, what a pause does to it, and who may press."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from rig.engine import Engine, LimitError, NotReadyError, Target, TripError, indent, verbs
from rig.engine.engine import State
from rig.engine.pressing.compliance import measure_compliance
from rig.engine.pressing.indent import ready_to_indent, touch_place
from tests.rig.plain_bench import PlainBench

Felt = Callable[[PlainBench], float]
CONTACT_MM = -0.3


def _finger(bench: PlainBench) -> float:
    return round(bench.hertz(6.0, CONTACT_MM), 2)


def _bench(felt: Felt = _finger, settings: dict[str, Any] | None = None, **options: Any) -> PlainBench:
    return PlainBench(felt, settings or {}, **options)


def test_what_an_indentation_does_unless_told_otherwise() -> None:
    """One hold of 1 s, at habits.press_speed_mm_s, on the next index, within limits.search_mm of the apex."""
    bench = _bench()
    engine = bench.ready()
    for index in (0, 1):
        done = indent(engine, Target("doi_mm", 0.5))
        assert (done.index, len(done.holds)) == (index, 1)
    start, end = bench.of("indentation_start")[0], bench.of("hold_end")[0]
    assert (start["increments"], end["asked_s"]) == (1, 1.0)
    assert end["hold_s"] == pytest.approx(1.0)


def test_an_indentation_is_journalled_with_all_the_time_it_took_to_a_millionth() -> None:
    """On a sensor that is late by an odd time."""
    bench = _bench(settings={"force": {"latency_s": math.pi / 100}})
    engine = bench.ready()
    start_s = bench.clock.monotonic_s()
    indent(engine, Target("doi_mm", 0.5))
    took_s = round(bench.clock.monotonic_s() - start_s, 6)
    assert bench.of("indentation_end") == [{"index": 0, "duration_s": took_s}]


@pytest.mark.parametrize("touch", [False, True])
@pytest.mark.parametrize(
    ("expected_mm", "contact_mm", "said"),
    [
        (0.25, -3.0, r"down to -0\.250 mm"),
        (0.25, 0.85, r"expected below 0\.750 mm"),
        (-0.25, -3.0, r"down to -0\.750 mm"),
        (-0.25, 0.35, r"expected below 0\.250 mm"),
    ],
)
def test_contact_is_expected_within_search_mm_of_where_the_model_says(
    touch: bool, expected_mm: float, contact_mm: float, said: str
) -> None:
    bench = _bench(lambda bench: bench.hertz(6.0, contact_mm))
    engine = bench.ready()
    with pytest.raises(TripError, match=said):
        _pressed(engine, touch, expected_mm)


def _pressed(engine: Engine, touch: bool, expected_mm: float) -> None:
    """Touched only, or pressed."""
    if touch:
        touch_place(engine, 0, expected_mm)
    else:
        indent(engine, Target("doi_mm", 0.5), expected_contact_mm=expected_mm)


def _pause_once(bench: PlainBench, phase: str, readings: int = 3) -> list[int]:
    """The operator wants a pause from so many readings of a phase on, and then goes on; how many there were."""
    asked: list[int] = []

    def wants() -> bool:
        if not asked and len(bench.readings(phase)) >= readings:
            asked.append(len(bench.readings(phase)))
            return True
        return False

    bench.wants_pause = wants
    return asked


@pytest.mark.parametrize("phase", ["approach", "touch", "press", "hold"])
def test_a_paused_indentation_is_done_anew_under_its_number(phase: str) -> None:
    bench = _bench()
    engine = bench.ready()
    asked = _pause_once(bench, phase)
    done = indent(engine, Target("doi_mm", 0.5), hold_s=0.5, contact_area_mm2=10.0)
    assert asked == [3]
    assert done.index == 0
    assert [event["index"] for event in bench.of("indentation_start")] == [0, 0]
    assert len(bench.of("indentation_end")) == len(bench.of("paused")) == len(bench.of("resumed")) == 1
    assert engine.next_index() == 1


def test_what_is_done_anew_after_a_pause_has_the_same_limit_of_pressure() -> None:
    """30 N/cm² over 0.1 mm² are 3.06 gwt."""
    bench = _bench()
    engine = bench.ready()
    _pause_once(bench, "press")
    with pytest.raises(LimitError, match=r"would pass the pressure limit, 3\.06 gwt"):
        indent(engine, Target("doi_mm", 1.0), contact_area_mm2=0.1)
    assert len(bench.of("indentation_start")) == 2


def test_a_pause_that_is_wanted_before_an_indentation_comes_before_it() -> None:
    bench = _bench()
    engine = bench.ready()
    _pause_once(bench, "clearance", 1)
    indent(engine, Target("doi_mm", 0.5), hold_s=0.1)
    streams = [stream for stream, _ in bench.events if stream in ("paused", "resumed", "indentation_start")]
    assert streams == ["paused", "resumed", "indentation_start"]


@pytest.mark.parametrize("phase", ["approach", "touch"])
def test_a_paused_touch_is_done_anew(phase: str) -> None:
    bench = _bench(lambda bench: round(bench.hertz(7.3, CONTACT_MM), 2))
    engine = bench.ready()
    asked = _pause_once(bench, phase)
    found_mm = touch_place(engine, 4, 0.0)
    assert asked == [3]
    assert found_mm == pytest.approx(CONTACT_MM, abs=0.01)
    (found,) = bench.of("find")
    assert found == {
        "index": 4, "indentor": "bar:3.0", "x_mm": 0.0, "along_mm": 0.0, "contact_height_mm": round(found_mm, 6),
    }  # fmt: skip
    assert engine.state is State.READY
    assert bench.height_mm == pytest.approx(2.0)


@pytest.mark.parametrize("touch", [False, True])
def test_a_finger_that_was_touched_for_too_long_is_let_go(touch: bool) -> None:
    """0.2 s are over in the touch-off; what was counted before this part of the run counts too."""
    bench = _bench(settings={"limits": {"max_contact_s": 100.0}}, contact_s=99.8)
    engine = bench.ready()
    with pytest.raises(LimitError, match=r"touched for 100\.\d s in this run, limits\.max_contact_s = 100"):
        _pressed(engine, touch, 0.0)
    assert engine.state is State.READY
    assert bench.height_mm == pytest.approx(2.0)
    assert len(bench.of("retract")) == 1
    assert bench.of("indentation_end") == bench.of("find") == []


def _unmounted(bench: PlainBench) -> None:
    bench.engine.indentor = None


def _in_contact(bench: PlainBench) -> None:
    bench.engine.go_to_height(1.96, 1.0)


def _homed_again(bench: PlainBench) -> None:
    verbs.home(bench.engine)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_unmounted, "no indentor is mounted"),
        (_homed_again, "has not been moved to a position since homing"),
        (_in_contact, "not allowed while in contact"),
    ],
)
@pytest.mark.parametrize("press", ["indent", "touch", "compliance"])
def test_nothing_is_pressed_unless_mounted_placed_and_clear(
    spoil: Callable[[PlainBench], None], said: str, press: str
) -> None:
    bench = _bench()
    bench.ready()
    spoil(bench)
    moves = bench.stage.moves
    with pytest.raises(NotReadyError, match=f"^indent: .*{said}"):
        _press(bench, press)
    assert bench.stage.moves == moves


def _press(bench: PlainBench, press: str) -> None:
    if press == "indent":
        indent(bench.engine, Target("doi_mm", 0.5))
    elif press == "touch":
        touch_place(bench.engine, 0, 0.0)
    else:
        measure_compliance(bench.engine, 5.0)


@pytest.mark.parametrize("press", ["indent", "touch", "compliance"])
def test_nothing_is_pressed_unless_zeroed_or_once_the_finger_was_touched_for_too_long(press: str) -> None:
    bench = _bench()
    verbs.mount(bench.engine, "bar:3.0")
    verbs.home(bench.engine)
    verbs.move_to(bench.engine, 0.0)
    with pytest.raises(NotReadyError, match="has not been zeroed"):
        _press(bench, press)
    bench = _bench()
    bench.ready()
    bench.engine.contact.begin()
    bench.clock.wait_s(3600.5)
    bench.engine.contact.end()
    moves = bench.stage.moves
    with pytest.raises(LimitError, match=r"limits\.max_contact_s = 3600"):
        _press(bench, press)
    assert bench.stage.moves == moves


def test_whoever_is_ready_is_told_nothing() -> None:
    ready_to_indent(_bench().ready())
