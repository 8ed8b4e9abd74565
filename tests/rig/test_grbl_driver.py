"""The GRBL driver: pairs of bytes, the settings that it expects of a board, and its words."""

from collections.abc import Callable
from typing import Any

import pytest

from rig.devices.base import (
    MoveError,
    Stage,
    StageAlarm,
    StageError,
    StageRejected,
    StageReset,
    StageStatus,
    StageTimeout,
)
from rig.devices.grbl import GrblStage
from rig.devices.grbl_link import ASK_TIMES, expected_settings, number, parse_setting
from rig.devices.registry import StageKind, find
from rig.plan.config import Config
from rig.settings import RigSettings
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.scripted_board import Board

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


OLD_STATUS = b"<{state},MPos:0.000,0.000,0.000,WPos:0.000,0.000,0.000>\r\n"
FLUIDNC = b"[VER:3.9 FluidNC v3.9.1 (esp32-wifi) :]\r\n[OPT:MPHS]\r\n[MSG: Machine: bench]\r\nok\r\n"
OLD_FLUIDNC = b"[VER:3.4 FluidNC v3.4.2:]\r\n[OPT:PHS]\r\nok\r\n"
OTHERS: dict[str, tuple[dict[bytes, bytes], str, str]] = {
    "GRBL 0.9j": ({b"$I\n": b"[0.9j.20160316:]\r\nok\r\n"}, "old_firmware", "[0.9j.20160316:]"),
    "GRBL 0.9g": ({b"$I\n": b"[0.9g.20150214:mine]\r\nok\r\n"}, "old_firmware", "0.9g"),
    "GRBL 0.9j, busy": (
        {b"$I\n": b"error: Not idle\r\n", b"\x18": b"\r\nGrbl 0.9j ['$' for help]\r\n"}, "old_firmware", "Grbl 0.9j",
    ),
    "GRBL 0.8c": (
        {b"$I\n": b"error: Bad number format\r\n", b"\x18": b"\r\nGrbl 0.8c ['$' for help]\r\n"},
        "old_firmware", "Grbl 0.8c",
    ),
    "FluidNC": ({b"$I\n": FLUIDNC}, "other_firmware", "FluidNC v3.9.1"),
    "FluidNC, without most settings": (
        {b"$I\n": OLD_FLUIDNC, b"$$\n": b"$10=1\r\nok\r\n"}, "other_firmware", "FluidNC v3.4.2",
    ),
    "no homing, no travel": ({b"$$\n": b"$10=1\r\n$13=0\r\nok\r\n"}, "settings_missing", "$22, $130, $131"),
    "no soft limits": (
        {b"$$\n": b"$22=1\r\n$130=60\r\n$131=30\r\nok\r\n"}, "settings_missing", "$20, $132",
    ),
}  # fmt: skip
"""Boards that answer like GRBL 1.1 and are none: by their sources, and what is missing."""


@pytest.mark.parametrize("name", OTHERS)
def test_a_board_whose_firmware_cannot_do_it_is_refused_by_name_and_told_no_setting(
    clock: VirtualClock, name: str
) -> None:
    answers, code, shown = OTHERS[name]
    board = Board(clock)
    board.answers.update({b"$I\n": HELLO[1]} | answers)
    stage = GrblStage(board, clock, expected=expected_settings(RigSettings()), bounds=RigSettings().bounds)
    with raises(StageError, code, port="board", shown=shown) as caught:
        stage.connect()
    assert "send it" not in str(caught.value)
    assert not any(data.startswith(b"$") and b"=" in data for data in board.said)


@pytest.mark.parametrize("state", ["Idle", "Run", "Hold", "Home", "Alarm", "Check", "Door"])
def test_a_status_of_an_old_board_says_so_unless_it_is_noise(clock: VirtualClock, state: str) -> None:
    """It has commas between its fields; one status may be garbled."""
    old = OLD_STATUS.replace(b"{state}", state.encode())
    board = Board(clock)
    stage = GrblStage(board, clock)
    board.next[b"?"] = [old, old]
    assert stage.look().state == "Idle"
    board.next[b"?"] = [old] * ASK_TIMES
    with raises(StageError, "old_firmware", port="board", shown=f"<{state},MPos"):
        stage.look()


@pytest.mark.parametrize("number", [8, 9, 13, 18, 45, 46, 50, 51, 79])
def test_a_board_that_cannot_obey_now_says_why(clock: VirtualClock, number: int) -> None:
    """Of GRBL 1.1 and grblHAL; the board was reset before it was asked again."""
    board = Board(clock)
    board.answers[b"$I\n"] = f"error:{number}\r\n".encode()
    with raises(StageRejected, "line_refused", number=f"error {number}: ") as caught:
        GrblStage(board, clock).connect()
    assert "manual" not in str(caught.value)
    assert board.said.count(b"\x18") == 1


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
    again = [*confirmed("X-99Y0Z0", 60, AT, (98.0, -2.0, -3.0)), (b"$J=X0F60\n", b"error:15\r\n")]
    board = stage([(b"?", IDLE), *again, (b"?", IDLE), *again, (b"?", IDLE), *again])
    with raises(StageRejected, "line_refused", number=15, line="$J=X0F60"):
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


# --- settings, inputs and words ---


@pytest.fixture
def board(clock: VirtualClock) -> Board:
    return Board(clock)


@pytest.mark.parametrize("garbled", ["", "1\N{REPLACEMENT CHARACTER}", "x"])
def test_a_garbled_number_is_an_error_and_an_alarm_all_the_same(
    board: Board, clock: VirtualClock, garbled: str
) -> None:
    stage = GrblStage(board, clock)
    stage.connect()
    raw = garbled.encode("ascii", "ignore") + b"\xff" * ("\N{REPLACEMENT CHARACTER}" in garbled)
    board.answers[b"$X\n"] = b"error:" + raw + b"\r\n"
    with raises(StageRejected, "line_refused", number=0):
        stage.unlock()
    board.says(b"ALARM:" + raw + b"\r\n")
    with raises(StageAlarm, "alarm", number=0):
        stage.status()


# --- settings ---

SET: dict[int, Any] = {13: 0, 22: 1, 32: 0, 130: 60.0, 131: 30.0}
"""What a board must be set to on the default bench: millimetres, homing, no laser, and the travel."""


def _connect(board: Board, clock: VirtualClock, settings: dict[int, Any]) -> None:
    lines = "".join(f"${number}={value}\r\n" for number, value in settings.items())
    board.answers[b"$$\n"] = lines.encode() + b"ok\r\n"
    GrblStage(board, clock, expected=expected_settings(RigSettings())).connect()


def test_a_board_as_configured_is_taken(board: Board, clock: VirtualClock) -> None:
    assert expected_settings(RigSettings()) == SET
    _connect(board, clock, SET)
    _connect(board, clock, {n: value for n, value in SET.items() if value})  # one that it lacks counts as 0


@pytest.mark.parametrize(
    ("setting", "settings", "hal"),
    [
        ("$384=0", "$384=1 (found 0", True),
        ("$10=95", "$10=127 (found 95", True),
        ("$10=63", "$10=127 (found 63", True),
        ("$23=4", "$23=0 (found 4", False),
        ("$23=7", "$23=3 (found 7", True),
        ("$384=1", "", True),
        ("$10=511", "", True),
        ("$23=3", "", True),
        ("$384=0", "", False),
        ("$10=0", "", False),
    ],
)
def test_a_board_whose_moves_could_not_be_confirmed_is_refused(
    board: Board,
    clock: VirtualClock,
    setting: str,
    settings: str,
    hal: bool,
) -> None:
    """grblHAL may hide its work zero and its overrides, or store each target; no board may home Z downwards."""
    board.answers[b"$I\n"] = b"[VER:1.1f.20240101:]\r\n" + b"[FIRMWARE:grblHAL]\r\n" * hal + b"ok\r\n"
    board.answers[b"$$\n"] = f"$13=0\r\n{setting}\r\nok\r\n".encode()
    if settings:
        with raises(StageError, "not_as_configured", settings=f"; send it {settings}"):
            GrblStage(board, clock).connect()
    else:
        GrblStage(board, clock).connect()


@pytest.mark.parametrize("number", SET)
@pytest.mark.parametrize("by", [-1, 1])
def test_each_setting_is_held_to_its_value(board: Board, clock: VirtualClock, number: int, by: int) -> None:
    has = SET[number] + by
    with raises(StageError, "not_as_configured", settings=f"; send it ${number}={SET[number]:g} (found {has:g})"):
        _connect(board, clock, SET | {number: has})


@pytest.mark.parametrize(
    ("number", "printed", "fine"),
    [(130, "60.0004", True), (130, "59.999", False), (32, "0.0005", True), (32, "0.001", False)],
)
def test_a_setting_is_compared_as_far_as_a_board_prints_it(
    board: Board, clock: VirtualClock, number: int, printed: str, fine: bool
) -> None:
    """To three decimals: half of the last one is no difference."""
    if fine:
        _connect(board, clock, SET | {number: printed})
    else:
        settings = f"; send it ${number}={SET[number]:g} (found {printed})"
        with raises(StageError, "not_as_configured", settings=settings):
            _connect(board, clock, SET | {number: printed})


@pytest.mark.parametrize(("answers", "fine"), [([1, 1], True), ([1, 2, 3, 3], True), ([1, 2, 3, 4], False)])
def test_settings_are_believed_once_two_answers_are_the_same(
    board: Board, clock: VirtualClock, answers: list[int], fine: bool
) -> None:
    """A number with a wrong digit would stay in use."""
    board.next[b"$$\n"] = [f"$13=0\r\n$100=40{n}.0\r\nok\r\n".encode() for n in answers]
    stage = GrblStage(board, clock)
    if fine:
        stage.connect()
        assert stage.steps_per_mm("x") == 400.0 + answers[-1]
    else:
        with raises(StageError, "answers_differ", port="board"):
            stage.connect()
    assert board.said.count(b"$$\n") == len(answers)


@pytest.mark.parametrize(
    ("measured", "direction"),
    [
        ((400.0, 401.0, 402.0), 0),
        ((0.5, 0.5, 0.5), 0),
        ((-400.0, 401.0, 402.0), 1),
        ((400.0, -401.0, 402.0), 2),
        ((400.0, 401.0, -402.0), 4),
        ((-0.5, -0.5, -0.5), 7),
    ],
)
def test_the_direction_of_each_motor_is_expected_once_all_are_measured(
    measured: tuple[float, float, float], direction: int
) -> None:
    """A board has one setting for all three, and its steps per millimetre without a sign."""
    day = {"date": "2026-01-01", "expires": "2027-01-01"}
    steps = {f"{axis}_steps_per_mm": {"value": mm, **day} for axis, mm in zip("xyz", measured, strict=True)}
    x, y, z = map(abs, measured)
    expected = expected_settings(RigSettings.model_validate({"calibration": steps}))
    assert expected == SET | {100: x, 101: y, 102: z, 3: direction}
    del steps["y_steps_per_mm"]
    expected = expected_settings(RigSettings.model_validate({"calibration": steps}))
    assert expected == SET | {100: x, 102: z}


@pytest.mark.parametrize(("told", "sign"), [(b"", 1), (b"$3=0\r\n", 1), (b"$3=7\r\n", -1)])
def test_a_motor_whose_direction_the_board_does_not_tell_runs_with_its_axis(
    board: Board, clock: VirtualClock, told: bytes, sign: int
) -> None:
    board.answers[b"$$\n"] = told + b"$100=400.0\r\n$101=250.0\r\n$102=80.0\r\nok\r\n"
    stage = GrblStage(board, clock)
    stage.connect()
    assert [stage.steps_per_mm(axis) for axis in ("x", "y", "z")] == [sign * 400.0, sign * 250.0, sign * 80.0]


@pytest.mark.parametrize(("output", "word"), [("coolant", b"M8\n"), ("spindle", b"M3S1000\n"), ("off", b"")])
def test_a_driver_of_the_registry_has_the_bounds_and_the_output_of_its_configuration(
    board: Board, clock: VirtualClock, output: str, word: bytes
) -> None:
    config = Config.model_validate({"stage": {"kind": "grbl"}, "sync": {"output": output}})
    stage = find(StageKind, "grbl").driver(lambda port: board, clock, config)
    floor = SET | {20: 1, 132: -config.bounds.lowest_z_mm}
    for found in (floor | {132: 40.0}, floor):
        board.answers[b"$$\n"] = "".join(f"${n}={value}\r\n" for n, value in found.items()).encode() + b"ok\r\n"
        if found[132] == 40.0:
            with raises(StageError, "not_kept", settings=f" $132={floor[132]:g} (found 40)"):
                stage.connect()
            assert board.said.count(f"$132={floor[132]:g}\n".encode()) == 3
        else:
            stage.connect()
    if word:
        stage.set_output(True)
        assert board.said[-1] == word
    else:
        with raises(StageError, "no_output"):
            stage.set_output(True)


@pytest.mark.parametrize(
    ("pins", "inputs"), [("", set()), ("|Pn:D", {"door"}), ("|Pn:XH", {"hold"}), ("|Pn:DHP", {"door", "hold"})]
)
def test_the_inputs_of_a_board_are_those_of_its_last_status(
    board: Board, clock: VirtualClock, pins: str, inputs: set[str]
) -> None:
    stage = GrblStage(board, clock)
    assert stage.active_inputs() == set()
    stage.connect()
    for now, active in ((pins, inputs), ("", set())):
        board.status = f"<Idle|MPos:-1.000,-2.000,-3.000|FS:0,0{now}>\r\n".encode()
        stage.status()
        heard = len(board.said)
        assert stage.active_inputs() == active
        assert len(board.said) == heard


@pytest.mark.parametrize(
    ("line", "read"),
    [("$11=0.010", (11, 0.01)), ("$0=10 (step pulse, usec)", (0, 10.0)), ("$130=60.", (130, 60.0)),
     ("$11=0..010", None), ("$11=0.0.10", None), ("$11=.", None), ("$N0=G21", None)],
)  # fmt: skip
def test_a_setting_is_one_number_or_none(line: str, read: tuple[int, float] | None) -> None:
    assert parse_setting(line) == read


# --- moves as words ---


@pytest.mark.parametrize(
    ("mm", "printed"),
    [(0.12344, "0.1234"), (0.12346, "0.1235"), (-0.00004, "0"), (-10.0, "-10")],
)
def test_a_coordinate_has_a_tenth_of_a_micrometer(mm: float, printed: str) -> None:
    assert number(mm) == printed


@pytest.mark.parametrize(("speed_mm_s", "told"), [(1 / 60, "F1"), (0.5, "F30"), (0.33333, "F20"), (10.0, "F600")])
def test_a_speed_is_told_per_minute(board: Board, clock: VirtualClock, speed_mm_s: float, told: str) -> None:
    """From 1 mm/min on, below which a board moves no slower whatever it is told."""
    stage = GrblStage(board, clock)
    stage.connect()
    stage.jog("y", 0.25, speed_mm_s)
    assert board.said[-1] == f"$J=Y0{told}\n".encode()
    heard = len(board.said)
    with raises(MoveError, "too_slow", least_mm_s=1 / 60):
        stage.jog("y", 0.25, 0.99 / 60)
    assert len(board.said) == heard
