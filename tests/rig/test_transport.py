"""Transports: loopback, byte log, lines, and a serial port with a pseudo-terminal behind it."""

import errno
import io
import json
import os
import socket
from collections.abc import Callable, Iterator

import pytest
import serial

from rig.clock import WallClock
from rig.transport import (
    LineReader,
    LoggedTransport,
    LoopbackTransport,
    NotOwnedError,
    PortOwner,
    SerialTransport,
    TcpTransport,
    TransportError,
    open_port,
    port_owner,
    refuse_missing,
)
from sim.devices import SerialLine
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.waiting import DEADLINE_S

pty = pytest.importorskip("pty", reason="needs pseudo-terminals")
tty = pytest.importorskip("tty", reason="needs pseudo-terminals")


# --- loopback and log ---


def test_every_byte_is_logged_with_its_time(clock: VirtualClock) -> None:
    line = SerialLine(clock, 1000)
    line.connect(lambda data: line.device_write(data[::-1]))
    sink = io.StringIO()
    wire = LoggedTransport(LoopbackTransport(line, clock, 'a "port"'), clock, sink)
    wire.write(b"\x18?")
    assert wire.read(1.0) == b"?\x18"
    assert wire.read(0.1) == b""
    assert [json.loads(entry) for entry in sink.getvalue().splitlines()] == [
        {"t_s": 0.0, "port": 'a "port"', "dir": "tx", "hex": "183f"},
        {"t_s": 0.04, "port": 'a "port"', "dir": "rx", "hex": "3f18"},
    ]


def test_bytes_are_sent_even_if_they_cannot_be_logged(clock: VirtualClock) -> None:
    class FullDisk(io.StringIO):
        def write(self, _text: str) -> int:
            raise OSError("no space left")

    line = SerialLine(clock, 1000)
    heard: list[bytes] = []
    line.connect(heard.append)
    wire = LoggedTransport(LoopbackTransport(line, clock), clock, FullDisk())
    with pytest.raises(OSError, match="no space"):
        wire.write(b"!")
    clock.wait_s(1.0)
    assert heard == [b"!"]


# --- lines ---


def test_the_line_reader_joins_lines_from_any_pieces(clock: VirtualClock, scripted) -> None:  # type: ignore[no-untyped-def]
    wire = scripted([(b"", [b"o", b"k\r", b"\nerr", b"or:9\r\n\r\n<Id", b"le>\n\xff\xfe\nrest"])])
    reader = LineReader(wire, clock)
    heard = [reader.read_line(1.0) for _ in range(4)]
    assert heard == ["ok", "error:9", "<Idle>", "\ufffd\ufffd"]
    assert reader.read_line(1.0) is None
    assert clock.monotonic_s() == 1.0


def test_reading_a_stream_without_line_ends_is_an_error(clock: VirtualClock, scripted) -> None:  # type: ignore[no-untyped-def]
    reader = LineReader(scripted([(b"", b"x" * 5000)]), clock)
    with raises(TransportError, "line_too_long", port="scripted", longest=4096):
        reader.read_line(1.0)


# --- a serial port ---


@pytest.fixture
def port() -> Iterator[tuple[int, str]]:
    """The far end's file descriptor and the name of a serial port."""
    far, near = pty.openpty()
    tty.setraw(near)
    yield far, os.ttyname(near)
    os.close(far)
    os.close(near)


def test_a_serial_port_sends_and_receives(port: tuple[int, str]) -> None:
    far, name = port
    wire = SerialTransport(name)
    wire.write(b"$I\n")
    assert os.read(far, 10) == b"$I\n"
    os.write(far, b"ok\r\n")
    assert LineReader(wire, WallClock()).read_line(WallClock().monotonic_s() + 5.0) == "ok"
    assert wire.read(0.001) == b""
    wire.close()


@pytest.mark.parametrize(("character", "dtr"), [("8N1", True), ("7E1", True), ("8O2", False)])
def test_a_serial_port_is_opened_with_its_framing_and_dtr(character: str, dtr: bool) -> None:
    """On pyserial's own loop, where DTR comes back as DSR; a pseudo-terminal has neither parity nor DTR."""
    wire = SerialTransport("loop://", 9600, character=character, dtr=dtr)
    try:
        inner = wire._serial
        assert f"{inner.bytesize}{inner.parity}{inner.stopbits}" == character
        assert inner.dsr is dtr
        wire.write(b"S S      0.00 g")
        assert wire.read(1.0) == b"S S      0.00 g"
    finally:
        wire.close()


def test_a_serial_port_has_one_owner(port: tuple[int, str]) -> None:
    _, name = port
    assert port_owner(name) is None
    wire = SerialTransport(name)
    assert port_owner(name) == PortOwner(os.getpid())
    with raises(NotOwnedError, "in_use", port=name, pid=os.getpid()) as refused:
        SerialTransport(name)
    assert refused.value.owner == PortOwner(os.getpid())
    wire.close()
    assert port_owner(name) is None
    SerialTransport(name).close()


@pytest.mark.parametrize("opens", [SerialTransport, refuse_missing])
def test_opening_a_missing_port_is_refused_by_name(opens: Callable[[str], object]) -> None:
    with raises(TransportError, "no_port", port="/dev/ttyNOWHERE7"):
        opens("/dev/ttyNOWHERE7")


@pytest.mark.parametrize(
    ("problem", "code", "more"),
    [
        (OSError(errno.ENOENT, "x"), "no_port", {}),
        (OSError(errno.EBUSY, "x"), "in_use", {}),
        (OSError(errno.EACCES, "x"), "no_permission", {}),
        (OSError(errno.EIO, "failed\nbadly"), "not_opened", {"problem": f"[Errno {errno.EIO}] failed"}),
    ],
    ids=repr,
)
def test_a_serial_port_that_cannot_be_opened_is_refused_with_the_cause(
    problem: Exception, code: str, more: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of what several lines say, the first."""

    def fails(*_: object, **__: object) -> None:
        raise problem

    monkeypatch.setattr(serial, "serial_for_url", fails)
    with raises(TransportError, code, port="/dev/ttyX", **more) as caught:
        SerialTransport("/dev/ttyX")
    assert caught.value.__cause__ is problem


def test_reading_or_writing_a_closed_port_is_an_error(port: tuple[int, str]) -> None:
    _, name = port
    wire = SerialTransport(name)
    wire.close()
    with raises(TransportError, "not_written", port=name):
        wire.write(b"?")
    with raises(TransportError, "not_read", port=name):
        wire.read(0.0)


# --- TCP ---


@pytest.fixture
def listener() -> Iterator[tuple[socket.socket, str]]:
    """A listening socket and the name of its port."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(DEADLINE_S)
        yield server, f"tcp://127.0.0.1:{server.getsockname()[1]}"


def test_a_tcp_port_sends_and_receives_and_has_one_owner(listener: tuple[socket.socket, str]) -> None:
    server, name = listener
    wire = open_port(name, 9600, name="force")
    assert (type(wire), wire.name) == (TcpTransport, "force")
    far, _ = server.accept()
    with far:
        wire.write(b"SI\r\n")
        assert far.recv(10) == b"SI\r\n"
        assert wire.read(0.001) == b""
        far.sendall(b"S S 1.00 g\r\n")
        assert LineReader(wire, WallClock()).read_line(WallClock().monotonic_s() + 5.0) == "S S 1.00 g"
        assert port_owner(name) == PortOwner(os.getpid())
        with raises(NotOwnedError, "in_use", port=name, pid=os.getpid()):
            TcpTransport(name)
    with raises(TransportError, "hung_up", port=name):
        wire.read(5.0)
    wire.close()
    assert port_owner(name) is None
    with raises(TransportError, "not_read", port=name):
        wire.read(0.0)
    with raises(TransportError, "not_written", port=name):
        wire.write(b"?")


def test_a_tcp_port_without_a_listener_is_refused(listener: tuple[socket.socket, str]) -> None:
    server, name = listener
    server.close()
    with raises(TransportError, "no_listener", port=name):
        TcpTransport(name)
    assert port_owner(name) is None
