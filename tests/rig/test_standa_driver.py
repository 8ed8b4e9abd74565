"""The Standa driver byte for byte: frames of the maker's library, alarms, retries; and the virtual controllers."""

import struct
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from typing import Any

import pytest

from rig.devices.base import StageAlarm, StageError
from rig.devices.registry import KnownBench, StageKind, find
from rig.devices.standa_link import (
    MOVE,
    RESERVED,
    SERIAL,
    SPEED,
    ZEROS,
    StandaLink,
    frame,
)
from rig.transport import LoopbackTransport
from sim.devices.clock import VirtualClock
from sim.devices.standa import VirtualStandaController
from tests.contracts import counted
from tests.contracts.bytes import standa as controller
from tests.contracts.counted import Bench, ScriptedWire
from tests.contracts.stage import StageBench
from tests.error_codes import raises

# --- frames, as the maker's library sends and reads them ---

SENT = {
    "move": (MOVE.pack(1000, 128, 6 * RESERVED), "6D 6F 76 65 E8 03 00 00 80 00 CC CC CC CC CC CC AB E1"),
    "smov": (
        SPEED.pack(0x1234, 7, 0x222, 0x333, 0, 0, 0, 9 * RESERVED),
        "73 6D 6F 76 34 12 00 00 07 22 02 33 03 00 00 00 00 00 00 CC CC CC CC CC CC CC CC CC E4 3D",
    ),
    "stop": (b"", "73 74 6F 70"),
    "gets": (b"", "67 65 74 73"),
}


@pytest.mark.parametrize("letters", SENT)
def test_a_command_is_the_one_of_the_makers_library(letters: str) -> None:
    payload, sent = SENT[letters]
    assert frame(letters, payload) == bytes.fromhex(sent)


BUSY = [
    ("B", 4, 1, True), ("B", 4, 0xFE, False), ("B", 5, 0x80, True), ("B", 5, 0x7F, False), ("<i", 23, 1, True),
    ("<i", 23, -1, True), ("<h", 27, 1, True), ("<h", 27, -1, True), ("B", 6, 4, False), ("<i", 9, 1, False),
]  # fmt: skip


@pytest.mark.parametrize(("layout", "offset", "value", "busy"), BUSY)
def test_a_controller_is_busy_while_a_command_runs_or_the_motor_turns(
    layout: str, offset: int, value: int, busy: bool
) -> None:
    """Its flag of motion, its command, its speed in full steps and microsteps."""
    data = bytearray(54)
    struct.pack_into(layout, data, offset, value)
    _, link = linked([frame("gets", bytes(data[4:52]))])
    assert link.status().busy is busy


def linked(*replies: list[bytes]) -> tuple[ScriptedWire, StandaLink]:
    """A link at whose far end the writes get these bytes in turn, and then nothing; zero bytes are returned."""
    clock, left = VirtualClock(0.0, 100.0), list(replies)
    wire = ScriptedWire(clock, lambda data: [data] if data == ZEROS else left.pop(0) if left else [])
    return wire, StandaLink(wire, clock)


ANSWER = frame("gser", SERIAL.pack(4711))


def test_what_came_before_is_not_the_reply() -> None:
    """An older reply, zero bytes, the confirmation of a stop; then the reply in two pieces."""
    wire, link = linked([bytes(7), b"stop", ANSWER[:5], ANSWER[5:]])
    wire.coming = [(0.0, frame("gser", SERIAL.pack(1))), (0.0, b"stop")]
    assert link.ask("gser", SERIAL) == (4711,)
    assert wire.sent == [b"gser"]


@pytest.mark.parametrize(
    "first", [[], [ANSWER[:9]], [ANSWER[:-1] + b"x"]], ids=["lost", "cut short", "a wrong checksum"]
)
def test_zero_bytes_clear_the_line_after_a_reply_that_was_lost_or_garbled(first: list[bytes]) -> None:
    wire, link = linked(first, [ANSWER])
    assert link.ask("gser", SERIAL) == (4711,)
    assert wire.sent == [b"gser", ZEROS, b"gser"]


# --- the stage on the virtual controllers ---


def letters(bench: Bench, axis: str) -> list[str]:
    """The commands that one controller got."""
    return [data[:4].decode("latin-1") for _, to, data in bench.sent if to == axis]


bench_of = partial(counted.bench_of, "standa")


def _changed(name: str, layout: str, place: int, value: int) -> Callable[[VirtualStandaController], None]:
    def change(controller: VirtualStandaController) -> None:
        fields = list(struct.unpack(layout, controller.settings[name]))
        fields[place] = value
        controller.settings[name] = struct.pack(layout, *fields)

    return change


ENGINE, SPEEDS, HOMING = "<HHIBHhBH12x", "<IBHHIBB9x", "<IBIBihH9x"


@pytest.mark.parametrize("mode", range(11))
def test_a_mode_of_the_motor_is_that_of_its_microsteps(mode: int) -> None:
    """1 is full steps, 9 is 256 microsteps; 0 and 10 are none."""
    microsteps = 2 ** (mode - 1) if 1 <= mode <= 9 else 0
    bench = bench_of(homed=False, stage={"standa": {"z": {"microsteps": microsteps or 256}}})
    assert bench.stage.connect()
    if not microsteps:
        _changed("eng", ENGINE, 6, mode)(bench.devices.z)
        with raises(StageError, "not_as_configured", setting="MicrostepMode", found=0, expected=256):
            bench.stage.connect()


@pytest.mark.parametrize("serial", [10003, 10001])
def test_another_controller_is_refused(serial: int) -> None:
    """Ports that have changed places, so that z's commands would move x: 10003 is z's."""
    bench = bench_of(homed=False, stage={"standa": {"z": {"serial": serial}}}, connected=serial == 10003)
    if serial == 10003:
        assert bench.stage.connect()
        return
    with raises(StageError, "not_as_configured", setting="serial number", axis="z", found=10003, expected=10001):
        bench.stage.connect()


def test_a_port_on_which_half_a_command_stands_is_asked_after_the_controller_has_forgotten_it() -> None:
    """As the bytes of another probe are; a silent one is asked twice."""
    bench = bench_of(homed=False)
    line = bench.lines[0]
    found = find(StageKind, "standa")
    assert found.probe is not None
    settings = KnownBench.model_validate({"stage": {"kind": "standa"}})
    line.host_write(frame("move", MOVE.pack(9, 9, 6 * RESERVED))[:7])
    begun_s = bench.clock.monotonic_s()
    assert str(found.probe(lambda port: LoopbackTransport(line, bench.clock), bench.clock, settings)).endswith(
        "10003"
    )
    assert bench.clock.monotonic_s() - begun_s < 0.6, "the first question is answered"
    silent = StageBench(controller.DEVICE, connected=False)
    silent.wire.silent = True
    assert found.probe(silent.wire.at, silent.clock, settings) is None
    assert silent.wire.asked == [b"z gser", b"z gser"]


def test_two_names_of_one_controller_are_refused() -> None:
    bench = bench_of(homed=False)
    bench.stage._axes["x"].link = bench.stage._axes["z"].link  # type: ignore[attr-defined]
    with raises(StageError, "one_controller_for_two", serial=10003):
        bench.stage.connect()


@pytest.mark.parametrize(
    ("port", "serial", "refused"),
    [
        ("/dev/ttyACM0", None, True), ("/dev/ttyUSB12", None, True), ("/dev/ttyACM0", 10003, False),
        ("/dev/serial/by-id/usb-XIMC_00001234-if00", None, False), ("tcp://10.0.0.7:1820", None, False),
        ("COM3", None, False),
    ],
)  # fmt: skip
def test_a_port_whose_name_may_change_needs_a_serial_number(port: str, serial: int | None, refused: bool) -> None:
    bench = bench_of(homed=False, stage={"standa": {"z": {"serial": serial}}})
    bench.stage._axes["z"].link.name = port  # type: ignore[attr-defined]
    with raises(StageError, "port_may_change", port=port, axis="z", serial=10003) if refused else nullcontext():
        bench.stage.connect()


def test_homing_that_goes_far_back_from_the_switch_is_stopped() -> None:
    """HomeDelta of 50 mm would go through the finger: 10 mm, and a stop."""
    bench = bench_of(homed=False)
    per_mm = abs(bench.stage.steps_per_mm("z"))
    _changed("hom", HOMING, 4, 5000)(bench.devices.z)
    with raises(StageError, "homes_the_wrong_way", axis="z"):
        bench.stage.home()
    bench.clock.wait_s(1.0)
    assert -10.0 < bench.devices.z.carriage_at(bench.clock.monotonic_s()) / per_mm < -9.0


def test_nothing_but_speed_and_zero_is_ever_written() -> None:
    """All else is kept by the controller, whose owner has set it."""
    bench = bench_of(homed=False)
    stored = [dict(one.settings) for one in (bench.devices.x, bench.devices.z)]
    bench.stage.home()
    bench.stage.move_to(z_mm=-2.0, speed_mm_s=2.0)
    bench.stage.stop()
    bench.stage.unlock()
    for one, before in zip((bench.devices.x, bench.devices.z), stored, strict=True):
        assert {name for name in before if one.settings[name] != before[name]} <= {"mov"}
        assert struct.unpack(SPEEDS, one.settings["mov"])[2:] == struct.unpack(SPEEDS, before["mov"])[2:]
    assert not {"save", "sars", "eesv"} & {*letters(bench, "x"), *letters(bench, "z")}


# --- what stops it ---

ALARMS = [(0, "ALARM"), (0x80, "ALARM CTP_ERROR"), (0x40000, "ALARM 40000 hex")]
HARMLESS = (0, 1, 2, 4, 5)
"""Bits of the flags of a status that are no alarm: protocol.xi."""


def under_way(bench: Bench) -> Iterator[Any]:
    """A move that has been looked at once."""
    looks = bench.stage.moving(z_mm=-10.0, speed_mm_s=2.0)
    next(looks)
    return looks


def test_a_stop_clears_the_alarm_of_the_controller_but_not_ours() -> None:
    """Only `unlock` does; until then nothing moves or homes."""
    bench, word = bench_of(), "ALARM CTP_ERROR"
    looks = under_way(bench)
    bench.devices.z.fail(0x80)
    with raises(StageAlarm, "alarm", number=word, axis="z"):
        list(looks)
    bench.stage.stop()
    assert not bench.devices.z.flags & 0x40, "the controller has forgotten it"
    bench.sent.clear()
    for act in (bench.stage.home, lambda: bench.stage.jog("z", 0.1, 1.0)):
        with raises(StageAlarm, "alarm", number=word, axis="z"):
            act()
    assert bench.stage.status().state == "Alarm"
    bench.stage.halt()
    assert not {"home", "move", "movr"} & {*letters(bench, "x"), *letters(bench, "z")}
    bench.stage.unlock()
    bench.stage.home()
    assert bench.stage.homed


@pytest.mark.parametrize(("home", "edge", "word"), [("left", 1, "RIGHT_EDGE"), ("right", 2, "LEFT_EDGE")])
def test_a_limit_switch_within_the_travel_is_an_alarm(home: str, edge: int, word: str) -> None:
    """Until it is unlocked, though the switch is free again. That of home is none."""
    bench = bench_of(stage={"standa": {"z": {"home": home}}})
    bench.devices.z.inputs = edge ^ 3
    looks = under_way(bench)
    bench.devices.z.inputs = edge
    with raises(StageAlarm, "alarm", number=word, axis="z"):
        list(looks)
    assert not bench.stage.homed
    bench.devices.z.inputs = 0
    bench.stage.stop()
    for act in (bench.stage.home, lambda: bench.stage.jog("z", 0.1, 1.0)):
        with raises(StageAlarm, "alarm", number=word, axis="z"):
            act()
    bench.stage.unlock()
    bench.stage.home()
    assert bench.stage.homed


@pytest.mark.parametrize("times", [1, 2])
def test_a_move_that_the_controller_calls_failed_is_no_arrival(times: int) -> None:
    """It shows so once, which may be an old reply, or always."""
    bench = StageBench(controller.DEVICE, homed=True)
    there, failed = (
        controller.status(command, 250, controller.HOMED) for command in (controller.MOVE, 0x40 | controller.MOVE)
    )
    states = {"arrived": {b"z gets": (failed, "there") if times == 1 else failed}, "there": {b"z gets": there}}
    bench.wire.device = replace(controller.DEVICE, states={**controller.DEVICE.states, **states})
    looks = bench.under_way()
    bench.wire.state = "arrived"
    with raises(StageError, "not_there", at_mm=-2.5) if times == 2 else nullcontext():
        list(looks)


# --- stop ---


def test_a_stop_goes_to_both_controllers_at_one_instant_and_is_confirmed() -> None:
    bench = bench_of()
    next(bench.stage.moving(z_mm=-10.0, speed_mm_s=5.0))
    bench.sent.clear()
    asked_s = bench.clock.monotonic_s()
    bench.stage.stop()
    assert bench.sent[:2] == [(asked_s, "z", b"stop"), (asked_s, "x", b"stop")]
    assert [letters(bench, axis).count("stop") for axis in "xz"] == [1, 1]
    assert not bench.stage.homed
    assert bench.stands()


@pytest.mark.parametrize(
    "damage",
    [lambda data: b"", lambda data: data[:3], lambda data: b"stoq", lambda data: data[1:], lambda data: data * 2],
    ids=["lost", "cut", "changed", "late begun", "twice"],
)
def test_a_stop_that_does_not_get_through_is_repeated(damage: Callable[[bytes], bytes]) -> None:
    bench = bench_of()
    next(bench.stage.moving(z_mm=-30.0, speed_mm_s=5.0))
    write, left = bench.lines[0].host_write, [1]

    def damaged(data: bytes) -> None:
        hit = data == b"stop" and bool(left)
        write(damage(data) if hit and left.pop() else data)

    bench.lines[0].host_write = damaged  # type: ignore[method-assign]
    asked_s = bench.clock.monotonic_s()
    bench.stage.stop()
    assert bench.clock.monotonic_s() - asked_s < 0.5
    assert not bench.devices.z.busy
