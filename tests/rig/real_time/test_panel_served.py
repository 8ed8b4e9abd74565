"""The panel on a port of loopback, with real sockets, processes and clocks."""

import asyncio
import errno
import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

import rig.panel.owners as by_hand_process
from rig.clock import WallClock
from rig.control.client import Announcement, announced
from rig.control.owner_socket import ControlSocket
from rig.data.events import STREAMS
from rig.data.journal import Journal
from rig.panel.app import Panel
from rig.panel.owners import ManualProcess, NotTakenError
from tests.error_codes import raises
from tests.preloaded import Popen
from tests.program import Program, beside_progress
from tests.rig.real_time.panel_page import Serve, Stream, post, serve
from tests.waiting import DEADLINE_S, until

__all__ = ["serve"]  # a fixture

SAMPLE = {"index": 0, "phase": "press", "x_mm": 0.5, "height_mm": -0.1, "doi_mm": 0.1, "force_gwt": 1.5}


def raw(panel: Panel, request: bytes) -> bytes:
    """What a server says to bytes."""
    with socket.create_connection(("127.0.0.1", panel.port), timeout=DEADLINE_S) as wire:
        wire.sendall(request)
        wire.shutdown(socket.SHUT_WR)
        heard = bytearray()
        while piece := wire.recv(65536):
            heard += piece
        return bytes(heard)


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    """Of a run that begins."""
    run = tmp_path / "runs" / "20260101T000000-p-abcdef"
    run.mkdir(parents=True)
    with Journal(run / "events.jsonl", WallClock(), STREAMS) as found:
        found.start({"protocol": "p", "title": "", "planned_indentations": 1})
        yield found
        found.stop("done")


# --- what is shown ---


def test_a_page_gets_every_reading_of_a_run(serve: Serve, journal: Journal) -> None:
    panel = serve()
    with closing(Stream(panel)) as page:
        assert page.answer.getheader("Content-Type") == "text/event-stream; charset=utf-8"
        state = page.until("state", lambda told: told["run"] is not None)
        assert (state["run"]["state"], state["run"]["name"]) == ("running", "20260101T000000-p-abcdef")
        for n in range(200):
            journal.event("sample", {**SAMPLE, "force_gwt": float(n)})
        places: list[float] = []
        while len(places) < 200:
            kind, told = page.event()
            if kind == "readings":
                assert told["dropped"] == 0
                places += [row[told["columns"].index("force_gwt")] for row in told["rows"]]
        assert places == [float(n) for n in range(200)]
        last = page.until("state", lambda told: told["newest"]["force_gwt"] == 199.0)
        assert 0.0 <= last["newest"]["age_s"] <= last["unix_s"] - page.came["state"][0]["unix_s"]
        older = page.until("state", lambda told: told["newest"]["age_s"] > last["newest"]["age_s"])
        assert older["unix_s"] > last["unix_s"]


def test_a_fifth_page_is_refused_with_the_reason(serve: Serve) -> None:
    panel = serve()
    pages = [Stream(panel, str(n)) for n in range(4)]
    for page in pages:
        page.until("state", bool)
    with closing(Stream(panel)) as fifth:
        assert fifth.answer.status == 503
        assert fifth.answer.read() == b"4 pages already monitor the rig; close one of them"
    pages.pop().close()

    def again() -> bool:
        with closing(Stream(panel)) as other:
            return other.answer.status == 200

    until(again)
    for page in pages:
        page.close()


def test_the_panel_ends_while_pages_are_open(serve: Serve) -> None:
    panel = serve()
    with closing(Stream(panel)) as page:
        page.until("state", bool)
        panel.end()
        while page.answer.readline():
            pass
    with pytest.raises(OSError):  # noqa: PT011
        until(lambda: socket.create_connection(("127.0.0.1", panel.port)).close())


# --- who is let in ---


@pytest.mark.parametrize(
    "request_",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"GET http://evil.example/ HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n",
        b"\x16\x03\x01\x00\xa5\x01\x00\x00\xa1\x03\x03" + bytes(160),
        b"GET / HTTP/1.1\r\nHost: a\r\nX: " + b"a" * 200_000 + b"\r\n\r\n",
    ],
    ids=lambda value: str(value)[:20],
)
def test_bytes_that_are_no_request_are_refused_and_the_next_request_is_answered(
    request_: bytes, serve: Serve
) -> None:
    panel = serve()
    try:
        said = raw(panel, request_)
    except ConnectionError:
        said = b""
    assert said.partition(b" ")[2][:3] in (b"", b"400", b"403", b"431")
    assert post(panel, "/take")[0] == 200


def test_the_token_of_another_panel_is_refused(serve: Serve) -> None:
    one, other = serve(), serve()
    assert one.url != other.url
    assert len(one.url.partition("=")[2]) >= 43
    assert post(one, "/take", **{"X-Rig-Token": other.url.partition("=")[2]})[0] == 403


# --- owners ---


def owned(answers: dict[str, Any]) -> ControlSocket:
    about = Announcement(pid=os.getpid(), kind="run", virtual=False, ports=("a",), began_unix_s=1.0)
    return ControlSocket(about, answers)


def test_a_hung_owner_delays_neither_stop_nor_the_page(serve: Serve) -> None:
    free, panel = threading.Event(), serve()

    def hangs(request: object) -> dict[str, Any]:
        free.wait(DEADLINE_S)
        return {}

    with owned(dict.fromkeys(("status", "pause"), hangs) | {"stop": lambda request: {}}):
        with closing(Stream(panel)) as page:
            page.until("state", lambda told: told["owner"] and not told["owner"]["reachable"])
            waiting = threading.Thread(target=post, args=(panel, "/pause"))
            waiting.start()
            assert post(panel, "/stop")[0] == 200
            page.until("state", bool)
        free.set()
        waiting.join(DEADLINE_S)


# --- the bench by hand ---

OWNER = """\
import os, sys, threading
from rig.control.client import Announcement
from rig.control.owner_socket import ControlSocket
over = threading.Event()
about = Announcement(pid=os.getpid(), kind="by hand", virtual=True, ports=(), began_unix_s=1.0)
with ControlSocket(about, {"leave": lambda request: over.set() or {}}):
    over.wait(60)
"""
LEAVES = "raise SystemExit(3)"
REFUSES = "import sys; print('rig: warming up\\nrig: the port is in use', file=sys.stderr); sys.exit(1)"


def taking(monkeypatch: pytest.MonkeyPatch, script: str) -> ManualProcess:
    """The bench, taken by another program."""
    monkeypatch.setattr(by_hand_process, "words", lambda config: [sys.executable, "-c", script])
    return ManualProcess(Path("rig.toml"), announced)


def test_manual_control_is_one_process_that_ends_with_the_panel(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = taking(monkeypatch, OWNER)

    async def twice() -> None:
        await asyncio.gather(bench.take(), bench.take())

    asyncio.run(twice())
    assert [one.kind for one in announced()] == ["by hand"]
    bench.leave()
    assert bench._process is not None
    assert bench._process.returncode == 0
    assert announced() == []
    bench.leave()
    assert bench.last_line == ""
    bench.forget()


def test_manual_control_that_does_not_start_names_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    said = "the port is in use"
    for script, code, name, value in ((REFUSES, "refused", "said", said), (LEAVES, "ended", "exit_code", 3)):
        bench = taking(monkeypatch, script)
        with raises(NotTakenError, code, **{name: value}):
            asyncio.run(bench.take())
        assert bench.last_line == (said if script == REFUSES else "")
        bench.forget()
        assert bench.last_line == ""
    monkeypatch.setattr(by_hand_process, "READY_S", 0.2)
    bench = taking(monkeypatch, "import threading; threading.Event().wait(60)")
    with raises(NotTakenError, "no_reply", within_s=0.2):
        asyncio.run(bench.take())
    assert bench._process is not None
    assert until(lambda: bench._process.poll() is not None)
    bench.forget()


# --- the command ---


def test_a_page_port_in_use_is_refused_in_one_line(serve: Serve, program: Program) -> None:
    panel = serve()
    ended = program("panel", "--json", "--port", panel.port)
    assert (ended.code, ended.error_code) == (2, "os_error")
    assert ended.complaint == f"127.0.0.1:{panel.port}: {os.strerror(errno.EADDRINUSE)}"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_program_prints_its_address_and_logs_no_token(number: signal.Signals, tmp_path: Path) -> None:
    words = [sys.executable, "-m", "rig", "panel", "--no-browser", "--json", "--out", str(tmp_path)]
    with Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as served:
        assert served.stdout is not None
        told = json.loads(served.stdout.readline())
        token = told["url"].partition("#token=")[2]
        assert told == {
            "url": f"http://127.0.0.1:{told['port']}/#token={token}",
            "port": told["port"],
            "pid": served.pid,
        }
        with closing(http.client.HTTPConnection("127.0.0.1", told["port"], timeout=DEADLINE_S)) as wire:
            for method, path in (("GET", "/"), ("POST", "/stop"), ("GET", f"/{token}"), ("GET", "/runs/../a")):
                wire.request(method, path, headers={"X-Rig-Token": token})
                answer = wire.getresponse()
                assert token.encode() not in answer.read() + str(answer.getheaders()).encode()
        served.send_signal(number)
        out, err = served.communicate(timeout=DEADLINE_S)
    assert (served.returncode, out, beside_progress(err)) == (0, "", "")
