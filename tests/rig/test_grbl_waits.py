"""How long the GRBL driver waits for an answer, and which answers it believes: by the wire alone."""

from collections.abc import Callable
from contextlib import nullcontext

import pytest

from rig.devices.base import StageError, StageRejected, StageStatus, StageTimeout
from rig.devices.grbl import GrblStage
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.scripted_board import BANNER, SETTINGS, At, Board, at, connected


@pytest.fixture
def board(clock: VirtualClock) -> Board:
    return Board(clock)


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
def test_a_damaged_status_is_not_believed(board: Board, garbled: bytes) -> None:
    """A number that was cut short is another number."""
    stage = connected(board)
    board.next[b"?"] = [garbled]
    assert stage.status().z_mm == -3.0
    assert board.said == [b"?", b"?"]


def test_a_line_is_answered_within_two_seconds(board: Board, clock: VirtualClock) -> None:
    stage = connected(board)
    board.next[b"$$\n"] = [[(1.99, SETTINGS)], b""]
    assert stage.settings()[100] == 400.0
    assert _lasts_s(clock, stage.settings, "no_reply") == pytest.approx(2.0)


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
def test_a_confirmation_may_answer_an_earlier_request(
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


def test_an_offset_from_before_the_line_was_executed_is_not_a_confirmation(clock: VirtualClock) -> None:
    board = Slow(clock)
    stage = connected(board)
    board.late_s = 0.15
    old = b"<Idle|MPos:-1.000,-2.000,-3.000|FS:0,0|WCO:-0.500,-2.000,-3.000>\r\n"
    board._answer = lambda data: [(0.0, old)] if data == b"?" else Slow._answer(board, data)  # type: ignore[method-assign]
    board.status = at("Idle")
    with raises(StageError, "not_confirmed"):
        stage.jog("x", -0.5, 5.0)
    assert not [data for data in board.said if data.startswith(b"$J=")]


def test_an_offset_of_an_earlier_motion_is_not_a_confirmation(board: Board) -> None:
    """Told the same target again, the board reports no work zero: that of the first time says nothing."""
    stage = connected(board)
    stage.move_to(x_mm=-1.0, speed_mm_s=1.0)
    board.heard.clear()
    answer = board._answer
    board._answer = lambda data: at("Idle") if data == b"?" else answer(data)  # type: ignore[method-assign]
    with raises(StageError, "not_confirmed", doubt_code="no_offset"):
        stage.move_to(x_mm=-1.0, speed_mm_s=1.0)
    assert not [data for data in board.said if data.startswith(b"G1")]


def test_an_offset_that_the_board_reports_before_it_has_obeyed_is_not_a_confirmation(clock: VirtualClock) -> None:
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
    with raises(StageError, "not_confirmed", doubt_code="no_offset"):
        stage.move_to(x_mm=-1.0, speed_mm_s=1.0)
    assert board.times(b"?")[0] < board.heard[0][0] + 0.15
    assert not [data for data in board.said if data.startswith(b"G1")]


def test_an_offset_is_not_used_any_more_once_a_line_that_sets_it_was_sent(board: Board) -> None:
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
def test_a_board_that_confirms_a_target_must_be_idle(board: Board, state: str, code: str, to: str) -> None:
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
def test_modes_are_believed_in_a_whole_line_alone(board: Board, printed: str, missing: list[str] | None) -> None:
    stage = connected(board)
    board.answers[b"$G\n"] = f"{printed}\r\nok\r\n".encode()
    if missing is None:
        stage.jog("x", -0.5, 1.0)
    else:
        with raises(StageError, "not_confirmed", doubt_code="modes_missing", missing=missing):
            stage.jog("x", -0.5, 1.0)


@pytest.mark.parametrize(("wrong", "missing"), [("G91", "G90"), ("G20", "G21"), ("G93", "G94"), ("", "G90")])
def test_the_modes_of_a_long_motion_are_confirmed(board: Board, wrong: str, missing: str) -> None:
    """Absolute, in millimetres, by feed per minute; a short one is over before they matter."""
    stage = connected(board)
    modes = "G1 G54 G17 G21 G90 G94 M5 M9 T0 F60 S0".replace(missing, wrong)
    board.answers[b"$G\n"] = f"[GC:{modes}]\r\nok\r\n".encode()
    with raises(StageError, "not_confirmed", doubt_code="modes_missing", missing=[missing]):
        stage.move_to(x_mm=-1.2, speed_mm_s=1.0)
    assert not [data for data in board.said if data.startswith(b"G1")]
    with raises(StageError, "not_there"):  # this board stays where it is
        stage.move_to(x_mm=-1.1, speed_mm_s=1.0)


@pytest.mark.parametrize(
    ("shown", "found_mm_min"),
    [("F60", 60), ("F59.5", 59.5), ("F60.5", 60.5), ("F59", 59.0), ("F61", 61.0), ("F600", 600.0), ("", None)],
)
def test_a_feed_is_confirmed_as_far_as_the_board_prints_it(
    board: Board, shown: str, found_mm_min: float | None
) -> None:
    """It may print whole mm/min: half of one is no difference. No feed at all is none."""
    stage = connected(board)
    board.answers[b"$G\n"] = f"[GC:G90 G54 G17 G21 G1 G94 M5 M9 T0 S0 {shown}]\r\nok\r\n".encode()
    if found_mm_min is not None and abs(found_mm_min - 60.0) <= 0.5:
        stage.jog("x", -0.5, 1.0)
    else:
        doubt = {"doubt_code": "wrong_feed", "found_mm_min": found_mm_min, "meant_mm_min": 60.0}
        with raises(StageError, "not_confirmed", **doubt):
            stage.jog("x", -0.5, 1.0)
        assert not [data for data in board.said if data.startswith(b"$J=")]


def test_a_banner_is_waited_for_three_seconds_and_twice(board: Board, clock: VirtualClock) -> None:
    stage = connected(board)
    stage.stop()
    board.heard.clear()
    board.answers[b"\x18"] = b""
    assert _lasts_s(clock, stage.unlock, "no_banner") == pytest.approx(2 * 3.0)
    assert board.said == [b"\x18"] * 2
    board.answers[b"\x18"] = [(2.9, BANNER)]
    stage.unlock()
    assert board.said == [b"\x18"] * 3 + [b"$X\n"]


def test_a_reset_forgets_what_came_before_it(board: Board) -> None:
    """Late answers, an alarm's text, the banner of a reset before it, and half a line."""
    stage = connected(board)
    stage.stop()
    board.says(b"ok\r\nALARM:3\r\n[MSG:Reset to continue]\r\n" + BANNER + b"<Idle|MP")
    board.answers[b"\x18"] = [(0.5, BANNER)]
    board.answers[b"$X\n"] = b"error:9\r\n"
    with raises(StageRejected, "line_refused", number=9, line="$X"):
        stage.unlock()


@pytest.mark.parametrize("asked_for", [True, False], ids=["the driver's", "the board's own"])
def test_after_a_reset_the_work_offset_is_waited_for_again(board: Board, asked_for: bool) -> None:
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


def test_homing_that_never_ends_has_three_minutes(clock: VirtualClock) -> None:
    board, stage = _deaf_to_resets(clock, at("Home"))
    board.answers[b"$H\n"] = b""
    assert _lasts_s(clock, stage.home, "no_reply") == pytest.approx(180.0)
    assert not stage.homed


def test_a_halt_that_never_rests_has_two_seconds_and_is_followed_by_no_reset(clock: VirtualClock) -> None:
    """A reset in motion would lose the position."""
    board, stage = _deaf_to_resets(clock, at("Run"))
    assert _lasts_s(clock, stage.halt, "not_at_rest") == pytest.approx(2.0, abs=0.021)
    assert board.said[0] == b"!"
    assert b"\x18" not in board.said


def test_a_held_board_that_does_not_go_on_has_five_seconds(clock: VirtualClock) -> None:
    _, stage = _deaf_to_resets(clock, at("Hold:0"))
    assert _lasts_s(clock, stage.resume, "still_held") == pytest.approx(5.0, abs=0.021)


@pytest.mark.parametrize("after", ["Idle", "Alarm"])
def test_a_halt_that_ends_in_an_alarm_has_lost_the_position(clock: VirtualClock, after: str) -> None:
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
