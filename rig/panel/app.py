"""The panel as an application: its routes behind its gate."""

from http import HTTPStatus
from pathlib import Path

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send

from rig.panel.asked import RequestError
from rig.panel.by_hand_process import ByHandProcess
from rig.panel.gate import Gate
from rig.panel.outlet import MOST_STREAMS, stream
from rig.panel.posts import Posts
from rig.panel.run_files import RunFiles
from rig.panel.watcher import Watcher

STATIC = Path(__file__).parent / "static"


def application(watcher: Watcher, bench: ByHandProcess, port: int, token: str) -> ASGIApp:
    """Everything that is served; the watcher is looked after elsewhere."""
    files = RunFiles(watcher.out)
    routes = [
        Route("/", _page, methods=["GET"]),
        Route("/events", _Events(watcher), methods=["GET"]),
        Route("/runs.json", files.catalogue, methods=["GET"]),
        Route("/runs/{name}/", files.files, methods=["GET"]),
        Route("/runs/{name}/{file}", files.file, methods=["GET"]),
        *Posts(watcher, bench).routes,
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
    told = {"ok": False, "problem": error.detail, "code": HTTPStatus(error.status_code).name.lower()}
    return JSONResponse(told, error.status_code, error.headers)


class _Events:
    """GET /events?tab=NAME: all that happens, as server-sent events."""

    def __init__(self, watcher: Watcher) -> None:
        self._watcher = watcher

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        outlet, tabs, clock = self._watcher.outlet, self._watcher.tabs, self._watcher.clock
        tab = Request(scope).query_params.get("tab", "")[:64]
        if scope["method"] == "HEAD":
            await Response()(scope, receive, send)
            return
        if outlet.full:
            words = f"{MOST_STREAMS} pages look on already: close one of them"
            await PlainTextResponse(words, 503)(scope, receive, send)
            return
        tabs.opened(tab)
        try:
            with outlet.joined() as client:
                await stream(outlet, client, receive, send, clock.unix_s)
        finally:
            tabs.closed(tab, clock.monotonic_s())
