"""The owner's side: one note, one socket, and a thread for each who asks."""

import os
import secrets
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing.connection import Connection, Listener
from pathlib import Path
from types import TracebackType
from typing import Any

from rig.session.control.announcements import STOP, Announced, Announcement, lock_of, remove, runtime_folder
from rig.session.control.conversation import BROKEN, Wire, connected, encoded

Answers = Mapping[str, Callable[[Mapping[str, Any]], Mapping[str, Any]]]
"""What is done for each request, and said of it; called from threads of their own, several at once."""

PATIENCE_S = 2.0
"""Whoever has connected and says nothing is let go after so long."""

SWITCH_S = 5e-4
"""How long a busy main thread may keep whoever answers waiting, some ten times for one answer."""

_BACKLOG = 16
_AGAIN_S = 0.05
_LONGEST_ADDRESS = 100  # bytes; a socket's path may have 103 on some systems


class ControlSocket:
    """A process that owns ports announces itself and answers, whatever its main thread does.

    Each who asks is served by a thread of its own: a stop waits for nobody. What an answer raises is its problem, in
    one line.
    """

    def __init__(self, announcement: Announcement, answers: Answers) -> None:
        self._announcement, self._answers = announcement, answers
        self._key = secrets.token_bytes(32)
        self._ending = threading.Event()

    def __enter__(self) -> "ControlSocket":
        """Raises OSError; filelock.Timeout where this process has announced itself already."""
        with ExitStack() as undo:
            undo.enter_context(quick_switches())
            self._note = undo.enter_context(_own_note(self._announcement.pid))
            self._listener = undo.enter_context(_listening(self._note))
            self._tell()
            undo.callback(self._note.unlink, missing_ok=True)
            thread = threading.Thread(target=self._accept, name="control", daemon=True)
            thread.start()
            undo.callback(self._no_more, thread)
            self._undo = undo.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._undo.close()

    def tell(self, **changes: Any) -> None:
        """Change what is announced. Raises OSError."""
        self._announcement = self._announcement.model_copy(update=changes)
        self._tell()

    def _tell(self) -> None:
        """Whole or not at all, and for nobody else's eyes."""
        said = Announced(**dict(self._announcement), address=self._listener.address, key=self._key.hex())
        new = self._note.with_suffix(".new")
        with open(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="utf-8") as file:
            file.write(said.model_dump_json())
        new.replace(self._note)

    def _accept(self) -> None:
        while True:
            try:
                connection = self._listener.accept()
            except OSError:  # too many are open: those that say nothing are let go soon
                self._ending.wait(_AGAIN_S)
                continue
            if self._ending.is_set():
                connection.close()
                return
            threading.Thread(target=self._serve, args=(connection,), name="control", daemon=True).start()

    def _no_more(self, thread: threading.Thread) -> None:
        """A connection of our own wakes the thread that waits for one."""
        self._ending.set()
        with suppress(OSError):  # the socket's file was removed by somebody: the thread ends with the process
            connected(self._listener.address, PATIENCE_S).close()
            thread.join(PATIENCE_S)

    def _serve(self, connection: "Connection[Any, Any]") -> None:
        """One request and its answer; whoever is none of ours, or gone, is let go."""
        with connection:
            try:
                wire = Wire(connection, PATIENCE_S)
                nonce = wire.challenge(self._key)
                if nonce is None:
                    wire.send_bytes(self._answer(wire.hear()))
                else:
                    wire.told(self._key, nonce, self._answer(STOP))
            except BROKEN:
                return

    def _answer(self, request: Mapping[str, Any]) -> bytes:
        do = request.get("do")
        if not isinstance(do, str) or do not in self._answers:
            return _refused(f"{do!r} cannot be asked here, expected {', '.join(self._answers)}")
        try:
            return encoded({"ok": True, **self._answers[do](request)})
        except Exception as error:
            return _refused(" ".join(str(error).split()) or type(error).__name__)


def _refused(problem: str) -> bytes:
    return encoded({"ok": False, "problem": problem})


@contextmanager
def quick_switches() -> Iterator[None]:
    """A thread that waits for another gets its turn within SWITCH_S, where Python has ten times that."""
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(min(SWITCH_S, before_s))
    try:
        yield
    finally:
        sys.setswitchinterval(before_s)


@contextmanager
def _own_note(pid: int) -> Iterator[Path]:
    """The path of this process's note, which is its own from here on."""
    note = runtime_folder() / f"{pid}.json"
    with lock_of(note):
        try:
            yield note
        finally:
            remove(note)


@contextmanager
def _listening(note: Path) -> Iterator[Listener]:
    """A socket beside the note, or in a folder of its own where that path is too long for one."""
    if os.name != "posix":
        with Listener() as listener:
            yield listener
        return
    address = note.with_suffix(".sock")
    with ExitStack() as undo:
        if len(os.fsencode(address)) > _LONGEST_ADDRESS:
            address = Path(undo.enter_context(tempfile.TemporaryDirectory(prefix="rig-"))) / "control.sock"
        address.unlink(missing_ok=True)
        listener = Listener(str(address), backlog=_BACKLOG)
        address.chmod(0o600)
        undo.callback(_closed, listener)
        yield listener


def _closed(listener: Listener) -> None:
    with suppress(OSError):  # it removes its file, which may be gone
        listener.close()
