"""A vibration about a preload: what it does, what ends it, and what is refused."""

import itertools
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.devices.base import StageError
from rig.devices.registry import BUILT_IN, StageKind, find
from rig.devices.zaber import ZaberAxis
from rig.engine import LimitError, NotReadyError, RecordError, RunAborted, Target, TripError, verbs
from rig.engine.bench import Pause
from rig.engine.corridor import PRINTED_MM
from rig.engine.engine import State
from rig.engine.indentation import vibrate
from rig.engine.limits import RELAXED_TO, TRIP_MARGIN, UNREAD_S, Stopping, Trips, VibrationBound, highest_vibration_hz
from rig.engine.press import Still
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.nerve import visits_of
from rig.plan.plan import Plan, make_plan
from rig.protocol.script import Script, load_script
from rig.records import Indentation, SineMotion
from rig.session.rehearsal_summary import preflight
from rig.session.resume import read_stopped
from rig.session.session import NewRun, Session, dry_run
from rig.settings import RigSettings
from rig.units import GWT_N
from sim.models.fingertip import Fingertip
from studies.faults.campaign.world import BENCHES
from studies.faults.faulty_bench import PREDICTED, SOFT_TRIP_N, FaultyBench
from studies.faults.outcomes import bound_gwt
from tests.error_codes import raises

NEAR = {"frame": {"pad_centre_x_mm": -12.0, "apex_z_mm": -12.0}}
"""A short way from the switches, below where a virtual stage begins."""
ZABER: dict[str, Any] = {"stage": {"kind": "zaber"}, **NEAR}
PRELOAD = Target("doi_mm", 0.86)
SINE = SineMotion.of(4.0, 50.0, 2.0)
SLOW = SineMotion.of(1.0, 50.0, 4.0)


# --- the sine and its bound ---


@pytest.mark.parametrize(
    ("frequency_hz", "duration_s", "period_s", "cycles"),
    [(4.0, 2.0, 0.25, 8), (7.0, 1.0, 0.1429, 7), (3.0, 0.5, 0.3334, 1), (4.0, 0.0, 0.25, 1), (4.0, 2.2, 0.25, 9)],
)
def test_a_vibration_has_whole_cycles_and_is_no_faster_than_asked(
    frequency_hz: float, duration_s: float, period_s: float, cycles: int
) -> None:
    found = SineMotion.of(frequency_hz, 50.0, duration_s)
    assert (found.period_s, found.cycles) == (period_s, cycles)
    assert found.frequency_hz <= frequency_hz + 1e-9
    assert (found.amplitude_mm, found.duration_s) == (0.05, cycles * period_s)


@pytest.mark.parametrize("frequency_hz", [0.02, 0.5, 5.0])
@pytest.mark.parametrize("amplitude_um", [5.0, 50.0, 200.0])
def test_a_vibration_from_its_trip_ends_at_the_bound_of_a_press(frequency_hz: float, amplitude_um: float) -> None:
    """The way from end to end counts, or the distance of a ramp at the highest speed if it is shorter."""
    sine = SineMotion.of(frequency_hz, amplitude_um, 1.0)
    for tables in ({}, {"force": {"latency_s": 0.2}}, {"stage": {"acceleration_mm_s2": 5.0}}):
        for force_gwt, doi_mm in ((8.0, 0.86), (8.0, 1.4), (1.0, 0.1)):
            _ends_at_the_bound(RigSettings.model_validate(tables), sine, force_gwt, doi_mm)


def _ends_at_the_bound(settings: RigSettings, sine: SineMotion, force_gwt: float, doi_mm: float) -> None:
    bound = VibrationBound.of(settings, sine, 16.0, force_gwt, doi_mm)
    press = Stopping.of(settings, settings.limits.max_press_speed_mm_s)
    move = Stopping.in_one_move(settings, 2 * math.pi * sine.amplitude_mm / sine.period_s)
    assert bound.bound_gwt == 16.0 + press.overshoot_gwt(16.0, force_gwt, doi_mm)
    way_mm = 2 * sine.amplitude_mm + settings.stage.resolution_mm + PRINTED_MM
    assert bound.stop_mm == pytest.approx(min(move.distance_mm, way_mm))
    assert 0.0 <= bound.trip_gwt <= 16.0
    if 0.0 < bound.trip_gwt < 16.0:
        there_mm = doi_mm * (bound.trip_gwt / force_gwt) ** (2 / 3) + bound.stop_mm / RELAXED_TO
        assert force_gwt * (there_mm / doi_mm) ** 1.5 == pytest.approx(bound.bound_gwt)


def test_a_preload_shallower_than_the_way_of_a_stop_may_swing_no_force_at_all() -> None:
    """100 um at 8 Hz: a stop takes up to 0.2055 mm, which is deeper than the trip allows."""
    bound = VibrationBound.of(RigSettings(), SineMotion.of(8.0, 100.0, 1.0), 1.0, 0.05, 0.01)
    assert (bound.trip_gwt, bound.stop_mm) == (0.0, pytest.approx(0.2055))


def test_the_ends_follow_the_stiffness_of_tissue_that_has_relaxed() -> None:
    bound = VibrationBound.of(RigSettings(), SINE, 16.0, 8.0, 0.86)
    swing_gwt = 1.5 * 8.0 / 0.86 * 0.05 / RELAXED_TO
    assert (bound.least_gwt, bound.peak_gwt) == pytest.approx((8.0 - swing_gwt, 8.0 + swing_gwt))
    at_the_skin = 1000 * (8.0 - 0.05) / (1.5 * 8.0 / 0.86 / RELAXED_TO)
    assert bound.largest_um == pytest.approx(at_the_skin)


@pytest.mark.parametrize("amplitude_um", [5.0, 20.0, 100.0])
@pytest.mark.parametrize("acceleration_mm_s2", [50.0, 1000.0])
def test_the_highest_frequency_keeps_to_acceleration_and_speed(
    amplitude_um: float, acceleration_mm_s2: float
) -> None:
    tables = {"kind": "zaber", "acceleration_mm_s2": acceleration_mm_s2}
    settings = Config.model_validate({"stage": tables, "limits": {"max_press_speed_mm_s": 2.0}})
    highest_hz = highest_vibration_hz(settings, amplitude_um / 1000)
    omega = 2 * math.pi * highest_hz
    ratios = amplitude_um / 1000 * omega / 2.0, amplitude_um / 1000 * omega**2 / acceleration_mm_s2
    assert max(ratios) == pytest.approx(1.0)


def test_the_trip_of_a_vibration_has_its_name_until_the_next_press() -> None:
    trips = Trips(RigSettings().limits, 0.1)
    trips.move_at("vibration", 8.0)
    passed = trips.passed_any(8.1)
    assert passed is not None
    assert passed.code == "vibration_trip"
    trips.press_on(math.inf)
    assert trips.passed_any(8.1) is None


# --- what a vibration does ---


def _bench(folder: Path, tables: dict[str, Any] | None = None) -> FaultyBench:
    bench = FaultyBench(folder, {**ZABER, "limits": {"soft_trip_n": SOFT_TRIP_N}, **(tables or {})})
    verbs.mount(bench.engine, "bar:3.0")
    verbs.home(bench.engine)
    verbs.zero(bench.engine)
    verbs.move_to(bench.engine, 0.0)
    return bench


@pytest.fixture
def faulty(tmp_path: Path) -> Iterator[FaultyBench]:
    """A bench of Zaber's stage, ready at x = 0, that keeps its events."""
    bench = _bench(tmp_path)
    yield bench
    bench.journal.close()


def _vibrate(bench: FaultyBench, sine: SineMotion = SINE, target: Target = PRELOAD) -> Indentation:
    return vibrate(bench.engine, target, sine, expected_contact_mm=PREDICTED.contact_mm)


def _events(bench: FaultyBench) -> list[tuple[str, dict[str, Any]]]:
    documents = map(json.loads, bench.journal_path.read_text(encoding="utf-8").splitlines())
    return [(one["stream"], one["data"]) for one in documents if one.get("doc") == "event"]


def _of(bench: FaultyBench, stream: str, phase: str | None = None) -> list[dict[str, Any]]:
    found = [data for name, data in _events(bench) if name == stream]
    return [data for data in found if data["phase"] == phase] if phase else found


def _in_the_vibration(bench: FaultyBench, act: Callable[[], object], after_s: float = 0.7) -> None:
    """Act once, so long after the vibration has begun."""

    def begin() -> None:
        bench.worst_n = 0.0
        bench.clock.call_at(bench.clock.monotonic_s() + after_s, act)

    bench.after("vibrate", begin)


def test_events_of_a_vibration_in_order(faulty: FaultyBench) -> None:
    done = _vibrate(faulty)
    events = _events(faulty)
    first = next(n for n, (stream, _) in enumerate(events) if stream == "indentation_start")
    assert [key for key, _ in itertools.groupby(stream for stream, _ in events[first:])] == [
        "indentation_start", "sample", "touch", "sample", "hold_start", "vibrate", "sample", "hold_end", "retract",
        "indentation_end",
    ]  # fmt: skip
    phases = [key for key, _ in itertools.groupby(data["phase"] for stream, data in events if stream == "sample")]
    assert phases == ["clearance", "approach", "back off", "touch", "press", "vibrate", "hold"]
    (begun,), (end,), (hold,) = _of(faulty, "vibrate"), _of(faulty, "hold_end"), done.holds
    assert (begun["frequency_hz"], begun["amplitude_um"], begun["cycles"]) == (4.0, 50.0, 8)
    assert begun["preload_mm"] == pytest.approx(0.86, abs=0.002)
    assert begun["measured_gwt"] == pytest.approx(10 * 0.86**1.5, rel=0.01)
    bound = VibrationBound.of(faulty.config, SINE, SOFT_TRIP_N / GWT_N, begun["measured_gwt"], begun["preload_mm"])
    assert (begun["trip_gwt"], begun["bound_gwt"]) == pytest.approx((bound.trip_gwt, bound.bound_gwt), abs=1e-5)
    assert hold.doi_mm == end["doi_mm"] == pytest.approx(begun["preload_mm"], abs=1e-6)
    readings = [sample["force_gwt"] for sample in _of(faulty, "sample", "vibrate")]
    assert end["readings"] == len(readings) > 15
    assert hold.force_gwt == pytest.approx(sum(readings) / len(readings))
    assert end["peak_gwt"] == max(readings)
    assert (end["asked_s"], end["hold_s"]) == (2.0, pytest.approx(2.0, abs=0.5))
    assert faulty.engine.state is State.READY
    assert faulty.engine.trips.lowest == "soft trip"


@pytest.mark.quick(rows=lambda sine, target: target is PRELOAD or sine is SINE)
@pytest.mark.parametrize("target", [PRELOAD, Target("force_gwt", 5.0)])
@pytest.mark.parametrize("sine", [SINE, SLOW, SineMotion.of(5.0, 25.0, 1.0)])
def test_the_carriage_stays_within_the_amplitude_about_the_preload(
    faulty: FaultyBench, sine: SineMotion, target: Target
) -> None:
    """And goes from end to end."""
    heights: list[float] = []

    def look() -> None:
        heights.append(faulty.height_mm)
        if not _over:
            faulty.clock.call_at(faulty.clock.monotonic_s() + 0.002, look)

    _over: list[bool] = []
    faulty.after("vibrate", look)
    faulty.on_sample["hold_end"] = lambda: _over.append(True)
    _vibrate(faulty, sine, target)
    (begun,), (touch,) = _of(faulty, "vibrate"), _of(faulty, "touch")
    during = heights[: int((sine.duration_s + 0.1) / 0.002)]
    depths = [touch["contact_height_mm"] - height for height in during]
    margin_mm = faulty.config.stage.resolution_mm + PRINTED_MM
    assert max(depths) == pytest.approx(begun["preload_mm"] + sine.amplitude_mm, abs=margin_mm)
    assert min(depths) == pytest.approx(begun["preload_mm"] - sine.amplitude_mm, abs=margin_mm)


def test_the_stage_gets_a_limit_one_increment_below_the_lower_end(
    faulty: FaultyBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits_mm: list[float] = []
    monkeypatch.setattr(faulty.engine, "limit_depth", limits_mm.append)
    _vibrate(faulty)
    assert limits_mm[-1] == pytest.approx(PREDICTED.contact_mm - 0.86 - 0.05 - 0.05, abs=0.006)


def test_the_press_measures_again_each_time(faulty: FaultyBench) -> None:
    _vibrate(faulty)
    _vibrate(faulty)
    assert len(_of(faulty, "vibrate")) == 2
    assert len({data["index"] for data in _of(faulty, "sample", "press")}) == 2


# --- what is refused ---


@pytest.mark.parametrize(
    ("sine", "code"),
    [
        (SineMotion.of(5.1, 50.0, 1.0), "vibration_too_fast"),
        (SineMotion.of(0.5, 345.0, 1.0), "vibration_leaves_skin"),
        (SineMotion.of(0.5, 250.0, 1.0), "vibration_too_large"),
    ],
)
def test_what_the_engine_refuses_by_the_measured_stiffness(faulty: FaultyBench, sine: SineMotion, code: str) -> None:
    """It lifts; the vibration itself never begins."""
    with raises(LimitError, code, x_mm=0.0):
        _vibrate(faulty, sine)
    assert not _of(faulty, "vibrate")
    assert faulty.engine.state is State.READY
    assert faulty.height_mm == pytest.approx(2.0, abs=0.003)


def test_the_limit_of_depth_counts_at_the_lower_end(tmp_path: Path) -> None:
    bench = _bench(tmp_path, {"limits": {"soft_trip_n": SOFT_TRIP_N, "max_doi_mm": 0.9}})
    with raises(LimitError, "too_deep"):
        _vibrate(bench)
    assert bench.engine.state is State.READY
    assert not _of(bench, "vibrate")
    bench.journal.close()


OTHERS = [name for name in BUILT_IN["stage"] if name != "zaber"]


@pytest.mark.parametrize("kind", OTHERS)
def test_the_other_stages_are_refused_by_engine_and_plan(kind: str, finger: Fingertip, tmp_path: Path) -> None:
    assert find(StageKind, kind).vibrates is None
    tables = next(bench for bench in BENCHES.values() if bench.get("stage", {}).get("kind", "grbl") == kind)
    bench = FaultyBench(tmp_path, tables)
    with raises(NotReadyError, "no_vibration", kind=kind):
        _vibrate(bench)
    with raises(BadInputError, "no_vibration", kind=kind):
        make_plan(_script(tmp_path, VIBRATE), Config.model_validate(tables), finger)
    bench.journal.close()


def test_a_stage_of_another_package_cannot_vibrate_unless_it_says_so() -> None:
    kind = StageKind(name="other", device="another stage", tests=(), driver=lambda *_: None)  # type: ignore[arg-type, return-value]
    assert kind.vibrates is None


# --- what ends it ---


@pytest.mark.quick(rows=lambda sine, nearer_mm, after_s: (sine is SLOW) == (nearer_mm == 0.47))
@pytest.mark.parametrize("sine", [SINE, SLOW])
@pytest.mark.parametrize("nearer_mm", [0.44, 0.47, 0.5])
@pytest.mark.parametrize("after_s", [0.5, 0.56, 0.62, 0.69])
def test_a_finger_that_comes_nearer_trips_in_any_phase(
    faulty: FaultyBench, sine: SineMotion, nearer_mm: float, after_s: float
) -> None:
    """The lower end is then 1.35 to 1.41 mm deep in it, where the trip is at 1.31 and the bound at 1.42 mm."""

    def nearer() -> None:
        faulty.nearer_mm = nearer_mm

    _in_the_vibration(faulty, nearer, after_s)
    with raises(TripError, "vibration_trip", phase="moving") as caught:
        _vibrate(faulty, sine)
    assert caught.value.fields["limit_gwt"] < SOFT_TRIP_N / GWT_N
    assert faulty.worst_n / GWT_N <= bound_gwt()
    assert faulty.engine.state is State.TRIPPED
    assert faulty.height_mm == pytest.approx(2.0, abs=0.003)


def test_a_sensor_that_falls_silent_ends_it_at_once(faulty: FaultyBench) -> None:
    def silent() -> None:
        faulty.force_line.device_write = lambda data: None  # type: ignore[method-assign]

    _in_the_vibration(faulty, silent)
    with pytest.raises(TripError):
        _vibrate(faulty)
    assert faulty.height_mm == pytest.approx(2.0, abs=0.003)
    assert len(_of(faulty, "hold_end")) == 0


def test_a_sensor_that_lost_its_cell_ends_it(faulty: FaultyBench) -> None:
    _in_the_vibration(faulty, lambda: setattr(faulty, "felt_n", lambda t_s: 0.0))
    with raises(TripError, "lost_finger"):
        _vibrate(faulty)
    assert faulty.height_mm == pytest.approx(2.0, abs=0.003)


def test_a_reading_that_stays_ends_a_slow_vibration(faulty: FaultyBench) -> None:
    _in_the_vibration(faulty, lambda: setattr(faulty, "felt_n", lambda t_s: 8.0 * GWT_N))
    with raises(TripError, "frozen", force_gwt=8.0):
        _vibrate(faulty, SLOW)
    assert faulty.height_mm == pytest.approx(10.0, abs=0.003), "the force does not vanish"
    assert not _of(faulty, "hold_end")


def test_a_reading_may_stay_where_the_force_swings_by_less_than_five_steps(faulty: FaultyBench) -> None:
    """By 0.03 gwt about 0.4 gwt, where a step is 0.01 gwt."""
    stays = lambda t_s: 0.4 * GWT_N if faulty.height_mm < 0.0 else faulty.true_n(t_s)  # noqa: E731
    _in_the_vibration(faulty, lambda: setattr(faulty, "felt_n", stays))
    assert len(_vibrate(faulty, SineMotion.of(1.0, 2.5, 4.0), Target("doi_mm", 0.1)).holds) == 1


@pytest.mark.parametrize(
    ("change_gwt", "later_s", "swing_gwt", "too_long"),
    [(0.0, 1.1, 1.0, True), (0.004, 1.1, 1.0, True), (0.006, 1.1, 1.0, False), (0.0, 0.9, 1.0, False),
     (0.0, 1.1, 0.04, False)],
)  # fmt: skip
def test_a_reading_stays_only_past_a_cycle_and_a_swing(
    change_gwt: float, later_s: float, swing_gwt: float, too_long: bool
) -> None:
    still = Still(0.01, 1.0)
    assert not still.too_long(2.0, 10.0, swing_gwt)
    assert still.too_long(2.0 + change_gwt, 10.0 + later_s, swing_gwt) is too_long


@pytest.mark.parametrize("period_s", [0.05, 0.2])
def test_a_late_or_slow_sensor_is_no_frozen_one(tmp_path: Path, period_s: float) -> None:
    """A cell that is read once a cycle shows the same each time; that is no reason to trip."""
    bench = _bench(tmp_path, {"force": {"latency_s": 0.2, "sample_period_s": period_s}})
    bench.felt_n = lambda t_s: bench.true_n(t_s - 0.2)
    for sine in (SineMotion.of(5.0, 20.0, 2.0), SineMotion.of(0.5, 50.0, 4.0)):
        assert len(_vibrate(bench, sine).holds) == 1
    bench.journal.close()


def test_a_pause_of_the_readings_ends_it(faulty: FaultyBench) -> None:
    """The disk is away for 0.45 s: longer than was ever measured."""
    _in_the_vibration(faulty, lambda: faulty.after("vibrate", lambda: faulty.clock.wait_s(0.45)))
    with raises(TripError, "vibration_unread", limit_s=UNREAD_S):
        _vibrate(faulty)
    assert faulty.height_mm == pytest.approx(2.0, abs=0.003)


def test_a_lost_journal_ends_it_and_lifts(faulty: FaultyBench) -> None:
    def away() -> None:
        faulty.journal_path.rename(faulty.journal_path.with_suffix(".old"))

    _in_the_vibration(faulty, away)
    begun_s = faulty.clock.monotonic_s()
    with pytest.raises(RecordError):
        _vibrate(faulty, SineMotion.of(4.0, 50.0, 60.0))
    assert faulty.clock.monotonic_s() - begun_s < 30.0
    assert faulty.stage.homed
    assert faulty.height_mm == pytest.approx(2.0, abs=0.003)


def test_a_stop_from_another_thread_ends_it(faulty: FaultyBench) -> None:
    stopped_mm: list[float] = []

    def stop() -> None:
        faulty.stage.stop()
        stopped_mm.append(faulty.height_mm)

    _in_the_vibration(faulty, stop)
    with raises(StageError, "stopped"):
        _vibrate(faulty)
    assert not faulty.stage.homed
    assert faulty.height_mm == pytest.approx(stopped_mm[0], abs=0.002)


def test_a_stop_input_ends_it(faulty: FaultyBench) -> None:
    pressed: list[bool] = []
    button = TripError("a button", code="stop_input")
    faulty.engine.stop_problem = lambda *, at_rest: button if pressed else None
    _in_the_vibration(faulty, lambda: pressed.append(True))
    with raises(TripError, "stop_input"):
        _vibrate(faulty)
    assert faulty.height_mm == pytest.approx(2.0, abs=0.003)


def test_an_engine_that_hangs_is_stopped_by_the_heartbeat(faulty: FaultyBench) -> None:
    """The sine would last a minute."""
    silence_s = faulty.config.limits.heartbeat_s + 1.0
    _in_the_vibration(faulty, lambda: faulty.after("vibrate", lambda: faulty.clock.wait_s(silence_s)))
    with pytest.raises((StageError, TripError)):
        _vibrate(faulty, SineMotion.of(4.0, 50.0, 60.0))
    assert faulty.engine.heartbeat.lost
    assert not faulty.stage.homed


@pytest.mark.parametrize("flag", ["FS", "WS"])
def test_a_stall_ends_it(faulty: FaultyBench, flag: str) -> None:
    act = faulty.board.z.warn if flag == "WS" else faulty.board.z.fail
    _in_the_vibration(faulty, lambda: act(flag))
    with raises(StageError, "alarm", number=flag):
        _vibrate(faulty)
    assert not faulty.stage.homed


@pytest.mark.parametrize("watched_by", ["the driver", "the engine"])
@pytest.mark.parametrize("goes_mm", [0.5, -0.5])
def test_a_carriage_that_leaves_its_way_is_stopped(
    faulty: FaultyBench, goes_mm: float, watched_by: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The device was commanded by another program, and reports no interruption."""

    def stray() -> None:
        z = faulty.board.z
        z._go([(z.carriage_at(faulty.clock.monotonic_s()) - 400 * goes_mm, 200.0)], 2000.0)

    _in_the_vibration(faulty, stray)
    if watched_by == "the engine":
        monkeypatch.setattr(ZaberAxis, "_refuse_off_its_way", lambda axis, *_: None)
        monkeypatch.setattr(ZaberAxis, "_out_of_time", lambda axis, *_: False)
    with pytest.raises((StageError, TripError)) as caught:
        _vibrate(faulty, SineMotion.of(4.0, 50.0, 60.0), Target("doi_mm", 0.5))
    assert caught.value.code == {"the driver": "not_there", "the engine": "off_its_way"}[watched_by]
    gone_mm = abs(faulty.height_mm - (PREDICTED.contact_mm - 0.5))
    assert gone_mm < 0.2 or faulty.height_mm > 0


def test_an_error_in_the_program_ends_it(faulty: FaultyBench, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> float:
        raise ZeroDivisionError

    _in_the_vibration(faulty, lambda: monkeypatch.setattr(faulty.engine.sensing, "glance_gwt", broken))
    with pytest.raises(ZeroDivisionError):
        _vibrate(faulty, SineMotion.of(4.0, 50.0, 60.0))
    at_mm = faulty.height_mm
    faulty.clock.wait_s(1.0)
    assert faulty.height_mm == at_mm


@pytest.mark.parametrize("goes_on", [True, False])
def test_a_pause_acts_within_it_and_begins_it_anew(faulty: FaultyBench, goes_on: bool) -> None:
    asked: list[bool] = []
    faulty.pause = Pause(lambda: bool(asked), lambda meanwhile: goes_on and not asked.clear())
    asked_s: list[float] = []
    _in_the_vibration(faulty, lambda: (asked.append(True), asked_s.append(faulty.clock.monotonic_s())))
    faulty.on_sample["paused"] = lambda: asked_s.append(faulty.clock.monotonic_s())
    sine = SineMotion.of(4.0, 50.0, 10.0)
    if goes_on:
        assert len(_vibrate(faulty, sine).holds) == 1
    else:
        with pytest.raises(RunAborted):
            _vibrate(faulty, sine)
    assert asked_s[1] - asked_s[0] < 3.0  # with the lift and its check
    assert len(_of(faulty, "vibrate")) == (2 if goes_on else 1)
    assert len(_of(faulty, "hold_end")) == (1 if goes_on else 0)
    assert faulty.height_mm == pytest.approx(2.0, abs=0.003)


# --- plan, summary, dry-run, resume ---

VIBRATE = "rig.vibrate(frequency_hz=4, amplitude_um=40, duration_s=0.5, doi_mm=0.5)"
ON_ZABER = Config.model_validate(ZABER)


def _script(folder: Path, *lines: str) -> Script:
    path = folder / "one.py"
    ready = ('rig.mount("bar:3.0")', "rig.home()", "rig.zero()", "rig.move_to(x_mm=0.0)")
    body = "".join(f"    {line}\n" for line in (*ready, *lines))
    path.write_text(f"from rig.protocol import Rig\n\ndef run(rig: Rig) -> None:\n{body}", encoding="utf-8")
    return load_script(str(path))


def _planned(finger: Fingertip, folder: Path, config: Config = ON_ZABER, **arguments: float) -> Plan:
    told = ", ".join(f"{name}={value!r}" for name, value in arguments.items())
    return make_plan(_script(folder, f"rig.vibrate({told})"), config, finger)


def test_the_plan_refuses_what_the_engine_would(finger: Fingertip, tmp_path: Path) -> None:
    sine = {"frequency_hz": 4.0, "amplitude_um": 40.0, "duration_s": 0.5, "doi_mm": 0.5}
    with raises(BadInputError, "vibration_too_fast") as caught:
        _planned(finger, tmp_path, **sine | {"frequency_hz": 40.0})
    highest_hz = caught.value.fields["highest_hz"]
    assert highest_hz == pytest.approx(highest_vibration_hz(ON_ZABER, 0.04))
    (planned,) = _planned(finger, tmp_path, **sine | {"frequency_hz": 0.99 * highest_hz}).indentations
    assert planned.vibration is not None
    assert planned.vibration.amplitude_um == 40.0
    with raises(BadInputError, "vibration_leaves_skin"):
        _planned(finger, tmp_path, **sine | {"frequency_hz": 0.5, "amplitude_um": 300.0})
    with raises(BadInputError, "vibration_too_large"):
        tight = Config.model_validate(ZABER | {"limits": {"soft_trip_n": 1.02 * planned.predicted_force_gwt * GWT_N}})
        _planned(finger, tmp_path, tight, **sine)
    with raises(BadInputError, "held_too_long", held_s=60.0):
        short = Config.model_validate(ZABER | {"limits": {"max_contact_s": 50.0}})
        _planned(finger, tmp_path, short, **sine | {"duration_s": 60.0})
    with raises(BadInputError, "means_beyond_limit", limit="max_doi_mm"):
        shallow = Config.model_validate(ZABER | {"limits": {"max_doi_mm": 0.52}})
        _planned(finger, tmp_path, shallow, **sine)


def test_the_summary_has_the_bound_and_the_dry_run_keeps_it(finger: Fingertip, tmp_path: Path) -> None:
    script = _script(tmp_path, "rig.indent(doi_mm=0.5, hold_s=0.1)", VIBRATE)
    plan = make_plan(script, ON_ZABER, finger)
    found = preflight(script, ON_ZABER, finger, plan).as_json()
    press, step = found["steps"]
    assert not [key for key in press if key.startswith("vibration_")]
    assert (step["vibration_hz"], step["vibration_um"], step["vibration_cycles"]) == (4.0, 40.0, 2)
    assert step["vibration_hz"] < step["vibration_highest_hz"]
    assert step["vibration_um"] < step["vibration_largest_um"]
    assert step["force_gwt"] < step["vibration_peak_gwt"] < TRIP_MARGIN * step["vibration_trip_gwt"]
    assert step["vibration_trip_gwt"] < step["vibration_bound_gwt"]
    done = dry_run(Session(script, ON_ZABER, finger, plan, NewRun(tmp_path / "runs")))
    assert done.complete, done.problem
    (begun,) = done.run.stream("vibrate")
    assert begun["trip_gwt"] == pytest.approx(step["vibration_trip_gwt"], rel=0.1)
    peak_gwt = max(sample["force_gwt"] for sample in done.run.stream("sample"))
    assert peak_gwt <= step["vibration_peak_gwt"]
    assert found["duration_s"] == pytest.approx(done.run.duration_s, rel=0.02)


def test_spikes_of_a_run_get_the_sine_itself(finger: Fingertip, tmp_path: Path) -> None:
    """Between two samples, too; about the depth of the preload."""
    script = _script(tmp_path, VIBRATE)
    plan = make_plan(script, ON_ZABER, finger)
    done = dry_run(Session(script, ON_ZABER, finger, plan, NewRun(tmp_path / "runs")))
    (visit,), (begun,) = visits_of(done.run, ON_ZABER).visits, done.run.stream("vibrate")
    t_s = begun["t_s"] + 0.25 * np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0])
    sine_mm = 0.04 * np.array([-1.0, 0.0, 1.0, 0.0, -1.0, 1.0, -1.0])
    assert visit.path.depth_mm(t_s) == pytest.approx(0.5 + sine_mm, abs=0.004)


@pytest.mark.quick(rows=lambda at: at == "vibrate")  # in the press: test_ramp.py, test_resume.py
@pytest.mark.usefixtures("empty_figures")
@pytest.mark.parametrize("at", ["press", "vibrate"])
def test_a_run_that_was_killed_in_a_vibration_does_it_anew(at: str, finger: Fingertip, tmp_path: Path) -> None:
    lines = [f"answer = {VIBRATE}", "rig.note(f'{answer.holds[0].doi_mm:.6f}')"]
    script = _script(tmp_path, *lines, VIBRATE)
    plan = make_plan(script, ON_ZABER, finger)
    whole = dry_run(Session(script, ON_ZABER, finger, plan, NewRun(tmp_path / "runs")))
    events = whole.folder.events
    documents = events.read_text(encoding="utf-8").splitlines(keepends=True)
    ends = [n for n, line in enumerate(documents) if '"stream": "indentation_end"' in line]
    cut = next(n for n, line in enumerate(documents) if f'"phase": "{at}"' in line and n > ends[0])
    events.write_text("".join(documents[: cut + 1]), encoding="utf-8")
    stopped = read_stopped(whole.folder.path)
    plan = make_plan(stopped.script, stopped.config, finger, stopped.run, stopped.folder.path)
    again = dry_run(Session(stopped.script, stopped.config, finger, plan, stopped))
    assert again.complete, again.problem
    assert len(again.run.done) == len(again.run.stream("vibrate")) == 2
    assert (again.run.restarted, again.run.repeated) == (1, 0)
    assert math.isclose(again.run.done[0][0]["doi_mm"], whole.run.done[0][0]["doi_mm"], abs_tol=0.003)
