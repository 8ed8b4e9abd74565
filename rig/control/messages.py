"""One question and one answer between two processes that know the same key."""

import hmac
import json
import os
import secrets
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client, Connection, answer_challenge, deliver_challenge
from typing import Any

from rig.clock import WallClock

MOST_BYTES = 1 << 16
_AGAIN_S = 0.005
BROKEN = (OSError, EOFError, ValueError, AuthenticationError, AssertionError)
"""What a conversation ends with where the other side is gone, silent, or none of ours."""


_STOP, _ANSWER = b"#STOP#", b"#TOLD#"
_DIGEST, _NONCE = 32, 16


class _StopSaidError(Exception):
    """Instead of the answer to a challenge; its nonce."""


class Wire:
    """A connection on which nothing is waited for beyond a deadline, the handshake included."""

    def __init__(self, connection: "Connection[Any, Any]", within_s: float) -> None:
        self._connection, self._deadline_s = connection, time.monotonic() + within_s

    def send_bytes(self, data: bytes) -> None:
        """A message. Raises OSError."""
        self._connection.send_bytes(data)

    def recv_bytes(self, most: int = MOST_BYTES) -> bytes:
        """The next message. Raises TimeoutError, EOFError, and OSError for one that is too long."""
        if not self._connection.poll(max(self._deadline_s - time.monotonic(), 0.0)):
            raise TimeoutError
        return self._connection.recv_bytes(most)

    def challenge(self, key: bytes) -> bytes | None:
        """The owner's side: let in who knows the key; the nonce of a stop that was said at once. Raises BROKEN."""
        try:
            deliver_challenge(_Challenging(self, key), key)  # type: ignore[arg-type]  # it sends and receives bytes
        except _StopSaidError as stop:
            return bytes(stop.args[0])
        answer_challenge(self, key)  # type: ignore[arg-type]
        return None

    def prove(self, key: bytes) -> None:
        """The other side: show that the key is known, and see that the owner knows it. Raises BROKEN."""
        answer_challenge(self, key)  # type: ignore[arg-type]
        deliver_challenge(self, key)  # type: ignore[arg-type]

    def stop(self, key: bytes) -> dict[str, Any]:
        """The other side: a stop, and what is answered to it. Raises BROKEN."""
        return self.stopped(key, self.say_stop(key))

    def say_stop(self, key: bytes, by: str = "") -> bytes:
        """The other side: a stop that waits for nothing; its nonce, with who says it. Raises OSError.

        It is its own proof, in one message: whoever passes one on may wait for a processor at each turn of a longer
        conversation. One that is said again by somebody else stops what was stopped.
        """
        nonce = secrets.token_bytes(_NONCE) + by.encode("ascii")
        self.send_bytes(_proven(key, _STOP, nonce))
        return nonce

    def stopped(self, key: bytes, nonce: bytes, lives: Callable[[], object] = lambda: None) -> dict[str, Any]:
        """The other side: what is answered to a stop that was said. Raises BROKEN.

        lives: called as soon as the owner has been heard at all.
        """
        self.recv_bytes()  # the challenge, which was not waited for
        lives()
        answer = _shown(key, _ANSWER + nonce, self.recv_bytes())
        if answer is None:
            raise AuthenticationError("the owner does not know the key")
        return _object(answer)

    def told(self, key: bytes, nonce: bytes, answer: bytes) -> None:
        """The owner's side: what is answered to a stop. Raises OSError."""
        self.send_bytes(_proven(key, _ANSWER + nonce, answer))

    def hear(self) -> dict[str, Any]:
        """An object. Raises BROKEN."""
        return _object(self.recv_bytes())


class _Challenging:
    """A wire on which the answer to a challenge is expected, and a stop may come."""

    def __init__(self, wire: Wire, key: bytes) -> None:
        self._wire, self._key = wire, key

    def send_bytes(self, data: bytes) -> None:
        with suppress(OSError):  # whoever has gone may have said a stop before
            self._wire.send_bytes(data)

    def recv_bytes(self, most: int) -> bytes:
        message = self._wire.recv_bytes(most)
        nonce = _shown(self._key, _STOP, message)
        if nonce is not None:
            raise _StopSaidError(nonce)
        return message


def said_by(nonce: bytes) -> str:
    """Return who said a stop, empty where it does not say."""
    return nonce[_NONCE:].decode("ascii", "replace")


def _proven(key: bytes, kind: bytes, said: bytes) -> bytes:
    """With a digest before it that only who knows the key can make."""
    return hmac.digest(key, kind + said, "sha256") + said


def _shown(key: bytes, kind: bytes, message: bytes) -> bytes | None:
    """What was said in a message of that kind; None where it is another, or by whoever does not know the key."""
    said = message[_DIGEST:]
    return said if hmac.compare_digest(_proven(key, kind, said), message) else None


def _object(message: bytes) -> dict[str, Any]:
    found = json.loads(message)
    if not isinstance(found, dict):
        raise ValueError("expected an object")
    return found


def encoded(message: Mapping[str, Any]) -> bytes:
    """As it goes over the wire. Raises TypeError, ValueError for what JSON cannot hold."""
    return json.dumps(message, allow_nan=False).encode()


def connected(address: str, within_s: float) -> "Connection[Any, Any]":
    """To an owner; neither side has shown who it is. Raises OSError, also where it accepts nobody."""
    if os.name != "posix":
        return Client(address)
    deadline_s = time.monotonic() + within_s
    with socket.socket(socket.AF_UNIX) as end:
        end.settimeout(within_s)
        while True:
            try:
                end.connect(address)
            except BlockingIOError:  # more wait already than the system keeps
                if time.monotonic() >= deadline_s:
                    raise
                WallClock().wait_s(_AGAIN_S)
            else:
                end.setblocking(True)
                return Connection(end.detach())
