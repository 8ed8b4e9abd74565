"""Hides what Windows lacks from this project, in every Python process whose PYTHONPATH names this folder.

    PYTHONPATH=tests/portable .venv/bin/python -m pytest -n 0 tests/portable

For modules of this program and of the example device, the system has no module or attribute of POSIX alone, and says
that it is Windows. Other packages, and the tests, see the real system. It is no Windows: paths, files, signals,
processes and the console are those of this machine, and `msvcrt` is a stand-in that reads standard input.
"""

import builtins
import os
import re
import select
import socket
import sys
import types
from typing import Any

PROJECT = frozenset({"rig", "sim", "rig_shared", "rig_line_scale"})
MODULES = frozenset({"fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty"})
HIDDEN = {
    "os": """
        fork forkpty getuid geteuid getgid getegid getpgid getpgrp setsid setuid setgid killpg getloadavg nice mkfifo
        openpty ttyname set_blocking O_NONBLOCK O_NOFOLLOW O_CLOEXEC O_NOCTTY O_DIRECTORY O_SYNC fchmod chown fchown
        waitid wait WNOHANG WUNTRACED sched_getaffinity register_at_fork statvfs uname sysconf getpriority
        setpriority pread pwrite posix_fallocate sendfile major minor fchdir fdatasync lchown sync""",
    "signal": """
        SIGALRM SIGUSR1 SIGUSR2 SIGKILL SIGHUP SIGTSTP SIGQUIT SIGTTIN SIGTTOU SIGCONT SIGSTOP SIGCHLD setitimer
        getitimer ITIMER_REAL alarm pause pthread_kill pthread_sigmask sigwait SIG_BLOCK SIG_UNBLOCK SIG_SETMASK""",
    "socket": "AF_UNIX SO_REUSEPORT",
    "sys": "",
}
_HIDDEN = {name: frozenset(re.findall(r"\w+", text)) for name, text in HIDDEN.items()}
SAYS = {"os": {"name": "nt"}, "sys": {"platform": "win32"}, "socket": {"SO_EXCLUSIVEADDRUSE": socket.SO_KEEPALIVE}}


class Hiding(types.ModuleType):
    """Module without the attributes that Windows lacks; what is set goes to the module behind it."""

    def __init__(self, module: types.ModuleType) -> None:
        super().__init__(module.__name__)
        object.__setattr__(self, "_behind", module)

    def __getattribute__(self, name: str) -> Any:
        behind = object.__getattribute__(self, "_behind")
        if name in _HIDDEN[behind.__name__]:
            raise AttributeError(f"module {behind.__name__!r} has no attribute {name!r} on this system")
        return SAYS.get(behind.__name__, {}).get(name) or getattr(behind, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(object.__getattribute__(self, "_behind"), name, value)

    def __delattr__(self, name: str) -> None:
        delattr(object.__getattribute__(self, "_behind"), name)


def _console() -> types.ModuleType:
    module = types.ModuleType("msvcrt")
    module.kbhit = lambda: bool(select.select([sys.stdin], [], [], 0.0)[0])  # type: ignore[attr-defined]
    module.getwch = lambda: os.read(sys.stdin.fileno(), 1).decode("latin-1")  # type: ignore[attr-defined]
    return module


_CONSOLE = _console()
_HIDING = {name: Hiding(module) for name in HIDDEN if (module := __import__(name))}
_import = builtins.__import__


def _hiding_import(name: str, *where: Any, **more: Any) -> Any:
    of = (where[0] if where else more.get("globals")) or {}
    importer = str(of.get("__package__") or of.get("__name__") or "").partition(".")[0]
    if importer not in PROJECT:
        return _import(name, *where, **more)
    if name == "msvcrt":
        return _CONSOLE
    if name in MODULES:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    found = _import(name, *where, **more)
    return _HIDING.get(getattr(found, "__name__", ""), found)


builtins.__import__ = _hiding_import
if "PROGRAMDATA" not in os.environ:
    os.environ["PROGRAMDATA"] = f"/tmp/rig-portable-{os.getuid()}"
    os.makedirs(os.environ["PROGRAMDATA"], exist_ok=True)
