"""Servers of the panel: uvicorn, with a bound on connections, and descriptors that are kept for STOP.

uvicorn limits neither the number of open connections nor the time until the first request, and
`limit_concurrency` refuses requests of everybody once idle connections have reached it. Here a connection gives way.
"""

import asyncio
import asyncio.constants
import errno
import json
import logging
import os
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

HOST = "127.0.0.1"
MOST_GUESTS, MOST_KNOWN = 320, 64
"""Open connections of a server, without and with the token; of more, the oldest gives way."""
HEADER_S = 5.0
"""Longest time until the first request (s)."""
HELD_S = 300
"""Time for which a connection that has shown the token stays open between requests (s)."""
MOST_HEADER = 16_384
"""Longest header (bytes)."""

_BACKLOG = 4096  # the system's queue; a full one would delay a new connection by a second
_AT_ONCE = 16  # connections that are accepted in one turn of the loop
_FEW, _MOST_GUEST_BYTES = 8, 1 << 18  # connections without descriptors to spare; a guest only reads
_SPARE = 16
_AGAIN_S = 0.1

HasToken = Callable[[Sequence[tuple[bytes, bytes]]], bool]


class Reserve:
    """Open descriptors without a use, so that a stop has some when no other is left."""

    def __init__(self) -> None:
        self._lock, self._spare, self._stops = threading.Lock(), list[int](), 0

    @property
    def short(self) -> bool:
        """Whether no other descriptor is left."""
        return len(self._spare) < _SPARE

    @contextmanager
    def freed(self) -> Iterator[None]:
        """Free the descriptors for a stop."""
        with self._lock:
            self._stops += 1
            self._close()
        try:
            yield
        finally:
            with self._lock:
                self._stops -= 1
            self.fill()

    def fill(self) -> None:
        """Open as many as there can be."""
        with self._lock, suppress(OSError):
            while not self._stops and len(self._spare) < _SPARE:
                self._spare.append(os.open(os.devnull, os.O_RDONLY))

    def release(self) -> None:
        """Close half for new connections; the other half stays for a stop."""
        with self._lock:
            self._close(_SPARE // 2)

    def close(self) -> None:
        """Close all, until they are filled again."""
        with self._lock:
            self._close()

    def _close(self, remaining: int = 0) -> None:
        while len(self._spare) > remaining:
            os.close(self._spare.pop())


class Group(dict["Connection", None]):
    """Connections of a server, the oldest first."""


class Connection(H11Protocol):
    """Connection that gives way to a newer one, unless it has shown the token."""

    def __init__(self, has_token: HasToken, reserve: Reserve, guests: Group, known: Group, **more: Any) -> None:
        super().__init__(**more)
        self._has_token, self._reserve, self._guests, self._known = has_token, reserve, guests, known
        self._received = 0

    @property
    def idle(self) -> bool:
        """Whether no request waits for its answer."""
        return not self.cycle or self.cycle.response_complete

    def abort(self) -> None:
        """Close the connection at once."""
        self._forget()
        self.transport.abort()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Let the oldest connection give way to this one."""
        super().connection_made(transport)
        self._guests[self] = None
        self.loop.call_later(HEADER_S, self._end_if_silent)
        while len(self._guests) > (_FEW if self._reserve.short else MOST_GUESTS):
            next(iter(self._guests)).abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Make room for another connection."""
        super().connection_lost(exc)
        self._forget()

    def data_received(self, data: bytes) -> None:
        """Serve requests, and note the first one with the token."""
        super().data_received(data)
        self._received += len(data)
        if self not in self._guests:
            return
        if self.headers and self._has_token(self.headers):
            self.timeout_keep_alive = HELD_S
            del self._guests[self]
            if len(self._known) >= MOST_KNOWN:
                next((one for one in self._known if one.idle), next(iter(self._known))).abort()
            self._known[self] = None
        elif self._received > _MOST_GUEST_BYTES:
            self.abort()

    def send_400_response(self, msg: str) -> None:
        """Refuse an invalid request with a line of JSON, as all others."""
        super().send_400_response(json.dumps({"ok": False, "problem": msg, "code": "bad_request"}))

    def _forget(self) -> None:
        self._guests.pop(self, None)
        self._known.pop(self, None)

    def _end_if_silent(self) -> None:
        if not self.headers:
            self.abort()


class Server(uvicorn.Server):
    """Server on a bound socket, which leaves signals to the panel."""

    def __init__(self, app: Any, listener: socket.socket, has_token: HasToken, reserve: Reserve) -> None:
        guests, known = Group(), Group()

        def connection(**of_the_server: Any) -> asyncio.Protocol:
            return Connection(has_token, reserve, guests, known, **of_the_server)

        super().__init__(
            uvicorn.Config(
                app,
                http=connection,  # type: ignore[arg-type]
                ws="none",
                lifespan="off",
                access_log=False,
                log_config=None,
                proxy_headers=False,
                server_header=False,
                backlog=_AT_ONCE,
                h11_max_incomplete_event_size=MOST_HEADER,
                timeout_graceful_shutdown=2,
                callback_notify=self._fill,
                timeout_notify=1,
            )
        )
        self._listener, self._reserve = listener, reserve

    async def run_here(self) -> None:
        """Serve in the running loop until `should_exit`."""
        asyncio.get_running_loop().set_exception_handler(self._note)
        # The loop listens again after this time if there was no descriptor for a connection; else after a second.
        vars(asyncio.constants)["ACCEPT_RETRY_DELAY"] = _AGAIN_S
        await self.serve(sockets=[self._listener])

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, with a longer queue of the system than is accepted at once."""
        await super().startup(sockets)
        self._listener.listen(_BACKLOG)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals alone."""
        yield

    async def _fill(self) -> None:
        self._reserve.fill()

    def _note(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Log an error of the loop; where it could not accept a connection, free descriptors for its next try."""
        if getattr(context.get("exception"), "errno", None) in (errno.EMFILE, errno.ENFILE):
            self._reserve.release()
        loop.default_exception_handler(context)


class Once(logging.Filter):
    """Filter that lets each line of a server pass once, without its traceback."""

    _MOST = 50

    def __init__(self) -> None:
        super().__init__()
        self._logged: set[str] = set()

    def filter(self, record: logging.LogRecord) -> bool:
        """Shorten a record, or leave it out."""
        words = record.getMessage().strip().partition("\n")[0]
        if record.exc_info and record.exc_info[1] is not None:
            error = record.exc_info[1]
            words += f": {type(error).__name__}: {error}".partition("\n")[0]
        if words in self._logged or len(self._logged) >= self._MOST:
            return False
        self._logged.add(words)
        record.msg, record.args, record.exc_info, record.exc_text = words, (), None, None
        return True

    @contextmanager
    def filtering(self) -> Iterator[None]:
        """Filter the lines of servers and loops."""
        loggers = [logging.getLogger(name) for name in ("uvicorn.error", "asyncio")]
        for one in loggers:
            one.addFilter(self)
        try:
            yield
        finally:
            for one in loggers:
                one.removeFilter(self)


def bound(port: int) -> socket.socket:
    """Return a bound socket on loopback. Raises OSError, which names the port."""
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((HOST, port))
        found.listen(_BACKLOG)
    except OSError as error:
        found.close()
        raise OSError(error.errno, error.strerror, f"{HOST}:{port}") from None
    return found
