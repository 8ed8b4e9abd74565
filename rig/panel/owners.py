"""Processes that own ports, including the panel's own one, and the tab that has control."""

import asyncio
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Literal, Protocol

from rig.control.client import ControlError
from rig.errors import RigError


class Owner(Protocol):
    """Process that owns ports (rig/control/client.py: Announced)."""

    @property
    def pid(self) -> int: ...
    @property
    def kind(self) -> Literal["run", "by hand"]: ...
    @property
    def virtual(self) -> bool: ...
    @property
    def ports(self) -> tuple[str, ...]: ...
    @property
    def run(self) -> str | None: ...
    @property
    def began_unix_s(self) -> float: ...

    def ask(self, do: str, *, within_s: float = ..., **more: Any) -> dict[str, Any]:
        """Return the reply. Raises RefusedError, ControlError."""
        ...

    def post_stop(self, *, by: str = "") -> Callable[[float], dict[str, Any]]:
        """Send a stop without waiting; the returned function waits for the reply. Raises ControlError."""
        ...


Find = Callable[[], Sequence[Owner]]


def shown(owners: Sequence[Owner]) -> Owner | None:
    """Return the owner that a page shows: real before virtual, then newest first."""
    return max(owners, key=lambda one: (not one.virtual, one.began_unix_s), default=None)


def owner_state(owner: Owner, status: dict[str, Any] | None) -> dict[str, Any]:
    """Return `owner` of the state; status: its last reply, or None."""
    return {
        "kind": owner.kind,
        "pid": owner.pid,
        "virtual": owner.virtual,
        "ports": list(owner.ports),
        "state": None if status is None else status.get("state"),
        "stopped": None if status is None else status.get("stopped"),
        "reachable": status is not None,
        **({"stop_button": status["stop_button"]} if status is not None and "stop_button" in status else {}),
    }


def run_of(owner: Owner) -> Path | None:
    """Return the folder of the owner's run, once it exists."""
    return None if owner.run is None else Path(owner.run)


class NoOwnerError(RigError):
    """Error of a request without an owner."""

    default_code = "nobody"


_OF_A_RUN = ("pause", "go_on")


def ask_owner(owner: Owner | None, do: str, within_s: float, **more: Any) -> dict[str, Any]:
    """Return an owner's reply. Raises NoOwnerError if it is not one for the request, RefusedError, ControlError."""
    if do in _OF_A_RUN and (owner is None or owner.kind != "run"):
        raise NoOwnerError("no protocol is running", "no_run")
    if do not in _OF_A_RUN and (owner is None or owner.kind != "by hand"):
        raise NoOwnerError("manual control is off; take control first", "bench_not_taken")
    assert owner is not None
    return owner.ask(do, within_s=within_s, **more)


READY_S = 15.0
_POLL_S = 0.05


class NotTakenError(RigError):
    """Error of manual control that did not start or end."""

    default_code = "not_taken"


def words(config: Path | None) -> list[str]:
    """Return the command line of the process."""
    return [sys.executable, "-m", "rig", "by-hand", "--config", str(config)]


class ManualProcess:
    """Process of manual control, at most one; it owns the ports, and ends with the panel."""

    def __init__(self, config: Path | None, find: Find) -> None:
        self._config, self._find = config, find
        self._process: subprocess.Popen[bytes] | None = None
        self._output: IO[bytes] | None = None
        self._taking = asyncio.Lock()

    async def take(self) -> None:
        """Start manual control, and wait until the process has announced itself. Raises NotTakenError."""
        async with self._taking:
            if await asyncio.to_thread(self._announced):
                return
            await self.ended()
            self.forget()
            self._process = self._begun()
            for _ in range(round(READY_S / _POLL_S)):
                if await asyncio.to_thread(self._announced):
                    return
                if self._process.poll() is not None:
                    if self.last_line:
                        raise NotTakenError(self.last_line, "refused")
                    code = self._process.returncode
                    raise NotTakenError(f"it ended with exit code {code}", "ended")
                await asyncio.sleep(_POLL_S)
            self._process.terminate()
            raise NotTakenError(f"manual control did not start within {READY_S:g} s", "no_reply")

    async def ended(self) -> None:
        """Wait until the process has ended; it holds the ports longer than its announcement. Raises NotTakenError."""
        for _ in range(round(READY_S / _POLL_S)):
            if self._process is None or self._process.poll() is not None:
                return
            await asyncio.sleep(_POLL_S)
        raise NotTakenError(f"manual control did not end within {READY_S:g} s", "not_left")

    def leave(self) -> None:
        """End manual control, if it runs."""
        if self._process is None or self._process.poll() is not None:
            return
        for owner in self._find():
            if owner.pid == self._process.pid:
                with suppress(ControlError):
                    owner.ask("leave", within_s=1.0)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(READY_S)

    def forget(self) -> None:
        """Forget the output of the last process."""
        if self._output is not None:
            self._output.close()
            self._output = None

    @property
    def last_line(self) -> str:
        """Return the last line of a process that ended unexpectedly, else nothing."""
        if self._output is None or self._process is None or self._process.poll() in (None, 0):
            return ""
        self._output.seek(0)
        said = self._output.read().decode("utf-8", "replace").strip().splitlines()
        return said[-1].removeprefix("rig: ") if said else ""

    def _begun(self) -> "subprocess.Popen[bytes]":
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  # open until forget()
        return subprocess.Popen(
            words(self._config),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._output,
            start_new_session=True,  # Ctrl-C ends the panel, not this process.
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # the same on Windows
        )

    def _announced(self) -> bool:
        process = self._process
        alive = process is not None and process.poll() is None
        return alive and any(owner.pid == process.pid for owner in self._find() if process is not None)


GONE_S = 5.0
"""Time after which a tab that sends no requests counts as closed (s)."""


class Tabs:
    """Tabs that monitor the rig, and the tab that has control."""

    def __init__(self) -> None:
        self.holder: str | None = None
        self._open: Counter[str] = Counter()
        self._active_s = 0.0

    def opened(self, tab: str) -> None:
        """Register a tab."""
        self._open[tab] += 1

    def closed(self, tab: str, now_s: float) -> None:
        """Remove a tab."""
        self._open[tab] -= 1
        if self._open[tab] <= 0:
            del self._open[tab]
        if tab == self.holder:
            self._active_s = now_s

    def take(self, tab: str, now_s: float) -> None:
        """Give a tab control."""
        self.holder, self._active_s = tab, now_s

    def may(self, tab: str, now_s: float) -> bool:
        """Return whether a tab has control; the first tab that sends a request gets it."""
        if self.holder is None:
            self.take(tab, now_s)
        if tab == self.holder:
            self._active_s = now_s
        return tab == self.holder

    def look(self, now_s: float) -> None:
        """Release the control of a tab that was closed."""
        if self.holder is not None and self.holder not in self._open and now_s - self._active_s > GONE_S:
            self.holder = None
