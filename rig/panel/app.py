"""Panel application on loopback: its routes, behind the gate."""

import asyncio
import contextlib
import secrets
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send

from rig.clock import WallClock
from rig.control.client import announced
from rig.control.owner_socket import quick_switches
from rig.panel.access import EVENTS, Gate, has_token
from rig.panel.connections import BACKLOG, MOST_HEADER, Connections, FewLines
from rig.panel.drawing import Drawer
from rig.panel.owners import Find, ManualProcess
from rig.panel.requests import Posts, RequestError
from rig.panel.run_files import RunFiles
from rig.panel.stream import MOST_STREAMS, stream
from rig.panel.watcher import BenchView, Watcher
from rig.plan.config import load_config

STATIC = Path(__file__).parent / "static"


def application(
    watcher: Watcher,
    bench: ManualProcess,
    port: int,
    token: str,
    room_for_stop: Callable[[], AbstractContextManager[None]] = contextlib.nullcontext,
) -> ASGIApp:
    """Return the application; the caller runs the watcher. room_for_stop: frees descriptors for a stop."""
    files = RunFiles(watcher.out)
    routes = [
        Route("/", _page, methods=["GET"]),
        Route(EVENTS, _Events(watcher), methods=["GET"]),
        Route("/runs.json", files.catalogue, methods=["GET"]),
        Route("/runs/{name}/", files.files, methods=["GET"]),
        Route("/runs/{name}/{file}", files.file, methods=["GET"]),
        *Posts(watcher, bench, room_for_stop).routes,
        Mount("/static", StaticFiles(directory=STATIC, check_dir=False)),
    ]
    app = Starlette(routes=routes, exception_handlers={HTTPException: _refused, RequestError: _refused})
    app.router.redirect_slashes = False
    return Gate(app, port, token)


async def _page(request: Request) -> Response:
    return FileResponse(STATIC / "index.html", media_type="text/html")


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


HOST = "127.0.0.1"
_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


@dataclass(frozen=True)
class Offered:
    """Folder of runs, optional configuration of a bench, port (0: any free one)."""

    out: Path
    config: Path | None = None
    port: int = 0


class Panel:
    """Panel server; its `url` exists before it starts, and contains the token in a part that is never logged."""

    def __init__(self, offered: Offered, find: Find = announced) -> None:
        """Bind the port. Raises BadInputError, OSError if the port is taken."""
        config = None if offered.config is None else load_config(offered.config)
        self._socket = _bound(offered.port)
        self.port = int(self._socket.getsockname()[1])
        self._token = secrets.token_urlsafe(32)
        self._bench = ManualProcess(offered.config, find)
        bench = BenchView(offered.config, config)
        self._watcher = Watcher(offered.out.absolute(), bench, find, WallClock())
        self._watcher.last_line = lambda: self._bench.last_line
        self._drawer = Drawer(lambda: self._watcher.job, self._watcher.outlet, self._watcher.clock)
        clock = self._watcher.clock
        connections = Connections(self._socket, lambda headers: has_token(headers, self._token), clock)
        app = application(self._watcher, self._bench, self.port, self._token, connections.room_for_stop)
        self._server = _Server(_quiet(app), connections, self._watcher.outlet.close)
        self._lines = FewLines(clock)

    @property
    def url(self) -> str:
        """Address for the browser; the part after # is not sent to a server."""
        return f"http://{HOST}:{self.port}/#token={self._token}"

    def serve(self) -> None:
        """Serve until Ctrl-C, another terminating signal, or `end`; manual control then ends."""
        try:
            with (
                quick_switches(),
                self._lines.filtering(),
                contextlib.suppress(KeyboardInterrupt),  # Signals may not reach the loop.
                asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner,  # Others cannot watch a socket.
            ):
                runner.run(self._serve())
        finally:
            self._socket.close()
            self._drawer.close()
            self._bench.leave()
            self._bench.forget()

    def end(self) -> None:
        """End the server; may be called from any thread."""
        self._server.should_exit = True

    async def _serve(self) -> None:
        """Serve, and raise the first failure."""
        self._end_at_signals()
        serving = asyncio.create_task(self._server.serve(sockets=[]))
        polling = [asyncio.create_task(one.follow()) for one in (self._watcher, self._drawer)]
        await asyncio.wait([serving, *polling], return_when=asyncio.FIRST_COMPLETED)
        self._server.should_exit = True
        await serving
        for task in polling:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    def _end_at_signals(self) -> None:
        for number in _SIGNALS:
            with contextlib.suppress(NotImplementedError, RuntimeError, ValueError):  # outside of the main thread
                asyncio.get_running_loop().add_signal_handler(number, self.end)


class _Server(uvicorn.Server):
    """Server that leaves signals and connections to the panel, and closes the endless streams at its end."""

    def __init__(self, config: uvicorn.Config, connections: Connections, close: Callable[[], None]) -> None:
        super().__init__(config)
        self._connections, self._close = connections, close

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals alone."""
        yield

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start without a listener, and serve the panel's connections."""
        await super().startup(sockets)
        state = {"server_state": self.server_state, "app_state": self.lifespan.state}
        self._connections.begin(config=self.config, **state)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Close the streams, and shut down."""
        self._connections.close()
        self._close()
        await super().shutdown(sockets)


def _quiet(app: object) -> uvicorn.Config:
    """Disable access logs and the server header."""
    return uvicorn.Config(
        app,  # type: ignore[arg-type]
        loop="asyncio",
        http="h11",
        ws="none",
        lifespan="off",
        access_log=False,
        log_config=None,
        proxy_headers=False,
        server_header=False,
        h11_max_incomplete_event_size=MOST_HEADER,
        timeout_graceful_shutdown=2,
    )


def _bound(port: int) -> socket.socket:
    """Return a listening socket. Raises OSError, which names the port."""
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((HOST, port))
        found.listen(BACKLOG)
    except OSError as error:
        found.close()
        raise OSError(error.errno, error.strerror, f"{HOST}:{port}") from None
    return found
