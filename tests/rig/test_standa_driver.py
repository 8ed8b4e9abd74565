"""The Standa driver byte for byte: frames of the maker's library, alarms, retries; and the virtual controllers."""

import random
import struct
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import pytest

from rig.bench.virtual import stage_opener, virtual_stage
from rig.devices.base import Stage, StageAlarm, StageError, StageHeld, StageOverridden, StageReset, StageTimeout
from rig.devices.make_drivers import stage_driver
from rig.devices.registry import KnownBench, StageKind, find
from rig.devices.standa_link import (
    MOVE,
    RESERVED,
    SERIAL,
    SPEED,
    STATUS,
    ZEROS,
    StandaLink,
    frame,
)
from rig.plan.config import Config
from rig.transport import LoopbackTransport
from sim.devices.clock import VirtualClock
from sim.devices.leadshine import DriveAxis
from sim.devices.line import SerialLine
from sim.devices.standa import StandaPair, VirtualStandaController
from tests.contracts.bytes import standa as controller
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


def test_an_empty_status_ends_with_the_crc_of_the_makers_library() -> None:
    assert frame("gets", bytes(48))[-2:] == bytes.fromhex("55 FF")


OFFSETS = [
    ("command", "B", 5, 0x86), ("power", "B", 6, 4), ("steps", "<i", 9, -70000), ("microsteps", "<h", 13, -255),
    ("flags", "<I", 39, 0x01A00040), ("inputs", "<I", 43, 2),
]  # fmt: skip


def test_the_fields_of_a_status_are_where_the_maker_has_them() -> None:
    data = bytearray(54)
    for _, layout, offset, value in OFFSETS:
        struct.pack_into(layout, data, offset, value)
    _, link = linked([frame("gets", bytes(data[4:52]))])
    found = link.status()
    assert [getattr(found, name) for name, *_ in OFFSETS] == [value for *_, value in OFFSETS]
    assert STATUS.size + 6 == 54


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


class Wire:
    """A wire whose far end says, to each write, what the test wants."""

    name = "wire"

    def __init__(self, clock: VirtualClock, says: Callable[[bytes], list[bytes]]) -> None:
        self.clock, self.says = clock, says
        self.sent: list[bytes] = []
        self.coming: list[bytes] = []
        self.reads_at_once = 0

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        self.coming += self.says(data)

    def read(self, timeout_s: float) -> bytes:
        self.reads_at_once += not timeout_s
        if not self.coming:
            self.clock.wait_s(timeout_s)
        return self.coming.pop(0) if self.coming else b""

    def close(self) -> None:
        pass


def linked(*replies: list[bytes]) -> tuple[Wire, StandaLink]:
    """A link at whose far end the writes get these bytes in turn, and then nothing; zero bytes are returned."""
    clock, left = VirtualClock(0.0, 100.0), list(replies)
    wire = Wire(clock, lambda data: [data] if data == ZEROS else left.pop(0) if left else [])
    return wire, StandaLink(wire, clock)


ANSWER = frame("gser", SERIAL.pack(4711))


def test_what_came_before_is_not_the_reply() -> None:
    """An older reply, zero bytes, the confirmation of a stop; then the reply in two pieces."""
    wire, link = linked([bytes(7), b"stop", ANSWER[:5], ANSWER[5:]])
    wire.coming = [frame("gser", SERIAL.pack(1)), b"stop"]
    assert link.ask("gser", SERIAL) == (4711,)
    assert wire.sent == [b"gser"]


def test_a_question_is_repeated_after_zero_bytes_and_a_command_is_not() -> None:
    wire, link = linked([ANSWER[:-1]], [], [ANSWER])
    assert link.ask("gser", SERIAL) == (4711,)
    assert wire.sent == [b"gser", ZEROS, b"gser", ZEROS, b"gser"]
    assert wire.reads_at_once == 3, "a line on which nothing is left is read once before a question"
    wire, link = linked()
    begun_s = wire.clock.monotonic_s()
    with raises(StageTimeout, "no_reply", port="wire", command="home", timeout_s=0.2):
        link.command("home")
    assert wire.clock.monotonic_s() - begun_s == pytest.approx(0.2)
    assert wire.sent == [b"home"]


@pytest.mark.parametrize(
    ("returned", "sends", "takes_s"),
    [
        ([[]], 3, 0.3), ([[bytes(10)]], 1, 0.02), ([[bytes(10), bytes(54)]], 1, 0.0), ([[b"mo", bytes(9)]], 1, 0.02),
        ([[], [bytes(64)]], 2, 0.1), ([[b"xy"], [], [bytes(1)]], 3, 0.22),
    ],
)  # fmt: skip
def test_zero_bytes_are_sent_up_to_three_times_until_some_come_back(
    returned: list[list[bytes]], sends: int, takes_s: float
) -> None:
    """A tenth of a second each; what the controller still needed of them ends a command that was cut short."""
    clock, left = VirtualClock(0.0, 100.0), list(returned)
    wire = Wire(clock, lambda data: (left.pop(0) if left else []) if data == ZEROS else [])
    link = StandaLink(wire, clock)
    with raises(StageTimeout, "no_reply", timeout_s=0.2):
        link.command("home")
    begun_s = clock.monotonic_s()
    with raises(StageTimeout, "no_reply", command="sstp", timeout_s=0.3 if takes_s == 0.3 else 0.2):
        link.command("sstp")
    lasted_s = takes_s + (0.0 if takes_s == 0.3 else 0.2)
    assert clock.monotonic_s() - begun_s == pytest.approx(lasted_s)
    assert wire.sent == [b"home", *sends * [ZEROS], *([b"sstp"] if takes_s != 0.3 else [])]


def test_a_reply_with_a_wrong_checksum_is_an_error_at_once() -> None:
    wire, link = linked([ANSWER[:-1] + bytes([ANSWER[-1] ^ 1])])
    with raises(StageError, "garbled", command="gser"):
        link.ask("gser", SERIAL, tries=1)
    assert wire.clock.monotonic_s() == 100.0


def test_of_a_garbled_reply_sixteen_bytes_are_shown() -> None:
    _, link = linked([bytes(range(1, 60))])
    with raises(StageError, "garbled", heard=bytes(range(1, 17)).hex(" ")):
        link.command("home")


@pytest.mark.parametrize("word", ["errc", "errd", "errv"])
def test_an_error_answer_has_the_makers_word(word: str) -> None:
    wire, link = linked([word.encode("ascii")])
    with raises(StageError, "line_refused", number=word, line="home", port="wire"):
        link.command("home")
    assert wire.sent == [b"home"]


def test_a_controller_that_never_stops_talking_is_an_error() -> None:
    clock = VirtualClock(0.0, 100.0)
    wire = Wire(clock, lambda data: [])

    def chatter(timeout_s: float) -> bytes:
        clock.wait_s(0.01)
        return b"xyz"

    wire.read = chatter  # type: ignore[method-assign]
    with pytest.raises(StageError) as caught:
        StandaLink(wire, clock).ask("gser", SERIAL)
    assert caught.value.code in ("garbled", "no_reply")
    most_s = 3 * (0.2 + 3 * 0.1 + 1.1)
    assert clock.monotonic_s() - 100.0 < most_s


def test_a_thousand_odd_replies_are_errors_of_the_stage_and_nothing_else() -> None:
    """Random bytes, and replies with a byte changed: what is believed is the reply itself."""
    chance = random.Random(0)
    payload = bytes(chance.randrange(256) for _ in range(STATUS.size))
    true = frame("gets", payload)
    for _ in range(1000):
        odd = bytearray(true)
        if chance.random() < 0.5:
            odd[chance.randrange(len(odd))] = chance.randrange(256)
        else:
            odd = bytearray(chance.randbytes(chance.randrange(1, 80)))
        _, link = linked([bytes(odd)])
        try:
            found = link.ask("gets", STATUS, tries=1)
        except StageError:
            continue
        assert found == STATUS.unpack(payload)


def test_a_thousand_odd_bytes_leave_the_virtual_controller_at_rest() -> None:
    """Also frames of which a byte is changed: it answers afterwards and has not moved."""
    chance, bench = random.Random(1), bench_of()
    sent = [frame(letters, payload) for letters, (payload, _) in SENT.items()]
    sent += [frame("movr", MOVE.pack(5, 0, 6 * RESERVED))]
    line, before = bench.lines[0], bench.pair.carriage_steps_at(bench.clock.monotonic_s())
    for _ in range(1000):
        odd = bytearray(chance.choice(sent))
        if chance.random() < 0.5:
            odd[chance.randrange(len(odd))] ^= 1 << chance.randrange(8)
        else:
            odd = bytearray(chance.randbytes(chance.randrange(1, 40)))
        line.host_write(bytes(odd))
        bench.clock.wait_s(0.5)
        line.host_read()
    assert bench.pair.carriage_steps_at(bench.clock.monotonic_s()) == before
    assert bench.stage.status().state == "Idle"


# --- the stage on the virtual controllers ---


@dataclass
class Bench:
    """Driver and controllers on two lines."""

    clock: VirtualClock
    pair: StandaPair
    stage: Stage
    lines: tuple[SerialLine, ...]
    sent: list[tuple[float, str, bytes]]

    def letters(self, axis: str) -> list[str]:
        """The commands that one controller got."""
        return [data[:4].decode("latin-1") for _, to, data in self.sent if to == axis]


def bench_of(*, homed: bool = True, connected: bool = True, **tables: Any) -> Bench:
    """A bench, homed."""
    config = Config.model_validate({"stage": {"kind": "standa", **tables.pop("stage", {})}, **tables})
    clock = VirtualClock(1.7e9, 50.0)
    line, sent = SerialLine(clock, config.stage.baud), list[tuple[float, str, bytes]]()
    pair: Any = virtual_stage(clock, line, config)

    def noted(one: SerialLine, name: str) -> LoopbackTransport:
        wire, axis = LoopbackTransport(one, clock, "wire"), "z" if one is line else "x"
        write = wire.write

        def writing(data: bytes) -> None:
            sent.append((clock.monotonic_s(), axis, data))
            write(data)

        wire.write = writing  # type: ignore[method-assign]
        return wire

    stage: Stage = stage_driver(stage_opener(config, line, noted), clock, config)
    if connected:
        stage.connect()
    if homed:
        for axis in (pair.x, pair.z):
            start = -round(NEAR_MM * 2 * axis._beyond)
            axis._axis, axis._zero = DriveAxis(start), start
            axis._home = partial(_home, axis)
        stage.home()
        del pair.x._home, pair.z._home
    sent.clear()
    return Bench(clock, pair, stage, (line, *line.further), sent)


NEAR_MM = 0.05
"""So far from home an axis of a homed bench begins, so that its test spends little time on the way."""


def _home(axis: Any) -> None:
    axis._homing, axis.flags = True, axis.flags & ~0x20
    axis._go([(0.0, 2 * axis._beyond)], [60000, 60000])


def test_a_move_has_its_speed_and_the_ramp_of_the_controller() -> None:
    """10 mm at 2 mm/s; 6000 full steps/s² of 10 µm."""
    bench = bench_of()
    begun_s = bench.clock.monotonic_s()
    bench.stage.move_to(z_mm=-10.0, speed_mm_s=2.0)
    assert bench.clock.monotonic_s() - begun_s == pytest.approx(10 / 2 + 2 / 60, abs=0.05)
    assert [data for _, _, data in bench.sent if data[:4] in (b"smov", b"move")] == [
        frame("smov", SPEED.pack(200, 0, 6000, 6000, 0, 0, 0, 9 * RESERVED)),
        frame("move", MOVE.pack(1000, 0, 6 * RESERVED)),
    ]


def _changed(name: str, layout: str, place: int, value: int) -> Callable[[VirtualStandaController], None]:
    def change(controller: VirtualStandaController) -> None:
        fields = list(struct.unpack(layout, controller.settings[name]))
        fields[place] = value
        controller.settings[name] = struct.pack(layout, *fields)

    return change


ENGINE, SPEEDS, HOMING = "<HHIBHhBH12x", "<IBHHIBB9x", "<IBIBihH9x"
EDGES, POWER = "<BBihih6x", "<BHHHB6x"
OTHERWISE = [
    (_changed("eng", ENGINE, 6, 8), "MicrostepMode"),
    (_changed("eng", ENGINE, 4, 0), "ENGINE_ACCEL_ON"),
    (_changed("eng", ENGINE, 4, 0x18), "ENGINE_ANTIPLAY"),
    (_changed("eds", EDGES, 0, 2), "BORDER_STOP_LEFT and _RIGHT"),
    (_changed("eds", EDGES, 0, 7), "BORDER_IS_ENCODER"),
    (_changed("hom", HOMING, 6, 0x31), "HOME_DIR_FIRST"),
    (_changed("hom", HOMING, 6, 0x10), "HOME_STOP_FIRST_BITS"),
    (_changed("pwr", POWER, 4, 2), "POWER_OFF_ENABLED"),
    *((_changed("eng", ENGINE, 4, bits), "ENGINE_ACCEL_ON") for bits in (0xFFE7, 0xFFEF)),
    (_changed("eng", ENGINE, 4, 0xFFFF), "ENGINE_ANTIPLAY"),
    *((_changed("eds", EDGES, 0, bits), "BORDER_STOP_LEFT and _RIGHT") for bits in (4, 0, 0xF8, 0xFA, 0xFC)),
    (_changed("eds", EDGES, 0, 0xFF), "BORDER_IS_ENCODER"),
    (_changed("hom", HOMING, 6, 0xFFFF), "HOME_DIR_FIRST"),
    *((_changed("hom", HOMING, 6, bits), "HOME_STOP_FIRST_BITS") for bits in (0x20, 0, 0xFFCE, 0xFFDE, 0xFFEE)),
    (_changed("pwr", POWER, 4, 0xFF), "POWER_OFF_ENABLED"),
    (_changed("mov", SPEEDS, 2, 4000), "Accel"),
    (_changed("mov", SPEEDS, 3, 4000), "Decel"),
]


@pytest.mark.parametrize(
    ("change", "setting"), OTHERWISE, ids=[f"{setting}-{n}" for n, (_, setting) in enumerate(OTHERWISE)]
)
def test_a_controller_that_is_set_otherwise_is_refused(
    change: Callable[[VirtualStandaController], None], setting: str
) -> None:
    bench = bench_of(homed=False)
    fresh = bench_of(homed=False)
    change(bench.pair.z)
    with raises(StageError, "not_as_configured", setting=setting, port="wire", axis="z"):
        bench.stage.connect()
    assert fresh.stage.connect()


def test_what_else_a_controller_is_set_to_is_its_owners() -> None:
    """Every bit but those that the driver relies on."""
    bench = bench_of(homed=False)
    for name, layout, place, bits in (
        ("eng", ENGINE, 4, 0xFFF7),
        ("eds", EDGES, 0, 0xFE),
        ("hom", HOMING, 6, 0xFFFE),
        ("pwr", POWER, 4, 0xFD),
    ):
        _changed(name, layout, place, bits)(bench.pair.z)
    assert bench.stage.connect()


@pytest.mark.parametrize("mode", range(11))
def test_a_mode_of_the_motor_is_that_of_its_microsteps(mode: int) -> None:
    """1 is full steps, 9 is 256 microsteps; 0 and 10 are none."""
    microsteps = 2 ** (mode - 1) if 1 <= mode <= 9 else 0
    bench = bench_of(homed=False, stage={"standa": {"z": {"microsteps": microsteps or 256}}})
    assert bench.stage.connect()
    if not microsteps:
        _changed("eng", ENGINE, 6, mode)(bench.pair.z)
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
    bench.stage._axes["x"]._link = bench.stage._axes["z"]._link  # type: ignore[attr-defined]
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
    bench.stage._axes["z"]._link.name = port  # type: ignore[attr-defined]
    with raises(StageError, "port_may_change", port=port, axis="z", serial=10003) if refused else nullcontext():
        bench.stage.connect()


@pytest.mark.parametrize(("start_mm", "inputs"), [(-10.0, 0), (-0.2, 0), (-10.0, 1)])
def test_homing_that_goes_the_wrong_way_is_stopped(start_mm: float, inputs: int) -> None:
    """A millimeter, and as far as the stage needs to stop, whatever it was told; also where the other switch is."""
    bench = bench_of()
    bench.stage.move_to(z_mm=start_mm, speed_mm_s=5.0)
    z: Any = bench.pair.z
    z.inputs = inputs
    z._home = lambda: z._go([(z._lowest, 5.0 * abs(bench.stage.steps_per_mm("z")))], [60000, 60000])
    before = z.carriage_at(bench.clock.monotonic_s())
    with raises(StageError, "homes_the_wrong_way", axis="z"):
        bench.stage.home()
    bench.clock.wait_s(1.0)
    gone_mm = (before - z.carriage_at(bench.clock.monotonic_s())) / abs(bench.stage.steps_per_mm("z"))
    assert 1.0 < gone_mm < 1.3
    assert not bench.stage.homed


def test_homing_that_goes_far_back_from_the_switch_is_stopped() -> None:
    """HomeDelta of 50 mm would go through the finger: 10 mm, and a stop."""
    bench = bench_of(homed=False)
    per_mm = abs(bench.stage.steps_per_mm("z"))
    _changed("hom", HOMING, 4, 5000)(bench.pair.z)
    with raises(StageError, "homes_the_wrong_way", axis="z"):
        bench.stage.home()
    bench.clock.wait_s(1.0)
    assert -10.0 < bench.pair.z.carriage_at(bench.clock.monotonic_s()) / per_mm < -9.0


TURNS = b"gets\x01" + controller.status(controller.HOME, 50, controller.HOMED)[5:]
NOT_HOMED: dict[str, tuple[str, bytes | tuple[bytes, str]]] = {
    "turning again": ("z is home", (controller.status(controller.HOME, 50, controller.HOMED), "turns again")),
    "failed": ("z is home", controller.status(controller.HOME | 0x40, 50, controller.HOMED)),
    "ended by another command": ("z is home", controller.status(controller.SSTP, 50, controller.HOMED)),
    "without its flag": ("z is home", controller.status(controller.HOME, 50, 0)),
    "with all flags but its own": ("z is home", controller.status(controller.HOME, 50, 0x17)),
    "a step from the zero": ("z is zero", controller.status(controller.HOME, 1, controller.HOMED)),
    "a microstep from the zero": ("z is zero", controller.status(controller.HOME, 0, controller.HOMED, 1)),
    "with all flags but its own after the zero": ("z is zero", controller.status(controller.HOME, 0, 0x17)),
    "without its flag after the zero": ("z is zero", controller.status(controller.HOME, 0, 0)),
}


@pytest.mark.parametrize("how", NOT_HOMED)
def test_homing_that_ends_otherwise_than_at_home_is_no_homing(how: str) -> None:
    state, said = NOT_HOMED[how]
    states = {**controller.DEVICE.states, state: {**controller.DEVICE.states[state], b"z gets": said}}
    states["turns again"] = {**states["z is home"], b"z gets": TURNS}
    bench = StageBench(replace(controller.DEVICE, states=states))
    with raises(StageError, "did_not_home", axis="z"):
        bench.stage.home()
    assert not bench.stage.homed


def test_nothing_but_speed_and_zero_is_ever_written() -> None:
    """All else is kept by the controller, whose owner has set it."""
    bench = bench_of(homed=False)
    stored = [dict(one.settings) for one in (bench.pair.x, bench.pair.z)]
    bench.stage.home()
    bench.stage.move_to(z_mm=-2.0, speed_mm_s=2.0)
    bench.stage.stop()
    bench.stage.unlock()
    for one, before in zip((bench.pair.x, bench.pair.z), stored, strict=True):
        assert {name for name in before if one.settings[name] != before[name]} <= {"mov"}
        assert struct.unpack(SPEEDS, one.settings["mov"])[2:] == struct.unpack(SPEEDS, before["mov"])[2:]
    assert not {"save", "sars", "eesv"} & {*bench.letters("x"), *bench.letters("z")}


# --- what stops it ---

ALARMS = [
    (0, "ALARM"), (0x80, "ALARM CTP_ERROR"), (0x800, "ALARM OVERLOAD_POWER_CURRENT"),
    (0x20000, "ALARM H_BRIDGE_FAULT"), (0x1000000, "ALARM EXTIO_ALARM"), (0x40000, "ALARM 40000 hex"),
]  # fmt: skip
BITS = {
    6: "ALARM", 7: "CTP_ERROR", 8: "POWER_OVERHEAT", 9: "CONTROLLER_OVERHEAT", 10: "OVERLOAD_POWER_VOLTAGE",
    11: "OVERLOAD_POWER_CURRENT", 12: "OVERLOAD_USB_VOLTAGE", 13: "LOW_USB_VOLTAGE", 14: "OVERLOAD_USB_CURRENT",
    15: "BORDERS_SWAP_MISSET", 16: "LOW_POWER_VOLTAGE", 17: "H_BRIDGE_FAULT", 20: "WINDING_RES_MISMATCH",
    21: "ENCODER_FAULT", 23: "ENGINE_RESPONSE_ERROR", 24: "EXTIO_ALARM",
}  # fmt: skip
"""Alarms among the flags of a status, by their bits: protocol.xi, without `STATE_`."""


def under_way(bench: Bench) -> Iterator[Any]:
    """A move that has been looked at once."""
    looks = bench.stage.moving(z_mm=-10.0, speed_mm_s=2.0)
    next(looks)
    return looks


@pytest.mark.parametrize(("flag", "word"), ALARMS, ids=[word for _, word in ALARMS])
def test_a_stop_clears_the_alarm_of_the_controller_but_not_ours(flag: int, word: str) -> None:
    """Only `unlock` does; until then nothing moves or homes."""
    bench = bench_of()
    looks = under_way(bench)
    bench.pair.z.fail(flag)
    with raises(StageAlarm, "alarm", number=word, axis="z"):
        list(looks)
    bench.stage.stop()
    assert not bench.pair.z.flags & 0x40, "the controller has forgotten it"
    bench.sent.clear()
    for act in (bench.stage.home, lambda: bench.stage.jog("z", 0.1, 1.0)):
        with raises(StageAlarm, "alarm", number=word, axis="z"):
            act()
    assert bench.stage.status().state == "Alarm"
    bench.stage.halt()
    assert not {"home", "move", "movr"} & {*bench.letters("x"), *bench.letters("z")}
    bench.stage.unlock()
    bench.stage.home()
    assert bench.stage.homed


def test_every_flag_has_the_makers_name_and_one_without_a_name_its_number() -> None:
    bench = bench_of()
    for bit in range(32):
        bench.stage.unlock()
        bench.stage.home()
        bench.pair.z.flags |= 1 << bit
        if bit in (0, 1, 2, 4, 5):
            assert bench.stage.status().state == "Idle"
            continue
        with raises(StageAlarm, "alarm", number=BITS.get(bit, f"{1 << bit:X} hex"), axis="z"):
            bench.stage.status()


def test_the_first_alarm_stays_until_it_is_unlocked() -> None:
    """Another one, later, does not hide it."""
    bench = bench_of()
    looks = under_way(bench)
    bench.pair.z.fail(0x80)
    with raises(StageAlarm, "alarm", number="ALARM CTP_ERROR"):
        list(looks)
    bench.stage.stop()
    bench.pair.z.fail(0x200)
    with raises(StageAlarm, "alarm", number="ALARM CTP_ERROR"):
        bench.stage.home()
    bench.stage.unlock()
    bench.stage.home()


def test_an_alarm_whose_cause_is_there_is_not_unlocked() -> None:
    bench = bench_of()
    looks = under_way(bench)
    bench.pair.z.fail(0x200, lasting=True)
    with raises(StageAlarm, "alarm", number="ALARM CONTROLLER_OVERHEAT"):
        list(looks)
    with raises(StageAlarm, "alarm", number="ALARM CONTROLLER_OVERHEAT"):
        bench.stage.unlock()


def test_a_halt_clears_no_alarm() -> None:
    bench = bench_of()
    bench.pair.z.fail(0x80)
    bench.stage.halt()
    with raises(StageAlarm, "alarm", number="ALARM CTP_ERROR"):
        bench.stage.status()


def test_a_position_error_without_an_alarm_is_one() -> None:
    """The encoder and the steps are apart."""
    bench = bench_of()
    bench.pair.z.flags |= 0x80
    with raises(StageAlarm, "alarm", number="CTP_ERROR", axis="z"):
        bench.stage.move_to(z_mm=-1.0, speed_mm_s=2.0)
    assert not bench.stage.homed


@pytest.mark.parametrize(("home", "edge", "word"), [("left", 1, "RIGHT_EDGE"), ("right", 2, "LEFT_EDGE")])
def test_a_limit_switch_within_the_travel_is_an_alarm(home: str, edge: int, word: str) -> None:
    """That of home is none."""
    bench = bench_of(stage={"standa": {"z": {"home": home}}})
    bench.pair.z.inputs = edge ^ 3
    looks = under_way(bench)
    bench.pair.z.inputs = edge
    with raises(StageAlarm, "alarm", number=word, axis="z"):
        list(looks)
    bench.pair.z.inputs = 0
    bench.stage.stop()
    with raises(StageAlarm, "alarm", number=word):
        bench.stage.home()


def shown(command: int, steps: int, *, flags: int = controller.HOMED, power: int = 3, inputs: int = 0) -> bytes:
    """A status with a power state and inputs."""
    found = bytearray(controller.status(command, steps, flags))
    found[4 + 2], found[4 + 39] = power, inputs
    return bytes(found)


SHOWN: dict[str, tuple[dict[str, int], str, str, str]] = {
    "power off": ({"power": 1}, "was_reset", "was_reset", "was_reset"),
    "another power": ({"power": 2}, "", "", ""),
    "not homed": ({"flags": 0}, "was_reset", "was_reset", "was_reset"),
    "not homed, with all else": ({"flags": 0x17}, "was_reset", "was_reset", "was_reset"),
    "far switch": ({"inputs": 1}, "alarm", "alarm", ""),
    "home switch": ({"inputs": 2}, "", "", ""),
    "right button": ({"inputs": 4}, "held", "", "held"),
    "left button": ({"inputs": 8}, "held", "", "held"),
    "another input": ({"inputs": 0xF0}, "", "", ""),
    "an alarm": ({"flags": 0x60}, "alarm", "alarm", "alarm"),
}
"""What a status shows, and the errors at a look of a move, at a status at rest, and before a move."""


@pytest.mark.parametrize("name", SHOWN)
def test_what_a_status_shows_is_noticed_at_once(name: str) -> None:
    shows, at_look, at_rest, before = SHOWN[name]
    bench = StageBench(controller.DEVICE, homed=True)
    looks = bench.under_way()
    bench.wire.instead[b"z gets"] = shown(controller.RUNS | controller.MOVE, 125, **shows)
    with raises(StageError, at_look) if at_look else nullcontext():
        next(looks)
    rest = shown(controller.HOME, 0, **shows)
    bench = StageBench(controller.DEVICE, homed=True)
    bench.wire.instead[b"z gets"] = rest
    with raises(StageError, at_rest) if at_rest else nullcontext():
        bench.stage.status()
    bench = StageBench(controller.DEVICE, homed=True)
    bench.wire.instead[b"z gets"] = rest
    with raises(StageError, before) if before else suppress(StageError):
        bench.move()
    assert (bench.wire.asked.count(controller.DEVICE.trigger) == 0) is bool(before)


@pytest.mark.parametrize(("command", "held"), [(3, False), (4, False), (0x83, True), (0x84, True), (5, False)])
def test_an_axis_that_a_button_has_moved_can_move_when_it_rests(command: int, held: bool) -> None:
    bench = StageBench(controller.DEVICE, homed=True)
    bench.wire.instead[b"z gets"] = shown(command, 0)
    with raises(StageHeld, "held", state="BUTTON") if held else suppress(StageError):
        bench.move()
    assert (controller.DEVICE.trigger in bench.wire.asked) is not held


def test_a_stop_whose_status_is_lost_is_sent_again_first() -> None:
    bench = StageBench(controller.DEVICE, homed=True)
    bench.under_way()
    bench.wire.forget()
    write, lost = bench.wire.write, [1]

    def writing(data: bytes, port: bytes = b"") -> None:
        bench.wire.silent = port + data == b"z gets" and bool(lost) and bool(lost.pop())
        write(data, port)

    bench.wire.write = writing  # type: ignore[method-assign]
    bench.stage.stop()
    assert [asked for asked in bench.wire.asked if asked.startswith(b"z")] == [
        b"z stop", b"z gets", b"z zeros", b"z stop", b"z gets",
    ]  # fmt: skip


@pytest.mark.parametrize("end", [controller.RUNS | controller.MOVE, 0x40 | controller.MOVE])
@pytest.mark.parametrize("times", [1, 2])
def test_a_target_where_it_turns_again_or_that_it_does_not_reach_is_no_arrival(end: int, times: int) -> None:
    """The controller has shown that it rests, and then otherwise, once or always."""
    bench = StageBench(controller.DEVICE, homed=True)
    there, away = (
        controller.status(controller.MOVE, 250, controller.HOMED),
        controller.status(end, 250, controller.HOMED),
    )
    states = {"arrived": {b"z gets": (there, "away")}, "away": {b"z gets": (away, "there") if times == 1 else away}}
    states["there"] = {b"z gets": there}
    bench.wire.device = replace(controller.DEVICE, states={**controller.DEVICE.states, **states})
    looks = bench.under_way()
    bench.wire.state = "arrived"
    with raises(StageError, "not_there", at_mm=-2.5) if times == 2 else nullcontext():
        list(looks)


ENDS: list[tuple[type[StageError], str, Callable[[StandaPair], object], bool]] = [
    (StageReset, "was_reset", lambda pair: pair.power_cycle(), False),
    (StageReset, "was_reset", lambda pair: pair.z._obey("pwof", b""), False),
    (StageReset, "was_reset", lambda pair: pair.z._obey("stop", b""), False),
    (StageHeld, "held", lambda pair: pair.z.push_button(), True),
    (StageOverridden, "overridden", lambda pair: pair.z._obey("sstp", b""), True),
    (StageError, "not_there", lambda pair: pair.z.slip(-20000), False),
]


@pytest.mark.parametrize(
    ("kind", "code", "act", "trusted"), ENDS, ids=["power", "pwof", "stop", "button", "soft stop", "slip"]
)
def test_what_ends_a_move(
    kind: type[StageError], code: str, act: Callable[[StandaPair], object], trusted: bool
) -> None:
    """Power, another program, a button at the controller, a position off the way."""
    bench = bench_of()
    looks = under_way(bench)
    act(bench.pair)
    with raises(kind, code):
        list(looks)
    assert bench.stage.homed is trusted
    if code == "not_there":
        bench.clock.wait_s(0.01)
        assert not bench.pair.z.busy, "it is stopped off its way"


# --- stop ---


def test_a_stop_goes_to_both_controllers_at_one_instant_and_is_confirmed() -> None:
    bench = bench_of()
    next(bench.stage.moving(z_mm=-10.0, speed_mm_s=5.0))
    bench.sent.clear()
    asked_s = bench.clock.monotonic_s()
    bench.stage.stop()
    assert bench.sent[:2] == [(asked_s, "z", b"stop"), (asked_s, "x", b"stop")]
    assert [bench.letters(axis).count("stop") for axis in "xz"] == [1, 1]
    assert not bench.stage.homed
    before = bench.pair.carriage_steps_at(bench.clock.monotonic_s())
    bench.clock.wait_s(1.0)
    assert bench.pair.carriage_steps_at(bench.clock.monotonic_s()) == before


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
    assert not bench.pair.z.busy


def test_a_stop_after_a_command_that_was_cut_short() -> None:
    """The controller waits for the rest of a frame and takes the stop for it; zero bytes complete the frame."""
    bench = bench_of()
    next(bench.stage.moving(z_mm=-30.0, speed_mm_s=5.0))
    bench.lines[0].host_write(frame("move", MOVE.pack(9, 9, 6 * RESERVED))[:7])
    asked_s = bench.clock.monotonic_s()
    bench.stage.stop()
    assert bench.clock.monotonic_s() - asked_s < 0.5
    assert not bench.pair.z.busy
