"""The GRBL driver as pairs of bytes."""

from collections.abc import Callable
from typing import Any

import pytest

from rig.devices.base import Stage, StageAlarm, StageError, StageRejected, StageReset, StageStatus, StageTimeout
from rig.devices.grbl import GrblStage
from rig.devices.grbl_link import ASK_TIMES, expected_settings
from rig.settings import RigSettings
from sim.devices.clock import VirtualClock
from tests.error_codes import raises

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
HELLO = (b"$I\n", b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n")
ASKED = b"\x90\x95\x99$$\n"
SET = b"$13=0\r\n$27=1.000\r\n$100=400.000\r\n$110=600.000\r\n$120=50.000\r\nok\r\n"
SETTINGS = ((ASKED, SET), (b"$$\n", SET))
IDLE = b"<Idle|MPos:-1.000,-2.000,-3.000|FS:0,0>\r\n"
Make = Callable[..., GrblStage]
Script = list[tuple[bytes, bytes]]


def asked(settings: bytes) -> Script:
    """The settings are read until two answers in a row are the same."""
    return [(ASKED, settings), (b"$$\n", settings)]


def confirmed(
    coordinates: str,
    feed: int,
    at: tuple[float, float, float],
    zero: tuple[float, float, float],
    *,
    modes: bool = True,
) -> Script:
    """What comes before a trigger: the offset, modes and feed where the motion is long, and work zero in a status."""
    place, work_zero = (",".join(f"{mm:.3f}" for mm in xyz) for xyz in (at, zero))
    shown = f"[GC:G1 G54 G17 G21 G90 G94 M5 M9 T0 F{feed} S0]\r\nok\r\n".encode()
    return [
        (f"G92{coordinates}G90G21G94F{feed}\n".encode(), b"ok\r\n"),
        *([(b"$G\n", shown)] if modes else []),
        (b"?", f"<Idle|MPos:{place}|FS:0,0|WCO:{work_zero}>\r\n".encode()),
    ]


AT = (-1.0, -2.0, -3.0)
HOMING: list[Any] = [
    (b"?", IDLE),
    (b"$H\n", b""),
    (b"?", b"<Home|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\nok\r\n"),
    (b"?", b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\n"),
]


@pytest.fixture
def stage(clock: VirtualClock, scripted: Callable[[list[Any]], Any]) -> Make:
    """A driver that has said hello to the far end of this script."""

    def make(script: list[Any], *, homed: bool = False, **options: Any) -> GrblStage:
        stage = GrblStage(scripted([HELLO, *SETTINGS, *script]), clock, **options)
        assert stage.connect() == "[VER:1.1h.20190825:] [OPT:V,15,128]"
        stage._link.trusted = homed
        return stage

    return make


# --- connect ---


def test_connect_after_the_banner(clock: VirtualClock, scripted: Callable[[list[Any]], Any]) -> None:
    stage: Stage = GrblStage(scripted([(b"", BANNER), HELLO, *SETTINGS]), clock)
    assert stage.connect() == "[VER:1.1h.20190825:] [OPT:V,15,128]"


def test_connect_resets_a_board_that_does_not_answer(
    clock: VirtualClock, scripted: Callable[[list[Any]], Any]
) -> None:
    stage = GrblStage(scripted([(b"$I\n", b""), (b"\x18", BANNER), HELLO, *SETTINGS]), clock)
    assert stage.connect().startswith("[VER:1.1h")


def test_connect_when_banner_and_question_cross(clock: VirtualClock, scripted: Callable[[list[Any]], Any]) -> None:
    """The answer to the first question must not be taken for the answer to the next."""
    script = [(b"$I\n", BANNER + HELLO[1]), (b"\x18", BANNER), HELLO, *SETTINGS]
    assert GrblStage(scripted(script), clock).connect().startswith("[VER:1.1h")


def test_connect_to_a_grblhal_board(clock: VirtualClock, scripted: Callable[[list[Any]], Any]) -> None:
    banner = b"\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n"
    hello = (b"$I\n", b"[VER:1.1f.20240101:]\r\n[OPT:VNM,35,1024]\r\n[FIRMWARE:grblHAL]\r\nok\r\n")
    stage = GrblStage(scripted([(b"$I\n", b""), (b"\x18", banner), hello, *SETTINGS]), clock)
    assert stage.connect().endswith("[FIRMWARE:grblHAL]")


def test_a_second_reset_where_the_first_is_lost(clock: VirtualClock, scripted: Callable[[list[Any]], Any]) -> None:
    script = [(b"$I\n", b""), (b"\x18", b"[MSG:Reset to continue]\r\n"), (b"\x18", BANNER), HELLO, *SETTINGS]
    assert GrblStage(scripted(script), clock).connect()


@pytest.mark.parametrize(
    ("board", "wanted"),
    [
        (b"$20=1\r\n$22=1\r\n$130=60.000\r\n", {131: 30.0}),
        (b"$20=0\r\n$22=0\r\n$130=60.000\r\n$131=30.000\r\n$132=40.000\r\n", {22: 1}),
    ],
)
def test_a_board_that_is_not_set_as_configured_is_refused(
    clock: VirtualClock, scripted: Callable[[list[Any]], Any], board: bytes, wanted: dict[int, float]
) -> None:
    stage = GrblStage(scripted([HELLO, *asked(board + b"ok\r\n")]), clock, expected=expected_settings(RigSettings()))
    with raises(StageError, "not_as_configured", wanted=wanted, found=dict.fromkeys(wanted, 0.0)):
        stage.connect()


# --- lines and answers ---


def test_push_messages_never_answer_a_line(stage: Make) -> None:
    pushed = IDLE + b"[MSG:Caution: Unlocked]\r\n$100=400.000\r\n<Run|MP"
    stage([(b"$X\n", [pushed, b"os:0,0,0>\r\n", b"ok\r\n"])]).unlock()


def test_no_answer_is_a_bounded_wait_and_then_only_a_reset_helps(stage: Make, clock: VirtualClock) -> None:
    board = stage([(b"$$\n", b""), (b"\x18", b"ok\r\n" + BANNER), (b"$X\n", b"ok\r\n")])
    with raises(StageTimeout, "no_reply", line="$$", timeout_s=2.0):
        board.settings()
    assert clock.monotonic_s() == pytest.approx(2.0)
    with raises(StageError, "needs_reset", line="$$"):
        board.settings()
    board.unlock()


# --- status ---


def test_work_position_waits_for_the_offset_and_keeps_it(stage: Make) -> None:
    work = b"<Idle|WPos:1.000,2.000,3.000|FS:0,0>\r\n"
    with_offset = b"<Idle|WPos:1.000,2.000,3.000|FS:0,0|WCO:-10.000,0.000,0.500>\r\n"
    board = stage([(b"?", work), (b"?", with_offset), (b"?", work)])
    assert board.status() == StageStatus("Idle", -9.0, 2.0, 3.5)
    assert board.status() == StageStatus("Idle", -9.0, 2.0, 3.5)


def test_a_status_without_position_is_an_error(stage: Make) -> None:
    with raises(StageError, "no_position"):
        stage([(b"?", b"<Idle|FS:0,0>\r\n")] * (1 + ASK_TIMES)).status()


# --- homing and moving ---


def test_a_banner_at_any_time_is_a_reset(stage: Make) -> None:
    board = stage([*HOMING, (b"?", b"<Idle|MPos:-1.0" + BANNER)])
    board.home()
    with raises(StageReset, "was_reset", line="Grbl 1.1h ['$' for help]"):
        board.status()
    assert not board.homed


def test_a_banner_glued_to_half_a_line_is_a_reset(stage: Make) -> None:
    with raises(StageReset, "was_reset", line="$100=40Grbl 1.1h ['$' for help]"):
        stage([(b"$$\n", b"$100=40Grbl 1.1h ['$' for help]\r\n")]).settings()


def test_an_alarm_that_came_between_is_raised_before_the_next_line(stage: Make, clock: VirtualClock) -> None:
    board = stage([(b"?", IDLE + b"ALARM:1\r\n[MSG:Reset to continue]\r\n")], homed=True)
    board.status()
    with raises(StageAlarm, "alarm", number=1):
        board.move_to(x_mm=-2.0, speed_mm_s=1.0)


# --- jogging and outputs ---


def test_a_jog_beyond_the_travel_is_refused_by_the_board(stage: Make) -> None:
    """After three times: an axis that was garbled is refused by its travel, too."""
    again = [*confirmed("X0Y0Z0", 60, AT, AT), (b"$J=G91Z0X99F60\n", b"error:15\r\n")]
    board = stage([(b"?", IDLE), *again, (b"?", IDLE), *again, (b"?", IDLE), *again])
    with raises(StageRejected, "line_refused", number=15, line="$J=G91Z0X99F60"):
        board.jog("x", 99.0, 1.0)


def test_a_jog_cancel_is_waited_for_and_not_sent_again_at_once(stage: Make) -> None:
    """A second one at the very end of the jog leaves GRBL 1.1h Idle and deaf to lines."""
    jogging = b"<Jog|MPos:-1.000,-2.000,-3.000|FS:60,0>\r\n"
    stage([(b"\x85", b""), (b"?", jogging), (b"?", jogging), (b"?", IDLE)]).end_jog()


@pytest.mark.parametrize(("output", "words"), [("coolant", (b"M8\n", b"M9\n")), ("spindle", (b"M3S1000\n", b"M5\n"))])
def test_the_output_for_a_recording_amplifier(stage: Make, output: str, words: tuple[bytes, bytes]) -> None:
    board = stage([(word, b"ok\r\n") for word in words], output=output)
    board.set_output(True)
    board.set_output(False)


def test_a_look_takes_no_banner_for_an_answer_and_resets_nothing(
    clock: VirtualClock, scripted: Callable[[list[Any]], Any]
) -> None:
    locked = b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n"
    board = GrblStage(scripted([(b"", BANNER), (b"?", b"ALARM:3\r\n" + BANNER), (b"?", locked)]), clock)
    assert board.look().state == "Alarm"


# --- stop, hold, unlock ---


def test_a_resume_is_sent_again_until_it_is_seen(stage: Make) -> None:
    held = b"|MPos:-1.000,-2.000,-3.000|FS:0,0>\r\n"
    board = stage(
        [
            (b"!", b""),
            (b"?", b"<Hold:1" + held),
            (b"~", b""),
            (b"?", b"<Hold:0" + held),
            (b"~", b""),
            (b"?", b"<Run" + held),
        ]
    )
    board.hold()
    board.resume()
