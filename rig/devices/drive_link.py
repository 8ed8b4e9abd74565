"""Port of drives that answer one request at a time."""

import threading
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from typing import ClassVar, Protocol, TypeVar

from rig.clock import Clock
from rig.devices.base import StageError, StageRejected, StageTimeout
from rig.transport import Transport, in_turn

REPLY_S = 0.2
READ_TRIES = 3

T = TypeVar("T")


class Link(Protocol):
    """Port of one or several drives."""

    name: str

    def close(self) -> None:
        """Close the port."""
        ...


L = TypeVar("L", bound=Link)


class DriveLink:
    """Base class of a link: a request waits for its turn and for its reply; a question is repeated."""

    IF_GARBLED: ClassVar[str] = "the cable and stage.baud"
    IF_SILENT: ClassVar[str] = "the power, the cable, stage.baud and the address"

    def __init__(self, transport: Transport, clock: Clock) -> None:
        self.name = transport.name
        self._transport, self._clock = transport, clock
        self._one = threading.Lock()

    def close(self) -> None:
        """Close the transport."""
        self._transport.close()

    def _turn(self) -> AbstractContextManager[None]:
        """Wait for the exchange of another thread, but not for one that hangs."""
        return in_turn(self._one, 2 * REPLY_S)

    def _repeated(self, ask: Callable[[], T], tries: int = READ_TRIES, *, refused: bool = True) -> T:
        """Ask again if the reply is missing or garbled, and if it is a refusal. Raises StageError, TransportError."""
        for _ in range(tries - 1):
            try:
                return ask()
            except StageError as error:
                if isinstance(error, StageRejected) and not refused:
                    raise
        return ask()

    def _garbled(self, label: str, heard: object) -> StageError:
        return StageError(f"{label}: {heard} is garbled; check {self.IF_GARBLED}", "garbled")

    def _silent(self, label: str, timeout_s: float = REPLY_S) -> StageTimeout:
        return StageTimeout(f"{label}: no reply within {timeout_s:g} s; check {self.IF_SILENT}", "no_reply")


def opened(ports: Iterable[str], link: Callable[[str], L]) -> dict[str, L]:
    """Return a link on each port; close all of them if one does not open. Raises TransportError."""
    links: dict[str, L] = {}
    try:
        for port in ports:
            links[port] = link(port)
    except BaseException:
        for one in links.values():
            one.close()
        raise
    return links


def both_answer(port: str, answers: Mapping[str, bool], code: str, remedy: str) -> bool:
    """Return whether the two drives of a stage answer, by name. Raises StageError if only one does."""
    silent = [name for name, answered in answers.items() if not answered]
    if silent and any(answers.values()):
        raise StageError(
            f"{port}: of {' and '.join(answers)}, only one answers; {silent[0]} does not; check its power, cable and "
            f"address, or {remedy}",
            code,
        )
    return not silent
