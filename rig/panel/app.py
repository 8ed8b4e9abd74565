"""Panel application on loopback: its routes, behind the gate."""

import asyncio
import contextlib
import secrets
import signal
import socket
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send

from rig.clock import WallClock
from rig.control.client import announced
from rig.control.owner_socket import quick_switches
from rig.panel.access import EVENTS, Address, Gate
from rig.panel.owners import Find, ManualProcess
from rig.panel.requests import Posts, RequestError
from rig.panel.run_files import RunFiles
from rig.panel.section import Sections
from rig.panel.server import HOST, Once, Reserve, Server, bound
from rig.panel.stops import Stops
from rig.panel.stream import MOST_STREAMS, stream
from rig.panel.watcher import BenchView, Watcher
from rig.plan.config import load_config

STATIC = Path(__file__).parent / "static"


def applications(
    watcher: Watcher,
    bench: ManualProcess,
    address: Address,
    room_for_stop: Callable[[], AbstractContextManager[None]] = contextlib.nullcontext,
) -> tuple[ASGIApp, ASGIApp]:
    """Return the application of the page and that of STOP; the caller runs the watcher.

    room_for_stop: frees descriptors for a stop. The page's own port takes a stop, too.
    """
    files, posts = RunFiles(watcher.out), Posts(watcher, bench, Stops(watcher, room_for_stop))
    page = (STATIC / "index.html").read_text("utf-8").replace("{STOP PORT}", str(address.stop_port))

    async def show(request: Request) -> Response:
        return HTMLResponse(page)

    routes: list[BaseRoute] = [
        Route("/", show, methods=["GET"]),
        Route(EVENTS, _Events(watcher), methods=["GET"]),
        Route("/runs.json", files.catalogue, methods=["GET"]),
        Route("/runs/{name}/report.html", files.report, methods=["GET"]),
        *posts.routes,
        Mount("/static", StaticFiles(directory=STATIC, check_dir=False)),
    ]
    alone: list[BaseRoute] = [posts.stop, Route("/stop", _kept_open, methods=["HEAD"])]
    return Gate(_app(routes), address), Gate(_app(alone), address, for_stop=True)


def _app(routes: list[BaseRoute]) -> ASGIApp:
    app = Starlette(routes=routes, exception_handlers={HTTPException: _refused, RequestError: _refused})
    app.router.redirect_slashes = False
    return app


async def _kept_open(request: Request) -> Response:
    """Answer a page that keeps a connection open, so that STOP needs no new one."""
    return Response()


async def _refused(request: Request, error: Exception) -> Response:
    if isinstance(error, RequestError):
        return JSONResponse({"ok": False, "problem": str(error), "code": error.code}, error.status)
    assert isinstance(error, HTTPException)
    answer = {"ok": False, "problem": error.detail, "code": HTTPStatus(error.status_code).name.lower()}
    return JSONResponse(answer, error.status_code, error.headers)


class _Events:
    """Handler of GET /events?tab=NAME: server-sent events."""

    def __init__(self, watcher: Watcher) -> None:
        self._watcher = watcher

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        outlet, tabs, clock = self._watcher.outlet, self._watcher.tabs, self._watcher.clock
        tab = Request(scope).query_params.get("tab", "")[:64]
        if scope["method"] == "HEAD":
            await Response()(scope, receive, send)
            return
        if outlet.full:
            words = f"{MOST_STREAMS} pages already monitor the rig; close one of them"
            await PlainTextResponse(words, 503)(scope, receive, send)
            return
        tabs.opened(tab)
        try:
            with outlet.joined() as client:
                await stream(outlet, client, receive, send, clock.unix_s)
        finally:
            tabs.closed(tab, clock.monotonic_s())


_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


@dataclass(frozen=True)
class Offered:
    """Folder of runs, optional configuration of a bench, port (0: any free one)."""

    out: Path
    config: Path | None = None
    port: int = 0


class Panel:
    """Panel server; its `url` exists before it starts, and contains the token in a part that is never logged.

    STOP has a port, a thread and a loop of its own, so that nothing that the page loads holds it up.
    """

    def __init__(self, offered: Offered, find: Find = announced) -> None:
        """Bind the ports. Raises BadInputError, OSError if the port is taken."""
        config = None if offered.config is None else load_config(offered.config)
        self._sockets = _both(offered.port)
        self.port, self.stop_port = (int(one.getsockname()[1]) for one in self._sockets)
        self._address = Address(self.port, self.stop_port, secrets.token_urlsafe(32))
        self._bench = ManualProcess(offered.config, find)
        self._reserve = Reserve()
        bench = BenchView(offered.config, config)
        self._watcher = Watcher(offered.out.absolute(), bench, find, WallClock())
        self._watcher.last_line = lambda: self._bench.last_line
        self._sections = Sections(lambda: self._watcher.job, self._watcher.outlet, self._watcher.clock)
        apps = applications(self._watcher, self._bench, self._address, self._reserve.freed)
        self._server, self._stop_server = (
            Server(app, listener, self._address.has_token, self._reserve)
            for app, listener in zip(apps, self._sockets, strict=True)
        )

    @property
    def url(self) -> str:
        """Address for the browser; the part after # is not sent to a server."""
        return f"http://{HOST}:{self.port}/#token={self._address.token}"

    def serve(self) -> None:
        """Serve until Ctrl-C, another terminating signal, or `end`; manual control then ends."""
        stops = threading.Thread(target=lambda: asyncio.run(self._stop_server.run_here()), name="stop port")
        try:
            with (
                quick_switches(),
                Once().filtering(),
                contextlib.suppress(KeyboardInterrupt),  # Signals may not reach the loop.
            ):
                self._reserve.fill()
                stops.start()
                asyncio.run(self._serve())
        finally:
            self._stop_server.should_exit = True
            stops.join()
            for one in self._sockets:
                one.close()
            self._reserve.close()
            self._bench.leave()
            self._bench.forget()

    def end(self) -> None:
        """End the server; may be called from any thread."""
        self._watcher.outlet.closed = True  # The streams have no end of their own.
        self._server.should_exit = True

    async def _serve(self) -> None:
        """Serve, and raise the first failure."""
        for number in _SIGNALS:
            with contextlib.suppress(NotImplementedError, RuntimeError, ValueError):  # outside of the main thread
                asyncio.get_running_loop().add_signal_handler(number, self.end)
        serving = asyncio.create_task(self._server.run_here())
        polling = [asyncio.create_task(one.follow()) for one in (self._watcher, self._sections)]
        await asyncio.wait([serving, *polling], return_when=asyncio.FIRST_COMPLETED)
        self.end()
        self._watcher.outlet.close()
        await serving
        for task in polling:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task


def _both(port: int) -> tuple[socket.socket, socket.socket]:
    """Return the sockets of the page and of STOP: the next port, or any free one if that is taken. Raises OSError."""
    first = bound(port)
    try:
        return first, bound(first.getsockname()[1] + 1)
    except (OSError, OverflowError):
        return first, bound(0)
