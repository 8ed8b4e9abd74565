"""The TMCL driver byte for byte: frames of the maker's client, odd bytes, faults; and the virtual modules."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from typing import Any

import pytest

from rig.devices.base import (
    StageAlarm,
    StageError,
    StageOverridden,
    StageRejected,
    StageReset,
    StageTimeout,
)
from rig.devices.registry import KnownBench, StageKind, find
from rig.devices.tmcl_link import (
    END_SEARCH,
    GAP,
    MST,
    MVP,
    RFS,
    SAP,
    SEARCH,
    SEARCH_STATUS,
    VERSION,
    Motor,
    TmclLink,
    TmclReply,
    TmclRequest,
    parse_reply,
    sealed,
)
from sim.devices.clock import VirtualClock
from sim.devices.tmcl import TmclModules, TmclRefusal
from tests.contracts import counted
from tests.contracts.bytes import tmcl as module
from tests.contracts.counted import Bench, ScriptedWire
from tests.contracts.stage import StageBench
from tests.error_codes import raises

X, Z = Motor(1, 0), Motor(1, 1)

# --- frames, as the maker's client sends and reads them ---

SENT = [
    ("01 04 00 00 00 00 C8 00 CD", TmclRequest(X, MVP, 0, 51200)),
    ("01 05 04 00 00 00 01 F4 FF", TmclRequest(X, SAP, 4, 500)),
    ("01 04 01 00 FF FF FF 00 03", TmclRequest(X, MVP, 1, -256)),
    ("01 06 01 00 00 00 00 00 08", TmclRequest(X, GAP, 1)),
    ("01 03 00 00 00 00 00 00 04", TmclRequest(X, MST)),
    ("01 0D 00 00 00 00 00 00 0E", TmclRequest(X, RFS, SEARCH)),
    ("01 0D 01 00 00 00 00 00 0F", TmclRequest(X, RFS, END_SEARCH)),
    ("01 0D 02 00 00 00 00 00 10", TmclRequest(X, RFS, SEARCH_STATUS)),
    ("01 88 00 00 00 00 00 00 89", TmclRequest(X, VERSION)),
]
READ = [
    ("02 01 64 04 00 00 C8 00 33", TmclReply(1, 100, MVP, 51200)),
    ("02 01 64 06 00 00 C7 00 34", TmclReply(1, 100, GAP, 50944)),
    ("02 01 64 03 00 00 00 00 6A", TmclReply(1, 100, MST, 0)),
]


@pytest.mark.parametrize(("frame", "request_"), SENT, ids=[frame for frame, _ in SENT])
def test_a_command_is_the_one_of_the_makers_client(frame: str, request_: TmclRequest) -> None:
    assert request_.frame() == bytes.fromhex(frame)


@pytest.mark.parametrize(("frame", "reply"), READ, ids=[frame for frame, _ in READ])
def test_a_reply_is_read_as_the_maker_means_it(frame: str, reply: TmclReply) -> None:
    assert parse_reply(bytes.fromhex(frame), 2) == reply
    assert parse_reply(bytes.fromhex(frame), 3) is None


def reply_to(frame: bytes, value: int, status: int = 100) -> bytes:
    """The module's reply to a frame."""
    return sealed(bytes([2, frame[0], status, frame[1]]) + value.to_bytes(4, "big", signed=True))


def linked(change: Callable[[int, bytes], list[bytes]] = lambda n, reply: [reply]) -> tuple[ScriptedWire, TmclLink]:
    """A module whose parameter n is 100 n; change: what becomes of its nth reply."""
    clock, said = VirtualClock(0.0, 100.0), list[bytes]()

    def says(frame: bytes) -> list[bytes]:
        if len(frame) != 9:
            return []
        said.append(frame)
        return change(len(said), reply_to(frame, 100 * frame[2] if frame[1] == GAP else 0))

    wire = ScriptedWire(clock, says, 1e-3)
    return wire, TmclLink(wire, clock)


def only(number: int, change: Callable[[bytes], list[bytes]]) -> Callable[[int, bytes], list[bytes]]:
    """Change the reply of this number alone."""
    return lambda n, reply: change(reply) if n == number else [reply]


ODD: dict[str, Callable[[bytes], list[bytes]]] = {
    "lost": lambda reply: [],
    "twice": lambda reply: [reply, reply],
    "three times": lambda reply: [reply] * 3,
    "a stray byte before it": lambda reply: [b"\x02" + reply],
    "stray bytes before it": lambda reply: [b"\xff\x02\x01\x64\x06", reply],
    "in pieces": lambda reply: [reply[:1], reply[1:8], reply[8:]],
    "cut short": lambda reply: [reply[:-1]],
    "a wrong bit": lambda reply: [reply[:6] + bytes([reply[6] ^ 1]) + reply[7:]],
    "of another module": lambda reply: [sealed(b"\x02\x05" + reply[2:8]), reply],
    "after the reply to a stop": lambda reply: [bytes.fromhex("02 01 64 03 00 00 00 00 6A"), reply],
    "refused for its checksum": lambda reply: [sealed(reply[:2] + b"\x01" + reply[3:8])],
}


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("number", [1, 2, 3, 4, 5])
def test_each_parameter_gets_its_own_value_whatever_happens_to_one_reply(number: int, odd: str) -> None:
    """Twice asked for, since a reply too many may come after the last question."""
    _, link = linked(only(number, ODD[odd]))
    for _ in range(2):
        assert link.ask(Z, (1, 3, 4)) == ([100, 300, 400], 0)


def test_a_command_with_a_wrong_checksum_is_refused_at_once_whatever_command_the_module_read() -> None:
    wire, link = linked(only(1, lambda reply: [sealed(reply[:2] + b"\x01\x24" + reply[4:8])]))
    begun_s = wire.clock.monotonic_s()
    with raises(StageRejected, "line_refused", number=1):
        link.command(Z, MVP, 0, 1000)
    assert wire.clock.monotonic_s() - begun_s < 0.1


def test_all_that_still_arrives_after_a_lost_reply_is_discarded() -> None:
    """Here two late refusals, one after the other."""
    clock, lost = VirtualClock(0.0, 100.0), [True]
    wire = ScriptedWire(clock, lambda frame: [] if lost else [reply_to(frame, 0)], 1e-3)
    link = TmclLink(wire, clock)
    with raises(StageTimeout, "no_reply"):
        link.command(Z, SAP, 4, 0)
    refusal = reply_to(TmclRequest(Z, SAP, 4).frame(), 0, 4)
    wire.coming += [(clock.monotonic_s() + after_s, refusal) for after_s in (0.005, 0.02)]
    lost.clear()
    link.command(Z, SAP, 4, 0)


# --- the stage on the virtual modules ---


def commands(bench: Bench) -> list[str]:
    """What was sent, without questions."""
    found = []
    for _, _, data in bench.sent:
        if len(data) == 9 and data[1] not in (GAP, VERSION) and (data[1], data[2]) != (RFS, SEARCH_STATUS):
            value = int.from_bytes(data[4:8], "big", signed=True)
            found.append(f"{data[0]}.{data[3]} {data[1]} {data[2]} {value}")
    return found


bench_of = partial(counted.bench_of, "tmcl")


@pytest.mark.parametrize("number", [0, 1, 3, 4, 10, 11, 207, 208])
def test_a_module_without_one_of_the_parameters_is_refused_when_it_connects(number: int) -> None:
    """Not in the middle of a motion."""
    bench = bench_of(homed=False)
    parameter = bench.devices.z.parameter

    def refuses(which: int) -> int:
        if which == number:
            raise TmclRefusal(3)
        return parameter(which)

    bench.devices.z.parameter = refuses  # type: ignore[method-assign]
    with raises(StageRejected, "line_refused", number=3, line=f"GAP {number}"):
        bench.stage.connect()


def test_a_jog_that_was_stopped_elsewhere_is_disarmed_before_the_next_target() -> None:
    """The target would start the axis at the speed of the jog."""
    bench = bench_of()
    bench.stage.jog("z", -2.0, 2.0)
    bench.clock.wait_s(0.3)
    bench.devices.z.stop()
    bench.clock.wait_s(0.5)
    bench.sent.clear()
    bench.stage.move_to(z_mm=-3.0, speed_mm_s=1.0)
    assert commands(bench) == ["1.1 5 4 0", "1.1 4 0 1200", "1.1 5 4 400", "1.1 5 4 0"]


def test_a_module_that_was_switched_off_is_disarmed_before_the_target_of_a_jog() -> None:
    """Its default speed would start it at once, before the target is read back."""
    bench = bench_of()
    bench.devices.power_cycle()
    with raises(StageReset, "was_reset", expected=0):
        bench.stage.status()
    bench.sent.clear()
    bench.stage.jog("z", -2.0, 0.5)
    assert commands(bench) == ["1.1 5 4 0", "1.1 4 0 800", "1.1 5 4 200"]


@pytest.mark.parametrize("parameter", [0, 4])
def test_a_move_whose_target_or_speed_another_program_changes_is_stopped(parameter: int) -> None:
    """It would go on to the other target, or three times as fast."""
    bench, z = bench_of(), Z.number
    looks = bench.stage.moving(z_mm=-5.0, speed_mm_s=1.0)
    next(looks)
    change = TmclRequest(Z, MVP, 0, 4000) if parameter == 0 else TmclRequest(Z, SAP, 4, 1200)
    bench.lines[0].host_write(change.frame())
    bench.sent.clear()
    with raises(StageOverridden, "overridden") if parameter == 0 else raises(StageReset, "was_reset", found=1200):
        list(looks)
    assert [data[1] for _, _, data in bench.sent if data[3] == z][-1] == MST
    bench.clock.wait_s(0.5)
    assert bench.stands()


def test_a_jog_whose_start_was_not_confirmed_is_no_reset() -> None:
    """The axis moves, at a speed that is not known to be set."""
    bench = counted.bench_of("tmcl")
    line = bench.lines[0]
    write, say = line.host_write, line.device_write

    def writing(data: bytes) -> None:
        armed = data[1:3] == b"\x05\x04" and any(data[4:8])
        line.device_write = (lambda data: None) if armed else say  # type: ignore[method-assign]
        write(data)

    line.host_write = writing  # type: ignore[method-assign]
    with raises(StageTimeout, "no_reply"):
        bench.stage.jog("z", -2.0, 2.0)
    assert bench.stage.status().state == "Run"
    assert bench.stage.homed


def test_an_axis_at_a_limit_switch_can_jog_off_it() -> None:
    bench = StageBench(module.DEVICE)
    bench.wire.instead[b"z GAP 10"] = b"100 1"
    states = {"new": {**module.axis("z"), b"z SAP 4 0": b"100 0"}}
    bench.wire.device = replace(module.DEVICE, states={**module.DEVICE.states, **states})
    bench.stage.jog("z", -0.1, 1.0)
    assert b"z SAP 4 400" in bench.wire.asked


def test_after_a_halt_nothing_can_start_an_axis() -> None:
    bench = bench_of()
    next(bench.stage.moving(z_mm=-10.0, speed_mm_s=5.0))
    bench.stage.halt()
    assert bench.devices.z.parameter(4) == bench.devices.x.parameter(4) == 0


# --- what stops it ---

ACCIDENTS: dict[int, Callable[[TmclModules], object]] = {
    207: lambda board: board.z.stall(),
    208: lambda board: board.z.fail(2),
}


@pytest.mark.parametrize("number", ACCIDENTS)
def test_a_flag_that_a_module_clears_when_it_is_read_stays_until_it_is_unlocked(number: int) -> None:
    bench = bench_of()
    bench.stage.move_to(z_mm=-3.0, speed_mm_s=5.0)
    looks = bench.stage.moving(z_mm=-10.0, speed_mm_s=2.0)
    next(looks)
    ACCIDENTS[number](bench.devices)
    with raises(StageAlarm, "alarm", number=number, axis="z"):
        list(looks)
    assert not bench.stage.homed
    bench.stage.stop()
    assert bench.stage.status().state == "Alarm"
    with raises(StageAlarm, "alarm", number=number):
        bench.stage.home()
    bench.devices.z.driver = 0
    bench.stage.unlock()
    bench.stage.home()
    assert bench.stage.homed


def test_a_switch_that_is_not_wired_and_flags_that_are_not_configured_are_left_alone() -> None:
    own = {"tmcl": {"z": {"motor": 1, "far_switch": False}}}
    bench = bench_of(stage=own)
    bench.stage.move_to(z_mm=-3.0, speed_mm_s=5.0)
    bench.devices.z.pressed.add(10)
    assert bench.stage.status().state == "Idle"
    own = {"tmcl": {"lost_steps_parameter": 0, "fault_parameter": 0}}
    bench = bench_of(stage=own)
    bench.stage.status()
    assert not {207, 208} & {data[2] for _, _, data in bench.sent}


def test_a_unit_of_speed_that_is_wrong_stops_the_first_move() -> None:
    """The module is ten times as fast as the configuration says."""
    bench = bench_of()
    bench.devices.z._motor = replace(bench.devices.z._motor, speed_unit=0.1)
    with raises(StageError, "too_fast", speed_mm_s=1.0, axis="z"):
        bench.stage.move_to(z_mm=-30.0, speed_mm_s=1.0)
    bench.clock.wait_s(2.0)
    assert -bench.devices.z.carriage_at(bench.clock.monotonic_s()) / 400 < 3.5


# --- reference search ---


def counting(bench: StageBench, asked: bytes, says: Callable[[int], bytes | None]) -> list[int]:
    """Let the module reply otherwise to a question, by how often it was asked; the count."""
    write, count = bench.wire.write, [0]

    def writing(data: bytes, port: bytes = b"") -> None:
        if module.heard(data) == asked:
            count[0] += 1
            said = says(count[0])
            if said is None:
                bench.wire.instead.pop(asked, None)
            else:
                bench.wire.instead[asked] = said
        write(data, port)

    bench.wire.write = writing  # type: ignore[method-assign]
    return count


@pytest.mark.parametrize(("parameter", "expected"), [(0, 160), (4, 200)])
def test_a_target_or_a_speed_that_is_read_back_wrong_starts_nothing_more(parameter: int, expected: int) -> None:
    """The axis may move already, so it is stopped."""
    bench = StageBench(module.DEVICE, homed=True)
    asked = f"z GAP {parameter}".encode("ascii")
    looks = bench.stage.moving(**module.DEVICE.move)
    before = 1  # the status before the move
    counting(bench, asked, lambda n: b"100 900" if n == before + 1 else None)
    fields = {"axis": "z", "parameter": parameter, "found": 900, "expected": expected}
    with raises(StageError, "not_as_configured", **fields):
        next(looks)
    assert b"z MST 0" in bench.wire.asked


@pytest.mark.parametrize(("asked", "moves"), [(b"z GAP 3", b"100 5"), (b"z RFS 2", b"100 1")])
def test_an_axis_that_moves_at_the_look_after_a_stop_is_stopped_again(asked: bytes, moves: bytes) -> None:
    bench = StageBench(module.DEVICE, homed=True)
    counting(bench, asked, lambda n: moves if n == 1 else None)
    bench.stage.stop()
    assert bench.wire.asked.count(b"z MST 0") == 3
    assert (b"z RFS 1" in bench.wire.asked) is (asked == b"z RFS 2")


@pytest.mark.parametrize("name", ["x", "z"])
def test_homing_begins_where_no_axis_has_a_flag_and_none_can_move(name: str) -> None:
    bench = StageBench(module.DEVICE)
    bench.stage.home()
    search = bench.wire.asked.index(b"z RFS 0")
    assert {b"x SAP 4 0", b"z SAP 4 0"} <= {*bench.wire.asked[:search]}
    bench = StageBench(module.DEVICE)
    bench.wire.instead[f"{name} GAP 208".encode()] = b"100 2"
    with raises(StageAlarm, "alarm", number=208, axis=name):
        bench.stage.home()
    assert b"z RFS 0" not in bench.wire.asked


@pytest.mark.parametrize("host", [2, 3])
def test_a_module_replies_to_its_host_alone(host: int) -> None:
    bench = StageBench(module.DEVICE, connected=False)
    settings = KnownBench.model_validate({"stage": {"kind": "tmcl", "tmcl": {"host_address": host}}})
    found = find(StageKind, "tmcl")
    assert found.probe is not None
    assert (found.probe(bench.wire.at, bench.clock, settings) is not None) is (host == 2)
    with nullcontext() if host == 2 else raises(StageError, "garbled"):
        find(StageKind, "tmcl").driver(bench.wire.at, bench.clock, settings).connect()


def test_another_axis_that_moves_by_itself_ends_homing_and_is_stopped() -> None:
    bench = bench_of(homed=False)
    search = bench.devices.z.search
    z: Any = bench.devices.z

    def both() -> None:
        search()
        bench.devices.x.rotate(400)

    z.search = both
    with raises(StageError, "moves", axis="x"):
        bench.stage.home()
    assert commands(bench)[-2:] == ["1.1 3 0 0", "1.0 3 0 0"]
    bench.clock.wait_s(1.0)
    assert not bench.devices.x.busy
    assert not bench.stage.homed


def test_a_stop_ends_a_search_too() -> None:
    bench = bench_of(homed=False)
    next(bench.stage.homing())
    assert bench.devices.z.busy
    bench.stage.stop()
    assert not bench.devices.z.searching
    assert bench.stands()


# --- stop ---


def test_a_stop_goes_to_z_at_once_then_to_x_and_is_confirmed() -> None:
    bench = bench_of()
    next(bench.stage.moving(z_mm=-10.0, speed_mm_s=5.0))
    bench.sent.clear()
    asked_s = bench.clock.monotonic_s()
    bench.stage.stop()
    assert bench.sent[0] == (asked_s, "z", TmclRequest(Z, MST).frame())
    assert bench.sent[1] == (pytest.approx(asked_s + 2e-3 + 180 / 115200), "z", TmclRequest(X, MST).frame())
    assert not bench.stage.homed
    assert bench.stands()


@pytest.mark.parametrize("pause_s", [0.02, float("inf")], ids=["drops parts", "waits for ever"])
@pytest.mark.parametrize("what", ["a question", "a stop"])
def test_a_byte_that_is_lost_on_its_way_to_a_module_does_not_lock_it_out(pause_s: float, what: str) -> None:
    """Also where the module waits for the end of the frame for ever."""
    bench = bench_of()
    next(bench.stage.moving(z_mm=-20.0, speed_mm_s=1.0))
    bench.devices.heard.forgets_s = pause_s
    hear, lost = bench.devices._hear, [4]
    bench.devices._line.connect(lambda data: hear(data[1:] if lost and lost.pop() else data))
    if what == "a stop":
        bench.stage.stop()
        assert not bench.devices.z.busy
    else:
        assert bench.stage.status().state == "Run"
