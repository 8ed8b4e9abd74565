"""A lock that every account of this machine sees, and that the system takes back when its process ends.

POSIX: a record lock on an empty file in a fixed folder that everybody may write to. The system itself names the
process that holds one (F_GETLK): no note is written that could be forged, left behind, or written through a link.
Windows has a lock file, and nobody's number; what it lacks stands in the class of that name.
"""

import errno
import os
import re
import secrets
import stat
import struct
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rig.errors import RigError

FOLDERS = ("/run/lock", "/tmp")
"""The first that is everybody's; neither an account nor its environment has a say in it."""

_TRIES = 20


@dataclass(frozen=True)
class PortOwner:
    """Process that holds a lock, as the system says; pid is None where it does not."""

    pid: int | None

    @property
    def ours(self) -> bool:
        """Whether it is a process of this account, which may be signalled."""
        if self.pid is None:
            return False
        if os.path.isdir("/proc/self"):
            with suppress(OSError):
                return os.stat(f"/proc/{self.pid}").st_uid == os.geteuid()
            return False
        if os.geteuid() == 0:  # it may signal anybody: that says nothing
            return False
        with suppress(OSError):
            os.kill(self.pid, 0)
            return True
        return False

    def __str__(self) -> str:
        if self.pid is None:
            return "another program"
        return f"process {self.pid}" + ("" if self.ours else " of another account")


class LockHeldError(RigError):
    """Somebody else has the lock."""

    default_code = "lock_held"

    def __init__(self, owner: PortOwner) -> None:
        super().__init__("in use by {owner}", owner=str(owner), pid=owner.pid)
        self.owner = owner


if sys.platform == "win32":
    import filelock

    class MachineLock:
        """This process's hold on a name, by a file that the system keeps open for one process alone."""

        def __init__(self, name: str) -> None:
            self._lock = filelock.FileLock(Path("C:/ProgramData") / _file_name(name), timeout=0, thread_local=False)
            try:
                self._lock.acquire()
            except filelock.Timeout:
                raise LockHeldError(PortOwner(None)) from None

        def release(self) -> None:
            """Let others have it."""
            self._lock.release()

    def lock_owner(name: str) -> PortOwner | None:
        """Return who holds a name; its number is not known."""
        try:
            MachineLock(name).release()
        except LockHeldError as held:
            return held.owner
        return None

else:
    import fcntl

    # struct flock: on Linux the type is first, on BSD and macOS it comes after the numbers.
    _LINUX = sys.platform.startswith("linux")
    _FLOCK = "hhqqi" if _LINUX else "qqihh"
    _ASKED = (fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0) if _LINUX else (0, 0, 0, fcntl.F_WRLCK, os.SEEK_SET)
    _TYPE, _PID = (0, 4) if _LINUX else (3, 2)
    _OPEN = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY

    Inode = tuple[int, int]

    _held: set[Inode] = set()
    """Files that this process has locked. To close any descriptor of one would let go of its lock."""

    _guard = threading.Lock()
    os.register_at_fork(after_in_child=lambda: _held.clear())

    class MachineLock:
        """This process's hold on a name.

        Parameters
        ----------
        name : str
            What is locked; every process that names it the same means the same.

        Raises
        ------
        LockHeldError
            If another process, or another lock of this one, holds it.
        OSError
            If it cannot be locked: the file in its place is no lock of this program, or closed to this account.
        """

        def __init__(self, name: str) -> None:
            self._path, self._pid = _folder() / _file_name(name), os.getpid()
            with _guard:
                self._fd = self._locked()
                self._inode = _inode(os.fstat(self._fd))
                _held.add(self._inode)

        def release(self) -> None:
            """Let others have it."""
            with _guard:
                if self._inode not in _held or os.getpid() != self._pid:
                    return
                with suppress(OSError):  # of another account: it stays, and anybody may lock it
                    if _inode(os.lstat(self._path)) == self._inode:
                        self._path.unlink()
                os.close(self._fd)
                _held.discard(self._inode)

        def _locked(self) -> int:
            for _ in range(_TRIES):
                with suppress(FileNotFoundError):
                    if _inode(os.lstat(self._path)) in _held:
                        raise LockHeldError(PortOwner(os.getpid()))
                try:
                    fd = _opened(self._path)
                except FileNotFoundError:
                    _make(self._path)
                    continue
                try:
                    fcntl.lockf(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except (BlockingIOError, PermissionError):
                    owner = _blocker(fd)
                    _close(fd)
                    if owner is not None:
                        raise LockHeldError(owner) from None
                    continue  # it has just been let go
                with suppress(FileNotFoundError):
                    if _inode(os.lstat(self._path)) == _inode(os.fstat(fd)):
                        return fd
                _close(fd)  # whoever held it removed the file meanwhile
            raise OSError(errno.EAGAIN, "it changes all the time", str(self._path))

    def lock_owner(name: str) -> PortOwner | None:
        """Return who holds a name now, None if nobody does. Nothing is locked, written or waited for."""
        with _guard:
            try:
                path = _folder() / _file_name(name)
                if _inode(os.lstat(path)) in _held:
                    return PortOwner(os.getpid())
                fd = os.open(path, os.O_RDONLY | _OPEN)
            except OSError:
                return None
            try:
                return _blocker(fd)
            except OSError:
                return None
            finally:
                _close(fd)

    def _folder() -> Path:
        for folder in FOLDERS[:-1]:
            with suppress(OSError):
                if os.stat(folder).st_mode & 0o1777 == 0o1777:
                    return Path(folder)
        return Path(FOLDERS[-1])

    def _opened(path: Path) -> int:
        """A descriptor of the lock's file, to which nothing is ever written."""
        # Without O_CREAT: Linux refuses that for a file of another account (fs.protected_regular).
        fd = os.open(path, os.O_RDWR | _OPEN)
        if not stat.S_ISREG(os.fstat(fd).st_mode):
            os.close(fd)
            raise OSError(errno.EEXIST, "expected an empty file", str(path))
        return fd

    def _make(path: Path) -> None:
        """An empty file that every account may lock whatever the umask is, there as a whole or not at all."""
        new = path.with_name(f"{path.name}-{secrets.token_hex(8)}")
        fd = os.open(new, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        try:
            os.fchmod(fd, 0o666)
            with suppress(FileExistsError):
                os.link(new, path)
        finally:
            os.unlink(new)
            os.close(fd)

    def _blocker(fd: int) -> PortOwner | None:
        """Who has locked a file. A file with another name may be anybody's, and says nothing of who uses a port."""
        found = struct.unpack(_FLOCK, fcntl.fcntl(fd, fcntl.F_GETLK, struct.pack(_FLOCK, *_ASKED)))
        if found[_TYPE] == fcntl.F_UNLCK:
            return None
        believed = found[_PID] > 0 and os.fstat(fd).st_nlink == 1
        return PortOwner(found[_PID] if believed else None)

    def _close(fd: int) -> None:
        if _inode(os.fstat(fd)) not in _held:
            os.close(fd)

    def _inode(found: os.stat_result) -> Inode:
        return found.st_dev, found.st_ino


def _file_name(name: str) -> str:
    return f"rig-port-{re.sub(r'[^A-Za-z0-9.]', '-', name)[:150]}.lock"
