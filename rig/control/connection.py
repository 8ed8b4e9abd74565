"""Authenticated connection of `multiprocessing` between two processes of one user, with a limit for every wait.

On POSIX it is a Unix socket in a folder that only its user can enter, on Windows a named pipe. Messages are JSON
objects; nothing is unpickled.
"""

import hmac
import json
import os
import secrets
import socket
import struct
import time
from collections.abc import Mapping
from contextlib import ExitStack
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client, Connection, Listener, answer_challenge, deliver_challenge
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rig_shared.user_files import json_of

MOST_BYTES = 1 << 16
BROKEN = (OSError, EOFError, ValueError, AuthenticationError, AssertionError)
"""Errors that end a connection if the other side is gone, silent, or another program."""

RECEIVED = b"received"
"""First reply to a stop, before it is carried out."""

_BACKLOG = 64
_HELLO, _STOP = b"hello", b"stop"
_DIGEST, _NONCE, _LONGEST_STOP = 32, 16, 256
_WHOLE_S = 2.0  # for the rest of a message that has begun
_LONGEST_PATH = 100  # bytes; the path of a socket may have 103 on some systems


class LimitedConnection:
    """Connection on which every wait ends. within_s: for all messages; None where the socket limits each read."""

    def __init__(self, connection: "Connection[Any, Any]", within_s: float | None = None) -> None:
        self._connection = connection
        self._deadline_s = None if within_s is None else time.monotonic() + within_s

    def send_bytes(self, data: bytes) -> None:
        """Send a message. Raises OSError."""
        self._connection.send_bytes(data)

    def recv_bytes(self, most: int = MOST_BYTES) -> bytes:
        """Return the next message. Raises BROKEN, TimeoutError among them."""
        if self._deadline_s is not None and not self._connection.poll(max(self._deadline_s - time.monotonic(), 0.0)):
            raise TimeoutError
        return self._connection.recv_bytes(most)

    def send(self, message: Mapping[str, Any]) -> None:
        """Send an object. Raises OSError; TypeError, ValueError if JSON cannot hold it."""
        self.send_bytes(encoded(message))

    def receive(self) -> dict[str, Any]:
        """Return the next object. Raises BROKEN."""
        return decoded(self.recv_bytes())

    def admit(self, key: bytes) -> bytes | None:
        """Authenticate a client (owner's side); return its stop, or None for another request. Raises BROKEN."""
        first = self.recv_bytes(_LONGEST_STOP)
        if first != _HELLO:
            return verified(key, _STOP, first)
        answer_challenge(self, key)  # type: ignore[arg-type]  # has the two methods
        deliver_challenge(self, key)  # type: ignore[arg-type]
        return None

    def greet(self, key: bytes) -> None:
        """Authenticate both sides (client's side). Raises BROKEN."""
        self.send_bytes(_HELLO)
        deliver_challenge(self, key)  # type: ignore[arg-type]
        answer_challenge(self, key)  # type: ignore[arg-type]


def stop_message(key: bytes, by: str) -> tuple[bytes, bytes]:
    """Return the nonce of a stop, and its message.

    One message contains its own proof, because each turn of a handshake waits for a processor. A replayed stop stops
    only what was already stopped.
    """
    stop = secrets.token_bytes(_NONCE) + by.encode("ascii")
    return stop, proven(key, _STOP, stop)


def proven(key: bytes, kind: bytes, data: bytes) -> bytes:
    """Return the data behind a digest that requires the key."""
    return hmac.digest(key, kind + data, "sha256") + data


def verified(key: bytes, kind: bytes, message: bytes) -> bytes:
    """Return the data of a message of this kind. Raises AuthenticationError."""
    data = message[_DIGEST:]
    if not hmac.compare_digest(proven(key, kind, data), message):
        raise AuthenticationError("the other side does not know the key")
    return data


def sender_of(stop: bytes) -> str:
    """Return the sender of a stop; empty if the stop does not name it."""
    return stop[_NONCE:].decode("ascii", "replace")


def encoded(message: Mapping[str, Any]) -> bytes:
    """Return the encoded message. Raises TypeError, ValueError if JSON cannot hold it."""
    return json.dumps(message, allow_nan=False).encode()


def decoded(message: bytes) -> dict[str, Any]:
    """Return the object. Raises ValueError."""
    found = json_of(message)
    if not isinstance(found, dict):
        raise ValueError("expected an object")
    return found


class PrivateListener:
    """Listener for this user: a Unix socket at a path, or in a temporary folder if it is too long; a pipe of Windows.

    It knows no key, because accept() of `multiprocessing` would wait for a silent client.
    """

    def __init__(self, path: Path) -> None:
        """Listen. Raises OSError."""
        self._undo = ExitStack()
        if not hasattr(socket, "AF_UNIX"):
            self._pipe = self._undo.enter_context(Listener())
            self.address = str(self._pipe.address)
            return
        with ExitStack() as undo:
            if len(os.fsencode(path)) > _LONGEST_PATH:
                path = Path(undo.enter_context(TemporaryDirectory(prefix="rig-"))) / "control.sock"
            path.unlink(missing_ok=True)
            self._socket = undo.enter_context(socket.socket(socket.AF_UNIX))
            self._socket.bind(str(path))
            undo.callback(path.unlink, missing_ok=True)
            self._socket.listen(_BACKLOG)
            self.address = str(path)
            self._undo = undo.pop_all()

    def accept(self, patience_s: float) -> "tuple[Connection[Any, Any], LimitedConnection]":
        """Wait for a client, which may be silent for so long. Raises OSError, EOFError.

        A limit of the socket costs no turn of the thread, unlike poll().
        """
        if not hasattr(socket, "AF_UNIX"):
            client: Any = self._pipe.accept()
            return client, LimitedConnection(client, patience_s)
        end, _ = self._socket.accept()
        _limit(end, patience_s, patience_s)
        connection = Connection(end.detach())
        return connection, LimitedConnection(connection)

    def close(self) -> None:
        """Close the socket and remove its file."""
        self._undo.close()


def connected(address: str, within_s: float) -> "Connection[Any, Any]":
    """Connect to a listener. Raises OSError, also if its owner hangs and others wait already."""
    if not hasattr(socket, "AF_UNIX"):
        pipe: Any = Client(address)
        return pipe
    with socket.socket(socket.AF_UNIX) as end:
        _limit(end, _WHOLE_S, within_s)
        end.connect(address)
        return Connection(end.detach())


def _limit(end: socket.socket, read_s: float, write_s: float) -> None:
    """Limit each wait of a blocking socket (s). Linux counts connect() as a write; elsewhere it does not wait."""
    for option, limit_s in ((socket.SO_RCVTIMEO, read_s), (socket.SO_SNDTIMEO, write_s)):
        whole_s, part_s = divmod(max(limit_s, 1e-3), 1.0)
        end.setsockopt(socket.SOL_SOCKET, option, struct.pack("ll", int(whole_s), int(part_s * 1e6)))
