"""Bytes in, bytes out of the virtual GRBL board: one conversation for each fact of the interface."""

from collections.abc import Callable
from types import EllipsisType
from typing import Any

import pytest

from sim.devices import Mechanics, SerialLine, VirtualGrbl
from sim.devices.clock import VirtualClock

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
UNLOCK = b"[MSG:'$H'|'$X' to unlock]\r\n"
RUN = b"G53G1X-20F600\n"
"""19 mm at 10 mm/s."""


class Host:
    """Has a board at the end of a fast line."""

    def __init__(self, **options: Any) -> None:
        self.clock = VirtualClock()
        self.line = SerialLine(self.clock, 1e7)
        self.board = VirtualGrbl(self.clock, self.line, **options)

    def say(self, data: bytes, wait_s: float = 0.01) -> bytes:
        self.line.host_write(data)
        return self.hear(wait_s)

    def hear(self, wait_s: float = 0.01) -> bytes:
        self.clock.wait_s(wait_s)
        return self.line.host_read()

    def steps(self) -> tuple[int, int, int]:
        return self.board.carriage_steps_at(self.clock.monotonic_s())

    def state(self) -> bytes:
        return self.say(b"?").split(b"|")[0]


def _homed(**options: Any) -> Host:
    """At -1, -1, -1, nothing left to hear."""
    host = Host(**options)
    host.say(b"$H\n", 60.0)
    host.say(b"??", 0.1)
    return host


def _locked() -> Host:
    """As it is when it is switched on, which it has said."""
    host = Host()
    host.hear()
    return host


def _free(**options: Any) -> Host:
    """Without homing and soft limits, at the place it woke up at."""
    host = Host(settings={20: 0, 22: 0}, **options)
    host.hear()
    return host


@pytest.fixture
def host() -> Host:
    return _homed()


@pytest.fixture
def locked() -> Host:
    return Host()


@pytest.fixture
def free() -> Host:
    return _free()


# --- conversations ---

Say = tuple[bytes | float | EllipsisType, ...]
"""What is sent; seconds of waiting if not 0.01; the reply: as it stands, or with ... for what may be anything."""

Fact = str | int | tuple[int, int, int] | Say
"""A state, the carriage's steps along x or all axes, or something said."""


def _check(host: Host, fact: Any) -> None:
    if isinstance(fact, str):
        assert host.state() == b"<" + fact.encode()
    elif isinstance(fact, int):
        assert host.steps()[0] == fact
    elif isinstance(fact[0], int):
        assert host.steps() == fact
    else:
        data, *reply = fact
        heard = host.say(data, reply.pop(0)) if reply and isinstance(reply[0], float) else host.say(data)
        if reply and reply[0] is not ...:
            assert heard.startswith(reply[0])
        if reply and reply[-1] is not ...:
            assert heard.endswith(reply[-1])
        assert len(reply) != 1 or heard == reply[0]
        assert all(one in heard for one in reply if one is not ...)


ASK = b"?"
CONVERSATIONS: dict[str, tuple[Callable[[], Host], *tuple[Fact, ...]]] = {
    # banner, lock, identity
    "banner and lock at power on": (Host, (b"", BANNER + UNLOCK), "Alarm"),
    "no lock without homing": (lambda: Host(settings={20: 0, 22: 0}), (b"", BANNER), "Idle"),
    "a reset at rest prints the banner and keeps the lock": (_locked, (b"\x18", BANNER + UNLOCK)),
    "a reset at rest keeps the position and sets no lock": (
        _homed, (b"\x18", BANNER), (ASK, b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0|WCO:", ...),
    ),
    "a host that came late can ask": (_homed, (b"$I\n", b"[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n")),
    # one answer a line
    "one answer for each line": (_homed, (b"G90\nG91\nnonsense\nG90\n", b"ok\r\nok\r\nerror:2\r\nok\r\n")),
    "everything is locked in alarm": (
        _locked,
        (b"G91\nG0X1\n$J=G91X1F100\n", b"error:9\r\n" * 2 + b"error:8\r\n"),
        (b"$X\n", b"[MSG:Caution: Unlocked]\r\nok\r\n"),
        (b"G91\n", b"ok\r\n"),
    ),
    # settings
    "soft limits need homing": (
        _homed, (b"$22=0\n", b"ok\r\n"), (b"$$\n", ..., b"$20=0\r\n", ...), (b"$20=1\n", b"error:10\r\n"),
    ),
    # status
    "a status leaves the buffer out unless asked": (
        _homed,
        (ASK, b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\n"),
        (b"$10=3\n",),
        (ASK, b"<Idle|MPos:-1.000,-1.000,-1.000|Bf:15,128|FS:0,0>\r\n"),
    ),
    "a work position is the machine's less the offset": (
        lambda: Host(settings={10: 0}, work_offset_mm=(-10.0, 0.0, 2.5)),
        (b"$H\n", 60.0),
        (ASK, b"<Idle|WPos:9.000,-1.000,-3.500|FS:0,0|WCO:-10.000,0.000,2.500>\r\n"),
    ),
    "a status in motion shows state, place and feed": (
        _homed, (RUN, 1.0), (ASK, b"<Run|MPos:-10.", ..., b"|FS:600,0", ...),
    ),
    "real-time bytes are picked out of the middle of a line": (
        _homed,
        (b"G53G1?X-2F600\n", 0.001, b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\nok\r\n"),
        (b"", 2.0),
        -800,
    ),
    "unknown high bytes are dropped": (_homed, (b"G\xff9\x900\n", b"ok\r\n")),
    # ok means queued
    "ok means queued, not done": (_homed, (RUN, b"ok\r\n"), "Run"),
    # hold, door, resume
    "a resume during the slowing down is lost": (_homed, (RUN, 1.0), (b"!", 0.1), (b"~", 1.0), "Hold:0"),
    "lines wait while held": (_homed, (b"!",), "Hold:0", (b"G90\n", b""), (b"~", b"ok\r\n"), "Idle"),
    "a reset in a hold at rest sets no lock": (
        _homed,
        (b"!",),
        (b"\x18", BANNER),
        (ASK, b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n"),
    ),
    "a reset in a hold that still slows down is alarm 3 and locks": (
        _homed,
        (RUN, 1.0),
        (b"!", 0.1, b""),
        (ASK, 0.05, b"<Hold:1|", ...),
        (b"\x18", 0.1, b"ALARM:3\r\n"),
        (b"", 1.0, BANNER + UNLOCK),
        "Alarm",
    ),
    "door": (
        _homed, (RUN, 1.0), (b"\x84", b"[MSG:Check Door]\r\n"), "Door:2", (b"", 1.0), "Door:0", (b"~", 5.0), -8000,
    ),
    # jog
    "a hold cancels a jog": (_homed, (b"$J=G91X-10F600\n", 0.5), (b"!",), "Jog", (b"", 1.0), "Idle"),
    "door in a jog": (_homed, (b"$J=G91X-10F600\n", 0.5), (b"\x84", 1.0), "Door:0", (b"~",), "Idle"),
    "a jog beyond the travel is refused and does not move": (
        _homed,
        (b"$J=G91X2F100\n", b"error:15\r\n"),
        (b"$J=G53X-60.1F100\n", b"error:15\r\n"),
        "Idle",
        (-400, -400, -400),
    ),
    # alarms
    "soft limit: alarm, then silence until a reset": (
        _homed,
        (b"G53G1X1F100\n", 0.1, b"ALARM:2\r\n"),
        (b"", 1.0, b"[MSG:Reset to continue]\r\n"),
        (b"?$X\nG90\n$I\n~!", 10.0, b""),
        (b"\x18", b"ok\r\n" + BANNER + UNLOCK),
        (b"G90\n", b"error:9\r\n"),
        (b"$X\n", ..., b"ok\r\n"),
        (ASK, b"<Idle|MPos:-1.000,-1.000,-1.000|", ...),
    ),
    "a reset while the soft limit's alarm is printed is lost": (
        _homed,
        (b"G53G1X1F100\n", 0.1),
        (b"\x18", 5.0, b"[MSG:Reset to continue]\r\n"),
        (b"\x18", ..., BANNER, ...),
    ),
    "a reset while slowing down is alarm 3": (
        _homed, (RUN, 1.0), (b"!\x18", 1.0, b"ALARM:3\r\n" + BANNER + UNLOCK),
    ),
    "a reset gives the ok of the line under way": (
        _homed, (RUN + b"G4P1\n", 1.0), (b"\x18", 1.0, b"ALARM:3\r\nok\r\n" + BANNER + UNLOCK),
    ),
    "after a reset in motion the board may be wrong about the carriage": (
        lambda: Host(mechanics=Mechanics(slip_steps=7)),
        (b"$H\n", 60.0),
        (RUN, 1.0),
        (b"\x18", 1.0),
        (b"$X\nG53G1X-5F600\n", 10.0),
        -5 * 400 - 7,
        (ASK, b"<Idle|MPos:-5.000,", ...),
    ),
    "unlocked without homing the board takes its place for zero": (
        Host, (b"$X\nG91G1X-2F600\n", 5.0), -32 * 400, (ASK, b"<Idle|MPos:-2.000,", ...),
    ),
    "a reset in homing is alarm 6": (
        _locked, (b"$H\n", 1.0), (b"\x18", 1.0, b"ALARM:6\r\nok\r\n" + BANNER + UNLOCK),
    ),
    "the door in homing is alarm 7": (
        _locked, (b"$H\n", 1.0), (b"\x84", 1.0, b"ALARM:7\r\nok\r\n" + BANNER + UNLOCK),
    ),
    # g-code
    "inches and relative moves": (_homed, (b"G20G91G1X-0.1F20\n", 20.0), -400 - 1016),
    "work coordinates move what follows": (  # G54 by G10 L20, G92 on top, a stored place by G28.1, and back to it
        _homed,
        (b"G10L20P1X0Y0Z0\nG92X1\nG1X-1F600\n", 2.0),
        (-1200, -400, -400),
        (b"G28.1\nG1X-3\n", 2.0),
        -2000,
        (ASK, ..., b"|WCO:-2.000,-1.000,-1.000>\r\n"),
        (b"G28Z-1\n", 5.0),
        (-2000, -400, -400),  # only the axis that was named, there and back
        (b"G92.1\nG54X-3F600G1\n", 2.0),
        -1600,
    ),
    "G53 ignores offset and relative mode": (
        lambda: Host(work_offset_mm=(-10.0, 0.0, 0.0)),
        (b"$H\n", 60.0),
        (b"G91G53G1X-5F600\n", 5.0),
        -2000,
        (b"G90G1X-5\n", 5.0),
        -6000,
    ),
    "a move to where it is does nothing": (_homed, (b"G53G1X-1F600\n", b"ok\r\n"), "Idle"),
}  # fmt: skip


@pytest.mark.parametrize("name", CONVERSATIONS)
def test_the_virtual_board_answers_each_line_as_grbl_documents(name: str) -> None:
    begun, *facts = CONVERSATIONS[name]
    host = begun()
    for fact in facts:
        _check(host, fact)


# --- what is not said in so few words ---


def test_a_power_cycle_in_motion_locks_the_virtual_board_and_resets_its_position(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 1.0)
    host.board.power_cycle()
    assert host.hear() == BANNER + UNLOCK
    assert host.say(b"?").startswith(b"<Alarm|MPos:0.000,0.000,0.000|")
    assert -20 * 400 < host.steps()[0] < -400


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (b"G43", 20), (b"G10L3P1X0", 20), (b"M7", 20), (b"M8M9", 21), (b"$J=M8X1F100", 16), (b"S-1", 4),
        (b"G2X1Y1R1F100", 20),
        (b"G38.2Z-1F10", 20), (b"A1", 20), (b"G1X-2", 22), (b"G1X-2F0", 22),
        (b"G1X-2F-3", 4), (b"G0G1X-2", 24), (b"X-2X-3", 25), (b"G4", 28),
        (b"G4P-1", 4), (b"=", 1), (b"GX", 2), (b"G0X-2P1", 36),
        (b"$J=G91X-1", 22), (b"$J=G91P1X1F100", 36), (b"$J=G91G1X-1F100", 16), (b"$JG91X1F100", 3),
        (b"$999=1", 3), (b"$100", 3), (b"$100=x", 2), (b"$foo", 2),
        (b"$110=-1", 4), (b"$0=1", 6), (b"$100=0", 4),
    ],
)  # fmt: skip
def test_the_virtual_board_answers_each_bad_line_with_the_error_of_grbl(host: Host, line: bytes, code: int) -> None:
    assert host.say(line + b"\n") == b"error:%d\r\n" % code
    assert host.steps() == (-400, -400, -400)


def test_status_reports_carry_wco_and_ov_every_tenth_time(host: Host) -> None:
    host.say(b"\x18")
    lines = [host.say(b"?") for _ in range(40)]
    assert [i for i, line in enumerate(lines) if b"|WCO:" in line] == [0, 10, 20, 30]
    assert [i for i, line in enumerate(lines) if b"|Ov:100,100,100" in line] == [1, 11, 21, 31]


def test_a_hold_and_reset_drop_the_planned_moves_and_keep_the_position() -> None:
    host = Host(mechanics=Mechanics(slip_steps=7, play_steps=(3.0, 3.0, 3.0)))
    host.say(b"$H\n", 60.0)
    assert host.say(b"??") != b""  # WCO and Ov
    # Ten moves planned, a dwell under way, a line in the receive buffer.
    assert host.say(b"G91G1X-20F600\n" + b"X-1\nY-1\n" * 4 + b"G4P1\nG90\n", 1.0) == b"ok\r\n" * 9
    assert host.say(b"!", 1.0) == b""
    assert host.say(b"?") == b"<Hold:0|MPos:-11.400,-1.000,-1.000|FS:0,0>\r\n"
    held = host.steps()
    assert host.say(b"\x18", 0.1) == b"ok\r\n" + BANNER
    assert host.say(b"?") == b"<Idle|MPos:-11.400,-1.000,-1.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n"
    assert host.say(b"~", 30.0) == b""
    assert host.steps() == held == (-4560, -400, -400)
    # No lock, nothing left in planner, parser or buffer, and the board is still right about its carriage.
    assert host.say(b"G91G1X-1F600\n", 0.4) == b"ok\r\n"
    assert host.steps() == (-4960, -400, -400)
    assert host.say(b"?") == b"<Idle|MPos:-12.400,-1.000,-1.000|FS:0,0|Ov:100,100,100>\r\n"
    assert host.say(b"G4P0.01\n", 0.1) == b"ok\r\n"


def test_a_reset_in_motion_raises_alarm_3_and_locks_the_virtual_board(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 1.0)
    before = host.steps()
    assert host.say(b"\x18", 0.1) == b"ALARM:3\r\n"
    stopped = host.steps()
    assert before[0] - 5 < stopped[0] <= before[0]
    assert host.say(b"?\x18", 0.1) == b""
    assert host.hear(1.0) == BANNER + UNLOCK
    assert host.say(b"G53G1X-2F100\n") == b"error:9\r\n"
    assert host.steps() == stopped


def test_the_virtual_board_is_silent_while_homing_and_ends_at_the_pull_off(locked: Host) -> None:
    locked.hear()
    assert locked.say(b"$H\n", 1.0) == b""
    assert locked.steps() == (-12000, -6000, -4000 + 1900)
    assert locked.say(b"??", 1.0) == b""
    locked.clock.wait_until(locked.line.host_pending, 60.0)
    # The status asked for meanwhile comes once, at the end.
    assert locked.hear() == b"<Home|MPos:-1.000,-1.000,-1.000|FS:0,0|WCO:0.000,0.000,0.000>\r\nok\r\n"
    assert 10.0 < locked.clock.monotonic_s() < 25.0
    assert locked.steps() == (-400, -400, -400)
    assert locked.state() == b"<Idle"


def test_the_virtual_board_switches_and_reports_coolant_and_spindle(host: Host) -> None:
    assert host.say(b"M8\n") == b"ok\r\n"
    assert b"|Ov:100,100,100|A:F>" in host.say(b"?")
    assert host.say(b"M3 S500\n") == b"ok\r\n"
    status = host.say(b"?")
    assert b"|FS:0,500|" in status
    assert b"|A:SF>" in status
    assert b"M3 M8 T0 F0 S500]" in host.say(b"$G\n")
    assert host.say(b"M5M9\n") == b"ok\r\n"
    assert b"A:" not in host.say(b"?")
    assert [word for _, word in host.board.outputs] == ["M8", "M3", "M5", "M9"]


def test_the_virtual_board_answers_a_flood_of_status_requests_by_a_few_reports(host: Host) -> None:
    """On a line at 115200 baud; what asks while a report waits for its place to be sent is forgotten."""
    clock = VirtualClock()
    line = SerialLine(clock, 115200)
    VirtualGrbl(clock, line, settings={20: 0, 22: 0})
    clock.wait_s(0.1)
    line.host_read()
    line.host_write(b"?" * 50)
    clock.wait_s(1.0)
    assert 1 <= line.host_read().count(b"<Idle") <= 5
    line.host_write(b"?")
    clock.wait_s(0.1)
    assert line.host_read().count(b"<Idle") == 1


@pytest.mark.parametrize(("axis", "rate"), [(b"X", b"600"), (b"Z", b"300")])
def test_each_axis_of_the_virtual_board_has_its_own_highest_rate(free: Host, axis: bytes, rate: bytes) -> None:
    free.say(b"G91G0%s-20\n" % axis, 1.0)
    assert b"|FS:%s,0" % rate in free.say(b"?")
