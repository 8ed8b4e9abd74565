"""One port, one owner: under every name, in every environment, for every account; a lock that nobody can forge."""

import json
import os
import signal
import socket
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from rig.transport import TransportError, open_port, ownership, port_owner
from rig.transport.ownership import (
    FOLDERS,
    MachineLock,
    NotOwnedError,
    PortOwner,
    PortOwnership,
    identities,
    lock_owner,
)
from tests.error_codes import raises

pty = pytest.importorskip("pty", reason="needs pseudo-terminals")
fcntl = pytest.importorskip("fcntl", reason="needs record locks")

SOMEBODY, ANOTHER = 60001, 60002
needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can act as other accounts")

# By the name of a port: the code and the owner that whoever asks for it is told, or that it was opened.
ASKS = """\
import json, sys
from rig.transport import NotOwnedError, TransportError, open_port
told = {}
for name in sys.argv[1:]:
    try:
        open_port(name, 9600).close()
        told[name] = "opened"
    except NotOwnedError as error:
        told[name] = error.code, error.owner and error.owner.pid
    except TransportError as error:
        told[name] = error.code, None
print(json.dumps(told))
"""
FOLDERS_OF_ENVIRONMENT = ("TMPDIR", "HOME", "XDG_RUNTIME_DIR", "RIG_RUNTIME_DIR", "RIG_STATE_DIR")


@contextmanager
def elsewhere(do: Callable[[], object], uid: int | None = None, umask: int = 0o022) -> Iterator[tuple[int, str]]:
    """The number of a process of its own, which lives on until the end, and what do() returns or raises there.

    Of an error of a port, its code and the owner's number.
    """
    (told, tells), (ends, end) = os.pipe(), os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads: none of them is needed there
        pid = os.fork()
    if pid == 0:
        try:
            os.close(end)
            os.umask(umask)
            if uid is not None:
                os.setgroups([])
                os.setgid(uid)
                os.setuid(uid)
            try:
                kept = do()
                said = "done" if kept is None else str(kept)
            except NotOwnedError as error:
                said = f"{error.code} {error.owner and error.owner.pid}"
            except Exception as error:
                said = str(error)
            os.write(tells, f"{said}\n".encode())
            os.read(ends, 1)
        finally:
            os._exit(0)
    os.close(tells)
    os.close(ends)
    try:
        with open(told, encoding="utf-8") as answer:
            yield pid, answer.readline().strip()
    finally:
        os.close(end)
        os.waitpid(pid, 0)


def _owner(port: str) -> PortOwner:
    found = port_owner(port)
    assert found is not None
    return found


_owned: list[PortOwnership] = []


def owning(port: str) -> Callable[[], str]:
    """Own a port, until the process ends."""

    def own() -> str:
        _owned.append(PortOwnership(port))
        return "owned"

    return own


@pytest.fixture
def gateway() -> Iterator[int]:
    """A gateway that takes several clients, on all addresses of this machine; its number."""
    with socket.create_server(("", 0)) as server:
        yield server.getsockname()[1]


@pytest.fixture
def line() -> Iterator[str]:
    """A serial port."""
    far, near = pty.openpty()
    yield os.ttyname(near)
    os.close(far)
    os.close(near)


@pytest.fixture
def place(gateway: int) -> Iterator[Path]:
    """Where the lock of the gateway's port lies, or would."""
    folder = next(Path(one) for one in FOLDERS if os.stat(one).st_mode & 0o1777 == 0o1777)
    path = folder / f"rig-port-tcp-this-machine-{gateway}.lock"
    path.unlink(missing_ok=True)  # a lock is an empty file that stays: another test may have had this port
    yield path
    with suppress(FileNotFoundError):
        path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()


# --- under every name ---


def _tcp_names(number: int) -> list[str]:
    hosts = ["127.0.0.1", "localhost", "LOCALHOST", "localhost.", "127.1", "2130706433", "0x7f.1", "0", "0.0.0.0",
             "127.0.0.2", "[::1]", "[::]", "[::ffff:127.0.0.1]", "[::ffff:7f00:1]", socket.gethostname()]  # fmt: skip
    return [f"tcp://{host}:{number}" for host in hosts] + [
        f"socket://localhost:{number}", f"rfc2217://127.1:{number}"
    ]  # fmt: skip


def _serial_names(line: str, folder: Path) -> list[str]:
    folder.mkdir(exist_ok=True)
    (folder / "by-id").symlink_to(line)
    (folder / "again").symlink_to(folder / "by-id")
    found = [line, str(folder / "by-id"), str(folder / "again"), f"/dev/../{line}", f"spy://{line}"]
    if os.geteuid() == 0:  # another node of the same device, as a container has it
        os.mknod(folder / "node", 0o600 | 0o020000, os.stat(line).st_rdev)
        found.append(str(folder / "node"))
    return found


def _there(name: str) -> bool:
    """Whether the system can make anything of it."""
    if not name.startswith("tcp://"):
        return True
    with suppress(OSError):
        return bool(socket.getaddrinfo(name.removeprefix("tcp://").rpartition(":")[0].strip("[]"), 1))
    return False


@pytest.mark.parametrize("environment", ["as here", "all folders elsewhere"])
@pytest.mark.parametrize("kind", ["tcp", "serial"])
def test_a_second_controller_is_refused_under_every_name_and_in_every_environment(
    kind: str, environment: str, gateway: int, line: str, tmp_path: Path
) -> None:
    names = _tcp_names(gateway) if kind == "tcp" else _serial_names(line, tmp_path / "dev")
    (tmp_path / "other").mkdir()
    other = {} if environment == "as here" else dict.fromkeys(FOLDERS_OF_ENVIRONMENT, str(tmp_path / "other"))
    wire = open_port(names[0], 9600)
    try:
        asked = subprocess.run(
            [sys.executable, "-c", ASKS, *names],
            env={**os.environ, **other}, capture_output=True, text=True, check=True,
        )  # fmt: skip
    finally:
        wire.close()
    told = json.loads(asked.stdout)
    assert {name: told[name] for name in names if _there(name) and told[name] != ["in_use", os.getpid()]} == {}
    assert told[names[0]] == ["in_use", os.getpid()]


def test_a_closed_port_is_free_under_every_name(gateway: int, place: Path) -> None:
    wire = open_port(f"tcp://localhost:{gateway}", 9600)
    assert port_owner(f"tcp://127.1:{gateway}") == PortOwner(os.getpid())
    wire.close()
    assert port_owner(f"tcp://127.1:{gateway}") is None
    assert not place.exists()
    open_port(f"tcp://127.1:{gateway}", 9600).close()


def test_ports_of_other_machines_and_numbers_are_other_ports() -> None:
    names = ["tcp://192.0.2.1:502", "tcp://192.0.2.2:502", "tcp://192.0.2.1:503", "tcp://[2001:db8::1]:502"]
    assert len({identities(name) for name in names}) == len(names)
    assert identities("tcp://[::ffff:192.0.2.1]:502") == identities("tcp://192.0.2.1:502")


def test_all_addresses_of_this_machine_are_one_port(monkeypatch: pytest.MonkeyPatch) -> None:
    assert ownership._is_here(socket.AF_INET, ("127.0.0.1", 9))
    assert not ownership._is_here(socket.AF_INET, ("192.0.2.7", 9))
    monkeypatch.setattr(ownership, "_is_here", lambda family, address: address[0] == "192.0.2.7")
    assert identities("tcp://192.0.2.7:5") == identities("tcp://127.0.0.1:5") != identities("tcp://192.0.2.8:5")


@pytest.mark.parametrize("port", ["tcp://no-such-host.invalid:5", "tcp://a..b:5", f"tcp://{'x' * 70}:5"])
def test_a_host_without_an_address_is_refused_in_one_line(port: str) -> None:
    with raises(TransportError, "unknown_host", port=port) as caught:
        PortOwnership(port)
    assert len(str(caught.value).splitlines()) == 1
    assert port_owner(port) is None


def test_a_port_that_is_exchanged_while_it_is_opened_is_refused(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import serial

    far, near = pty.openpty()
    link, opens = tmp_path / "link", serial.Serial.open
    link.symlink_to(line)

    def exchanged(wire: Any) -> None:
        opens(wire)
        link.unlink()
        link.symlink_to(os.ttyname(near))

    monkeypatch.setattr(serial.Serial, "open", exchanged)
    try:
        with raises(TransportError, "exchanged", port=str(link)):
            open_port(str(link), 9600)
        assert port_owner(line) is None
    finally:
        os.close(far)
        os.close(near)


# --- the lock ---


def test_a_lock_ends_with_its_process(gateway: int) -> None:
    port = f"tcp://127.0.0.1:{gateway}"
    with elsewhere(owning(port)) as (pid, said):
        assert said == "owned"
        assert port_owner(port) == PortOwner(pid)
        os.kill(pid, signal.SIGKILL)
    PortOwnership(port).release()


def test_asking_for_the_owner_releases_no_lock(gateway: int) -> None:
    """To close any descriptor of a file would end this process's lock on it."""
    port = f"tcp://127.0.0.1:{gateway}"
    own = PortOwnership(port)
    for _ in range(3):
        assert port_owner(port) == PortOwner(os.getpid())
        with raises(NotOwnedError, "in_use", port=port, pid=os.getpid()):
            PortOwnership(port)
    with elsewhere(lambda: _owner(port).pid) as (_, said):
        assert said == str(os.getpid()), "a fork owns nothing"
    with elsewhere(owning(port)) as (_, said):
        assert said == f"in_use {os.getpid()}"
    own.release()
    own.release()


@pytest.mark.parametrize("late", [False, True], ids=["there before", "made meanwhile"])
def test_a_second_name_of_a_held_lock_releases_nothing(
    gateway: int, place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, late: bool
) -> None:
    """A hard link that somebody made from the place of one lock to another one's."""
    other = f"tcp-this-machine-{gateway}0"
    own, link = MachineLock(f"tcp-this-machine-{gateway}"), place.with_name(f"rig-port-{other}.lock")
    os.link(place, link)
    try:
        with monkeypatch.context() as patch:
            if late:
                patch.setattr(os, "lstat", lambda path: tmp_path.stat())
            assert lock_owner(other) == (None if late else PortOwner(os.getpid()))
        with elsewhere(owning(f"tcp://127.0.0.1:{gateway}")) as (_, said):
            assert said == "in_use None", "of a file with two names nobody says whose lock it is"
    finally:
        own.release()
        link.unlink()


@pytest.mark.parametrize("link", [os.link, os.symlink], ids=["second name", "link"])
def test_a_foreign_file_in_the_place_of_a_lock_names_no_owner(
    gateway: int, place: Path, tmp_path: Path, link: Callable[[Path, Path], None]
) -> None:
    """Whoever has locked a file of their own is no owner of a port, and is not to be signalled."""
    own = tmp_path / "own"
    own.write_text("precious")
    try:
        link(own, place)
    except OSError:
        pytest.skip("the folder of temporary files is on another disk")

    def locks() -> None:
        fcntl.lockf(os.open(own, os.O_RDWR), fcntl.LOCK_EX)

    with elsewhere(locks):
        owner = port_owner(f"tcp://127.0.0.1:{gateway}")
        assert owner == (PortOwner(None) if link is os.link else None)
        assert owner is None or not owner.same_account
    assert own.read_text() == "precious"


@pytest.mark.parametrize("kind", ["link", "dangling", "pipe", "folder", "socket", "text"])
def test_a_foreign_file_in_the_place_of_a_lock_is_neither_written_nor_waited_for(
    kind: str, gateway: int, place: Path, tmp_path: Path
) -> None:
    target = tmp_path / "target"
    with ExitStack() as stack:
        match kind:
            case "link":
                target.write_text("precious")
                place.symlink_to(target)
            case "dangling":
                place.symlink_to(target)
            case "pipe":
                os.mkfifo(place, 0o666)
            case "folder":
                place.mkdir()
            case "socket":
                stack.enter_context(socket.socket(socket.AF_UNIX)).bind(str(place))
            case "text":
                place.write_text("4711")
        port = f"tcp://127.0.0.1:{gateway}"
        assert port_owner(port) is None
        if kind == "text":
            PortOwnership(port).release()
        else:
            with raises(NotOwnedError, "not_lockable", port=port, path=str(place)) as refused:
                PortOwnership(port)
            assert refused.value.owner is None
            assert len(str(refused.value).splitlines()) == 1
    assert target.exists() == (kind == "link")
    if kind == "link":
        assert target.read_text() == "precious"


def test_a_lock_whose_file_is_removed_meanwhile_is_taken_again(
    gateway: int, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever let go of it has removed it, and the next one has made another."""
    real, gone = fcntl.lockf, []

    def late(fd: int, how: int) -> None:
        if not gone:
            place.unlink()
            gone.append(fd)
        real(fd, how)

    monkeypatch.setattr(fcntl, "lockf", late)
    own = MachineLock(f"tcp-this-machine-{gateway}")
    monkeypatch.undo()
    with elsewhere(owning(f"tcp://127.0.0.1:{gateway}")) as (_, said):
        assert said == f"in_use {os.getpid()}"
    own.release()


def test_a_port_is_locked_on_a_full_disk(gateway: int) -> None:
    import resource

    def owns() -> str:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
        return owning(f"tcp://127.0.0.1:{gateway}")()

    with elsewhere(owns) as (pid, said):
        assert said == "owned"
        assert port_owner(f"tcp://127.0.0.1:{gateway}") == PortOwner(pid)


# --- accounts ---


@needs_root
@pytest.mark.parametrize("umask", [0o022, 0o077])
@pytest.mark.parametrize("killed", [False, True], ids=["ended", "killed"])
def test_several_accounts_work_one_after_another(gateway: int, place: Path, umask: int, killed: bool) -> None:
    port = f"tcp://127.0.0.1:{gateway}"
    for uid in (SOMEBODY, ANOTHER, 0, SOMEBODY):
        with elsewhere(owning(port), uid, umask) as (pid, said):
            assert said == "owned"
            assert place.stat().st_mode & 0o777 == 0o666
            if killed:
                os.kill(pid, signal.SIGKILL)
    assert place.exists(), "of a process that did not release it"


@needs_root
def test_an_owner_of_another_account_is_named_as_one(gateway: int) -> None:
    port = f"tcp://127.0.0.1:{gateway}"
    with elsewhere(owning(port), SOMEBODY) as (pid, said):
        assert said == "owned"
        owner = port_owner(port)
        assert owner == PortOwner(pid)
        assert not owner.same_account
        with elsewhere(owning(port), ANOTHER) as (_, told):
            assert told == f"in_use {pid}"
        for account, ours in ((ANOTHER, False), (SOMEBODY, True)):
            with elsewhere(lambda: _owner(port).same_account, account) as (_, told):
                assert told == str(ours)


@needs_root
def test_a_lock_closed_to_other_accounts_is_refused_in_one_line(gateway: int, place: Path) -> None:
    def shut() -> None:
        os.close(os.open(place, os.O_CREAT | os.O_WRONLY, 0o600))

    port = f"tcp://127.0.0.1:{gateway}"
    with elsewhere(shut, SOMEBODY) as (_, said):
        assert said == "done"
    with elsewhere(owning(port), ANOTHER) as (_, said):
        assert said == "not_lockable None"
    with elsewhere(owning(port), SOMEBODY) as (_, said):
        assert said == "owned"
