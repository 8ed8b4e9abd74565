"""Runs below one folder, and their files."""

import asyncio
import mimetypes
import stat
from collections.abc import AsyncGenerator, Mapping
from contextlib import aclosing
from dataclasses import asdict
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.types import Send

from rig.data.index import RunFilter, listed
from rig.panel.access import FILE_POLICY
from rig.panel.requests import RequestError, whole_of_text
from rig_shared.errors import code_of
from sim.contact.shapes import ShapeError, shape_filter

_AS_TEXT = (".csv", ".jsonl", ".log", ".md", ".py", ".toml", ".txt", "SHA256SUMS")
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

    async def files(self, request: Request) -> Response:
        """Handle GET /runs/NAME/: the files of a run."""
        folder = await asyncio.to_thread(self._folder, request.path_params["name"])
        return JSONResponse({"files": await asyncio.to_thread(_files, folder)})

    async def file(self, request: Request) -> Response:
        """Handle GET /runs/NAME/FILE: the file at its present length, with a policy that allows nothing."""
        folder = await asyncio.to_thread(self._folder, request.path_params["name"])
        path = await asyncio.to_thread(_plain_file, folder, request.path_params["file"])
        size = path.stat().st_size
        headers = {"content-length": str(size), "content-security-policy": FILE_POLICY}
        body = _pieces(path, size if request.method == "GET" else 0)
        return _Closing(body, media_type=_type_of(path), headers=headers)

    def _folder(self, name: str) -> Path:
        """Return the folder of a run, not a link. Raises RequestError."""
        path = self._out / name
        if not _named(name) or path.is_symlink() or not path.is_dir():
            raise RequestError("there is no such run", "no_such_run")
        return path


def _no_runs(problem: str, code: str) -> dict[str, Any]:
    return {"runs": [], "unreadable": [], "problem": problem, "code": code}


class _Closing(StreamingResponse):
    """Response that closes its file when the client leaves."""

    async def stream_response(self, send: Send) -> None:
        """Send the body, and close it in any case."""
        assert isinstance(self.body_iterator, AsyncGenerator)
        async with aclosing(self.body_iterator):
            await super().stream_response(send)


def _named(name: str) -> bool:
    """Return whether it is the name of a visible file in a folder."""
    return bool(name) and not name.startswith(".") and not set(name) & {"/", "\\", "\0", ":"}


def _plain_file(folder: Path, name: str) -> Path:
    """Return a regular file in a folder, not a link. Raises RequestError."""
    path = folder / name
    try:
        is_file = _named(name) and stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        is_file = False
    if not is_file:
        raise RequestError("there is no such file", "no_such_file")
    return path


def _files(folder: Path) -> list[Mapping[str, Any]]:
    found = sorted(path for path in folder.iterdir() if _named(path.name) and stat.S_ISREG(path.lstat().st_mode))
    return [{"name": path.name, "bytes": path.stat().st_size} for path in found]


def _type_of(path: Path) -> str:
    if path.name.endswith(_AS_TEXT):
        return "text/plain; charset=utf-8"
    return mimetypes.guess_type(path.name)[0] or "application/octet-stream"


async def _pieces(path: Path, size: int) -> AsyncGenerator[bytes, None]:
    """Yield a number of bytes; a journal may grow meanwhile."""
    with await asyncio.to_thread(path.open, "rb") as file:
        while size > 0 and (piece := await asyncio.to_thread(file.read, min(size, _CHUNK))):
            size -= len(piece)
            yield piece
