"""The engine over a virtual board and balance: places it refuses, stops of an operator, devices that fail."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from rig.devices.base import StageReset
from rig.engine import LimitError, NotReadyError, PressId, RunAborted, Target, TripError, indent, verbs
from rig.engine.engine import State
from rig.settings import RigSettings
from rig.units import GWT_N
from tests.error_codes import raises

Make = Callable[..., Any]
FORCE = Target("force_gwt", 2.33)


def _press(engine: Any, target: Target = FORCE, **manner: Any) -> Any:
    return indent(engine, target, **{"hold_s": 0.2, **manner})


# --- which verb is allowed when ---


def test_no_place_outside_the_lateral_limits_is_gone_to(spring: Make) -> None:
    """limits.x_mm is ± 6, limits.along_mm ± 4."""
    bench = spring()
    engine = bench.ready()
    before = len(bench.moves())
    for x_mm, along_mm in ((-6.01, 0.0), (6.01, 0.0), (math.nan, 0.0), (math.inf, 0.0), (0.0, -4.01), (0.0, 4.01)):
        with raises(LimitError, "outside_limits"):
            verbs.move_to(engine, x_mm, along_mm)
    assert len(bench.moves()) == before
    assert engine.state is State.READY


def test_a_long_move_down_below_clearance_is_refused_unsent(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    before = len(bench.moves())
    for height in (1.9, 0.0, -1.0):
        with raises(LimitError, "longer_than_an_increment", to_mm=height):
            engine.go_to_height(height, 0.5)
    assert len(bench.moves()) == before


def test_a_reading_is_of_after_the_move(spring: Make) -> None:
    """The balance samples on its own grid: what is read must be a sample taken at rest."""
    bench = spring(contact_mm=1.99)
    engine = bench.ready()
    for n in range(20):
        engine.go_to_height(engine.height_mm - 0.0213, 0.5)
        read = engine.read_force_gwt(PressId(0), "touch")
        depth = bench.contact_mm - bench.height_mm
        assert read == pytest.approx(6.0 * max(depth, 0.0) ** 1.5, abs=0.005 + 1e-6), n


# --- trips ---


def test_a_finger_that_stiffens_in_the_hold_trips(spring: Make) -> None:
    bench = spring(soft_trip_n=0.05)
    engine = bench.ready()

    def stiffen(stream: str, data: Mapping[str, Any]) -> None:
        if stream == "sample" and data["phase"] == "hold":
            bench.k_gwt = 60.0

    bench.on_event = stiffen
    with raises(TripError, "soft_trip", limit_gwt=0.05 / GWT_N):
        _press(engine, hold_s=1.0)
    assert bench.of("sample")[-1]["phase"] == "hold"
    assert bench.height_mm == pytest.approx(2.0, abs=0.002)
    assert bench.of("hold_end") == []


# --- an operator's stop ---


@pytest.mark.parametrize("phase", ["approach", "touch", "press", "hold"])
def test_an_interrupt_lifts_journals_and_ends_the_run(spring: Make, phase: str) -> None:
    bench = spring()
    engine = bench.ready()
    bench.interrupt = lambda: any(e["phase"] == phase for e in bench.of("sample"))
    with raises(RunAborted, "stopped_at_a_safe_point"):
        _press(engine, hold_s=600.0)
    assert [stream for stream, _ in bench.events[-3:]] == ["sample", "retract", "paused"]
    assert bench.of("sample")[-1]["phase"] == phase
    assert bench.of("paused") == [{"reason": "operator"}]
    assert bench.height_mm == pytest.approx(2.0, abs=0.002)
    assert engine.state is State.READY


def test_an_interrupt_between_indentations_moves_nothing(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    before = len(bench.moves())
    bench.interrupt = lambda: True
    with raises(RunAborted, "stopped_at_a_safe_point"):
        verbs.move_to(engine, 1.0)
    with raises(RunAborted, "stopped_at_a_safe_point"):
        _press(engine)
    assert len(bench.moves()) == before
    assert bench.of("indentation_start") == []


# --- devices that fail ---


def _at_first(bench: Any, phase: str, act: Callable[[], None]) -> None:
    """Do something once, when the first sample of a phase is on disk."""
    left = [act]

    def look(stream: str, data: Mapping[str, Any]) -> None:
        if left and stream == "sample" and data["phase"] == phase:
            left.pop()()

    bench.on_event = look


@pytest.mark.parametrize("phase", ["approach", "hold"])
def test_a_silent_balance_stops_the_stage(spring: Make, phase: str) -> None:
    bench = spring()
    engine = bench.ready()
    _at_first(bench, phase, lambda: setattr(bench.balance, "mute", True))
    with raises(TripError, "no_reading", error_code="no_reply"):
        _press(engine)
    asked_s = [t for t, data in bench.sent("force") if data == b"SI\r\n"][-1]
    lift_s = next(t for t, data in bench.sent("stage") if t > asked_s)
    assert lift_s == pytest.approx(asked_s + 0.5, abs=1e-6)
    assert bench.height_mm == pytest.approx(2.0, abs=0.002)
    assert engine.state is State.TRIPPED
    with raises(NotReadyError, "not_allowed", verb="indent", state="tripped"):
        _press(engine)


def test_a_board_that_restarts_in_a_move_stops_the_run_and_homing_mends_it(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    _at_first(bench, "press", lambda: bench.clock.call_at(bench.clock.monotonic_s() + 0.06, bench.board.power_cycle))
    with pytest.raises(StageReset):
        _press(engine)
    assert engine.state is State.UNHOMED
    bench.clock.wait_s(1.0)
    verbs.home(engine)
    verbs.zero(engine)
    verbs.move_to(engine, 0.0)
    assert _press(engine).holds[0].force_gwt == pytest.approx(2.33, abs=0.05)


def test_a_frame_of_its_own(spring: Make) -> None:
    """Machine coordinates are the frame's; the finger's do not change."""
    settings = RigSettings.model_validate(
        {"frame": {"pad_centre_x_mm": -20.0, "pad_y_mm": -10.0, "apex_z_mm": -15.0}}
    )
    bench = spring(settings=settings)
    engine = bench.ready(1.0)
    assert bench.true_pose() == pytest.approx((1.0, -2.3), abs=0.002)
    aside = next(move for move in bench.moves() if "X" in move)
    assert aside == pytest.approx({"X": -19.0, "Y": -10.0, "F": 300.0})
    assert _press(engine).holds[0].force_gwt == pytest.approx(2.33, abs=0.05)
