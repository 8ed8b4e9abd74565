"""Processes that own ports, the one behind the panel among them, and which tab has the controls."""

import asyncio
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import IO, Any, Literal, Protocol

from rig.control.client import ControlError, RefusedError
from rig.errors import RigError

STOP_S = 3.0
"""Time (s) for which the panel polls an owner after a stop, until the drives report that they stand."""


class Owner(Protocol):
    """A process that owns ports (rig/control/client.py: Announced)."""

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
        """Its answer. Raises RefusedError, ControlError."""
        ...

    def say_stop(self, *, by: str = "") -> Callable[[float], dict[str, Any]]:
        """Send a stop without waiting; the returned function waits for the answer. Raises ControlError."""
        ...


Find = Callable[[], Sequence[Owner]]


def shown(owners: Sequence[Owner]) -> Owner | None:
    """Return the owner that a page shows: real before virtual, then newest first."""
    return max(owners, key=lambda one: (not one.virtual, one.began_unix_s), default=None)


def owner_told(owner: Owner, status: dict[str, Any] | None) -> dict[str, Any]:
    """`owner` of the state; status: its last answer, None where it gave none."""
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
    """The folder of the owner's run, once it exists."""
    return None if owner.run is None else Path(owner.run)


class NobodyError(RigError):
    """No owner exists for the request."""

    default_code = "nobody"


def asked(owner: Owner | None, kind: str, do: str, within_s: float, **more: Any) -> dict[str, Any]:
    """An owner's answer. Raises NobodyError where it is none of that kind, RefusedError, ControlError."""
    if owner is None or owner.kind != kind:
        if kind == "run":
            raise NobodyError("no protocol is running", code="no_run")
        raise NobodyError("manual control is off; take control first", code="bench_not_taken")
    return owner.ask(do, within_s=within_s, **more)


Said = Mapping[int, Callable[[float], dict[str, Any]]]
"""Owners that were requested to stop, by process, with the functions that receive their answers."""


def say_stop(owners: Sequence[Owner]) -> Said:
    """Send a stop to every real owner and to the shown one, without waiting; skip unreachable owners."""
    said = {}
    for one in _to_be_stopped(owners):
        with suppress(ControlError):
            said[one.pid] = one.say_stop(by="panel")
    return said


def stop_all(owners: Sequence[Owner], said: Said, pool: ThreadPoolExecutor) -> dict[str, Any]:
    """Stop the remaining owners in parallel, and return the answers of all.

    Raises NobodyError without an owner, ControlError if one does not answer, RefusedError if all refuse.
    """
    there = _to_be_stopped(owners)
    if not there:
        raise NobodyError("no process owns the ports, so there is nothing to stop", code="nothing_to_stop")
    stopping = partial(_stopped, said)
    others = pool.map(stopping, there[1:])
    answers = [stopping(there[0]), *others]
    for problem in answers:
        if isinstance(problem, ControlError) and not isinstance(problem, RefusedError):
            raise problem
    stopped = [one.pid for one, answer in zip(there, answers, strict=True) if not isinstance(answer, ControlError)]
    if not stopped:
        raise RefusedError("{problems}", code="all_refuse", problems="; ".join(map(str, answers)))
    return {"stopped": stopped, "words": f"the stop reached process {', '.join(map(str, stopped))}"}


def _to_be_stopped(owners: Sequence[Owner]) -> list[Owner]:
    return [one for one in owners if not one.virtual or one is shown(owners)]


def _stopped(said: Said, owner: Owner) -> dict[str, Any] | ControlError:
    answered = said.get(owner.pid)
    try:
        answer = owner.ask("stop", within_s=STOP_S) if answered is None else answered(STOP_S)
    except ControlError as error:
        return error
    if "unconfirmed" in answer:
        return ControlError(
            "stop sent to process {pid}: {problem}",
            code="stop_not_confirmed", pid=owner.pid, problem=answer["unconfirmed"],
        )  # fmt: skip
    return answer


READY_S = 15.0
_LOOK_S = 0.05


class NotTakenError(RigError):
    """The bench could not be taken. One line."""

    default_code = "not_taken"


def words(config: Path | None) -> list[str]:
    """Return the command line of the process."""
    return [sys.executable, "-m", "rig", "by-hand", "--config", str(config)]


class ByHandProcess:
    """At most one; it owns the ports, and ends with this process."""

    def __init__(self, config: Path | None, find: Find) -> None:
        self._config, self._find = config, find
        self._process: subprocess.Popen[bytes] | None = None
        self._said: IO[bytes] | None = None
        self._taking = asyncio.Lock()

    async def take(self) -> None:
        """Start manual control, and wait until the process has announced itself. Raises NotTakenError."""
        async with self._taking:
            if await asyncio.to_thread(self._announced):
                return
            await self.ended()
            self.forget()
            self._process = self._begun()
            for _ in range(round(READY_S / _LOOK_S)):
                if await asyncio.to_thread(self._announced):
                    return
                if self._process.poll() is not None:
                    if self.last_words:
                        raise NotTakenError("{said}", code="refused", said=self.last_words)
                    code = self._process.returncode
                    raise NotTakenError("it ended with exit code {exit_code}", code="ended", exit_code=code)
                await asyncio.sleep(_LOOK_S)
            self._process.terminate()
            raise NotTakenError(
                "manual control did not start within {within_s:g} s", code="no_reply", within_s=READY_S
            )

    async def ended(self) -> None:
        """Wait until the process has ended; it holds the ports longer than its announcement. Raises NotTakenError."""
        for _ in range(round(READY_S / _LOOK_S)):
            if self._process is None or self._process.poll() is not None:
                return
            await asyncio.sleep(_LOOK_S)
        raise NotTakenError("manual control did not end within {within_s:g} s", code="not_left", within_s=READY_S)

    def leave(self) -> None:
        """Have it leave the bench, where it is there."""
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
        if self._said is not None:
            self._said.close()
            self._said = None

    @property
    def last_words(self) -> str:
        """Return the last line of a process that ended unexpectedly, else nothing."""
        if self._said is None or self._process is None or self._process.poll() in (None, 0):
            return ""
        self._said.seek(0)
        said = self._said.read().decode("utf-8", "replace").strip().splitlines()
        return said[-1].removeprefix("rig: ") if said else ""

    def _begun(self) -> "subprocess.Popen[bytes]":
        self._said = tempfile.TemporaryFile()  # noqa: SIM115  # until it is forgotten
        return subprocess.Popen(
            words(self._config),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._said,
            start_new_session=True,  # Ctrl-C is the panel's
        )

    def _announced(self) -> bool:
        process = self._process
        there = process is not None and process.poll() is None
        return there and any(owner.pid == process.pid for owner in self._find() if process is not None)


GONE_S = 5.0
"""Time in s after which a tab that sends no requests counts as closed."""


class Tabs:
    """The tabs that monitor the rig, and the tab that has control."""

    def __init__(self) -> None:
        self.holder: str | None = None
        self._looking: Counter[str] = Counter()
        self._heard_s = 0.0
        self._released = 0

    def opened(self, tab: str) -> None:
        """Register a tab."""
        self._looking[tab] += 1

    def closed(self, tab: str, now_s: float) -> None:
        """It does so no more."""
        self._looking[tab] -= 1
        if self._looking[tab] <= 0:
            del self._looking[tab]
        if tab == self.holder:
            self._heard_s = now_s

    def take(self, tab: str, now_s: float) -> None:
        """The controls are its own from here on."""
        if tab != self.holder:
            self._released = 0
        self.holder, self._heard_s = tab, now_s

    def may(self, tab: str, now_s: float) -> bool:
        """Return whether a tab has control; the first tab that sends a request gets it."""
        if self.holder is None:
            self.take(tab, now_s)
        if tab == self.holder:
            self._heard_s = now_s
        return tab == self.holder

    def look(self, now_s: float) -> None:
        """Whoever has left gives the controls back."""
        if self.holder is not None and self.holder not in self._looking and now_s - self._heard_s > GONE_S:
            self.holder = None

    def release(self, press: int) -> None:
        """A button was let go; nothing more comes of what was pressed before."""
        self._released = max(self._released, press)

    def is_released(self, press: int) -> bool:
        """Return whether the button was released."""
        return press <= self._released
