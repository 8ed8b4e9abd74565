"""A real serial port, owned by one process at a time."""

import errno
import os
import re
import tempfile
from pathlib import Path
from typing import Any

import filelock
import serial

from rig.transport.base import TransportError

WRITE_TIMEOUT_S = 1.0
# Somebody who only asks for the owner holds the lock for a moment.
OWNER_S = 0.2


class SerialTransport:
    """Transport over pyserial, 8N1.

    port is a device or a pyserial URL such as socket://host:port. Raises TransportError, in one line that
    names the port, if it is missing, not permitted, or owned by somebody else. Opening resets many GRBL
    boards (DTR).
    """

    def __init__(self, port: str, baud: int = 115200, *, name: str | None = None) -> None:
        self.name = name or port
        self._port = port
        self._lock = _own(port)
        try:
            self._serial = _open(port, baud)
            _owner_file(port).write_text(str(os.getpid()), encoding="ascii")
        except BaseException:
            self._lock.release()
            raise

    def write(self, data: bytes) -> None:
        try:
            self._serial.write(data)
        except (serial.SerialException, OSError) as problem:
            raise TransportError(f"cannot write to {self._port}: {problem}") from problem

    def read(self, timeout_s: float) -> bytes:
        try:
            self._serial.timeout = max(timeout_s, 0.0)
            first = self._serial.read(1)
            return bytes(first + self._serial.read(self._serial.in_waiting)) if first else b""
        except (serial.SerialException, OSError, TypeError) as problem:
            # pyserial fails with a TypeError when another thread closes the port under a read.
            raise TransportError(f"cannot read from {self._port}: {problem}") from problem

    def close(self) -> None:
        self._serial.close()
        _owner_file(self._port).unlink(missing_ok=True)
        self._lock.release()


def port_owner(port: str) -> int | None:
    """Return the process id that holds this port through a SerialTransport, None if nobody does."""
    try:
        with filelock.FileLock(_lock_file(port), timeout=0):
            return None
    except (filelock.Timeout, OSError):
        return _noted_owner(port)


def _own(port: str) -> filelock.BaseFileLock:
    # Not thread-local: a stop from another thread may close the port.
    lock = filelock.FileLock(_lock_file(port), timeout=OWNER_S, thread_local=False)
    try:
        lock.acquire()
    except filelock.Timeout:
        owner = _noted_owner(port)
        by = f"process {owner}" if owner else "another program"
        raise TransportError(f"{port} is already in use by {by}") from None
    except OSError as problem:
        raise TransportError(f"cannot lock {port}: {problem}") from problem
    return lock


def _open(port: str, baud: int) -> Any:
    try:
        return serial.serial_for_url(port, baudrate=baud, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
    except (serial.SerialException, OSError, ValueError) as problem:
        raise TransportError(_why_not(port, problem)) from problem


def _why_not(port: str, problem: Exception) -> str:
    number = getattr(problem, "errno", None)
    if number == errno.ENOENT:
        return f"there is no port {port}"
    if number in (errno.EBUSY, errno.EAGAIN):
        return f"{port} is already in use by another program"
    if number == errno.EACCES:
        return f"no permission to open {port}"
    return f"cannot open {port}: {problem}".splitlines()[0]


def _lock_file(port: str) -> Path:
    # One port must have one lock, whichever of its names (a by-id link, say) it is opened by.
    real = os.path.realpath(port) if os.path.exists(port) else port
    return Path(tempfile.gettempdir()) / f"rig-port-{re.sub(r'[^A-Za-z0-9.]+', '-', real)}.lock"


def _owner_file(port: str) -> Path:
    return _lock_file(port).with_suffix(".owner")


def _noted_owner(port: str) -> int | None:
    try:
        return int(_owner_file(port).read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None
