"""Find the process that owns a port and ask it what it is doing."""

import errno
import os
import stat
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from multiprocessing import AuthenticationError
from pathlib import Path
from typing import Any, Literal

import filelock
from platformdirs import user_runtime_path
from pydantic import BaseModel, ValidationError

from rig.control.messages import BROKEN, Wire, connected, encoded
from rig.errors import RigError

ASK_S = 1.0
STOP = {"do": "stop"}
"""The one request that is said at once."""


class ControlError(RigError):
    """No answer: the process has ended, hangs, or is not the one that announced itself. One line."""

    default_code = "no_answer"


class RefusedError(ControlError):
    """The process answered that it will not. One line."""

    default_code = "refused"


class Announcement(BaseModel, frozen=True):
    """What a process says of itself while it owns ports; run is the run's folder once there is one."""

    pid: int
    kind: Literal["run", "by hand"]
    virtual: bool
    ports: tuple[str, ...]
    out: str | None = None
    run: str | None = None
    protocol: str | None = None
    config: str | None = None
    began_unix_s: float


class Announced(Announcement, frozen=True):
    """An announcement as others read it, with where to ask and the key."""

    address: str
    key: str

    def ask(self, do: str, *, within_s: float = ASK_S, **more: Any) -> dict[str, Any]:
        """Its answer to one request. Raises RefusedError with what it says, ControlError where nobody answers."""
        with self._failing(do, within_s):
            return self._answered(do, self._answer({"do": do, **more}, within_s))

    def say_stop(
        self, lives: Callable[[], object] = lambda: None, *, by: str = ""
    ) -> Callable[[float], dict[str, Any]]:
        """A stop that is said when this returns, which waits for nothing. Raises ControlError where it is not.

        What is returned listens to the answer for so many seconds, as ask does, and calls `lives` when the owner is
        heard at all: an owner that is not may hang.
        """
        key = bytes.fromhex(self.key)
        with self._failing("stop", 0.0):
            connection = connected(self.address, 0.0)
            nonce = Wire(connection, 0.0).say_stop(key, by)

        def answer(within_s: float) -> dict[str, Any]:
            with self._failing("stop", within_s), connection:
                return self._answered("stop", Wire(connection, within_s).stopped(key, nonce, lives))

        return answer

    @contextmanager
    def _failing(self, do: str, within_s: float) -> Iterator[None]:
        """What fails inside is told as a ControlError."""
        try:
            yield
        except (TimeoutError, BlockingIOError):
            raise ControlError(
                "process {pid} does not answer within {within_s:g} s",
                code="no_reply",
                pid=self.pid,
                within_s=within_s,
            ) from None
        except AuthenticationError:
            raise ControlError("process {pid} is not the one that announced itself: it has another key",
                               code="another_key", pid=self.pid) from None  # fmt: skip
        except (FileNotFoundError, ConnectionRefusedError):
            raise ControlError("process {pid} has ended", code="ended", pid=self.pid) from None
        except BROKEN as error:
            raise ControlError(
                "process {pid} ended before it answered {do!r}: {problem}",
                code="broken_off",
                pid=self.pid,
                do=do,
                problem=str(error) or type(error).__name__,
            ) from None

    def _answered(self, do: str, answer: dict[str, Any]) -> dict[str, Any]:
        if answer.get("ok") is not True:
            problem = str(answer.get("problem", f"process {self.pid} refused {do!r}"))
            code = str(answer.get("code", RefusedError.default_code))
            raise RefusedError("{problem}", code=code, pid=self.pid, do=do, problem=problem)
        return answer

    def _answer(self, request: dict[str, Any], within_s: float) -> dict[str, Any]:
        with connected(self.address, within_s) as connection:
            wire, key = Wire(connection, within_s), bytes.fromhex(self.key)
            if request == STOP:
                return wire.stop(key)
            wire.prove(key)
            wire.send_bytes(encoded(request))
            return wire.hear()


def announced() -> list[Announced]:
    """Every process that owns ports now, the oldest first; notes of those that have ended are removed.

    Raises PermissionError where the folder is somebody else's.
    """
    found = []
    for note in runtime_folder().glob("*.json"):
        try:
            if not _removed_where_left(note):
                found.append(Announced.model_validate_json(note.read_bytes()))
        except (OSError, ValidationError):
            continue  # just removed, or none of ours
    return sorted(found, key=lambda one: one.began_unix_s)


def runtime_folder() -> Path:
    """RIG_RUNTIME_DIR, or the user's runtime folder; private. Raises OSError."""
    chosen = os.environ.get("RIG_RUNTIME_DIR")
    if chosen:
        return _private(Path(chosen))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # where nobody has logged in there is none, and another one will do
        return _private(user_runtime_path("rig", ensure_exists=True))


def lock_of(note: Path) -> filelock.FileLock:
    """Held by the process that wrote a note, until it ends however it ends."""
    return filelock.FileLock(note.with_suffix(".lock"), timeout=0.2, thread_local=False)


def remove(note: Path) -> None:
    """A note, its socket and its lock, which the caller holds."""
    for suffix in (".json", ".new", ".sock", ".lock"):
        note.with_suffix(suffix).unlink(missing_ok=True)


def _removed_where_left(note: Path) -> bool:
    try:
        with lock_of(note).acquire(timeout=0):
            remove(note)
            return True
    except (filelock.Timeout, OSError):  # a disk that takes nothing says nothing of who lives: who asks will see
        return False


def _private(folder: Path) -> Path:
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if os.name == "posix":
        found = folder.lstat()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid():
            raise PermissionError(errno.EPERM, "expected a folder of this user's own", str(folder))
        if stat.S_IMODE(found.st_mode) != 0o700:
            folder.chmod(0o700)
    return folder


_ANSWER_S = 0.5


def at_work(owner: int) -> dict[str, str]:
    """What a process does, since when, and what stops it; nothing of one that has not announced itself."""
    try:
        found = next((one for one in announced() if one.pid == owner), None)
    except OSError:  # nobody can be announced there
        found = None
    if found is None:
        return {}
    since = datetime.fromtimestamp(found.began_unix_s).isoformat(" ", "seconds")
    return {"does": f"{_what(found)}, {_state(found)}", "since": since, "stopped by": _stop(found)}


def _what(owner: Announced) -> str:
    return owner.kind if owner.protocol is None else f"{owner.kind} of {owner.protocol}"


def _state(owner: Announced) -> str:
    try:
        return str(owner.ask("status", within_s=_ANSWER_S)["state"])
    except ControlError as error:
        return str(error)


def _stop(owner: Announced) -> str:
    return "rig stop" if owner.config is None else f"rig stop --config {owner.config}"
