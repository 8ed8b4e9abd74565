"""Requests of a page: what each may contain, who may send it, and who carries it out."""

import asyncio
import json
from collections.abc import Awaitable, Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from rig.control.client import ControlError, RefusedError
from rig.errors import RigError, first_problem
from rig.manual.session import SIZES_MM
from rig.panel.access import TAB_HEADER
from rig.panel.owners import ManualProcess, NoOwnerError, NotTakenError, ask_owner
from rig.panel.stops import Stops
from rig.panel.watcher import Watcher

MOST_BYTES = 4096
FRESH_S = 0.5
"""Age from which a click no longer counts (s)."""
_ANSWER_S = 1.0
_AT_ONCE = 4
_LARGEST_WHOLE = 2**53 - 1
_STATUS = {"no_such_file": 404, "body_too_large": 413, "content_type": 415}


class RequestError(RigError):
    """Error of an invalid request, or of one for a missing run or file."""

    default_code = "bad_request"

    @property
    def status(self) -> int:
        """HTTP status."""
        return _STATUS.get(self.code, 400)


class Body(BaseModel):
    """Body of a request that says all by its path."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class StopBody(Body):
    """STOP; press: its number in the tab, the same for all repeats of one press."""

    press: int | None = None


class ZeroBody(Body):
    """Zero; anyway: without a check."""

    anyway: bool = False


class StepBody(Body):
    """Click of a direction, with its time by the page."""

    axis: Literal["x", "y", "z"]
    sign: Literal[-1, 1]
    by_mm: float
    unix_s: float = Field(ge=-1e12, le=1e12)

    @field_validator("sign", mode="before")
    @classmethod
    def _whole(cls, sign: object) -> object:
        if type(sign) is not int:
            raise ValueError("must be 1 or -1")
        return sign

    @field_validator("by_mm")
    @classmethod
    def _offered(cls, by_mm: float) -> float:
        if by_mm not in SIZES_MM:
            raise ValueError(f"must be one of {', '.join(f'{mm:g}' for mm in SIZES_MM)}")
        return by_mm


_B = TypeVar("_B", bound=Body)


async def validated(kind: type[_B], request: Request) -> _B:
    """Return the body of a request. Raises RequestError."""
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise RequestError("content-type: must be application/json", "content_type")
    too_large = RequestError(f"body: at most {MOST_BYTES} bytes are allowed", "body_too_large")
    if whole_of_text("content-length", request.headers.getlist("content-length") or ["0"]) > MOST_BYTES:
        raise too_large
    found = bytearray()
    try:
        async for piece in request.stream():
            found += piece
            if len(found) > MOST_BYTES:
                raise too_large
        document = json.loads(found, object_pairs_hook=_each_once)
        if not isinstance(document, dict):
            raise ValueError
    except (ClientDisconnect, ValueError, RecursionError):
        raise RequestError("body: must be a JSON object with each key once", "no_json_object") from None
    try:
        return kind.model_validate(document)
    except ValidationError as error:
        problem = first_problem("body", error)
        raise RequestError(str(problem), problem.code) from None


def _each_once(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    if len(dict(pairs)) < len(pairs):
        raise ValueError("a key is repeated")
    return dict(pairs)


def whole_of_text(name: str, texts: Sequence[str]) -> int:
    """Return a whole number from 0, which a query or a header contains once. Raises RequestError."""
    text = "".join(texts)
    if len(texts) != 1 or not (text.isascii() and text.isdecimal()) or len(text) > len(str(_LARGEST_WHOLE)):
        raise RequestError(f"{name}: must be one whole number", "not_a_number")
    return int(text)


Answer = Mapping[str, Any]
Action = Callable[[str, _B], Awaitable[Answer]]
"""Carries out a request of a tab."""


class Posts:
    """Handlers of the requests that change something; all but STOP and taking control need control."""

    def __init__(self, watcher: Watcher, bench: ManualProcess, stops: Stops) -> None:
        self._watcher, self._bench = watcher, bench
        self._pool, self._pending = ThreadPoolExecutor(_AT_ONCE, "post"), 0
        self.stop = _route("/stop", StopBody, lambda tab, body: stops.stop(tab, body.press))

    @property
    def routes(self) -> list[Route]:
        """Routes of all requests."""
        return [
            self.stop,
            _route("/take", Body, self._take),
            _route("/by_hand", Body, self._in_control(self._take_the_bench)),
            _route("/leave", Body, self._in_control(self._leave)),
            _route("/step", StepBody, self._in_control(self._step)),
            _route("/zero", ZeroBody, self._in_control(lambda _, body: self._ask("zero", anyway=body.anyway))),
            *(_route(f"/{do}", Body, self._in_control(partial(self._plain, do))) for do in ("home", "park")),
            *(_route(f"/{do}", Body, self._in_control(partial(self._plain, do))) for do in ("pause", "go_on")),
        ]

    def _in_control(self, do: Action[_B]) -> Action[_B]:
        """Allow a request only from the tab that has control."""

        async def done(tab: str, body: _B) -> Answer:
            if not self._watcher.tabs.may(tab, self._watcher.clock.monotonic_s()):
                raise NoOwnerError("another tab has control; take control first", "another_tab")
            return await do(tab, body)

        return done

    async def _take(self, tab: str, body: Body) -> Answer:
        self._watcher.tabs.take(tab, self._watcher.clock.monotonic_s())
        return {}

    async def _take_the_bench(self, tab: str, body: Body) -> Answer:
        if not self._watcher.bench.configured:
            raise NoOwnerError("no configuration; restart rig panel with --config", "no_bench")
        ports = set(self._watcher.bench.ports)
        for owner in self._watcher.owners:
            if owner.kind == "run" and ports & set(owner.ports):
                raise NoOwnerError(f"a run owns the ports (process {owner.pid}); end it first", "ports_taken")
        await self._bench.take()
        return {}

    async def _leave(self, tab: str, body: Body) -> Answer:
        answer = await self._ask("leave")
        await self._bench.ended()
        return answer

    async def _step(self, tab: str, body: StepBody) -> Answer:
        """Pass a click on while it is fresh, so that no delayed request moves the stage."""
        if abs(self._watcher.clock.unix_s() - body.unix_s) > FRESH_S:
            raise NoOwnerError(
                f"the click is older than {FRESH_S:g} s, or from another clock; click again", "too_old"
            )
        return await self._ask("step", tab=tab, axis=body.axis, sign=body.sign, by_mm=body.by_mm)

    async def _plain(self, do: str, tab: str, body: Body) -> Answer:
        return await self._ask(do)

    async def _ask(self, do: str, **more: Any) -> Answer:
        """Return the reply of the shown owner. Raises ControlError if too many requests are pending."""
        if self._pending >= _AT_ONCE:
            raise ControlError("the previous request is still pending; wait for its answer", "busy")
        ask = partial(ask_owner, self._watcher.owner, do, _ANSWER_S, **more)
        self._pending += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(self._pool, ask)
        finally:
            self._pending -= 1


def _route(path: str, kind: type[_B], do: Action[_B]) -> Route:
    async def answered(request: Request) -> Response:
        body, tab = await validated(kind, request), request.headers.get(TAB_HEADER, "")
        if not (0 < len(tab) <= 64 and tab.isascii() and tab.isprintable()):
            raise RequestError(f"{TAB_HEADER}: must be the name of the tab", "no_tab")
        try:
            return JSONResponse({"ok": True, "problem": None, **await do(tab, body)})
        except (NoOwnerError, ControlError, NotTakenError) as error:
            status = 409 if isinstance(error, NoOwnerError | RefusedError) else 503
            return JSONResponse({"ok": False, "problem": str(error), "code": error.code}, status)

    return Route(path, answered, methods=["POST"])
