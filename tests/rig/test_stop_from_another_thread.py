"""A stage told to stop in the middle of whatever another thread asks of it: the bytes, and what it believes after."""

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest

from rig.clock import WallClock
from rig.devices.base import StageError
from rig.transport.modbus import ModbusMaster
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.scripted_board import Board, at, connected
from tests.waiting import DEADLINE_S

STOP = b"!\x18"


class Watched(Board):
    """A board at whose wire somebody stops the stage, once, when these bytes go out or come in."""

    stop: Callable[[], None] | None = None
    when = b""

    def write(self, data: bytes) -> None:
        super().write(data)
        self._met(data)

    def read(self, timeout_s: float) -> bytes:
        data = super().read(timeout_s)
        self._met(data)
        return data

    def _met(self, data: bytes) -> None:
        if self.stop is not None and self.when in data:
            stop, self.stop = self.stop, None
            stop()


@pytest.fixture
def board(clock: VirtualClock) -> Watched:
    return Watched(clock)


@pytest.mark.parametrize(
    ("when", "do"),
    [
        (b"G92", lambda stage: stage.move_to(z_mm=-2.0, speed_mm_s=1.0)),
        (b"$G", lambda stage: stage.move_to(z_mm=-2.0, speed_mm_s=1.0)),
        (b"WCO", lambda stage: stage.move_to(z_mm=-2.0, speed_mm_s=1.0)),
        (b"G1Z0", lambda stage: stage.move_to(z_mm=-2.0, speed_mm_s=1.0)),
        (b"?", lambda stage: stage.move_to(z_mm=-2.0, speed_mm_s=1.0)),
        (b"G92", lambda stage: stage.jog("z", 0.1, 1.0)),
        (b"$J", lambda stage: stage.jog("z", 0.1, 1.0)),
        (b"!", lambda stage: stage.halt()),
        (b"\x18", lambda stage: stage.halt()),
        (b"Grbl", lambda stage: stage.halt()),
        (b"$H", lambda stage: stage.home()),
        (b"Idle", lambda stage: stage.home()),
    ],
)
def test_a_stop_during_any_command_goes_out_and_nothing_moves_after_it(
    board: Watched, when: bytes, do: Callable[[Any], None]
) -> None:
    stage = connected(board)
    board.stop, board.when = stage.stop, when
    board.status = at("Idle")
    with suppress(StageError):
        do(stage)
    assert board.stop is None, "it came"
    assert STOP in board.said
    assert not stage.homed
    said = len(board.said)
    with pytest.raises(StageError):
        stage.move_to(z_mm=-1.0, speed_mm_s=1.0)
    assert not [data for data in board.said[said:] if data.startswith((b"G92", b"G1"))]


def test_no_line_follows_a_stop_that_is_being_sent(board: Watched) -> None:
    """Or a line of another thread could follow the reset and move a board that is ready again."""
    stage = connected(board)
    seen: list[bool] = []

    def write(data: bytes) -> None:
        seen.append(stage.homed)
        with raises(StageError, "needs_reset"):
            stage.move_to(z_mm=-1.0, speed_mm_s=1.0)

    board.write = write  # type: ignore[method-assign]
    stage.stop()
    assert seen == [False]


# --- drives ---


class Wire:
    """A Modbus wire that answers a write by its echo, when it may; notes who wrote what, in order."""

    name = "wire"

    def __init__(self) -> None:
        self.asked, self.may_answer = threading.Event(), threading.Event()
        self.sent: list[tuple[str, bytes]] = []
        self._due: list[bytes] = []

    def write(self, data: bytes) -> None:
        who = threading.current_thread().name
        self.sent.append((who, data))
        if data[0]:
            self._due.append(data)

    def read(self, timeout_s: float) -> bytes:
        if timeout_s > 0 and self._due:
            self.asked.set()
            assert self.may_answer.wait(DEADLINE_S)
            self.sent.append((threading.current_thread().name, b"answered"))
            return self._due.pop(0)
        return b""

    def close(self) -> None:
        """Nothing to close."""


def test_a_stop_passes_an_exchange_under_way_on_a_bus(rtu: Callable[[str], bytes]) -> None:
    wire = Wire()
    bus = ModbusMaster(wire, WallClock(), reply_s=DEADLINE_S)
    main = threading.Thread(target=lambda: bus.write_one(1, 0x6200, 7), name="main")
    main.start()
    assert wire.asked.wait(DEADLINE_S)

    def stop() -> None:
        bus.send_now([1, 2], 0x6002, 0x40)
        stopped.set()
        bus.write_one(2, 0x6002, 0x40)

    stopped = threading.Event()
    control = threading.Thread(target=stop, name="control")
    control.start()
    assert stopped.wait(DEADLINE_S), "it waits for nobody"
    wire.may_answer.set()
    for thread in (main, control):
        thread.join(DEADLINE_S)
    assert wire.sent == [
        ("main", rtu("01 06 62 00 00 07")),
        ("control", rtu("00 06 60 02 00 40")),
        ("main", b"answered"),
        ("control", rtu("02 06 60 02 00 40")),
        ("control", b"answered"),
    ]


def test_a_stop_does_not_wait_for_an_exchange_that_hangs(rtu: Callable[[str], bytes], clock: VirtualClock) -> None:
    wire = Wire()
    wire.may_answer.set()
    bus = ModbusMaster(wire, clock, reply_s=0.01)
    with bus._one:
        bus.write_one(2, 0x6002, 0x40)
        assert bus._one.locked(), "it is somebody else's"
    assert wire.sent[0][1] == rtu("02 06 60 02 00 40")
    bus.write_one(2, 0x6002, 0x40)
    assert not bus._one.locked()
