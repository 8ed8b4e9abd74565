"""The Modbus master as pairs of bytes, RTU and TCP, on the virtual clock."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.settings import Framing
from rig.transport import LoopbackTransport, modbus
from rig.transport.modbus import ModbusBusy, ModbusError, ModbusGarbled, ModbusMaster, ModbusRefused, ModbusTimeout
from sim.devices import SerialLine
from sim.devices.clock import VirtualClock
from tests.error_codes import has_code, raises
from tests.timed_wire import TimedWire

GOLDEN_WRITE = bytes.fromhex("07 10 62 00 00 08 10 00 01 00 00 27 10 00 00 27 10 27 10 00 00 00 10 8D 50")
GOLDEN_ANSWER = bytes.fromhex("07 10 62 00 00 08 DE 11")
GOLDEN_SAVE = bytes.fromhex("01 06 18 01 22 44 C6 39")
READ_2 = bytes.fromhex("01 03 00 07 00 02 75 CA")
# After a failure a device is read only once it has replied to a read of another length.
RESUME = (bytes.fromhex("01 03 00 07 00 01 35 CB"), bytes.fromhex("01 03 02 00 01 79 84"))
RESUME_3 = (bytes.fromhex("01 03 00 07 00 03 B4 0A"), bytes.fromhex("01 03 06 00 01 86 A0 00 00 35 DF"))
Rtu = Callable[[str], bytes]
Script = Callable[[list[Any]], Any]

NUMBERS = (0x8001, 0x8002, 0x8003)  # of the first questions over TCP


def three_times(question: bytes, reply: bytes) -> list[Any]:
    """A reply that is not accepted."""
    return [(question, reply), *[RESUME, (question, reply)] * 2]


@pytest.fixture
def master(clock: VirtualClock, scripted: Script) -> Callable[..., ModbusMaster]:
    def make(script: list[Any], **options: Any) -> ModbusMaster:
        return ModbusMaster(scripted(script), clock, **options)

    return make


# --- golden frames ---


def test_the_master_writes_eight_registers_in_one_frame(master: Any) -> None:
    """From the CS2RS manual, p. 43."""
    bus = master([(GOLDEN_WRITE, GOLDEN_ANSWER)])
    bus.write(7, 0x6200, [1, 0, 0x2710, 0, 0x2710, 0x2710, 0, 0x10])


def test_the_master_writes_one_register(master: Any) -> None:
    master([(GOLDEN_SAVE, GOLDEN_SAVE)]).write_one(1, 0x1801, 0x2244)


def test_the_master_reads_registers(master: Any, rtu: Rtu) -> None:
    assert master([(READ_2, rtu("01 03 04 00 01 86 A0"))]).read(1, 7, 2) == [1, 0x86A0]


def test_modbus_tcp_frames_carry_ascending_transaction_numbers(master: Any) -> None:
    bus = master(
        [
            (bytes.fromhex("8001 0000 0006 01 03 0007 0002"), bytes.fromhex("8001 0000 0007 01 03 04 0001 86A0")),
            (bytes.fromhex("8002 0000 0006 01 06 1801 1111"), bytes.fromhex("8002 0000 0006 01 06 1801 1111")),
            (
                bytes.fromhex("8003 0000 0009 01 10 0005 0001 02 0008"),
                bytes.fromhex("8003 0000 0006 01 10 0005 0001"),
            ),
        ],
        framing="tcp",
    )
    assert bus.read(1, 7, 2) == [1, 0x86A0]
    bus.write_one(1, 0x1801, 0x1111)
    bus.write(1, 5, [8])


# --- silence ---


@pytest.mark.parametrize(("baud", "pause_s"), [(9600, 3.5 * 11 / 9600), (19200, 3.5 * 11 / 19200), (115200, 1.75e-3)])
def test_rtu_frames_are_three_and_a_half_characters_apart(
    clock: VirtualClock, scripted: Script, rtu: Rtu, baud: int, pause_s: float
) -> None:
    clock.wait_s(1000.0)
    wire = scripted([(GOLDEN_SAVE, GOLDEN_SAVE), (GOLDEN_SAVE, GOLDEN_SAVE)])
    sent_s: list[float] = []
    write = wire.write
    wire.write = lambda data: (sent_s.append(clock.monotonic_s()), write(data))
    bus = ModbusMaster(wire, clock, baud=baud)
    bus.write_one(1, 0x1801, 0x2244)
    answered_s = clock.monotonic_s()
    bus.write_one(1, 0x1801, 0x2244)
    assert sent_s[1] - answered_s == pytest.approx(pause_s)


def test_after_a_broadcast_the_next_frame_waits_for_its_end(clock: VirtualClock, scripted: Script, rtu: Rtu) -> None:
    bus = ModbusMaster(scripted([(rtu("00 06 60 02 00 40"), b""), (GOLDEN_SAVE, GOLDEN_SAVE)]), clock, baud=9600)
    clock.wait_s(10.0)
    bus.send_now([1, 2], 0x6002, 0x40)
    assert clock.monotonic_s() == 10.0
    bus.write_one(1, 0x1801, 0x2244)
    assert clock.monotonic_s() == pytest.approx(10.0 + 8 * 10 / 9600 + 3.5 * 11 / 9600)


# --- what goes wrong ---

ABOUT_2 = {"port": "scripted", "device": 1, "function": "read", "function_number": 3, "count": 2, "address": "0x0007"}
"""What an error about READ_2 names."""


@pytest.mark.parametrize("number", [1, 2, 3, 4, 7, 8])
def test_an_exception_response_raises_an_error_with_function_register_and_code(
    master: Any, rtu: Rtu, number: int
) -> None:
    bus = master([(READ_2, rtu(f"01 83 {number:02X}"))])
    with raises(ModbusRefused, "refused", number=f"exception {number},", **ABOUT_2):
        bus.read(1, 7, 2)


NOT_NOW = pytest.mark.parametrize("number", [5, 6, 10, 11])


def test_a_read_with_a_bad_crc_is_repeated(master: Any, rtu: Rtu, clock: VirtualClock) -> None:
    good = rtu("01 03 04 00 01 86 A0")
    bad = good[:4] + b"\xff" + good[5:]
    assert master([(READ_2, bad), RESUME, (READ_2, bad), RESUME, (READ_2, good)]).read(1, 7, 2) == [1, 0x86A0]


def test_each_read_after_a_failure_has_a_length_that_no_unanswered_read_had(master: Any, rtu: Rtu) -> None:
    late = [RESUME[1], RESUME_3[1]]
    assert master([(READ_2, b""), (RESUME[0], b""), (RESUME_3[0], late), (READ_2, rtu(ANSWER_2))]).read(1, 7, 2) == [
        1,
        0x86A0,
    ]


def test_a_garbled_reply_between_two_reads_costs_no_try(master: Any, rtu: Rtu) -> None:
    good, bad = rtu(ANSWER_2), RESUME[1][:3] + b"\xff" + RESUME[1][4:]
    script = [(READ_2, b""), (RESUME[0], bad), RESUME, (READ_2, good)]
    assert master(script, read_tries=2).read(1, 7, 2) == [1, 0x86A0]


def test_a_device_without_so_many_registers_has_replied(master: Any, rtu: Rtu) -> None:
    assert master([(READ_2, b""), (RESUME[0], rtu("01 83 02")), (READ_2, rtu(ANSWER_2))]).read(1, 7, 2) == [1, 0x86A0]


def test_an_answer_from_another_device_is_refused(master: Any, rtu: Rtu) -> None:
    with raises(ModbusGarbled, "another_device", device=1, answering=5):
        master(three_times(READ_2, rtu("05 03 04 00 01 86 A0"))).read(1, 7, 2)


@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize(("late", "count"), [("01 03 02 00 05", 1), ("01 83 02", 1), ("01 06 00 07 00 01", 0)])
def test_a_late_answer_of_another_device_fails_no_write(
    master: Any, rtu: Rtu, late: str, count: int, together: bool
) -> None:
    """A write is not repeated, since it may have been obeyed."""
    request = "01 03 00 07 00 01" if count else "01 06 00 07 00 01"
    answers = [rtu(late), GOLDEN_ANSWER]
    bus = master([(rtu(request), b""), (GOLDEN_WRITE, [b"".join(answers)] if together else answers)], read_tries=1)
    with raises(ModbusTimeout, "no_reply"):
        bus.read(1, 7) if count else bus.write_one(1, 7, 1)
    bus.write(7, 0x6200, [1, 0, 0x2710, 0, 0x2710, 0x2710, 0, 0x10])


def test_an_answer_with_too_few_registers_is_refused(master: Any, rtu: Rtu) -> None:
    with raises(ModbusGarbled, "does_not_fit"):
        master(three_times(READ_2, rtu("01 03 02 00 01"))).read(1, 7, 2)


@pytest.mark.parametrize("answer", ["01 06 18 01 22 45", "01 06 18 02 22 44", "01 10 18 01 00 01"])
def test_a_write_whose_answer_is_not_its_echo_is_an_error(master: Any, rtu: Rtu, answer: str) -> None:
    with raises(ModbusGarbled, "does_not_fit"):
        master([(GOLDEN_SAVE, rtu(answer))]).write_one(1, 0x1801, 0x2244)


@pytest.mark.parametrize("answer", ["07 10 62 01 00 08", "07 10 62 00 00 07", "07 06 62 00 00 08"])
def test_a_write_of_several_registers_must_be_confirmed_by_its_answer(master: Any, rtu: Rtu, answer: str) -> None:
    with raises(ModbusGarbled, "does_not_fit"):
        master([(GOLDEN_WRITE, rtu(answer))]).write(7, 0x6200, [1, 0, 0x2710, 0, 0x2710, 0x2710, 0, 0x10])


class LateTransport(TimedWire):
    """Answers the n-th write with chunks, each so many seconds after it."""

    def __init__(self, clock: VirtualClock, answers: list[list[tuple[float, bytes]]]) -> None:
        super().__init__(clock)
        self.answers, self.sent_s, self.sent = answers, list[float](), list[bytes]()

    def write(self, data: bytes) -> None:
        now_s = self.clock.monotonic_s()
        self.sent_s.append(now_s)
        self.sent.append(data)
        self.coming += [(now_s + after_s, chunk) for after_s, chunk in self.answers.pop(0)]
        self.coming.sort(key=lambda due: due[0])


@NOT_NOW
def test_a_read_of_a_busy_device_is_repeated_for_a_tenth_of_a_second(
    clock: VirtualClock, rtu: Rtu, number: int
) -> None:
    """For 0.1 s, so that a look of several reads is short of a lost reply; then the device is busy."""
    busy, good = [(0.005, rtu(f"01 83 {number:02X}"))], [(0.005, rtu(ANSWER_2))]
    wire = LateTransport(clock, [busy, busy, good, *[busy] * 40])
    bus = ModbusMaster(wire, clock)
    assert bus.read(1, 7, 2) == [1, 0x86A0]
    assert len(wire.sent_s) == 3
    begun_s = clock.monotonic_s()
    with raises(ModbusBusy, "busy", number=f"exception {number},", **ABOUT_2 | {"port": "wire"}):
        bus.read(1, 7, 2)
    assert clock.monotonic_s() - begun_s == pytest.approx(0.1, abs=0.03)


@pytest.mark.parametrize("number", [6, 10])
@pytest.mark.parametrize("stopped", [False, True])
def test_a_write_refused_as_busy_is_repeated_unless_a_stop_was_sent(
    clock: VirtualClock, rtu: Rtu, number: int, stopped: bool
) -> None:
    """A trigger that is sent after a stop would move the stage."""
    busy, stop = [(0.005, rtu(f"01 86 {number:02X}"))], rtu("01 06 60 02 00 40")
    wire = LateTransport(clock, [busy, busy, *([[]] if stopped else []), [(0.005, GOLDEN_SAVE)], *[busy] * 40])
    bus = ModbusMaster(wire, clock)
    if stopped:
        clock.call_at(0.03, lambda: bus.send_now([1], 0x6002, 0x40))
        with raises(ModbusBusy, "busy"):
            bus.write_one(1, 0x1801, 0x2244)
        assert wire.sent == [GOLDEN_SAVE, GOLDEN_SAVE, stop]
        return
    bus.write_one(1, 0x1801, 0x2244)
    assert wire.sent == [GOLDEN_SAVE] * 3
    begun_s = clock.monotonic_s()
    with raises(ModbusBusy, "busy"):
        bus.write_one(1, 0x1801, 0x2244)
    assert clock.monotonic_s() - begun_s == pytest.approx(0.1, abs=0.03)


@pytest.mark.parametrize("number", [1, 2, 3, 4, 5, 7, 8, 11])
def test_a_write_that_a_device_refused_or_may_have_executed_is_not_repeated(
    master: Any, rtu: Rtu, number: int
) -> None:
    with raises(ModbusRefused, "busy" if number in (5, 11) else "refused"):
        master([(GOLDEN_SAVE, rtu(f"01 86 {number:02X}"))]).write_one(1, 0x1801, 0x2244)


@pytest.mark.parametrize(("baud", "gap_s"), [(9600, 8e-3), (115200, 1.5e-3)])
def test_after_a_garbled_answer_the_master_waits_until_the_bus_is_silent(
    clock: VirtualClock, rtu: Rtu, baud: int, gap_s: float
) -> None:
    # Longer than 3.5 characters at 9600 baud, longer than 10 at 115200.
    bad = [
        (0.01 + k * gap_s, chunk) for k, chunk in enumerate([bytes.fromhex("01 03 04 00 01 86 A0 00 00"), b"?", b"?"])
    ]
    wire = LateTransport(clock, [bad, [(0.01, RESUME[1])], [(0.01, rtu("01 03 04 00 01 86 A0"))]])
    assert ModbusMaster(wire, clock, baud=baud).read(1, 7, 2) == [1, 0x86A0]
    quiet_s = max(10 * 10 / baud, 3.5 * 11 / baud if baud == 9600 else 1.75e-3)
    assert wire.sent_s[1] - bad[-1][0] == pytest.approx(quiet_s)


def test_modbus_tcp_transaction_numbers_stay_above_0x8000(clock: VirtualClock) -> None:
    """A first byte that a device would take for a missing last one must not be a command of a drive."""
    written: list[bytes] = []
    wire = LateTransport(clock, [[]] * 3)
    wire.write = written.append
    bus = ModbusMaster(wire, clock, framing="tcp")
    bus._transaction = 0x7FFE
    for _ in range(3):
        bus.send_now([1], 7, 1)
    assert [frame[:2] for frame in written] == [b"\xff\xff", b"\x80\x00", b"\x80\x01"]


def test_a_modbus_exchange_waits_for_another_thread_at_most_two_replies(
    master: Any, rtu: Rtu, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For the time of two replies; then it goes out all the same."""
    waited_s = list[float]()

    class HangingLock:
        def acquire(self, timeout: float) -> bool:
            waited_s.append(timeout)
            return False

    monkeypatch.setattr(modbus, "threading", SimpleNamespace(Lock=HangingLock))
    bus = master([(READ_2, b""), RESUME, (READ_2, rtu(ANSWER_2)), (GOLDEN_SAVE, GOLDEN_SAVE)], reply_s=0.15)
    assert bus.read(1, 7, 2) == [1, 0x86A0]
    bus.write_one(1, 0x1801, 0x2244)
    assert waited_s == [0.3] * 5, "two questions and the one between, what comes late, and the write"


@pytest.mark.parametrize(
    ("port", "framing", "sent"),
    [
        ("/dev/ttyUSB0", None, "01 06 00 07 00 01 F9 CB"),
        ("tcp://10.0.0.7:502", None, "80 01 00 00 00 06 01 06 00 07 00 01"),
        ("/dev/ttyUSB0", "tcp", "80 01 00 00 00 06 01 06 00 07 00 01"),
        ("tcp://10.0.0.7:502", "rtu", "01 06 00 07 00 01 F9 CB"),
    ],
)
def test_the_modbus_framing_follows_the_port_unless_configured(
    clock: VirtualClock, scripted: Script, port: str, framing: Any, sent: str
) -> None:
    """A gateway may pass frames of RTU through."""
    wire = scripted([(bytes.fromhex(sent), b"")] * 2)
    bus = ModbusMaster.on_port(wire, clock, port, framing=framing, baud=9600)
    bus.send_now([1], 7, 1)
    assert clock.monotonic_s() == 0.0
    bus._transaction = 0
    with raises(ModbusTimeout, "no_reply"):
        bus.write_one(1, 7, 1)
    pause_s = 8 * 10 / 9600 + 38.5 / 9600 if len(sent) < 24 else 0.0
    assert clock.monotonic_s() == pytest.approx(pause_s + 0.2)


@pytest.mark.parametrize(
    ("answer", "kind", "code"),
    [
        (b"", ModbusTimeout, "no_reply"),
        (bytes.fromhex("07 10 62 00 00 08 00 00"), ModbusGarbled, "bad_crc"),
    ],
)
def test_a_write_without_a_valid_answer_is_never_repeated(
    master: Any, answer: bytes, kind: type[ModbusError], code: str
) -> None:
    """It may have been obeyed: a move must not be triggered twice. The script holds it once."""
    with raises(kind, code, function="write"):
        master([(GOLDEN_WRITE, answer)]).write(7, 0x6200, [1, 0, 0x2710, 0, 0x2710, 0x2710, 0, 0x10])


def test_a_refused_read_is_not_repeated(master: Any, rtu: Rtu) -> None:
    with raises(ModbusRefused, "refused", number="exception 2,"):
        master([(READ_2, rtu("01 83 02"))]).read(1, 7, 2)


@pytest.mark.parametrize("together", [False, True])
def test_modbus_tcp_ignores_an_answer_to_an_older_request(master: Any, together: bool) -> None:
    late = bytes.fromhex("8001 0000 0005 01 03 02 1111")
    right = bytes.fromhex("8002 0000 0005 01 03 02 2222")
    bus = master(
        [
            (bytes.fromhex("8001 0000 0006 01 03 0006 0001"), b""),
            (bytes.fromhex("8002 0000 0006 01 03 0006 0001"), [late + right] if together else [late, right]),
        ],
        framing="tcp",
    )
    assert bus.read(1, 6, 1) == [0x2222]


def test_modbus_tcp_refuses_an_answer_from_another_unit(master: Any) -> None:
    question = "0000 0006 01 03 0006 0001"
    script = [
        (bytes.fromhex(f"{n:04x}" + question), bytes.fromhex(f"{n:04x} 0000 0005 09 03 02 2222")) for n in NUMBERS
    ]
    with raises(ModbusGarbled, "another_device", answering=9):
        master(script, framing="tcp").read(1, 6, 1)


def test_a_stop_frame_is_sent_at_once_and_for_all_drives_in_one_tcp_write(
    clock: VirtualClock, scripted: Script, rtu: Rtu
) -> None:
    """On a bus the answer may be lost; on TCP both frames go in one write."""
    wire = scripted([(bytes.fromhex("8001 0000 0006 02 06 6002 0040 8002 0000 0006 01 06 6002 0040"), b"")])
    ModbusMaster(wire, clock, framing="tcp").send_now([2, 1], 0x6002, 0x40)
    alone = scripted([(rtu("02 06 60 02 00 40"), b"")])
    ModbusMaster(alone, clock).send_now([2], 0x6002, 0x40)
    assert clock.monotonic_s() == 0.0


# --- an RS-485 adapter that hears itself ---

ANSWER_2 = "01 03 04 00 01 86 A0"


@pytest.mark.parametrize("pieces", ["whole", "bytes", "echo, then answer"])
def test_an_adapter_echo_is_detected_by_the_first_read_and_removed(master: Any, rtu: Rtu, pieces: str) -> None:
    """Read: the echo, 8 bytes, and the answer. Then function 06: two copies, of which the second is the answer."""
    answer = rtu(ANSWER_2)
    comes = {
        "whole": READ_2 + answer,
        "bytes": [bytes([b]) for b in READ_2 + answer],
        "echo, then answer": [READ_2, answer],
    }[pieces]
    bus = master(
        [(READ_2, comes), (GOLDEN_SAVE, [GOLDEN_SAVE, GOLDEN_SAVE]), (GOLDEN_WRITE, [GOLDEN_WRITE, GOLDEN_ANSWER])]
    )
    assert bus.echoes is None
    assert bus.read(1, 7, 2) == [1, 0x86A0]
    assert bus.echoes is True
    bus.write_one(1, 0x1801, 0x2244)
    bus.write(7, 0x6200, [1, 0, 0x2710, 0, 0x2710, 0x2710, 0, 0x10])


def test_behind_an_echoing_adapter_a_dead_device_confirms_no_write(master: Any, rtu: Rtu) -> None:
    """Function 06 answers with the very bytes of its question: one copy is the adapter's, and nobody's answer."""
    bus = master([(READ_2, READ_2 + rtu(ANSWER_2)), (GOLDEN_SAVE, GOLDEN_SAVE)])
    bus.read(1, 7, 2)
    with raises(ModbusTimeout, "only_echo", address="0x1801", timeout_s=0.2):
        bus.write_one(1, 0x1801, 0x2244)


def test_without_an_echoing_adapter_one_copy_of_a_write_is_its_answer(master: Any, rtu: Rtu) -> None:
    bus = master([(READ_2, rtu(ANSWER_2)), (GOLDEN_SAVE, GOLDEN_SAVE)])
    bus.read(1, 7, 2)
    assert bus.echoes is False
    bus.write_one(1, 0x1801, 0x2244)


def test_an_echo_that_appears_later_is_not_accepted_as_an_answer(master: Any, rtu: Rtu) -> None:
    """Once a bus is known to have none, its own frame coming back is no answer, and nothing to take off."""
    bus = master([(READ_2, rtu(ANSWER_2)), (READ_2, READ_2 + rtu(ANSWER_2))], read_tries=1)
    bus.read(1, 7, 2)
    with raises(ModbusGarbled, "bad_crc"):
        bus.read(1, 7, 2)
    assert bus.echoes is False


# --- any bytes at all: an error in bounded time ---

FRAMINGS = pytest.mark.parametrize("framing", ["rtu", "tcp"])
# Mostly what looks like the beginning of an answer: pure noise hardly ever gets past the first byte.
BEGINNINGS = st.sampled_from(
    [
        b"", b"\x01\x03", b"\x01\x03\x02", b"\x01\x83", b"\x01\x90", b"\x01\x2b\x0e", b"\x01\x08", b"\x01\x14",
        b"\x00\x01\x00\x00\x00\x05\x01\x03", b"\x00\x01\x00\x00\x00\x03\x01\x83", b"\x00\x01\x00\x00\x00\x02\x01\x2b",
    ]
)  # fmt: skip
NOISE = st.builds(lambda first, rest: first + rest, BEGINNINGS, st.binary(max_size=40))
CODES = {
    *(
        "no_reply",
        "incomplete",
        "bad_crc",
        "no_modbus",
        "does_not_fit",
        "another_device",
        "refused",
        "busy",
    ),
}


class Noise:
    """A far end that answers each question with the next of these."""

    def __init__(self, clock: VirtualClock, answers: list[bytes]) -> None:
        self.line = SerialLine(clock, 115200)
        self._answers = iter(answers)
        self.line.connect(lambda data: self.line.device_write(next(self._answers, b"")))


@FRAMINGS
@given(answers=st.lists(NOISE, min_size=1, max_size=3))
@settings(max_examples=150, deadline=None)
def test_the_master_answers_any_noise_with_an_error_in_bounded_time(framing: Framing, answers: list[bytes]) -> None:
    clock = VirtualClock()
    master = ModbusMaster(LoopbackTransport(Noise(clock, answers).line, clock), clock, framing=framing)
    came: ModbusError | None = None
    try:
        master.read(1, 0x1003, 1)
    except ModbusError as error:
        came = error
    if came is not None:
        assert "\n" not in str(came)
        assert came.code in CODES
        has_code(came, came.code, device=1, function="read", function_number=3, count=1, address="0x1003")
    assert clock.monotonic_s() < 2.0


@FRAMINGS
@given(answer=NOISE)
@settings(max_examples=100, deadline=None)
def test_a_modbus_write_sends_one_frame_whatever_noise_answers(framing: Framing, answer: bytes) -> None:
    clock = VirtualClock()
    line, heard = SerialLine(clock, 115200), list[bytes]()
    line.connect(lambda data: (heard.append(data), line.device_write(answer)))
    with pytest.raises(ModbusError):
        ModbusMaster(LoopbackTransport(line, clock), clock, framing=framing).write(
            1, 0x6200, [1, 0, 0, 60, 1, 1, 0, 16]
        )
    assert len(heard) == 1
