"""Connections of the panel: how many there are, which of them gives way, and the descriptors that STOP needs.

uvicorn limits neither the connections without a request nor their time, and asyncio accepts until no descriptor is
left. Here a connection waits as a bare socket until its header is complete. A request with the token is then served
at once; those of guests are served in turn, and the oldest waiting connection gives way to a new one.
"""

import asyncio
import json
import logging
import os
import re
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

from rig.clock import Clock
from rig.panel.access import EVENTS

BACKLOG = 4096
"""Connections that the system holds for the panel; a shorter queue would delay a new one by a second."""
HEADER_S = 5.0
"""Longest time until a header is complete (s)."""
MOST_HEADER = 16_384
"""Longest header (bytes)."""
MOST_GUESTS, MOST_HOLDERS = 16, 64
"""Maximum number of connections that are served, without and with the token."""
HOLDER_KEPT_S = 300
"""Time for which a connection with the token stays open between requests (s); a STOP over it needs no new one."""
LINE_EVERY_S = 60.0
"""Shortest time between two lines of one logger and level (s)."""

_GUEST_S = 2.0  # after which an unanswered guest gives way to another one
_MOST_GUEST_BYTES = 1 << 18  # a guest only reads
_MOST_WAITING, _FEWEST_WAITING = 1024, 16
_ACCEPTED_AT_ONCE, _SERVED_AT_ONCE = 128, 2  # in one turn of the loop; one while a request with the token is pending
_SPARE, _SPARE_FOR_STOP = 16, 12
_LOOK_S, _AGAIN_S = 0.25, 0.02
_HEADER_END = re.compile(rb"\n\r?\n")
_SELECT = 512  # descriptors that select() watches on Windows

Pairs = list[tuple[bytes, bytes]]
"""Headers of a request, with lower-case names."""


if sys.platform == "win32":

    def descriptors() -> int:
        """Return how many descriptors this process may open."""
        return _SELECT

else:
    import resource

    def descriptors() -> int:
        """Return how many descriptors this process may open."""
        soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        return sys.maxsize if soft == resource.RLIM_INFINITY else soft


@dataclass(eq=False)
class _Waiting:
    """Connection whose header is not complete, or that waits for its turn."""

    end: socket.socket
    since_s: float
    data: bytearray = field(default_factory=bytearray)
    watched: bool = False


class Served(H11Protocol):
    """Connection that the server serves; it becomes a holder's with the first request that has the token."""

    def __init__(self, connections: "Connections", first: bytes, since_s: float, **of_the_server: Any) -> None:
        super().__init__(**of_the_server)
        self._connections, self._first, self.since_s = connections, first, since_s
        self._received = 0

    @property
    def idle(self) -> bool:
        """Whether the last request is answered."""
        return self.cycle is not None and self.cycle.response_complete

    @property
    def is_unanswered(self) -> bool:
        """Whether a complete request waits for its reply, or for the end of the reply."""
        return self.cycle is not None and not self.cycle.more_body and not self.idle

    @property
    def is_pending(self) -> bool:
        """Whether a complete request, other than for a stream, waits for its answer."""
        return self.is_unanswered and (self.scope is None or self.scope["path"] != EVENTS)

    def abort(self) -> None:
        """Close the connection at once."""
        self._connections.left(self)
        if self.transport is not None:
            self.transport.abort()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin with the bytes that have already arrived."""
        super().connection_made(transport)
        self.data_received(self._first)

    def data_received(self, data: bytes) -> None:
        """Serve requests, and note the first one with the token."""
        self._received += len(data)
        super().data_received(data)
        if self._connections.holds(self):
            return
        if self.headers and self._connections.may_hold(self.headers):
            self._connections.enter_as_holder(self)
        elif self._received > _MOST_GUEST_BYTES:
            self.abort()

    def send_400_response(self, msg: str) -> None:
        """Refuse an invalid request with a line of JSON, as all others."""
        super().send_400_response(json.dumps({"ok": False, "problem": msg, "code": "bad_request"}))

    def connection_lost(self, exc: Exception | None) -> None:
        """Make room for another connection."""
        super().connection_lost(exc)
        self._connections.left(self)


class Connections:
    """Accepts connections, and passes those with a complete header to the server."""

    def __init__(self, listener: socket.socket, may_hold: Callable[[Pairs], bool], clock: Clock) -> None:
        """Prepare the connections. may_hold: returns whether the headers of a request contain the token."""
        self.may_hold = may_hold
        self._listener, self._clock = listener, clock
        self._most_waiting = max(_FEWEST_WAITING, min(_MOST_WAITING, descriptors() // 2))
        self._waiting: dict[_Waiting, None] = {}
        self._complete: dict[_Waiting, None] = {}
        self._unwatched: list[_Waiting] = []
        self._guests: dict[Served, None] = {}
        self._holders: dict[Served, None] = {}
        self._begun: set[asyncio.Task[Any]] = set()
        self._spare: list[int] = []
        self._stops, self._open, self._serving, self._crowded = 0, False, False, False
        self._scarce_until_s = -1.0

    def begin(self, **of_the_server: Any) -> None:
        """Accept connections in the running loop; of_the_server: arguments of the server's protocol."""
        self._loop, self._of_the_server, self._open = asyncio.get_running_loop(), of_the_server, True
        self._listener.setblocking(False)
        self._listener.listen(BACKLOG)
        self._loop.add_reader(self._listener, self._accept)
        self._look()

    def close(self) -> None:
        """Accept no more, and close the waiting connections."""
        if not self._open:
            return
        self._open = False
        self._loop.remove_reader(self._listener)
        self._looking.cancel()
        while self._waiting:
            self._drop(next(iter(self._waiting)))
        self._release(0)

    # --- descriptors ---

    @contextmanager
    def room_for_stop(self) -> Iterator[None]:
        """Free descriptors for the connections to the owners of ports."""
        self._stops += 1
        self._release(0)
        try:
            yield
        finally:
            self._stops -= 1
            self._fill()

    def _release(self, down_to: int) -> bool:
        """Close spare descriptors; return whether there were any."""
        found = self._spare[down_to:]
        del self._spare[down_to:]
        for one in found:
            os.close(one)
        return bool(found)

    def _fill(self) -> None:
        """Take spare descriptors, if need be those of other connections."""
        while self._open and not self._stops and len(self._spare) < _SPARE:
            try:
                self._spare.append(os.open(os.devnull, os.O_RDONLY))
            except OSError:
                self._scarce_until_s = self._clock.monotonic_s() + HEADER_S
                if not self._give_way():
                    return

    def _give_way(self) -> bool:
        """Close the longest waiting connection, unless its header is complete; return whether there was one."""
        if not self._waiting:
            return False
        one = next(iter(self._waiting))
        if not one.watched and one not in self._complete:
            self._read(one)
        if one in self._waiting:
            self._drop(one)
        return True

    # --- waiting connections ---

    def _accept(self) -> None:
        self._crowded, pending = False, self._is_pending()
        for _ in range(1 if pending else _ACCEPTED_AT_ONCE):
            if self._stops and self._clock.monotonic_s() < self._scarce_until_s and not self._give_way():
                self._accept_later()  # The descriptors that are free are those of a stop.
                return
            try:
                end, _address = self._listener.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                self._watch()
                return
            except OSError:  # No descriptor is left.
                self._scarce_until_s = self._clock.monotonic_s() + HEADER_S
                if self._give_way() or self._release(_SPARE_FOR_STOP):
                    continue
                self._accept_later()
                return
            end.setblocking(False)
            if len(self._waiting) >= self._most_waiting:
                self._give_way()
            one = _Waiting(end, self._clock.monotonic_s())
            self._waiting[one] = None
            self._read(one)
        self._crowded = not pending
        if pending:
            self._watch()

    def _accept_later(self) -> None:
        self._loop.remove_reader(self._listener)
        self._loop.call_later(_AGAIN_S, self._accept_again)

    def _accept_again(self) -> None:
        if self._open:
            self._loop.add_reader(self._listener, self._accept)

    def _read(self, one: _Waiting) -> None:
        """Read the received part of a header."""
        try:
            data = one.end.recv(MOST_HEADER + 1)
        except (BlockingIOError, InterruptedError):
            self._watch_later(one)
            return
        except OSError:
            data = b""
        one.data += data
        if not data or len(one.data) > MOST_HEADER or not one.data[:1].isalpha():
            self._drop(one)
        elif found := _HEADER_END.search(one.data, max(0, len(one.data) - len(data) - 2)):
            self._unwatch(one)
            if self.may_hold(_pairs(one.data[: found.start()])):
                self.enter_as_holder(self._serve(one))
            else:
                self._complete[one] = None
                self._serve_soon()
        else:
            self._watch_later(one)

    def _watch_later(self, one: _Waiting) -> None:
        """Watch a connection once all waiting connections are accepted, since watching takes as long as accepting."""
        if not one.watched:
            self._unwatched.append(one)

    def _watch(self) -> None:
        for one in self._unwatched:
            if one in self._waiting and not one.watched:
                one.watched = True
                self._loop.add_reader(one.end.fileno(), self._read, one)
        self._unwatched.clear()

    def _unwatch(self, one: _Waiting) -> None:
        if one.watched:
            one.watched = False
            self._loop.remove_reader(one.end.fileno())

    def _drop(self, one: _Waiting) -> None:
        self._unwatch(one)
        self._waiting.pop(one)
        self._complete.pop(one, None)
        one.end.close()

    def _look(self) -> None:
        """Close connections that wait for too long, and reserve spare descriptors."""
        then_s = self._clock.monotonic_s() - HEADER_S
        self._watch()
        while self._waiting and next(iter(self._waiting)).since_s < then_s:
            self._give_way()
        self._fill()
        self._serve_soon()
        self._looking = self._loop.call_later(_LOOK_S, self._look)

    # --- served connections ---

    def holds(self, one: Served) -> bool:
        """Return whether a connection has shown the token."""
        return one in self._holders

    def enter_as_holder(self, one: Served) -> None:
        """Count a connection that has shown the token; the oldest idle one gives way, a complete request last."""
        one.timeout_keep_alive = HOLDER_KEPT_S
        self._guests.pop(one, None)
        if len(self._holders) >= MOST_HOLDERS:
            min(self._holders, key=lambda other: (not other.idle, other.is_unanswered)).abort()
        self._holders[one] = None

    def left(self, one: Served) -> None:
        """Forget a closed connection."""
        self._guests.pop(one, None)
        self._holders.pop(one, None)
        self._serve_soon()

    def _is_pending(self) -> bool:
        """Return whether a request with the token waits for its answer, apart from the streams."""
        return any(one.is_pending for one in self._holders)

    def _serve_soon(self) -> None:
        if self._open and self._complete and not self._serving:
            self._serving = True
            self._loop.call_soon(self._serve_guests)

    def _serve_guests(self) -> None:
        """Serve a few guests in one turn of the loop, and none while more connections wait to be accepted."""
        self._serving = False
        if self._crowded:
            self._serve_soon()
            return
        for _ in range(1 if self._is_pending() else _SERVED_AT_ONCE):
            if not self._complete or not self._has_place():
                return
            self._guests[self._serve(next(iter(self._complete)))] = None
        self._serve_soon()

    def _has_place(self) -> bool:
        """Return whether another guest can be served; an idle or old one gives way."""
        if len(self._guests) < MOST_GUESTS:
            return True
        then_s = self._clock.monotonic_s() - _GUEST_S
        found = next((one for one in self._guests if one.idle or one.since_s < then_s), None)
        if found is not None:
            found.abort()
        return found is not None

    def _serve(self, one: _Waiting) -> Served:
        """Pass a connection to the server."""
        self._waiting.pop(one)
        self._complete.pop(one, None)
        served = Served(self, bytes(one.data), self._clock.monotonic_s(), **self._of_the_server)
        begun = self._loop.create_task(self._loop.connect_accepted_socket(lambda: served, one.end))
        self._begun.add(begun)
        begun.add_done_callback(self._begun.discard)
        return served


def _pairs(head: bytearray) -> Pairs:
    lines = (line.partition(b":") for line in bytes(head).splitlines()[1:])
    return [(name.strip().lower(), value.strip()) for name, _, value in lines]


class FewLines(logging.Filter):
    """Filter that lets one line of each logger and level pass in LINE_EVERY_S, without its traceback."""

    def __init__(self, clock: Clock) -> None:
        super().__init__()
        self._clock = clock
        self._said_s: dict[tuple[str, int], float] = {}
        self._left_out: dict[tuple[str, int], int] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Shorten a record, or leave it out and count it."""
        kind, now_s = (record.name, record.levelno), self._clock.monotonic_s()
        if now_s - self._said_s.get(kind, -LINE_EVERY_S) < LINE_EVERY_S:
            self._left_out[kind] = self._left_out.get(kind, 0) + 1
            return False
        self._said_s[kind], left_out = now_s, self._left_out.pop(kind, 0)
        words = record.getMessage().strip().partition("\n")[0]
        if record.exc_info and record.exc_info[1] is not None:
            error = record.exc_info[1]
            words += f": {type(error).__name__}: {error}".partition("\n")[0]
        record.msg = words + (f" ({left_out} more lines were left out)" if left_out else "")
        record.args, record.exc_info, record.exc_text = (), None, None
        return True

    @contextmanager
    def filtering(self) -> Iterator[None]:
        """Filter the lines of the server and of its loop."""
        loggers = [logging.getLogger(name) for name in ("uvicorn.error", "asyncio")]
        for one in loggers:
            one.addFilter(self)
        try:
            yield
        finally:
            for one in loggers:
                one.removeFilter(self)
