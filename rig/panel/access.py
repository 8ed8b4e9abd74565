"""Gate of the panel: accepts requests that name this server; changes and streams need its own page and its token.

The Host header is checked against DNS rebinding, the Origin and Sec-Fetch headers against other pages of the same
browser, and the token against other users of this machine, who can connect but cannot read this process.
"""

import secrets
from collections.abc import Sequence
from dataclasses import dataclass

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

EVENTS = "/events"
"""Path of the streams, of which there are few: only a page with the token may open one."""
TOKEN_HEADER, TAB_HEADER = "x-rig-token", "x-rig-tab"
FILE_POLICY = (
    "sandbox; default-src 'none'; img-src data:; style-src 'unsafe-inline'; font-src data:; frame-ancestors 'none'"
)
"""Content security policy of a run's files: a browser may only display them."""

_HEADERS = {
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
}
_SHOWS = ("GET", "HEAD")
_PREFLIGHT = {
    "access-control-allow-methods": "HEAD, POST",
    "access-control-allow-headers": f"content-type, {TAB_HEADER}, {TOKEN_HEADER}",
    "access-control-max-age": "7200",
}


@dataclass(frozen=True)
class Address:
    """Port of a page, that of STOP, and the token of both."""

    port: int
    stop_port: int
    token: str

    @property
    def page_policy(self) -> str:
        """Content security policy of the page: its own files, and requests to both ports."""
        stops = " ".join(f"http://{name}:{self.stop_port}" for name in ("127.0.0.1", "localhost"))
        return (
            f"default-src 'none'; connect-src 'self' {stops}; img-src 'self' data:; "
            "script-src 'self'; style-src 'self'; worker-src 'self'; "
            "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )

    def has_token(self, headers: Sequence[tuple[bytes, bytes]]) -> bool:
        """Return whether a request has the token once; headers: pairs with lower-case names."""
        found = [value for name, value in headers if name == TOKEN_HEADER.encode()]
        return len(found) == 1 and secrets.compare_digest(found[0], self.token.encode())


class Gate:
    """Middleware that checks every request, and sets security headers on every response.

    for_stop: it guards the port of STOP, where every request comes from the page and needs the token.
    """

    def __init__(self, app: ASGIApp, address: Address, *, for_stop: bool = False) -> None:
        self._app, self._address, self._for_stop = app, address, for_stop
        port = address.stop_port if for_stop else address.port
        self._hosts = (f"127.0.0.1:{port}", f"localhost:{port}")
        self._headers = {**_HEADERS, "content-security-policy": address.page_policy}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return
        found = Headers(scope=scope)
        own = f"http://{found.get('host', '').lower().partition(':')[0]}:{self._address.port}"
        shared = {"access-control-allow-origin": own, "vary": "origin"} if self._for_stop else {}

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in (self._headers | shared).items():
                    headers.setdefault(name, value)
            await send(message)

        problem = self._problem(scope["method"], scope["path"], found, own)
        if problem is not None:
            code, words = problem
            if code in ("foreign_host", "foreign_origin"):
                shared.clear()
            await JSONResponse({"ok": False, "problem": words, "code": code}, 403)(scope, receive, sent)
        elif self._for_stop and scope["method"] == "OPTIONS":
            await Response(status_code=204, headers=_PREFLIGHT)(scope, receive, sent)
        else:
            whole = {"headers": [pair for pair in scope["headers"] if pair[0] != b"range"]}
            await self._app({**scope, **whole}, receive, sent)  # No page needs a part of a file.

    def _problem(self, method: str, path: str, headers: Headers, own: str) -> tuple[str, str] | None:
        """Return the code and the sentence of a refusal, or None."""
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            return "foreign_host", f"host: must be {' or '.join(self._hosts)}"
        if method in _SHOWS and not self._for_stop:
            if origins not in ([], [own]) or not _from_here(headers):
                return "foreign_page", "the request comes from another page; use the panel's own page"
            if path != EVENTS:
                return None
        elif origins != [own]:
            return "foreign_origin", f"origin: must be {own}"
        elif self._for_stop and method == "OPTIONS":  # a browser's question before a request with the token
            return None
        if not self._address.has_token(headers.raw):
            return "wrong_token", "token: must be the one that rig panel printed; open the address that it printed"
        return None


def _from_here(headers: Headers) -> bool:
    """Return whether the request comes from this page or a followed link, by the headers of the browser."""
    site, mode = headers.get("sec-fetch-site", "none"), headers.get("sec-fetch-mode", "")
    return site in ("none", "same-origin") or mode == "navigate"
