"""Asks an application as a server would: one request, its whole answer."""

import asyncio
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote

from starlette.datastructures import Headers

Pairs = Sequence[tuple[str, str | bytes]]


@dataclass(frozen=True)
class Answer:
    """What came back."""

    status_code: int
    headers: Headers
    content: bytes

    def json(self) -> Any:
        return json.loads(self.content)


def asked(app: Any, method: str, target: str, headers: Pairs, pieces: Sequence[bytes] = (b"",)) -> Answer:
    """The answer to a request whose body comes in these pieces."""
    return asyncio.run(answer_to(app, method, target, headers, pieces))


async def answer_to(app: Any, method: str, target: str, headers: Pairs, pieces: Sequence[bytes]) -> Answer:
    """The same, beside other requests."""
    path, _, query = target.partition("?")
    raw = [(name.encode(), value if isinstance(value, bytes) else value.encode()) for name, value in headers]
    scope = {"type": "http", "http_version": "1.1", "method": method, "scheme": "http", "headers": raw}
    scope |= {"path": unquote(path), "raw_path": path.encode(), "root_path": "", "query_string": query.encode()}
    coming = [{"type": "http.request", "body": piece, "more_body": True} for piece in pieces[:-1]]
    coming += [{"type": "http.request", "body": pieces[-1], "more_body": False}]
    said: list[dict[str, Any]] = []

    async def receive() -> dict[str, Any]:
        if not coming:
            await asyncio.Event().wait()  # it stays until all is said
        return coming.pop(0)

    async def send(message: dict[str, Any]) -> None:
        said.append(message)

    await app(scope, receive, send)
    start, *bodies = said
    return Answer(start["status"], Headers(raw=start["headers"]), b"".join(one.get("body", b"") for one in bodies))
