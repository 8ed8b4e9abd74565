"""Ramps and vibrations over a stage without a wire: what each reading on the way decides, by hand.

The finger is F = 6 gwt/mm^1.5 below its skin at -0.3 mm; a touch is 0.05 gwt, shown 0.041 mm below the skin. The
sensor is read at each look, and settles within 0.05 s.
"""

import math
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from typing import Any

import pytest

from rig.engine import LimitError, RecordError, RunAborted, Target, TripError
from rig.engine.corridor import PRINTED_MM
from rig.engine.engine import State
from rig.engine.indentation import ramp, vibrate
from rig.engine.limits import UNREAD_S, RampBound, VibrationBound
from rig.records import Indentation, SineMotion
from rig.units import GWT_N
from tests.error_codes import raises
from tests.rig.plain_bench import GlidingBench, PlainBench

SKIN_MM, K_GWT = -0.3, 6.0
DEPTH_MM, SPEED_MM_S = 0.8, 0.3
PRELOAD_MM = 0.6
SINE = SineMotion.of(2.0, 50.0, 1.0)
ZABER: Mapping[str, Any] = {"stage": {"kind": "zaber"}}
LAW_GWT = K_GWT * DEPTH_MM**1.5
INCREMENT_MM, STEP_MM = 0.05, 0.0025
READ_S, WAIT_S = 0.05, 0.05

Felt = Callable[["Finger"], float]


class Finger(GlidingBench):
    """A bench over the finger; from the start of the motion on, `then` says what the sensor shows."""

    def __init__(self, then: Felt | None = None, tables: Mapping[str, Any] | None = None, **options: Any) -> None:
        self.then: Felt = then or _law
        super().__init__(self._shown, tables or {}, **{"soft_trip_n": 0.1, **options})

    def _shown(self, bench: PlainBench) -> float:
        return self.then(self) if self.moving and self.height_mm < 1.0 else _law(self)

    @property
    def moving(self) -> bool:
        """Whether the ramp or the vibration has begun."""
        return bool(self.of("ramp") or self.of("vibrate"))

    def within(self, phase: str) -> list[dict[str, Any]]:
        """The readings of a phase on record."""
        return [sample for sample in self.of("sample") if sample["phase"] == phase]

    def ramp(self, doi_mm: float = DEPTH_MM, speed_mm_s: float = SPEED_MM_S, hold_s: float = 0.2) -> Indentation:
        engine = self.engine if self.engine.placed else self.ready()
        return ramp(engine, doi_mm, speed_mm_s, hold_s=hold_s, expected_contact_mm=SKIN_MM)

    def vibrate(self, sine: SineMotion = SINE, doi_mm: float = PRELOAD_MM) -> Indentation:
        engine = self.engine if self.engine.placed else self.ready()
        return vibrate(engine, Target("doi_mm", doi_mm), sine, expected_contact_mm=SKIN_MM)


def _law(bench: PlainBench, skin_mm: float = SKIN_MM) -> float:
    return round(bench.hertz(K_GWT, skin_mm), 2)


def _below(bench: PlainBench, skin_mm: float = SKIN_MM) -> float:
    return skin_mm - bench.height_mm


def _odd(bench: PlainBench) -> int:
    """0 and 1 in turn, from one reading to the next."""
    return round(bench.clock.monotonic_s() / READ_S) % 2


# --- a ramp ---


def test_a_ramp_and_its_hold_are_journalled_by_what_was_read() -> None:
    bench = Finger()
    (hold,) = bench.ramp().holds
    assert (hold.doi_mm, hold.force_gwt) == (pytest.approx(DEPTH_MM, abs=0.002), pytest.approx(LAW_GWT, abs=0.03))
    (end,), readings = bench.of("hold_end"), bench.within("ramp")
    assert end["ramp_gwt"] == pytest.approx(hold.force_gwt, abs=0.02)
    assert end["peak_gwt"] == max(one["force_gwt"] for one in [*readings, *bench.within("hold")])
    assert readings[0]["doi_mm"] < 0.0
    assert (end["index"], end["hold"], end["asked_s"], end["commanded"]) == (0, 1, 0.2, DEPTH_MM)
    contact_mm = bench.of("touch")[0]["contact_height_mm"]
    assert all(one["doi_mm"] == pytest.approx(contact_mm - one["height_mm"], abs=2e-6) for one in readings)
    assert end["ramp_s"] == pytest.approx((DEPTH_MM - readings[0]["doi_mm"]) / SPEED_MM_S, abs=0.15)


def test_a_ramp_leaves_to_the_next_what_the_press_before_it_measured() -> None:
    bench = Finger()
    bench.ramp()
    reached = bench.engine.touched.reached_at(0.0, 0.0)
    assert reached == (pytest.approx(DEPTH_MM, abs=0.01), pytest.approx(LAW_GWT, abs=0.1))
    bench.ramp(0.5)
    assert bench.engine.touched.reached_at(0.0, 0.0) == reached


def test_a_ramp_goes_deeper_by_what_the_rig_gives() -> None:
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
    floor_mm = _floors_mm(bench)[-1]
    assert floor_mm == pytest.approx(contact_mm - DEPTH_MM - force_n - INCREMENT_MM, abs=0.003)


@pytest.mark.parametrize("more_gwt", [0.5, -0.5])
def test_the_peak_of_a_hold_is_the_highest_reading_of_its_ramp_and_of_nothing_before(more_gwt: float) -> None:
    """A pulse of the finger in the middle of the ramp, or a slack one: the press before showed the law."""
    at_gwt: list[float] = []

    def pulse(bench: Finger) -> float:
        if _below(bench) > 0.7 and not at_gwt:
            at_gwt.append(_law(bench) + 3.0)
            return at_gwt[0]
        return _law(bench) + min(more_gwt, 0.0)

    bench = Finger(pulse if more_gwt > 0 else lambda bench: 0.9 * _law(bench))
    bench.ramp()
    peak_gwt = bench.of("hold_end")[0]["peak_gwt"]
    assert peak_gwt == pytest.approx(at_gwt[0] if more_gwt > 0 else 0.9 * LAW_GWT, abs=0.03)
    if more_gwt < 0:
        bench.ramp(0.2)
        assert bench.of("hold_end")[1]["peak_gwt"] == pytest.approx(0.9 * K_GWT * 0.2**1.5, abs=0.03)


def _floors_mm(bench: GlidingBench) -> list[float]:
    return [round(mm - bench.settings.frame.apex_z_mm, 6) for mm in bench.stage.floors_mm]


def test_the_limit_of_depth_follows_the_approach_the_touch_and_the_motion() -> None:
    """Where nothing is found it is search_mm and max_doi_mm below; then an increment below the deepest there is."""
    found: dict[str, list[float]] = {}
    for name, press in (("ramp", Finger.ramp), ("vibrate", Finger.vibrate)):
        bench = Finger(tables=ZABER)
        press(bench)
        found[name] = _floors_mm(bench)[1:]
        limits, touch = bench.settings.limits, bench.of("touch")[0]["contact_height_mm"]
        assert found[name][:2] == pytest.approx(
            [SKIN_MM - limits.search_mm - limits.max_doi_mm, touch - limits.max_doi_mm - INCREMENT_MM]
        )
    assert found["ramp"][2:] == pytest.approx([SKIN_MM - DEPTH_MM - INCREMENT_MM], abs=0.004)
    assert found["vibrate"][2:] == pytest.approx([SKIN_MM - PRELOAD_MM - 0.05 - INCREMENT_MM], abs=0.004)


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
def test_what_ends_a_ramp(name: str) -> None:
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
        assert caught.value.fields["below_mm"] == pytest.approx(below_mm, abs=2e-6)
    if code == "ramp_trip":
        assert caught.value.fields["limit_gwt"] == pytest.approx(bench.of("ramp")[0]["trip_gwt"], abs=1e-5)
    assert bench.height_mm == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("stays_gwt", "latency_s", "speed_mm_s"),
    [(0.03, 0.0, 0.05), (2.0, 0.0, 0.05), (2.0, 0.0, 0.3), (0.03, 0.2, 0.3), (2.0, 0.2, 0.3)],
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


@pytest.mark.parametrize(("more_s", "ends"), [(-0.02, False), (0.02, True)])
def test_a_ramp_may_go_unread_for_so_far_and_no_farther(more_s: float, ends: bool) -> None:
    """The journal takes its time once; the stage goes on meanwhile, and is a look from its next reading."""
    may_mm = SPEED_MM_S * UNREAD_S + STEP_MM + PRINTED_MM
    bench = Finger()

    def slow(stream: str, data: Mapping[str, Any]) -> None:
        if stream == "sample" and data["phase"] == "ramp" and data["doi_mm"] > 0.3:
            bench.at_event = lambda stream, data: None
            bench.clock.wait_s(may_mm / SPEED_MM_S - READ_S + more_s)

    bench.at_event = slow
    if ends:
        with raises(TripError, "ramp_unread", limit_mm=pytest.approx(may_mm)) as caught:
            bench.ramp()
        assert caught.value.fields["gone_mm"] == pytest.approx(may_mm + SPEED_MM_S * more_s, abs=1e-6)
        assert len(bench.within("ramp")) == sum(one["doi_mm"] <= 0.5 for one in bench.within("ramp"))
    else:
        assert bench.ramp().holds


# --- a vibration ---


def test_a_vibration_is_journalled_by_what_was_read() -> None:
    bench = Finger(tables=ZABER)
    (hold,) = bench.vibrate().holds
    (begun,), (end,), readings = bench.of("vibrate"), bench.of("hold_end"), bench.within("vibrate")
    assert begun["preload_mm"] == pytest.approx(PRELOAD_MM, abs=0.002)
    depths = [one["doi_mm"] for one in readings]
    assert (min(depths), max(depths)) == pytest.approx((PRELOAD_MM - 0.05, PRELOAD_MM + 0.05), abs=0.003)
    assert all(one["force_gwt"] == pytest.approx(K_GWT * one["doi_mm"] ** 1.5, abs=0.03) for one in readings)
    assert end["readings"] == len(readings) > 20
    assert end["peak_gwt"] == max(one["force_gwt"] for one in readings)
    assert end["force_gwt"] == pytest.approx(sum(one["force_gwt"] for one in readings) / len(readings))
    assert end["interval_sd_s"] < 0.01
    assert (end["index"], end["hold"], end["asked_s"], end["commanded"]) == (0, 1, 1.0, PRELOAD_MM)
    assert (hold.doi_mm, end["hold_s"]) == (pytest.approx(PRELOAD_MM, abs=0.003), pytest.approx(1.2, abs=0.2))
    assert ("sine", 0.05, 0.5, 2) in bench.stage.told


SINES: dict[str, tuple[Felt, str | None]] = {
    "it sank": (lambda bench: _law(bench, SKIN_MM - 0.3), None),
    "it is gone": (lambda bench: 0.0, "lost_finger"),
    "less than half a touch": (lambda bench: 0.02, "lost_finger"),
    "it stays": (lambda bench: 2.0, "frozen"),
    "it stays and wavers by less than half a step": (lambda bench: 2.0 + 0.0044 * _odd(bench), "frozen"),
    "it wavers by more": (lambda bench: 2.0 + 0.0056 * _odd(bench), None),
    "it came up": (lambda bench: _law(bench, SKIN_MM + 0.9), "vibration_trip"),
}


@pytest.mark.parametrize("name", SINES)
def test_what_ends_a_vibration(name: str) -> None:
    felt, code = SINES[name]
    bench = Finger(felt, ZABER)
    if code is None:
        assert bench.vibrate().holds
        return
    with raises(TripError, code):
        bench.vibrate()
    assert bench.height_mm == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("latency_s", "frequency_hz", "code"),
    [(0.0, 4.9, "frozen"), (0.0, 5.1, None), (0.1, 1.6, "frozen"), (0.1, 1.7, None)],
)
def test_a_reading_that_stays_is_noticed_in_sines_of_four_ages_of_a_reading(
    latency_s: float, frequency_hz: float, code: str | None
) -> None:
    """The sensor settles in 0.05 s, later by its latency: up to 5 Hz, or 1.67 Hz. After a cycle and an age."""
    bench = Finger(lambda bench: 2.79, {**ZABER, "force": {"latency_s": latency_s}})
    sine = SineMotion.of(frequency_hz, 20.0, 3.0)
    if code is None:
        assert bench.vibrate(sine).holds
        return
    with raises(TripError, code, force_gwt=2.79):
        bench.vibrate(sine)
    stays_s = (len(bench.within("vibrate")) - 1) * READ_S
    assert 0.0 < stays_s - (sine.period_s + WAIT_S + latency_s) <= READ_S


@pytest.mark.parametrize(("amplitude_um", "ends"), [(4.0, False), (6.0, True)])
def test_a_reading_may_stay_where_the_force_swings_by_less_than_five_steps_of_the_sensor(
    amplitude_um: float, ends: bool
) -> None:
    """By 0.038 and 0.057 gwt, 0.1 mm below the skin, where a step is 0.01 gwt."""
    bench = Finger(lambda bench: 0.19, ZABER)
    with raises(TripError, "frozen") if ends else nullcontext():
        bench.vibrate(SineMotion.of(2.0, amplitude_um, 1.5), 0.1)


@pytest.mark.parametrize(("more_s", "ends"), [(-0.01, False), (0.01, True)])
def test_a_vibration_may_go_unread_for_so_long_and_no_longer(more_s: float, ends: bool) -> None:
    bench = Finger(tables=ZABER)

    def slow(stream: str, data: Mapping[str, Any]) -> None:
        if stream == "sample" and data["phase"] == "vibrate" and len(bench.within("vibrate")) == 10:
            bench.clock.wait_s(UNREAD_S - READ_S + more_s)

    bench.at_event = slow
    if ends:
        with raises(TripError, "vibration_unread", unread_s=pytest.approx(UNREAD_S + more_s), limit_s=UNREAD_S):
            bench.vibrate()
        assert len(bench.within("vibrate")) == 11
    else:
        assert bench.vibrate().holds
        assert bench.of("hold_end")[0]["interval_sd_s"] > 0.05


def test_a_sine_between_two_readings_is_held_by_the_one_at_rest() -> None:
    bench = Finger(tables=ZABER)
    bench.stage.vibrating = lambda **sine: iter(())  # type: ignore[assignment, method-assign]
    (hold,) = bench.vibrate().holds
    (end,), (rested,) = bench.of("hold_end"), bench.within("hold")
    assert not bench.within("vibrate")
    assert (end["readings"], end["force_gwt"], end["peak_gwt"]) == (1, rested["force_gwt"], rested["force_gwt"])
    assert (hold.force_gwt, end["force_sd_gwt"], end["interval_sd_s"]) == (rested["force_gwt"], 0.0, 0.0)


@pytest.mark.parametrize("target", [Target("doi_mm", 0.6), Target("force_gwt", 3.0)], ids=["depth", "force"])
def test_a_sine_starts_from_its_target_and_leaves_its_depth_and_force_to_the_next_ramp(target: Target) -> None:
    bench = Finger(tables=ZABER)
    vibrate(bench.ready(), target, SINE, expected_contact_mm=SKIN_MM)
    reached = bench.engine.touched.reached_at(0.0, 0.0)
    assert reached is not None
    (begun,) = bench.of("vibrate")
    assert reached == pytest.approx((begun["preload_mm"], begun["measured_gwt"]), abs=1e-6)
    assert dict(zip(("doi_mm", "force_gwt"), reached, strict=True))[target.kind] == pytest.approx(
        target.value, abs=0.03
    )
    bench.events.clear()
    bench.ramp(reached[0])
    assert not bench.within("press")
    assert bench.of("ramp")[0]["measured_gwt"] == pytest.approx(reached[1], abs=1e-6)


PRESSES = {"ramp": Finger.ramp, "vibrate": Finger.vibrate}
ODD = SineMotion(0.0123456789, 0.5123456789, 2)


@pytest.mark.parametrize("phase", PRESSES)
def test_what_a_motion_may_do_is_journalled_before_it_to_a_millionth(phase: str) -> None:
    gives = {"value": 0.123456789, "sd": 0.2, "date": "2026-01-01", "expires": "2036-01-01"}
    bench = Finger(tables={**ZABER, "calibration": {"compliance_mm_per_n": gives}})
    bound: RampBound | VibrationBound
    if phase == "ramp":
        bench.ramp(0.7123456789, 0.2123456789)
    else:
        bench.vibrate(ODD)
    (begun,) = bench.of(phase)
    gwt, trip_gwt = begun["measured_gwt"], 0.1 / GWT_N
    if phase == "ramp":
        bound = RampBound.of(bench.settings, 0.2123456789, trip_gwt, gwt, 0.7123456789)
        own: dict[str, Any] = {"speed_mm_s": 0.2123456789}
    else:
        bound = VibrationBound.of(bench.settings, ODD, trip_gwt, gwt, begun["preload_mm"])
        own = {"frequency_hz": round(1 / 0.5123456789, 6), "amplitude_um": pytest.approx(12.3456789), "cycles": 2,
               "preload_mm": begun["preload_mm"]}  # fmt: skip
    loads = {"trip_gwt": bound.trip_gwt, "bound_gwt": bound.bound_gwt}
    assert begun == {
        "index": 0, **own, "measured_gwt": gwt, "stop_mm": round(bound.stop_mm, 6),
        **{key: pytest.approx(value, rel=1e-5) for key, value in loads.items()},
    }  # fmt: skip
    samples = [one for one in bench.of("sample") if one["doi_mm"] is not None]
    lengths = [one[key] for one in samples for key in ("doi_mm", "height_mm", "contact_s")]
    lengths += [one[key] for stream in ("hold_start", "hold_end") for one in bench.of(stream)
                for key in ("doi_mm", "ramp_s", "hold_s", "doi_sd_mm", "interval_sd_s") if key in one]  # fmt: skip
    lengths += [begun["preload_mm"]] if phase == "vibrate" else []
    assert lengths == [round(length, 6) for length in lengths]


@pytest.mark.parametrize("phase", PRESSES)
@pytest.mark.parametrize(("sample_period_s", "look_s"), [(0.02, 0.02), (0.05, 0.05), (0.2, 0.1)])
def test_a_motion_is_looked_at_with_each_sample_and_promised_from_its_start(
    phase: str, sample_period_s: float, look_s: float
) -> None:
    bench = Finger(tables=ZABER)
    engine = bench.ready()
    bench.sample_period_s, bench.also = sample_period_s, {"fx_n": 0.5}
    promised, seen = list[tuple[float, float]](), list[float]()
    beat = engine.heartbeat.beat

    def beats(within_s: float) -> None:
        promised.append((bench.clock.monotonic_s(), within_s))
        beat(within_s)

    def begins(stream: str, data: Mapping[str, Any]) -> None:
        if stream == phase:
            promised.clear()
            seen.append(bench.clock.monotonic_s())
        elif stream == "sample" and data["phase"] == phase:
            seen.append(bench.stage.look_s)

    engine.heartbeat.beat = beats  # type: ignore[method-assign]
    bench.at_event = begins
    PRESSES[phase](bench)
    assert promised[0] == (seen[0], bench.settings.limits.heartbeat_s)
    assert set(seen[1:-1]) == {look_s}
    assert all(one["fx_n"] == 0.5 for one in bench.within(phase))


@pytest.mark.parametrize("goes_on", [True, False])
@pytest.mark.parametrize("phase", PRESSES)
def test_a_pause_ends_a_motion_at_its_next_reading(phase: str, goes_on: bool) -> None:
    """A pause that goes on begins it anew."""
    press = PRESSES[phase]
    bench = Finger(tables=ZABER)
    bench.goes_on, paused = goes_on, list[int]()

    def asked() -> bool:
        if len(bench.within(phase)) >= 5 and not paused:
            paused.append(len(bench.within(phase)))
            return True
        return bool(paused) and not bench.of("paused")

    bench.wants_pause = asked
    if goes_on:
        assert press(bench).holds
        assert len(bench.of(phase)) == 2
    else:
        with raises(RunAborted, "stopped_at_a_safe_point"):
            press(bench)
        assert len(bench.within(phase)) == paused[0] == 5
    assert bench.height_mm == pytest.approx(2.0)


@pytest.mark.parametrize("phase", PRESSES)
def test_a_pause_before_a_motion_is_taken_before_it(phase: str) -> None:
    """As the indentor backs off from the press before a ramp, or as the hold of a vibration begins."""
    bench = Finger(tables=ZABER)
    bench.ready()
    begun: list[int] = []

    def due() -> bool:
        *_, (stream, data) = bench.events
        return stream == "hold_start" if phase == "vibrate" else data.get("phase") == "back off" and pressed()

    def pressed() -> bool:
        return bool(bench.within("press"))

    def asked() -> bool:
        if not begun and due():
            begun.append(len(bench.of(phase)))
        return bool(begun) and not bench.of("paused")

    bench.wants_pause = asked
    PRESSES[phase](bench)
    assert begun == [0]
    assert len(bench.of(phase)) == 1
    streams = [stream for stream, _ in bench.events]
    assert streams.index("paused") < streams.index(phase)


@pytest.mark.parametrize(("phase", "deepest_mm"), [("ramp", 0.6), ("vibrate", 0.65)])
def test_no_motion_goes_deeper_than_the_limit(phase: str, deepest_mm: float) -> None:
    """Where the press before it came within a step of a ramp's depth; at the lower end of a sine."""
    bench = Finger(tables={**ZABER, "limits": {"max_doi_mm": deepest_mm}})
    press = bench.ramp if phase == "ramp" else lambda doi_mm: bench.vibrate(doi_mm=doi_mm)
    assert press(0.6).holds
    with raises(LimitError, "too_deep", limit_mm=deepest_mm, doi_mm=pytest.approx(deepest_mm + 0.0015, abs=0.0013)):
        press(0.6015)
    assert len(bench.of(phase)) == 1
    assert bench.height_mm == pytest.approx(2.0)


@pytest.mark.parametrize("phase", PRESSES)
def test_a_contact_that_lasts_too_long_ends_a_motion_at_its_next_reading(phase: str) -> None:
    """By the clock of a motion that was not ended: at its sixth reading."""
    whole = Finger(tables=ZABER)
    PRESSES[phase](whole)
    longest_s = whole.within(phase)[4]["contact_s"] + 0.01
    bench = Finger(tables={**ZABER, "limits": {"max_contact_s": longest_s}})
    with raises(LimitError, "contact_time", limit_s=longest_s):
        PRESSES[phase](bench)
    assert bench.within(phase)[5]["contact_s"] > longest_s
    assert len(bench.within(phase)) == 6 + (phase == "ramp")  # and the one at rest
    assert not bench.within("hold")
    assert bench.height_mm == pytest.approx(2.0)


@pytest.mark.parametrize("phase", PRESSES)
def test_a_reading_that_cannot_be_journalled_ends_a_motion_at_rest_before_it_lifts(phase: str) -> None:
    """No lift is asked of a stage that moves."""
    bench = Finger(tables=ZABER)
    bench.ready()

    def full(stream: str, data: Mapping[str, Any]) -> None:
        if len(bench.within(phase)) == 4:
            bench.stage.told.append("full")
            raise RecordError("the disk is full")

    bench.at_event = full
    with pytest.raises(RecordError, match="the disk is full"):
        PRESSES[phase](bench)
    told = bench.stage.told[bench.stage.told.index("full") + 1 :]
    assert told[0] == "halt"
    assert told[1][2] == bench.settings.frame.apex_z_mm + 2.0
    assert bench.height_mm == pytest.approx(2.0)


def test_a_sine_from_clearance_may_touch() -> None:
    bench = Finger(tables=ZABER)
    engine = bench.ready()
    seen: list[float] = []
    engine.vibrate(SineMotion.of(2.0, 20.0, 1.0), seen.append)
    assert (engine.state, engine.may_touch, set(seen)) == (State.IN_CONTACT, True, {0.0})
    with raises(LimitError, "too_fast", limit_mm_s=5.0):
        engine.vibrate(SineMotion(0.9, 1.0, 1), seen.append)
