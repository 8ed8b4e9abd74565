"""Modbus frames in and out of the virtual drive and transmitter, on the virtual clock."""

from collections.abc import Callable

import pytest

from sim.devices import Load, ModbusBus, SerialLine, VirtualDrive, VirtualLaumas
from sim.devices.clock import VirtualClock

Rtu = Callable[[str], bytes]
GRAM_N = 9.80665e-3
GOLDEN_WRITE = bytes.fromhex("07 10 62 00 00 08 10 00 01 00 00 27 10 00 00 27 10 27 10 00 00 00 10 8D 50")
GOLDEN_ANSWER = bytes.fromhex("07 10 62 00 00 08 DE 11")
GOLDEN_SAVE = bytes.fromhex("01 06 18 01 22 44 C6 39")


class Host:
    """Has drives 1 and 7 and transmitter 3 on one bus."""

    def __init__(self, framing: str = "rtu", force_n: Callable[[float], float] = lambda t_s: 0.0) -> None:
        self.clock = VirtualClock()
        self.line = SerialLine(self.clock, 115200)
        self.drive, self.seven = VirtualDrive(self.clock), VirtualDrive(self.clock)
        self.cell = VirtualLaumas(self.clock, Load(force_n))
        devices = {1: self.drive, 7: self.seven, 3: self.cell}
        self.bus = ModbusBus(self.clock, self.line, devices, framing=framing)

    def say(self, data: bytes, wait_s: float = 0.02) -> bytes:
        self.line.host_write(data)
        self.clock.wait_s(wait_s)
        return self.line.host_read()


@pytest.fixture
def host() -> Host:
    return Host()


# --- frames ---


def test_the_virtual_drive_answers_the_example_frame_of_the_manual_and_does_not_move(host: Host) -> None:
    """CS2RS manual, p. 43; its speed word is 0."""
    assert host.say(GOLDEN_WRITE) == GOLDEN_ANSWER
    host.clock.wait_s(5.0)
    assert host.seven.carriage_at(host.clock.monotonic_s()) == -4000


def test_virtual_devices_ignore_a_bad_crc_and_frames_to_other_devices(host: Host, rtu: Rtu) -> None:
    assert host.say(GOLDEN_SAVE[:-1] + b"\x00") == b""
    assert host.say(rtu("05 03 10 03 00 01")) == b""
    assert host.say(GOLDEN_SAVE) == GOLDEN_SAVE


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        ("01 03 12 34 00 01", "01 83 02"),  # no such register
        ("01 03 10 03 00 00", "01 83 03"),  # none of it
        ("01 06 10 03 00 01", "01 86 02"),  # read only
        ("01 06 60 02 00 99", "01 86 03"),  # no such trigger
        ("01 06 18 01 00 01", "01 86 03"),  # no such control word
        ("01 10 62 00 00 01 02 00 07", "01 10 62 00 00 01"),
        ("01 01 00 00 00 01", "01 81 01"),  # coils
        ("01 04 10 03 00 01", "01 84 01"),  # input registers
        ("03 06 00 05 00 07", "03 86 01"),  # a transmitter knows functions 3 and 16
        ("03 03 00 00 00 21", "03 83 03"),  # 33 registers
        ("03 03 00 0D 00 02", "03 83 02"),
        ("03 10 00 06 00 01 02 00 00", "03 90 02"),
        ("03 10 00 05 00 01 02 00 63", "03 90 03"),  # no such command
    ],
)
def test_the_virtual_drive_answers_illegal_requests_with_modbus_exceptions(
    host: Host, rtu: Rtu, question: str, answer: str
) -> None:
    assert host.say(rtu(question)) == rtu(answer)


# --- the drive ---


def go(mode: str, position: str, rpm: str = "00 3C", ramps: str = "01 4D 01 4D") -> str:
    """PR0 with its trigger, to drive 1."""
    return f"01 10 62 00 00 08 10 {mode} {position} {rpm} {ramps} 00 00 00 10"


STATUS, POSITION = "01 03 10 03 00 01", "01 03 10 14 00 02"


def home(host: Host, rtu: Rtu) -> None:
    host.say(rtu("01 06 60 02 00 20"))
    assert host.say(rtu(STATUS)) == rtu("01 03 02 00 06")
    host.clock.wait_s(10.0)
    assert host.say(rtu(STATUS)) == rtu("01 03 02 00 72")


def test_the_virtual_drive_stops_at_its_soft_limits(host: Host, rtu: Rtu) -> None:
    """−1000 … 0; a move to −2000 ends at −1000, and its path is not done."""
    home(host, rtu)
    host.say(rtu("01 10 60 06 00 04 08 00 00 00 00 FF FF FC 18"))
    host.say(rtu("01 06 60 00 00 02"))
    host.say(rtu(go("00 01", "FF FF F8 30")), 10.0)
    assert host.say(rtu(POSITION)) == rtu("01 03 04 FF FF FC 18")
    assert host.say(rtu(STATUS)) == rtu("01 03 02 00 42")
    host.say(rtu("01 06 18 01 40 02"), 1.0)
    assert host.say(rtu(POSITION)) == rtu("01 03 04 FF FF FC 18")
    host.say(rtu("01 06 60 00 00 00"))
    host.say(rtu(go("00 01", "FF FF F8 30")), 10.0)
    assert host.say(rtu(POSITION)) == rtu("01 03 04 FF FF F8 30")


def test_a_quick_stop_of_the_virtual_drive_decelerates_and_keeps_the_position(host: Host, rtu: Rtu) -> None:
    """600 rpm are 4000 pulses/s: to rest in 10 ms after 20 pulses, 15 of them in the first half."""
    host.say(rtu(go("00 01", "00 01 00 00", "02 58")), 1.0)
    order = rtu("01 06 60 02 00 40")
    host.line.host_write(order)
    host.clock.wait_s(len(order) * 10 / 115200)
    start_s = host.clock.monotonic_s()
    host.clock.wait_s(0.02)
    start, half, end = (host.drive.carriage_at(start_s + t_s) for t_s in (0.0, 0.005, 0.01))
    assert (half - start, end - start) == (pytest.approx(15, abs=1), pytest.approx(20, abs=1))
    assert host.drive.carriage_at(start_s + 0.007) < end
    assert host.line.host_read() == order
    counts = f"{end + 4000:08X}"
    assert host.say(rtu(POSITION)) == rtu(f"01 03 04 {counts}")
    # The rest of the path is dropped, and the next one ends where it should.
    assert host.say(rtu(STATUS), 1.0) == rtu("01 03 02 00 02")
    assert host.say(rtu(POSITION)) == rtu(f"01 03 04 {counts}")
    host.say(rtu(go("00 01", "00 00 00 64", "02 58")), 5.0)
    assert host.say(rtu(POSITION)) == rtu("01 03 04 00 00 00 64")
    assert host.drive.carriage_at(host.clock.monotonic_s()) == -3900


def test_an_alarm_stops_the_virtual_drive_until_it_is_cleared(host: Host, rtu: Rtu) -> None:
    host.say(rtu(go("00 01", "00 01 00 00")), 0.5)
    host.drive.fault(0x152)
    host.clock.wait_s(0.1)
    assert host.say(rtu(STATUS)) == rtu("01 03 02 00 01")
    assert host.say(rtu("01 03 22 03 00 01")) == rtu("01 03 02 01 52")
    before = host.drive.carriage_at(host.clock.monotonic_s())
    for order in (go("00 01", "00 00 00 64"), "01 06 60 02 00 20", "01 06 18 01 40 01"):
        host.say(rtu(order), 0.5)
    assert host.drive.carriage_at(host.clock.monotonic_s()) == before
    host.say(rtu("01 06 18 01 11 11"))
    assert host.say(rtu(STATUS)) == rtu("01 03 02 00 02")


@pytest.mark.parametrize(("word", "sign"), [("40 01", 1), ("40 02", -1)])
def test_a_jog_of_the_virtual_drive_ends_50_ms_after_its_last_command(
    host: Host, rtu: Rtu, word: str, sign: int
) -> None:
    """60 rpm are 400 pulses/s: one word is 20 pulses, fifty at 40 ms from each other are 49 · 16 + 20."""
    host.say(rtu(f"01 06 18 01 {word}"), 1.0)
    assert sign * (host.drive.carriage_at(host.clock.monotonic_s()) + 4000) == pytest.approx(20, abs=2)
    for _ in range(50):
        host.say(rtu(f"01 06 18 01 {word}"), 0.04)
    assert host.say(rtu(STATUS), 0.01)[4] == 0x06
    host.clock.wait_s(0.06)
    assert host.say(rtu(STATUS))[4] & 0x04 == 0
    moved = sign * (host.drive.carriage_at(host.clock.monotonic_s()) + 4000)
    assert moved == pytest.approx(20 + 49 * 16 + 20, abs=2)


@pytest.mark.parametrize("number", [0, 1, 15])
def test_each_path_of_the_virtual_drive_has_its_own_trigger(host: Host, rtu: Rtu, number: int) -> None:
    """1F runs PR15, whose registers begin at 6278."""
    path = "00 01 00 00 00 64 02 58 01 4D 01 4D 00 00"
    host.say(rtu(f"01 10 62 {8 * number:02X} 00 07 0E {path}"), 1.0)
    for other in range(16):
        if other != number:
            host.say(rtu(f"01 06 60 02 00 {0x10 + other:02X}"), 0.5)
    assert host.say(rtu(POSITION)) == rtu("01 03 04 00 00 00 00")
    host.say(rtu(f"01 06 60 02 00 {0x10 + number:02X}"), 1.0)
    assert host.say(rtu(POSITION)) == rtu("01 03 04 00 00 00 64")


def test_the_virtual_drive_loses_unsaved_settings_at_a_power_cycle() -> None:
    drive = VirtualDrive(VirtualClock(), stored={0x6208: 0x41})
    drive.write(0x6208, [0])
    drive.write(0x6008, [0xFFFF, 0xFF00])
    drive.power_cycle()
    assert (drive.read(0x6208, 1), drive.read(0x6008, 2)) == ([0x41], [0, 0])
    drive.write(0x6208, [0])
    drive.write(0x1801, [0x2211])
    drive.power_cycle()
    assert drive.read(0x6208, 1) == [0]


def test_a_virtual_gateway_passes_unit_0_to_every_drive() -> None:
    host = Host("tcp")
    assert host.say(bytes.fromhex("0001 0000 0006 00 06 6000 0002")) == b""
    assert host.drive.read(0x6000, 1) == host.seven.read(0x6000, 1) == [2]


# --- the transmitter ---

WEIGHT = "03 03 00 06 00 08"


def told(host: Host, rtu: Rtu) -> tuple[int, int, int]:
    """Status, gross and net counts."""
    answer = host.say(rtu(WEIGHT))
    assert answer == rtu(answer[:-2].hex())
    assert answer[:3] == b"\x03\x03\x10"
    assert answer[-4:-2] == b"\x01\x0c"
    return tuple(int.from_bytes(answer[a:b], "big") for a, b in ((3, 5), (5, 9), (9, 13)))  # type: ignore[return-value]


@pytest.mark.parametrize(("grams", "bits"), [(209.5, 0x0004), (331.0, 0x000C), (10_001.0, 0x003C)])
def test_the_virtual_transmitter_flags_each_level_of_overload(rtu: Rtu, grams: float, bits: int) -> None:
    host = Host(force_n=lambda t_s: grams * GRAM_N)
    host.clock.wait_s(1.0)
    assert told(host, rtu)[0] & 0x003F == bits


def test_the_virtual_transmitter_flags_a_dead_cell_and_a_dead_converter(rtu: Rtu) -> None:
    host = Host(force_n=lambda t_s: float("nan"))
    host.clock.wait_s(1.0)
    assert told(host, rtu)[0] & 0x0801 == 0x0001
    host = Host()
    host.cell.broken = 0x0002
    assert told(host, rtu)[0] & 0x0803 == 0x0002


def test_the_filter_of_the_virtual_transmitter_averages_its_last_samples(rtu: Rtu) -> None:
    """A step at 1 s; samples every 12.5 ms, four in the mean."""
    host = Host(force_n=lambda t_s: 4 * GRAM_N if t_s >= 1.0 else 0.0)
    counts = []
    for n in range(5):
        host.clock.wait_s(1.0 + 0.0125 * n + 0.001 - host.clock.monotonic_s())
        host.line.host_write(rtu(WEIGHT))
        host.clock.wait_s(0.008)
        counts.append(int.from_bytes(host.line.host_read()[5:9], "big"))
    assert counts == [100, 200, 300, 400, 400]


# --- what other masters do ---

READ_2_OF_TCP = bytes.fromhex("0001 0000 0006 03 03 0007 0002")
ANSWER_OF_TCP = bytes.fromhex("0001 0000 0007 03 03 04")


def test_a_virtual_device_ignores_a_frame_of_impossible_length_and_answers_the_next() -> None:
    tcp = Host("tcp")
    assert tcp.say(bytes.fromhex("0001 0000 FFFF 03 03 0007 0002")) == b""
    assert tcp.say(READ_2_OF_TCP).startswith(ANSWER_OF_TCP)
