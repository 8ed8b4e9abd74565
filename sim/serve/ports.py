"""Host end of a virtual line as a local port: a pseudo-terminal, a TCP port, or a UDP port with a web page.

Without a client, with one that does not read, or with one that vanishes, bytes are lost as on a real cable, and the
devices continue.
"""

import contextlib
import os
import socket
import sys
from collections.abc import Iterator

from sim.devices.line import SerialLine
from sim.errors import SimError
from sim.serve.real_time_loop import WallScheduler

HOST = "127.0.0.1"
_CHUNK = 4096
# A client whose machine vanished is dropped after about ten seconds.
_KEEPALIVE = (("TCP_KEEPIDLE", 5), ("TCP_KEEPINTVL", 2), ("TCP_KEEPCNT", 3))


class PortBusyError(SimError):
    """Error of a port that is not available, with a one-line message."""

    default_code = "port_busy"


if sys.platform == "win32":

    def _terminal() -> tuple[int, int, str]:
        raise PortBusyError("this system has no pseudo-terminals; use TCP ports", "no_terminals")
else:
    import pty
    import tty

    def _terminal() -> tuple[int, int, str]:
        """Return both ends of a new pseudo-terminal in raw mode, and the name of the second one."""
        far, near = pty.openpty()
        tty.setraw(near)
        os.set_blocking(far, False)
        return far, near, os.ttyname(near)


class PtyPort:
    """Line behind a pseudo-terminal; clients may connect and disconnect."""

    def __init__(self, scheduler: WallScheduler, line: SerialLine) -> None:
        """Open the pseudo-terminal. Raises PortBusyError on a system without them."""
        self._scheduler, self._line = scheduler, line
        # The near end stays open here too: it keeps its raw mode, and the far end readable, between clients.
        self._far, self._near, self.name = _terminal()
        line.forward(self._to_client)
        scheduler.watch(self, self._from_client)

    def fileno(self) -> int:
        return self._far

    def close(self) -> None:
        self._scheduler.unwatch(self)
        os.close(self._far)
        os.close(self._near)

    def _from_client(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self._line.host_write(os.read(self._far, _CHUNK))

    def _to_client(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):
            os.write(self._far, data)


@contextlib.contextmanager
def _or_busy(server: socket.socket, port: int | None = None) -> Iterator[None]:
    try:
        yield
    except OSError as problem:
        number = server.getsockname()[1] if port is None else port
        server.close()
        raise PortBusyError(f"TCP port {number}: {os.strerror(problem.errno or 0).lower()}") from None


class TcpPort:
    """Line behind a local TCP port, for one client at a time; a second one is rejected."""

    def __init__(self, scheduler: WallScheduler, line: SerialLine, port: int) -> None:
        """Bind a port, any free one for 0; it rejects clients until `listen`. Raises PortBusyError."""
        self._scheduler, self._line = scheduler, line
        self._client: socket.socket | None = None
        self._listens = False
        self._server = socket.socket()
        if os.name == "posix":  # a recently closed port may be reused at once
            self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with _or_busy(self._server, port):
            self._server.bind((HOST, port))
        self._server.setblocking(False)
        self.name = f"tcp://{HOST}:{self._server.getsockname()[1]}"
        line.forward(self._to_client)

    def listen(self) -> None:
        """Accept clients. Raises PortBusyError."""
        with _or_busy(self._server):
            self._server.listen()
        self._scheduler.watch(self._server, self._accept)
        self._listens = True

    def close(self) -> None:
        self._drop()
        if self._listens:
            self._scheduler.unwatch(self._server)
        self._server.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            client, _ = self._server.accept()
            self._from_client()  # the previous client may have disconnected just now
            if self._client is not None:
                client.close()
                return
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for name, value in _KEEPALIVE:
                if hasattr(socket, name):
                    client.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
            self._client = client
            self._line.renewed()
            self._scheduler.watch(client, self._from_client)

    def _from_client(self) -> None:
        if self._client is None:
            return
        try:
            data = self._client.recv(_CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._line.host_write(data)
        else:
            self._drop()

    def _to_client(self, data: bytes) -> None:
        if self._client is None:
            return
        try:
            sent = self._client.send(data)
        except BlockingIOError:
            sent = 0
        except OSError:
            self._drop()
            return
        if sent < len(data):  # the client does not read, and half a message would be worse than none
            self._drop()

    def _drop(self) -> None:
        if self._client is not None:
            self._scheduler.unwatch(self._client)
            self._client.close()
            self._client = None


_PAGE = b"HTTP/"
_TRIES = 20


class UdpPort:
    """Line behind a local UDP port, and behind the TCP port of the same number for its web page.

    Datagrams go to the client that sent the last one. What the device sends as HTTP goes to the oldest client of the
    page.
    """

    def __init__(self, scheduler: WallScheduler, line: SerialLine, port: int) -> None:
        """Bind both ports, any free number for 0. Raises PortBusyError."""
        self._scheduler, self._line = scheduler, line
        self._peer: tuple[str, int] | None = None
        self._clients: list[socket.socket] = []
        self._datagrams, self._server = _both(port)
        self.name = f"udp://{HOST}:{self._server.getsockname()[1]}"
        line.forward(self._to_client)
        self._listens = False

    def listen(self) -> None:
        """Accept clients."""
        self._server.listen()
        self._scheduler.watch(self._server, self._accept)
        self._scheduler.watch(self._datagrams, self._from_client)
        self._listens = True

    def close(self) -> None:
        while self._clients:
            self._drop(self._clients[0])
        for one in (self._server, self._datagrams):
            if self._listens:
                self._scheduler.unwatch(one)
            one.close()

    def _from_client(self) -> None:
        with contextlib.suppress(OSError):  # such as a refusal of an earlier datagram
            data, self._peer = self._datagrams.recvfrom(_CHUNK)
            self._line.host_write(data)

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            client, _ = self._server.accept()
            client.setblocking(False)
            self._clients.append(client)
            self._scheduler.watch(client, lambda: self._from_page_client(client))

    def _from_page_client(self, client: socket.socket) -> None:
        try:
            data = client.recv(_CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._line.host_write(data)
        elif client in self._clients:
            self._drop(client)

    def _to_client(self, data: bytes) -> None:
        if data.startswith(_PAGE):
            if self._clients:
                with contextlib.suppress(OSError):
                    self._clients[0].sendall(data)
                self._drop(self._clients[0])
        elif self._peer is not None:
            with contextlib.suppress(OSError):  # a full buffer, or a client that is gone
                self._datagrams.sendto(data, self._peer)

    def _drop(self, client: socket.socket) -> None:
        self._clients.remove(client)
        self._scheduler.unwatch(client)
        client.close()


def _both(port: int) -> tuple[socket.socket, socket.socket]:
    """Return a UDP and a TCP socket of one number, any free one for 0."""
    for last in range(_TRIES - 1, -1, -1):
        datagrams, server = socket.socket(type=socket.SOCK_DGRAM), socket.socket()
        try:
            if os.name == "posix":
                server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            server.bind((HOST, port))
            datagrams.bind((HOST, server.getsockname()[1]))
        except OSError as problem:
            datagrams.close()
            server.close()
            if port or not last:
                raise PortBusyError(f"UDP port {port}: {os.strerror(problem.errno or 0).lower()}") from None
        else:
            datagrams.setblocking(False)
            server.setblocking(False)
            return datagrams, server
    raise AssertionError
