"""A stop from another thread closes the wires behind itself: nothing that was under way goes out any more."""

import threading
from collections.abc import Callable

import pytest

from rig.transport import stop_gate
from rig.transport.stop_gate import StopGate
from rig.transport.wire import TransportError
from tests.error_codes import raises
from tests.waiting import DEADLINE_S, until


class Wire:
    """What was written, in its order; `while_in` is done within each write and read."""

    name = "stage"

    def __init__(self) -> None:
        self.written: list[bytes] = []
        self.while_in: Callable[[bytes], object] = lambda data: None
        self.closed = False

    def write(self, data: bytes) -> None:
        self.while_in(data)
        self.written.append(data)

    def read(self, timeout_s: float) -> bytes:
        self.while_in(b"")
        return b"ok"[: int(timeout_s)]

    def close(self) -> None:
        self.closed = True


def elsewhere(action: Callable[[], object]) -> list[str]:
    """The codes of what it raised in a thread of its own."""
    raised: list[str] = []

    def act() -> None:
        try:
            action()
        except TransportError as error:
            raised.append(error.code)

    thread = threading.Thread(target=act)
    thread.start()
    thread.join(DEADLINE_S)
    assert not thread.is_alive()
    return raised


def test_without_a_stop_the_gate_passes_all_bytes() -> None:
    wire, gate = Wire(), StopGate()
    guarded = gate.guarded(wire)
    guarded.write(b"move")
    assert (guarded.name, guarded.read(1.0), guarded.read(2.0), wire.written) == ("stage", b"o", b"ok", [b"move"])
    assert not gate.closed
    guarded.close()
    assert wire.closed


def test_after_a_stop_no_byte_passes_until_the_gate_is_opened() -> None:
    wire, gate = Wire(), StopGate()
    guarded = gate.guarded(wire)
    with gate.stopping():
        guarded.write(b"stop")
    wire.while_in = lambda data: pytest.fail("what there is to hear is for who stops")
    for talk in (lambda: guarded.write(b"move"), lambda: guarded.read(2.0)):
        with raises(TransportError, "stopped", port="stage"):
            talk()
    assert wire.written == [b"stop"]
    assert gate.closed
    assert gate.open()
    wire.while_in = lambda data: None
    guarded.write(b"home")
    assert wire.written == [b"stop", b"home"]


def test_during_a_stop_only_its_thread_writes_and_reads() -> None:
    wire, gate = Wire(), StopGate()
    guarded = gate.guarded(wire)
    with gate.stopping():
        assert guarded.read(2.0) == b"ok"
        assert elsewhere(lambda: guarded.write(b"move")) == ["stopped"]
        assert elsewhere(lambda: guarded.read(2.0)) == ["stopped"]
        assert not gate.open()
        with gate.stopping():
            pass
        assert not gate.open(), "one of two stops is not over"
        guarded.write(b"stop")
    assert wire.written == [b"stop"]
    assert gate.open()


def test_bytes_that_arrive_during_a_stop_go_to_the_stopping_thread() -> None:
    wire, gate = Wire(), StopGate()

    def stop_meanwhile(data: bytes) -> None:
        with gate.stopping():
            wire.while_in = lambda data: None

    wire.while_in = stop_meanwhile
    with raises(TransportError, "stopped", port="stage"):
        gate.guarded(wire).read(2.0)


@pytest.mark.parametrize("stuck", [False, True])
def test_a_stop_waits_for_a_write_under_way_unless_it_is_stuck(stuck: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    assert stop_gate.STUCK_S == 0.05
    monkeypatch.setattr(stop_gate, "STUCK_S", 0.001 if stuck else DEADLINE_S)
    wire, gate, writing, go_on = Wire(), StopGate(), threading.Event(), threading.Event()
    guarded = gate.guarded(wire)

    def slow(data: bytes) -> None:
        if data == b"move":
            writing.set()
            assert go_on.wait(DEADLINE_S)

    def stop() -> None:
        with gate.stopping():
            guarded.write(b"stop")

    wire.while_in = slow
    threads = [threading.Thread(target=lambda: guarded.write(b"move")), threading.Thread(target=stop)]
    threads[0].start()
    assert writing.wait(DEADLINE_S)
    threads[1].start()
    if stuck:
        until(lambda: wire.written)
    go_on.set()
    for thread in threads:
        thread.join(DEADLINE_S)
        assert not thread.is_alive()
    assert wire.written == ([b"stop", b"move"] if stuck else [b"move", b"stop"])


def test_a_stop_past_a_stuck_write_leaves_the_lock_to_its_holder(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stuck write goes on to hold it, and a second stop does not wait for it either."""
    monkeypatch.setattr(stop_gate, "STUCK_S", 0.001)
    wire, gate = Wire(), StopGate()
    guarded = gate.guarded(wire)

    def stop_twice(data: bytes) -> None:
        wire.while_in = lambda data: None
        for _ in range(2):
            with gate.stopping():
                guarded.write(b"stop")

    wire.while_in = stop_twice
    guarded.write(b"move")
    assert wire.written == [b"stop", b"stop", b"move"]
    with raises(TransportError, "stopped", port="stage"):
        guarded.write(b"move")
