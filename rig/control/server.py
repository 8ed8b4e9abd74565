"""The owner's side: one note, one socket, and a thread for each who asks."""

import gc
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

from rig.control.client import STOP, Announced, Announcement, RefusedError, lock_of, remove, runtime_folder
from rig.control.messages import BROKEN, Wire, connected, encoded, said_by
from rig.errors import RigError

Answers = Mapping[str, Callable[[Mapping[str, Any]], Mapping[str, Any]]]
"""What is done for each request, and said of it; called from threads of their own, several at once."""

PATIENCE_S = 2.0
"""Whoever has connected and says nothing is let go after so long."""

SWITCH_S = 5e-4
"""How long a busy main thread may keep whoever answers waiting, some ten times for one answer."""

SHORT_LOOKS = (5_000, 3, 30)
"""New objects that are looked through for garbage, and how often older ones are with them. No thread has its turn
meanwhile: up to 5 ms while a script is planned, where it is 56 by the 50 000 objects of rig/cli/program.py."""

_SPARE = 3  # threads that wait for whoever asks next
_BACKLOG = 16
_AGAIN_S = 0.05
_LONGEST_ADDRESS = 100  # bytes; a socket's path may have 103 on some systems


class ControlSocket:
    """A process that owns ports announces itself and answers, whatever its main thread does.

    Each who asks is served by a thread of its own, which has waited for whoever comes next: a stop waits for nobody,
    and no thread has to be begun for it. What an answer raises is its problem, in one line.
    """

    def __init__(self, announcement: Announcement, answers: Answers) -> None:
        self._announcement, self._answers = announcement, answers
        self._key = secrets.token_bytes(32)
        self._ending = threading.Event()
        self._counting, self._waiting = threading.Lock(), set[threading.Thread]()

    def __enter__(self) -> "ControlSocket":
        """Raises OSError; filelock.Timeout where this process has announced itself already."""
        with ExitStack() as undo:
            undo.enter_context(quick_switches())
            self._note = undo.enter_context(_own_note(self._announcement.pid))
            self._listener = undo.enter_context(_listening(self._note))
            self._tell()
            undo.callback(self._note.unlink, missing_ok=True)
            undo.callback(self._no_more)
            for _ in range(_SPARE):
                self._wait_for_one_more()
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

    def _wait_for_one_more(self) -> None:
        threading.Thread(target=self._serve_some, name="control", daemon=True).start()

    def _serve_some(self) -> None:
        """One after the other; the last of those that wait begins another before it serves."""
        this = threading.current_thread()
        while True:
            with self._counting:
                if self._ending.is_set() or len(self._waiting) >= _SPARE:
                    return
                self._waiting.add(this)
            connection = self._accepted()
            with self._counting:
                self._waiting.discard(this)
                alone = not self._waiting
            if connection is None:
                return
            if self._ending.is_set():
                connection.close()
                return
            if alone:
                self._wait_for_one_more()
            self._serve(connection)

    def _accepted(self) -> "Connection[Any, Any] | None":
        """The next who asks; None where nobody is served any more."""
        while not self._ending.is_set():
            try:
                return self._listener.accept()
            except OSError:  # too many are open: those that say nothing are let go soon
                self._ending.wait(_AGAIN_S)
        return None

    def _no_more(self) -> None:
        """Connections of our own wake the threads that wait for one."""
        with self._counting:
            self._ending.set()
            waiting = list(self._waiting)
        with suppress(OSError):  # the socket's file was removed by somebody: the threads end with the process
            for _ in waiting:
                connected(self._listener.address, PATIENCE_S).close()
            for thread in waiting:
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
                    by = said_by(nonce)
                    wire.told(self._key, nonce, self._answer({**STOP, "by": by} if by else STOP))
            except BROKEN:
                return

    def _answer(self, request: Mapping[str, Any]) -> bytes:
        do = request.get("do")
        if not isinstance(do, str) or do not in self._answers:
            return _refused(f"{do!r} cannot be asked here, expected {', '.join(self._answers)}", "cannot_be_asked")
        try:
            return encoded({"ok": True, **self._answers[do](request)})
        except Exception as error:
            code = error.code if isinstance(error, RigError) else RefusedError.default_code
            return _refused(" ".join(str(error).split()) or type(error).__name__, code)


def _refused(problem: str, code: str) -> bytes:
    return encoded({"ok": False, "problem": problem, "code": code})


@contextmanager
def quick_switches() -> Iterator[None]:
    """A thread that waits for another gets its turn within SWITCH_S, or after a short look for garbage."""
    before_s, looked_through = sys.getswitchinterval(), gc.get_threshold()
    sys.setswitchinterval(min(SWITCH_S, before_s))
    if looked_through[0] > SHORT_LOOKS[0]:
        gc.set_threshold(*SHORT_LOOKS)
    try:
        yield
    finally:
        gc.set_threshold(*looked_through)
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
