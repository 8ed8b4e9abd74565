"""What a driver needs of a wire."""

from typing import Protocol

from rig.errors import RigError


class TransportError(RigError):
    """The wire itself failed: no such port, port busy, unplugged, closed."""


class Transport(Protocol):
    """A two-way stream of bytes."""

    @property
    def name(self) -> str:
        """The port as a person knows it."""
        ...

    def write(self, data: bytes) -> None:
        """Send now, past anything that waits in read(). Raises TransportError."""
        ...

    def read(self, timeout_s: float) -> bytes:
        """Return as soon as there is at least one byte, b"" after timeout_s. Raises TransportError."""
        ...

    def close(self) -> None: ...
