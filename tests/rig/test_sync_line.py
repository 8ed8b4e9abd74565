"""Pulses on RTS or DTR of a serial adapter: their times, the level at rest, and what a lost adapter does."""

import os
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

import rig.cli.pulse as pulse_command
from rig.bench.checks import bench_problems, sync_problems
from rig.bench.sync_line import sync_line
from rig.clock import WallClock
from rig.devices.sync_line import AdapterOutput, SyncLineError
from rig.engine import RunAborted, Target, TripError, indent
from rig.engine.indentation import ramp
from rig.plan.config import Config
from rig.settings import RigSettings, SyncSettings
from rig.transport import NotOwnedError, SerialTransport, TransportError, port_owner
from sim.devices.clock import VirtualClock
from sim.devices.sync_line import VirtualSyncLine
from tests.error_codes import raises
from tests.program import Program
from tests.rig.plain_bench import GlidingBench, PlainBench, PlainStage

LOOP = "loop://"
"""A port of pyserial in which RTS reaches CTS, and DTR reaches DSR."""

Levels = list[tuple[str, bool]]


@pytest.fixture
def levels(monkeypatch: pytest.MonkeyPatch) -> Levels:
    """What each line was set to."""
    found, usual = Levels(), SerialTransport.set_line

    def set_line(port: SerialTransport, line: Any, *, level: bool) -> None:
        usual(port, line, level=level)
        found.append((line, level))

    monkeypatch.setattr(SerialTransport, "set_line", set_line)
    return found


class Bench:
    """A bench of real time, of which only the clock counts."""

    clock = WallClock()


BENCH: Any = Bench()


def _settings(line: str = "rts", port: str = LOOP, **more: Any) -> SyncSettings:
    return SyncSettings(output=f"{line}:{port}", **more)


# --- the level of the line ---

ENDS: dict[str, BaseException | None] = {
    "the end of the run": None,
    "a trip": TripError("too much", "soft_trip"),
    "STOP": KeyboardInterrupt(),
    "the stop button": RunAborted("stopped", "stop_button"),
    "an error of the program": ZeroDivisionError(),
}
LEVELS = [(line, inverted, end) for line in ("rts", "dtr") for inverted in (False, True) for end in ENDS]


@pytest.mark.parametrize(("line", "inverted", "end"), LEVELS)
def test_the_line_is_at_rest_from_the_opening_of_its_port_and_after_every_ending(
    line: str, inverted: bool, end: str, levels: Levels
) -> None:
    """Also where a pulse has begun and not ended."""
    error, rest = ENDS[end], (line, inverted)
    try:
        with sync_line(_settings(line, inverted=inverted), BENCH) as output:
            assert levels == [rest]
            assert output is not None
            output.switch(True)
            assert levels[1:] == [(line, not inverted)]
            if error is not None:
                raise error
    except BaseException as raised:
        assert raised is error  # noqa: PT017
    assert levels[-1] == rest
    assert port_owner(LOOP) is None


def test_the_port_of_the_line_has_one_owner() -> None:
    with sync_line(_settings(), BENCH):
        assert port_owner(LOOP) is not None
        with raises(NotOwnedError, "in_use", port=LOOP):
            AdapterOutput(_settings(), WallClock())


def test_a_port_without_the_line_is_refused_before_a_motion() -> None:
    """A pseudo-terminal has neither RTS nor DTR."""
    master, slave = os.openpty()
    try:
        name = os.ttyname(slave)
        for line in ("rts", "dtr"):
            with raises(TransportError, "no_line", port=name), sync_line(_settings(line, name), BENCH):
                pass
            assert port_owner(name) is None
            (problem,) = sync_problems(Config.model_validate({"sync": {"output": f"{line}:{name}"}}))
            assert f"{name} has no {line.upper()} line" in problem
    finally:
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize("device", ["stage", "force"])
def test_the_port_of_stage_or_force_sensor_is_no_port_of_the_line(device: str) -> None:
    tables = {"stage": {"port": "/dev/one"}, "force": {"port": "/dev/two"}}
    (problem,) = bench_problems(Config.model_validate(tables | {"sync": {"output": f"rts:{tables[device]['port']}"}}))
    assert f"sync.output: {tables[device]['port']} is {device}.port" in problem


def test_no_output_but_an_adapters_line_is_virtual() -> None:
    with sync_line(SyncSettings(), BENCH) as line:
        assert line is None


# --- in a press ---


def _finger(bench: PlainBench) -> float:
    return bench.hertz(6.0, -0.3)


class Line:
    """A line that fails from its n-th switch on, and counts them."""

    def __init__(self, clock: VirtualClock, fails_at: int = 1000) -> None:
        self.line, self.fails_at, self.switches = VirtualSyncLine(clock), fails_at, 0

    def switch(self, on: bool) -> tuple[float, float]:
        self.switches += 1
        if self.switches >= self.fails_at:
            raise SyncLineError("RTS of /dev/a did not confirm", "sync_line_late")
        return self.line.switch(on)


def _bench(make: type[PlainBench] = GlidingBench, on_alarm: str = "warn", fails_at: int = 1000) -> Any:
    settings = {"sync": {"output": "rts:/dev/a"}, "limits": {"on_alarm": on_alarm}}
    bench: Any = make(_finger, settings)
    bench.line = bench.engine.sync_line = Line(bench.clock, fails_at)
    return bench


PRESSES: dict[str, tuple[Callable[[Any], Any], list[str]]] = {
    "a press in two increments": (
        lambda engine: indent(engine, Target("doi_mm", 0.3), increments=2, hold_s=0.2, expected_contact_mm=-0.3),
        ["touch", "hold_start", "hold_end", "hold_start", "hold_end"],
    ),
    "a ramp": (
        lambda engine: ramp(engine, 0.3, 0.2, hold_s=0.2, expected_contact_mm=-0.3),
        ["touch", "ramp", "hold_start", "hold_end"],
    ),
}


@pytest.mark.parametrize("kind", PRESSES)
def test_touch_ramp_hold_start_and_hold_end_have_a_pulse_with_its_uncertainty(kind: str) -> None:
    press, at = PRESSES[kind]
    bench = _bench()
    press(bench.ready())
    pulses, edges = bench.of("sync"), list(bench.line.line.edges)
    assert [one["at"] for one in pulses] == at
    assert [level for _, level in edges] == [True, False] * len(at)
    for one, (rise_s, _) in zip(pulses, edges[::2], strict=True):
        assert one["rise_s"] - one["uncertainty_s"] <= rise_s <= one["rise_s"]
        assert one["uncertainty_s"] == pytest.approx(0.001)
        assert one["width_s"] == pytest.approx(0.011)
    if kind == "a ramp":
        streams = [name for name, data in bench.events if name in ("sync", "ramp") or data.get("phase") == "ramp"]
        assert streams[streams.index("ramp") :][:3] == ["ramp", "sync", "sample"], (
            "before the first reading on its way"
        )


LOST = [(kind, n) for kind, (_, at) in PRESSES.items() for n in range(1, 2 * len(at) + 1)]


@pytest.mark.parametrize(("kind", "fails_at"), LOST)
def test_a_lost_adapter_is_one_alarm_and_the_press_ends_as_with_it(kind: str, fails_at: int) -> None:
    """Whichever edge fails, the line is left alone from then on, the hold is as long and the lift as high."""
    press, _ = PRESSES[kind]
    whole, lost = _bench(), _bench(fails_at=fails_at)
    for bench in (whole, lost):
        press(bench.ready())
    assert len(lost.of("alarm")) == 1
    assert lost.line.switches == fails_at
    assert len(lost.of("sync")) == (fails_at - 1) // 2
    ends = [[one[key] for one in bench.of("hold_end")] for bench in (whole, lost) for key in ("doi_mm", "readings")]
    assert ends[:2] == ends[2:]
    assert lost.engine.height_mm == whole.engine.height_mm == lost.settings.habits.clearance_mm
    assert lost.engine.problem is None
    press(lost.engine)
    assert lost.line.switches == fails_at, "no later press waits for it"


@pytest.mark.parametrize(("kind", "fails_at"), LOST)
def test_a_lost_adapter_lifts_where_an_alarm_trips(kind: str, fails_at: int) -> None:
    press, _ = PRESSES[kind]
    bench = _bench(on_alarm="trip", fails_at=fails_at)
    engine = bench.ready()
    with raises(TripError, "sync_line_late"):
        press(engine)
    assert engine.height_mm == bench.settings.habits.clearance_mm
    assert engine.contact.measured.kind == "lifted"


def test_an_adapter_that_blocks_is_given_up_and_keeps_nothing_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a system call may, for seconds, on an adapter that was pulled out; neither switch nor close waits."""
    unplugged, plugged = threading.Event(), SerialTransport.set_line

    def set_line(port: SerialTransport, line: Any, *, level: bool) -> None:
        plugged(port, line, level=level)
        if level:
            unplugged.wait()

    monkeypatch.setattr(SerialTransport, "set_line", set_line)
    try:
        with sync_line(_settings(), BENCH) as line:
            assert line is not None
            with raises(SyncLineError, "sync_line_late", s="0.1"):
                line.switch(True)
    finally:
        unplugged.set()
    assert port_owner(LOOP) is None


def test_an_adapter_that_is_gone_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    with sync_line(_settings(), BENCH) as line:
        assert line is not None

        def set_line(port: SerialTransport, line: Any, *, level: bool) -> None:
            raise TransportError("cannot set RTS: [Errno 5] Input/output error", "not_written")

        monkeypatch.setattr(SerialTransport, "set_line", set_line)
        with raises(SyncLineError, "sync_line_lost"):
            line.switch(True)


# --- rig pulse ---


@pytest.mark.parametrize(("line", "inverted"), [("rts", False), ("dtr", False), ("rts", True)])
def test_test_pulses_are_sent_and_their_times_printed(
    line: str, inverted: bool, levels: Levels, program: Program, tmp_path: Any
) -> None:
    config = tmp_path / "rig.toml"
    words = f'[sync]\noutput = "{line}:{LOOP}"\nwidth_s = 0.002\ninverted = {str(inverted).lower()}\n'
    config.write_text(words, encoding="utf-8")
    asked = ("pulse", "--config", config, "--count", 3, "--every-s", 0.02, "--loopback")
    found = program(*asked, "--json").json
    assert found["output"] == f"{line}:{LOOP}"
    assert [level for _, level in levels] == [inverted, *[not inverted, inverted] * 3, inverted]
    assert [one["requested_s"] for one in found["pulses"]] == sorted(one["requested_s"] for one in found["pulses"])
    for one in found["pulses"]:
        assert one["rise_s"] - one["requested_s"] == pytest.approx(one["uncertainty_s"], abs=2e-6)
        assert one["width_s"] >= 0.002
        assert one["answer_s"] is not None
    assert found["worst_uncertainty_s"] == max(one["uncertainty_s"] for one in found["pulses"])
    printed = program(*asked)
    assert printed.code == 0
    assert re.search(rf"{line.upper()} of {LOOP}: a rise was confirmed [\d.]+ ms after its request", printed.out)


def test_test_pulses_on_an_output_of_the_stage_connect_it_and_move_nothing(
    program: Program, monkeypatch: pytest.MonkeyPatch, tmp_path: Any
) -> None:
    clock = VirtualClock()
    stage = PlainStage(clock)

    @contextmanager
    def connected(settings: Config) -> Iterator[Any]:
        yield stage, clock

    monkeypatch.setattr(pulse_command, "connected_stage", connected)
    (tmp_path / "rig.toml").write_text('[sync]\noutput = "coolant"\n', encoding="utf-8")
    found = program("pulse", "--config", tmp_path / "rig.toml", "--count", 2, "--json").json
    assert [on for _, on in stage.outputs] == [True, False] * 2
    assert [one["uncertainty_s"] for one in found["pulses"]] == [0.002, 0.002]
    assert [one["requested_s"] for one in found["pulses"]] == [0.0, 1.0]
    assert stage.moves == 0


def test_an_engine_without_a_line_of_its_own_sends_the_pulses_of_its_stage_only() -> None:
    settings = RigSettings.model_validate({"sync": {"output": "rts:/dev/a"}})
    bench = PlainBench(_finger, settings.model_dump())
    indent(bench.ready(), Target("doi_mm", 0.3), hold_s=0.1, expected_contact_mm=-0.3)
    assert bench.of("sync") == bench.stage.outputs == []
