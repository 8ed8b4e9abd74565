"""POST requests of a page, strictly validated: stop, pause, continue, manual control."""

import asyncio
import json
import threading
from collections.abc import Awaitable, Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, suppress
from functools import partial
from typing import Any, Literal, NamedTuple, TypeVar

from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from rig.control.client import ControlError, RefusedError
from rig.control.stop import BESIDE_S, SentStop, send_stop
from rig.devices.registry import stage_ports
from rig.errors import RigError
from rig.manual.session import SIZES_MM
from rig.panel.access import TAB_HEADER
from rig.panel.owners import (
    ManualProcess,
    NoOwnerError,
    NotTakenError,
    Owner,
    SentStops,
    ask_owner,
    post_stop,
    stop_all,
)
from rig.panel.watcher import Watcher
from rig.settings import BenchSettings

MOST_BYTES = 4096
_LARGEST, _LARGEST_WHOLE = 1e12, 2**53 - 1
_SIGNS = (-1, 1)
_AXES = ("x", "y", "z")
_STATUS = {"no_such_run": 404, "no_such_file": 404, "body_too_large": 413, "content_type": 415}


class RequestError(RigError):
    """Error of an invalid request, or of one for a missing run or file."""

    default_code = "bad_request"

    @property
    def status(self) -> int:
        """HTTP status."""
        return _STATUS.get(self.code, 400)


async def body_of(request: Request) -> dict[str, Any]:
    """Return the JSON object of a request. Raises RequestError."""
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise RequestError("content-type: must be application/json", "content_type")
    too_large = RequestError(f"body: at most {MOST_BYTES} bytes are allowed", "body_too_large")
    if whole_of_text("content-length", request.headers.getlist("content-length") or ["0"]) > MOST_BYTES:
        raise too_large
    found = bytearray()
    no_object = RequestError("body: must be a JSON object with each key once", "no_json_object")
    try:
        async for piece in request.stream():
            found += piece
            if len(found) > MOST_BYTES:
                raise too_large
        document = json.loads(found, parse_constant=_no_number, object_pairs_hook=_each_once)
    except (ClientDisconnect, ValueError, RecursionError):
        raise no_object from None
    if not isinstance(document, dict):
        raise no_object
    return document


def _no_number(name: str) -> float:
    raise ValueError(name)


def _each_once(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object. Raises ValueError if a key is repeated."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key is repeated")
    return found


def _not_understood(code: str, key: str, expected: str) -> RequestError:
    return RequestError(f"{key}: must be {expected}", code)


class StepButton(NamedTuple):
    """Click of a direction: axis, sign, size of the step, and time by the page."""

    axis: Literal["x", "y", "z"]
    sign: Literal[-1, 1]
    by_mm: float
    unix_s: float

    @classmethod
    def of(cls, body: Mapping[str, Any]) -> "StepButton":
        """Validate a request. Raises RequestError."""
        axis, sign = body.get("axis"), body.get("sign")
        if axis not in _AXES:
            raise _not_understood("unknown_choice", "axis", "x, y or z")
        if type(sign) is not int or sign not in _SIGNS:
            raise _not_understood("unknown_choice", "sign", "1 or -1")
        by_mm = number("by_mm", body)
        if by_mm not in SIZES_MM:
            raise _not_understood("unknown_choice", "by_mm", f"one of {', '.join(f'{mm:g}' for mm in SIZES_MM)}")
        return cls(axis, sign, by_mm, number("unix_s", body))  # type: ignore[arg-type]


def number(name: str, body: Mapping[str, Any]) -> float:
    """Return a finite number. Raises RequestError."""
    found = body.get(name)
    if isinstance(found, bool) or not isinstance(found, int | float) or not abs(found) <= _LARGEST:
        raise _not_understood("not_a_number", name, "a number")
    return float(found)


def whole_of_text(name: str, texts: Sequence[str]) -> int:
    """Return a whole number from 0, which a query or a header contains once. Raises RequestError."""
    text = "".join(texts)
    if len(texts) != 1 or not (text.isascii() and text.isdecimal()) or len(text) > len(str(_LARGEST_WHOLE)):
        raise _not_understood("not_a_number", name, "one whole number")
    return int(text)


def flag(name: str, body: Mapping[str, Any]) -> bool:
    """Return a Boolean, false by default. Raises RequestError."""
    found = body.get(name, False)
    if type(found) is not bool:
        raise _not_understood("not_a_flag", name, "true or false")
    return found


Answer = TypeVar("Answer")
First = TypeVar("First")


class BoundedPool:
    """Thread pool that rejects work when all threads are busy."""

    def __init__(self, threads: int, name: str, problem: str, code: str = "busy") -> None:
        """Prepare the pool. problem, code: reply while all threads are busy."""
        self._pool, self._problem, self._code = ThreadPoolExecutor(threads, name), problem, code
        self._idle = threading.Semaphore(threads)

    def begin(self, do: Callable[[], Answer]) -> "asyncio.Future[Answer]":
        """Run a function in a thread. Raises ControlError."""
        return self.begin_behind(lambda: None, lambda _: do())

    def begin_behind(self, first: Callable[[], First], do: Callable[[First], Answer]) -> "asyncio.Future[Answer]":
        """Call `first` in this thread at once, and pass its result to `do` in another one, which may have to wait.

        Raises ControlError, and then calls neither.
        """
        if not self._idle.acquire(blocking=False):
            raise ControlError(self._problem, self._code)
        try:
            begun = self._pool.submit(do, first())
        except BaseException:
            self._idle.release()
            raise
        begun.add_done_callback(lambda _: self._idle.release())
        return asyncio.wrap_future(begun)


Body = Mapping[str, Any]
PostAnswer = Mapping[str, Any]
Action = Callable[[Body], Awaitable[PostAnswer]]

FRESH_S = 0.5
"""Age from which a click no longer counts (s)."""
_ANSWER_S, _STOP_S = 1.0, 0.25
_THREADS, _MOST_STOPS = 4, 16
_NOT_YET = "stop sent, no answer yet: use the emergency stop"
_NOT_YET_CODE = "not_answered_yet"


async def answered(do: Callable[[str, Body], Awaitable[PostAnswer]], request: Request) -> Response:
    """Return the response to a valid request of a tab."""
    body, tab = await body_of(request), request.headers.get(TAB_HEADER, "")
    if not (0 < len(tab) <= 64 and tab.isascii() and tab.isprintable()):
        raise RequestError(f"{TAB_HEADER}: must be the name of the tab", "no_tab")
    try:
        return JSONResponse({"ok": True, "problem": None, **await do(tab, body)})
    except (NoOwnerError, ControlError, NotTakenError) as error:
        status = 409 if isinstance(error, NoOwnerError | RefusedError) else 503
        return JSONResponse({"ok": False, "problem": str(error), "code": error.code}, status)


class Stops:
    """Handler of STOP, which any tab may request, on the page's port and on its own."""

    def __init__(self, watcher: Watcher, room_for_stop: Callable[[], AbstractContextManager[None]]) -> None:
        self._watcher, self._room_for_stop = watcher, room_for_stop
        self._stopping = BoundedPool(_MOST_STOPS, "stop", _NOT_YET, _NOT_YET_CODE)
        self._each = ThreadPoolExecutor(64, "stopped")
        self.route = Route("/stop", partial(answered, self._stop), methods=["POST"])

    async def _stop(self, tab: str, body: Body) -> PostAnswer:
        """Send the stop at once, in this thread, to every known owner.

        Other threads find new owners and wait briefly for the replies.
        """
        with self._room_for_stop():
            asking = self._stopping.begin_behind(lambda: post_stop(self._watcher.owners), self._stop_all)
            done, _ = await asyncio.wait({asking}, timeout=_STOP_S)
        if not done:
            raise ControlError(_NOT_YET, _NOT_YET_CODE)
        answer = asking.result()
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _stop_all(self, stops: SentStops) -> PostAnswer | NoOwnerError | ControlError:
        """Return the result of a stop; a failure is also returned, since the page may have gone."""
        try:
            owners = self._watcher.find()
        except OSError:
            owners = self._watcher.owners
        settings, confirmed = self._watcher.bench.settings, threading.Event()
        sent = None if settings is None else self._each.submit(_sent_without_owner, settings, owners, confirmed)
        try:
            return stop_all(owners, stops, self._each)
        except RefusedError as error:
            return error
        except (NoOwnerError, ControlError) as error:
            confirmed.set()
            if settings is None or sent is None:
                return error
            stop = sent.result() or send_stop(settings)
            if stop.done:
                return {"stopped": list(stop.notified), "words": stop.words}
            words = stop.words if isinstance(error, NoOwnerError) else f"{error}. {stop.words}"
            return ControlError(words, "not_confirmed" if stop.sent else "not_sent")
        finally:
            confirmed.set()


def _sent_without_owner(
    settings: BenchSettings, owners: Sequence[Owner], confirmed: threading.Event
) -> SentStop | None:
    """Send the stop directly to the drives if no owner responds at once; None if one does."""
    if owners and confirmed.wait(BESIDE_S):
        return None
    of_the_bench = [one for one in owners if set(one.ports) & set(stage_ports(settings.stage))]
    for one in of_the_bench or owners:
        with suppress(ControlError):
            one.ask("status", within_s=BESIDE_S)
            return None
    return send_stop(settings)


class Posts:
    """Handlers of the other requests that change something; all but taking control need it."""

    def __init__(self, watcher: Watcher, bench: ManualProcess) -> None:
        self._watcher, self._bench = watcher, bench
        self._asking = BoundedPool(_THREADS, "post", "the previous request is still pending; wait for its answer")

    @property
    def routes(self) -> list[Route]:
        """Routes of all requests."""
        actions: dict[str, Action] = {
            "pause": lambda body: self._reply_of("run", "pause"),
            "go_on": lambda body: self._reply_of("run", "go_on"),
            "by_hand": self._take_the_bench,
            "leave": self._leave,
            "home": lambda body: self._reply_of("by hand", "home"),
            "zero": lambda body: self._reply_of("by hand", "zero", anyway=flag("anyway", body)),
            "park": lambda body: self._reply_of("by hand", "park"),
            "step": self._step,
        }
        handlers = {"take": self._take} | {name: self._in_control(do) for name, do in actions.items()}
        return [Route(f"/{name}", partial(answered, do), methods=["POST"]) for name, do in handlers.items()]

    def _in_control(self, do: Action) -> Callable[[str, Body], Awaitable[PostAnswer]]:
        """Allow a request only from the tab that has control."""

        async def done(tab: str, body: Body) -> PostAnswer:
            if not self._watcher.tabs.may(tab, self._watcher.clock.monotonic_s()):
                raise NoOwnerError("another tab has control; take control first", "another_tab")
            return await do({**body, "tab": tab})

        return done

    async def _take(self, tab: str, body: Body) -> PostAnswer:
        self._watcher.tabs.take(tab, self._watcher.clock.monotonic_s())
        return {}

    async def _take_the_bench(self, body: Body) -> PostAnswer:
        if not self._watcher.bench.configured:
            raise NoOwnerError("no configuration; restart rig panel with --config", "no_bench")
        ports = set(self._watcher.bench.ports)
        for owner in self._watcher.owners:
            if owner.kind == "run" and ports & set(owner.ports):
                raise NoOwnerError(f"a run owns the ports (process {owner.pid}); end it first", "ports_taken")
        await self._bench.take()
        return {}

    async def _leave(self, body: Body) -> PostAnswer:
        answer = await self._reply_of("by hand", "leave")
        await self._bench.ended()
        return answer

    async def _step(self, body: Body) -> PostAnswer:
        """Pass a click on while it is fresh, so that no delayed request moves the stage."""
        button = StepButton.of(body)
        if abs(self._watcher.clock.unix_s() - button.unix_s) > FRESH_S:
            raise NoOwnerError(
                f"the click is older than {FRESH_S:g} s, or from another clock; click again", "too_old"
            )
        what = {"axis": button.axis, "sign": button.sign, "by_mm": button.by_mm}
        return await self._reply_of("by hand", "step", tab=body["tab"], **what)

    def _reply_of(self, kind: str, do: str, **more: Any) -> Awaitable[PostAnswer]:
        """Return the reply of the shown owner. Raises ControlError if too many requests are pending."""
        return self._asking.begin(partial(ask_owner, self._watcher.owner, kind, do, _ANSWER_S, **more))
