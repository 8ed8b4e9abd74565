"""Finger in a separate process, for a parent that must never solve; requests are functions of the finger."""

import contextlib
import logging
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar, Union

from sim.config import FingertipConfig
from sim.errors import SimError
from sim.workers import TO_THE_GROUP, give_way, keep_freed_memory, leaving_signals_to_us

if TYPE_CHECKING:
    from sim.models.fingertip import Fingertip  # the parent does not need the solver

P = ParamSpec("P")
T = TypeVar("T")
Finger = Union["Fingertip", "FingerProcess"]

_MODELS = logging.getLogger("sim")
_END_S = 5.0
_GIVES_WAY = 5
"""Nice value of the process, so that it yields to its parent and to a program that requests a stop."""


class FingerLostError(SimError, RuntimeError):
    """Error of a finger process that ended before it answered."""

    default_code = "finger_lost"
    remedy = "check whether the computer ran out of memory, then resume"


class FingerProcess:
    """Process that evaluates importable functions of the finger, in order; close() it, or use `with`.

    It loads the finger at once. Terminal signals do not reach it, and it ends with its parent, however that ends.
    After a loss, or an answer that was not awaited, the next request starts it anew.
    """

    def __init__(self, config: FingertipConfig) -> None:
        self._config = config
        self._process: BaseProcess | None = None
        self._begin()

    @property
    def pid(self) -> int | None:
        """Process id, None without a process."""
        return None if self._process is None else self._process.pid

    def ask(self, function: "Callable[Concatenate[Fingertip, P], T]", *arguments: P.args, **options: P.kwargs) -> T:
        """Return or raise the result of function(finger, …); Ctrl-C ends the wait. Raises FingerLostError."""
        if self._process is None:
            self._begin()
        try:
            self._near.send((function, arguments, options))
            while (reply := self._near.recv())[0] == "told":
                if _MODELS.isEnabledFor(reply[1].levelno):
                    _MODELS.handle(reply[1])
        except (EOFError, OSError):
            raise FingerLostError(
                f"the process of the finger model ended ({self._how_it_ended()}); start again"
            ) from None
        except BaseException:
            self.close()  # the next request would receive this answer
            raise
        kind, found = reply
        if kind == "raised":
            raise found
        return found

    def close(self) -> None:
        """End the process, whatever it is doing."""
        process, self._process = self._process, None
        if process is not None:
            self._near.close()
            process.kill()
            process.join(_END_S)

    def __enter__(self) -> "FingerProcess":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _begin(self) -> None:
        context = multiprocessing.get_context("spawn")  # a forked MKL may hang
        self._near, far = context.Pipe()
        self._process = context.Process(target=_serve, args=(far, self._config), name="finger", daemon=True)
        with leaving_signals_to_us():
            self._process.start()
        far.close()

    def _how_it_ended(self) -> str:
        process = self._process
        assert process is not None
        process.join(_END_S)
        code = process.exitcode
        self.close()
        if code is None:
            return "it does not respond"
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def asked(
    finger: Finger, function: "Callable[Concatenate[Fingertip, P], T]", *arguments: P.args, **options: P.kwargs
) -> T:
    """Return function(finger, …), evaluated in the finger's process."""
    if isinstance(finger, FingerProcess):
        return finger.ask(function, *arguments, **options)
    return function(finger, *arguments, **options)


class _LogForwarder(logging.Handler):
    """Log handler that forwards a model's messages to the parent."""

    def __init__(self, far: "Connection[Any, Any]") -> None:
        super().__init__()
        self._far = far

    def emit(self, record: logging.LogRecord) -> None:
        self._far.send(("told", record))


def _serve(far: "Connection[Any, Any]", config: FingertipConfig) -> None:
    belong_to_parent()
    keep_freed_memory()
    _MODELS.addHandler(_LogForwarder(far))
    _MODELS.setLevel(logging.DEBUG)
    finger = _load(config)
    with contextlib.suppress(EOFError, OSError):
        while True:
            function, arguments, options = far.recv()
            _send(far, *_answer(finger, function, arguments, options))


def belong_to_parent() -> None:
    """Yield to the parent, end with it, and leave terminal signals to it."""
    give_way(_GIVES_WAY)
    _ignore_terminal()
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()


def _ignore_terminal() -> None:
    """Ignore terminal signals, including those that arrived during the start."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform != "win32":
        for name in TO_THE_GROUP:
            signal.signal(signal.Signals[name], signal.SIG_IGN)
        signal.pthread_sigmask(signal.SIG_SETMASK, ())


def _load(config: FingertipConfig) -> "Fingertip | Exception":
    """Load the finger; a failure to load it is the answer to every request."""
    from sim.models.fingertip import Fingertip

    try:
        return Fingertip.load(config)
    except Exception as error:
        return error


def _answer(finger: "Fingertip | Exception", function: Callable[..., Any], arguments: Any, options: Any) -> Any:
    if isinstance(finger, Exception):
        return "raised", finger
    try:
        return "gave", function(finger, *arguments, **options)
    except Exception as error:
        return "raised", error


def _send(far: "Connection[Any, Any]", kind: str, found: Any) -> None:
    """Send an answer, or an error in its place if it cannot be pickled."""
    try:
        far.send((kind, found))
    except (OSError, EOFError):
        raise
    except Exception as error:
        far.send(("raised", RuntimeError(f"{type(found).__name__} cannot be sent between processes: {error}")))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
