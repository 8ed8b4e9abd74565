"""The heartbeat by itself, how far a stage goes on, and the small records of an indentation."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from rig.engine import Target, TripError, indent
from rig.engine.limits import Heartbeat, Stopping
from rig.settings import RigSettings
from sim.devices.clock import VirtualClock
from tests.error_codes import raises

# --- the heartbeat ---


def _watched() -> tuple[VirtualClock, Heartbeat, list[float]]:
    clock = VirtualClock(1.7e9, 100.0)
    stopped_s = list[float]()
    return clock, Heartbeat(clock, lambda: stopped_s.append(clock.monotonic_s())), stopped_s


def test_a_missed_heartbeat_stops_the_stage_once() -> None:
    clock, heartbeat, stopped_s = _watched()
    heartbeat.beat(0.5)
    clock.wait_s(0.4)
    heartbeat.look()
    assert (heartbeat.lost, stopped_s) == (False, [])
    clock.wait_s(0.2)
    for _ in range(3):
        heartbeat.look()
        clock.wait_s(1.0)
    assert heartbeat.lost
    assert stopped_s == [pytest.approx(100.6)]


@pytest.mark.parametrize("rested", [False, True], ids=["never begun", "rested"])
def test_a_heartbeat_that_rests_never_stops_the_stage(rested: bool) -> None:
    clock, heartbeat, stopped_s = _watched()
    if rested:
        heartbeat.beat(0.5)
        heartbeat.rest()
    clock.wait_s(3600.0)
    heartbeat.look()
    assert (heartbeat.lost, stopped_s) == (False, [])


# --- a computer that was suspended ---


def test_a_computer_that_was_suspended_in_a_touch_lifts_and_counts_the_time(spring: Callable[..., Any]) -> None:
    """The monotonic clock stood still for an hour: a hold would otherwise be as long as commanded."""
    bench = spring()
    engine = bench.ready()

    def sleep(stream: str, data: Mapping[str, Any]) -> None:
        if stream == "hold_start":
            bench.clock.suspended_s = lambda: 3600.0

    bench.on_event = sleep
    with raises(TripError, "suspended", for_s=3600.0):
        indent(engine, Target("force_gwt", 1.0), hold_s=0.5)
    assert engine.height_mm == 2.0
    assert engine.known_contact.kind == "lifted"
    assert bench.of("trip")[0]["contact_s"] > 3600.0
    assert bench.of("hold_end") == []


def test_a_suspension_during_a_motion_ends_the_motion_and_trips(spring: Callable[..., Any]) -> None:
    bench = spring()
    engine = bench.ready()
    engine.go_to_height(1.96, 0.5)
    bench.clock.call_at(bench.clock.monotonic_s() + 0.03, lambda: setattr(bench.clock, "suspended_s", lambda: 9.0))
    with raises(TripError, "suspended", for_s=9.0):
        engine.go_to_height(1.92, 0.1)
    assert engine.height_mm == 2.0


def test_a_suspension_in_the_air_does_not_trip(spring: Callable[..., Any]) -> None:
    bench = spring()
    engine = bench.ready()
    bench.clock.suspended_s = lambda: 3600.0
    indent(engine, Target("force_gwt", 1.0), hold_s=0.0)
    assert engine.contact_time.total_s < 60.0


# --- how far a stage goes on ---


@pytest.mark.parametrize(
    ("speed_mm_s", "late_s", "distance_mm"),
    [
        (1.0, 0.02, 0.030),  # 0.02 + 1/100
        (0.5, 0.02, 0.0125),  # 0.01 + 0.25/100
        (2.0, 0.005, 0.050),  # 0.01 + 4/100
        (4.0, 0.01, 0.200),  # 0.04 + 16/100
        (5.0, 0.10, 0.300),  # 0.75 free, and no more than is queued
    ],
)
def test_the_stopping_distance_is_speed_times_latency_and_the_braking_distance(
    speed_mm_s: float, late_s: float, distance_mm: float
) -> None:
    assert Stopping(speed_mm_s, late_s, 50.0, most_mm=0.3).distance_mm == pytest.approx(distance_mm)


def test_the_latency_of_a_stop_is_that_of_sensor_reading_and_controller() -> None:
    """0.02 s, three sample periods of 0.05 s, and 0.11 s that a controller has prepared."""
    settings = RigSettings.model_validate(
        {
            "force": {"latency_s": 0.02, "sample_period_s": 0.05},
            "habits": {"settle_readings": 3, "increment_mm": 0.04},
            "stage": {"acceleration_mm_s2": 80.0},
        }
    )
    assert Stopping.of(settings, 0.7) == Stopping(0.7, pytest.approx(0.28), 80.0, 0.04)


def test_the_overshoot_is_the_force_gained_over_the_stopping_distance() -> None:
    """2 gwt at 2 mm: the trip of 16 gwt is at 2 · 8^(2/3) = 8 mm, and twice as deep it is 2^1.5 times as much."""
    stopping = Stopping(1.0, 100.0, 50.0, most_mm=8.0)
    assert stopping.overshoot_gwt(16.0, 2.0, 2.0) == pytest.approx(16.0 * (math.sqrt(8.0) - 1.0))
