"""Runs below one folder, and their reports."""

import asyncio
import stat
from collections.abc import AsyncGenerator
from contextlib import aclosing
from dataclasses import asdict
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.types import Send

from rig.data.folder import RunFolder
from rig.data.index import RunFilter, listed
from rig.panel.access import FILE_POLICY
from rig.panel.requests import RequestError, whole_of_text
from rig_shared.errors import code_of
from sim.contact.shapes import ShapeError, shape_filter

_CHUNK = 1 << 16
_MOST_RUNS = 500
_FILTERS = ("subject", "shape", "protocol", "state")


class RunFiles:
    """Run folders below `rig panel --out`."""

    def __init__(self, out: Path) -> None:
        self._out = out

    async def catalogue(self, request: Request) -> Response:
        """Handle GET /runs.json: the newest first, filtered by subject, shape, protocol and state; limit."""
        query = request.query_params
        limit = whole_of_text("limit", query.getlist("limit") or [str(_MOST_RUNS)])
        subject, shape, protocol, state = (query.get(name) or None for name in _FILTERS)
        try:
            run_filter = RunFilter(subject, None if shape is None else shape_filter(shape), protocol, state)
        except ShapeError as error:  # perhaps half typed
            return JSONResponse(_no_runs(str(error), error.code))
        return JSONResponse(await asyncio.to_thread(self._catalogue, run_filter, limit))

    def _catalogue(self, run_filter: RunFilter, limit: int) -> dict[str, Any]:
        try:
            entries = [one.summary for one in listed(self._out)]
        except OSError as error:
            return _no_runs(f"{self._out}: {error.strerror}", code_of(error))
        found = [one for one in entries if not one.problem and run_filter.has(one)]
        runs = [{name: value for name, value in asdict(one).items() if name != "problem"} for one in reversed(found)]
        broken = [{"name": one.name, "problem": one.problem} for one in entries if one.problem]
        return {"runs": runs[:limit], "of": len(runs), "unreadable": broken, "problem": None}

    async def report(self, request: Request) -> Response:
        """Handle GET /runs/NAME/report.html, with a policy that allows no script. Links are not followed."""
        name = request.path_params["name"]
        path = RunFolder(self._out / name).report
        try:
            if set(name) & {"/", "\\", "\0", ":"} or name.startswith(".") or path.parent.is_symlink():
                raise FileNotFoundError
            about = path.lstat()
            if not stat.S_ISREG(about.st_mode):
                raise FileNotFoundError
        except OSError:
            raise RequestError("there is no such report", "no_such_file") from None
        headers = {"content-length": str(about.st_size), "content-security-policy": FILE_POLICY}
        body = _pieces(path, about.st_size if request.method == "GET" else 0)
        return _Closing(body, media_type="text/html; charset=utf-8", headers=headers)


def _no_runs(problem: str, code: str) -> dict[str, Any]:
    return {"runs": [], "unreadable": [], "problem": problem, "code": code}


class _Closing(StreamingResponse):
    """Response that closes its file when the client leaves."""

    async def stream_response(self, send: Send) -> None:
        """Send the body, and close it in any case."""
        assert isinstance(self.body_iterator, AsyncGenerator)
        async with aclosing(self.body_iterator):
            await super().stream_response(send)


async def _pieces(path: Path, size: int) -> AsyncGenerator[bytes, None]:
    """Yield a number of bytes, while the file may be replaced."""
    with await asyncio.to_thread(path.open, "rb") as file:
        while size > 0 and (piece := await asyncio.to_thread(file.read, min(size, _CHUNK))):
            size -= len(piece)
            yield piece
