"""The private socket of the process that owns the ports: requests, attacks, and processes that hang or end."""

import errno
import os
import signal
import socket
import stat
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, suppress
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import filelock
import pytest

import rig.control.client as announcements
import rig.control.connection as control_connection
import rig.control.owner_socket as control_socket
from rig.control.client import Announced, Announcement, ControlError, RefusedError, announced, runtime_folder
from rig.control.connection import MOST_BYTES, LimitedConnection, PrivateListener, connected, proven, stop_message
from rig.control.owner_socket import ControlSocket
from rig.errors import RigError
from tests.error_codes import raises
from tests.preloaded import Popen
from tests.waiting import DEADLINE_S, until

OWNER = """
import os, sys
from rig.control.client import Announcement
from rig.control.owner_socket import ControlSocket

about = Announcement(pid=os.getpid(), kind="run", virtual=True, ports=("a", "b"), began_unix_s=5.0)
with ControlSocket(about, {"status": lambda _: {"state": "planning"}, "end": lambda _: os._exit(3)}):
    print("ready", flush=True)
    sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Of announcements; short enough for a socket's path."""
    monkeypatch.setenv("RIG_RUNTIME_DIR", str(tmp_path / "r"))
    return tmp_path / "r"


@pytest.fixture
def elsewhere() -> Iterator[subprocess.Popen[str]]:
    """An owner in a process of its own, which ends when its input does."""
    with Popen([sys.executable, "-c", OWNER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


def _owner(**answers: Callable[[Mapping[str, Any]], Mapping[str, Any]]) -> ControlSocket:
    about = Announcement(pid=os.getpid(), kind="run", virtual=False, ports=("/dev/a",), began_unix_s=7.0)
    return ControlSocket(about, answers)


def _only() -> Announced:
    (one,) = announced()
    return one


def _raw(one: Announced) -> socket.socket:
    end = socket.socket(socket.AF_UNIX)
    end.connect(one.address)
    end.settimeout(DEADLINE_S)
    return end


# --- requests ---


def test_a_request_reaches_its_handler_and_returns_the_reply() -> None:
    heard: list[Mapping[str, Any]] = []

    def answer(request: Mapping[str, Any]) -> dict[str, Any]:
        heard.append(request)
        return {"state": "running"}

    with _owner(jog=answer, stop=answer):
        assert _only().ask("jog", axis="x", sign=-1) == {"ok": True, "state": "running"}
        assert _only().ask("stop") == _only().post_stop(by="panel")(DEADLINE_S) == {"ok": True, "state": "running"}
    assert heard == [{"do": "jog", "axis": "x", "sign": -1}, {"do": "stop"}, {"do": "stop", "by": "panel"}]


def _fail(_: object) -> dict[str, Any]:
    raise RuntimeError("the board\n is gone")


def _fail_with_a_code(_: object) -> dict[str, Any]:
    raise RigError("the board is\n not there", "no_board")


@pytest.mark.parametrize(
    ("answer", "code", "told"),
    [
        (_fail, "refused", "the board is gone"),
        (_fail_with_a_code, "no_board", "the board is not there"),
        (lambda _: {"ok": False, "problem": "not now"}, "refused", "not now"),
        (lambda _: {"force_gwt": float("nan")}, "refused", "Out of range float values are not JSON compliant"),
    ],
)
@pytest.mark.parametrize("request_", ["do", "stop"])
def test_a_refusal_is_one_line_with_a_code(answer: Any, code: str, told: str, request_: str) -> None:
    with _owner(**{request_: answer}), raises(RefusedError, code) as refused:
        _only().ask(request_)
    assert str(refused.value).startswith(told)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("request_", ["fly", "__class__"])
def test_an_unknown_request_is_refused_with_the_known_ones(request_: str) -> None:
    refused = raises(RefusedError, "cannot_be_asked", do=request_)
    with _owner(status=lambda _: {}, stop=lambda _: {}), refused as caught:
        _only().ask(request_)
    assert str(caught.value).endswith(" status, stop")


def test_a_stop_is_answered_while_another_request_takes_its_time() -> None:
    begun, over = threading.Event(), threading.Event()
    slow: list[dict[str, Any]] = []

    def home(_: object) -> dict[str, Any]:
        begun.set()
        return {"homed": over.wait(DEADLINE_S)}

    with _owner(home=home, stop=lambda _: {"stopped": True}):
        one = _only()
        asking = threading.Thread(target=lambda: slow.append(one.ask("home", within_s=DEADLINE_S)))
        asking.start()
        assert begun.wait(DEADLINE_S)
        assert one.ask("stop", within_s=DEADLINE_S) == {"ok": True, "stopped": True}
        assert slow == []
        over.set()
        asking.join(DEADLINE_S)
    assert slow == [{"ok": True, "homed": True}]


def test_a_stop_waits_for_its_place_behind_many_clients(monkeypatch: pytest.MonkeyPatch) -> None:
    free, trying, accept = threading.Event(), threading.Event(), PrivateListener.accept

    def late(listener: PrivateListener, patience_s: float) -> Any:
        assert free.wait(DEADLINE_S)
        return accept(listener, patience_s)

    def tried(address: str, within_s: float) -> Any:
        trying.set()
        return connected(address, within_s)

    monkeypatch.setattr(PrivateListener, "accept", late)
    monkeypatch.setattr(announcements, "connected", tried)
    monkeypatch.setattr(control_connection, "_BACKLOG", 0)  # a place for one
    replies: list[object] = []
    with _owner(stop=lambda _: {"stopped": True}), closing(_raw(_only())):
        asking = threading.Thread(target=lambda: replies.append(_only().ask("stop", within_s=DEADLINE_S)))
        asking.start()
        assert trying.wait(DEADLINE_S)
        free.set()
        asking.join(DEADLINE_S)
    assert replies == [{"ok": True, "stopped": True}]


def test_a_stop_whose_sender_has_gone_is_carried_out(monkeypatch: pytest.MonkeyPatch) -> None:
    stopped, gone, admit = threading.Event(), threading.Event(), LimitedConnection.admit

    def late(client: LimitedConnection, key: bytes) -> bytes | None:
        assert gone.wait(DEADLINE_S)
        return admit(client, key)

    def stop(_: object) -> dict[str, Any]:
        stopped.set()
        return {}

    monkeypatch.setattr(LimitedConnection, "admit", late)
    with _owner(stop=stop):
        one = _only()
        with connected(one.address, DEADLINE_S) as connection:
            connection.send_bytes(stop_message(bytes.fromhex(one.key), "")[1])
        gone.set()
        assert stopped.wait(DEADLINE_S)


def test_a_message_that_is_too_long_is_not_received() -> None:
    near, far = Pipe()
    with near, far:
        near.send_bytes(bytes(MOST_BYTES + 1))
        with pytest.raises(OSError, match="length"):
            LimitedConnection(far, DEADLINE_S).recv_bytes()


# --- attacks ---


def _sends(data: bytes, *, ends: bool = False) -> Callable[[socket.socket], None]:
    def attack(end: socket.socket) -> None:
        end.sendall(data)
        if ends:
            end.close()

    return attack


ATTACKS = {
    "silent": _sends(b""),
    "half a message": _sends(b"\x00\x00"),
    "half a stop": _sends(b"\x00\x00\x00\x30" + bytes(20)),
    "disconnects in the middle": _sends(b"\x00\x00\x00\x30" + bytes(20), ends=True),
    "disconnects in the handshake": _sends(b"\x00\x00\x00\x05hello", ends=True),
    "garbage": _sends(b"GET / HTTP/1.1\r\n\r\n"),
    "a pickle": _sends(b"\x00\x00\x00\x10\x80\x04cos\nsystem\n(X"),
    "an oversize message": _sends(b"\x7f\xff\xff\xff" + bytes(1000)),
    "an oversize first message": _sends(b"\x00\x00\x02\x00" + bytes(512)),
}


@pytest.mark.parametrize("clients", [1, 100])
@pytest.mark.parametrize("name", ATTACKS)
def test_a_stop_is_carried_out_beside_an_attack(name: str, clients: int) -> None:
    done: list[object] = []

    def stop(request: object) -> dict[str, Any]:
        done.append(request)
        return {"stopped": True}

    with _owner(stop=stop), ExitStack() as hanging:
        one = _only()
        for _ in range(clients):
            end = hanging.enter_context(closing(_raw(one)))
            with suppress(BrokenPipeError, ConnectionResetError):  # It may be refused before all is sent.
                ATTACKS[name](end)
        assert one.ask("stop", within_s=DEADLINE_S)["stopped"]
        assert one.ask("stop", within_s=DEADLINE_S)["stopped"]
    assert done == [{"do": "stop"}] * 2
    until(lambda: not [thread for thread in threading.enumerate() if thread.name == "control"])


@pytest.mark.parametrize("name", ["silent", "half a message", "half a stop"])
def test_a_silent_client_is_disconnected(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(control_socket, "PATIENCE_S", 0.01)
    with _owner(stop=lambda _: {}), closing(_raw(_only())) as end:
        ATTACKS[name](end)
        assert end.recv(4096) == b""


@pytest.mark.parametrize("do", ["stop", "home"])
def test_another_key_is_refused_and_nothing_is_done(do: str) -> None:
    done: list[object] = []

    def note(request: Mapping[str, Any]) -> dict[str, Any]:
        done.append(request)
        return {}

    with _owner(stop=note, home=note):
        other = _only().model_copy(update={"key": "00" * 32})
        with pytest.raises(ControlError) as caught:
            other.ask(do, within_s=DEADLINE_S)
        assert caught.value.code in ("another_key", "broken_off")
        with closing(connected(_only().address, DEADLINE_S)) as connection:
            connection.send_bytes(proven(bytes.fromhex(_only().key), b"stop", bytes(16))[:-1])
            with pytest.raises((EOFError, OSError)):
                LimitedConnection(connection, DEADLINE_S).recv_bytes()
    assert done == []


def test_an_impostor_at_the_address_is_not_believed_and_learns_nothing() -> None:
    with _owner(stop=lambda _: {}):
        one = _only()
    from multiprocessing.connection import Listener

    heard: list[bytes] = []
    with Listener(one.address) as listener:

        def answer() -> None:
            for _ in range(2):
                with listener.accept() as connection, suppress(EOFError, OSError):
                    heard.append(connection.recv_bytes())
                    connection.send_bytes(b"received")
                    connection.send_bytes(bytes(32) + b'{"ok": true}')

        thread = threading.Thread(target=answer)
        thread.start()
        with raises(ControlError, "another_key", pid=one.pid):
            one.ask("stop", within_s=DEADLINE_S)
        with pytest.raises(ControlError):
            one.ask("status", within_s=DEADLINE_S)
        thread.join(DEADLINE_S)
    assert not any(bytes.fromhex(one.key) in said or b"status" in said for said in heard)


def test_a_system_without_free_files_or_threads_accepts_later(monkeypatch: pytest.MonkeyPatch) -> None:
    refused = [OSError(errno.EMFILE, "Too many open files")] * 2
    with _owner(status=lambda _: {}) as own:
        accept = own._listener.accept

        def scarce(patience_s: float) -> Any:
            if refused:
                raise refused.pop()
            return accept(patience_s)

        monkeypatch.setattr(own._listener, "accept", scarce)
        monkeypatch.setattr(control_socket, "MOST_THREADS", 0)
        for _ in range(control_socket._SPARE + 1):  # each thread waits in the old accept for its first
            assert _only().ask("status", within_s=DEADLINE_S) == {"ok": True}
        until(lambda: refused == [])


# --- the note and the folder ---


def test_only_this_user_reads_the_note_and_enters_the_folder(folder: Path) -> None:
    before = os.umask(0)
    try:
        with _owner():
            assert stat.S_IMODE(folder.stat().st_mode) == 0o700
            assert stat.S_IMODE((folder / f"{os.getpid()}.json").stat().st_mode) == 0o600
            first = _only()
        with _owner():
            assert len(bytes.fromhex(first.key)) == 32
            assert _only().key != first.key
    finally:
        os.umask(before)


def test_a_process_that_ends_leaves_no_file(folder: Path) -> None:
    with _owner(status=lambda _: {}):
        one = _only()
    assert list(folder.iterdir()) == []
    assert announced() == []
    with raises(ControlError, "ended", pid=os.getpid()):
        one.ask("status")


def test_an_announcement_changes_as_a_whole(folder: Path) -> None:
    with _owner(status=lambda _: {}) as own:
        before = _only()
        own.tell(run="/runs/a")
        after = _only()
        assert (before.run, after.run) == (None, "/runs/a")
        assert after.model_copy(update={"run": None}) == before
        assert {path.suffix for path in folder.iterdir()} - {".sock"} == {".json", ".lock"}


def test_one_process_announces_itself_once() -> None:
    with _owner(status=lambda _: {}):
        with pytest.raises(filelock.Timeout), _owner():
            pass
        assert _only().ask("status") == {"ok": True}, "the first one is as it was"


def test_a_path_too_long_for_a_socket_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIG_RUNTIME_DIR", str(tmp_path / ("long" * 40)))
    with _owner(status=lambda _: {}):
        address = Path(_only().address)
        assert stat.S_IMODE(address.parent.stat().st_mode) == 0o700
        assert _only().ask("status") == {"ok": True}
    assert not address.parent.exists()


def test_a_folder_that_others_could_read_is_closed(folder: Path) -> None:
    folder.mkdir(mode=0o755)
    runtime_folder()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_a_folder_of_another_account_or_a_link_is_not_used(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder.symlink_to(tmp_path)
    with pytest.raises(PermissionError):
        runtime_folder()
    folder.unlink()
    folder.mkdir()
    monkeypatch.setattr(os, "getuid", lambda: folder.stat().st_uid + 1)
    for use in (announced, _owner().__enter__):
        with pytest.raises(PermissionError) as refused:
            use()
        assert (refused.value.errno, refused.value.filename) == (errno.EPERM, str(folder))


def test_a_note_of_a_process_that_has_gone_is_removed(folder: Path) -> None:
    with _owner():
        note = next(folder.glob("*.json")).read_text()
    for suffix in (".json", ".new", ".sock"):
        (folder / f"17{suffix}").write_text(note)
    assert announced() == []
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("words", ["{", '{"pid": 3}', "\xff"])
def test_a_note_that_cannot_be_read_is_passed_over(folder: Path, words: str) -> None:
    with _owner(), announcements.lock_of(folder / "3.json"):
        (folder / "3.json").write_text(words, encoding="latin-1")
        assert _only().pid == os.getpid()


def test_an_owner_whose_lock_cannot_be_read_on_a_full_disk_is_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(note: Path) -> Any:
        raise OSError(errno.EROFS, "Read-only file system", str(note))

    with _owner(status=lambda _: {}), monkeypatch.context() as patch:
        patch.setattr(announcements, "lock_of", full)
        assert _only().ask("status", within_s=DEADLINE_S) == {"ok": True}


def test_a_process_ends_although_its_socket_file_is_gone(folder: Path) -> None:
    with _owner(status=lambda _: {}):
        Path(_only().address).unlink()
        with raises(ControlError, "ended", pid=os.getpid()):
            _only().ask("status")
    assert list(folder.iterdir()) == []


# --- owners in other processes ---


def test_a_killed_owner_is_not_listed(elsewhere: subprocess.Popen[str], folder: Path) -> None:
    one = _only()
    assert (one.pid, one.ports, one.run) == (elsewhere.pid, ("a", "b"), None)
    assert one.ask("status")["state"] == "planning"
    elsewhere.kill()
    elsewhere.wait(DEADLINE_S)
    with raises(ControlError, "ended", pid=one.pid):
        one.ask("status")
    assert announced() == []
    assert list(folder.iterdir()) == []


def test_an_owner_that_ends_before_it_answers_is_named(elsewhere: subprocess.Popen[str]) -> None:
    with raises(ControlError, "broken_off", pid=elsewhere.pid, do="end"):
        _only().ask("end", within_s=DEADLINE_S)
    assert elsewhere.wait(DEADLINE_S) == 3


def test_an_owner_that_hangs_delays_nobody_and_carries_out_later_what_it_received(
    elsewhere: subprocess.Popen[str],
) -> None:
    """Also if it is asked more often than the system keeps for it."""
    one = _only()
    elsewhere.send_signal(signal.SIGSTOP)
    os.waitpid(elsewhere.pid, os.WUNTRACED)
    listens = one.post_stop()
    for _ in range(100):
        with raises(ControlError, "no_reply", pid=one.pid, within_s=0.01):
            one.ask("status", within_s=0.01)
    with raises(ControlError, "no_reply", pid=one.pid, within_s=0.0):
        one.post_stop(within_s=0.0)
    elsewhere.send_signal(signal.SIGCONT)
    with raises(RefusedError, "cannot_be_asked", do="stop"):
        listens(DEADLINE_S)
    assert one.ask("status", within_s=DEADLINE_S)["state"] == "planning"
