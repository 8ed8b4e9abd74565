"""Every wait of a stage driver has an end, and it is the one that was meant: to the millisecond of the virtual clock.

The far end is a controller that answers, and never comes to what is waited for.
"""

from collections.abc import Callable
from typing import Any

import pytest

from rig.devices.base import StageAlarm, StageError, StageTimeout
from rig.devices.grbl import GrblStage
from rig.devices.leadshine import LeadshineStage
from rig.devices.leadshine_drive import LeadshineDrive
from rig.settings import DriveSettings
from rig.transport.modbus import ModbusMaster
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.scripted_board import Board, connected


def _grbl(clock: VirtualClock, status: bytes, **options: Any) -> tuple[Board, GrblStage]:
    clock.wait_s(1000.0)
    board = Board(clock, status)
    board.answers[b"\x18"] = b""
    stage = connected(board, homed=False, **options)
    stage._link.trusted = True
    return board, stage


def _lasts_s(clock: VirtualClock, act: Callable[[], object], code: str, **fields: Any) -> float:
    begun_s = clock.monotonic_s()
    with raises(StageTimeout, code, **fields):
        act()
    return clock.monotonic_s() - begun_s


def test_a_board_that_never_homes(clock: VirtualClock) -> None:
    board, stage = _grbl(clock, b"<Home|MPos:0,0,0>\r\n")
    board.answers[b"$H\n"] = b""
    assert _lasts_s(clock, stage.home, "no_reply", line="$H", timeout_s=180.0) == pytest.approx(180.0)
    assert not stage.homed


def test_a_board_that_never_arrives(clock: VirtualClock) -> None:
    """10 mm at 1 mm/s and 50 mm/s² are 10.02 s: half as much again and five seconds more, seen at the next poll."""
    _, stage = _grbl(clock, b"<Run|MPos:-1.000,-2.000,-3.000>\r\n")
    stage.status()
    lasted_s = _lasts_s(clock, lambda: stage.move_to(x_mm=-11.0, speed_mm_s=1.0), "not_over", state="Run")
    assert lasted_s == pytest.approx(1.5 * 10.02 + 5.0, abs=0.021)


def test_a_board_that_never_comes_to_rest(clock: VirtualClock) -> None:
    board, stage = _grbl(clock, b"<Run|MPos:-1.000,-2.000,-3.000>\r\n")
    assert _lasts_s(clock, stage.halt, "not_at_rest", timeout_s=2.0, state="Run") == pytest.approx(2.0, abs=0.021)
    assert board.said[0] == b"!"
    assert b"\x18" not in board.said  # a reset in motion would lose the position


@pytest.mark.parametrize(("printed", "fine"), [("-11.002", True), ("-11.003", False)])
def test_an_arrival_is_within_a_step(clock: VirtualClock, printed: str, fine: bool) -> None:
    """Of 0.0025 mm."""
    _, stage = _grbl(clock, f"<Idle|MPos:{printed},0.000,0.000>\r\n".encode())
    if fine:
        stage.move_to(x_mm=-11.0, speed_mm_s=1.0)
    else:
        with raises(StageError, "not_there", axis="X", at_mm=-11.003, target_mm=-11.0):
            stage.move_to(x_mm=-11.0, speed_mm_s=1.0)


def test_a_work_offset_is_waited_for_in_thirty_six_answers(clock: VirtualClock) -> None:
    """A board tells it in every tenth to thirtieth."""
    board, stage = _grbl(clock, b"<Idle|WPos:0.000,0.000,0.000>\r\n")
    with raises(StageError, "no_position"):
        stage.status()
    assert board.said.count(b"?") == 36


@pytest.mark.parametrize(("pieces", "fine"), [(4, True), (5, False)])
def test_a_look_takes_in_four_pieces_of_news(clock: VirtualClock, pieces: int, fine: bool) -> None:
    """An alarm, the banner after it, and one more of each."""
    board, stage = _grbl(clock, b"<Idle|MPos:0.000,0.000,0.000>\r\n")
    news, write = [b"ALARM:1\r\n"] * pieces, board.write

    def first_the_news(data: bytes) -> None:
        if news:
            board.says(news.pop(), -1e-9)
        write(data)

    board.write = first_the_news  # type: ignore[method-assign]
    if fine:
        assert stage.look().state == "Idle"
    else:
        with raises(StageAlarm, "alarm"):
            stage.look()


def test_without_backlash_a_move_is_one_line(clock: VirtualClock) -> None:
    board, stage = _grbl(clock, b"<Idle|MPos:-1.000,-1.000,-1.000>\r\n")
    stage.status()
    stage.move_to(x_mm=-1.0, y_mm=-1.0, z_mm=-1.0, speed_mm_s=1.0)
    board.status = b"<Idle|MPos:-0.500,-0.500,-0.500>\r\n"
    stage.move_to(x_mm=-0.5, y_mm=-0.5, z_mm=-0.5, speed_mm_s=1.0)
    assert len([line for line in board.said if line.startswith(b"G1")]) == 2


def test_a_held_board_that_does_not_go_on(clock: VirtualClock) -> None:
    _, stage = _grbl(clock, b"<Hold:0|MPos:0.000,0.000,0.000>\r\n")
    assert _lasts_s(clock, stage.resume, "still_held", timeout_s=5.0) == pytest.approx(5.0, abs=0.021)


@pytest.mark.parametrize("after", ["Idle", "Alarm"])
def test_a_halt_that_ends_in_an_alarm_has_lost_the_position(clock: VirtualClock, after: str) -> None:
    board, stage = _grbl(clock, b"<Hold:0|MPos:-5.000,0.000,0.000>\r\n")
    board.answers[b"\x18"] = b"\r\nGrbl 1.1h ['$' for help]\r\n"
    write = board.write

    def reset(data: bytes) -> None:
        if data == b"\x18":
            board.status = f"<{after}|MPos:-5.000,0.000,0.000>\r\n".encode()
        write(data)

    board.write = reset  # type: ignore[method-assign]
    if after == "Idle":
        stage.halt()
    else:
        with raises(StageError, "lost_in_halt", state="Alarm"):
            stage.halt()
    assert stage.homed is (after == "Idle")
    assert board.said == [b"!", b"?", b"\x18", b"?"]


def test_an_identity_is_what_stands_in_brackets_and_is_no_message(clock: VirtualClock) -> None:
    board = Board(clock, b"")
    board.answers[b"$I\n"] = b"[MSG:'$H'|'$X' to unlock]\r\n[VER:1.1h:]\r\n$10=1\r\n[OPT:V,15,128]\r\nok\r\n"
    assert GrblStage(board, clock).connect() == "[VER:1.1h:] [OPT:V,15,128]"


def test_a_status_without_a_position_is_asked_again_though_the_offset_is_known(clock: VirtualClock) -> None:
    board, stage = _grbl(clock, b"<Idle|WPos:1.000,1.000,1.000|WCO:-3.000,-3.000,-3.000>\r\n")
    stage.status()
    answers = [b"<Idle|WPos:2.000,1.000,1.000>\r\n", b"<Idle|FS:0,0>\r\n"]
    write = board.write

    def one_by_one(data: bytes) -> None:
        board.status = answers.pop()
        write(data)

    board.write = one_by_one  # type: ignore[method-assign]
    assert stage.status().x_mm == -1.0


@pytest.mark.parametrize(
    ("to_mm", "gone_mm"),
    [(-0.015, [0.9998, -0.0148]), (-0.5, [0.52, -0.02]), (-1.0, [0.0]), (-2.0, [-1.0])],
)
def test_backlash_is_taken_up_on_the_way_up_and_not_beyond_the_top(
    clock: VirtualClock, to_mm: float, gone_mm: list[float]
) -> None:
    """10 µm of it, from −1 mm; where nothing moves there is nothing to take up."""
    board, stage = _grbl(clock, b"<Idle|MPos:0.000,0.000,-1.000>\r\n", backlash_mm=(0.0, 0.0, 0.01))
    stage.status()
    write, by_mm = board.write, list[float]()

    def arrived(data: bytes) -> None:
        if data.startswith(b"G92"):
            by_mm.append(-float(data[5:].split(b"Z")[1].split(b"G")[0]))
        if data == b"G1Z0\n":
            board.status = f"<Idle|MPos:0.000,0.000,{-1.0 + sum(by_mm):.3f}>\r\n".encode()
        write(data)

    board.write = arrived  # type: ignore[method-assign]
    stage.move_to(z_mm=to_mm, speed_mm_s=1.0)
    assert by_mm == pytest.approx(gone_mm)


def test_a_board_that_jogs_on(clock: VirtualClock) -> None:
    board, stage = _grbl(clock, b"<Jog|MPos:0.000,0.000,0.000>\r\n")
    write = board.write

    def creeping(data: bytes) -> None:
        board.status = f"<Jog|MPos:{clock.monotonic_s():.3f},0.000,0.000>\r\n".encode()
        write(data)

    board.write = creeping  # type: ignore[method-assign]
    assert _lasts_s(clock, stage.end_jog, "still_jogging", timeout_s=5.0) == pytest.approx(5.0, abs=0.021)
    assert board.said.count(b"\x85") == pytest.approx(5.0 / 0.5, rel=0.1)


def test_a_board_that_says_jog_and_stands_is_at_rest(clock: VirtualClock) -> None:
    """Half a second: longer than a step of 1/400 mm takes at 1 mm/min, the slowest there is."""
    _board, stage = _grbl(clock, b"<Jog|MPos:0.000,0.000,0.000>\r\n")
    begun_s = clock.monotonic_s()
    stage.end_jog()
    assert clock.monotonic_s() - begun_s == pytest.approx(0.5, abs=0.021)


def test_what_a_board_takes_for_a_millimetre_has_the_sign_of_its_motor(clock: VirtualClock) -> None:
    board = Board(clock, b"")
    board.answers[b"$$\n"] = b"$3=5\r\n$13=0\r\n$100=400.0\r\n$101=250.0\r\n$102=80.0\r\nok\r\n"
    stage = GrblStage(board, clock)
    stage.connect()
    assert [stage.steps_per_mm(axis) for axis in ("x", "y", "z")] == [-400.0, 250.0, -80.0]


@pytest.mark.parametrize(
    ("from_mm", "expected_s"),
    [(None, 0.0), (b"-1.000,-2.000,-3.000", 10.02), (b"-11.000,-2.000,-3.000", 0.0)],
    ids=["from nobody knows where", "10 mm", "nowhere"],
)
def test_a_move_is_given_the_time_that_the_boards_own_limits_ask_for(
    clock: VirtualClock, from_mm: bytes | None, expected_s: float
) -> None:
    """5 mm/s are asked for; X may do 60 mm/min, 1 mm/s, at 50 mm/s²; the other axes' limits do not count."""
    board = Board(clock, b"<Idle|MPos:%s>\r\n" % (from_mm or b"-11.000,-2.000,-3.000"))
    board.answers[b"$$\n"] = (
        b"$13=0\r\n$100=400.0\r\n$110=60.0\r\n$111=6.0\r\n$112=6.0\r\n$120=50.0\r\n$121=1.0\r\nok\r\n"
    )
    stage = GrblStage(board, clock)
    stage.connect()
    stage._link.trusted = True
    if from_mm is not None:
        stage.status()
    board.status = b"<Idle|MPos:-11.000,-2.000,-3.000>\r\n"
    begun_s = clock.monotonic_s()
    stage.move_to(x_mm=-11.0, speed_mm_s=5.0)
    assert clock.monotonic_s() - begun_s == pytest.approx(expected_s)


# --- drives ---


class Drive:
    """A drive's registers, 0 where nothing is said; writes are taken and echoed, and nothing ever comes of them."""

    name = "drive"

    def __init__(self, clock: VirtualClock, rtu: Callable[[str], bytes], status: int) -> None:
        self.clock, self.rtu = clock, rtu
        self.registers = {0x1003: status, 0x0001: 400}
        self.asked: list[tuple[float, bytes]] = []
        self._waiting = b""

    def write(self, data: bytes) -> None:
        self.asked.append((self.clock.monotonic_s(), data))
        address, count = int.from_bytes(data[2:4]), int.from_bytes(data[4:6])
        if data[1] == 3:
            words = "".join(f" {self.registers.get(address + n, 0):04X}" for n in range(count))
            self._waiting += self.rtu(f"{data[0]:02X} 03 {2 * count:02X}{words}")
        elif data[1] == 6:
            self._waiting += data
        else:
            for n in range(count):
                self.registers[address + n] = int.from_bytes(data[7 + 2 * n : 9 + 2 * n])
            self._waiting += self.rtu(data[:6].hex(" "))

    def read(self, timeout_s: float) -> bytes:
        data, self._waiting = self._waiting, b""
        if not data:
            self.clock.wait_s(timeout_s)
        return data

    def close(self) -> None: ...


ENABLED, RUNNING = 0x02, 0x46  # homed, too


def _drive(clock: VirtualClock, rtu: Callable[[str], bytes], status: int) -> tuple[Drive, LeadshineStage]:
    wire = Drive(clock, rtu, status)
    bus = ModbusMaster(wire, clock)
    x, z = (
        LeadshineDrive(bus, clock, axis, DriveSettings(device_id=n), pulses_per_mm=400.0, travel_mm=60.0)
        for n, axis in ((1, "x"), (2, "z"))
    )
    stage = LeadshineStage(x, z, inputs_register=0x0179)
    stage._trusted = True
    return wire, stage


def test_a_drive_that_never_homes(clock: VirtualClock, rtu: Callable[[str], bytes]) -> None:
    _, stage = _drive(clock, rtu, ENABLED)
    assert _lasts_s(clock, stage.home, "not_over", what="homing", timeout_s=180.0) == pytest.approx(180.0, abs=0.1)


def test_a_drive_that_never_arrives(clock: VirtualClock, rtu: Callable[[str], bytes]) -> None:
    """10 mm at 1 mm/s, 60 rpm with ramps of 20 ms: 10.02 s, half as much again, and five seconds."""
    _, stage = _drive(clock, rtu, RUNNING)
    lasted_s = _lasts_s(
        clock, lambda: stage.move_to(x_mm=-10.0, speed_mm_s=1.0), "not_over", what="the move to -10 mm"
    )
    assert lasted_s == pytest.approx(1.5 * 10.02 + 5.0, abs=0.1)


def test_a_drive_that_never_stops(clock: VirtualClock, rtu: Callable[[str], bytes]) -> None:
    """A second for each, told again every 20 ms and some for the answers."""
    wire, stage = _drive(clock, rtu, RUNNING)
    lasted_s = _lasts_s(clock, stage.halt, "still_runs", timeout_s=1.0)
    assert lasted_s == pytest.approx(1.0, abs=0.05)
    assert sum(data[:6] == bytes.fromhex("02 06 60 02 00 40") for _, data in wire.asked) > 20


def test_a_drive_on_its_way_is_asked_for_alarms_every_quarter_of_a_second(
    clock: VirtualClock, rtu: Callable[[str], bytes]
) -> None:
    wire, stage = _drive(clock, rtu, RUNNING)
    with raises(StageTimeout, "not_over"):
        stage.move_to(x_mm=-10.0, speed_mm_s=1.0)
    asked_s = [t_s for t_s, data in wire.asked if data[1:4] == bytes.fromhex("03 10 03") and data[0] == 1]
    under_way = [t_s for t_s in asked_s if asked_s[0] < t_s < asked_s[0] + 9.0]
    assert len(under_way) == pytest.approx(9.0 / 0.25, rel=0.1)


@pytest.mark.parametrize(("pulses", "fine"), [(4001, True), (4002, False)])
def test_a_drives_arrival_is_within_a_step(
    clock: VirtualClock, rtu: Callable[[str], bytes], pulses: int, fine: bool
) -> None:
    wire, stage = _drive(clock, rtu, 0x72)
    wire.registers |= {0x602C: 0xFFFF, 0x602D: (-4000) & 0xFFFF, 0x1014: 0xFFFF, 0x1015: -pulses & 0xFFFF}
    if fine:
        stage.move_to(x_mm=-10.0, speed_mm_s=1.0)
    else:
        with raises(StageError, "not_there", at_mm=-10.005, target_mm=-10.0):
            stage.move_to(x_mm=-10.0, speed_mm_s=1.0)
