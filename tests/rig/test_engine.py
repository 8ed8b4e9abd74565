"""What the engine lets each verb do, and how it stops."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from rig.data.journal import read_journal
from rig.devices.base import StageAlarm, StageReset
from rig.engine import LimitError, NotReadyError, PressId, RunAborted, Target, TripError, indent, verbs
from rig.engine.engine import State
from rig.settings import RigSettings
from rig.units import GWT_N
from tests.error_codes import raises

STOP = b"!\x18"
Make = Callable[..., Any]
FORCE = Target("force_gwt", 2.33)


def _press(engine: Any, target: Target = FORCE, **manner: Any) -> Any:
    return indent(engine, target, **{"hold_s": 0.2, **manner})


# --- which verb is allowed when ---


def test_nothing_moves_unhomed(spring: Make) -> None:
    bench = spring()
    engine = bench.engine
    verbs.mount(engine, "bar:3.0")
    for verb, act in (
        ("zero", partial(verbs.zero, engine)),
        ("move_to", lambda: verbs.move_to(engine, 0.0)),
        ("indent", lambda: _press(engine)),
        ("retract", partial(verbs.retract, engine)),
    ):
        with raises(NotReadyError, "not_allowed", verb=verb, state="unhomed"):
            act()
    assert bench.sent("stage") == []
    assert [stream for stream, _ in bench.events] == ["mount"]


def test_no_indentation_without_zero_or_indentor(spring: Make) -> None:
    engine = spring().engine
    verbs.home(engine)
    verbs.move_to(engine, 0.0)
    with raises(NotReadyError, "no_indentor"):
        _press(engine)
    verbs.mount(engine, "bar:3.0")
    with raises(NotReadyError, "not_zeroed"):
        _press(engine)
    verbs.zero(engine)
    assert _press(engine).index == 0


def test_nothing_but_lifting_and_homing_in_contact(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    engine.go_to_height(1.96, 0.5)
    assert engine.state is State.IN_CONTACT
    for verb, act in (
        ("zero", partial(verbs.zero, engine)),
        ("move_to", lambda: verbs.move_to(engine, 1.0)),
        ("indent", lambda: _press(engine)),
    ):
        with raises(NotReadyError, "not_allowed", verb=verb, state="in contact"):
            act()
    with raises(NotReadyError, "may_touch", state="in contact"):
        verbs.mount(engine, "step:1")
    verbs.retract(engine)
    assert engine.state is State.READY
    assert bench.height_mm == pytest.approx(2.0, abs=0.002)
    verbs.move_to(engine, 1.0)


@pytest.mark.parametrize("x_mm", [-6.01, 6.01, float("nan"), float("inf")])
def test_lateral_limits(spring: Make, x_mm: float) -> None:
    bench = spring()
    engine = bench.ready()
    before = len(bench.moves())
    with raises(LimitError, "outside_limits", axis="x", low_mm=-6.0, high_mm=6.0) as refused:
        verbs.move_to(engine, x_mm)
    assert refused.value.fields["at_mm"] == pytest.approx(x_mm, nan_ok=True)
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


def test_each_verb_is_journalled(spring: Make) -> None:
    bench = spring()
    engine = bench.ready(0.5)
    verbs.note(engine, "a word")
    verbs.retract(engine)
    assert bench.mounted == "bar:3.0"
    assert [stream for stream, _ in bench.events] == ["mount", "home", "zero", "sample", "move", "note", "retract"]
    assert bench.of("home")[0]["controller"].startswith("[VER:1.1h")
    assert bench.of("zero")[0]["sensor"] == "MT-SICS balance 0123456789"
    assert bench.of("move")[0] == {"x_mm": 0.5, "along_mm": 0.0, "height_mm": 2.0}
    documents = list(read_journal(bench.journal_path))
    assert [d["stream"] for d in documents if d["doc"] == "event"] == [stream for stream, _ in bench.events]


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


def test_a_trip_lifts_latches_and_is_journalled(spring: Make) -> None:
    """A finger much stiffer than predicted."""
    bench = spring(k_gwt=4000.0, soft_trip_n=0.02)
    engine = bench.ready()
    with raises(TripError, "soft_trip", limit_gwt=0.02 / GWT_N) as tripped:
        _press(engine)
    assert engine.state is State.TRIPPED
    assert bench.height_mm == pytest.approx(2.0, abs=0.002)
    assert bench.force_n(bench.clock.monotonic_s()) == 0.0
    last_sample, trip, lift = bench.events[-3:]
    assert (last_sample[0], trip[0], lift[0]) == ("sample", "trip", "retract")
    assert trip[1]["force_gwt"] == pytest.approx(last_sample[1]["force_gwt"], abs=1e-6)
    assert trip[1]["reason"] == str(tripped.value)
    assert trip[1]["force_gwt"] == pytest.approx(tripped.value.fields["force_gwt"], abs=1e-6)
    for verb, act in (
        ("zero", partial(verbs.zero, engine)),
        ("retract", partial(verbs.retract, engine)),
        ("move_to", lambda: verbs.move_to(engine, 0.0)),
        ("indent", lambda: _press(engine)),
    ):
        with raises(NotReadyError, "not_allowed", verb=verb, state="tripped"):
            act()
    with raises(NotReadyError, "tripped"):
        verbs.home(engine)


def test_the_soft_trip_is_the_lower_of_limit_and_prediction(spring: Make) -> None:
    assert spring(soft_trip_n=0.5).engine.trips.soft_gwt == pytest.approx(50.986, abs=1e-3)
    assert spring(soft_trip_n=50.0).engine.trips.soft_gwt == pytest.approx(203.943, abs=1e-3)
    assert spring().engine.trips.soft_gwt == pytest.approx(203.943, abs=1e-3)


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


@pytest.mark.parametrize("phase", ["approach", "touch", "press"])
def test_an_interrupt_lifts_journals_and_ends_the_run(spring: Make, phase: str) -> None:
    bench = spring()
    engine = bench.ready()
    bench.interrupt = lambda: any(e["phase"] == phase for e in bench.of("sample"))
    with raises(RunAborted, "stopped_at_a_safe_point"):
        _press(engine)
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


@pytest.mark.parametrize("phase", ["approach", "touch", "press", "hold"])
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


def test_an_overloaded_balance_stops_the_stage(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    _at_first(bench, "press", lambda: setattr(bench, "k_gwt", 1e5))
    with raises(TripError, "no_reading", error_code="overload"):
        _press(engine)
    assert bench.height_mm == pytest.approx(2.0, abs=0.002)
    assert engine.state is State.TRIPPED


@pytest.mark.parametrize("phase", ["approach", "touch", "press"])
def test_an_alarm_stops_the_stage(spring: Make, phase: str) -> None:
    bench = spring()
    engine = bench.ready()
    _at_first(bench, phase, lambda: bench.stage_line.device_write(b"ALARM:1\r\n"))
    with raises(StageAlarm, "alarm", number=1):
        _press(engine)
    assert bench.sent("stage")[-1][1] == STOP
    assert engine.state is State.UNHOMED


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


def test_stop_goes_out_in_one_write_and_trusts_nothing_after(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    engine.stop()
    assert bench.sent("stage")[-1][1] == STOP
    assert engine.state is State.UNHOMED
    with raises(NotReadyError, "not_allowed", verb="retract", state="unhomed"):
        verbs.retract(engine)


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


def test_the_journal_of_a_bench_lies_where_it_was_put(spring: Make, tmp_path: Path) -> None:
    bench = spring()
    bench.ready()
    assert bench.journal_path.is_relative_to(tmp_path)
    assert len(list(read_journal(bench.journal_path))) == 10  # five events, each with its descriptor
