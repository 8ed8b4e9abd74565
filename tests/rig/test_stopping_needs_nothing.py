"""`rig stop` through every obstacle: its bytes go out first, and its words begin with what is known of the stage."""

import json
import os
import subprocess
import threading
import tomllib
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from rig.control.client import BESIDE_S, ControlError
from rig.control.stage_alone import NoStageError, stage_alone
from rig.control.stop import OutsideStop, SentStop
from rig.transport import PortOwner, open_port
from tests.error_codes import raises
from tests.preloaded import Popen

pytest.importorskip("pty", reason="needs pseudo-terminals")
obstacles = pytest.importorskip("tests.faults.obstacles", reason="needs limits of resources")


ELSEWHERE_TOO = ("runtime folder is a link", "wrong [habits], unknown table", "wrong values in [stage]")
"""Obstacles of which another of the same kind, or another test of this file, is among the quick ones."""


@pytest.fixture(autouse=True)
def _forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """But for `rig stop` without disk space, or without any folder, which is begun anew."""
    monkeypatch.setattr(subprocess, "Popen", Popen)


@pytest.mark.quick(rows=lambda name: name not in ELSEWHERE_TOO)
@pytest.mark.parametrize("name", obstacles.OBSTACLES)
def test_the_bytes_go_out_through_it(
    name: str, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    ended = obstacles.stopped(obstacles.OBSTACLES[name], tmp_path)
    record_property("first_byte_s", ended.to_byte_s)
    assert ended.code == 0, ended.err
    assert ended.heard.startswith(obstacles.STOP), "nothing goes out before it"
    assert set(ended.heard) <= set(obstacles.STOP + b"?"), "and nothing behind it but a question"
    assert ended.out.startswith("Stop sent to ")
    assert "the stage reports Alarm." in ended.out
    assert "stopped:" not in ended.err
    assert ended.bystanders_live


# With --json, it says the same words on standard error.
@pytest.mark.parametrize(
    ("name", "options"), [*((name, ("--json",)) for name in obstacles.WALLS), ("nobody listens", ())]
)
def test_where_nothing_can_go_out_the_first_words_say_so(name: str, options: tuple[str, ...], tmp_path: Path) -> None:
    ended = obstacles.stopped(obstacles.WALLS[name], tmp_path, *options)
    assert ended.code in (1, 2)
    assert ended.heard == b""
    first = ended.err.splitlines()[0]
    assert first.startswith("Stop NOT sent")
    assert "stopped:" not in ended.err
    if options:
        told = json.loads(ended.out)
        assert (told["error_text"], told["exit_code"]) == (first, ended.code)
        assert "stopped" not in told
    else:
        assert ended.out == ""


# --- which processes are signalled ---


@pytest.mark.parametrize(
    ("owner", "account", "signalled"),
    [
        (PortOwner(os.getpid()), 0, True),
        (PortOwner(os.getpid()), 1, False),
        (PortOwner(None), 0, False),
        (None, 0, False),
    ],
    ids=["ours", "another account's", "unknown", "nobody"],
)
def test_only_an_owner_of_this_account_is_signalled(
    owner: PortOwner | None, account: int, signalled: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """And only after the bytes."""
    from rig.control import stop as sent_stop

    board = obstacles.Board()
    signals: list[tuple[int, int, bytes]] = []
    monkeypatch.setattr(sent_stop, "first_owner", lambda ports: owner)
    monkeypatch.setattr(sent_stop, "LET_GO_S", 0.0)
    monkeypatch.setattr(os, "kill", lambda pid, number: signals.append((pid, number, board.all)))
    here = os.geteuid() + account
    monkeypatch.setattr(os, "geteuid", lambda: here)
    with board.behind_tcp() as port:
        settings, _ = stage_alone(_file(tmp_path, f"[stage]\nport = '{port}'\n"))
        stopping = OutsideStop(settings, [10, 9], find=list)
        found = stopping.send()
        assert signals == []
        stopping.end_holder()
    assert [(pid, number) for pid, number, _ in signals] == (
        [(os.getpid(), 10), (os.getpid(), 9)] if signalled else []
    )
    assert all(heard.startswith(obstacles.STOP) for _, _, heard in signals)
    assert (found.sent, found.state) == (True, "Alarm")


def test_a_stop_finds_the_owner_under_every_name_of_the_port(tmp_path: Path) -> None:
    """By who holds the lock: no name of somebody else's port is looked up for it."""
    board = obstacles.Board()
    said: list[tuple[int, bytes]] = []

    class Known:
        kind, virtual = "by hand", False

        def __init__(self, pid: int, port: str) -> None:
            self.pid, self.ports = pid, (port,)

        def post_stop(self, lives: object) -> object:
            said.append((self.pid, board.all))
            raise ControlError(f"process {self.pid} has ended")

    with board.behind_tcp() as port:
        settings, _ = stage_alone(_file(tmp_path, f"[stage]\nport = '{port}'\n"))
        other = f"tcp://localhost:{port.rpartition(':')[2]}"
        known = [Known(os.getpid(), other), Known(7, port), Known(8, "tcp://no-such-host.invalid:5")]
        with closing(open_port(other, 9600)):
            found = OutsideStop(settings, find=lambda: known).send()  # type: ignore[arg-type, return-value]
    assert said == [(os.getpid(), b""), (7, b"")], "before a byte went out"
    assert (found.sent, found.state) == (True, "Alarm")


def test_no_byte_is_sent_beside_an_owner_that_is_answering(tmp_path: Path) -> None:
    """What drives answer is for one reader; an owner that keeps the port is not waited for after that."""
    board = obstacles.Board()
    before: list[bytes] = []

    class ByHand:
        pid, kind, virtual = 7, "by hand", False

        def post_stop(self, lives: Callable[[], object]) -> object:
            def answer(within_s: float) -> dict[str, object]:
                lives()
                threading.Event().wait(10 * BESIDE_S)
                before.append(board.all)
                return {"ok": True, "stopped": True}

            return answer

    with board.behind_tcp() as port, closing(open_port(port, 9600)):
        ByHand.ports = (port,)  # type: ignore[attr-defined]
        settings, _ = stage_alone(_file(tmp_path, f"[stage]\nport = '{port}'\n"))
        found = OutsideStop(settings, find=lambda: [ByHand()]).send()  # type: ignore[list-item]
    assert before == [b""]
    assert (found.confirmed_by, found.notified, found.sent, found.state) == (7, (7,), True, "Alarm")
    assert board.all.startswith(obstacles.STOP)


def test_of_two_ports_one_that_does_not_open_keeps_no_stop_from_the_other(tmp_path: Path) -> None:
    board = obstacles.Board()
    with board.behind_tcp() as port:
        ports = (("x", 1, "/dev/ttyNOWHERE7"), ("z", 2, port))
        drives = "".join(f"[stage.drives.{axis}]\ndevice_id = {n}\nport = '{at}'\n" for axis, n, at in ports)
        settings, _ = stage_alone(_file(tmp_path, f"[stage]\nkind = 'leadshine'\nframing = 'rtu'\n{drives}"))
        found = OutsideStop(settings, find=list).send()
    assert found.sent
    assert not found.done, "half of a stage is no stage"
    assert "/dev/ttyNOWHERE7" in found.words
    assert board.all != b""


# --- a configuration of which the stage alone is read ---


@pytest.mark.parametrize(
    ("text", "passed"),
    [
        ("[stage]\nport = '/dev/a'\n", 0),
        ("[stage]\nport = '/dev/a'\n[habits]\nclearance_mm = 'far'\n", 0),
        ("[stage]\nport = '/dev/a'\n[stage.drives.x]\ndevice_id = 'one'\n", 0),
        ("[stage]\nport = '/dev/a'\nbaud = 0\ntravel_mm = [1, 'b', 3]\nwhat = 1\n", 3),
        ("\ufeff[stage]\nport = '/dev/a'\n[limits\n", 1),
        ("[limits]\nx = = 2\n[ stage ]\nport = '/dev/a'\n[frame]\n=\n", 1),
        ("x = [\n[1, 2],\n\n[stage]\nport = '/dev/a'\nresolution_mm = 'x'\n", 2),
    ],
)
def test_a_stop_reads_the_stage_despite_other_errors_in_the_file(text: str, passed: int, tmp_path: Path) -> None:
    settings, lines = stage_alone(_file(tmp_path, text))
    assert (settings.stage.port, settings.stage.baud) == ("/dev/a", 115200)
    assert len(lines) == passed
    assert all(line.startswith(f"config {tmp_path}") and "\n" not in line for line in lines)


@pytest.mark.parametrize(
    ("text", "code", "fields"),
    [
        ("[stage]\nport = ''\n", "invalid_value", {"key": "stage.port"}),
        ("[stage]\nport = 3\n", "invalid_value", {"key": "stage.port = 3: must be text"}),
        ("[stage]\nkind = 'gbrl'\n", "invalid_value", {"key": "stage.kind"}),
        ("[stage]\nport = '/dev/a\n", "no_toml", {}),
        ("stage = 3\n", "invalid_value", {"key": "stage"}),
        ("[habits]\n= 3\n", "no_toml", {}),
        (
            "[stage]\nkind = 'leadshine'\n[stage.drives.x]\ndevice_id = 'one'\n",
            "invalid_value", {"key": "stage.drives.x.device_id"},
        ),
    ],
)  # fmt: skip
def test_a_stop_is_refused_if_the_file_does_not_identify_the_stage(
    text: str, code: str, fields: dict[str, str], tmp_path: Path
) -> None:
    path = _file(tmp_path, text)
    with raises(NoStageError, code, path=str(path), **fields) as caught:
        stage_alone(path)
    assert str(caught.value).startswith(f"config {path}: ")
    assert "\n" not in str(caught.value)


def test_an_empty_file_means_the_default_stage(tmp_path: Path) -> None:
    assert tomllib.loads("") == {}
    assert stage_alone(_file(tmp_path, ""))[0].stage.port == "/dev/ttyUSB0"


# --- words ---


@pytest.mark.parametrize(
    ("found", "words", "done"),
    [
        (SentStop(("a",), sent=True, state="Alarm"), "Stop sent to a: the stage reports Alarm.", True),
        (SentStop(("a", "b"), confirmed_by=7), "Stop sent to a and b by process 7", True),
        (SentStop(("a",), sent=True, problems=["it is slow"]), "Stop sent to a but not confirmed", False),
        (SentStop(("a",), problems=["gone", "gone"]), "Stop NOT sent to a", False),
    ],
)  # fmt: skip
def test_the_report_of_a_stop_begins_with_its_result(found: SentStop, words: str, done: bool) -> None:
    assert found.words.startswith(words)
    assert found.done is done
    assert ("emergency stop" in found.words) is not done
    assert all(found.words.count(problem) == 1 for problem in found.problems)


def _file(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path
