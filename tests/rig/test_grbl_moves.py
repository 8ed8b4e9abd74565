"""How a GRBL stage moves, homes, jogs and halts, how long it waits, and which answers it believes."""

import math
import re
from collections.abc import Callable
from contextlib import nullcontext, suppress
from typing import Any

import pytest

from rig.devices.base import (
    StageAlarm,
    StageError,
    StageOverridden,
    StageRejected,
    StageReset,
    StageStatus,
    StageTimeout,
)
from rig.devices.grbl import GrblStage
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.scripted_board import BANNER, At, Board, at, connected


@pytest.fixture
def board(clock: VirtualClock) -> Board:
    return Board(clock)


LINE_X = b"G1X0\n"
"""10 mm at 1 mm/s and 50 mm/s²: 10.02 s."""


def _asked_s(board: Board, line: bytes = LINE_X) -> list[float]:
    """The `?` of a move, in seconds from its line."""
    (begun_s,) = board.times(line)
    return [t_s - begun_s for t_s, data in board.after(line) if data == b"?"]


@pytest.mark.parametrize("state", ["Alarm", "Sleep", "Check", "Alarm:1"])
def test_a_board_state_that_cannot_lead_to_arrival_ends_a_move_at_once(board: Board, state: str) -> None:
    stage = connected(board)
    board.status = at(state)
    with raises(StageError, "left_move", state=state):
        stage.move_to(x_mm=-11.0, speed_mm_s=1.0)
    assert len(_asked_s(board)) == 1


def test_a_speed_override_first_reported_at_the_arrival_fails_the_move(board: Board) -> None:
    """The move was too short to be looked at on the way: it went at another speed all the same."""
    stage = connected(board)
    board.status = b"<Idle|MPos:-11.000,-2.000,-3.000|FS:0,0|Ov:50,100,100>\r\n"
    with raises(StageOverridden, "overridden", feed_percent=50):
        stage.move_to(x_mm=-11.0, speed_mm_s=1.0)


@pytest.mark.parametrize("news", [b"ALARM:1\r\n", BANNER])
def test_an_alarm_or_reset_during_a_move_ends_it_at_once(board: Board, clock: VirtualClock, news: bytes) -> None:
    stage = connected(board)
    board.says(news, 3.3)
    begun_s = clock.monotonic_s()
    with pytest.raises((StageAlarm, StageReset)):
        stage.move_to(x_mm=-11.0, speed_mm_s=1.0)
    assert clock.monotonic_s() - begun_s == pytest.approx(3.3)


LIMITS = (
    b"$13=0\r\n$100=400.0\r\n$101=400.0\r\n$102=400.0\r\n$110=600.0\r\n$111=300.0\r\n$112=120.0\r\n"
    b"$120=50.0\r\n$121=10.0\r\n$122=4.0\r\nok\r\n"
)
"""10, 5 and 2 mm/s; 50, 10 and 4 mm/s²."""


@pytest.mark.parametrize(
    ("by_mm", "speed_mm_s", "expected_s"),
    [
        ((10.0, 0.0, 0.0), 1.0, 10.0 + 1.0 / 50.0),
        ((20.0, 0.0, 0.0), 99.0, 20.0 / 10.0 + 10.0 / 50.0),
        ((0.0, 0.0, 0.25), 99.0, 2 * math.sqrt(0.25 / 4.0)),
        # 5 mm of which 4 are in Z: 2 mm/s there are 2.5 mm/s on the way, 4 mm/s² are 5.
        ((3.0, 0.0, 4.0), 99.0, 5.0 / 2.5 + 2.5 / 5.0),
        # 13 mm of which 12 in X: 10.83 mm/s by X, 13 mm/s by Y; 26 mm/s² by Y.
        ((12.0, 5.0, 0.0), 99.0, 13.0 / (10.0 * 13.0 / 12.0) + (10.0 * 13.0 / 12.0) / 26.0),
        ((0.0, 0.0, 0.0), 1.0, 0.0),
    ],
)
def test_a_move_is_first_polled_when_length_and_axis_limits_predict_its_end(
    board: Board,
    by_mm: tuple[float, float, float],
    speed_mm_s: float,
    expected_s: float,
) -> None:
    board.answers[b"$$\n"] = LIMITS
    board.status = at("Idle", -30.0, -30.0, -30.0)
    stage = connected(board)
    x_mm, y_mm, z_mm = (-30.0 + mm for mm in by_mm)
    board.status = at("Idle", x_mm, y_mm, z_mm)
    stage.move_to(x_mm=x_mm, y_mm=y_mm, z_mm=z_mm, speed_mm_s=speed_mm_s)
    (line,) = (data for data in board.said if data.startswith(b"G1"))
    assert _asked_s(board, line) == pytest.approx([expected_s])


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("off_mm", [-0.003, -0.002, 0.002, 0.003])
def test_each_axis_must_arrive_within_one_of_its_own_steps(board: Board, axis: str, off_mm: float) -> None:
    """Of 0.0025 mm; the other axes of this board have steps of a tenth of it, and were not told to go anywhere."""
    fine = "\r\n".join(f"${100 + k}={400 if one == axis else 4000}" for k, one in enumerate("xyz"))
    board.answers[b"$$\n"] = fine.encode() + b"\r\n$13=0\r\nok\r\n"
    stage = connected(board)
    board.status = at("Idle", **{f"{one}_mm": -5.0 + (off_mm if one == axis else 1.0) for one in "xyz"})
    if abs(off_mm) < 0.0025:
        stage.move_to(**{f"{axis}_mm": -5.0}, speed_mm_s=1.0)  # type: ignore[arg-type]
    else:
        with raises(StageError, "not_there", axis=axis.upper(), target_mm=-5.0):
            stage.move_to(**{f"{axis}_mm": -5.0}, speed_mm_s=1.0)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "move",
    [
        lambda stage: stage.move_to(x_mm=-11.0, speed_mm_s=1.0),
        lambda stage: stage.jog("x", -10.0, 1.0),
        lambda stage: stage.jog("z", -1.0, 1.0),
    ],
    ids=["move", "jog", "jog down"],
)
def test_while_a_speed_override_is_active_no_motion_is_sent(
    board: Board, move: Callable[[GrblStage], object]
) -> None:
    stage = connected(board)
    board.status = b"<Idle|MPos:-1.000,-2.000,-3.000|FS:0,0|Ov:50,100,100>\r\n"
    stage.status()
    board.heard.clear()
    with raises(StageOverridden, "overridden", feed_percent=50):
        move(stage)
    assert board.said == []


STEPS = {"x": 400.0, "y": 250.0, "z": 80.0}


@pytest.mark.parametrize(
    ("axis", "to_mm", "step_mm"),
    [("x", -5.0012, -5.0), ("x", -5.0013, -5.0025), ("y", -5.0019, -5.0), ("y", -5.0021, -5.004),
     ("x", -5.03125, -5.0325), ("x", 5.03125, 5.0325),
     ("z", -5.006, -5.0), ("z", -5.007, -5.0125), ("z", 5.007, 5.0125)],
)  # fmt: skip
def test_a_target_is_rounded_to_the_nearest_step_of_its_axis(
    board: Board, axis: str, to_mm: float, step_mm: float
) -> None:
    """Half a step is rounded away from zero, as by the board. −1, −2 and −3 mm are whole steps of all three axes."""
    told = "".join(f"${100 + k}={per_mm}\r\n" for k, per_mm in enumerate(STEPS.values()))
    board.answers[b"$$\n"] = told.encode() + b"$13=0\r\nok\r\n"
    stage = connected(board)
    place = {"x_mm": -1.0, "y_mm": -2.0, "z_mm": -3.0}
    board.status = at("Idle", **{**place, f"{axis}_mm": step_mm})
    stage.move_to(**{f"{axis}_mm": to_mm}, speed_mm_s=1.0)  # type: ignore[arg-type]
    (line,) = (data for data in board.said if data.startswith(b"G92"))
    number = line.partition(axis.upper().encode())[2]
    assert float(re.match(rb"[-.\d]+", number)[0]) == pytest.approx(place[f"{axis}_mm"] - step_mm, abs=1e-6)  # type: ignore[index]


# --- homing ---

HOMES = "$13=0\r\n$27={off}\r\n$23={down}\r\n$130=60.0\r\n$131=30.0\r\n{z}ok\r\n"


@pytest.mark.parametrize(
    ("down", "off", "z", "home"),
    [
        (0, 1.0, "$132=40.0\r\n", (-1.0, -1.0, -1.0)),
        (0, 0.5, "$132=40.0\r\n", (-0.5, -0.5, -0.5)),
        (1, 1.0, "$132=40.0\r\n", (-59.0, -1.0, -1.0)),
        (3, 1.0, "$132=40.0\r\n", (-59.0, -29.0, -1.0)),
        (2, 0.5, "", (-0.5, -29.5, -0.5)),
    ],
)
def test_homing_ends_at_the_position_that_the_board_settings_define(
    board: Board, down: int, off: float, z: str, home: tuple[float, float, float]
) -> None:
    """Off its switch by $27, at the end that $23 names for each axis."""
    board.answers[b"$$\n"] = HOMES.format(off=off, down=down, z=z).encode()
    stage = connected(board, homed=False)
    board.status = at("Idle", *home)
    stage.home()
    assert stage.homed
    for axis in range(3):
        elsewhere = [mm + 0.01 * (k == axis) for k, mm in enumerate(home)]
        board.status = at("Idle", *elsewhere)
        with raises(StageError, "did_not_home", axis="XYZ"[axis], at_mm=elsewhere[axis], target_mm=home[axis]):
            stage.home()
        assert not stage.homed


@pytest.mark.parametrize("options", ["VZ,15,128", "VNMPZHL,35,1024,3,0", "Z"])
@pytest.mark.parametrize("off", [0.5, 1.0])
def test_homing_a_board_with_option_z_ends_at_its_origin(board: Board, options: str, off: float) -> None:
    """GRBL built with HOMING_FORCE_SET_ORIGIN: where homing ends is 0, whatever the pull-off."""
    board.answers[b"$I\n"] = f"[VER:1.1h.20190825:Z]\r\n[OPT:{options}]\r\nok\r\n".encode()
    board.answers[b"$$\n"] = HOMES.format(off=off, down=0, z="$132=40.0\r\n").encode()
    stage = connected(board, homed=False)
    board.status = at("Idle", 0.0, 0.0, 0.0)
    stage.home()
    assert stage.homed
    for elsewhere in ((-off, -off, -off), (0.0, 0.01, 0.0)):
        board.status = at("Idle", *elsewhere)
        with raises(StageError, "did_not_home"):
            stage.home()
        assert not stage.homed


@pytest.mark.parametrize(
    ("options", "down", "wanted"),
    [*(("VZ,15,128", down, 0) for down in (1, 2, 3, 4, 7)), ("V,15,128", 3, None), ("V,15,128", 7, 3)],
)
def test_a_board_with_option_z_must_home_every_axis_at_its_positive_end(
    board: Board, options: str, down: int, wanted: int | None
) -> None:
    """Otherwise its positions would be positive, and each move beyond its soft limits."""
    board.answers[b"$I\n"] = f"[VER:1.1h.20190825:]\r\n[OPT:{options}]\r\nok\r\n".encode()
    board.answers[b"$$\n"] = HOMES.format(off=1.0, down=down, z="$132=40.0\r\n").encode()
    if wanted is None:
        connected(board, homed=False)
    else:
        with raises(StageError, "not_as_configured", settings=f"$23={wanted} (found {down}, with"):
            connected(board, homed=False)


@pytest.mark.parametrize(("after_s", "fine"), [(1.85, True), (2.25, False)])
def test_a_board_that_has_not_begun_homing_after_two_seconds_has_failed(
    board: Board, clock: VirtualClock, after_s: float, fine: bool
) -> None:
    """Until then it may say that it is idle; some say nothing while they home, and `Home` once."""
    clock.wait_s(1000.0)
    stage = connected(board)
    board.answers[b"$H\n"] = [(after_s, at("Home")), (after_s + 0.01, b"ok\r\n")]
    if fine:
        stage.home()
    else:
        with raises(StageTimeout, "does_not_home", state="Idle"):
            stage.home()
        with raises(StageError, "needs_reset"):
            stage.jog("x", 0.1, 1.0)
    assert stage.homed is fine


@pytest.mark.parametrize("verb", ["home", "halt"])
def test_a_stop_from_another_thread_leaves_the_stage_unhomed(board: Board, verb: str) -> None:
    """It comes with the first status that is asked for meanwhile."""
    stage = connected(board)
    answer, told = board._answer, b"$H\n" if verb == "home" else b"!"

    def stopped_meanwhile(data: bytes) -> bytes | list[At]:
        if data == b"?" and told in board.said:
            board._answer = answer  # type: ignore[method-assign]
            stage.stop()
        return answer(data)

    board._answer = stopped_meanwhile  # type: ignore[method-assign]
    with suppress(StageError):
        getattr(stage, verb)()
    assert b"!\x18" in board.said
    assert not stage.homed


def test_an_ok_without_homing_does_not_count_as_homed(board: Board) -> None:
    """That of `$X`, which one wrong bit makes of `$H`."""
    stage = connected(board)
    board.answers[b"$H\n"] = b"ok\r\n"
    with raises(StageError, "did_not_home"):
        stage.home()
    assert not stage.homed


# --- a halt ---


def test_a_feed_hold_is_repeated_while_the_board_still_runs(board: Board) -> None:
    """While the board runs, each 20 ms; not while it slows down."""
    stage = connected(board)
    board.next[b"?"] = [at("Run"), at("Run"), at("Hold:1"), at("Hold:0"), at("Idle")]
    stage.halt()
    assert board.said == [b"!", b"?", b"!", b"?", b"!", b"?", b"?", b"\x18", b"?"]
    assert stage.homed


# --- jogs ---


@pytest.mark.parametrize(("axis", "zero"), [("x", "X0.1Y0Z0"), ("y", "X0Y0.1Z0"), ("z", "X0Y0Z0.1")])
def test_a_jog_is_sent_only_from_rest_and_to_a_confirmed_target(board: Board, axis: Any, zero: str) -> None:
    stage = connected(board)
    stage.jog(axis, -0.1, 1.0)
    assert board.said == [f"G92{zero}G90G21G94F60\n".encode(), b"?", f"$J={axis.upper()}0F60\n".encode()]
    answer = board._answer
    board._answer = lambda data: at("Jog") if data == b"?" else answer(data)  # type: ignore[method-assign]
    with raises(StageError, "not_idle", state="Jog"):
        stage.jog(axis, -0.1, 1.0)
    assert len([data for data in board.said if data.startswith(b"$J=")]) == 1


def test_a_canceled_jog_is_over_once_the_board_rests_for_half_a_second(board: Board, clock: VirtualClock) -> None:
    """Whatever it says: some grblHAL boards report Jog for ever."""
    stage = connected(board)
    board.status = at("Jog")
    begun_s = clock.monotonic_s()
    stage.end_jog()
    assert clock.monotonic_s() - begun_s == pytest.approx(0.5, abs=0.021)
    assert board.said[0] == b"\x85"


def test_a_jog_cancel_is_repeated_each_half_second_for_five_seconds(board: Board, clock: VirtualClock) -> None:
    stage = connected(board)
    begun_s, answer = clock.monotonic_s(), board._answer
    board._answer = lambda data: at("Jog", -clock.monotonic_s()) if data == b"?" else answer(data)  # type: ignore[method-assign]
    with raises(StageTimeout, "still_jogging", timeout_s=5.0):
        stage.end_jog()
    assert clock.monotonic_s() - begun_s == pytest.approx(5.0, abs=0.021)
    assert [t_s - begun_s for t_s in board.times(b"\x85")] == pytest.approx([0.5 * k for k in range(10)], abs=0.2)


# --- the ends of the travel ---


@pytest.mark.parametrize(
    ("to_mm", "told_mm"),
    [(0.0, -0.0002), (math.nextafter(0.0, 1.0), -0.0002), (-39.5, -39.5), (-40.0, -39.9998), (-40.01, -40.01)],
)
def test_a_target_at_an_end_of_the_travel_is_sent_just_within_it(board: Board, to_mm: float, told_mm: float) -> None:
    """The board compares in 24 bits; what lies beyond is for it to refuse."""
    board.answers[b"$$\n"] = b"$13=0\r\n$132=40.000\r\nok\r\n"
    board.status = at("Idle", z_mm=-20.0)
    stage = connected(board)
    board.status = at("Idle", z_mm=to_mm)
    stage.move_to(z_mm=to_mm, speed_mm_s=1.0)
    (line,) = (data for data in board.said if data.startswith(b"G92"))
    assert float(line.partition(b"Z")[2].partition(b"G")[0]) == pytest.approx(-20.0 - told_mm, abs=1e-6)


# --- how long it waits, and which answers it believes ---


def _lasts_s(clock: VirtualClock, act: Callable[[], object], code: str) -> float:
    begun_s = clock.monotonic_s()
    with raises(StageTimeout, code):
        act()
    return clock.monotonic_s() - begun_s


@pytest.mark.parametrize(
    "garbled",
    [
        b"<Idle|MPos:-1.000,-2.000,-13.500|FS:0,0\r\n",
        b"<Idle|MPos:-1.000,-2.000,-1\r\n",
        b"Idle|MPos:-1.000,-2.000,-13.500|FS:0,0>\r\n",
        b"<<Idle|MPos:-1.000,-2.000,-13.500|FS:0,0>\r\n",
        b"le|MPos:-1.000,-2.000,-13.500|FS:0,0>\r\n",
        b"<Idle|MPos:-1.000,-2.0<Idle|MPos:-1.000,-2.000,-13.500|FS:0,0>\r\n",
        b"<Idle|MPos:inf,-2.000,-13.500>\r\n",
        b"<Idle|MPos:inf,-inf,-13.500>\r\n",
        b"<Idle|MPos:-1.000,-2.000,-1e999>\r\n",
        b"<Idle|MPos:-1.000,inf,-13.500>\r\n",
        b"<Idle|MPos:nan,-2.000,-13.500>\r\n",
    ],
)
def test_a_damaged_status_report_is_requested_again(board: Board, garbled: bytes) -> None:
    """A number that was cut short is another number."""
    stage = connected(board)
    board.next[b"?"] = [garbled]
    assert stage.status().z_mm == -3.0
    assert board.said == [b"?", b"?"]


class Slow(Board):
    """A board whose answers all come late, in their order."""

    late_s = 0.0

    def _answer(self, data: bytes) -> bytes | list[At]:
        answer = super()._answer(data)
        chunks = [(0.0, answer)] if isinstance(answer, bytes) else answer
        return [(after_s + self.late_s, chunk) for after_s, chunk in chunks]


@pytest.mark.parametrize("late_s", [0.0, 0.09, 0.11, 0.29])
@pytest.mark.parametrize("far_mm", [0.05, 0.5], ids=["near", "far"])
@pytest.mark.parametrize("to", ["jog", "move"])
def test_a_confirmation_that_answers_an_earlier_status_request_counts(
    clock: VirtualClock, to: str, far_mm: float, late_s: float
) -> None:
    """A board reports a new work zero once; while it owes an ok, it is asked every 0.1 s."""
    board = Slow(clock)
    stage = connected(board)
    board.late_s = late_s
    if to == "jog":
        stage.jog("x", -far_mm, 5.0)
    else:
        with raises(StageError, "not_there"):  # this board stays where it is
            list(stage.moving(x_mm=-1.0 - far_mm, speed_mm_s=5.0))
    trigger = [data for data in board.said if data.startswith((b"$J=", b"G1"))]
    assert len(trigger) == 1
    assert len([data for data in board.said if data.startswith(b"G92")]) == 1


def test_a_work_offset_reported_before_the_line_was_executed_confirms_nothing(clock: VirtualClock) -> None:
    board = Slow(clock)
    stage = connected(board)
    board.late_s = 0.15
    old = b"<Idle|MPos:-1.000,-2.000,-3.000|FS:0,0|WCO:-0.500,-2.000,-3.000>\r\n"
    board._answer = lambda data: [(0.0, old)] if data == b"?" else Slow._answer(board, data)  # type: ignore[method-assign]
    board.status = at("Idle")
    with raises(StageError, "not_confirmed"):
        stage.jog("x", -0.5, 5.0)
    assert not [data for data in board.said if data.startswith(b"$J=")]


def test_a_work_offset_of_an_earlier_motion_confirms_nothing(board: Board) -> None:
    """Told the same target again, the board reports no work zero: that of the first time says nothing."""
    stage = connected(board)
    stage.move_to(x_mm=-1.0, speed_mm_s=1.0)
    board.heard.clear()
    answer = board._answer
    board._answer = lambda data: at("Idle") if data == b"?" else answer(data)  # type: ignore[method-assign]
    with raises(StageError, "not_confirmed", doubt="contains no WCO"):
        stage.move_to(x_mm=-1.0, speed_mm_s=1.0)
    assert not [data for data in board.said if data.startswith(b"G1")]


def test_a_work_offset_reported_while_the_board_owes_an_ok_confirms_nothing(clock: VirtualClock) -> None:
    """Of an earlier motion to the same target: it is reported while the line is owed an ok, and not after that."""
    board = Slow(clock)
    stage = connected(board)
    stage.move_to(x_mm=-1.0, speed_mm_s=1.0)
    earlier = b"<Idle|MPos:-1.000,-2.000,-3.000|FS:0,0|WCO:-1.000,-2.000,-3.000>\r\n"
    board.heard.clear()

    def answer(data: bytes) -> bytes | list[At]:
        if data.startswith(b"G92"):
            return [(0.15, b"ok\r\n")]
        asked = len(board.times(b"?"))
        return (earlier if asked == 1 else at("Idle")) if data == b"?" else Board._answer(board, data)

    board._answer = answer  # type: ignore[method-assign]
    with raises(StageError, "not_confirmed", doubt="contains no WCO"):
        stage.move_to(x_mm=-1.0, speed_mm_s=1.0)
    assert board.times(b"?")[0] < board.heard[0][0] + 0.15
    assert not [data for data in board.said if data.startswith(b"G1")]


def test_a_known_work_offset_is_discarded_once_a_line_that_sets_it_was_sent(board: Board) -> None:
    """The board may have obeyed though it did not answer: its work coordinates count from elsewhere then."""
    work = "<Idle|WPos:{}|FS:0,0{}>\r\n"
    board.next[b"?"] = [work.format("1.000,2.000,3.000", "|WCO:-10.000,-10.000,-10.000").encode()]
    board.status = work.format("1.000,2.000,3.000", "").encode()
    stage = connected(board)
    assert stage.status() == StageStatus("Idle", -9.0, -8.0, -7.0)
    new = [work.format("0.000,0.000,0.000", offset).encode() for offset in ("", "|WCO:-9.000,-8.000,-7.000")]
    usual = board._answer
    board._answer = lambda data: b"" if data.startswith(b"G92") else usual(data)  # type: ignore[method-assign]
    with raises(StageTimeout, "no_reply"):
        stage.jog("x", -0.05, 1.0)
    board.next[b"?"] = [*new]
    assert stage.status() == StageStatus("Idle", -9.0, -8.0, -7.0)


@pytest.mark.parametrize(
    ("state", "code"), [("Hold:0", "held"), ("Door:1", "held"), ("Run", "not_idle"), ("Alarm", "not_idle")]
)
@pytest.mark.parametrize("to", ["jog", "move"])
def test_a_target_confirmed_by_a_board_that_is_not_idle_starts_no_motion(
    board: Board, state: str, code: str, to: str
) -> None:
    stage = connected(board)
    answer = board._answer
    board._answer = lambda data: at(state) if data == b"?" else answer(data)  # type: ignore[method-assign]
    with raises(StageError, code, state=state):
        stage.jog("x", -0.05, 1.0) if to == "jog" else stage.move_to(x_mm=-1.05, speed_mm_s=1.0)
    assert not [data for data in board.said if data.startswith((b"$J=", b"G1"))]


@pytest.mark.parametrize(
    ("printed", "missing"),
    [
        ("[MSG:G90 G21 G94 F60]\r\n[GC:G90 G1 G21 G94 F60]", None),
        ("[GC:G90 G1 G21 G94 F60", ["G21", "G90", "G94"]),
        ("GC:G90 G1 G21 G94 F60]", ["G21", "G90", "G94"]),
        ("", ["G21", "G90", "G94"]),
        ("[GC:]", ["G21", "G90", "G94"]),
    ],
)
def test_modal_state_counts_only_in_a_complete_report_line(
    board: Board, printed: str, missing: list[str] | None
) -> None:
    stage = connected(board)
    board.answers[b"$G\n"] = f"{printed}\r\nok\r\n".encode()
    if missing is None:
        stage.jog("x", -0.5, 1.0)
    else:
        with raises(StageError, "not_confirmed", doubt=f"$G does not show {', '.join(missing)})"):
            stage.jog("x", -0.5, 1.0)


@pytest.mark.parametrize(("wrong", "missing"), [("G91", "G90"), ("G20", "G21"), ("G93", "G94"), ("", "G90")])
def test_a_long_motion_starts_only_in_confirmed_absolute_millimeter_modes(
    board: Board, wrong: str, missing: str
) -> None:
    """Absolute, in millimetres, by feed per minute; a short one is over before they matter."""
    stage = connected(board)
    modes = "G1 G54 G17 G21 G90 G94 M5 M9 T0 F60 S0".replace(missing, wrong)
    board.answers[b"$G\n"] = f"[GC:{modes}]\r\nok\r\n".encode()
    with raises(StageError, "not_confirmed", doubt=f"$G does not show {missing})"):
        stage.move_to(x_mm=-1.2, speed_mm_s=1.0)
    assert not [data for data in board.said if data.startswith(b"G1")]
    with raises(StageError, "not_there"):  # this board stays where it is
        stage.move_to(x_mm=-1.1, speed_mm_s=1.0)


@pytest.mark.parametrize(
    ("shown", "found_mm_min"),
    [("F60", 60), ("F59.5", 59.5), ("F60.5", 60.5), ("F59", 59.0), ("F61", 61.0), ("F600", 600.0), ("", None)],
)
def test_the_feed_is_confirmed_to_half_a_millimeter_a_minute(
    board: Board, shown: str, found_mm_min: float | None
) -> None:
    """It may print whole mm/min: half of one is no difference. No feed at all is none."""
    stage = connected(board)
    board.answers[b"$G\n"] = f"[GC:G90 G54 G17 G21 G1 G94 M5 M9 T0 S0 {shown}]\r\nok\r\n".encode()
    if found_mm_min is not None and abs(found_mm_min - 60.0) <= 0.5:
        stage.jog("x", -0.5, 1.0)
    else:
        doubt = f"$G shows a feed of {found_mm_min} mm/min instead of 60 mm/min"
        with raises(StageError, "not_confirmed", doubt=doubt):
            stage.jog("x", -0.5, 1.0)
        assert not [data for data in board.said if data.startswith(b"$J=")]


def test_a_reset_without_a_banner_is_repeated_once_after_three_seconds(board: Board, clock: VirtualClock) -> None:
    stage = connected(board)
    stage.stop()
    board.heard.clear()
    board.answers[b"\x18"] = b""
    assert _lasts_s(clock, stage.unlock, "no_banner") == pytest.approx(2 * 3.0)
    assert board.said == [b"\x18"] * 2
    board.answers[b"\x18"] = [(2.9, BANNER)]
    stage.unlock()
    assert board.said == [b"\x18"] * 3 + [b"$X\n"]


def test_a_reset_discards_all_answers_from_before(board: Board) -> None:
    """Late answers, an alarm's text, the banner of a reset before it, and half a line."""
    stage = connected(board)
    stage.stop()
    board.says(b"ok\r\nALARM:3\r\n[MSG:Reset to continue]\r\n" + BANNER + b"<Idle|MP")
    board.answers[b"\x18"] = [(0.5, BANNER)]
    board.answers[b"$X\n"] = b"error:9\r\n"
    with raises(StageRejected, "line_refused", number=9, line="$X"):
        stage.unlock()


@pytest.mark.parametrize("asked_for", [True, False], ids=["the driver's", "the board's own"])
def test_after_a_reset_the_driver_waits_for_a_new_work_offset(board: Board, asked_for: bool) -> None:
    """A board may come up with another."""
    work = "<Idle|WPos:1.000,2.000,3.000|FS:0,0{}>\r\n"
    board.status = work.format("").encode()
    board.next[b"?"] = [work.format("|WCO:-10.000,-10.000,-10.000").encode()]
    stage = connected(board)
    assert stage.status() == StageStatus("Idle", -9.0, -8.0, -7.0)
    if asked_for:
        stage.stop()
        stage.unlock()
    else:
        board.says(BANNER)
    board.next[b"?"] = [work.format("").encode(), work.format("|WCO:-20.000,-20.000,-20.000").encode()]
    assert stage.look() == StageStatus("Idle", -19.0, -18.0, -17.0)


# --- what never comes ---


def _deaf_to_resets(clock: VirtualClock, status: bytes) -> tuple[Board, GrblStage]:
    clock.wait_s(1000.0)
    board = Board(clock, status)
    board.answers[b"\x18"] = b""
    stage = connected(board, homed=False)
    stage._link.trusted = True
    return board, stage


def test_homing_fails_after_three_minutes(clock: VirtualClock) -> None:
    board, stage = _deaf_to_resets(clock, at("Home"))
    board.answers[b"$H\n"] = b""
    assert _lasts_s(clock, stage.home, "no_reply") == pytest.approx(180.0)
    assert not stage.homed


def test_a_halt_without_rest_fails_after_two_seconds_and_sends_no_reset(clock: VirtualClock) -> None:
    """A reset in motion would lose the position."""
    board, stage = _deaf_to_resets(clock, at("Run"))
    assert _lasts_s(clock, stage.halt, "not_at_rest") == pytest.approx(2.0, abs=0.021)
    assert board.said[0] == b"!"
    assert b"\x18" not in board.said


def test_resuming_a_board_that_stays_held_fails_after_five_seconds(clock: VirtualClock) -> None:
    _, stage = _deaf_to_resets(clock, at("Hold:0"))
    assert _lasts_s(clock, stage.resume, "still_held") == pytest.approx(5.0, abs=0.021)


@pytest.mark.parametrize("after", ["Idle", "Alarm"])
def test_a_halt_that_ends_in_an_alarm_leaves_the_stage_unhomed(clock: VirtualClock, after: str) -> None:
    board, stage = _deaf_to_resets(clock, at("Hold:0"))
    board.answers[b"\x18"] = BANNER
    write = board.write

    def reset(data: bytes) -> None:
        if data == b"\x18":
            board.status = at(after)
        write(data)

    board.write = reset  # type: ignore[method-assign]
    with nullcontext() if after == "Idle" else raises(StageError, "lost_in_halt", state="Alarm"):
        stage.halt()
    assert stage.homed is (after == "Idle")
    assert board.said == [b"!", b"?", b"\x18", b"?"]
