"""Bytes in, bytes out of the virtual GRBL board: one test for each fact of the interface."""

from typing import Any

import pytest

from sim.devices import Mechanics, SerialLine, VirtualGrbl
from sim.devices.clock import VirtualClock

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
UNLOCK = b"[MSG:'$H'|'$X' to unlock]\r\n"


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


@pytest.fixture
def locked() -> Host:
    return Host()


@pytest.fixture
def host() -> Host:
    """Homed, at -1, -1, -1, nothing left to hear."""
    host = Host()
    host.say(b"$H\n", 60.0)
    host.say(b"??", 0.1)
    return host


@pytest.fixture
def free() -> Host:
    """Without homing and soft limits, at the place it woke up at."""
    host = Host(settings={20: 0, 22: 0})
    host.hear()
    return host


# --- banner, lock, identity ---


def test_banner_and_lock_at_power_on(locked: Host) -> None:
    assert locked.hear() == BANNER + UNLOCK
    assert locked.state() == b"<Alarm"


def test_no_lock_without_homing() -> None:
    host = Host(settings={20: 0, 22: 0})
    assert host.hear() == BANNER
    assert host.state() == b"<Idle"


def test_reset_at_rest_prints_the_banner_and_keeps_the_lock(locked: Host) -> None:
    locked.hear()
    assert locked.say(b"\x18") == BANNER + UNLOCK


def test_reset_at_rest_keeps_the_position_and_sets_no_lock(host: Host) -> None:
    assert host.say(b"\x18") == BANNER
    assert host.say(b"?").startswith(b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0|WCO:")


def test_a_host_that_came_late_can_ask(host: Host) -> None:
    assert host.say(b"$I\n") == b"[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n"


def test_power_cycle_in_motion_locks_and_forgets_where_it_is(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 1.0)
    host.board.power_cycle()
    assert host.hear() == BANNER + UNLOCK
    assert host.say(b"?").startswith(b"<Alarm|MPos:0.000,0.000,0.000|")
    assert -20 * 400 < host.steps()[0] < -400


# --- one answer a line ---


def test_one_answer_for_each_line(host: Host) -> None:
    assert host.say(b"G90\nG91\nnonsense\nG90\n") == b"ok\r\nok\r\nerror:2\r\nok\r\n"


def test_carriage_return_and_line_feed_are_two_ends(host: Host) -> None:
    assert host.say(b"G90\r\n") == b"ok\r\nok\r\n"


def test_lower_case_spaces_and_comments(host: Host) -> None:
    assert host.say(b" g90 (absolute) g21 ; and millimetres\n") == b"ok\r\n"


def test_everything_is_locked_in_alarm(locked: Host) -> None:
    locked.hear()
    assert locked.say(b"G91\nG0X1\n$J=G91X1F100\n") == b"error:9\r\n" * 2 + b"error:8\r\n"
    assert locked.say(b"$X\n") == b"[MSG:Caution: Unlocked]\r\nok\r\n"
    assert locked.say(b"G91\n") == b"ok\r\n"


def test_79_characters_are_a_line_and_80_are_too_many(host: Host) -> None:
    line = b"G90" + b"N1".ljust(76, b"0")
    assert len(line) == 79
    assert host.say(line + b"\n") == b"ok\r\n"
    assert host.say(line + b"0\n") == b"error:11\r\n"
    assert host.say(b" " * 40 + line + b"(" + b"x" * 60 + b")\n") == b"ok\r\n"


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
def test_errors(host: Host, line: bytes, code: int) -> None:
    assert host.say(line + b"\n") == b"error:%d\r\n" % code
    assert host.steps() == (-400, -400, -400)


# --- settings ---


def test_settings_are_listed_and_stored(host: Host) -> None:
    listing = host.say(b"$$\n")
    assert listing.startswith(b"$0=10\r\n$1=255\r\n")
    assert b"$11=0.010\r\n" in listing
    assert b"$100=400.000\r\n" in listing
    assert listing.endswith(b"$132=40.000\r\nok\r\n")
    assert host.say(b"$120=25\n") == b"ok\r\n"
    assert b"$120=25.000\r\n" in host.say(b"$$\n")


def test_the_rig_s_settings(host: Host) -> None:
    """400 steps/mm, 10 mm/s (Z 5), 50 mm/s², 60 × 30 × 40 mm; homing and soft limits on."""
    assert host.say(b"$$\n").decode().split() == [
        *("$0=10", "$1=255", "$2=0", "$3=0", "$4=0", "$5=0", "$6=0", "$10=1", "$11=0.010", "$12=0.002", "$13=0"),
        *("$20=1", "$21=0", "$22=1", "$23=0", "$24=25.000", "$25=300.000", "$26=250", "$27=1.000"),
        *("$30=1000", "$31=0", "$32=0", "$100=400.000", "$101=400.000", "$102=400.000"),
        *("$110=600.000", "$111=600.000", "$112=300.000", "$120=50.000", "$121=50.000", "$122=50.000"),
        *("$130=60.000", "$131=30.000", "$132=40.000", "ok"),
    ]


def test_soft_limits_need_homing(host: Host) -> None:
    assert host.say(b"$22=0\n") == b"ok\r\n"
    assert b"$20=0\r\n" in host.say(b"$$\n")
    assert host.say(b"$20=1\n") == b"error:10\r\n"


def test_settings_and_identity_only_at_rest(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 0.5)
    assert host.say(b"$$\n$I\n$120=10\n$H\n$#\n$G\n").startswith(b"error:8\r\n" * 5 + b"[GC:G1 G54 G17 G21 G90")


def test_parameters(host: Host) -> None:
    assert host.say(b"$#\n").startswith(b"[G54:0.000,0.000,0.000]\r\n[G55:")
    assert host.say(b"$#\n").endswith(b"[TLO:0.000]\r\n[PRB:0.000,0.000,0.000:0]\r\nok\r\n")


def test_homing_switched_off_is_error_5(free: Host) -> None:
    assert free.say(b"$H\n") == b"error:5\r\n"


# --- status ---


def test_status_leaves_the_buffer_out_unless_asked(host: Host) -> None:
    assert host.say(b"?") == b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\n"
    host.say(b"$10=3\n")
    assert host.say(b"?") == b"<Idle|MPos:-1.000,-1.000,-1.000|Bf:15,128|FS:0,0>\r\n"


def test_work_position_is_machine_position_less_the_offset() -> None:
    host = Host(settings={10: 0}, work_offset_mm=(-10.0, 0.0, 2.5))
    host.say(b"$H\n", 60.0)
    assert host.say(b"?") == b"<Idle|WPos:9.000,-1.000,-3.500|FS:0,0|WCO:-10.000,0.000,2.500>\r\n"


def test_wco_and_ov_come_now_and_then(host: Host) -> None:
    host.say(b"\x18")
    lines = [host.say(b"?") for _ in range(40)]
    assert [i for i, line in enumerate(lines) if b"|WCO:" in line] == [0, 10, 20, 30]
    assert [i for i, line in enumerate(lines) if b"|Ov:100,100,100" in line] == [1, 11, 21, 31]


def test_status_in_motion_shows_state_place_and_feed(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 1.0)
    assert host.say(b"?").startswith(b"<Run|MPos:-10.")
    assert b"|FS:600,0" in host.say(b"?")


def test_status_in_inches(host: Host) -> None:
    host.say(b"$13=1\n")
    assert b"|MPos:-0.0394,-0.0394,-0.0394|" in host.say(b"?")


def test_pins_show_a_pressed_switch() -> None:
    host = Host(mechanics=Mechanics(start_mm=(0.0, -5.0, 0.0)))
    host.hear()
    assert b"|Pn:XZ|" in host.say(b"?")


def test_real_time_bytes_are_picked_out_of_the_middle_of_a_line(host: Host) -> None:
    heard = host.say(b"G53G1?X-2F600\n", 0.001)
    assert heard == b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\nok\r\n"
    host.hear(2.0)
    assert host.steps()[0] == -800


def test_unknown_high_bytes_are_dropped(host: Host) -> None:
    assert host.say(b"G\xff9\x900\n") == b"ok\r\n"


# --- ok means queued ---


def test_ok_means_queued_not_done(host: Host) -> None:
    assert host.say(b"G53G1X-20F600\n") == b"ok\r\n"
    assert host.state() == b"<Run"


def test_the_ok_of_a_dwell_comes_after_motion_and_dwell(host: Host) -> None:
    start_s = host.clock.monotonic_s()
    assert host.say(b"G53G1X-11F600\nG4P0.25\n", 1.4) == b"ok\r\n"
    # 10 mm at 10 mm/s and 50 mm/s²: 1.2 s, and the dwell.
    host.clock.wait_until(host.line.host_pending, start_s + 5)
    assert host.line.host_read() == b"ok\r\n"
    assert host.clock.monotonic_s() - start_s == pytest.approx(1.45, abs=1e-4)


def test_a_sixteenth_block_waits_for_a_place_and_the_buffer_holds_128_bytes(host: Host) -> None:
    host.say(b"$10=3\nG91\nF60\n")
    moves = b"".join(b"G1X-0.%d\n" % (i % 2 + 1) for i in range(16))
    assert host.say(moves, 0.001) == b"ok\r\n" * 15
    assert b"|Bf:0,128|" in host.say(b"?")
    host.say(b";" * 200)
    assert b",0|FS:" in host.say(b"?", 0.001)


def test_bytes_beyond_the_buffer_are_lost(host: Host) -> None:
    host.say(b"G4P1\n" + b"G90\n" * 40, 0.001)
    assert host.hear(2.0) == b"ok\r\n" * (1 + 128 // 4)


# --- hold, door, resume ---


def test_hold_slows_down_then_can_be_resumed(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 1.0)
    host.line.host_write(b"!")
    assert host.say(b"?", 0.1).startswith(b"<Hold:1|")
    host.hear(0.2)
    assert host.state() == b"<Hold:0"
    held = host.steps()
    host.hear(5.0)
    assert host.steps() == held
    host.say(b"~")
    assert host.state() == b"<Run"
    host.hear(5.0)
    assert host.steps()[0] == -8000


def test_a_resume_during_the_slowing_down_is_lost(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 1.0)
    host.say(b"!", 0.1)
    host.say(b"~", 1.0)
    assert host.state() == b"<Hold:0"


def test_lines_wait_while_held(host: Host) -> None:
    host.say(b"!")
    assert host.state() == b"<Hold:0"
    assert host.say(b"G90\n") == b""
    assert host.say(b"~") == b"ok\r\n"
    assert host.state() == b"<Idle"


def test_hold_delays_the_ok_of_a_dwell(host: Host) -> None:
    assert host.say(b"G53G1X-11F600\nG4P0.1\n", 0.6) == b"ok\r\n"
    assert host.say(b"!", 10.0) == b""
    assert host.say(b"~", 2.0) == b"ok\r\n"
    assert host.steps()[0] == -4400


def test_hold_with_a_full_queue_keeps_every_move(host: Host) -> None:
    moves = b"".join(b"G91G1X-0.%dF60\n" % (i % 2 + 1) for i in range(20))
    host.say(moves, 0.5)
    host.say(b"!", 3.0)
    host.say(b"~", 10.0)
    assert host.steps()[0] == -400 - 10 * 40 - 10 * 80
    assert host.state() == b"<Idle"


def test_reset_in_a_finished_hold_keeps_the_position(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 1.0)
    host.say(b"!", 1.0)
    assert host.say(b"\x18") == BANNER
    here = host.steps()[0]
    assert host.say(b"?").startswith(b"<Idle|MPos:%.3f," % (here / 400))


def test_hold_then_reset_drops_the_rest_byte_for_byte() -> None:
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


def test_reset_in_a_hold_at_rest_sets_no_lock(host: Host) -> None:
    host.say(b"!")
    assert host.say(b"\x18") == BANNER
    assert host.say(b"?") == b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n"


def test_reset_in_a_hold_that_still_slows_down_is_alarm_3_and_locks(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 1.0)
    assert host.say(b"!", 0.1) == b""
    assert host.say(b"?", 0.05).startswith(b"<Hold:1|")
    assert host.say(b"\x18", 0.1) == b"ALARM:3\r\n"
    assert host.hear(1.0) == BANNER + UNLOCK
    assert host.state() == b"<Alarm"


def test_reset_behind_an_open_door_keeps_the_position(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 1.0)
    host.say(b"\x84", 1.0)
    here = host.steps()
    assert host.say(b"\x18") == BANNER
    assert host.say(b"?").startswith(b"<Idle|MPos:%.3f,-1.000,-1.000|" % (here[0] / 400))


def test_door(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 1.0)
    assert host.say(b"\x84") == b"[MSG:Check Door]\r\n"
    assert host.state() == b"<Door:2"
    host.hear(1.0)
    assert host.state() == b"<Door:0"
    host.say(b"~", 5.0)
    assert host.steps()[0] == -8000


def test_sleep_ends_by_a_reset_only(host: Host) -> None:
    assert host.say(b"$SLP\n") == b"ok\r\n[MSG:Sleeping]\r\n"
    assert host.say(b"G90\n$X\n~") == b""
    assert host.state() == b"<Sleep"
    assert host.say(b"\x18") == BANNER + UNLOCK


# --- jog ---


def test_jog_and_its_cancel(host: Host) -> None:
    assert host.say(b"$J=G91 G21 X-10 F600\n", 0.5) == b"ok\r\n"
    assert host.state() == b"<Jog"
    assert host.say(b"G90\n") == b"error:9\r\n"
    host.say(b"\x85", 1.0)
    assert host.state() == b"<Idle"
    here = host.steps()
    assert -4400 < here[0] < -400
    host.say(b"$J=G91X-1F600\n", 2.0)
    assert host.steps()[0] == here[0] - 400


def test_a_hold_cancels_a_jog(host: Host) -> None:
    host.say(b"$J=G91X-10F600\n", 0.5)
    host.say(b"!")
    assert host.state() == b"<Jog"
    host.hear(1.0)
    assert host.state() == b"<Idle"


def test_door_in_a_jog(host: Host) -> None:
    host.say(b"$J=G91X-10F600\n", 0.5)
    host.say(b"\x84", 1.0)
    assert host.state() == b"<Door:0"
    host.say(b"~")
    assert host.state() == b"<Idle"


def test_a_jog_beyond_the_travel_is_refused_and_does_not_move(host: Host) -> None:
    assert host.say(b"$J=G91X2F100\n") == b"error:15\r\n"
    assert host.say(b"$J=G53X-60.1F100\n") == b"error:15\r\n"
    assert host.state() == b"<Idle"
    assert host.steps() == (-400, -400, -400)


def test_no_jog_while_running(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 0.5)
    assert host.say(b"$J=G91X-1F100\n") == b"error:8\r\n"


def test_a_jog_leaves_the_modes_alone(host: Host) -> None:
    host.say(b"$J=G91G20X-0.1F10\n", 20.0)
    assert host.steps()[0] == -400 - 1016
    assert host.say(b"$G\n").startswith(b"[GC:G0 G54 G17 G21 G90 G94")


# --- alarms ---


def test_soft_limit_alarm_then_silence_until_reset(host: Host) -> None:
    assert host.say(b"G53G1X1F100\n", 0.1) == b"ALARM:2\r\n"
    assert host.hear(1.0) == b"[MSG:Reset to continue]\r\n"
    assert host.say(b"?$X\nG90\n$I\n~!", 10.0) == b""
    assert host.say(b"\x18") == b"ok\r\n" + BANNER + UNLOCK
    assert host.say(b"G90\n") == b"error:9\r\n"
    assert host.say(b"$X\n").endswith(b"ok\r\n")
    assert host.say(b"?").startswith(b"<Idle|MPos:-1.000,-1.000,-1.000|")


def test_a_reset_while_the_soft_limit_alarm_is_printed_is_lost(host: Host) -> None:
    host.say(b"G53G1X1F100\n", 0.1)
    assert host.say(b"\x18", 5.0) == b"[MSG:Reset to continue]\r\n"
    assert BANNER in host.say(b"\x18")


def test_a_soft_limit_in_motion_stops_slowly_first(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 1.0)
    assert host.say(b"G53X-61\n", 0.1) == b""
    assert host.state() == b"<Hold:1"
    assert host.hear(0.2) == b"ALARM:2\r\n"
    here = host.steps()
    host.hear(1.0)
    host.say(b"\x18")
    assert host.say(b"?").startswith(b"<Alarm|MPos:%.3f," % (here[0] / 400))


def test_reset_in_motion_is_alarm_3_and_locks(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 1.0)
    before = host.steps()
    assert host.say(b"\x18", 0.1) == b"ALARM:3\r\n"
    stopped = host.steps()
    assert before[0] - 5 < stopped[0] <= before[0]
    assert host.say(b"?\x18", 0.1) == b""
    assert host.hear(1.0) == BANNER + UNLOCK
    assert host.say(b"G53G1X-2F100\n") == b"error:9\r\n"
    assert host.steps() == stopped


def test_reset_while_slowing_down_is_alarm_3(host: Host) -> None:
    host.say(b"G53G1X-20F600\n", 1.0)
    assert host.say(b"!\x18", 1.0) == b"ALARM:3\r\n" + BANNER + UNLOCK


def test_a_reset_gives_the_ok_of_the_line_under_way(host: Host) -> None:
    host.say(b"G53G1X-20F600\nG4P1\n", 1.0)
    assert host.say(b"\x18", 1.0) == b"ALARM:3\r\nok\r\n" + BANNER + UNLOCK


def test_after_a_reset_in_motion_the_board_may_be_wrong_about_the_carriage() -> None:
    host = Host(mechanics=Mechanics(slip_steps=7))
    host.say(b"$H\n", 60.0)
    host.say(b"G53G1X-20F600\n", 1.0)
    host.say(b"\x18", 1.0)
    host.say(b"$X\nG53G1X-5F600\n", 10.0)
    assert host.steps()[0] == -5 * 400 - 7
    assert host.say(b"?").startswith(b"<Idle|MPos:-5.000,")


def test_unlocked_without_homing_the_board_takes_its_place_for_zero(locked: Host) -> None:
    locked.say(b"$X\nG91G1X-2F600\n", 5.0)
    assert locked.steps()[0] == -32 * 400
    assert locked.say(b"?").startswith(b"<Idle|MPos:-2.000,")


# --- homing ---


def test_homing_takes_its_time_is_silent_and_ends_at_the_pull_off(locked: Host) -> None:
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


def test_z_homes_before_x_and_y(locked: Host) -> None:
    locked.say(b"$H\n", 1.5)
    x, y, z = locked.steps()
    assert (x, y) == (-12000, -6000)
    assert z > -4000


def test_homing_duration_in_closed_form() -> None:
    host = Host(mechanics=Mechanics(start_mm=(-1.0, -1.0, -3.0)), settings={26: 0})
    host.hear()
    start_s = host.clock.monotonic_s()
    host.line.host_write(b"$H\n")
    host.clock.wait_until(host.line.host_pending, 60.0)
    seek, feed, accel = 5.0, 25 / 60, 50.0

    def ramp_up(mm: float, speed: float) -> float:
        return speed / (2 * accel) + mm / speed

    pull_off = 1.0 / seek + seek / accel
    once = 2 * pull_off + ramp_up(1.0, feed)
    expected_s = 2 * once + ramp_up(3.0, seek) + ramp_up(1.0, seek)
    assert host.clock.monotonic_s() - start_s == pytest.approx(expected_s, abs=1e-4)


def test_reset_in_homing_is_alarm_6(locked: Host) -> None:
    locked.hear()
    locked.say(b"$H\n", 1.0)
    assert locked.say(b"\x18", 1.0) == b"ALARM:6\r\nok\r\n" + BANNER + UNLOCK


def test_door_in_homing_is_alarm_7(locked: Host) -> None:
    locked.hear()
    locked.say(b"$H\n", 1.0)
    assert locked.say(b"\x84", 1.0) == b"ALARM:7\r\nok\r\n" + BANNER + UNLOCK


# --- outputs ---


def test_coolant_and_spindle_are_switched_and_reported(host: Host) -> None:
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


def test_an_output_waits_for_the_motion_before_it(host: Host) -> None:
    host.say(b"G53G1X-2F60\n")
    assert host.say(b"M8\n", 0.5) == b""
    assert host.hear(1.0) == b"ok\r\n"
    ((t_s, word),) = host.board.outputs
    # 1 mm at 1 mm/s and 50 mm/s²
    assert (word, t_s) == ("M8", pytest.approx(host.clock.monotonic_s() - 1.51 + 1.01, abs=0.011))


def test_a_reset_switches_outputs_off(host: Host) -> None:
    host.say(b"M8\n")
    host.say(b"\x18")
    assert [word for _, word in host.board.outputs] == ["M8", "M9"]
    assert b"M5 M9" in host.say(b"$G\n")


# --- g-code ---


def test_inches_and_relative_moves(host: Host) -> None:
    host.say(b"G20G91G1X-0.1F20\n", 20.0)
    assert host.steps()[0] == -400 - 1016


def test_words_of_a_cam_header_are_taken_and_reported(host: Host) -> None:
    assert host.say(b"G17G21G54G90G94\n") == b"ok\r\n"
    for other in (b"G18", b"G55", b"G93", b"G40", b"G49", b"G61", b"G91.1", b"G80"):
        assert host.say(other + b"\n") == b"ok\r\n"
    assert host.say(b"G81\n") == b"error:20\r\n"
    assert host.say(b"$G\n") == b"[GC:G80 G55 G18 G21 G90 G93 M5 M9 T0 F0 S0]\r\nok\r\n"
    assert host.say(b"M30\n") == b"[MSG:Pgm End]\r\nok\r\n"
    assert host.say(b"$G\n") == b"[GC:G1 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]\r\nok\r\n"


def test_work_coordinates_move_what_follows(host: Host) -> None:
    """G54 by G10 L20, then G92 on top of it, a stored place by G28.1, and back to it by way of another."""
    host.say(b"G10L20P1X0Y0Z0\nG92X1\nG1X-1F600\n", 2.0)
    assert host.steps() == (-1200, -400, -400)
    host.say(b"G28.1\nG1X-3\n", 2.0)
    assert host.steps()[0] == -2000
    assert host.say(b"?").split(b"|WCO:")[1] == b"-2.000,-1.000,-1.000>\r\n"
    host.say(b"G28Z-1\n", 5.0)
    assert host.steps() == (-2000, -400, -400), "only the axis that was named, there and back"
    host.say(b"G92.1\nG54X-3F600G1\n", 2.0)
    assert host.steps()[0] == -1600


def test_inverse_time_is_a_share_of_a_minute(host: Host) -> None:
    start_s = host.clock.monotonic_s()
    host.say(b"G93G1G91X-2F30\nG4P0\n", 0.01)
    host.clock.wait_until(host.line.host_pending, start_s + 60)
    assert host.clock.monotonic_s() - start_s == pytest.approx(2.0, abs=0.05)


def test_check_mode_reads_everything_and_moves_nothing(host: Host) -> None:
    assert host.say(b"$C\n") == b"[MSG:Enabled]\r\nok\r\n"
    assert host.say(b"G53G1X-20F600\nG1X\n", 3.0) == b"ok\r\nerror:2\r\n"
    assert host.state() == b"<Check"
    assert host.steps() == (-400, -400, -400)
    assert host.say(b"$C\n") == b"[MSG:Disabled]\r\nok\r\n" + BANNER


def test_a_pause_is_answered_once_it_is_resumed(host: Host) -> None:
    assert host.say(b"M0\n", 0.5) == b""
    assert host.state() == b"<Hold:0"
    assert host.say(b"~") == b"ok\r\n"
    assert host.state() == b"<Idle"


def test_a_flood_of_questions_is_answered_by_a_few(host: Host) -> None:
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


def test_g53_ignores_offset_and_relative_mode() -> None:
    host = Host(work_offset_mm=(-10.0, 0.0, 0.0))
    host.say(b"$H\n", 60.0)
    host.say(b"G91G53G1X-5F600\n", 5.0)
    assert host.steps()[0] == -2000
    host.say(b"G90G1X-5\n", 5.0)
    assert host.steps()[0] == -6000


def test_a_move_to_where_it_is_does_nothing(host: Host) -> None:
    assert host.say(b"G53G1X-1F600\n") == b"ok\r\n"
    assert host.state() == b"<Idle"


def test_no_move_is_slower_than_one_millimetre_a_minute(free: Host) -> None:
    free.say(b"G91G1X1F0.01\n", 1.0)
    assert b"|FS:1,0" in free.say(b"?")


def test_a_rapid_runs_at_the_axis_rate(free: Host) -> None:
    free.say(b"G91G0Z-10\n", 1.0)
    assert b"|FS:300,0" in free.say(b"?")


@pytest.mark.parametrize(("axis", "rate"), [(b"X", b"600"), (b"Y", b"480"), (b"Z", b"300")])
def test_each_axis_has_a_rate_of_its_own(free: Host, axis: bytes, rate: bytes) -> None:
    free.say(b"$111=480\n")
    free.say(b"G91G0%s-20\n" % axis, 1.0)
    assert b"|FS:%s,0" % rate in free.say(b"?")


@pytest.mark.parametrize(("axis", "number"), [(b"X", 120), (b"Y", 121), (b"Z", 122)])
def test_each_axis_has_an_acceleration_of_its_own(free: Host, axis: bytes, number: int) -> None:
    free.say(b"$%d=2\n" % number)
    free.say(b"G91G0%s-20\n" % axis, 0.5)
    assert b"|FS:60,0" in free.say(b"?", 1e-4)  # 2 mm/s² for half a second: 1 mm/s
