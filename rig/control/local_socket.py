"""Messages between two processes of one user: over a Unix socket, or over TCP within the machine where there is none.

Both carry the same bytes. The kernel keeps other accounts away from a Unix socket in a private folder. Every account
can connect to a TCP port of the machine, where only the key in the note keeps them out.
"""

import os
import socket
import struct
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from rig.clock import WallClock

HOST = "127.0.0.1"
UNIX: int | None = getattr(socket, "AF_UNIX", None)
"""Family of Unix sockets, None on a system without them."""

_BACKLOG = 16
_LONGEST_PATH = 100  # bytes; the path of a socket may have 103 on some systems
_LENGTH = struct.Struct("!i")  # in front of each message, as in multiprocessing.connection
_WHOLE_S = 2.0  # for the rest of a message that has begun, either way
_AGAIN_S = 0.005
# A connection within the machine is made at once; Windows repeats one that is refused for two seconds.
_TCP_CONNECTS_S = 0.02


class Channel:
    """Connection that sends and receives whole messages; every wait ends."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        if end.family == socket.AF_INET:
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        end.settimeout(_WHOLE_S)

    def send_bytes(self, data: bytes) -> None:
        """Send a message. Raises OSError."""
        self._end.settimeout(_WHOLE_S)
        self._end.sendall(_LENGTH.pack(len(data)) + data)

    def poll(self, timeout_s: float) -> bool:
        """Return whether a message, or the end of the connection, comes within this time (s)."""
        self._end.settimeout(timeout_s)
        with suppress(BlockingIOError, TimeoutError):
            self._end.recv(1, socket.MSG_PEEK)
            return True
        return False

    def recv_bytes(self, most: int) -> bytes:
        """Return a message. Raises EOFError at the end of the connection, OSError if it is too long or incomplete."""
        deadline_s = time.monotonic() + _WHOLE_S
        (length,) = _LENGTH.unpack(self._received(_LENGTH.size, deadline_s))
        if not 0 <= length <= most:
            self.close()
            raise OSError("bad message length")
        return self._received(length, deadline_s)

    def _received(self, length: int, deadline_s: float) -> bytes:
        data = b""
        while len(data) < length:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0.0:
                raise TimeoutError
            self._end.settimeout(left_s)
            more = self._end.recv(length - len(data))
            if not more:
                raise EOFError
            data += more
        return data

    def end_reading(self) -> None:
        """End every read after the data that have arrived; called from another thread."""
        with suppress(OSError):  # It has just been closed.
            self._end.shutdown(socket.SHUT_RD)

    def close(self) -> None:
        """Close the connection."""
        self._end.close()

    def __del__(self) -> None:  # A sender of a stop may not wait for the reply.
        self._end.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class Listener:
    """Socket that accepts channels at `address`: a path, or HOST:PORT."""

    def __init__(self, address: str, family: int) -> None:
        """Bind and listen. Raises OSError."""
        self._socket = socket.socket(family)
        try:
            if family == socket.AF_INET:
                if sys.platform == "win32":  # Otherwise another program may bind the same port.
                    self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
                self._socket.bind((HOST, 0))
                address = f"{HOST}:{self._socket.getsockname()[1]}"
            else:
                self._socket.bind(address)
                os.chmod(address, 0o600)
            self._socket.listen(_BACKLOG)
        except OSError:
            self._socket.close()
            raise
        self.address = address

    def accept(self) -> Channel:
        """Wait for a client. Raises OSError."""
        end, _ = self._socket.accept()
        return Channel(end)

    def close(self) -> None:
        """Close the socket and remove its file."""
        self._socket.close()
        if self._socket.family != socket.AF_INET:
            with suppress(OSError):
                os.unlink(self.address)


@contextmanager
def listening(path: Path) -> Iterator[Listener]:
    """Yield a listener at a path, or in a temporary folder if it is too long; at a TCP port without Unix sockets."""
    with ExitStack() as undo:
        if UNIX is None:
            listener = Listener("", socket.AF_INET)
        else:
            if len(os.fsencode(path)) > _LONGEST_PATH:
                path = Path(undo.enter_context(tempfile.TemporaryDirectory(prefix="rig-"))) / "control.sock"
            path.unlink(missing_ok=True)
            listener = Listener(str(path), UNIX)
        undo.callback(listener.close)
        yield listener


def connected(address: str, within_s: float) -> Channel:
    """Connect to a listener, without authentication. Raises OSError, also if it does not accept in time."""
    host, _, port = address.rpartition(":")
    if host == HOST and port.isdigit():
        return Channel(_tcp((HOST, int(port)), max(within_s, _TCP_CONNECTS_S)))
    if UNIX is None:
        raise ConnectionRefusedError
    return Channel(_unix(address, UNIX, within_s))


def _tcp(address: tuple[str, int], within_s: float) -> socket.socket:
    end = socket.create_connection(address, within_s)
    if end.getsockname() == end.getpeername():  # A free port may be given to the client itself.
        end.close()
        raise ConnectionRefusedError
    return end


def _unix(address: str, family: int, within_s: float) -> socket.socket:
    deadline_s = time.monotonic() + within_s
    with ExitStack() as undo:
        end = undo.enter_context(socket.socket(family))
        end.settimeout(within_s)
        while True:
            try:
                end.connect(address)
            except BlockingIOError:  # The backlog of the socket is full.
                if time.monotonic() >= deadline_s:
                    raise
                WallClock().wait_s(_AGAIN_S)
            else:
                undo.pop_all()
                return end
