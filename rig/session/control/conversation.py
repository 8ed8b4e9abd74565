"""One question and one answer between two processes that know the same key."""

import json
import os
import socket
import time
from collections.abc import Mapping
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client, Connection, answer_challenge, deliver_challenge
from typing import Any

from rig.transport.clock import WallClock

MOST_BYTES = 1 << 16
_AGAIN_S = 0.005
BROKEN = (OSError, EOFError, ValueError, AuthenticationError, AssertionError)
"""What a conversation ends with where the other side is gone, silent, or none of ours."""


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

    def challenge(self, key: bytes) -> None:
        """The owner's side: let in whoever knows the key. Raises BROKEN."""
        deliver_challenge(self, key)  # type: ignore[arg-type]  # it sends and receives bytes, and no more
        answer_challenge(self, key)  # type: ignore[arg-type]

    def prove(self, key: bytes) -> None:
        """The other side: show that the key is known, and see that the owner knows it. Raises BROKEN."""
        answer_challenge(self, key)  # type: ignore[arg-type]
        deliver_challenge(self, key)  # type: ignore[arg-type]

    def hear(self) -> dict[str, Any]:
        """An object. Raises BROKEN."""
        message = json.loads(self.recv_bytes())
        if not isinstance(message, dict):
            raise ValueError("expected an object")
        return message


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
