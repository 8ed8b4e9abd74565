"""When the position of a GRBL stage is trusted, and what it takes to find it again: by the wire alone."""

from collections.abc import Callable

import pytest

from rig.devices.base import StageAlarm, StageError, StageRejected, StageReset, StageTimeout
from rig.devices.grbl import GrblStage
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.scripted_board import BANNER, Board, at, connected


@pytest.fixture
def board(clock: VirtualClock) -> Board:
    return Board(clock)


def _told(board: Board) -> list[bytes]:
    """All but the questions where it is."""
    return [data for data in board.said if data != b"?"]


def _no_answer_to_a_line(board: Board, stage: GrblStage) -> None:
    board.answers[b"G1X0\n"] = b""
    with raises(StageTimeout, "no_reply", line="G1X0"):
        stage.move_to(x_mm=-2.0, speed_mm_s=1.0)


def _no_answer_to_the_status_question(board: Board, stage: GrblStage) -> None:
    board.next[b"?"] = [b"", b"", b""]
    with raises(StageTimeout, "no_status"):
        stage.status()


def _alarm(board: Board, stage: GrblStage) -> None:
    board.says(b"ALARM:1\r\n")
    with raises(StageAlarm, "alarm", number=1):
        stage.status()


def _banner(board: Board, stage: GrblStage) -> None:
    board.says(BANNER)
    with raises(StageReset, "was_reset"):
        stage.status()


def _lost_arrival(board: Board, stage: GrblStage) -> None:
    board.answers[b"$H\n"] = b""
    with raises(StageTimeout, "does_not_home", state="Idle"):
        stage.home()


def _refused_homing(board: Board, stage: GrblStage) -> None:
    board.answers[b"$H\n"] = b"error:5\r\n"
    with raises(StageRejected, "line_refused", number=5, line="$H"):
        stage.home()


def _homed_but_deaf(board: Board, stage: GrblStage) -> None:
    board.next[b"?"] = [b"", b"", b""]
    with raises(StageTimeout, "no_status"):
        stage.home()


def _stop(board: Board, stage: GrblStage) -> None:
    stage.stop()


def _unlock(board: Board, stage: GrblStage) -> None:
    stage.unlock()


def _connect(board: Board, stage: GrblStage) -> None:
    stage.connect()


def _halt_that_never_rests(board: Board, stage: GrblStage) -> None:
    board.status = at("Hold:0")
    board.answers[b"\x18"] = b""
    with raises(StageTimeout, "no_banner"):
        stage.halt()


LOSSES = [
    _no_answer_to_a_line, _no_answer_to_the_status_question, _alarm, _banner, _lost_arrival, _refused_homing,
    _homed_but_deaf, _stop, _unlock, _connect, _halt_that_never_rests,
]  # fmt: skip
NEEDS_A_RESET = [_no_answer_to_a_line, _alarm, _banner, _lost_arrival, _stop]


@pytest.mark.parametrize("loss", LOSSES)
def test_every_loss_of_the_position_leaves_the_stage_unhomed_until_homing(
    board: Board, loss: Callable[[Board, GrblStage], None]
) -> None:
    """Homing begins with a reset where the board may still owe an answer, and only there."""
    stage = connected(board)
    usual = dict(board.answers)
    assert stage.homed
    loss(board, stage)
    assert not stage.homed
    with raises(StageError, "needs_reset" if loss in NEEDS_A_RESET else "not_homed"):
        stage.move_to(x_mm=-1.0, speed_mm_s=1.0)
    board.answers, board.status, board.next = usual, at("Idle"), {}
    board.heard.clear()
    stage.home()
    assert stage.homed
    assert _told(board) == [b"\x18", b"$H\n"][loss not in NEEDS_A_RESET :]
    stage.move_to(x_mm=-1.0, speed_mm_s=1.0)


def test_before_connecting_the_stage_is_unhomed_and_sends_no_line_but_homing(
    board: Board, clock: VirtualClock
) -> None:
    """What the board was told before is not known; homing begins with a reset and needs no connection."""
    stage = GrblStage(board, clock)
    assert not stage.homed
    for act in (lambda: stage.move_to(x_mm=-1.0, speed_mm_s=1.0), lambda: stage.jog("x", -1.0, 1.0), stage.settings):
        with raises(StageError, "needs_reset"):
            act()
    assert board.said == []
    stage.home()
    assert _told(board) == [b"\x18", b"$H\n"]
    assert stage.homed


@pytest.mark.parametrize("state", ["Idle", "Hold:0"])
def test_a_halt_keeps_a_stage_homed_or_unhomed(board: Board, state: str) -> None:
    for homed in (True, False):
        stage = connected(board, homed=homed)
        board.status = at(state)
        board.next[b"?"] = [at("Hold:1"), at(state), at("Idle")]
        stage.halt()
        assert stage.homed is homed
        assert board.said == [b"!", b"?", b"?", b"\x18", b"?"]
        board.status = at("Idle")


def test_a_line_that_the_board_refuses_keeps_the_stage_homed(board: Board) -> None:
    stage = connected(board)
    board.answers[b"$J=X0F60\n"] = b"error:15\r\n"
    with raises(StageRejected, "line_refused", number=15):
        stage.jog("x", 1.0, 1.0)
    assert stage.homed
    stage.move_to(x_mm=-1.0, speed_mm_s=1.0)
