"""The panel without a port: its application, told what owners there are and what each of them answers."""

import json
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

from rig.control.client import ControlError
from rig.panel.owners import ManualProcess
from rig.panel.watcher import Watcher
from sim.devices.clock import VirtualClock
from tests.rig.panel.asgi_client import Answer, asked

PORT, STOP_PORT, TOKEN = 8123, 8124, "the-token"
HERE = f"http://127.0.0.1:{PORT}"
OWN = {
    "host": f"127.0.0.1:{PORT}",
    "origin": HERE,
    "x-rig-token": TOKEN,
    "content-type": "application/json",
}


@dataclass(eq=False)
class StubOwner:
    """Announces what a test says, and answers what it says: an answer or an error for each request."""

    pid: int = 1
    kind: Literal["run", "by hand"] = "run"
    virtual: bool = False
    ports: tuple[str, ...] = ("/dev/ttyUSB0", "/dev/ttyUSB1")  # of the built-in configuration
    run: str | None = None
    began_unix_s: float = 0.0
    answers: dict[str, Any] = field(default_factory=dict)
    asked: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    within_s: list[float] = field(default_factory=list)
    said: list[str] = field(default_factory=list)  # stops that wait for nothing, by the thread that says them
    says: ControlError | None = None
    listened: int = 0

    def ask(self, do: str, *, within_s: float = 1.0, **more: Any) -> dict[str, Any]:
        self.asked.append((do, more))
        self.within_s.append(within_s)
        answer = self.answers.get(do, {"ok": True})
        if isinstance(answer, Exception):
            raise answer
        return dict(answer() if callable(answer) else answer)

    def post_stop(self, *, by: str = "") -> Callable[[float], dict[str, Any]]:
        if isinstance(self.says, ControlError):
            raise self.says
        self.said.append(threading.current_thread().name)

        def listen(within_s: float) -> dict[str, Any]:
            self.listened += 1
            return self.ask("stop", within_s=within_s)

        return listen


class StubHandProcess(ManualProcess):
    """Takes the bench as a test says."""

    def __init__(self) -> None:
        super().__init__(None, list)
        self.taken, self.left, self.problem = 0, 0, None  # type: int, int, Exception | None

    async def take(self) -> None:
        self.taken += 1
        if self.problem is not None:
            raise self.problem

    async def ended(self) -> None:
        self.left += 1


@dataclass
class StubPanel:
    """A panel with everything around it."""

    owners: list[StubOwner]
    watcher: Watcher
    bench: StubHandProcess
    clock: VirtualClock
    app: Any
    stop_app: Any

    def post(
        self, path: str, body: object = None, tab: str = "a", **headers: str | bytes | None
    ) -> tuple[int, dict[str, Any]]:
        """From the panel's own page, but for headers that are given; None leaves one out."""
        told = {**OWN, "x-rig-tab": tab, **{name.replace("_", "-"): value for name, value in headers.items()}}
        given = [(name, value) for name, value in told.items() if value is not None]
        content = body if isinstance(body, bytes) else json.dumps({} if body is None else body).encode()
        answer = asked(self.app, "POST", path, given, [content])
        return answer.status_code, answer.json()

    def refused(
        self, path: str, body: object = None, tab: str = "a", **headers: str | bytes | None
    ) -> tuple[int, str]:
        """The status and the code of what is not done; its one line is for people."""
        status, answer = self.post(path, body, tab, **headers)
        assert (answer["ok"], list(answer)) == (False, ["ok", "problem", "code"])
        assert answer["problem"]
        assert "\n" not in answer["problem"]
        return status, answer["code"]

    def get(self, path: str, method: str = "GET", **headers: str) -> Answer:
        """From the line of a browser, but for headers that are given."""
        told = {"host": OWN["host"], **{name.replace("_", "-"): value for name, value in headers.items()}}
        return asked(self.app, method, path, list(told.items()))
