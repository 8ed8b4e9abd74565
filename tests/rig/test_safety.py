"""Trips, the heartbeat, and how far a stage goes on after it was told to stop."""

import threading
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from rig.clock import WallClock
from rig.engine import EngineError, Target, TripError, indent
from rig.engine.bench import monitored
from rig.engine.engine import State
from rig.engine.limits import Heartbeat, Stopping
from rig.settings import RigSettings
from rig.units import GWT_N
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.waiting import DEADLINE_S, until

Make = Callable[..., Any]
FORCE = Target("force_gwt", 2.33)
STOP = b"!\x18"


def _once(bench: Any, phase: str, act: Callable[[], object]) -> None:
    left = [act]

    def look(stream: str, data: Mapping[str, Any]) -> None:
        if left and stream == "sample" and data["phase"] == phase:
            left.pop()()

    bench.on_event = look


# --- what a trip does ---


@pytest.mark.parametrize(("on_trip", "height_mm"), [("retract", 2.0), ("park", 10.0), ("stop", None)])
def test_a_trip_lifts_as_configured(spring: Make, on_trip: str, height_mm: float | None) -> None:
    bench = spring(settings=RigSettings.model_validate({"limits": {"on_trip": on_trip}}), soft_trip_n=0.02)
    engine = bench.ready()
    _once(bench, "press", lambda: setattr(bench, "k_gwt", 100.0))
    with raises(TripError, "soft_trip", limit_gwt=0.02 / GWT_N):
        indent(engine, Target("force_gwt", 1.5))
    assert engine.state is State.TRIPPED
    if height_mm is None:
        assert bench.sent("stage")[-1][1] == STOP
        assert bench.height_mm < bench.contact_mm
    else:
        assert bench.height_mm == pytest.approx(height_mm, abs=0.002)


def test_a_force_above_the_pressure_limit_over_the_contact_area_trips(spring: Make) -> None:
    """300 kPa over 0.1 mm² is 0.03 N, 3.06 gwt."""
    bench = spring()
    engine = bench.ready()
    _once(bench, "press", lambda: setattr(bench, "k_gwt", 60.0))
    with raises(TripError, "pressure_limit", limit_gwt=0.03 / GWT_N):
        indent(engine, FORCE, contact_area_mm2=0.1)


# --- the heartbeat ---


class Watched(Heartbeat):
    """One that says how often it was looked at, and by whom; `slow`: a look takes its time."""

    looks = 0
    slow = False

    def look(self) -> None:
        super().look()
        self.thread = threading.current_thread()
        self.looks += 1
        if self.slow:
            sum(range(3_000_000))


def looked_at(heartbeat: Watched, times: int) -> None:
    seen = heartbeat.looks
    until(lambda: heartbeat.looks >= seen + times)


def test_the_heartbeat_stops_the_stage_when_the_engine_is_silent() -> None:
    """On the real clock: nobody beats, as in a read that never returns."""
    stopped_s: list[float] = []
    clock, stopped = WallClock(), threading.Event()
    heartbeat = Watched(clock, lambda: (stopped_s.append(clock.monotonic_s()), stopped.set()))
    with monitored(heartbeat):
        began_s = clock.monotonic_s()
        heartbeat.beat(0.1)
        assert stopped.wait(DEADLINE_S)
        looked_at(heartbeat, 3)
    assert heartbeat.lost
    assert len(stopped_s) == 1
    assert stopped_s[0] >= began_s + 0.1


def test_the_heartbeat_does_not_stop_a_beating_or_resting_engine() -> None:
    stopped: list[bool] = []
    clock = VirtualClock()
    heartbeat = Watched(clock, lambda: stopped.append(True))
    with monitored(heartbeat):
        for _ in range(5):
            heartbeat.beat(0.5)
            clock.wait_s(0.45)
            looked_at(heartbeat, 3)
        heartbeat.rest()
        clock.wait_s(60.0)
        looked_at(heartbeat, 3)
        heartbeat.slow = True
        looked_at(heartbeat, 1)  # and it has not finished looking
    assert not stopped
    thread = heartbeat.thread  # by its name in a debugger, of no program that ends, and gone with what it watched
    assert (thread.name, thread.daemon, thread.is_alive()) == ("heartbeat", True, False)


def test_a_lost_heartbeat_stops_the_stage_and_trips(spring: Make) -> None:
    """A disk that hangs under the journal: the stop goes out meanwhile, and nothing moves after it."""
    bench = spring()
    engine = bench.ready()
    engine.heartbeat = heartbeat = Heartbeat(bench.clock, engine._stop_stage)

    def hang() -> None:
        bench.clock.call_at(bench.clock.monotonic_s() + 3.5, heartbeat.look)
        bench.clock.wait_s(60.0)

    _once(bench, "press", hang)
    with raises(TripError, "heartbeat_lost"):
        indent(engine, FORCE)
    sent = bench.sent("stage")
    assert sent[-1][1] == STOP
    assert sent[-1][0] - sent[-2][0] == pytest.approx(3.5, abs=0.2)
    assert engine.state is State.TRIPPED


# --- how far it goes on ---


@pytest.mark.parametrize(("speed_mm_s", "latency_s"), [(0.5, 0.1), (5.0, 0.02)])
def test_the_stage_stops_within_the_computed_stopping_distance(
    spring: Make, speed_mm_s: float, latency_s: float
) -> None:
    """Told to stop in mid-move so much later: v · latency + v² / 2a, measured on the carriage, one step allowed."""
    bench = spring()
    bench.ready()
    clock, heights = bench.clock, []
    start_s = clock.monotonic_s() + 2.0 / speed_mm_s * 0.25
    clock.call_at(start_s, lambda: heights.append(bench.height_mm))
    clock.call_at(start_s + latency_s, bench.engine.stop)
    bench.stage_line.host_write(f"G53G1G90G21Z-26F{60 * speed_mm_s:.3f}\n".encode())
    clock.wait_s(3.0)
    gone_mm = heights[0] - bench.height_mm
    stopping = Stopping(speed_mm_s, latency_s, 50.0, most_mm=10.0)
    assert 0.5 * speed_mm_s * latency_s < gone_mm <= stopping.distance_mm + 0.0025


@pytest.mark.parametrize("k_gwt", [60.0, 4000.0])
def test_a_stiff_object_is_pressed_no_harder_than_trip_and_overshoot(spring: Make, k_gwt: float) -> None:
    """The true force at every step of the stage, against trip and overshoot at the true stiffness."""
    bench = spring(k_gwt=k_gwt, soft_trip_n=0.02)
    engine = bench.ready()
    felt = [0.0]
    step = bench.force_n

    def watch() -> None:
        felt[0] = max(felt[0], step(bench.clock.monotonic_s()))
        bench.clock.call_at(bench.clock.monotonic_s() + 0.002, watch)

    watch()
    with pytest.raises(EngineError) as ended:
        indent(engine, Target("doi_mm", 1.0))
    assert ended.value.code in ("soft_trip", "next_move_past_soft_trip")
    trip_gwt = engine.trips.soft_gwt
    bound = trip_gwt + Stopping.of(bench.settings, 1.0).overshoot_gwt(trip_gwt, k_gwt, 1.0)
    assert 0.05 < felt[0] / GWT_N <= bound


def test_the_hard_trip_acts_whatever_was_predicted(spring: Make) -> None:
    settings = RigSettings.model_validate({"limits": {"soft_trip_n": 0.05, "hard_trip_n": 0.05}})
    bench = spring(settings=settings, soft_trip_n=4.0)
    engine = bench.ready()
    _once(bench, "press", lambda: setattr(bench, "k_gwt", 300.0))
    with raises(TripError, "hard_trip", limit_gwt=0.05 / GWT_N):
        indent(engine, FORCE)
