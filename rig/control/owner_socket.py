"""Server of the process that owns ports: one note, one socket, and a thread for each client."""

import gc
import os
import secrets
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from rig.control.client import Announced, Announcement, RefusedError, lock_of, remove, runtime_folder
from rig.control.connection import (
    RECEIVED,
    LimitedConnection,
    PrivateListener,
    connected,
    encoded,
    proven,
    sender_of,
)
from rig.data.folder import put_in_place
from rig.errors import RigError

Answers = Mapping[str, Callable[[Mapping[str, Any]], Mapping[str, Any]]]
"""Handlers by request, which return the reply; called from several threads at once."""

PATIENCE_S = 2.0
"""Time until a silent client is disconnected (s)."""

MOST_THREADS = 256
"""Number of threads from which a client waits until another one has gone."""

SWITCH_S = 5e-4
"""Longest delay of a waiting thread by a busy main thread (s), some ten times for one reply."""

GC_THRESHOLDS = (5_000, 3, 30)
"""Thresholds of the garbage collector.

No thread runs during a collection: up to 5 ms while a script is planned, instead of 56 ms with the 50 000 objects
of rig/cli/program.py.
"""

_SPARE = 3  # threads that wait for the next client
_AGAIN_S = 0.05


class ControlSocket:
    """Socket on which a process that owns ports announces itself and replies, whatever its main thread does.

    Each client is served by a thread that was already waiting, so that a stop waits for no other client and no thread
    start: both cost turns of a thread on a busy machine. An exception of a handler is reported in one line.
    """

    def __init__(self, announcement: Announcement, answers: Answers) -> None:
        self._announcement, self._answers = announcement, answers
        self._key = secrets.token_bytes(32)
        self._ending, self._counting, self._waiting = threading.Event(), threading.Condition(), 0

    def __enter__(self) -> "ControlSocket":
        """Announce the process and listen.

        Raises OSError; filelock.Timeout if the process has already announced itself.
        """
        with ExitStack() as undo:
            undo.enter_context(quick_switches())
            self._note = undo.enter_context(_own_note(self._announcement.pid))
            self._listener = undo.enter_context(closing(PrivateListener(self._note.with_suffix(".sock"))))
            self._write_note()
            undo.callback(self._note.unlink, missing_ok=True)
            undo.callback(self._end)
            for _ in range(_SPARE):
                self._begin_thread()
            self._undo = undo.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._undo.close()

    def tell(self, **changes: Any) -> None:
        """Change the announcement. Raises OSError."""
        self._announcement = self._announcement.model_copy(update=changes)
        self._write_note()

    def _write_note(self) -> None:
        """Write the note in one step, readable for this user only."""
        address, key = self._listener.address, self._key.hex()
        announced = Announced(**dict(self._announcement), address=address, key=key)
        new = self._note.with_suffix(".new")
        with open(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="utf-8") as file:
            file.write(announced.model_dump_json())
        put_in_place(new, self._note)

    def _begin_thread(self) -> None:
        with suppress(RuntimeError):  # The system has no more threads.
            threading.Thread(target=self._serve_some, name="control", daemon=True).start()

    def _serve_some(self) -> None:
        """Serve one client after another; the last waiting thread begins another one before it serves."""
        while True:
            with self._counting:
                if self._ending.is_set() or self._waiting == _SPARE:
                    return
                self._waiting += 1
            accepted = None
            try:
                accepted = self._listener.accept(PATIENCE_S)
            except (OSError, EOFError):  # Too many files are open; silent clients are disconnected soon.
                self._ending.wait(_AGAIN_S)
            with self._counting:
                self._waiting -= 1
                self._counting.notify_all()
                alone = not self._waiting
            if accepted is None:
                continue
            connection, client = accepted
            with suppress(Exception), connection:  # No failed client ends this.
                if alone and threading.active_count() < MOST_THREADS:
                    self._begin_thread()
                self._serve(client)

    def _end(self) -> None:
        """Wake the waiting threads by connections of our own, and wait for their end."""
        with self._counting:
            self._ending.set()
            waiting = self._waiting
        with suppress(OSError):  # The socket's file is gone; the threads end with the process.
            for _ in range(waiting):
                connected(self._listener.address, PATIENCE_S).close()
            with self._counting:
                self._counting.wait_for(lambda: not self._waiting, PATIENCE_S)

    def _serve(self, client: LimitedConnection) -> None:
        """Serve one request. Raises BROKEN if the client is foreign, silent or gone."""
        stop = client.admit(self._key)
        if stop is None:
            client.send_bytes(self._answer(client.receive()))
            return
        by = sender_of(stop)
        with suppress(OSError):  # Who sends a stop may not wait for a reply.
            client.send_bytes(RECEIVED)
        answer = self._answer({"do": "stop", **({"by": by} if by else {})})
        client.send_bytes(proven(self._key, stop, answer))

    def _answer(self, request: Mapping[str, Any]) -> bytes:
        do = request.get("do")
        if not isinstance(do, str) or do not in self._answers:
            return _refused(f"{do!r} is not available here, expected {', '.join(self._answers)}", "cannot_be_asked")
        try:
            return encoded({"ok": True, **self._answers[do](request)})
        except Exception as error:
            code = error.code if isinstance(error, RigError) else RefusedError.default_code
            return _refused(" ".join(str(error).split()) or type(error).__name__, code)


def _refused(problem: str, code: str) -> bytes:
    return encoded({"ok": False, "problem": problem, "code": code})


@contextmanager
def quick_switches() -> Iterator[None]:
    """Limit the delay of waiting threads to SWITCH_S, or a short garbage collection."""
    before_s, thresholds = sys.getswitchinterval(), gc.get_threshold()
    sys.setswitchinterval(min(SWITCH_S, before_s))
    if thresholds[0] > GC_THRESHOLDS[0]:
        gc.set_threshold(*GC_THRESHOLDS)
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)
        sys.setswitchinterval(before_s)


@contextmanager
def _own_note(pid: int) -> Iterator[Path]:
    """Yield the path of this process's note, locked."""
    note = runtime_folder() / f"{pid}.json"
    with lock_of(note):
        try:
            yield note
        finally:
            remove(note)
