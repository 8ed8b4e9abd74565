"""Events for pages; each page has its own queue, so that a slow one delays no other."""

import asyncio
import json
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from starlette.types import Message, Receive, Send

MOST_STREAMS = 4
"""Maximum number of streams: a browser has six connections to a host, and two remain for other requests."""
MOST_ROWS = 20_000
"""Number of readings stored for a page that does not fetch them: several hundred seconds at fifty per second."""
SHOWN_S = 60.0
"""Past run time that a new page receives (s)."""

Row = Sequence[Any]


@dataclass(frozen=True)
class ReadingSource:
    """Source of readings; `run` is the name of its folder, None for manual control."""

    run: str | None
    columns: tuple[str, ...]
    hand: bool = False


NOTHING = ReadingSource(None, ())


def as_event(kind: str, data: Mapping[str, Any]) -> str:
    """Return a server-sent event."""
    return f"event: {kind}\ndata: {json.dumps(data, allow_nan=False, separators=(',', ':'))}\n\n"


@dataclass(eq=False)
class PageQueue:
    """Pending events of one page: the newest states and drawings, and all readings up to a limit."""

    source: ReadingSource
    rows: deque[Row]
    latest: dict[str, str]
    reset: bool = True
    dropped: int = 0
    woken: asyncio.Event = field(default_factory=asyncio.Event)

    def put(self, kind: str, event: str) -> None:
        """Store the newest event of its kind."""
        self.latest[kind] = event
        self.woken.set()

    def add(self, rows: Sequence[Row]) -> None:
        """Add readings; drop and count the oldest beyond the limit."""
        self.rows.extend(rows)
        while len(self.rows) > MOST_ROWS:
            self.rows.popleft()
            self.dropped += 1
        self.woken.set()

    def begin(self, source: ReadingSource) -> None:
        """Start with readings of another source, and drop the old ones."""
        self.source, self.reset = source, True
        self.rows.clear()
        self.woken.set()

    def taken(self, unix_s: float) -> str:
        """Return all pending events."""
        self.woken.clear()
        found = "".join(self.latest.values())
        self.latest.clear()
        if self.rows or self.reset:
            source = self.source
            data: dict[str, Any] = {
                "unix_s": unix_s,
                "run": source.run,
                "hand": source.hand,
                "columns": source.columns,
            }
            data |= {"reset": self.reset, "dropped": self.dropped, "rows": list(self.rows)}
            found += as_event("readings", data)
            self.rows.clear()
            self.reset, self.dropped = False, 0
        return found


class Outlet:
    """Publisher that sends new events to every page, and the current state to a new page."""

    def __init__(self) -> None:
        self.clients: list[PageQueue] = []
        self.closed = False
        self._latest: dict[str, str] = {}
        self.source, self._rows = NOTHING, deque[Row](maxlen=MOST_ROWS)

    def publish(self, kind: str, data: Mapping[str, Any]) -> None:
        """Publish a state, a schedule, a prediction or a section."""
        self._latest[kind] = event = as_event(kind, data)
        for client in self.clients:
            client.put(kind, event)

    def begin(self, source: ReadingSource) -> None:
        """Start with readings of another source."""
        self.source = source
        self._rows.clear()
        for client in self.clients:
            client.begin(source)

    def add(self, rows: Sequence[Row]) -> None:
        """Publish new readings of the source."""
        if not rows:
            return
        self._rows.extend(rows)
        at = self.source.columns.index("t_s")
        while self._rows[-1][at] - self._rows[0][at] > SHOWN_S:
            self._rows.popleft()
        for client in self.clients:
            client.add(rows)

    def close(self) -> None:
        """End all streams."""
        self.closed = True
        for client in self.clients:
            client.woken.set()

    @property
    def full(self) -> bool:
        """Whether the maximum number of pages is reached."""
        return len(self.clients) >= MOST_STREAMS

    @contextmanager
    def joined(self) -> Iterator[PageQueue]:
        """Add a page until it leaves."""
        client = PageQueue(self.source, deque(self._rows), dict(self._latest))
        client.woken.set()
        self.clients.append(client)
        try:
            yield client
        finally:
            self.clients.remove(client)


async def stream(
    outlet: Outlet, client: PageQueue, receive: Receive, send: Send, unix_s: Callable[[], float]
) -> None:
    """Send a page its events until it leaves or the outlet is closed."""
    tasks = {asyncio.create_task(_gone(receive)), asyncio.create_task(_write(outlet, client, send, unix_s))}
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


async def _write(outlet: Outlet, client: PageQueue, send: Send, unix_s: Callable[[], float]) -> None:
    headers = [(b"content-type", b"text/event-stream; charset=utf-8")]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send(_body("retry: 1000\n\n"))
    while not outlet.closed:
        await client.woken.wait()
        await send(_body(client.taken(unix_s())))
    await send({"type": "http.response.body", "body": b"", "more_body": False})


def _body(text: str) -> Message:
    return {"type": "http.response.body", "body": text.encode(), "more_body": True}
