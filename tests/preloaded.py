"""Programs forked from a Python that has imported `rig`: a start takes a tenth of a second instead of one and more.

Each is a real process, and a child of the one that begins it: signals, exit codes, pipes and being killed are as
always. So are the processes that it begins with `multiprocessing`. What tests the start itself begins Python anew.
"""

import ctypes
import fcntl
import gc
import inspect
import io
import multiprocessing.util
import os
import pickle
import runpy
import signal
import socket
import subprocess
import sys
import threading
import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sim.workers import TO_THE_GROUP
from tests.waiting import until

POSSIBLE = sys.platform == "linux"
SPAWN_ANEW = getattr(multiprocessing.util, "spawnv_passfds", None)
IMPORTED = (
    *("rig.cli.program", "rig.cli.run", "rig.cli.serve", "rig.cli.jog", "rig.cli.bench", "rig.cli.panel"),
    *("rig.devices.grbl", "rig.devices.mtsics", "sim.devices.grbl", "rig.report.run_report", "rig.panel.app"),
    *("multiprocessing.spawn", "sim.finger_process", "sim.models.fingertip", "sim.contact.warmup"),
    # Of the workers of the suite.
    *("pytest", "jsonschema", "matplotlib.figure", "rig.bench.served", "rig.compare.stimuli", "rig.study.parallel"),
    "rig.design.chooser",  # brings scipy.stats, which takes as long as all else of scipy
)
SET_CHILD_SUBREAPER = 36  # of <linux/prctl.h>: orphans below become our children
PATH = "PYTHONPATH"
LONGEST, MOST_HANDLES = 1 << 18, 32
ENDS = ("p2cread", "p2cwrite", "c2pread", "c2pwrite", "errread", "errwrite")
NOT_HERE = ("preexec_fn", "shell", "executable", "pass_fds")
LEFT_TO_PROGRAMS = [signal.Signals[name] for name in ("SIGTERM", *TO_THE_GROUP)] if POSSIBLE else []


class Server:
    """The other end of a Python that forks programs, which ends with this one: the socket to it, and its process."""

    def __init__(self, near: socket.socket, process: "subprocess.Popen[bytes] | None" = None) -> None:
        self._near, self._process, self._lock = near, process, threading.Lock()

    @classmethod
    def begin(cls, env: Mapping[str, str]) -> "Server":
        near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        code = f"from tests import preloaded; preloaded.import_all(); preloaded.serve({far.fileno()})"
        process = subprocess.Popen(
            [sys.executable, "-c", code], pass_fds=[far.fileno()], stdin=subprocess.DEVNULL,
            cwd=Path(__file__).parents[1], env={**env, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
        far.close()
        return cls(near, process)

    def fork(self, words: Sequence[str], numbers: dict[int, int], **more: Any) -> int:
        """Begin Python with these words and our handles, each as its own of such a number; its process id."""
        ignored = [number for number in LEFT_TO_PROGRAMS if signal.getsignal(number) == signal.SIG_IGN]
        like_us = {"parent": os.getpid(), "cwd": os.getcwd(), "env": dict(os.environ), "ignored": ignored}
        asked = {"words": words, "numbers": list(numbers), "blocked": signal.pthread_sigmask(signal.SIG_BLOCK, [])}
        with self._lock:
            _adopt(True)
            try:
                socket.send_fds(self._near, [pickle.dumps(asked | like_us | more)], list(numbers.values()))
                return int(self._near.recv(LONGEST))
            finally:
                _adopt(False)

    def close(self) -> None:
        self._near.close()
        if self._process is not None:
            self._process.kill()
            self._process.wait()


def _adopt(orphans: bool) -> None:
    assert not ctypes.CDLL(None).prctl(SET_CHILD_SUBREAPER, int(orphans), 0, 0, 0)


_servers: dict[str, Server] = {}


def server(env: Mapping[str, str] = os.environ) -> Server:
    """The one of this process that has this path of modules."""
    path = env.get(PATH, "")
    if path not in _servers:
        _servers[path] = Server.begin(env)
    return _servers[path]


def close() -> None:
    """End all of them."""
    while _servers:
        _servers.popitem()[1].close()


class Popen(subprocess.Popen[Any]):
    """`subprocess.Popen` of a Python, forked where that is possible."""

    def _execute_child(self, *arguments: Any) -> None:
        really = super()._execute_child  # type: ignore[misc]
        asked = inspect.signature(really).bind(*arguments).arguments
        words, env = [os.fspath(word) for word in asked["args"]], dict(asked["env"] or os.environ)
        unbuffered = words[1:2] == ["-u"]
        names = [name for name in {*env, *os.environ} if name.startswith("PYTHON") and name != PATH]
        as_here = words[0] == sys.executable and all(env.get(name) == os.environ.get(name) for name in names)
        if not POSSIBLE or not as_here or any(asked[name] for name in NOT_HERE):
            really(*arguments)
            return
        ends = (asked["p2cread"], asked["c2pwrite"], asked["errwrite"])
        numbers = {number: number if end == -1 else end for number, end in enumerate(ends)}
        cwd = os.path.abspath(asked["cwd"] or ".")
        session = asked["start_new_session"]
        if unbuffered:
            del words[1]
        how = {"env": env, "cwd": cwd, "session": session, "unbuffered": unbuffered}
        self.pid = server(env).fork(words, numbers, **how, forks=True)
        self._child_created = True
        self._close_pipe_fds(*[asked[end] for end in ENDS])  # type: ignore[attr-defined]


def fork_workers() -> None:
    """Have xdist begin its workers so: each would import what the tests of a worker need, and a server of its own.

    The server of a worker is then forked with it.
    """
    from execnet import gateway_base, gateway_io  # xdist is there

    def begin(end: Any, words: Sequence[str], execmodel: Any) -> None:
        end.popen = Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        gateway_base.Popen2IO.__init__(end, end.popen.stdin, end.popen.stdout, execmodel=execmodel)

    gateway_io.Popen2IOMaster.__init__ = begin  # type: ignore[method-assign]


def spawnv_passfds(path: bytes | str, words: Sequence[str], handles: Sequence[int]) -> int:
    """As that of `multiprocessing.util`, by which it begins a process."""
    same = {number: number for number in {0, 1, 2, *handles}}
    return server().fork(list(map(os.fsdecode, words)), same, session=False, unbuffered=False, forks=False)


def import_all() -> None:
    """What most programs would import, and the machine code of the contact's loops."""
    for name in IMPORTED:
        __import__(name)
    sys.modules["sim.contact.warmup"].make_ready()


def serve(far: int) -> None:
    """Fork a program for each request until nobody can ask; in each of them, carry it out."""
    until(lambda: len(os.listdir("/proc/self/task")) == 1)  # No thread survives a fork; one that has ended goes soon.
    for number in LEFT_TO_PROGRAMS:
        signal.signal(number, signal.SIG_IGN)
    gc.freeze()  # or each program looks through all of it when it ends
    asked, handles = _forked(socket.socket(fileno=far))
    while asked["forks"]:  # it has a server of its own, which has no threads either
        near, connection = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        if os.fork():
            connection.close()
            multiprocessing.util.spawnv_passfds = spawnv_passfds
            _servers[os.environ.get(PATH, "")] = Server(near)
            break
        for handle in {near.detach(), *handles}:
            os.close(handle)
        asked, handles = _forked(connection)
    _inherit(asked, handles)
    _run(asked["words"])


def _forked(connection: socket.socket) -> tuple[dict[str, Any], list[int]]:
    """Returns in each program, with what it was asked for and its handles."""
    while True:
        message, handles, _, _ = socket.recv_fds(connection, LONGEST, MOST_HANDLES)
        if not message:
            os._exit(0)
        between = os.fork()
        if not between:
            if os.fork():
                os._exit(0)
            break
        os.waitpid(between, 0)
        for handle in handles:
            os.close(handle)
    asked = pickle.loads(message)
    until(lambda: os.getppid() == asked["parent"])
    connection.send(str(os.getpid()).encode())
    connection.close()
    return asked, handles


def _inherit(asked: dict[str, Any], handles: Sequence[int]) -> None:
    """What a Python begun so has from its parent."""
    above = max(*handles, *asked["numbers"]) + 1
    moved = [fcntl.fcntl(handle, fcntl.F_DUPFD, above) for handle in handles]
    for handle, number in zip(moved, asked["numbers"], strict=True):
        os.dup2(handle, number)
    for handle in {*handles, *moved} - set(asked["numbers"]):
        os.close(handle)
    if asked["session"]:
        os.setsid()
    os.chdir(asked["cwd"])
    os.environ.clear()
    os.environ.update(asked["env"])
    # The streams of the server still believe that they write to its own files.
    unbuffered = asked["unbuffered"] or bool(asked["env"].get("PYTHONUNBUFFERED"))
    out = io.FileIO(1, "w", closefd=False)
    sys.stdin = sys.__stdin__ = io.TextIOWrapper(io.BufferedReader(io.FileIO(0, closefd=False)), "utf-8")
    sys.stdout = sys.__stdout__ = io.TextIOWrapper(
        out if unbuffered else io.BufferedWriter(out),
        "utf-8",
        line_buffering=out.isatty(),
        write_through=unbuffered,
    )
    errors = io.BufferedWriter(io.FileIO(2, "w", closefd=False))
    sys.stderr = sys.__stderr__ = io.TextIOWrapper(errors, "utf-8", "backslashreplace", line_buffering=True)
    for number in LEFT_TO_PROGRAMS:
        begun = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
        signal.signal(number, signal.SIG_IGN if number in asked["ignored"] else begun)
    signal.pthread_sigmask(signal.SIG_SETMASK, asked["blocked"])


def _run(words: Sequence[str]) -> None:
    """Python with these words: -c CODE, -m MODULE or a file, and their arguments."""
    if words[1] == "-B":  # multiprocessing passes it on where nothing compiled is written
        sys.dont_write_bytecode, words = True, [words[0], *words[2:]]
    if words[1] == "-m":
        sys.argv, sys.path[0] = list(words[2:]), os.getcwd()
        runpy.run_module(words[2], run_name="__main__", alter_sys=True)
    elif words[1] == "-c":
        sys.argv, sys.path[0] = ["-c", *words[3:]], ""
        sys.modules["__main__"] = types.ModuleType("__main__")
        exec(compile(words[2], "<string>", "exec"), vars(sys.modules["__main__"]))
    else:
        sys.argv, sys.path[0] = list(words[1:]), str(Path(words[1]).parent)
        runpy.run_path(words[1], run_name="__main__")
