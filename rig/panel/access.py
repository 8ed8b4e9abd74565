"""Gate of the panel: accepts requests that name this server; changes and streams need its own page and its token.

The Host header is checked against DNS rebinding, the Origin and Sec-Fetch headers against other pages of the same
browser, and the token against other users of this machine, who can connect but cannot read this process.
"""

import secrets
from collections.abc import Sequence

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

EVENTS = "/events"
"""Path of the streams, of which there are few: only a page with the token may open one."""
TOKEN_HEADER, TAB_HEADER = "x-rig-token", "x-rig-tab"
PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "worker-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
FILE_POLICY = (
    "sandbox; default-src 'none'; img-src data:; style-src 'unsafe-inline'; font-src data:; frame-ancestors 'none'"
)
"""Content security policy of a run's files: a browser may only display them."""

_HEADERS = {
    "cache-control": "no-store",
    "content-security-policy": PAGE_POLICY,
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
}
_SHOWS = ("GET", "HEAD")


class Gate:
    """Middleware that checks every request, and sets security headers on every response."""

    def __init__(self, app: ASGIApp, port: int, token: str) -> None:
        self._app, self._token = app, token
        self._hosts = (f"127.0.0.1:{port}", f"localhost:{port}")

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        if scope["type"] != "http":
            return
        problem = self._problem(scope["method"], scope["path"], Headers(scope=scope))
        if problem is None:
            whole = {"headers": [pair for pair in scope["headers"] if pair[0] != b"range"]}
            await self._app({**scope, **whole}, receive, sent)  # No page needs a part of a file.
        else:
            code, words = problem
            await JSONResponse({"ok": False, "problem": words, "code": code}, 403)(scope, receive, sent)

    def _problem(self, method: str, path: str, headers: Headers) -> tuple[str, str] | None:
        """Return the code and the sentence of a refusal, or None."""
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            return "foreign_host", f"host: must be {' or '.join(self._hosts)}"
        own = f"http://{hosts[0].lower()}"
        if method in _SHOWS:
            if origins not in ([], [own]) or not _from_here(headers):
                return "foreign_page", "the request comes from another page; use the panel's own page"
            if path != EVENTS:
                return None
        elif origins != [own]:
            return "foreign_origin", f"origin: must be {own}"
        if not has_token(headers.raw, self._token):
            return "wrong_token", "token: must be the one that rig panel printed; open the address that it printed"
        return None


def has_token(headers: Sequence[tuple[bytes, bytes]], token: str) -> bool:
    """Return whether a request has the token once; headers: pairs with lower-case names."""
    found = [value for name, value in headers if name == TOKEN_HEADER.encode()]
    return len(found) == 1 and secrets.compare_digest(found[0], token.encode())


def _from_here(headers: Headers) -> bool:
    """Return whether the request comes from this page or a followed link, by the headers of the browser."""
    site, mode = headers.get("sec-fetch-site", "none"), headers.get("sec-fetch-mode", "")
    return site in ("none", "same-origin") or mode == "navigate"
