"""The private socket of whoever owns the ports: who may ask, what is answered, and who hangs is not waited for."""

import errno
import json
import os
import signal
import socket
import stat
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, suppress
from multiprocessing import AuthenticationError
from pathlib import Path
from typing import Any

import filelock
import pytest

import rig.control.client as announcements
import rig.control.local_socket as local_socket
import rig.control.owner_socket as control_socket
from rig.control.client import Announced, Announcement, ControlError, RefusedError, announced, runtime_folder
from rig.control.local_socket import connected
from rig.control.messages import Wire
from rig.control.owner_socket import ControlSocket
from rig.errors import RigError
from tests.error_codes import raises
from tests.preloaded import Popen
from tests.waiting import DEADLINE_S, until

OWNER = """
import os, sys, time
import rig.control.local_socket
from rig.control.client import Announcement
from rig.control.owner_socket import ControlSocket

if sys.argv[1] == "tcp":
    rig.control.local_socket.UNIX = None
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


ON_TCP = pytest.mark.parametrize("transport", ["tcp"], indirect=True)
ON_BOTH = pytest.mark.parametrize("transport", ["unix", "tcp"], indirect=True)


@pytest.fixture(autouse=True)
def transport(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Unix sockets, or TCP as on a system without them."""
    found = str(getattr(request, "param", "unix"))
    if found == "tcp":
        monkeypatch.setattr(local_socket, "UNIX", None)
    return found


@pytest.fixture
def elsewhere(transport: str) -> Iterator[subprocess.Popen[str]]:
    """An owner in a process of its own, which ends when its input does."""
    words = [sys.executable, "-c", OWNER, transport]
    with Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


def _about(**more: Any) -> Announcement:
    return Announcement(
        **{"pid": os.getpid(), "kind": "run", "virtual": False, "ports": ("/dev/a",), "began_unix_s": 7.0} | more
    )


def _owner(**answers: Callable[[Mapping[str, Any]], Mapping[str, Any]]) -> ControlSocket:
    return ControlSocket(_about(), answers)


def _only() -> Announced:
    (one,) = announced()
    return one


def _raw(one: Announced) -> socket.socket:
    host, colon, port = one.address.partition(":")
    end = socket.socket(socket.AF_INET if colon else socket.AF_UNIX)
    end.connect((host, int(port)) if colon else one.address)  # waits for a place in the backlog
    end.settimeout(DEADLINE_S)
    return end


# --- a question and its answer ---


@ON_BOTH
def test_a_question_is_answered_with_what_it_said() -> None:
    heard: list[Mapping[str, Any]] = []

    def answer(request: Mapping[str, Any]) -> dict[str, Any]:
        heard.append(request)
        return {"state": "running"}

    with _owner(jog=answer):
        assert _only().ask("jog", axis="x", sign=-1) == {"ok": True, "state": "running"}
    assert heard == [{"do": "jog", "axis": "x", "sign": -1}]


@pytest.mark.parametrize("request_", ["fly", "__class__"])
def test_what_cannot_be_asked_is_refused_with_what_can(request_: str) -> None:
    refused = raises(RefusedError, "cannot_be_asked", do=request_)
    with _owner(status=lambda _: {}, stop=lambda _: {}), refused as caught:
        _only().ask(request_)
    assert str(caught.value).endswith(" status, stop")


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
def test_a_problem_is_one_line(answer: Any, code: str, told: str) -> None:
    with _owner(do=answer), raises(RefusedError, code) as refused:
        _only().ask("do")
    assert str(refused.value).startswith(told)
    assert "\n" not in str(refused.value)


@ON_BOTH
def test_a_stop_is_answered_while_another_answer_takes_its_time() -> None:
    begun, over = threading.Event(), threading.Event()
    slow: list[dict[str, Any]] = []

    def home(_: object) -> dict[str, Any]:
        begun.set()
        assert over.wait(DEADLINE_S)
        return {"homed": True}

    with _owner(home=home, stop=lambda _: {"stopped": True}):
        one = _only()
        asking = threading.Thread(target=lambda: slow.append(one.ask("home", within_s=DEADLINE_S)))
        asking.start()
        assert begun.wait(DEADLINE_S)
        assert one.ask("stop") == {"ok": True, "stopped": True}
        assert slow == []
        over.set()
        asking.join(DEADLINE_S)
    assert slow == [{"ok": True, "homed": True}]


def _serving() -> set[threading.Thread]:
    return {thread for thread in threading.enumerate() if thread.name == "control"}


def test_a_stop_waits_for_no_thread_to_begin() -> None:
    """Each turn of a thread may wait for a processor."""
    by: list[threading.Thread] = []

    def stop(_: object) -> dict[str, Any]:
        by.append(threading.current_thread())
        return {}

    with _owner(stop=stop):
        waiting = _serving()
        assert len(waiting) == control_socket._SPARE == 3
        for _ in range(5):
            until(lambda: _serving() == waiting)
            _only().ask("stop", within_s=DEADLINE_S)
    assert len(by) == 5
    assert set(by) <= waiting
    until(lambda: not _serving())


@ON_BOTH
def test_however_many_hang_the_next_is_served_and_no_thread_is_left_of_them() -> None:
    with _owner(stop=lambda _: {}), ExitStack() as hanging:
        one = _only()
        for _ in range(9):
            hanging.enter_context(closing(_raw(one)))
        assert one.ask("stop", within_s=DEADLINE_S) == {"ok": True}
        assert len(_serving()) > 9
        hanging.close()
        until(lambda: len(_serving()) == control_socket._SPARE)
    until(lambda: not _serving())


def _let_go(end: socket.socket) -> bool:
    end.setblocking(False)
    with suppress(BlockingIOError):
        while end.recv(4096):
            pass
        return True
    return False


def test_clients_without_the_key_are_few_and_the_newest_are_served(monkeypatch: pytest.MonkeyPatch) -> None:
    """For one more the first is let go; a client that has shown the key is not counted."""
    monkeypatch.setattr(control_socket, "PATIENCE_S", DEADLINE_S)  # only the limit ends them
    most, begun, over = control_socket.MOST_UNPROVEN, threading.Event(), threading.Event()

    def home(_: object) -> dict[str, Any]:
        begun.set()
        return {"homed": over.wait(DEADLINE_S)}

    with _owner(home=home, stop=lambda _: {"stopped": True}), ExitStack() as hanging:
        one, homed = _only(), list[dict[str, Any]]()
        asking = threading.Thread(target=lambda: homed.append(one.ask("home", within_s=DEADLINE_S)))
        asking.start()
        assert begun.wait(DEADLINE_S)
        ends = [hanging.enter_context(closing(_raw(one))) for _ in range(2 * most)]
        until(lambda: all(map(_let_go, ends[:most])))
        until(lambda: len(_serving()) <= most + control_socket._SPARE + 1)  # and the one at home
        assert one.ask("stop", within_s=DEADLINE_S)["stopped"]
        assert not any(map(_let_go, ends[most + 1 :]))
        over.set()
        asking.join(DEADLINE_S)
        assert homed == [{"ok": True, "homed": True}]


def test_a_stop_that_has_arrived_is_carried_out_before_its_client_is_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    """As many clients as there may be connect before the message is read."""
    monkeypatch.setattr(control_socket, "MOST_UNPROVEN", 1)
    stopped, let_go, reading = threading.Event(), threading.Event(), threading.Event()
    challenge, end_reading = Wire.challenge, local_socket.Channel.end_reading

    def ends(channel: local_socket.Channel) -> None:
        end_reading(channel)
        let_go.set()

    def late(wire: Wire, key: bytes) -> bytes | None:
        if not reading.is_set():
            reading.set()
            assert let_go.wait(DEADLINE_S)
        return challenge(wire, key)

    monkeypatch.setattr(Wire, "challenge", late)
    monkeypatch.setattr(local_socket.Channel, "end_reading", ends)
    with _owner(stop=lambda _: {"stopped": not stopped.set()}):
        one = _only()
        with connected(one.address, DEADLINE_S) as channel, ExitStack() as hanging:
            wire, key = Wire(channel, DEADLINE_S), bytes.fromhex(one.key)
            nonce = wire.post_stop(key)
            assert reading.wait(DEADLINE_S)
            hanging.enter_context(closing(_raw(one)))
            assert wire.stopped(key, nonce)["stopped"]
        assert stopped.wait(DEADLINE_S)


# --- who may not ask ---


def _says_nothing(end: socket.socket) -> None:
    """Connected, and that is all."""


def _half_a_message(end: socket.socket) -> None:
    end.sendall(b"\x00\x00")


def _garbage(end: socket.socket) -> None:
    end.sendall(b"GET / HTTP/1.1\r\n\r\n")


def _enormous(end: socket.socket) -> None:
    end.sendall(b"\x7f\xff\xff\xff")


@pytest.mark.parametrize("nuisance", [_says_nothing, _half_a_message, _garbage, _enormous])
def test_whoever_hangs_or_babbles_stands_in_nobodys_way(nuisance: Callable[[socket.socket], None]) -> None:
    with _owner(stop=lambda _: {"stopped": True}):
        one = _only()
        with closing(_raw(one)) as end:
            nuisance(end)
            assert one.ask("stop", within_s=DEADLINE_S)["stopped"]


@ON_BOTH
def test_whoever_says_nothing_is_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(control_socket, "PATIENCE_S", 0.01)
    with _owner(stop=lambda _: {}), closing(_raw(_only())) as end:
        heard = b""
        while data := end.recv(4096):
            heard += data
    assert b"#CHALLENGE#" in heard, "it was challenged, and then let go"


@ON_BOTH
def test_another_key_is_refused_and_nothing_is_done() -> None:
    done: list[object] = []

    def stop(request: Mapping[str, Any]) -> dict[str, Any]:
        done.append(request)
        return {}

    with _owner(stop=stop):
        other = _only().model_copy(update={"key": "00" * 32})
        with raises(ControlError, "another_key", pid=os.getpid()):
            other.ask("stop")
        assert done == []


@ON_BOTH
def test_an_owner_that_does_not_know_the_key_is_not_believed() -> None:
    """Somebody else's socket at the same place: it lets everybody in, and is told nothing."""
    with _owner(status=lambda _: {}):
        one = _only()
    from multiprocessing.connection import Listener, deliver_challenge

    heard: list[bytes] = []
    with Listener(("127.0.0.1", 0) if ":" in one.address else one.address) as listener:
        if isinstance(listener.address, tuple):
            one = one.model_copy(update={"address": "{}:{}".format(*listener.address)})

        def lets_in() -> None:
            with listener.accept() as connection:
                connection.send_bytes(b"#CHALLENGE#" + b"0" * 20)
                connection.recv_bytes()
                connection.send_bytes(b"#WELCOME#")
                with suppress(Exception):
                    deliver_challenge(connection, b"no such key")
                    connection.recv_bytes()
                    connection.send_bytes(b"nonsense")
                    heard.append(connection.recv_bytes())

        thread = threading.Thread(target=lets_in)
        thread.start()
        with pytest.raises(ControlError):
            one.ask("status", within_s=DEADLINE_S)
        thread.join(DEADLINE_S)
    assert all(b"status" not in said for said in heard)


# --- a stop is said at once ---


class Spoken:
    """A wire of lists."""

    def __init__(self, *heard: bytes) -> None:
        self.sent: list[bytes] = []
        self.heard = list(heard)

    def send_bytes(self, data: bytes) -> None:
        self.sent.append(data)

    def poll(self, timeout_s: float) -> bool:
        return bool(self.heard)

    def recv_bytes(self, most: int) -> bytes:
        return self.heard.pop(0)


def _wire(*heard: bytes) -> tuple[Wire, Spoken]:
    spoken: Any = Spoken(*heard)
    return Wire(spoken, DEADLINE_S), spoken


KEY = b"k" * 32


def _said() -> bytes:
    """A stop, by who knows the key."""
    wire, spoken = _wire()
    with pytest.raises(TimeoutError):
        wire.stop(KEY)
    (message,) = spoken.sent
    return message


def test_a_stop_is_one_message_and_waits_for_nothing() -> None:
    message = _said()
    wire, spoken = _wire(message)
    nonce = wire.challenge(KEY)
    assert nonce == message[32:]
    assert len(nonce) == 16
    (challenge,) = spoken.sent
    assert challenge.startswith(b"#CHALLENGE#"), "nothing more is asked"
    assert _said() != message, "each has a nonce of its own"


def test_a_stop_by_another_key_or_torn_is_none() -> None:
    message = _said()
    for wrong in (message[:-1], message + b"0", b"0" + message, message[32:], b""):
        with pytest.raises(AuthenticationError):
            _wire(wrong)[0].challenge(KEY)
    with pytest.raises(AuthenticationError):
        _wire(message)[0].challenge(b"j" * 32)


@pytest.mark.parametrize(
    ("key", "to_another", "believed"), [(KEY, False, True), (b"j", False, False), (KEY, True, False)]
)
def test_the_answer_to_a_stop_is_believed_of_who_knows_the_key_and_answers_this_one(
    key: bytes, to_another: bool, believed: bool
) -> None:
    asker, asking = _wire(b"#CHALLENGE#")

    def told(most: int) -> bytes:
        if asking.heard:
            return asking.heard.pop()
        owner, said = _wire(_said() if to_another else asking.sent[0])
        nonce = owner.challenge(KEY)
        assert nonce is not None
        owner.answer_stop(key, nonce, b'{"ok": true}')
        return said.sent[-1]

    asking.recv_bytes = told  # type: ignore[method-assign]
    asking.poll = lambda timeout_s: True  # type: ignore[method-assign]
    if believed:
        assert asker.stop(KEY) == {"ok": True}
    else:
        with pytest.raises(AuthenticationError):
            asker.stop(KEY)


def test_only_a_stop_is_said_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Anything else said twice would be done twice."""
    said: list[Mapping[str, Any]] = []
    proofs: list[bytes] = []
    prove = Wire.prove

    def proved(wire: Wire, key: bytes) -> None:
        proofs.append(key)
        prove(wire, key)

    monkeypatch.setattr(Wire, "prove", proved)

    def note(request: Mapping[str, Any]) -> dict[str, Any]:
        said.append(request)
        return {}

    with _owner(stop=note, home=note):
        one = _only()
        one.ask("stop")
        assert proofs == []
        one.ask("home")
        one.ask("stop", why="more")
    assert said == [{"do": "stop"}, {"do": "home"}, {"do": "stop", "why": "more"}]
    assert len(proofs) == 2


def _stopped(process: subprocess.Popen[str]) -> None:
    """All threads of it: the signal itself is on its way for a while."""
    process.send_signal(signal.SIGSTOP)
    os.waitpid(process.pid, os.WUNTRACED)


@ON_BOTH
def test_a_stop_is_said_before_anybody_listens(elsewhere: subprocess.Popen[str]) -> None:
    """Whoever says it waits for no answer, and not for an owner that hangs."""
    one = _only()
    _stopped(elsewhere)
    listens = one.post_stop()
    with raises(ControlError, "no_reply", pid=one.pid, within_s=0.01):
        one.post_stop()(0.01)
    elsewhere.send_signal(signal.SIGCONT)
    with raises(RefusedError, "cannot_be_asked", do="stop"):
        listens(DEADLINE_S)
    with raises(ControlError, "broken_off", pid=one.pid, do="stop"):
        listens(DEADLINE_S)  # it answers once
    _stopped(elsewhere)
    with raises(ControlError, "no_reply", pid=one.pid, within_s=0.0):
        [one.post_stop() for _ in range(40)]  # more than the system keeps
    elsewhere.kill()
    elsewhere.wait(DEADLINE_S)
    with raises(ControlError, "ended", pid=one.pid):
        one.post_stop()


def test_a_stop_that_was_said_is_done_and_answered() -> None:
    done: list[Mapping[str, Any]] = []

    def stop(request: Mapping[str, Any]) -> dict[str, Any]:
        done.append(request)
        return {"stopped": True}

    with _owner(stop=stop):
        one = _only()
        listens = one.post_stop()
        until(lambda: done == [{"do": "stop"}])
        assert listens(DEADLINE_S) == {"ok": True, "stopped": True}
        one.post_stop()  # nobody listens
        until(lambda: len(done) == 2)


# --- where it lies ---


@ON_BOTH
def test_only_this_user_reads_the_note_and_the_socket(folder: Path, transport: str) -> None:
    before = os.umask(0)
    try:
        with _owner():
            note = folder / f"{os.getpid()}.json"
            modes = {path.suffix: stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()}
            assert stat.S_IMODE(folder.stat().st_mode) == 0o700
            assert (".sock" in modes) is (transport == "unix")
            assert modes[".json"] == modes.get(".sock", 0o600) == 0o600
            assert set(json.loads(note.read_text())) == {
                *("pid", "kind", "virtual", "ports", "out", "run", "protocol", "config", "began_unix_s"),
                *("address", "key"),
            }
            assert len(bytes.fromhex(_only().key)) == 32
    finally:
        os.umask(before)


def test_every_key_is_another() -> None:
    keys = set()
    for _ in range(3):
        with _owner():
            keys.add(_only().key)
    assert len(keys) == 3


def test_nothing_is_left_of_one_that_has_ended(folder: Path) -> None:
    with _owner(status=lambda _: {}):
        one = _only()
    assert list(folder.iterdir()) == []
    assert announced() == []
    with raises(ControlError, "ended", pid=os.getpid()):
        one.ask("status")


def test_what_is_announced_changes_as_a_whole(folder: Path) -> None:
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
        one = _only()
        address = Path(one.address)
        assert len(os.fsencode(one.address)) <= 100
        assert stat.S_IMODE(address.parent.stat().st_mode) == 0o700
        assert one.ask("status") == {"ok": True}
    assert not address.parent.exists()


def test_a_folder_that_others_could_read_is_closed(folder: Path) -> None:
    folder.mkdir(mode=0o755)
    runtime_folder()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_somebody_elses_folder_is_not_used(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder.mkdir()
    monkeypatch.setattr(os, "getuid", lambda: folder.stat().st_uid + 1)
    for use in (announced, _owner().__enter__):
        with pytest.raises(PermissionError) as refused:
            use()
        assert (refused.value.errno, refused.value.filename) == (errno.EPERM, str(folder))
        assert refused.value.strerror == "expected a folder of this user's own"


def test_a_link_to_a_folder_is_not_used(folder: Path, tmp_path: Path) -> None:
    folder.symlink_to(tmp_path)
    with pytest.raises(PermissionError):
        runtime_folder()


@ON_TCP
def test_a_port_is_of_this_machine_alone() -> None:
    with _owner(status=lambda _: {}):
        host, _, port = _only().address.partition(":")
        assert host == "127.0.0.1"
        with closing(socket.socket()) as outside, pytest.raises(ConnectionRefusedError):
            outside.connect(("127.0.0.2", int(port)))


@ON_TCP
def test_a_client_that_reaches_itself_has_reached_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """A free port of the machine may be given to the end that connects."""
    end = socket.socket()
    end.bind(("127.0.0.1", 0))
    end.connect(end.getsockname())
    monkeypatch.setattr(socket, "create_connection", lambda *_: end)
    with pytest.raises(ConnectionRefusedError):
        connected("127.0.0.1:1", DEADLINE_S)
    assert end.fileno() == -1


@pytest.mark.parametrize("sent", [b"\x00\x00", b"\x00\x00\x00\x09{}"])
def test_the_rest_of_a_message_is_not_waited_for_for_ever(monkeypatch: pytest.MonkeyPatch, sent: bytes) -> None:
    monkeypatch.setattr(local_socket, "_WHOLE_S", 0.05)
    near, far = socket.socketpair()
    with closing(far), local_socket.Channel(near) as channel:
        far.sendall(sent)
        assert channel.poll(DEADLINE_S)
        with pytest.raises(TimeoutError):
            channel.recv_bytes(100)


@pytest.mark.parametrize("within_s", [0.0, DEADLINE_S])
def test_messages_are_those_of_multiprocessing(within_s: float) -> None:
    """A panel and a run of two versions understand each other."""
    from multiprocessing.connection import Connection

    near, far = socket.socketpair()
    with local_socket.Channel(near) as channel, Connection(far.detach()) as other:
        assert not channel.poll(0.0)
        for length in (0, 1, 5000, 40_000):
            channel.send_bytes(b"x" * length)
            assert other.recv_bytes() == b"x" * length
            other.send_bytes(b"y" * length)
            assert channel.poll(within_s)
            assert channel.recv_bytes(length) == b"y" * length
        other.send_bytes(b"too long")
        with pytest.raises(OSError, match="length"):
            channel.recv_bytes(7)


# --- notes that nobody stands behind ---


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


def test_one_whose_lock_cannot_be_asked_for_is_listed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a disk that takes nothing: whoever asks will see whether it lives."""

    def full(note: Path) -> Any:
        raise OSError(errno.EROFS, "Read-only file system", str(note))

    with _owner(status=lambda _: {}), monkeypatch.context() as patch:
        patch.setattr(announcements, "lock_of", full)
        assert _only().ask("status", within_s=DEADLINE_S) == {"ok": True}


def test_a_socket_whose_file_is_gone_ends_all_the_same(folder: Path) -> None:
    with _owner(status=lambda _: {}):
        one = _only()
        Path(one.address).unlink()
        with raises(ControlError, "ended", pid=os.getpid()):
            one.ask("status")
    assert list(folder.iterdir()) == []


def test_a_system_that_has_no_more_files_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    refused = [OSError(errno.EMFILE, "Too many open files")] * 2
    with _owner(status=lambda _: {}) as own:
        accept = own._listener.accept

        def scarce() -> Any:
            if refused:
                raise refused.pop()
            return accept()

        monkeypatch.setattr(own._listener, "accept", scarce)
        for _ in range(control_socket._SPARE + 1):  # each thread waits in the old accept for its first
            assert _only().ask("status", within_s=DEADLINE_S) == {"ok": True}
        until(lambda: refused == [])


# --- an owner elsewhere ---


@ON_BOTH
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


def test_an_owner_that_ends_in_mid_question(elsewhere: subprocess.Popen[str]) -> None:
    with raises(ControlError, "broken_off", pid=elsewhere.pid, do="end"):
        _only().ask("end", within_s=DEADLINE_S)
    assert elsewhere.wait(DEADLINE_S) == 3


@ON_BOTH
def test_an_owner_that_hangs_is_told_of_however_often_it_is_asked(elsewhere: subprocess.Popen[str]) -> None:
    """More often than the system keeps for it: neither connecting nor the handshake is waited for."""
    _stopped(elsewhere)
    one = _only()
    for _ in range(40):
        with raises(ControlError, "no_reply", pid=one.pid, within_s=0.01):
            one.ask("status", within_s=0.01)
    elsewhere.send_signal(signal.SIGCONT)
    assert one.ask("status", within_s=DEADLINE_S)["state"] == "planning"
