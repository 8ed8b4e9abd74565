"""What the process at the bench tells, keeps and logs: readings, state, what to do next, how it gets back in step."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rig.devices.base import ForceReading, ForceTimeout, MoveError, StageError
from rig.engine.bench_memory import BenchMemory
from rig.engine.sensing import ForceZero, Sensing
from rig.engine.steps import take_zero
from rig.errors import BadInputError, LimitError
from rig.manual import status as hand_log
from rig.manual.status import AT_A_TIME, COLUMNS, KEPT, Backlog, ManualLog
from rig.settings import RigSettings
from rig.transport.wire import TransportError
from rig.units import GWT_N
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.rig.hand_bench import APEX_MM, KINDS, HandBench, Person
from tests.stub_bench import StubSensor, raising

ZERO = ForceZero(0.0, 0.0)


@pytest.fixture(params=KINDS)
def make(request: pytest.FixtureRequest) -> Callable[..., HandBench]:
    return lambda **options: HandBench(request.param, **{"zero": ZERO, **options})


# --- readings ---


def test_the_backlog_returns_new_readings_in_portions_and_forgets_the_oldest() -> None:
    log = Backlog()
    assert log.since(0) == {"columns": COLUMNS, "rows": [], "next": 0}
    for number in range(450):
        log.add((float(number),))
    first = log.since(0)
    assert (len(first["rows"]), first["next"]) == (AT_A_TIME, 400)
    assert (first["rows"][0], first["rows"][-1]) == ((0.0,), (399.0,))
    second = log.since(400)
    assert (len(second["rows"]), second["next"]) == (50, 450)
    assert second["rows"][0] == (400.0,)
    assert log.since(450)["rows"] == log.since(9999)["rows"] == []
    assert log.since(9999)["next"] == 450
    for number in range(450, KEPT + 10):
        log.add((float(number),))
    assert log.since(0)["rows"][0] == log.since(3)["rows"][0] == (10.0,)
    assert log.since(11)["rows"][0] == (11.0,)


@pytest.mark.parametrize("period_s", [0.05, 0.02])
def test_an_idle_session_reads_the_sensor_at_its_own_rate(make: Callable[..., HandBench], period_s: float) -> None:
    """The stage beside it, ten times a second."""
    bench = make(sample_period_s=period_s)
    looks: list[float] = []
    status = bench.bench.stage.status
    bench.bench.stage.status = lambda: (looks.append(bench.clock.monotonic_s()), status())[1]  # type: ignore[method-assign]

    def person() -> Person:
        bench.spring.offset_gwt = 1.5
        yield 10.0
        told = bench("status", since=1 << 40)["readings"]["next"]
        assert told == pytest.approx(10.0 / period_s, rel=0.04)
        found = bench("status", since=told - 10)
        rows = found["readings"]["rows"]
        assert len(rows) == 10
        assert 85 <= len(looks) <= 103
        assert rows[-1][0] == pytest.approx(bench.clock.unix_s(), abs=0.11)
        assert rows[-1][1] == pytest.approx(bench.clock.monotonic_s(), abs=0.11)
        assert rows[-1][2] == found["force_gwt"] == pytest.approx(1.5, abs=0.01)
        assert rows[-1][3:] == [found["x_mm"], found["y_mm"], found["z_mm"], found["height_mm"]]
        assert found["height_mm"] == pytest.approx(3.0, abs=0.003)
        assert found["z_mm"] == pytest.approx(APEX_MM + 3.0, abs=0.003)
        assert found["read_unix_s"] == pytest.approx(rows[-1][0], abs=0.002)
        assert found["seen_unix_s"] == pytest.approx(bench.clock.unix_s(), abs=0.15)
        assert "readings" not in bench("status")

    bench.run(person())


@pytest.mark.parametrize("since", [-1, 1.5, "all"])
def test_status_refuses_a_reading_number_that_is_no_whole_number(since: Any) -> None:
    with raises(LimitError, "invalid_request", do="status", key="since", value=since):
        HandBench("grbl")("status", since=since)


@pytest.mark.parametrize(
    "wrong",
    [{"tab": None}, {"axis": "u"}, {"sign": 0}, {"sign": "1"}, {"by_mm": 0.0}, {"by_mm": 5.1}, {"by_mm": "much"}],
    ids=str,
)
def test_a_step_with_an_invalid_axis_sign_or_length_is_refused(wrong: dict[str, Any]) -> None:
    bench = HandBench("grbl")
    step = {"axis": "x", "sign": 1, "by_mm": 1.0, "tab": "one"}
    with raises(LimitError, "invalid_request"):
        bench("step", **step | wrong)
    assert bench("status")["busy"] is None


# --- state ---


def test_while_homing_the_status_reports_no_position(make: Callable[..., HandBench]) -> None:
    bench = make()

    def person() -> Person:
        yield 0.1
        bench("home")
        yield 1.0
        found = bench("status", since=0)
        assert (found["state"], found["busy"], found["homed"]) == ("Home", "home", False)
        assert [found[key] for key in ("x_mm", "y_mm", "z_mm", "height_mm")] == [None] * 4
        assert found["readings"]["rows"][-1][3:] == [None] * 4
        assert found["readings"]["rows"][-1][2] is not None
        yield from bench.done()
        assert bench("status")["height_mm"] == pytest.approx(bench.height_mm, abs=0.003)

    bench.run(person())


def test_a_silent_sensor_is_reported_and_its_last_reading_keeps_its_time(make: Callable[..., HandBench]) -> None:
    bench = make()
    read = bench.bench.force.read

    def person() -> Person:
        yield 0.3
        before = bench("status")
        assert before["force_problem"] is None
        bench.bench.force.read = raising(ForceTimeout("no answer"))  # type: ignore[method-assign]
        yield 1.0
        found = bench("status")
        assert (found["force_problem"], found["read_unix_s"]) == ("no answer", before["read_unix_s"])
        assert found["next"] == "nothing moves while the force sensor does not answer"
        bench.bench.force.read = lambda: ForceReading(float("inf"), True, 0.0)  # type: ignore[method-assign]
        yield 0.2
        assert bench("status")["force_problem"] == "the force reading is inf, not a number"
        bench.bench.force.read = read  # type: ignore[method-assign]
        yield 0.2
        assert bench("status")["force_problem"] is None

    bench.run(person())


def test_while_another_program_stops_the_stage_no_device_is_queried(make: Callable[..., HandBench]) -> None:
    bench = make()
    tries: list[float] = []
    open_again = bench.gate.open

    def person() -> Person:
        yield 0.3
        with bench.gate.stopping():
            bench.gate.open = lambda: (tries.append(bench.clock.monotonic_s()), open_again())[1]  # type: ignore[method-assign]
            yield 0.1
            before = len(bench.sent()) + len(bench.sent("force"))
            yield 0.5
            assert len(bench.sent()) + len(bench.sent("force")) == before
            assert bench("status")["homed"] is False
        assert 25 <= len(tries) <= 31
        yield 0.5
        assert len(bench.sent("force")) + len(bench.sent()) > before + 5

    bench.run(person())


# --- a stage that fails ---


def test_a_stage_that_failed_is_reconnected_and_counts_as_unhomed(make: Callable[..., HandBench]) -> None:
    bench = make()
    stage = bench.bench.stage
    status, connect, connected = stage.status, stage.connect, []

    def person() -> Person:
        yield 0.3
        stage.connect = lambda: (connected.append(1), connect())[1]  # type: ignore[method-assign]
        stage.stop()
        stage.status = raising(StageError("the board was reset"))  # type: ignore[method-assign]
        yield 0.3
        found = bench("status")
        assert (found["stage_problem"], found["homed"], found["height_mm"]) == ("the board was reset", False, None)
        assert not connected
        stage.status = status  # type: ignore[method-assign]
        yield 2.0
        assert bench("status")["stage_problem"] is None
        assert len(connected) == 1
        yield from bench.step("x", 0.5)

    found = bench.run(person())
    assert (found["ended_by"], found["homed"]) == (None, False)
    assert bench.memory.read().left_at_mm is None


def test_a_board_in_feed_hold_is_not_reconnected_before_its_release() -> None:
    """Speaking to it would reset it: somebody holds it on purpose."""
    bench = HandBench("grbl", zero=ZERO)
    stage: Any = bench.bench.stage
    status, connect, connected = stage.status, stage.connect, []

    def person() -> Person:
        stage.connect = lambda: (connected.append(1), connect())[1]
        stage.stop()
        stage.status = raising(StageError("the board was reset"))
        yield 0.3
        stage.status = lambda: replace(status(), state="Hold:0")
        yield 1.0
        assert (bench("status")["state"], connected) == ("Hold:0", [])
        yield from bench.step("x", 1.0)
        assert "Hold:0" in bench("status")["ended_by"]
        assert not connected
        stage.status = status
        yield 1.0
        assert connected == [1]

    bench.run(person())


def test_a_step_refused_for_its_axis_or_speed_leaves_the_stage_homed() -> None:
    bench = HandBench("leadshine", zero=ZERO)

    def person() -> Person:
        yield from bench.step("y", 1.0)
        assert "no drive for the y axis" in bench("status")["ended_by"]
        refused = MoveError("speed_mm_s must be at least 0.02")
        bench.bench.stage.moving = lambda **_: raising(refused)()  # type: ignore[method-assign]
        yield from bench.step("x", 1.0)
        assert bench("status")["ended_by"] == "speed_mm_s must be at least 0.02; nothing was moved"

    assert bench.run(person())["homed"]
    assert bench.moves_sent()[-1] < bench.clock.monotonic_s() - 1.0


def test_a_session_ends_when_its_port_is_lost(make: Callable[..., HandBench]) -> None:
    bench = make()

    def person() -> Person:
        yield 0.3
        bench.bench.stage.status = raising(TransportError("cannot read from stage"))  # type: ignore[method-assign]
        yield 5.0
        raise AssertionError("it went on")

    with pytest.raises(TransportError) as caught:
        bench.run(person())
    assert str(caught.value) == "cannot read from stage"
    assert bench.memory.read().left_at_mm is None


def test_an_unexpected_error_in_a_session_stops_the_stage(make: Callable[..., HandBench]) -> None:
    bench = make()
    stops: list[int] = []

    def person() -> Person:
        bench.bench.stage.stop = lambda: stops.append(1)  # type: ignore[method-assign]
        yield 0.3
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bench.run(person())
    assert stops == [1]


def test_a_session_that_ends_after_a_stop_records_no_stage_position(make: Callable[..., HandBench]) -> None:
    bench = make()

    def person() -> Person:
        yield 0.3
        bench("stop")

    assert bench.run(person())["homed"] is False
    assert bench.memory.read().left_at_mm is None


def test_a_session_left_during_a_step_finishes_the_step_and_records_the_position(
    make: Callable[..., HandBench],
) -> None:
    bench = make()

    def person() -> Person:
        bench("step", axis="x", sign=1, by_mm=5.0, tab="one")
        yield 1.5

    bench.run(person())
    left_mm, pad_mm = bench.memory.read().left_at_mm, bench.config.frame.pad_centre_x_mm
    assert bench.x_mm == pytest.approx(5.0, abs=0.003)
    assert left_mm is not None
    assert left_mm[0] - pad_mm == pytest.approx(5.0, abs=0.003)
    assert bench.refusal("step") == "busy: leaving"


def test_a_session_ends_when_its_client_is_gone() -> None:
    bench = HandBench("grbl")
    asked: list[float] = []

    def gone() -> bool:
        asked.append(bench.clock.monotonic_s())
        return len(asked) > 20

    with bench.owner.begun():
        bench.owner.run(gone)
    assert len(asked) == 21
    assert asked[-1] - asked[0] == pytest.approx(20 * bench.bench.force.sample_period_s, abs=0.15)


def test_a_session_does_not_begin_without_an_answer_of_the_sensor() -> None:
    bench = HandBench("grbl")
    bench.bench.force.connect = raising(ForceTimeout("no balance answers"))  # type: ignore[method-assign]
    with raises(BadInputError, "not_felt", problem="no balance answers"), bench.owner.begun():
        raise AssertionError("begun")


# --- zero ---


def test_a_zero_that_fails_midway_erases_the_recorded_zero(make: Callable[..., HandBench]) -> None:
    """The sensor counts from elsewhere then, and from where nobody knows."""
    bench = make(zero=ForceZero(0.02, 0.0))
    bench.spring.offset_gwt = 0.02 / GWT_N
    zero, read = bench.bench.force.zero, bench.bench.force.read

    def zeroed() -> None:
        zero()
        bench.bench.force.read = raising(ForceTimeout("no answer"))  # type: ignore[method-assign]

    def person() -> Person:
        bench.bench.force.zero = zeroed  # type: ignore[method-assign]
        yield from bench.do("zero")
        found = bench("status")
        assert found["ended_by"] == "no force reading: no answer; zero the sensor again"
        assert (found["zeroed"], found["homed"]) == (False, True)
        assert bench.memory.read().zero is None
        bench.bench.force.read = read  # type: ignore[method-assign]
        bench.bench.force.zero = zero  # type: ignore[method-assign]
        yield from bench.do("zero")

    found = bench.run(person())
    assert (found["ended_by"], found["zeroed"]) == (None, True)
    assert bench.memory.read().zero is not None


def test_a_sensor_that_refuses_to_zero_keeps_the_recorded_zero() -> None:
    settings, sensor = RigSettings(), StubSensor(VirtualClock(1.7e9))
    memory, sensing = BenchMemory(settings), Sensing(settings, sensor.clock, sensor)  # type: ignore[arg-type]
    memory.record_zero(ZERO)
    sensing.zero = ZERO
    sensor.zero = raising(ForceTimeout("not stable"))  # type: ignore[method-assign]
    with pytest.raises(ForceTimeout) as caught:
        take_zero(sensing, memory)
    assert str(caught.value) == "not stable"
    assert memory.read().zero == sensing.zero == ZERO


# --- the log ---


def test_every_manual_log_begins_with_the_wall_time_and_the_oldest_are_deleted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("RIG_STATE_DIR", str(tmp_path))
    monkeypatch.setattr(hand_log, "FILE_BYTES", 100)
    assert hand_log.KEPT_FILES == 16
    clock = VirtualClock(1.7e9, 50.0)
    with ManualLog(clock) as log:
        for number in range(200):
            clock.wait_s(0.01)
            log.write(f'{{"number": {number:5d}}}\n')
        assert log.problem is None
        assert log.path.exists()
    files = sorted((tmp_path / "by_hand").iterdir())
    assert len(files) == 16
    assert files[-1] == log.path
    lines = [[json.loads(line) for line in path.read_text("ascii").splitlines()] for path in files]
    for first, *rest in lines:
        assert first["unix_s"] - first["t_s"] == pytest.approx(1.7e9 - 50.0)
        assert 1 <= len(rest) <= 6
    numbers = [line["number"] for _, *rest in lines for line in rest]
    assert numbers == list(range(200 - len(numbers), 200))
    assert len(numbers) >= 75


def test_the_manual_log_records_each_action_beside_the_bytes(make: Callable[..., HandBench]) -> None:
    bench = make()

    def person() -> Person:
        yield from bench.step("z", 0.5)
        yield from bench.do("zero", anyway=True)
        yield from bench.do("home")

    bench.run(person())
    did = [json.loads(line) for line in bench.wire.getvalue().splitlines() if '"did"' in line]
    assert [(line["did"], line["ended_by"]) for line in did] == [
        ("step z +0.5 mm", None), ("zero anyway", None), ("home", None),
    ]  # fmt: skip
    assert did[0]["t_s"] < did[1]["t_s"] < did[2]["t_s"] < bench.clock.monotonic_s()


def test_a_stop_that_the_stage_does_not_confirm_is_reported_as_unconfirmed(make: Callable[..., HandBench]) -> None:
    def still_runs() -> None:
        raise StageError("x axis still runs")

    bench = make()
    bench.bench.stage.stop = still_runs  # type: ignore[method-assign]
    assert bench("stop") == {"stopped": True, "unconfirmed": "x axis still runs"}
    assert bench.gate.closed
