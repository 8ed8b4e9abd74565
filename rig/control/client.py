"""Client of the process that owns a port: finds it and sends requests."""

import errno
import os
import shlex
import stat
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from multiprocessing import AuthenticationError
from pathlib import Path
from typing import Any, Literal

import filelock
from platformdirs import user_runtime_path
from pydantic import BaseModel, Field, ValidationError

from rig.control.connection import BROKEN, LimitedConnection, connected, decoded, stop_message, verified
from rig.errors import RigError
from rig_shared.outputs import CommandLine, Output, Time
from rig_shared.user_files import read_bytes

ASK_S = 1.0

BESIDE_S = 0.025
"""Time after which a silent owner is abandoned, and the bytes of a stop are sent beside it (s)."""


class ControlError(RigError):
    """Error of a missing reply: the process has ended, hangs, or is another one."""

    default_code = "no_answer"


class RefusedError(ControlError):
    """Error of a request that the process refused."""

    default_code = "refused"


class Announcement(BaseModel, frozen=True):
    """Announcement of a process that owns ports; `run` is the run's folder once it exists."""

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
    """Announcement read by other processes, with address and key."""

    address: str
    key: str = Field(pattern=r"^([0-9a-f]{2})+$")

    def ask(self, do: str, *, within_s: float = ASK_S, **more: Any) -> dict[str, Any]:
        """Return the reply to one request. Raises RefusedError, or ControlError without a reply."""
        if do == "stop" and not more:
            return self.post_stop(within_s=within_s)(within_s)
        with self._failing(do, within_s), connected(self.address, within_s) as connection:
            owner = LimitedConnection(connection, within_s)
            owner.greet(bytes.fromhex(self.key))
            owner.send({"do": do, **more})
            return self._answered(do, owner.receive())

    def post_stop(
        self, lives: Callable[[], object] = lambda: None, *, by: str = "", within_s: float = BESIDE_S
    ) -> Callable[[float], dict[str, Any]]:
        """Send a stop without waiting for a reply. Raises ControlError if it is not sent.

        within_s: longest wait for a place, where more clients are before it than the system keeps. The returned
        function waits for the reply, up to the given seconds, and calls `lives` at the first sign of the owner; an
        owner without one may hang.
        """
        key = bytes.fromhex(self.key)
        stop, message = stop_message(key, by)  # First: the owner wakes when this connects.
        with self._failing("stop", within_s):
            connection = connected(self.address, within_s)
            connection.send_bytes(message)

        def answer(within_s: float) -> dict[str, Any]:
            with self._failing("stop", within_s), connection:
                owner = LimitedConnection(connection, within_s)
                owner.recv_bytes()
                lives()
                return self._answered("stop", decoded(verified(key, stop, owner.recv_bytes())))

        return answer

    @contextmanager
    def _failing(self, do: str, within_s: float) -> Iterator[None]:
        """Turn failures into a ControlError."""
        try:
            yield
        except (TimeoutError, BlockingIOError):
            raise ControlError(f"process {self.pid} does not answer within {within_s:g} s", "no_reply") from None
        except AuthenticationError:
            raise ControlError(
                f"process {self.pid} is not the one that announced itself: it has another key", "another_key"
            ) from None
        except (FileNotFoundError, ConnectionRefusedError):
            raise ControlError(f"process {self.pid} has ended", "ended") from None
        except BROKEN as error:
            raise ControlError(
                f"process {self.pid} ended before it answered {do!r}: {str(error) or type(error).__name__}",
                "broken_off",
            ) from None

    def _answered(self, do: str, answer: dict[str, Any]) -> dict[str, Any]:
        if answer.get("ok") is not True:
            problem = str(answer.get("problem", f"process {self.pid} refused {do!r}"))
            raise RefusedError(problem, str(answer.get("code", RefusedError.default_code)))
        return answer


def announced() -> list[Announced]:
    """Return the processes that own ports now, the oldest first; remove the notes of ended ones.

    Raises PermissionError if the folder belongs to another user.
    """
    found = []
    for note in runtime_folder().glob("*.json"):
        try:
            if not _removed_where_left(note):
                found.append(Announced.model_validate_json(read_bytes(note)))
        except (OSError, ValidationError):
            continue  # It was just removed, or is no note of this program.
    return sorted(found, key=lambda one: one.began_unix_s)


def runtime_folder() -> Path:
    """Return RIG_RUNTIME_DIR, or the user's runtime folder; private. Raises OSError."""
    chosen = os.environ.get("RIG_RUNTIME_DIR")
    if chosen:
        return _private(Path(chosen))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Without a login session there is none, and a fallback is used.
        return _private(user_runtime_path("rig", ensure_exists=True))


def lock_of(note: Path) -> filelock.FileLock:
    """Return the lock that the writer of a note holds as long as it lives."""
    return filelock.FileLock(note.with_suffix(".lock"), timeout=0.2, thread_local=False)


def remove(note: Path) -> None:
    """Remove a note, its socket and its lock, which the caller holds."""
    for suffix in (".json", ".new", ".sock"):
        note.with_suffix(suffix).unlink(missing_ok=True)
    with suppress(PermissionError):  # Windows removes the file when the lock is released.
        note.with_suffix(".lock").unlink(missing_ok=True)


def _removed_where_left(note: Path) -> bool:
    try:
        with lock_of(note).acquire(timeout=0):
            remove(note)
            return True
    except (filelock.Timeout, OSError):  # A full disk does not show whether the process lives; a request will.
        return False


def _private(folder: Path) -> Path:
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if sys.platform != "win32":  # There the profile of the user is private.
        found = folder.lstat()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid():
            raise PermissionError(errno.EPERM, "expected a folder of this user's own", str(folder))
        if stat.S_IMODE(found.st_mode) != 0o700:
            folder.chmod(0o700)
    return folder


_ANSWER_S = 0.5


class ActivityJson(Output):
    """Activity of a process, its start, and the command that stops it."""

    does_text: str
    since_utc: Time
    stop: CommandLine


def activity_of(owner: int) -> ActivityJson | None:
    """Return the activity of a process; None if it is not announced."""
    try:
        found = next((one for one in announced() if one.pid == owner), None)
    except OSError:  # Then no process can be announced there.
        found = None
    if found is None:
        return None
    since = datetime.fromtimestamp(found.began_unix_s, UTC).isoformat(timespec="seconds")
    return {"does_text": f"{_what(found)}, {_state(found)}", "since_utc": since, "stop": _stop(found)}


def _what(owner: Announced) -> str:
    return owner.kind if owner.protocol is None else f"{owner.kind} of {owner.protocol}"


def _state(owner: Announced) -> str:
    try:
        return str(owner.ask("status", within_s=_ANSWER_S)["state"])
    except ControlError as error:
        return str(error)


def _stop(owner: Announced) -> str:
    return shlex.join(["rig", "stop", *([] if owner.config is None else ["--config", owner.config])])
