"""A panel that is served, and a page that looks on and asks, as a browser would."""

import http.client
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from rig.clock import WallClock
from rig.panel.app import Offered, Panel
from tests.waiting import DEADLINE_S

Serve = Callable[..., Panel]


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Serve]:
    """Serve a panel from a thread until the test ends."""
    going: list[tuple[Panel, threading.Thread]] = []

    def begin(**more: Any) -> Panel:
        panel = Panel(Offered(tmp_path / "runs", **more))
        thread = threading.Thread(target=panel.serve)
        thread.start()
        going.append((panel, thread))
        return panel

    yield begin
    for panel, thread in going:
        panel.end()
        thread.join(DEADLINE_S)
        assert not thread.is_alive()


class Stream:
    """A page's stream of events: what came, put together."""

    def __init__(self, panel: Panel, tab: str = "a") -> None:
        self.wire = http.client.HTTPConnection("127.0.0.1", panel.port, timeout=DEADLINE_S)
        self.wire.request("GET", f"/events?tab={tab}", headers={"X-Rig-Token": panel.url.partition("=")[2]})
        self.answer = self.wire.getresponse()
        self.came: dict[str, list[dict[str, Any]]] = {}

    def event(self) -> tuple[str, dict[str, Any]]:
        """The next one."""
        lines: list[str] = []
        while line := self.answer.readline().decode().rstrip("\n"):
            lines.append(line)
        if not lines or not lines[0].startswith("event: "):
            return self.event()
        kind, told = lines[0].removeprefix("event: "), json.loads(lines[1].removeprefix("data: "))
        self.came.setdefault(kind, []).append(told)
        return kind, told

    def until(self, kind: str, look: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
        """The first of a kind that is as it is looked for. Raises AssertionError with the last at the deadline."""
        clock = WallClock()
        deadline_s, last = clock.monotonic_s() + DEADLINE_S, {}
        while clock.monotonic_s() < deadline_s:
            found, told = self.event()
            if found == kind and look(told):
                return told
            last = told if found == kind else last
        raise AssertionError(last)

    def close(self) -> None:
        self.answer.close()
        self.wire.close()


def post(panel: Panel, path: str, body: Any = None, tab: str = "a", **headers: str) -> tuple[int, dict[str, Any]]:
    """From the panel's own page."""
    here = f"http://127.0.0.1:{panel.port}"
    own = {"Origin": here, "X-Rig-Token": panel.url.partition("=")[2], "X-Rig-Tab": tab}
    with closing(http.client.HTTPConnection("127.0.0.1", panel.port, timeout=DEADLINE_S)) as wire:
        kind = {"Content-Type": "application/json"}
        wire.request("POST", path, json.dumps({} if body is None else body), {**own, **kind, **headers})
        answer = wire.getresponse()
        return answer.status, json.loads(answer.read())
