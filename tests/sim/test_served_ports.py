"""Virtual lines behind pseudo-terminals and TCP ports: clients come, go and vanish."""

import errno
import os
import socket
import struct
import threading
from collections.abc import Iterator
from functools import partial

import pytest

from sim.devices import SerialLine
from sim.serve.ports import PortBusyError, PtyPort, TcpPort
from sim.serve.real_time_loop import WallScheduler
from tests.error_codes import raises
from tests.waiting import DEADLINE_S, gathered, until

pytest.importorskip("pty", reason="needs pseudo-terminals")


class Loop:
    """A scheduler that runs in a thread, with a line that answers in upper case."""

    def __init__(self) -> None:
        self.scheduler = WallScheduler()
        self.line = SerialLine(self.scheduler, 1e6)
        self.line.connect(lambda data: self.line.device_write(data.upper()))
        self._thread = threading.Thread(target=self.scheduler.run)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self.scheduler.stop()
        self._thread.join(DEADLINE_S)
        assert not self._thread.is_alive()


@pytest.fixture
def loop() -> Iterator[Loop]:
    loop = Loop()
    yield loop
    loop.stop()
    loop.scheduler.close()


@pytest.fixture
def tcp(loop: Loop) -> Iterator[TcpPort]:
    port = TcpPort(loop.scheduler, loop.line, 0)
    port.listen()
    loop.start()
    yield port
    loop.stop()
    port.close()


def connect(port: TcpPort) -> socket.socket:
    host, number = port.name.removeprefix("tcp://").split(":")
    return socket.create_connection((host, int(number)), DEADLINE_S)


def asked(client: socket.socket, data: bytes) -> bytes:
    client.sendall(data)
    heard = b""
    while len(heard) < len(data) and (more := client.recv(100)):
        heard += more
    return heard


def test_a_pseudo_terminal_serves_one_client_after_another(loop: Loop) -> None:
    port = PtyPort(loop.scheduler, loop.line)
    loop.start()
    try:
        for text in (b"one", b"two"):
            client = os.open(port.name, os.O_RDWR | os.O_NOCTTY)
            os.write(client, text)
            assert gathered(partial(os.read, client, 10), text.upper().__eq__) == text.upper()
            os.close(client)
    finally:
        loop.stop()
        port.close()


def test_a_served_tcp_port_serves_one_client_after_another(tcp: TcpPort) -> None:
    for text in (b"one", b"two", b"three"):
        with connect(tcp) as client:
            assert asked(client, text) == text.upper()


def test_a_second_tcp_client_is_refused_and_the_first_stays(tcp: TcpPort) -> None:
    with connect(tcp) as first:
        assert asked(first, b"a") == b"A"
        with connect(tcp) as second:
            assert second.recv(1) == b""
        assert asked(first, b"b") == b"B"


def test_a_served_tcp_port_survives_a_client_that_resets_the_connection(tcp: TcpPort) -> None:
    client = connect(tcp)
    assert asked(client, b"a") == b"A"
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.sendall(b"never read")
    client.close()  # a reset, not an orderly end

    def heard_again() -> bool:
        with connect(tcp) as again:
            try:
                return asked(again, b"b") == b"B"
            except ConnectionError:
                return False

    until(heard_again)


def test_serving_on_a_busy_tcp_port_is_refused_by_name(loop: Loop) -> None:
    loop.start()
    with socket.create_server(("127.0.0.1", 0)) as other:
        number = other.getsockname()[1]
        with raises(PortBusyError, "port_busy", port=number, problem=os.strerror(errno.EADDRINUSE).lower()):
            TcpPort(loop.scheduler, loop.line, number)


def test_a_served_tcp_port_refuses_clients_until_it_listens(loop: Loop) -> None:
    """Whoever comes while a finger is loaded is refused, instead of waiting for an answer that does not come."""
    port = TcpPort(loop.scheduler, loop.line, 0)
    with pytest.raises(ConnectionRefusedError):
        connect(port)
    port.listen()
    loop.start()
    connect(port).close()
    loop.stop()
    port.close()
    TcpPort(loop.scheduler, loop.line, 0).close()  # one that never listened
