"""Transports: loopback, byte log, lines, and a serial port with a pseudo-terminal behind it."""

import io
import json
import os
import socket
from collections.abc import Iterator
from typing import Any

import pytest
from pydantic import ValidationError

from rig.devices.drivers import open_force, open_stage
from rig.plan.config import Config
from rig.transport import (
    LineReader,
    LoggedTransport,
    LoopbackTransport,
    PortOwner,
    SerialTransport,
    TcpTransport,
    Transport,
    TransportError,
    open_port,
    port_owner,
)
from rig.transport.clock import WallClock
from sim.devices import SerialLine
from sim.devices.clock import VirtualClock
from tests.waiting import DEADLINE_S

pty = pytest.importorskip("pty", reason="needs pseudo-terminals")
tty = pytest.importorskip("tty", reason="needs pseudo-terminals")


# --- loopback and log ---


def test_loopback_reads_as_soon_as_something_is_there(clock: VirtualClock) -> None:
    line = SerialLine(clock, 1000)
    wire: Transport = LoopbackTransport(line, clock, "near")
    clock.call_at(0.5, lambda: line.device_write(b"ab"))
    assert wire.read(0.1) == b""
    assert clock.monotonic_s() == pytest.approx(0.1)
    assert wire.read(5.0) == b"ab"
    assert clock.monotonic_s() == pytest.approx(0.52)
    assert wire.read(0.0) == b""


def test_loopback_sends_to_the_device(clock: VirtualClock) -> None:
    line = SerialLine(clock, 1000)
    heard: list[bytes] = []
    line.connect(heard.append)
    wire = LoopbackTransport(line, clock)
    wire.write(b"?")
    clock.wait_s(0.01)
    assert heard == [b"?"]
    wire.close()
    with pytest.raises(TransportError, match="loopback is closed"):
        wire.write(b"?")


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


def test_the_log_never_stands_before_the_bytes(clock: VirtualClock) -> None:
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


def test_lines_out_of_any_pieces(clock: VirtualClock, scripted) -> None:  # type: ignore[no-untyped-def]
    wire = scripted([(b"", [b"o", b"k\r", b"\nerr", b"or:9\r\n\r\n<Id", b"le>\n\xff\xfe\nrest"])])
    reader = LineReader(wire, clock)
    heard = [reader.read_line(1.0) for _ in range(4)]
    assert heard == ["ok", "error:9", "<Idle>", "\ufffd\ufffd"]
    assert reader.read_line(1.0) is None
    assert clock.monotonic_s() == 1.0


def test_a_stream_without_line_ends_is_an_error(clock: VirtualClock, scripted) -> None:  # type: ignore[no-untyped-def]
    reader = LineReader(scripted([(b"", b"x" * 5000)]), clock)
    with pytest.raises(TransportError, match="without an end of line"):
        reader.read_line(1.0)


def test_pending_and_discard(clock: VirtualClock, scripted) -> None:  # type: ignore[no-untyped-def]
    wire = scripted([(b"", [b"one\r\ntwo\r\nthr", b"ee\r\nfo"])])
    reader = LineReader(wire, clock)
    assert [reader.next_pending() for _ in range(4)] == ["one", "two", "three", None]
    reader.discard()
    wire.chunks.append(b"ur\r\n")
    assert reader.read_line(0.0) == "ur"


# --- a serial port ---


@pytest.fixture
def port() -> Iterator[tuple[int, str]]:
    """The far end's file descriptor and the name of a serial port."""
    far, near = pty.openpty()
    tty.setraw(near)
    yield far, os.ttyname(near)
    os.close(far)
    os.close(near)


def test_serial_port_both_ways(port: tuple[int, str]) -> None:
    far, name = port
    wire = SerialTransport(name)
    wire.write(b"$I\n")
    assert os.read(far, 10) == b"$I\n"
    os.write(far, b"ok\r\n")
    assert LineReader(wire, WallClock()).read_line(WallClock().monotonic_s() + 5.0) == "ok"
    assert wire.read(0.001) == b""
    wire.close()


@pytest.mark.parametrize(("character", "dtr"), [("8N1", True), ("7E1", True), ("8O2", False)])
def test_a_port_is_opened_as_it_is_set(character: str, dtr: bool) -> None:
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


@pytest.mark.parametrize("table", ["stage", "force"])
def test_the_settings_of_a_port_reach_it(table: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both devices: stage and force each have baud, character and dtr of their own."""
    opened: list[tuple[Any, ...]] = []

    def note(port: str, baud: int, *, character: str, dtr: bool, owned: bool) -> LoopbackTransport:
        assert owned
        opened.append((port, baud, character, dtr))
        return LoopbackTransport(SerialLine(VirtualClock(), 9600), VirtualClock())

    monkeypatch.setattr("rig.devices.drivers.open_port", note)
    config = Config.model_validate({table: {"port": "/dev/ttyX", "baud": 2400, "character": "7E1", "dtr": False}})
    {"stage": open_stage, "force": open_force}[table](config, WallClock())
    assert opened == [("/dev/ttyX", 2400, "7E1", False)]


@pytest.mark.parametrize("character", ["9N1", "8X1", "8N3", "8N", "8n1", ""])
def test_a_character_format_that_there_is_not_is_refused(character: str) -> None:
    with pytest.raises(ValidationError, match="expected data bits, parity and stop bits, such as 8N1 or 7E1"):
        Config.model_validate({"force": {"character": character}})


def test_one_owner_a_port(port: tuple[int, str]) -> None:
    _, name = port
    assert port_owner(name) is None
    wire = SerialTransport(name)
    assert port_owner(name) == PortOwner(os.getpid())
    with pytest.raises(TransportError, match=rf"^{name} is already in use by process {os.getpid()}$"):
        SerialTransport(name)
    wire.close()
    assert port_owner(name) is None
    SerialTransport(name).close()


def test_a_missing_port_is_named_in_one_line() -> None:
    with pytest.raises(TransportError, match=r"^there is no port /dev/ttyNOWHERE7$"):
        SerialTransport("/dev/ttyNOWHERE7")
    with pytest.raises(TransportError, match=r"^there is no port /dev/ttyNOWHERE7$"):
        SerialTransport("/dev/ttyNOWHERE7")


def test_a_port_that_goes_away_is_an_error(port: tuple[int, str]) -> None:
    _, name = port
    wire = SerialTransport(name)
    wire.close()
    with pytest.raises(TransportError, match=f"cannot write to {name}"):
        wire.write(b"?")
    with pytest.raises(TransportError, match=f"cannot read from {name}"):
        wire.read(0.0)


# --- TCP ---


@pytest.fixture
def listener() -> Iterator[tuple[socket.socket, str]]:
    """A listening socket and the name of its port."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(DEADLINE_S)
        yield server, f"tcp://127.0.0.1:{server.getsockname()[1]}"


def test_tcp_both_ways_and_one_owner(listener: tuple[socket.socket, str]) -> None:
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
        with pytest.raises(TransportError, match=rf"^{name} is already in use by process {os.getpid()}$"):
            TcpTransport(name)
    with pytest.raises(TransportError, match=rf"^cannot read from {name}: the other side closed"):
        wire.read(5.0)
    wire.close()
    assert port_owner(name) is None
    with pytest.raises(TransportError, match=f"cannot read from {name}"):
        wire.read(0.0)
    with pytest.raises(TransportError, match=f"cannot write to {name}"):
        wire.write(b"?")


def test_nobody_listens(listener: tuple[socket.socket, str]) -> None:
    server, name = listener
    server.close()
    with pytest.raises(
        TransportError,
        match=rf"^cannot open {name}: connection refused, nothing listens there, .* said its ports$",
    ):
        TcpTransport(name)
    assert port_owner(name) is None


@pytest.mark.parametrize("port", ["tcp://", "tcp://host", "tcp://:80", "tcp://host:port", "tcp://host:70000"])
def test_what_a_tcp_port_looks_like(port: str) -> None:
    with pytest.raises(TransportError, match=r"expected tcp://HOST:PORT$"):
        open_port(port, 9600)
