"""One request and one reply between two processes that share a key."""

import hmac
import json
import secrets
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing import AuthenticationError
from multiprocessing.connection import answer_challenge, deliver_challenge
from typing import Any

from rig.control.local_socket import Channel
from rig_shared.user_files import json_of

MOST_BYTES = 1 << 16
BROKEN = (OSError, EOFError, ValueError, AuthenticationError, AssertionError)
"""Errors that end a connection if the other side is gone, silent, or another program."""


_STOP, _ANSWER = b"#STOP#", b"#TOLD#"
_DIGEST, _NONCE = 32, 16


class _StopReceivedError(Exception):
    """Raised when a stop arrives instead of the reply to a challenge; carries its nonce."""


class Wire:
    """Connection with a deadline for every wait, the handshake included."""

    def __init__(self, connection: Channel, within_s: float) -> None:
        self._connection, self._deadline_s = connection, time.monotonic() + within_s

    def send_bytes(self, data: bytes) -> None:
        """Send a message. Raises OSError."""
        self._connection.send_bytes(data)

    def recv_bytes(self, most: int = MOST_BYTES) -> bytes:
        """Return the next message. Raises TimeoutError, EOFError, or OSError if it is too long."""
        if not self._connection.poll(max(self._deadline_s - time.monotonic(), 0.0)):
            raise TimeoutError
        return self._connection.recv_bytes(most)

    def challenge(self, key: bytes) -> bytes | None:
        """Authenticate the client (owner's side); return the nonce of an immediate stop, or None. Raises BROKEN."""
        try:
            deliver_challenge(_Challenging(self, key), key)  # type: ignore[arg-type]  # has the two methods
        except _StopReceivedError as stop:
            return bytes(stop.args[0])
        answer_challenge(self, key)  # type: ignore[arg-type]
        return None

    def prove(self, key: bytes) -> None:
        """Authenticate both sides (client's side). Raises BROKEN."""
        answer_challenge(self, key)  # type: ignore[arg-type]
        deliver_challenge(self, key)  # type: ignore[arg-type]

    def stop(self, key: bytes) -> dict[str, Any]:
        """Send a stop and return the reply (client's side). Raises BROKEN."""
        return self.stopped(key, self.post_stop(key))

    def post_stop(self, key: bytes, by: str = "") -> bytes:
        """Send a stop without waiting, and return its nonce with its sender (client's side). Raises OSError.

        One message contains its own proof, because each turn of a longer exchange may wait for a processor. A
        replayed stop stops only what was already stopped.
        """
        nonce = secrets.token_bytes(_NONCE) + by.encode("ascii")
        self.send_bytes(_proven(key, _STOP, nonce))
        return nonce

    def stopped(self, key: bytes, nonce: bytes, lives: Callable[[], object] = lambda: None) -> dict[str, Any]:
        """Return the reply to a stop that was sent (client's side). Raises BROKEN.

        lives: called at the first sign of the owner.
        """
        self.recv_bytes()  # The challenge, which the stop did not wait for.
        lives()
        answer = _verified(key, _ANSWER + nonce, self.recv_bytes())
        if answer is None:
            raise AuthenticationError("the owner does not know the key")
        return _object(answer)

    def answer_stop(self, key: bytes, nonce: bytes, answer: bytes) -> None:
        """Send the reply to a stop (owner's side). Raises OSError."""
        self.send_bytes(_proven(key, _ANSWER + nonce, answer))

    def hear(self) -> dict[str, Any]:
        """Receive an object. Raises BROKEN."""
        return _object(self.recv_bytes())


class _Challenging:
    """Wire that expects the reply to a challenge, or a stop."""

    def __init__(self, wire: Wire, key: bytes) -> None:
        self._wire, self._key = wire, key

    def send_bytes(self, data: bytes) -> None:
        with suppress(OSError):  # A client that has gone may have sent a stop before.
            self._wire.send_bytes(data)

    def recv_bytes(self, most: int) -> bytes:
        message = self._wire.recv_bytes(most)
        nonce = _verified(self._key, _STOP, message)
        if nonce is not None:
            raise _StopReceivedError(nonce)
        return message


def sender_of(nonce: bytes) -> str:
    """Return the sender of a stop; empty if the stop does not name it."""
    return nonce[_NONCE:].decode("ascii", "replace")


def _proven(key: bytes, kind: bytes, data: bytes) -> bytes:
    """Return the data behind a digest that requires the key."""
    return hmac.digest(key, kind + data, "sha256") + data


def _verified(key: bytes, kind: bytes, message: bytes) -> bytes | None:
    """Return the data of a message of this kind with a valid digest, else None."""
    data = message[_DIGEST:]
    return data if hmac.compare_digest(_proven(key, kind, data), message) else None


def _object(message: bytes) -> dict[str, Any]:
    found = json_of(message)
    if not isinstance(found, dict):
        raise ValueError("expected an object")
    return found


def encoded(message: Mapping[str, Any]) -> bytes:
    """Return the encoded message. Raises TypeError, ValueError if JSON cannot hold it."""
    return json.dumps(message, allow_nan=False).encode()
