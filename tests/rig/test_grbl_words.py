"""What the lines of a GRBL board mean to a user: alarms, errors, settings. Source: GRBL 1.1 interface wiki."""

from typing import Any

import pytest

from rig.devices.base import MoveError, StageAlarm, StageError, StageRejected
from rig.devices.grbl import GrblStage
from rig.devices.grbl_link import expected_settings, parse_setting
from rig.devices.registry import StageKind, find
from rig.plan.config import Config
from rig.settings import RigSettings
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.scripted_board import Board


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
    ("setting", "wanted", "found", "hal"),
    [
        ("$384=0", {384: 1}, {384: 0}, True),
        ("$10=95", {10: 127}, {10: 95}, True),
        ("$10=63", {10: 127}, {10: 63}, True),
        ("$23=4", {23: 0}, {23: 4}, False),
        ("$23=7", {23: 3}, {23: 7}, True),
        ("$384=1", {}, {}, True),
        ("$10=511", {}, {}, True),
        ("$23=3", {}, {}, True),
        ("$384=0", {}, {}, False),
        ("$10=0", {}, {}, False),
    ],
)
def test_a_board_whose_moves_could_not_be_confirmed_is_refused(
    board: Board,
    clock: VirtualClock,
    setting: str,
    wanted: dict[int, float],
    found: dict[int, float],
    hal: bool,
) -> None:
    """grblHAL may hide its work zero and its overrides, or store each target; no board may home Z downwards."""
    board.answers[b"$I\n"] = b"[VER:1.1f.20240101:]\r\n" + b"[FIRMWARE:grblHAL]\r\n" * hal + b"ok\r\n"
    board.answers[b"$$\n"] = f"$13=0\r\n{setting}\r\nok\r\n".encode()
    if wanted:
        with raises(StageError, "not_as_configured", wanted=wanted, found=found):
            GrblStage(board, clock).connect()
    else:
        GrblStage(board, clock).connect()


@pytest.mark.parametrize("number", SET)
@pytest.mark.parametrize("by", [-1, 1])
def test_each_setting_is_held_to_its_value(board: Board, clock: VirtualClock, number: int, by: int) -> None:
    has = SET[number] + by
    with raises(StageError, "not_as_configured", wanted={number: SET[number]}, found={number: has}):
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
        with raises(StageError, "not_as_configured", wanted={number: SET[number]}, found={number: float(printed)}):
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
            with raises(StageError, "not_kept", wanted={132: floor[132]}, found={132: 40.0}):
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
    ("by_mm", "told"),
    [(0.12344, "0.1234"), (0.12346, "0.1235"), (-0.00004, "0"), (-10.0, "-10")],
)
def test_a_distance_is_told_to_a_tenth_of_a_micrometre(
    board: Board, clock: VirtualClock, by_mm: float, told: str
) -> None:
    stage = GrblStage(board, clock)
    stage.connect()
    stage.jog("y", by_mm, 1.0)
    assert board.said[-1] == f"$J=G91Z0Y{told}F60\n".encode()


@pytest.mark.parametrize(("speed_mm_s", "told"), [(1 / 60, "F1"), (0.5, "F30"), (0.33333, "F20"), (10.0, "F600")])
def test_a_speed_is_told_per_minute(board: Board, clock: VirtualClock, speed_mm_s: float, told: str) -> None:
    """From 1 mm/min on, below which a board moves no slower whatever it is told."""
    stage = GrblStage(board, clock)
    stage.connect()
    stage.jog("y", 0.25, speed_mm_s)
    assert board.said[-1] == f"$J=G91Z0Y0.25{told}\n".encode()
    heard = len(board.said)
    with raises(MoveError, "too_slow", least_mm_s=1 / 60):
        stage.jog("y", 0.25, 0.99 / 60)
    assert len(board.said) == heard
