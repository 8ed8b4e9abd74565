"""One indentation: approach, touch off, press, hold, lift; its pauses, its pulses, and its reference."""

import itertools
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from rig.devices.base import StageError
from rig.engine import (
    Engine,
    Hold,
    Indentation,
    LimitError,
    NotReadyError,
    PressId,
    RunAborted,
    Target,
    TripError,
    indent,
    verbs,
)
from rig.engine.engine import State
from rig.engine.indentation import touch_place
from rig.engine.reference import compare_reference, measure_compliance
from rig.engine.sync_pulse import pulse
from rig.records import Purpose
from rig.settings import RigSettings
from rig.units import GWT_N
from tests.error_codes import raises
from tests.rig.plain_bench import PlainBench

Make = Callable[..., Any]


def _tolerance(gwt: float) -> float:
    return max(0.05, 0.01 * gwt)


def _drops_below_clearance(bench: Any) -> list[float]:
    """How far each move went down below clearance, from the bytes."""
    clearance_z = bench.settings.frame.apex_z_mm + bench.settings.habits.clearance_mm
    heights = [move["Z"] for move in bench.moves() if "Z" in move]
    below = [(before, after) for before, after in itertools.pairwise(heights) if after < min(before, clearance_z)]
    return [min(before, clearance_z) - after for before, after in below]


@pytest.mark.parametrize("doi_mm", [0.02, 0.33, 1.5])
def test_indent_reaches_a_depth_within_one_motor_step(spring: Make, doi_mm: float) -> None:
    bench = spring()
    done = indent(bench.ready(), Target("doi_mm", doi_mm), hold_s=0.2)
    assert done.holds[0].doi_mm == pytest.approx(doi_mm, abs=0.0025)
    end, touch = bench.of("hold_end")[0], bench.of("touch")[0]
    # The true depth differs by what the touch-off missed, and by the step that the board rounds to.
    assert end["true_doi_mm"] - end["doi_mm"] == pytest.approx(touch["true_doi_bias_mm"], abs=0.0025)
    assert abs(touch["true_doi_bias_mm"]) < 0.012
    assert end["force_gwt"] == pytest.approx(6.0 * end["true_doi_mm"] ** 1.5, abs=0.006)


def test_an_indentation_in_four_increments_has_four_holds(spring: Make) -> None:
    bench = spring()
    done = indent(bench.ready(), Target("doi_mm", 1.0), increments=4, hold_s=0.2)
    assert [hold.doi_mm for hold in done.holds] == pytest.approx([0.25, 0.5, 0.75, 1.0], abs=0.0025)
    assert [e["commanded"] for e in bench.of("hold_start")] == [0.25, 0.5, 0.75, 1.0]
    assert [e["hold"] for e in bench.of("hold_end")] == [1, 2, 3, 4]
    (end,) = bench.of("indentation_end")
    samples_s = 0.05 * len(bench.of("sample"))
    assert samples_s < end["duration_s"] < bench.clock.monotonic_s()
    assert len(bench.of("touch")) == 1
    forces = [hold.force_gwt for hold in done.holds]
    assert forces == sorted(forces)


@pytest.mark.parametrize("hold_s", [0.0, 0.05, 2.5, 1.0])
def test_a_hold_lasts_as_long_as_requested_and_one_second_by_default(spring: Make, hold_s: float) -> None:
    bench = spring()
    indent(bench.ready(), Target("doi_mm", 0.5), **({} if hold_s == 1.0 else {"hold_s": hold_s}))
    end = bench.of("hold_end")[0]
    # At least as long, and not by more than one reading over the line.
    assert hold_s <= end["hold_s"] <= hold_s + 0.1
    assert end["readings"] == sum(e["phase"] == "hold" for e in bench.of("sample")) >= 1


@given(
    k_gwt=st.floats(2.0, 30.0),
    contact_mm=st.floats(-1.0, 1.0),
    force_gwt=st.floats(0.2, 5.0),
)
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_indent_reaches_any_force_on_any_spring_within_tolerance(
    spring: Make, k_gwt: float, contact_mm: float, force_gwt: float
) -> None:
    depth_mm = (force_gwt / k_gwt) ** (2 / 3)
    # Within reach, and not so stiff that one step of the stage is more than the tolerance is wide.
    assume(depth_mm < 1.4 and 1.5 * force_gwt / depth_mm * 0.0025 < 0.03)
    bench = spring(k_gwt=k_gwt, contact_mm=contact_mm)
    done = indent(bench.ready(), Target("force_gwt", force_gwt), hold_s=0.1, expected_contact_mm=contact_mm)
    assert done.holds[0].force_gwt == pytest.approx(force_gwt, abs=_tolerance(force_gwt))
    assert max(_drops_below_clearance(bench)) <= 0.05 + 1e-4


# --- the recording amplifier, and a rig that gives ---


@pytest.mark.parametrize(("output", "on", "off"), [("coolant", "M8", "M9"), ("spindle", "M3", "M5")])
def test_a_board_output_pulses_at_contact_hold_start_and_hold_end(
    spring: Make, output: str, on: str, off: str
) -> None:
    bench = spring(settings=RigSettings.model_validate({"sync": {"output": output, "width_s": 0.02}}))
    indent(bench.ready(), Target("force_gwt", 2.0), increments=2, hold_s=0.2)
    pulses = bench.of("sync")
    assert [p["at"] for p in pulses] == ["touch", "hold_start", "hold_end", "hold_start", "hold_end"]
    switched = list(bench.board.outputs)
    assert [word for _, word in switched] == [on, off] * 5
    for each, (rise_s, _), (fall_s, _) in zip(pulses, switched[::2], switched[1::2], strict=True):
        assert each["rise_s"] - each["uncertainty_s"] <= rise_s <= each["rise_s"]
        assert each["uncertainty_s"] < 0.005
        assert fall_s - rise_s == pytest.approx(0.02, abs=0.005)
        assert each["width_s"] == pytest.approx(0.02, abs=0.005)


@pytest.mark.parametrize("broken", [True, False])
def test_a_sync_output_that_fails_stops_the_stage(broken: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether it is to rise or to fall."""

    def fails(on: bool) -> None:
        if on is broken:
            raise StageError("no output")

    bench = _plain(settings={"sync": {"output": "coolant"}})
    engine = bench.ready()
    monkeypatch.setattr(bench.stage, "set_output", fails)
    with pytest.raises(StageError):
        indent(engine, Target("doi_mm", 0.5), hold_s=0.1)
    assert engine.state is State.UNHOMED
    assert isinstance(engine.problem, StageError)


@pytest.mark.parametrize("purpose", ["data", "precondition", "reference", "find"])
@pytest.mark.parametrize("output", ["off", "coolant"])
def test_sync_pulses_mark_data_presses_only_and_need_an_output(purpose: Purpose, output: str) -> None:
    bench = _plain(settings={"sync": {"output": output}})
    pulse(bench.ready(), PressId(0, purpose), "touch")
    assert bool(bench.of("sync")) == bool(bench.stage.outputs) == ((purpose, output) == ("data", "coolant"))


def test_a_compliant_rig_travels_farther_by_its_own_deflection(spring: Make) -> None:
    """0.5 mm/N: at some 2.5 gwt, 25 mN, the stage goes 12 µm farther for the same depth."""
    given = {"value": 0.5, "date": "2026-01-01", "expires": "2027-01-01"}
    bench = spring(settings=RigSettings.model_validate({"calibration": {"compliance_mm_per_n": given}}))
    indent(bench.ready(), Target("doi_mm", 0.5), hold_s=0.2)
    end = bench.of("hold_end")[0]
    last = [s for s in bench.of("sample") if s["phase"] == "hold"][-1]
    travel_mm = bench.of("touch")[0]["contact_height_mm"] - last["height_mm"]
    assert end["doi_mm"] == pytest.approx(0.5, abs=0.00125 + 1e-6)
    assert travel_mm - end["doi_mm"] == pytest.approx(0.5 * end["force_gwt"] * 9.80665e-3, abs=1e-6)
    assert travel_mm - end["doi_mm"] > 0.01


# --- as a whole: pauses, and who may press ---

Felt = Callable[[PlainBench], float]
CONTACT_MM = -0.3


def _finger(bench: PlainBench) -> float:
    return round(bench.hertz(6.0, CONTACT_MM), 2)


def _plain(felt: Felt = _finger, settings: dict[str, Any] | None = None, **options: Any) -> PlainBench:
    return PlainBench(felt, settings or {}, **options)


@pytest.mark.parametrize("touch", [False, True])
@pytest.mark.parametrize(
    ("expected_mm", "contact_mm", "code", "fields"),
    [
        (0.25, -3.0, "no_contact", {"lowest_mm": -0.25}),
        (0.25, 0.85, "contact_too_high", {"highest_mm": 0.75}),
        (-0.25, -3.0, "no_contact", {"lowest_mm": -0.75}),
        (-0.25, 0.35, "contact_too_high", {"highest_mm": 0.25}),
    ],
)
def test_contact_outside_search_mm_of_its_predicted_height_trips(
    touch: bool, expected_mm: float, contact_mm: float, code: str, fields: dict[str, float]
) -> None:
    bench = _plain(lambda bench: bench.hertz(6.0, contact_mm))
    engine = bench.ready()
    with raises(TripError, code, **fields):
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
def test_an_indentation_that_is_ended_in_a_pause_lifts_before_the_pause(phase: str) -> None:
    bench = _plain()
    engine = bench.ready()
    bench.goes_on = False
    _pause_once(bench, phase)
    with raises(RunAborted, "stopped_at_a_safe_point"):
        indent(engine, Target("doi_mm", 0.5), hold_s=600.0)
    assert [stream for stream, _ in bench.events[-3:]] == ["sample", "retract", "paused"]
    assert bench.of("sample")[-1]["phase"] == phase
    assert bench.of("paused") == [{"reason": "operator"}]
    assert (engine.state, bench.height_mm) == (State.READY, pytest.approx(2.0))


def test_a_pause_between_indentations_moves_nothing() -> None:
    bench = _plain()
    engine = bench.ready()
    bench.goes_on, bench.wants_pause, moves = False, lambda: True, bench.stage.moves
    for verb in (lambda: verbs.move_to(engine, 1.0), lambda: indent(engine, Target("doi_mm", 0.5))):
        with raises(RunAborted, "stopped_at_a_safe_point"):
            verb()
    assert bench.stage.moves == moves
    assert bench.of("indentation_start") == []


@pytest.mark.parametrize("phase", ["approach", "touch", "press", "hold"])
def test_a_paused_indentation_starts_again_under_its_number(phase: str) -> None:
    bench = _plain()
    engine = bench.ready()
    asked = _pause_once(bench, phase)
    done = indent(engine, Target("doi_mm", 0.5), hold_s=0.5, contact_area_mm2=10.0)
    assert asked == [3]
    assert done.index == 0
    assert [event["index"] for event in bench.of("indentation_start")] == [0, 0]
    assert len(bench.of("indentation_end")) == len(bench.of("paused")) == len(bench.of("resumed")) == 1
    assert engine.next_index() == 1


def test_an_indentation_repeated_after_a_pause_keeps_its_pressure_limit() -> None:
    """300 kPa over 0.1 mm² are 3.06 gwt."""
    bench = _plain()
    engine = bench.ready()
    _pause_once(bench, "press")
    with raises(LimitError, "next_move_past_pressure_limit", limit_gwt=pytest.approx(0.03 / GWT_N)):
        indent(engine, Target("doi_mm", 1.0), contact_area_mm2=0.1)
    assert len(bench.of("indentation_start")) == 2


def test_a_paused_touch_starts_again() -> None:
    bench = _plain(lambda bench: round(bench.hertz(7.3, CONTACT_MM), 2))
    engine = bench.ready()
    asked = _pause_once(bench, "touch")
    found_mm = touch_place(engine, 4, 0.0)
    assert asked == [3]
    assert found_mm == pytest.approx(CONTACT_MM, abs=0.01)
    assert [event["index"] for event in bench.of("find")] == [4]
    assert engine.state is State.READY
    assert bench.height_mm == pytest.approx(2.0)


@pytest.mark.parametrize("touch", [False, True])
def test_a_press_that_exceeds_the_contact_time_lifts(touch: bool) -> None:
    """0.2 s are over in the touch-off; what was counted before this part of the run counts too."""
    bench = _plain(settings={"limits": {"max_contact_s": 100.0}}, contact_s=99.8)
    engine = bench.ready()
    with raises(LimitError, "contact_time", contact_s=pytest.approx(100.5, abs=0.5), limit_s=100.0):
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
    ("spoil", "code", "fields"),
    [
        (_unmounted, "no_indentor", {}),
        (_homed_again, "not_placed", {}),
        (_in_contact, "not_allowed", {"verb": "indent", "state": "in contact"}),
    ],
)
@pytest.mark.parametrize("press", ["indent", "touch", "compliance"])
def test_no_press_begins_unless_an_indentor_is_mounted_placed_and_clear(
    spoil: Callable[[PlainBench], None], code: str, fields: dict[str, str], press: str
) -> None:
    bench = _plain()
    bench.ready()
    spoil(bench)
    moves = bench.stage.moves
    with raises(NotReadyError, code, **fields):
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
def test_no_press_begins_without_a_zero_or_after_the_longest_contact_time(press: str) -> None:
    bench = _plain()
    verbs.mount(bench.engine, "bar:3.0")
    verbs.home(bench.engine)
    verbs.move_to(bench.engine, 0.0)
    with raises(NotReadyError, "not_zeroed"):
        _press(bench, press)
    bench = _plain()
    bench.ready()
    bench.engine.contact_time.begin()
    bench.clock.wait_s(3600.5)
    bench.engine.contact_time.end()
    moves = bench.stage.moves
    with raises(LimitError, "contact_time", limit_s=3600.0):
        _press(bench, press)
    assert bench.stage.moves == moves


# --- the reference ---


def _found(*gwt: float) -> Indentation:
    return Indentation(7, 0.0, tuple(Hold(Target("doi_mm", 0.5), 0.5, force, 0.0) for force in gwt))


@pytest.mark.parametrize(
    ("now_gwt", "deviation"),
    [((2.28, 4.0), 0.14), ((2.0, 3.44), -0.14), ((2.32, 3.9), 0.16), ((2.1, 3.36), -0.16)],
)
@pytest.mark.parametrize("resumed", [False, True])
def test_a_reference_press_is_compared_with_the_first_one(
    now_gwt: tuple[float, ...], deviation: float, resumed: bool
) -> None:
    """The hold that is farthest off counts, limits.reference_band = 0.15 is what it may be off by."""
    bench = _plain(settings={"limits": {"on_alarm": "trip"}})
    if resumed:
        bench.engine.first_reference_gwt = [2.0, 4.0]
    else:
        compare_reference(bench.engine, _found(2.0, 4.0))
        compare_reference(bench.engine, _found(2.2, 4.0))
    off = {"index": 7, "deviation": f"{deviation:+.1%}", "band": 0.15}
    with raises(TripError, "reference_off", **off) if abs(deviation) > 0.15 else nullcontext():
        compare_reference(bench.engine, _found(*now_gwt))
    assert bench.of("reference")[-1] == {"index": 7, "deviation": pytest.approx(deviation, abs=1e-6)}
    assert len(bench.of("alarm")) == (abs(deviation) > 0.15)


@pytest.mark.parametrize(
    ("low_gwt", "high_gwt", "within"), [(3.9, 4.1, True), (4.0, 4.0, True), (4.1, 5.0, False), (1.9, 3.9, False)]
)
def test_the_last_hold_of_a_reference_lies_in_the_band_of_an_identified_finger(
    low_gwt: float, high_gwt: float, within: bool
) -> None:
    bench = _plain(settings={"limits": {"on_alarm": "trip"}})
    off = {"index": 7, "force_gwt": 4.0, "low_gwt": low_gwt, "high_gwt": high_gwt}
    with nullcontext() if within else raises(TripError, "not_as_met", **off):
        compare_reference(bench.engine, _found(2.0, 4.0), (low_gwt, high_gwt))
    assert len(bench.of("alarm")) == (not within)
