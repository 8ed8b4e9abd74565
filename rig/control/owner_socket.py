"""Server of the process that owns ports: one note, one socket, and a thread for each client."""

import gc
import os
import secrets
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from rig.control.client import STOP, Announced, Announcement, RefusedError, lock_of, remove, runtime_folder
from rig.control.local_socket import Channel, connected, listening
from rig.control.messages import BROKEN, Wire, encoded, sender_of
from rig.data.folder import put_in_place
from rig.errors import RigError

Answers = Mapping[str, Callable[[Mapping[str, Any]], Mapping[str, Any]]]
"""Handlers by request, which return the reply; called from several threads at once."""

PATIENCE_S = 2.0
"""Time until a silent client is disconnected (s)."""

MOST_UNPROVEN = 32
"""Maximum number of unauthenticated clients; one more disconnects the oldest of them."""

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

    Each client is served by a thread that was already waiting, so that a stop waits for no other client and no
    thread start. An exception of a handler is reported in one line.
    """

    def __init__(self, announcement: Announcement, answers: Answers) -> None:
        self._announcement, self._answers = announcement, answers
        self._key = secrets.token_bytes(32)
        self._ending = threading.Event()
        self._counting, self._waiting = threading.Condition(), set[threading.Thread]()
        self._unproven: dict[Channel, None] = {}  # in the order in which they connected

    def __enter__(self) -> "ControlSocket":
        """Announce the process and listen.

        Raises OSError; filelock.Timeout if the process has already announced itself.
        """
        with ExitStack() as undo:
            undo.enter_context(quick_switches())
            self._note = undo.enter_context(_own_note(self._announcement.pid))
            self._listener = undo.enter_context(listening(self._note.with_suffix(".sock")))
            self._write_note()
            undo.callback(self._note.unlink, missing_ok=True)
            undo.callback(self._wake_waiting)
            for _ in range(_SPARE):
                self._wait_for_one_more()
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
        announced = Announced(**dict(self._announcement), address=self._listener.address, key=self._key.hex())
        new = self._note.with_suffix(".new")
        with open(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="utf-8") as file:
            file.write(announced.model_dump_json())
        put_in_place(new, self._note)

    def _wait_for_one_more(self) -> None:
        threading.Thread(target=self._serve_some, name="control", daemon=True).start()

    def _serve_some(self) -> None:
        """Serve one client after another; the last waiting thread starts another one before it serves."""
        this = threading.current_thread()
        while True:
            with self._counting:
                if self._ending.is_set() or len(self._waiting) >= _SPARE:
                    return
                self._waiting.add(this)
            connection = self._accepted()
            if connection is not None:
                self._admit(connection)
            with self._counting:
                self._waiting.discard(this)
                alone = not self._waiting
            if connection is None:
                return
            if self._ending.is_set():
                self._dismiss(connection)
                connection.close()
                return
            if alone:
                self._wait_for_one_more()
            self._serve(connection)

    def _accepted(self) -> Channel | None:
        """Return the next connection, or None at the end."""
        while not self._ending.is_set():
            try:
                return self._listener.accept()
            except OSError:  # Too many are open; silent ones are disconnected soon.
                self._ending.wait(_AGAIN_S)
        return None

    def _admit(self, connection: Channel) -> None:
        """Count a client without the key; above the limit, wait for the end of the first ones."""
        with self._counting:
            self._unproven[connection] = None
            for first in list(self._unproven)[: max(len(self._unproven) - MOST_UNPROVEN, 0)]:
                first.end_reading()
            self._counting.wait_for(lambda: len(self._unproven) <= MOST_UNPROVEN, PATIENCE_S)

    def _dismiss(self, connection: Channel) -> None:
        """Stop counting a client that has proven the key or disconnected."""
        with self._counting:
            self._unproven.pop(connection, None)
            self._counting.notify_all()

    def _wake_waiting(self) -> None:
        """Wake the waiting threads with connections of our own, and join them."""
        with self._counting:
            self._ending.set()
            waiting = list(self._waiting)
        with suppress(OSError):  # The socket's file is gone; the threads end with the process.
            for _ in waiting:
                connected(self._listener.address, PATIENCE_S).close()
            for thread in waiting:
                thread.join(PATIENCE_S)

    def _serve(self, connection: Channel) -> None:
        """Serve one request; drop a client that is foreign or gone."""
        with connection:
            try:
                wire = Wire(connection, PATIENCE_S)
                try:
                    nonce = wire.challenge(self._key)
                finally:
                    self._dismiss(connection)
                if nonce is None:
                    wire.send_bytes(self._answer(wire.hear()))
                else:
                    by = sender_of(nonce)
                    wire.answer_stop(self._key, nonce, self._answer({**STOP, "by": by} if by else STOP))
            except BROKEN:
                return

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
