"""One port, one owner: a lock file that the system releases when its process dies, and a note of who that is."""

import os
import re
import tempfile
from collections.abc import Iterable
from pathlib import Path

import filelock

from rig.transport.base import TransportError

# Somebody who only asks for the owner holds the lock for a moment.
_OWNER_S = 0.2


class PortOwnership:
    """This process's hold on a port. Raises TransportError, which names the owner, where there is another."""

    def __init__(self, port: str) -> None:
        self._note = _owner_file(port)  # found now: a port that is unplugged loses its other names
        # Not thread-local: a stop from another thread may close the port.
        self._lock = filelock.FileLock(_lock_file(port), timeout=_OWNER_S, thread_local=False)
        try:
            self._lock.acquire()
        except filelock.Timeout:
            owner = _noted_owner(port)
            by = f"process {owner}" if owner is not None else "another program"
            raise TransportError(f"{port} is already in use by {by}") from None
        except OSError as problem:
            raise TransportError(f"cannot lock {port}: {problem}") from problem
        self._note.write_text(str(os.getpid()), encoding="ascii")

    def release(self) -> None:
        """Let others have the port."""
        self._note.unlink(missing_ok=True)
        self._lock.release()


def port_owner(port: str) -> int | None:
    """Return the process id that holds this port, None if nobody does."""
    try:
        with filelock.FileLock(_lock_file(port), timeout=0):
            return None
    except (filelock.Timeout, OSError):
        return _noted_owner(port)


def first_owner(ports: Iterable[str]) -> int | None:
    """Return the process id that holds one of these ports, None if nobody does."""
    return next((owner for port in ports if (owner := port_owner(port)) is not None), None)


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
