"""Vibrations under one fault: of the command, of the device's sine, of a cell that reads half, and of limits."""

from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rig.bench.virtual import stage_opener
from rig.devices.base import MoveError, StageError, StageRejected
from rig.devices.make_drivers import stage_driver
from rig.devices.zaber_link import checksum
from rig.engine import Engine, LimitError, Target, TripError, verbs
from rig.engine.bench import Pause
from rig.engine.engine import State
from rig.engine.indentation import indent
from rig.engine.limits import CONTACT_EXPONENT, RELAXED_TO, VibrationBound
from rig.engine.press import Press
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.plan import Plan, refuse_vibrations
from rig.records import PlannedIndentation, SineMotion
from rig.units import GWT_N
from sim.devices.zaber import CommandRejected
from studies.faults.campaign.faults import WireFault
from studies.faults.faulty_bench import PREDICTED, SOFT_TRIP_N, FaultyBench
from studies.faults.outcomes import bound_gwt
from tests.error_codes import raises
from tests.rig.test_vibrate import PRELOAD, SINE, SLOW, ZABER, _bench, _in_the_vibration, _of, _vibrate

STEP_MM = 0.0025
LONG = SineMotion.of(4.0, 50.0, 60.0)
BRIEF = SineMotion.of(4.0, 50.0, 0.5)


@pytest.fixture
def faulty(tmp_path: Path) -> Iterator[FaultyBench]:
    """A bench of Zaber's stage, ready at x = 0, that keeps its events."""
    bench = _bench(tmp_path)
    bench.worst_n = 0.0
    yield bench
    bench.journal.close()


def _lowest_gwt(sine: SineMotion, doi_mm: float = PRELOAD.value) -> float:
    """The force at the lower end of a sine, and one step of the stage below it."""
    return PREDICTED.force_at(PREDICTED.contact_mm - doi_mm - sine.amplitude_mm - 2 * STEP_MM) / GWT_N


def _read_as(bench: FaultyBench, old: bytes, new: bytes) -> None:
    """The device makes this sine, although it accepts the command."""
    read = bench.board._read

    def changed(line: bytes) -> None:
        content = line[1:].rpartition(b":")[0].replace(b"move sin " + old, b"move sin " + new).decode()
        read(f"/{content}:{checksum(content)}".encode() if b"move sin" in line else line)

    bench.board._read = changed


def _again(bench: FaultyBench) -> None:
    """Another program at the same devices."""
    bench.stage = stage_driver(
        stage_opener(bench.config, bench.stage_line, bench._stage_wire), bench.clock, bench.config
    )
    bench.engine = Engine(bench.config, bench, bench.journal, SOFT_TRIP_N)
    bench.engine.may_touch = True


# --- the command ---


@pytest.mark.parametrize(
    ("sine", "at"), [*((SineMotion.of(4.0, 50.0, 25.0), at) for at in range(10)), (SINE, 6), (SINE, 7)]
)
def test_no_bytes_of_a_sine_that_change_places_press_deeper(faulty: FaultyBench, sine: SineMotion, at: int) -> None:
    """A checksum does not notice it; a fast sine may show its upper end alone in every report."""
    told = f"20 {sine.period_s * 1000:g} {sine.cycles}".encode()
    (_, swapped), *_ = WireFault("swap", at).pieces(b" " + told)
    _read_as(faulty, told, swapped[1:] if swapped[:1] == b" " else swapped)
    with suppress(StageError, TripError):
        _vibrate(faulty, sine)
    assert faulty.worst_n / GWT_N <= _lowest_gwt(sine)


@pytest.mark.parametrize(("amplitude", "period_ms"), [(21, 250), (41, 50), (202, 250)])
def test_the_device_refuses_a_larger_amplitude(faulty: FaultyBench, amplitude: int, period_ms: int) -> None:
    _read_as(faulty, b"20 250 8", f"{amplitude} {period_ms} 8".encode())
    with pytest.raises(StageRejected):
        _vibrate(faulty)
    assert faulty.worst_n / GWT_N < _lowest_gwt(SINE)


def test_the_limit_of_the_device_is_again_that_of_the_travel(faulty: FaultyBench) -> None:
    z = faulty.board.z
    travel = z.settings["limit.max"]
    lowest: list[int] = []
    begin = z._begin_sine

    def begins(*words: Any) -> None:
        lowest.append(z.settings["limit.max"] - z.position())
        begin(*words)

    z._begin_sine = begins
    _in_the_vibration(faulty, lambda: lowest.append(z.settings["limit.max"]))
    _vibrate(faulty)
    assert lowest == [40, travel]
    assert z.settings["limit.max"] == travel


def test_a_limit_that_cannot_be_reset_at_once_is_reset_before_the_next_move(faulty: FaultyBench) -> None:
    z = faulty.board.z
    travel = z.settings["limit.max"]
    set_ = z._set

    def busy(setting: str, value: str) -> str:
        if z.busy:
            raise CommandRejected("STATUSBUSY")
        return set_(setting, value)

    z._set = busy
    _vibrate(faulty)
    assert z.settings["limit.max"] == travel


# --- the limit of the device, lowered for a sine and reset ---

ABOUT_A_SINE = ("set", "question after the set", "sine", "reset", "question after the reset")
MESSAGES = ("lost", "reply lost", "reply swapped", "refused", "swap 0", "swap 1", "swap 2", "swap 3")
ENDS = ("cut", "stop", "kill before", "kill after")


class Killed(BaseException):
    """The program is gone."""


def _at_frame(bench: FaultyBench, frame: str, fault: str) -> list[int]:
    """Let a fault happen at a frame about a sine; return the limits of the device after each frame since."""
    read, send, left, limits = bench.board._read, bench.stage_line.device_write, list(ABOUT_A_SINE), list[int]()
    kind, _, at = fault.partition(" ")

    def next_reply(change: Callable[[bytes], bytes]) -> None:
        def write(data: bytes) -> None:
            bench.stage_line.device_write = send  # type: ignore[method-assign]
            send(change(data))

        bench.stage_line.device_write = write  # type: ignore[method-assign]

    def swapped(line: bytes, n: int) -> bytes:
        return WireFault("swap", line.rindex(b":") - 2 - n).pieces(line)[0][1]

    def fails(line: bytes) -> None:
        match kind, at:
            case "lost", _:
                return
            case "cut", _:  # The rest of the next line ends it.
                bench.board._read = lambda line: setattr(bench.board, "_read", heard)
                return
            case "reply", "lost":
                next_reply(lambda data: b"")
            case "reply", "swapped":
                next_reply(lambda data: swapped(data, 0))
            case "refused", _:
                line = line.rpartition(b":")[0] + b" what"
            case "swap", n:
                line = swapped(line, int(n))
            case "stop", _:  # as another thread, which waits for nothing
                stage: Any = bench.stage
                stage._times_stopped += 1
                stage._trusted = False
                stage._send_stop()
            case "kill", when:
                if when == "after":
                    read(line)
                bench.board._read = lambda line: None  # Nothing of the program arrives any more.
                raise Killed
        read(line)

    def heard(line: bytes) -> None:
        about = left and (b"limit.max" in line or b"move sin" in line)
        (fails if about and left.pop(0) == frame else read)(line)
        limits.append(bench.board.z.settings["limit.max"])

    def begin() -> None:
        bench.board._read = heard

    bench.after("vibrate", begin)
    bench.read = read  # type: ignore[attr-defined]
    return limits


@pytest.mark.parametrize("fault", MESSAGES + ENDS)
def test_a_fault_about_the_limit_leaves_a_stage_that_lifts_and_is_right_or_refuses(
    faulty: FaultyBench, fault: str
) -> None:
    """Frame after frame on one stage, homed in between; one wrong message does not even end the vibration."""
    z, killed = faulty.board.z, fault.startswith("kill")
    travel = z.settings["limit.max"]
    for frame in ABOUT_A_SINE:
        harmless = fault in MESSAGES and frame != "sine"
        limits = _at_frame(faulty, frame, fault)
        with nullcontext() if harmless else suppress(StageError, TripError, Killed):
            _vibrate(faulty, BRIEF)
        faulty.board._read = faulty.read  # type: ignore[attr-defined]
        assert faulty.worst_n / GWT_N <= _lowest_gwt(BRIEF), frame
        assert fault.startswith("swap") or max(limits) <= travel, frame
        assert killed or z.settings["limit.max"] == travel, frame
        if harmless:
            assert faulty.engine.state is State.READY, frame
            assert faulty.height_mm == pytest.approx(2.0, abs=0.003), frame
            continue
        tripped = faulty.engine.state is State.TRIPPED
        if tripped:  # by the time without a reading
            assert fault == "cut"
            assert faulty.height_mm == pytest.approx(2.0, abs=0.003), frame
        if killed:
            faulty.clock.wait_s(3.0)
        if killed or tripped:
            _again(faulty)
        if z.settings["limit.max"] < travel:
            with raises(StageError, "not_as_configured", setting="limit.max"):
                verbs.home(faulty.engine)
            assert faulty.height_mm == pytest.approx(12.0, abs=0.01), frame
            assert not faulty.stage.homed
            z.settings["limit.max"] = travel  # as somebody sets it
        verbs.home(faulty.engine)
        assert faulty.stage.homed
        assert faulty.height_mm == pytest.approx(12.0, abs=0.01), frame
        assert z.settings["limit.max"] == travel
        verbs.mount(faulty.engine, "bar:3.0")
        verbs.zero(faulty.engine)
        verbs.move_to(faulty.engine, 0.0)
    done = indent(faulty.engine, PRELOAD, expected_contact_mm=PREDICTED.contact_mm)
    assert done.holds[-1].doi_mm == pytest.approx(PRELOAD.value, abs=0.003)


@pytest.mark.parametrize("phase", ["a trip", "a stop"])
def test_a_limit_that_the_device_never_resets_leaves_the_way_up(faulty: FaultyBench, phase: str) -> None:
    """Homing then refuses it, at home."""
    z, set_ = faulty.board.z, faulty.board.z._set

    def refuses(setting: str, value: str) -> str:
        if z.busy or sets:
            raise CommandRejected("STATUSBUSY")
        sets.append(value)
        return set_(setting, value)

    sets: list[str] = []
    z._set = refuses
    acts: dict[str, Any] = {
        "a trip": lambda: setattr(faulty, "felt_n", lambda t_s: 90 * GWT_N),
        "a stop": faulty.stage.stop,
    }
    _in_the_vibration(faulty, acts[phase])
    with pytest.raises((StageError, TripError)):
        _vibrate(faulty)
    if phase == "a trip":
        assert faulty.height_mm >= faulty.config.habits.clearance_mm - 0.003
        assert faulty.engine.state is State.TRIPPED
    else:
        with pytest.raises(StageRejected):
            verbs.home(faulty.engine)
        assert faulty.height_mm == pytest.approx(12.0, abs=0.01)
        assert not faulty.stage.homed
    assert sets


# --- the sine of the device ---


@pytest.mark.quick(rows=lambda sine, ms, ended_by: ended_by == "nobody" or (sine, ms) in ((LONG, 25), (SLOW, 500)))
@pytest.mark.parametrize(
    ("sine", "ms"),
    [
        (LONG, 25),
        (LONG, 80),
        (LONG, 205),
        (LONG, 520),
        (SLOW, 100),
        (SLOW, 500),
        (SineMotion.of(2.0, 80.0, 30.0), 50),
    ],
)
@pytest.mark.parametrize("ended_by", ["nobody", "a pause", "a trip", "a stop"])
def test_a_sine_of_another_period_ends_within_its_ends(
    faulty: FaultyBench, sine: SineMotion, ms: int, ended_by: str
) -> None:
    """From its speed the device would brake on a way of up to 2 mm, so the sine ends with its cycle."""
    amplitude = round(sine.amplitude_mm / STEP_MM)
    told, heard = f"{amplitude} {sine.period_s * 1000:g} {sine.cycles}", f"{amplitude} {ms} {sine.cycles}"
    _read_as(faulty, told.encode(), heard.encode())
    asked: list[bool] = []
    faulty.pause = Pause(lambda: bool(asked), lambda meanwhile: False)
    acts: dict[str, Any] = {
        "nobody": lambda: None,
        "a pause": lambda: asked.append(True),
        "a trip": lambda: setattr(faulty, "felt_n", lambda t_s: 90 * GWT_N),
        "a stop": faulty.stage.stop,
    }
    _in_the_vibration(faulty, acts[ended_by], 0.71)
    with pytest.raises((StageError, TripError)):
        _vibrate(faulty, sine)
    assert faulty.worst_n / GWT_N <= _lowest_gwt(sine)


@pytest.mark.parametrize("at_s", [0.5, 0.56, 0.62, 0.69])
def test_a_new_program_homes_over_a_sine_that_a_killed_one_left(faulty: FaultyBench, at_s: float) -> None:
    def kill() -> None:
        raise Killed

    _in_the_vibration(faulty, lambda: faulty.after("vibrate", kill), at_s)
    with pytest.raises(Killed):
        _vibrate(faulty, LONG)
    faulty.clock.wait_s(1.0)
    assert faulty.board.z.busy
    _again(faulty)
    verbs.home(faulty.engine)
    assert faulty.stage.homed
    assert faulty.height_mm == pytest.approx(12.0, abs=0.01)
    assert faulty.worst_n / GWT_N <= _lowest_gwt(LONG)


# --- a cell that reads half ---


def _planned(sine: SineMotion | None, force_gwt: float, doi_mm: float) -> PlannedIndentation:
    return PlannedIndentation(
        indentor="bar:3.0", x_mm=0.0, target=Target("force_gwt", force_gwt), expected_contact_mm=-0.3,
        predicted_doi_mm=doi_mm, predicted_force_gwt=force_gwt, contact_area_mm2=20.0, peak_pressure_mpa=0.01,
        increments=1, hold_s=1.0, vibration=sine,
    )  # fmt: skip


def _plan_of(*planned: PlannedIndentation) -> Plan:
    plan = Plan()
    plan.presses["data"] += planned
    return plan


@pytest.mark.parametrize("amplitude_um", [20.0, 50.0, 100.0, 200.0])
@pytest.mark.parametrize(("force_gwt", "doi_mm"), [(8.0, 0.86), (8.0, 1.4), (2.0, 0.4)])
def test_a_cell_that_reads_half_leaves_a_vibration_below_the_trip(
    amplitude_um: float, force_gwt: float, doi_mm: float
) -> None:
    """The press to the preload then goes to twice the force; the soft trip is twice that of the lower end."""
    sine = SineMotion.of(1.0, amplitude_um, 1.0)
    trip_gwt = _plan_of(_planned(sine, force_gwt, doi_mm)).soft_trip_n / GWT_N
    true_mm = doi_mm * 2 ** (1 / CONTACT_EXPONENT)
    lower_end_gwt = 2 * force_gwt * ((true_mm + sine.amplitude_mm) / true_mm) ** CONTACT_EXPONENT
    assert lower_end_gwt < trip_gwt
    assert _plan_of(_planned(None, force_gwt, doi_mm)).soft_trip_n == pytest.approx(2 * force_gwt * GWT_N)


@pytest.mark.parametrize("amplitude_um", [20.0, 50.0, 80.0])
def test_a_cell_that_reads_half_presses_no_further_than_the_bound(tmp_path: Path, amplitude_um: float) -> None:
    sine = SineMotion.of(1.0, amplitude_um, 1.0)
    trip_n = _plan_of(_planned(sine, 8.0, 0.86)).soft_trip_n
    bench = _bench(tmp_path, {"limits": {"soft_trip_n": trip_n}})
    bench.engine.trips.soft_gwt = trip_n / GWT_N
    bench.felt_n = lambda t_s: 0.5 * bench.true_n(t_s)
    bench.worst_n = 0.0
    _vibrate(bench, sine, Target("force_gwt", 8.0))
    (begun,) = _of(bench, "vibrate")
    assert 2 * 8.0 < bench.worst_n / GWT_N <= begun["bound_gwt"]
    bench.journal.close()


# --- limits ---


def test_the_limit_of_force_counts_at_the_lower_end() -> None:
    press = _planned(SINE, 8.0, 0.86)
    plan = _plan_of(press)
    peak_gwt = plan.peak_force_gwt
    assert peak_gwt == pytest.approx(8.0 * (1 + 1.5 * 0.05 / 0.86 / 0.6))
    refuse_vibrations(plan, Config.model_validate(ZABER | {"limits": {"max_force_gwt": peak_gwt + 0.01}}))
    with raises(BadInputError, "means_beyond_limit", limit="max_force_gwt"):
        refuse_vibrations(plan, Config.model_validate(ZABER | {"limits": {"max_force_gwt": peak_gwt - 0.01}}))


@pytest.mark.parametrize(
    ("sine", "code"),
    [
        (SineMotion(20.0, 100.0, 1), "outside_travel"),
        (SineMotion(3.0, 10.0, 1), "below_floor"),
        (SineMotion(0.05, 0.05, 1), "too_fast"),
    ],
)
def test_the_engine_sends_no_sine_beyond_a_limit(faulty: FaultyBench, sine: SineMotion, code: str) -> None:
    sines: list[object] = []
    faulty.board.z._begin_sine = lambda *words: sines.append(words)
    with raises(LimitError, code):
        faulty.engine.vibrate(sine, lambda force_gwt: None)
    assert not sines


@pytest.mark.parametrize(("share", "refused"), [(0.89, False), (0.91, True)])
def test_the_lower_end_stays_a_tenth_below_the_trip(share: float, refused: bool) -> None:
    bound = VibrationBound.of(Config.model_validate(ZABER), SINE, 16.0, 8.0, 0.86)
    near = replace(bound, peak_gwt=share * bound.trip_gwt)
    with raises(LimitError, "vibration_too_large") if refused else nullcontext():
        near.refuse_beyond(LimitError, 0.0)


def test_a_preload_at_the_skin_is_refused_and_lifted(faulty: FaultyBench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The press to it ends within half a step, which may be above contact."""
    for reached in ((0.02, 0.03), (0.0, 0.05), (-0.001, 0.05), (0.001, 0.0), (-0.001, -0.02)):
        monkeypatch.setattr(Press, "reach", lambda self, target, reached=reached: reached)
        with raises(LimitError, "vibration_leaves_skin", largest_um=0.0):
            _vibrate(faulty, SineMotion.of(4.0, 5.0, 1.0), Target("doi_mm", 0.02))
        assert not _of(faulty, "vibrate")
        assert faulty.engine.state is State.READY
        assert faulty.height_mm == pytest.approx(2.0, abs=0.003)


def test_the_contact_time_ends_a_vibration(tmp_path: Path) -> None:
    bench = _bench(tmp_path, {"limits": {"max_contact_s": 40.0}})
    begun_s = bench.clock.monotonic_s()
    with raises(LimitError, "contact_time"):
        _vibrate(bench, SineMotion.of(4.0, 50.0, 600.0))
    assert bench.clock.monotonic_s() - begun_s < 90.0
    assert bench.engine.state is State.READY
    assert bench.height_mm == pytest.approx(2.0, abs=0.003)
    bench.journal.close()


def test_an_amplitude_below_a_microstep_leaves_the_stage_homed(faulty: FaultyBench) -> None:
    with raises(MoveError, "too_small"):
        list(faulty.stage.vibrating(amplitude_mm=0.002, period_s=1.0, cycles=1))
    assert faulty.stage.homed


# --- readings ---


@pytest.mark.quick(rows=lambda phase, nearer_mm: nearer_mm == 0.5 or phase == 0.25)
@pytest.mark.parametrize("phase", [0.0, 0.25, 0.5, 0.75])
@pytest.mark.parametrize("nearer_mm", [0.4, 0.45, 0.5])
def test_readings_that_never_see_the_peak_keep_the_bound(faulty: FaultyBench, phase: float, nearer_mm: float) -> None:
    """The sensor shows one phase of each cycle again and again, as if it were read once a cycle."""
    begun_s: list[float] = []

    def alias() -> None:
        begun_s.append(faulty.clock.monotonic_s())

        def seen(t_s: float) -> float:
            at_s = begun_s[0] + (int((t_s - begun_s[0]) / SINE.period_s - phase) + phase) * SINE.period_s
            return faulty.true_n(max(at_s, begun_s[0]))

        faulty.felt_n = seen
        faulty.nearer_mm = nearer_mm

    _in_the_vibration(faulty, alias)
    with suppress(TripError):
        _vibrate(faulty)
    assert faulty.worst_n / GWT_N <= bound_gwt()


@pytest.mark.parametrize(("amplitude_um", "phase"), [(50.0, 0.25), (100.0, 0.0)])
def test_tissue_that_has_relaxed_keeps_the_bound_unseen(tmp_path: Path, amplitude_um: float, phase: float) -> None:
    """It keeps 0.6 of its force and swings by all of it; the finger comes nearer by 0.3 mm/s."""
    sine = SineMotion.of(3.0, amplitude_um, 20.0)
    bench = _bench(tmp_path, {"limits": {"soft_trip_n": SOFT_TRIP_N, "max_doi_mm": 2.0}})
    clock, seen_gwt = bench.clock, [0.0]
    state = [clock.monotonic_s(), 0.0]

    def elastic_n(t_s: float) -> float:
        return PREDICTED.force_at(bench.reached_mm(bench.carriage.pose_at(t_s).above_apex_mm))

    def true_n(t_s: float) -> float:
        while state[0] + 0.002 <= t_s:
            state[0] += 0.002
            state[1] += (elastic_n(state[0]) - state[1]) * 0.001
        return max(elastic_n(t_s) - (1 - RELAXED_TO) * state[1], 0.0)

    def nearer() -> None:
        bench.nearer_mm += 0.003
        clock.call_at(clock.monotonic_s() + 0.01, nearer)

    def look() -> None:
        seen_gwt[0] = true_n(clock.monotonic_s())
        clock.call_at(clock.monotonic_s() + sine.period_s, look)

    def begin() -> None:
        nearer()
        look()
        bench.felt_n = lambda t_s: seen_gwt[0]

    bench.true_n = true_n  # type: ignore[method-assign]
    _in_the_vibration(bench, begin, 5.0 + phase * sine.period_s)
    with raises(TripError, "vibration_trip"):
        _vibrate(bench, sine, Target("force_gwt", 8.0))
    (begun,) = _of(bench, "vibrate")
    assert bench.worst_n / GWT_N <= begun["bound_gwt"]
    bench.journal.close()
