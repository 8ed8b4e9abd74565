"""Exclusive ownership of ports, by identity rather than name, with locks visible to every account."""

import errno
import ipaddress
import os
import re
import secrets
import socket
import stat
import struct
import sys
import threading
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from rig.errors import RigError
from rig.transport.wire import TransportError

SCHEME = "tcp://"
DATAGRAMS = "udp://"

Address = tuple[int, tuple[Any, ...]]
"""Family and socket address."""

_OVER_TCP = ("socket://", "rfc2217://")  # URL schemes of pyserial for a TCP port


def tcp_addresses(port: str) -> tuple[Address, ...]:
    """Resolve ``tcp://HOST:PORT``, once for its lock and its connection, in the system's order.

    Raises TransportError if the port has another form, or its host has no address.
    """
    host, colon, number = port.removeprefix(SCHEME).rpartition(":")
    if not (port.startswith(SCHEME) and host and colon and number.isdigit() and 0 < int(number) < 65536):
        raise TransportError(f"{port!r} is not a TCP port; use tcp://HOST:PORT", "no_address")
    try:
        found = socket.getaddrinfo(host.strip("[]"), int(number), type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as problem:
        raise TransportError(f"cannot open port {port}: {problem}", "unknown_host") from problem
    return tuple(dict.fromkeys((int(family), address) for family, _, _, _, address in found))


def udp_addresses(port: str) -> tuple[Address, ...]:
    """Resolve ``udp://HOST:PORT``, as `tcp_addresses` does."""
    return tcp_addresses(SCHEME + port.removeprefix(DATAGRAMS))


def identities(port: str) -> tuple[str, ...]:
    """Return the identities of a port, sorted, so that every process locks them in the same order.

    Two names with a common identity may reach the same device. All addresses of this machine count as one, since a
    listener may be bound to all of them. Raises TransportError if the host of a TCP port has no address.
    """
    if port.startswith(_OVER_TCP):
        url = urlsplit(port)
        port = f"{SCHEME}[{url.hostname}]:{url.port}"
    if port.startswith(SCHEME):
        return tuple(sorted({_of_address("tcp", *address) for address in tcp_addresses(port)}))
    if port.startswith(DATAGRAMS):
        return tuple(sorted({_of_address("udp", *address) for address in udp_addresses(port)}))
    return (port if "://" in port else _of_device(port),)


def _of_address(protocol: str, family: int, address: tuple[Any, ...]) -> str:
    ip = ipaddress.ip_address(address[0])
    mapped = getattr(ip, "ipv4_mapped", None) or ip
    here = mapped.is_loopback or mapped.is_unspecified or _is_here(family, address)
    return f"{protocol}-{'this-machine' if here else mapped}-{address[1]}"


def _is_here(family: int, address: tuple[Any, ...]) -> bool:
    """Return whether an address belongs to this machine; nothing is sent."""
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect(address)
            return bool(probe.getsockname()[0] == address[0])
    except OSError:
        return False


if sys.platform == "win32":

    def _of_device(path: str) -> str:
        r"""Return the name of a COM port: COM12, com12 and \\.\COM12 are one."""
        return re.sub(r"^\\\\[.?]\\", "", path).upper()
else:

    def _of_device(path: str) -> str:
        real = os.path.realpath(path)
        if sys.platform == "darwin":  # A line has two devices there, for calling in and out.
            real = real.replace("/dev/cu.", "/dev/tty.")
        try:
            found = os.stat(real)
        except OSError:
            return real
        if stat.S_ISCHR(found.st_mode):
            return f"device-{os.major(found.st_rdev)}-{os.minor(found.st_rdev)}"
        return f"file-{found.st_dev}-{found.st_ino}"


# Locks that every account of this machine sees, and that the system releases when their process ends.
# POSIX: a record lock on an empty file in a fixed, world-writable folder. The system itself reports the process
# that holds one (F_GETLK), so there is no note that could be forged, left behind, or written through a link.
# Windows uses a lock file, and does not report the process.

FOLDERS = ("/run/lock", "/tmp")
"""Folders for locks; the first world-writable one is used, independent of account and environment."""

_TRIES = 20


@dataclass(frozen=True)
class PortOwner:
    """Process that holds a lock; pid is None if the system does not report it."""

    pid: int | None

    @property
    def same_account(self) -> bool:
        """Whether the process belongs to this account and may be signaled."""
        return self.pid is not None and _same_account(self.pid)

    def __str__(self) -> str:
        if self.pid is None:
            return "another program"
        return f"process {self.pid}" + ("" if self.same_account else " of another account")


class LockHeldError(RigError):
    """Error of a lock that another process holds."""

    default_code = "lock_held"

    def __init__(self, owner: PortOwner) -> None:
        super().__init__(f"in use by {owner}")
        self.owner = owner


if sys.platform == "win32":
    import filelock

    def _same_account(pid: int) -> bool:
        return False  # Windows has no signal that stops a process in order.

    class MachineLock:
        """Lock on a name, by a file that the system keeps open for one process."""

        def __init__(self, name: str) -> None:
            self.path = Path(os.environ.get("PROGRAMDATA", "C:/ProgramData")) / _file_name(name)
            self._lock = filelock.FileLock(self.path, timeout=0, thread_local=False)
            try:
                self._lock.acquire()
            except filelock.Timeout:
                raise LockHeldError(PortOwner(None)) from None

        def release(self) -> None:
            """Release the lock."""
            self._lock.release()

    def lock_owner(name: str) -> PortOwner | None:
        """Return the owner of a lock, without its process id, or None."""
        try:
            MachineLock(name).release()
        except LockHeldError as held:
            return held.owner
        return None

else:
    import fcntl

    def _same_account(pid: int) -> bool:
        if os.path.isdir("/proc/self"):
            with suppress(OSError):
                return os.stat(f"/proc/{pid}").st_uid == os.geteuid()
            return False
        if os.geteuid() == 0:  # Root may signal every process, so this shows nothing.
            return False
        with suppress(OSError):
            os.kill(pid, 0)
            return True
        return False

    # struct flock: the type comes first on Linux, and after the numbers on BSD and macOS.
    _LINUX = sys.platform.startswith("linux")
    _FLOCK = "hhqqi" if _LINUX else "qqihh"
    _QUERY = (fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0) if _LINUX else (0, 0, 0, fcntl.F_WRLCK, os.SEEK_SET)
    _TYPE, _PID = (0, 4) if _LINUX else (3, 2)
    _OPEN = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY

    Inode = tuple[int, int]

    _held: set[Inode] = set()
    """Files that this process has locked; closing any descriptor of one would release its lock."""

    _guard = threading.Lock()
    os.register_at_fork(after_in_child=lambda: _held.clear())

    class MachineLock:
        """Lock on a name, held by this process.

        Parameters
        ----------
        name : str
            Name of the lock, the same in every process.

        Raises
        ------
        LockHeldError
            If another process, or another lock of this one, holds it.
        OSError
            If it cannot be locked: the file is no lock of this program, or closed to this account.
        """

        def __init__(self, name: str) -> None:
            self.path, self._pid = _folder() / _file_name(name), os.getpid()
            with _guard:
                self._fd = self._locked()
                self._inode = _inode(os.fstat(self._fd))
                _held.add(self._inode)

        def release(self) -> None:
            """Release the lock."""
            with _guard:
                if self._inode not in _held or os.getpid() != self._pid:
                    return
                with suppress(OSError):  # A file of another account stays, and anybody may lock it.
                    if _inode(os.lstat(self.path)) == self._inode:
                        self.path.unlink()
                os.close(self._fd)
                _held.discard(self._inode)

        def _locked(self) -> int:
            for _ in range(_TRIES):
                with suppress(FileNotFoundError):
                    if _inode(os.lstat(self.path)) in _held:
                        raise LockHeldError(PortOwner(os.getpid()))
                try:
                    fd = _opened(self.path)
                except FileNotFoundError:
                    _make(self.path)
                    continue
                try:
                    fcntl.lockf(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except (BlockingIOError, PermissionError):
                    owner = _blocker(fd)
                    _close(fd)
                    if owner is not None:
                        raise LockHeldError(owner) from None
                    continue  # The lock was just released.
                with suppress(FileNotFoundError):
                    if _inode(os.lstat(self.path)) == _inode(os.fstat(fd)):
                        return fd
                _close(fd)  # The previous owner removed the file meanwhile.
            raise OSError(errno.EAGAIN, "the lock file keeps changing", str(self.path))

    def lock_owner(name: str) -> PortOwner | None:
        """Return the owner of a lock, or None, without locking, writing or waiting."""
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
        """Open the lock file, which always stays empty."""
        # Without O_CREAT, which Linux refuses for a file of another account (fs.protected_regular).
        fd = os.open(path, os.O_RDWR | _OPEN)
        if not stat.S_ISREG(os.fstat(fd).st_mode):
            os.close(fd)
            raise OSError(errno.EEXIST, "not a lock file of this program", str(path))
        return fd

    def _make(path: Path) -> None:
        """Create an empty file that every account may lock, whatever the umask, in one step."""
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
        """Return the process that has locked a file. A file with several links is not trusted."""
        found = struct.unpack(_FLOCK, fcntl.fcntl(fd, fcntl.F_GETLK, struct.pack(_FLOCK, *_QUERY)))
        if found[_TYPE] == fcntl.F_UNLCK:
            return None
        trusted = found[_PID] > 0 and os.fstat(fd).st_nlink == 1
        return PortOwner(found[_PID] if trusted else None)

    def _close(fd: int) -> None:
        if _inode(os.fstat(fd)) not in _held:
            os.close(fd)

    def _inode(found: os.stat_result) -> Inode:
        return found.st_dev, found.st_ino


def _file_name(name: str) -> str:
    return f"rig-port-{re.sub(r'[^A-Za-z0-9.]', '-', name)[:150]}.lock"


class NotOwnedError(TransportError):
    """Error of a port that is not available; `owner` is the owning process, None if the port cannot be locked."""

    default_code = "in_use"

    def __init__(self, sentence: str, owner: PortOwner | None, code: str | None = None) -> None:
        super().__init__(sentence, code)
        self.owner = owner


class PortOwnership:
    """Ownership of a port by this process, under all of its names and for every account.

    Raises NotOwnedError if another process owns it or it cannot be locked, and TransportError if its host has no
    address.
    """

    def __init__(self, port: str) -> None:
        self._locks: list[MachineLock] = []
        self.names = identities(port)
        try:
            for name in self.names:
                self._locks.append(MachineLock(name))
        except LockHeldError as held:
            self.release()
            raise NotOwnedError(f"port {port} is in use by {held.owner}; end it or wait for it", held.owner) from None
        except OSError as problem:
            self.release()
            raise NotOwnedError(
                f"cannot lock port {port}: {problem.filename}: {problem.strerror}; ask the owner of that file to "
                "remove it",
                None,
                "not_lockable",
            ) from problem

    def release(self) -> None:
        """Release the port."""
        while self._locks:
            self._locks.pop().release()


def port_owner(port: str) -> PortOwner | None:
    """Return the owner of a port; None if it has none or does not exist."""
    try:
        names = identities(port)
    except TransportError:
        return None
    return next((owner for name in names if (owner := lock_owner(name)) is not None), None)


def first_owner(ports: Iterable[str]) -> PortOwner | None:
    """Return the owner of the first port that has one, or None."""
    return next((owner for port in ports if (owner := port_owner(port)) is not None), None)
