"""One port, one owner, by what the port is and not by what it is called."""

from collections.abc import Iterable
from typing import Any

from rig.transport.base import TransportError
from rig.transport.identity import identities
from rig.transport.machine_lock import LockHeldError, MachineLock, PortOwner, lock_owner


class NotOwnedError(TransportError):
    """The port cannot be had for oneself; owner: who has it, None where it cannot be locked at all."""

    default_code = "in_use"

    def __init__(self, sentence: str, owner: PortOwner | None, /, *, code: str | None = None, **fields: Any) -> None:
        super().__init__(sentence, code=code, **fields)
        self.owner = owner


class PortOwnership:
    """This process's hold on a port, under all of its names and for every account.

    Raises
    ------
    NotOwnedError
        If another process owns it, or it cannot be locked.
    TransportError
        If the host of a TCP port has no address.
    """

    def __init__(self, port: str) -> None:
        self._locks: list[MachineLock] = []
        self.names = identities(port)
        try:
            for name in self.names:
                self._locks.append(MachineLock(name))
        except LockHeldError as held:
            self.release()
            raise NotOwnedError(
                "{port} is already in use by {owner}",
                held.owner,
                code="in_use",
                port=port,
                owner=str(held.owner),
                pid=held.owner.pid,
            ) from None
        except OSError as problem:
            self.release()
            raise NotOwnedError(
                "cannot lock {port}: {path}: {problem}; expected its owner to remove that",
                None,
                code="not_lockable",
                port=port,
                path=str(problem.filename),
                problem=problem.strerror,
            ) from problem

    def release(self) -> None:
        """Let others have the port."""
        while self._locks:
            self._locks.pop().release()


def port_owner(port: str) -> PortOwner | None:
    """Return who owns a port, None if nobody does, or it is not there."""
    try:
        names = identities(port)
    except TransportError:
        return None
    return next((owner for name in names if (owner := lock_owner(name)) is not None), None)


def first_owner(ports: Iterable[str]) -> PortOwner | None:
    """Return who owns one of these ports, None if nobody does."""
    return next((owner for port in ports if (owner := port_owner(port)) is not None), None)
