"""Whether and how soon `rig stop` has its bytes on the wire, whatever stands in the way.

    .venv/bin/python -m tests.faults.obstacles --busy 4

`rig stop`, in a process of its own, for each obstacle: full disks, folders that are missing, forged notes, broken
configurations, locks, and owners that hang. A board behind a TCP gateway or a serial port notes what comes and when.
Start-up is from the beginning of the process to where the command's module is there, the rest from there to the first
byte. tests/rig/test_stopping_needs_nothing.py has the promises.
"""

import json
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from rig.transport.ownership import MachineLock, identities
from studies.posix import os, pty, resource, tty

STOP = b"!\x18"
SOMEBODY = 60001
_ANSWERS = {b"\x18": b"\r\nGrbl 1.1h ['$' for help]\r\n", b"?": b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n"}
_DEADLINE_S = 60.0
_BEGIN = """\
import sys, time
import rig.cli.stop
print("begins", time.monotonic(), file=sys.stderr, flush=True)
from rig.cli import main
main()
"""
_OWNER = """\
import os, signal, sys, time
from rig.transport import open_port
port, announced = sys.argv[1:]
wire = open_port(port, 9600)
if announced == "announced":
    from rig.control.client import Announcement
    from rig.control.owner_socket import ControlSocket
    about = Announcement(pid=os.getpid(), kind="run", virtual=False, ports=(port,), began_unix_s=time.time())
    ControlSocket(about, {"stop": lambda request: {}}).__enter__()
print("ready", flush=True)
os.kill(os.getpid(), signal.SIGSTOP)
"""
_HOLDS = """\
import fcntl, os, sys, time
fcntl.{kind}(os.open(sys.argv[1], os.O_RDWR), fcntl.LOCK_EX)
print("ready", flush=True)
time.sleep(1000)
"""
BUSY = "while True: pass"


class Board:
    """A board that notes what comes, and when; it answers a reset and a question."""

    def __init__(self) -> None:
        self.heard: list[tuple[float, bytes]] = []

    @property
    def first_s(self) -> float:
        """When the first byte came; not a number where none did."""
        return self.heard[0][0] if self.heard else float("nan")

    @property
    def all(self) -> bytes:
        """All that came."""
        return b"".join(piece for _, piece in self.heard)

    def take(self, data: bytes) -> bytes:
        """What came; what is answered."""
        self.heard.append((time.monotonic(), data))
        return b"".join(answer for byte, answer in _ANSWERS.items() if byte in data)

    @contextmanager
    def behind_tcp(self, clients: int = 100) -> Iterator[str]:
        """A gateway for so many clients; those beyond are turned away."""
        with socket.create_server(("127.0.0.1", 0)) as server:
            there: list[socket.socket] = []

            def serve() -> None:
                while True:
                    ready = select.select([server.fileno(), *map(socket.socket.fileno, there), ended], [], [])[0]
                    if ended in ready:
                        return
                    if server.fileno() in ready:
                        client, _ = server.accept()
                        there.append(client) if len(there) < clients else client.close()
                    for one in [one for one in there if one.fileno() in ready]:
                        with suppress(OSError):
                            data = one.recv(4096)
                            if data:
                                one.sendall(self.take(data))
                                continue
                        there.remove(one)
                        one.close()

            ended, end = os.pipe()
            thread = threading.Thread(target=serve, daemon=True)
            thread.start()
            try:
                yield f"tcp://127.0.0.1:{server.getsockname()[1]}"
            finally:
                os.write(end, b"x")
                thread.join(_DEADLINE_S)
                os.close(ended)
                os.close(end)
                for one in there:
                    one.close()

    @contextmanager
    def behind_serial(self) -> Iterator[str]:
        """A serial port."""
        far, near = pty.openpty()
        tty.setraw(near)
        ended, end = os.pipe()

        def serve() -> None:
            while ended not in (ready := select.select([far, ended], [], [])[0]):
                if far in ready:
                    os.write(far, self.take(os.read(far, 4096)))

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        try:
            yield os.ttyname(near)
        finally:
            os.write(end, b"x")
            thread.join(_DEADLINE_S)
            for one in (far, near, ended, end):
                os.close(one)


@dataclass
class StopScene:
    """What `rig stop` finds: a board and the way to it, a configuration, an environment, and bystanders."""

    folder: Path
    board: Board
    stack: ExitStack
    port: str = ""
    config: str = "[stage]\nport = '{port}'\n"
    environment: dict[str, str] = field(default_factory=dict)
    limits: tuple[int, ...] = ()  # resource limits of 0
    bystanders: list["subprocess.Popen[str]"] = field(default_factory=list)
    owner: int | None = None

    def bystander(self) -> int:
        """A process of this account that has nothing to do with it; a signal would end it."""
        self.bystanders.append(self.begun("import time; print('ready', flush=True); time.sleep(1000)"))
        return self.bystanders[-1].pid

    def hung_owner(self, announced: str = "no") -> None:
        """A process that owns the port and is stopped by the system."""
        self.owner = self.begun(_OWNER, self.port, announced).pid
        os.waitpid(self.owner, os.WUNTRACED)

    def lock_file(self) -> Path:
        """Where the lock of the port lies."""
        lock = MachineLock(identities(self.port)[0])
        path: Path = lock.path
        lock.release()
        self.stack.callback(path.unlink, missing_ok=True)
        return path

    def begun(self, code: str, *words: str) -> "subprocess.Popen[str]":
        """A process, once it says that it is ready."""
        process = subprocess.Popen(
            [sys.executable, "-c", code, *words],
            env={**os.environ, **self.environment}, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self.stack.callback(_ended, process)
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        return process


def _ended(process: "subprocess.Popen[str]") -> None:
    process.kill()
    process.communicate()


@dataclass(frozen=True)
class Stopped:
    """What became of one `rig stop`."""

    code: int
    out: str
    err: str
    heard: bytes
    startup_s: float
    to_byte_s: float
    bystanders_live: bool
    owner: int | None


Obstacle = Callable[[StopScene], None]


def _tcp(scene: StopScene, clients: int = 100) -> None:
    scene.port = scene.stack.enter_context(scene.board.behind_tcp(clients))


def _nothing(scene: StopScene) -> None:
    _tcp(scene)


def _full_disk(scene: StopScene) -> None:
    """No file takes a byte, so that no folder is usable for temporary ones."""
    _tcp(scene)
    scene.limits = (resource.RLIMIT_FSIZE,)


def _no_folders(scene: StopScene) -> None:
    _tcp(scene)
    names = (
        "TMPDIR",
        "HOME",
        "XDG_RUNTIME_DIR",
        "XDG_STATE_HOME",
        "RIG_RUNTIME_DIR",
        "RIG_STATE_DIR",
        "RIG_CACHE_DIR",
    )
    scene.environment = dict.fromkeys((*names, "PYTHONUSERBASE"), "/proc/nowhere/at/all")


def _linked_runtime(scene: StopScene) -> None:
    _tcp(scene)
    link = scene.folder / "runtime"
    link.symlink_to(scene.folder)
    scene.environment = {"RIG_RUNTIME_DIR": str(link)}


def _forged_notes(scene: StopScene) -> None:
    """Of an owner that is none: as versions before wrote them, and as processes announce themselves."""
    _tcp(scene)
    victim, runtime = scene.bystander(), scene.folder / "runtime"
    runtime.mkdir(mode=0o700)
    scene.environment = {"TMPDIR": str(scene.folder), "RIG_RUNTIME_DIR": str(runtime)}
    old = scene.folder / f"rig-port-{scene.port.replace('://', '-').replace(':', '-')}"
    old.with_name(f"{old.name}.owner").write_text(str(victim))
    Path(f"{old}.lock").touch()
    scene.begun(_HOLDS.format(kind="flock"), f"{old}.lock")
    note = {"pid": victim, "kind": "run", "virtual": False, "ports": [scene.port], "began_unix_s": 1.0,
            "address": str(runtime / "none.sock"), "key": "00" * 32}  # fmt: skip
    (runtime / f"{victim}.json").write_text(json.dumps(note))


def _forged_lock(scene: StopScene) -> None:
    """In place of the lock a second name of a file that a process of this account has locked for itself."""
    _tcp(scene)
    place, own = scene.lock_file(), scene.folder / "own"
    own.touch()
    scene.bystanders.append(scene.begun(_HOLDS.format(kind="lockf"), str(own)))
    try:
        os.link(own, place)
    except OSError:  # another disk: the lock itself, held by nobody who owns a port
        place.touch()


def _habits(scene: StopScene) -> None:
    _tcp(scene)
    scene.config += "[habits]\nclearance_mm = 'far'\n[no_such_table]\nkey = 1\n"


def _not_toml(scene: StopScene) -> None:
    _tcp(scene)
    scene.config = "title = \n" + scene.config + "[habits]\nclearance_mm = = 3\n"


def _stage_values(scene: StopScene) -> None:
    _tcp(scene)
    scene.config += "travel_mm = 'long'\nresolution_mm = -1\nno_such_key = 3\n[stage.drives.x]\ndevice_id = 'one'\n"


def _linked_lock(scene: StopScene) -> None:
    _tcp(scene)
    scene.lock_file().symlink_to(scene.folder / "target")


def _hung(scene: StopScene) -> None:
    _tcp(scene)
    scene.hung_owner()


def _hung_announced(scene: StopScene) -> None:
    _tcp(scene)
    scene.environment = {"RIG_RUNTIME_DIR": str(scene.folder / "runtime")}
    scene.hung_owner("announced")


def _hung_full_disk(scene: StopScene) -> None:
    _hung_announced(scene)
    scene.limits = (resource.RLIMIT_FSIZE,)


OBSTACLES: dict[str, Obstacle] = {
    "nothing": _nothing,
    "disk and temporary folders full": _full_disk,
    "no folder there at all": _no_folders,
    "runtime folder is a link": _linked_runtime,
    "forged notes of an owner": _forged_notes,
    "forged lock": _forged_lock,
    "wrong [habits], unknown table": _habits,
    "configuration is not TOML": _not_toml,
    "wrong values in [stage]": _stage_values,
    "lock cannot be taken": _linked_lock,
    "owner hangs": _hung,
    "announced owner hangs, disk full": _hung_full_disk,
}
"""Those through which the bytes go out."""


def _nobody_listens(scene: StopScene) -> None:
    _tcp(scene)
    number = scene.port.rpartition(":")[2]
    scene.stack.close()
    scene.port = f"tcp://127.0.0.1:{number}"


def _no_configuration(scene: StopScene) -> None:
    _tcp(scene)
    scene.config = ""


def _wrong_port(scene: StopScene) -> None:
    _tcp(scene)
    scene.config = "[stage]\nport = ''\n"


WALLS: dict[str, Obstacle] = {
    "nobody listens": _nobody_listens,
    "no configuration": _no_configuration,
    "port is not said": _wrong_port,
}
"""Those through which nothing can go."""


def stopped(obstacle: Obstacle, folder: Path, *options: str) -> Stopped:
    """One `rig stop` behind an obstacle."""
    board = Board()
    with ExitStack() as stack:
        scene = StopScene(folder, board, stack)
        obstacle(scene)
        config = folder / "rig.toml"
        if scene.config:
            config.write_text(scene.config.format(port=scene.port), encoding="utf-8")

        def limited() -> None:
            for one in scene.limits:
                resource.setrlimit(one, (0, 0))

        began_s = time.monotonic()
        process = subprocess.Popen(
            [sys.executable, "-c", _BEGIN, "stop", "--config", str(config), *options],
            env={**os.environ, **scene.environment}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            preexec_fn=limited if scene.limits else None,
        )  # fmt: skip
        try:
            out, err = process.communicate(timeout=_DEADLINE_S)
        finally:
            process.kill()
        first, _, rest = err.partition("\n")
        begins_s = float(first.removeprefix("begins "))
        return Stopped(
            process.returncode, out, rest, board.all, begins_s - began_s, board.first_s - begins_s,
            all(one.poll() is None for one in scene.bystanders), scene.owner,
        )  # fmt: skip
