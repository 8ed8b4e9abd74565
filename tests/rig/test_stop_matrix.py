"""What a stop does in every state of the owner and of the port: the table of docs/stop.md, with real processes."""

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from rig.clock import WallClock
from rig.control.client import announced
from rig.panel import stops
from rig.panel.access import Address
from rig.panel.app import applications
from rig.panel.watcher import BenchView, Watcher
from rig.plan.config import Config
from tests.preloaded import Popen
from tests.program import press_script
from tests.rig.panel.asgi_client import asked
from tests.rig.panel.stub_panel import OWN, PORT, STOP_PORT, TOKEN, StubHandProcess
from tests.waiting import DEADLINE_S, until

pytest.importorskip("pty", reason="needs pseudo-terminals")
obstacles = pytest.importorskip("tests.faults.obstacles", reason="needs limits of resources")

PAGE = Path(__file__).parents[2] / "docs" / "stop.md"
CELLS = re.findall(
    r"^\| (.+?) \| (.+?) \| (.+?) \| (.+?) \| (.+?) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE
)
OWNERS = (
    "none",
    "alive",
    "paused",
    "manual control",
    "hung",
    "stuck",
    "dead",
    "another account",
    "without a socket",
    "two runs",
)
PORTS = ("free", "held by us", "held by another program", "gone")
CANNOT_EXIST = {
    ("none", "held by us"): "the system frees the lock with its process",
    ("dead", "held by us"): "the system frees the lock with its process",
    ("another account", "held by another program"): "the port is locked by its account: as held by us",
    **{("manual control", port): "as a run that is alive" for port in PORTS if port != "held by us"},
    **{("without a socket", port): "as none, or as held by us" for port in PORTS if port != "held by us"},
    **{("two runs", port): "as a run that is alive" for port in PORTS if port != "held by us"},
}
SOMEBODY = obstacles.SOMEBODY
OWNER = """\
import ctypes, encodings.idna, os, signal, sys, time
from pathlib import Path
config, state, holds, account, kind = sys.argv[1:]
from rig.clock import WallClock
from rig.control.client import Announcement
from rig.control.owner_socket import ControlSocket
from rig.control.owned_stage import OwnedStage, answer_to_a_stop
from rig.control.stage_alone import stage_alone
from rig.devices.registry import stage_ports

settings, _ = stage_alone(Path(config))
if account != "0":
    os.setgroups([]), os.setgid(int(account)), os.setuid(int(account))
stage = OwnedStage(settings, WallClock())
if holds == "True":
    stage.open()

if kind == "no socket":
    print("ready", flush=True)
    sys.stdin.read()

def stop(request):
    print("stopped", flush=True)
    answer = answer_to_a_stop(stage.stop)
    if kind == "run":
        stage.close()
    return answer

ports = stage_ports(settings.stage)
about = Announcement(pid=os.getpid(), kind=kind, virtual=False, ports=ports, began_unix_s=time.time())
with ControlSocket(about, {"stop": stop, "status": lambda request: {"state": "running"}}):
    if state == "stuck":  # No other thread of it runs any more.
        sys.setswitchinterval(1000.0)
        c = ctypes.PyDLL(None)
        c.write(1, b"ready\\n", 6), c.sleep(1000)
    print("ready", flush=True)
    if state == "hung":
        os.kill(os.getpid(), signal.SIGSTOP)
    while state == "alive":
        pass
    sys.stdin.read()
"""
HOLDS = """\
import serial, socket, sys
port = sys.argv[1]
if port.startswith("tcp"):
    held = socket.create_connection(("127.0.0.1", int(port.rpartition(":")[2])))
else:
    held = serial.Serial(port, exclusive=True)
print("ready", flush=True)
sys.stdin.read()
"""
SCRIPT = press_script("doi_mm=0.3")


class Cell:
    """Board, port and owners of one row."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self.folder, self._stack = folder, stack
        self.board = obstacles.Board()
        self.config = folder / "rig.toml"
        self.port = ""
        self.owners: list[subprocess.Popen[str]] = []
        self.gone: Callable[[], None] = lambda: None
        self.other: Cell | None = None

    def begun(self, code: str, *words: object, **environment: str) -> "subprocess.Popen[str]":
        """Start a process that prints `ready`."""
        process = Popen(
            [sys.executable, "-c", code, *map(str, words)], env={**os.environ, **environment},
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self._stack.callback(_ended, process)
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        return process

    def own(
        self, state: str, *, holds: bool, account: int = 0, kind: str = "run", config: Path | None = None
    ) -> None:
        """Start an owner in a state."""
        environment = {}
        if account:
            theirs = self._stack.enter_context(tempfile.TemporaryDirectory())
            os.chown(theirs, account, account)
            environment["RIG_RUNTIME_DIR"] = theirs
        owner = self.begun(OWNER, config or self.config, state, holds, account, kind, **environment)
        if state == "hung":
            os.waitpid(owner.pid, os.WUNTRACED)
        if state == "dead":
            owner.kill()
            owner.wait(DEADLINE_S)
        self.owners.append(owner)

    def open_port(self, kind: str) -> None:
        """Connect a board, and write the configuration of its port."""
        if kind.startswith("gateway"):
            self.port = self._stack.enter_context(self.board.behind_tcp(clients=1))
        else:
            serial = ExitStack()
            self.port = serial.enter_context(self.board.behind_serial())
            os.chmod(self.port, 0o666)
            self._stack.callback(serial.close)
            self.gone = serial.close
        force = self._stack.enter_context(obstacles.Board().behind_serial())
        self.config.write_text(f"[stage]\nport = '{self.port}'\n[force]\nport = '{force}'\n", encoding="utf-8")


def _ended(process: "subprocess.Popen[str]") -> None:
    process.kill()
    process.communicate()


@contextmanager
def cell(owner: str, port: str, folder: Path) -> Iterator[Cell]:
    """Make the owner and the port of a row."""
    with ExitStack() as stack:
        made = Cell(folder, stack)
        made.open_port(port)
        holds = port not in ("free", "gateway taken by another program")
        match owner:
            case "none":
                pass
            case "another account":
                made.own("paused", holds=holds, account=SOMEBODY)
            case "manual control":
                made.own("paused", holds=holds, kind="by hand")
            case "without a socket":
                made.own("paused", holds=holds, kind="no socket")
            case "two runs":
                made.own("alive", holds=holds)
                (folder / "other").mkdir()
                made.other = Cell(folder / "other", stack)
                made.other.open_port("held by us")
                made.own("alive", holds=True, config=made.other.config)
            case _:
                made.own(owner, holds=holds)
        if "another program" in port:
            if owner in ("none", "dead"):
                made.begun(HOLDS, made.port)
            else:  # The owner has it exclusively for programs that ask.
                stack.callback(os.close, os.open(made.port, os.O_RDWR | os.O_NOCTTY))
        if port == "gone":
            made.gone()
        yield made


@pytest.fixture(autouse=True)
def _runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIG_RUNTIME_DIR", str(tmp_path / "r"))


def _rows(column: int) -> list[object]:
    return [
        pytest.param(
            row[0], row[1], row[column], id=f"{row[0]}, {row[1]}",
            marks=pytest.mark.skipif(row[0] == "another account" and os.geteuid() != 0, reason="needs root"),
        )
        for row in CELLS[1:] if row[0] in OWNERS
    ]  # fmt: skip


IN_SUITE = {("none", "free"), ("alive", "held by us"), ("hung", "held by us"), ("manual control", "held by us")}
"""Owner and port of the rows that `make test` runs; `make shake` runs all."""


def test_every_cell_is_a_row_or_cannot_exist() -> None:
    rows = [(row[0], row[1]) for row in CELLS[1:]]
    assert {(owner, port) for owner in OWNERS for port in PORTS} - set(rows) == set(CANNOT_EXIST)
    assert not set(rows) & set(CANNOT_EXIST)
    assert len(rows) == len(set(rows))


in_suite = pytest.mark.quick(rows=lambda owner, port, **_: (owner, port) in IN_SUITE)


@in_suite
@pytest.mark.parametrize(("owner", "port", "expected"), _rows(2))
def test_rig_stop(
    owner: str, port: str, expected: str, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    with cell(owner, port, tmp_path) as made:
        begun_s = time.monotonic()
        process = Popen(
            [sys.executable, "-c", obstacles._BEGIN, "stop", "--config", str(made.config)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        until(lambda: made.board.heard or process.poll() is not None)
        bytes_first = not made.owners or made.owners[0].poll() is None
        out, err = process.communicate(timeout=DEADLINE_S)
        took_s = time.monotonic() - begun_s
        begins, _, err = err.partition("\n")
        record_property("first_byte_s", made.board.first_s - float(begins.removeprefix("begins ")))
        record_property("took_s", took_s)
        sent = "not" not in expected
        assert process.returncode == (0 if sent else 1), out + err
        if sent:
            assert out.startswith(f"Stop sent to {made.port}: the stage reports Alarm.")
            assert made.board.all.startswith(obstacles.STOP)
        else:
            not_confirmed = f"Stop sent to {made.port} but not confirmed"
            assert err.startswith(("Stop NOT sent to", not_confirmed) if "confirmed" in expected else "Stop NOT sent")
            assert "se the emergency stop" in err.splitlines()[0]
            assert ("held by another account: use the emergency stop" in err.splitlines()[0]) is (
                "another account" in expected
            )
            assert out == ""
        if made.owners and owner != "dead":
            ended = [one.poll() is not None for one in made.owners]
            assert ended[0] is ("ended" in expected), err
            assert bytes_first is not expected.startswith("ended")
            assert not any(ended[1:])
        assert made.other is None or made.other.board.all == b"", "a run on other ports goes on"


@in_suite
@pytest.mark.parametrize(("owner", "port", "expected"), _rows(3))
def test_stop_in_the_panel(
    owner: str,
    port: str,
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    record_property: Callable[[str, object], None],
) -> None:
    monkeypatch.setattr(stops, "_ANSWER_S", DEADLINE_S)
    with cell(owner, port, tmp_path) as made:
        settings = Config.model_validate({"stage": {"port": made.port}})
        watcher = Watcher(tmp_path / "runs", BenchView(made.config, settings), announced, WallClock())
        watcher.owners = watcher.find()
        app, _ = applications(watcher, StubHandProcess(), Address(PORT, STOP_PORT, TOKEN))
        body, headers = b"{}", [*OWN.items(), ("x-rig-tab", "a")]
        begun_s = time.monotonic()
        answer = asked(app, "POST", "/stop", headers, [body]).json()
        record_property("first_byte_s", made.board.first_s - begun_s)
        if answer["ok"]:
            until(lambda: made.board.all.startswith(obstacles.STOP))
        heard = made.board.all
    words = str(answer.get("words", answer["problem"]))
    reached = {"reached": made.owners[:1], "reached both": made.owners}.get(expected, [])
    assert answer["ok"] is (expected == "sent" or bool(reached)), answer
    assert heard.startswith(obstacles.STOP) is answer["ok"]
    assert answer.get("stopped", []) == [one.pid for one in reached] or not reached
    if answer["ok"]:
        assert words.startswith("process " if reached else f"Stop sent to {made.port}: the stage")
    else:
        assert answer["code"] in ("not_sent", "not_confirmed")
        assert "se the emergency stop" in words


@in_suite
@pytest.mark.parametrize("command", ["run", "jog"])
@pytest.mark.parametrize(("owner", "port", "expected"), _rows(4))
def test_a_command_that_moves(owner: str, port: str, expected: str, command: str, tmp_path: Path) -> None:
    codes = {"in use": ["in_use"], "missing": ["no_port"], "no reply": ["hung_up", "not_read"]}
    with cell(owner, port, tmp_path) as made:
        script = tmp_path / "script.py"
        script.write_text(SCRIPT, encoding="utf-8")
        words = {
            "run": ["run", script, "--yes", "--mounted", "bar:3.0", "--out", tmp_path / "runs"],
            "jog": ["jog", "--axis", "z", "--by-mm", "0.1", "--without-force"],
        }[command]
        process = Popen(
            [sys.executable, "-m", "rig", *map(str, words), "--config", str(made.config), "--json"],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        if expected == "starts":
            until(lambda: made.board.heard or process.poll() is not None)
            process.kill()
        out, _ = process.communicate(timeout=DEADLINE_S)
        if expected == "starts":
            assert made.board.heard, out
            return
        found = json.loads(out)
        print(command, owner, "|", port, "|", found["code"], found["error_text"])
        assert found["exit_code"] != 0
        assert found["code"] in codes[expected]
        if expected == "in use" and owner not in ("none", "dead"):
            assert f"process {made.owners[0].pid}" in found["error_text"]
