"""Ramps over a stage without a wire: what each reading on the way decides, by hand.

The finger is F = 6 gwt/mm^1.5 below its skin at -0.3 mm; a touch is 0.05 gwt, shown 0.041 mm below the skin. The
sensor is read at each look, and settles within 0.05 s.
"""

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from itertools import pairwise
from typing import Any

import pytest

from rig.devices.base import StageStatus
from rig.engine import LimitError, RecordError, TripError, verbs
from rig.engine.indentation import ramp
from rig.engine.motion import PRINTED_MM
from rig.records import Indentation
from rig.units import GWT_N
from tests.error_codes import raises, shows
from tests.rig.plain_bench import GlidingBench, GlidingStage, PlainBench

SKIN_MM, K_GWT = -0.3, 6.0
DEPTH_MM, SPEED_MM_S = 0.8, 0.3
ZABER: Mapping[str, Any] = {"stage": {"kind": "zaber"}}
LAW_GWT = K_GWT * DEPTH_MM**1.5
INCREMENT_MM, STEP_MM = 0.05, 0.0025
READ_S, WAIT_S = 0.05, 0.05

Felt = Callable[["Finger"], float]


class Finger(GlidingBench):
    """A bench over the finger; from the start of the motion on, `then` says what the sensor shows."""

    def __init__(self, then: Felt | None = None, tables: Mapping[str, Any] | None = None, **options: Any) -> None:
        self.then: Felt = then or _law
        self.skin_mm = SKIN_MM
        super().__init__(self._shown, tables or {}, **{"soft_trip_n": 0.1, **options})

    def _shown(self, bench: PlainBench) -> float:
        return self.then(self) if self.moving and self.height_mm < 1.0 else _law(self)

    @property
    def moving(self) -> bool:
        """Whether the ramp has begun."""
        return bool(self.of("ramp"))

    def within(self, phase: str) -> list[dict[str, Any]]:
        """The readings of a phase on record."""
        return [sample for sample in self.of("sample") if sample["phase"] == phase]

    def ramp(
        self, doi_mm: float = DEPTH_MM, speed_mm_s: float = SPEED_MM_S, hold_s: float = 0.2, rest_s: float = 0.0
    ) -> Indentation:
        engine = self.engine if self.engine.placed else self.ready()
        return ramp(engine, doi_mm, speed_mm_s, hold_s=hold_s, rest_s=rest_s, expected_contact_mm=SKIN_MM)


class LaggingStage(GlidingStage):
    """Reports an old position for a while."""

    lags_until_s = -math.inf
    reported: StageStatus | None = None

    def status(self) -> StageStatus:
        if self.reported is None or self.clock.monotonic_s() >= self.lags_until_s:
            self.reported = super().status()
        return self.reported


class LaggingFinger(Finger):
    """The same, over a stage that may lag."""

    make_stage = LaggingStage


def _law(bench: Any, skin_mm: float | None = None) -> float:
    return round(float(bench.hertz(K_GWT, bench.skin_mm if skin_mm is None else skin_mm)), 2)


def _odd(bench: PlainBench) -> int:
    """0 and 1 in turn, from one reading to the next."""
    return round(bench.clock.monotonic_s() / READ_S) % 2


# --- a ramp ---


@pytest.mark.parametrize("bump_gwt", [0.0, 2.0])
def test_a_ramp_journals_its_readings_and_the_peak_of_ramp_and_hold(bump_gwt: float) -> None:
    """The highest force may be one of the way, here at some 0.6 mm."""
    bench = Finger(lambda bench: _law(bench) + bump_gwt * (-0.92 < bench.height_mm < -0.85))
    (hold,) = bench.ramp().holds
    assert (hold.doi_mm, hold.force_gwt) == (pytest.approx(DEPTH_MM, abs=0.002), pytest.approx(LAW_GWT, abs=0.03))
    (end,), readings = bench.of("hold_end"), bench.within("ramp")
    assert end["ramp_gwt"] == pytest.approx(hold.force_gwt, abs=0.02)
    assert end["peak_gwt"] == max(one["force_gwt"] for one in [*readings, *bench.within("hold")])
    assert (end["peak_gwt"] > LAW_GWT + 0.1) is bool(bump_gwt)
    assert readings[0]["doi_mm"] < 0.0
    assert (end["index"], end["hold"], end["asked_s"], end["commanded"]) == (0, 1, 0.2, DEPTH_MM)
    contact_mm = bench.of("touch")[0]["contact_height_mm"]
    assert all(one["doi_mm"] == pytest.approx(contact_mm - one["height_mm"], abs=2e-6) for one in readings)
    assert end["ramp_s"] == pytest.approx((DEPTH_MM - readings[0]["doi_mm"]) / SPEED_MM_S, abs=0.15)


def test_a_ramp_on_a_compliant_rig_travels_farther_by_its_deflection() -> None:
    """1 mm/N: 0.042 mm at its depth, by the force of the press before it; and of a hold the sd is that of both."""
    gives = {"value": 1.0, "sd": 0.2, "date": "2026-01-01", "expires": "2036-01-01"}
    bench = Finger(tables={"calibration": {"compliance_mm_per_n": gives}})
    (hold,) = bench.ramp().holds
    assert hold.doi_mm == pytest.approx(DEPTH_MM, abs=0.003)
    force_n, (end,) = hold.force_gwt * GWT_N, bench.of("hold_end")
    height_mm = bench.within("hold")[-1]["height_mm"]
    contact_mm = bench.of("touch")[0]["contact_height_mm"]
    assert hold.doi_mm == pytest.approx(contact_mm - height_mm - force_n, abs=2e-6)
    assert end["doi_sd_mm"] == pytest.approx(math.hypot(STEP_MM / math.sqrt(12), 0.2 * force_n), abs=2e-6)
    floor_mm = bench.stage.floors_mm[-1] - bench.settings.frame.apex_z_mm
    assert floor_mm == pytest.approx(contact_mm - DEPTH_MM - force_n - INCREMENT_MM, abs=0.003)


def test_the_depth_limit_of_the_stage_follows_approach_touch_and_ramp() -> None:
    """Where nothing is found it is search_mm and max_doi_mm below; then an increment below the deepest there is."""
    bench = Finger(tables=ZABER)
    bench.ramp()
    _, *floors_mm = [round(mm - bench.settings.frame.apex_z_mm, 6) for mm in bench.stage.floors_mm]
    limits, touch = bench.settings.limits, bench.of("touch")[0]["contact_height_mm"]
    assert floors_mm[:2] == pytest.approx(
        [SKIN_MM - limits.search_mm - limits.max_doi_mm, touch - limits.max_doi_mm - INCREMENT_MM]
    )
    assert floors_mm[2:] == pytest.approx([SKIN_MM - DEPTH_MM - INCREMENT_MM], abs=0.004)


ENDS: dict[str, tuple[Felt, str | None]] = {
    # the touch was 0.041 mm below the skin; half a touch must show one increment and an age of a reading below it
    "it sank by an increment": (lambda bench: _law(bench, SKIN_MM - 0.05), None),
    "it sank by two": (lambda bench: _law(bench, SKIN_MM - 0.12), "lost_finger"),
    "it is gone": (lambda bench: 0.0, "lost_finger"),
    "it pulls": (lambda bench: -0.03, "lost_finger"),
    "less than half a touch": (lambda bench: min(_law(bench), 0.02), "lost_finger"),
    "half a touch": (lambda bench: min(_law(bench), 0.03), "frozen"),
    "half a touch from the start, in the air": (lambda bench: 0.03, "frozen"),
    "it stays": (lambda bench: min(_law(bench), 2.0), "frozen"),
    "it stays and wavers by less than half a step": (
        lambda bench: min(_law(bench), 2.0 + 0.0044 * _odd(bench)), "frozen"),
    "it wavers by more": (
        lambda bench: _law(bench) if _law(bench) < 2.0 else 2.0 + 0.0056 * _odd(bench),
        None),
    "it came up": (lambda bench: _law(bench, SKIN_MM + 0.6), "ramp_trip"),
    "it pulls too much": (lambda bench: -_law(bench) * 3, "lost_finger"),
}  # fmt: skip


@pytest.mark.parametrize("name", ENDS)
def test_a_ramp_ends_at_a_lost_finger_a_frozen_reading_or_its_trip(name: str) -> None:
    felt, code = ENDS[name]
    bench = Finger(felt)
    if code is None:
        assert bench.ramp().holds[0].doi_mm == pytest.approx(DEPTH_MM, abs=0.003)
        return
    with raises(TripError, code) as caught:
        bench.ramp()
    last = bench.within("ramp")[-1]
    if code == "lost_finger":
        touch_mm = bench.of("touch")[0]["height_at_threshold_mm"]
        below_mm = touch_mm - last["height_mm"]
        assert 0.0 <= below_mm - INCREMENT_MM - SPEED_MM_S * WAIT_S <= SPEED_MM_S * READ_S + 1e-6
        assert shows(str(caught.value), below_mm)
    if code == "ramp_trip":
        assert shows(str(caught.value), bench.of("ramp")[0]["trip_gwt"])
    assert bench.height_mm == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("stays_gwt", "latency_s", "speed_mm_s"),
    [(0.03, 0.0, 0.05), (2.0, 0.0, 0.3), (2.0, 0.2, 0.3)],
)
def test_a_reading_that_stays_ends_a_ramp_past_its_age_and_five_steps_or_a_tenth(
    stays_gwt: float, latency_s: float, speed_mm_s: float
) -> None:
    """By the stiffness that the press before it measured."""
    bench = Finger(lambda bench: min(_law(bench), stays_gwt), {"force": {"latency_s": latency_s}})
    with raises(TripError, "frozen", force_gwt=stays_gwt):
        bench.ramp(speed_mm_s=speed_mm_s)
    measured_gwt = bench.of("ramp")[0]["measured_gwt"]
    since = [one for one in bench.within("ramp") if one["force_gwt"] == stays_gwt]
    late_mm, enough_gwt = speed_mm_s * (WAIT_S + latency_s), max(0.05, 0.1 * stays_gwt)

    def ends(one: dict[str, Any]) -> bool:
        first, now = (measured_gwt * (each["doi_mm"] / DEPTH_MM) ** 1.5 for each in (since[0], one))
        return bool(since[0]["height_mm"] - one["height_mm"] > late_mm + 1e-6 and now - first > enough_gwt)

    assert [ends(one) for one in since] == [False] * (len(since) - 1) + [True]


@pytest.mark.parametrize("times", [0, 1, 2, 3])
def test_a_ramp_with_a_late_reading_is_lifted_and_repeated_at_most_twice(times: int) -> None:
    """The journal takes its time; the stage goes on meanwhile, and stops at the next reading."""
    bench, late_s = Finger(), 2 * 0.05 + 0.1
    slow_s = [late_s + 0.02 - READ_S] * times + [late_s - 0.02 - READ_S]

    def slow(stream: str, data: Mapping[str, Any]) -> None:
        if stream == "retract":
            waits.append(True)
        if stream == "sample" and data["phase"] == "ramp" and data["doi_mm"] > 0.3 and waits and slow_s:
            waits.clear()
            bench.clock.wait_s(slow_s.pop(0))

    waits = [True]
    bench.on_event = slow
    if times == 3:
        with raises(LimitError, "late_readings", attempts=3):
            bench.ramp()
    else:
        assert bench.ramp().holds
    assert [alarm["reason"].count("the ramp is repeated") for alarm in bench.of("alarm")] == [1] * times
    assert bench.height_mm == pytest.approx(2.0)


def test_a_stage_that_covers_too_much_between_two_readings_ends_a_ramp() -> None:
    """Readings come in time, but the reported position stands for 0.4 s."""
    bench = LaggingFinger()
    may_mm = SPEED_MM_S * (2 * 0.05 + 0.1) + STEP_MM + PRINTED_MM

    def lag(stream: str, data: Mapping[str, Any]) -> None:
        if stream == "sample" and data["phase"] == "ramp" and data["doi_mm"] > 0.3:
            bench.on_event = lambda stream, data: None
            bench.stage.lags_until_s = bench.clock.monotonic_s() + 0.4  # type: ignore[attr-defined]

    bench.on_event = lag
    with raises(TripError, "ramp_unread", limit_mm=may_mm):
        bench.ramp()


# --- nothing touches the finger before ---


def _touches_before(bench: Finger) -> list[int]:
    """Readings of a touch of each press before its ramp."""
    found, ramped = list[int](), False
    for name, data in bench.events:
        if name == "indentation_start":
            found.append(0)
            ramped = False
        ramped = ramped or name == "ramp"
        if name == "sample" and not ramped and found and data["force_gwt"] >= 0.05:
            found[-1] += 1
    return found


def test_nothing_touches_the_finger_before_a_ramp_to_a_contact_that_was_found_twice() -> None:
    """The first one begins with a press by increments, the second one with a touch."""
    bench = Finger()
    found = [bench.ramp() for _ in range(4)]
    first, second, *others = _touches_before(bench)
    assert first > second > 0
    assert others == [0, 0]
    assert [one.holds[0].doi_mm for one in found] == pytest.approx([DEPTH_MM] * 4, abs=0.003)
    touches = bench.of("touch")
    assert [touch["fit_points"] > 0 for touch in touches] == [True, True, False, False]
    assert len({touch["contact_height_mm"] for touch in touches[1:]}) == 1
    begun_mm = next(one["height_mm"] for one in bench.within("ramp") if one["index"] == 3)
    assert begun_mm > SKIN_MM


@pytest.mark.parametrize(
    ("then", "touched"),
    [
        (lambda bench: None, False),
        (lambda bench: verbs.rest(bench.engine, 40.0), False),
        (lambda bench: verbs.rest(bench.engine, 61.0), True),
        (lambda bench: verbs.move_to(bench.engine, 1.0) or verbs.move_to(bench.engine, 0.0), False),
        (lambda bench: verbs.home(bench.engine) or verbs.move_to(bench.engine, 0.0), True),
    ],
    ids=["at once", "after 40 s", "after 61 s", "there and back", "homed"],
)
def test_a_ramp_touches_first_where_contact_is_no_longer_certain(
    then: Callable[[Any], object], touched: bool
) -> None:
    bench = Finger()
    for n in range(3):
        if n == 2:
            then(bench)
        bench.ramp()
    assert (_touches_before(bench)[-1] > 0) is touched


@pytest.mark.parametrize("speed_mm_s", [0.1, 0.3, 0.8])
def test_a_ramp_touches_no_earlier_than_its_rest_after_the_last_lift_off(speed_mm_s: float) -> None:
    bench, touched = Finger(soft_trip_n=0.3), list[tuple[float, bool]]()

    def look() -> None:
        touched.append((bench.clock.monotonic_s(), bench.height_mm < SKIN_MM))
        bench.clock.call_at(bench.clock.monotonic_s() + 0.01, look)

    bench.ready()
    look()
    for _ in range(4):
        bench.ramp(0.4, speed_mm_s, rest_s=6.0)
    changes = [after for before, after in pairwise(touched) if before[1] is not after[1]]
    for (lifted_s, touches), (touched_s, _) in pairwise(changes):
        if not touches and touched_s - lifted_s > 2.0:
            assert touched_s - lifted_s >= 6.0 - 0.02
    assert all(6.0 <= touch["rested_s"] < 8.5 for touch in bench.of("touch")[1:])


@pytest.mark.parametrize(("drift_mm", "touched"), [(0.0, False), (0.01, False), (0.035, True), (-0.035, True)])
def test_a_ramp_touches_first_while_its_contact_drifts(drift_mm: float, touched: bool) -> None:
    bench = Finger()
    bench.ramp()
    bench.skin_mm = SKIN_MM + drift_mm
    bench.ramp()
    bench.ramp()
    assert (_touches_before(bench)[-1] > 0) is touched


def test_a_deeper_ramp_measures_the_stiffness_first() -> None:
    bench = Finger(soft_trip_n=0.2)
    for doi_mm in (DEPTH_MM, DEPTH_MM, DEPTH_MM + 0.1):
        bench.ramp(doi_mm)
    assert bench.of("ramp")[-1]["measured_gwt"] == pytest.approx(K_GWT * (DEPTH_MM + 0.1) ** 1.5, rel=0.02)
    assert _touches_before(bench)[-1] > 5


@pytest.mark.parametrize("nearer_mm", [0.05, 0.2, 0.5, 1.0])
def test_a_finger_that_comes_nearer_before_a_ramp_without_a_touch_is_pressed_within_the_bound(
    nearer_mm: float,
) -> None:
    """Deeper by as much as it came, tripped, or met on the way down and touched first."""
    bench = Finger()
    bench.ramp()
    bench.ramp()
    bench.skin_mm = SKIN_MM + nearer_mm
    with suppress(TripError):
        bench.ramp()
    assert max(one["force_gwt"] for one in bench.of("sample")) <= bench.of("ramp")[0]["bound_gwt"]
    assert bench.height_mm == pytest.approx(2.0)


def test_a_finger_that_left_before_a_ramp_without_a_touch_is_missed() -> None:
    bench = Finger()
    bench.ramp()
    bench.ramp()
    bench.skin_mm = SKIN_MM - 2.0
    with raises(TripError, "lost_finger"):
        bench.ramp()


@pytest.mark.parametrize(("sample_period_s", "look_s"), [(0.02, 0.02), (0.05, 0.05), (0.2, 0.1)])
def test_a_ramp_is_polled_with_each_sample_and_has_no_extra_heartbeat(sample_period_s: float, look_s: float) -> None:
    bench = Finger(tables=ZABER)
    engine = bench.ready()
    bench.sample_period_s, bench.also = sample_period_s, {"fx_n": 0.5}
    promised, seen = list[tuple[float, float]](), list[float]()
    beat = engine.heartbeat.beat

    def beats(within_s: float) -> None:
        promised.append((bench.clock.monotonic_s(), within_s))
        beat(within_s)

    def begins(stream: str, data: Mapping[str, Any]) -> None:
        if stream == "ramp":
            promised.clear()
            seen.append(bench.clock.monotonic_s())
        elif stream == "sample" and data["phase"] == "ramp":
            seen.append(bench.stage.look_s)

    engine.heartbeat.beat = beats  # type: ignore[method-assign]
    bench.on_event = begins
    bench.ramp()
    assert promised[0] == (seen[0], bench.settings.limits.heartbeat_s)
    assert set(seen[1:-1]) == {look_s}
    assert all(one["fx_n"] == 0.5 for one in bench.within("ramp"))


def test_no_ramp_goes_deeper_than_the_limit() -> None:
    """Where the press before it came within a step of its depth."""
    bench = Finger(tables={**ZABER, "limits": {"max_doi_mm": 0.6}})
    assert bench.ramp(0.6).holds
    with raises(LimitError, "too_deep", limit_mm=0.6, doi_mm=pytest.approx(0.6015, abs=0.0013)):
        bench.ramp(0.6015)
    assert len(bench.of("ramp")) == 1
    assert bench.height_mm == pytest.approx(2.0)


def test_a_contact_that_lasts_too_long_ends_a_ramp_at_its_next_reading() -> None:
    """By the clock of a motion that was not ended: at its sixth reading."""
    whole = Finger(tables=ZABER)
    whole.ramp()
    longest_s = whole.within("ramp")[4]["contact_s"] + 0.01
    bench = Finger(tables={**ZABER, "limits": {"max_contact_s": longest_s}})
    with raises(LimitError, "contact_time", limit_s=longest_s):
        bench.ramp()
    assert bench.within("ramp")[5]["contact_s"] > longest_s
    assert len(bench.within("ramp")) == 7  # and the one at rest
    assert not bench.within("hold")
    assert bench.height_mm == pytest.approx(2.0)


def test_a_reading_that_cannot_be_journalled_ends_a_ramp_at_rest_before_it_lifts() -> None:
    """No lift is asked of a stage that moves."""
    bench = Finger(tables=ZABER)
    bench.ready()

    def full(stream: str, data: Mapping[str, Any]) -> None:
        if len(bench.within("ramp")) == 4:
            bench.stage.told.append("full")
            raise RecordError("the disk is full")

    bench.on_event = full
    with pytest.raises(RecordError, match="the disk is full"):
        bench.ramp()
    told = bench.stage.told[bench.stage.told.index("full") + 1 :]
    assert told[0] == "halt"
    assert told[1][2] == bench.settings.frame.apex_z_mm + 2.0
    assert bench.height_mm == pytest.approx(2.0)
