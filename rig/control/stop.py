"""Stop of the stage from outside of the process that owns it, whatever the state of locks and disks."""

import os
import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field
from typing import Any

from rig.clock import Clock, WallClock
from rig.control.client import BESIDE_S, Announced, ControlError, announced
from rig.devices.base import StageError
from rig.devices.make_drivers import stage_driver
from rig.devices.registry import stage_ports
from rig.settings import BenchSettings, StageSettings
from rig.transport import PortOwner, Transport, TransportError, first_owner, open_port, port_owner

CONFIRMS_S = 1.5
"""Time for a responsive owner to confirm that the stage is at rest (s): a drive repeats its stop for a second."""

LET_GO_S = 5.0
"""Longest wait for an owner that stops, or that alone can reach the stage (s)."""

END_S = 1.0
"""Time from the signal to an owner that does not answer to its end by the system (s)."""

ENDED_AFTER = sys.platform != "win32"
"""Whether a process that does not answer is ended after the bytes. No second program opens its port on Windows."""

_AGAIN_S = 0.02
_AGAIN_FOR_S = 1.0


@dataclass
class SentStop:
    """Result of a stop: whether this process sent bytes, and the processes that received and confirmed the stop.

    `state` of the stage is after the bytes, None without a reply; `owner` is that of the port at the time.
    """

    ports: tuple[str, ...]
    sent: bool = False
    state: str | None = None
    owner: PortOwner | None = None
    notified: tuple[int, ...] = ()
    confirmed_by: int | None = None
    problems: list[str] = field(default_factory=list)

    @property
    def done(self) -> bool:
        """Whether the stage or its owner confirms the stop."""
        return self.state is not None or self.confirmed_by is not None

    @property
    def words(self) -> str:
        """Result of the stop in one line, with advice if it was not confirmed."""
        ports = " and ".join(self.ports)
        if self.sent and self.state is not None:
            return f"Stop sent to {ports}: the stage reports {self.state}."
        if self.confirmed_by is not None:
            return f"Stop sent to {ports} by process {self.confirmed_by}, which owns the stage."
        begin = f"Stop sent to {ports} but not confirmed" if self.sent else f"Stop NOT sent to {ports}"
        why = "; ".join(dict.fromkeys(self.problems)) or "the stage does not answer"
        if self.owner is not None and self.owner.pid is not None and not self.owner.same_account:
            return f"{begin}, held by another account: use the emergency stop. Cause: {why}"
        return f"{begin}. Use the emergency stop. Cause: {why}"


def send_stop(settings: BenchSettings) -> SentStop:
    """Stop a stage from outside of its owner, and end no process; problems are in the result, not raised."""
    return OutsideStop(settings).send()


class OutsideStop:
    """Stop of a stage from outside of its owner.

    The stop is sent to every owner at once, without waiting. This process then sends the bytes as well, without
    owning the port: at once if the port has no owner, after an owner that stops and releases it, and beside one that
    does not reply within BESIDE_S. Only then a process that holds the port and does not answer is ended, and only if
    the lock proves that it holds the port and it belongs to this account. On Windows it is ended first, because no
    second program can open its port; there the note in the user's own folder names it.
    """

    def __init__(
        self,
        settings: BenchSettings,
        signals: Sequence[int] = (),
        find: Callable[[], Iterable[Announced]] = announced,
    ) -> None:
        """Prepare a stop. signals: end an owner that does not answer, the gentlest first; none ends no process."""
        self._settings, self._signals, self._find = settings, signals, find
        self._clock = WallClock()
        self._recipients: list[_Recipient] = []
        self.result = SentStop(stage_ports(settings.stage))

    def send(self) -> SentStop:
        """Stop by the surest and fastest ways first."""
        result = self.result
        self._notify()
        if result.owner is not None and self._recipients:
            self._wait(lambda: self._lives or self._free, BESIDE_S)
            if self._lives:  # It acts now, and must be the only reader of the replies.
                self._wait(lambda: self._answered or self._free, CONFIRMS_S)
            if self._lets_go:
                self._wait(lambda: self._free, LET_GO_S)
            if not ENDED_AFTER:
                self._wait(lambda: self._answered or self._free, CONFIRMS_S)
                self.end_holder()
        self._send_bytes()
        if result.state is None and result.owner is not None:
            if self._lives:
                self._wait(lambda: self._answered or self._free, LET_GO_S)
            self.end_holder()
            if self._free:
                self._send_bytes()
        return self._with_answers()

    def end_holder(self) -> str | None:
        """End a process that holds the port and does not answer, and return a line about it."""
        pid = self._holder()
        if pid is None:
            return None
        grace_s = END_S if self._recipients else LET_GO_S  # One without a socket cannot answer.
        if self._recipients:
            self._wait(lambda: self._holder() != pid, CONFIRMS_S)
        for number in self._signals if self._holder() == pid else ():
            with suppress(OSError):  # The process has just ended.
                os.kill(pid, number)
                self.result.notified = tuple(dict.fromkeys((*self.result.notified, pid)))
            self._wait(lambda: self._holder() != pid, grace_s)
            if self._holder() != pid:
                return f"process {pid} did not answer and was ended" if self._free else None
        return None

    # --- owner of the port ---

    def _notify(self) -> None:
        """Send the stop to the owner of the port under any name, and to a process that may take it again."""
        ports = self.result.ports
        holders = [owner for port in ports if (owner := port_owner(port)) is not None]
        self.result.owner = next(iter(holders), None)
        with suppress(OSError):  # Then no process can be announced there.
            for one in self._find():
                if not one.virtual and (one.pid in [owner.pid for owner in holders] or set(one.ports) & set(ports)):
                    self._notify_one(one)

    def _notify_one(self, one: Announced) -> None:
        try:
            self._recipients.append(_Recipient(one))
        except ControlError as error:  # The signal remains.
            self.result.problems.append(str(error))
        else:
            self.result.notified += (one.pid,)

    def _holder(self) -> int | None:
        """Return the process of this account that proves to hold the port, and has not answered."""
        owner = first_owner(self.result.ports)
        silent = [one.pid for one in self._recipients if one.answer is None]
        if owner is None or (owner.pid is not None and not owner.same_account):
            return None
        if not ENDED_AFTER:
            return next(iter(silent), None)
        answered = {one.pid for one in self._recipients} - set(silent)
        return None if owner.pid in answered else owner.pid

    @property
    def _answered(self) -> bool:
        return any(one.answer is not None for one in self._recipients)

    @property
    def _lives(self) -> bool:
        return any(one.lives for one in self._recipients)

    @property
    def _lets_go(self) -> bool:
        """Whether the owner closes the port: a stopped run does, manual control does not."""
        return any(one.is_run and one.confirms for one in self._recipients)

    @property
    def _free(self) -> bool:
        return first_owner(self.result.ports) is None

    def _wait(self, ready: Callable[[], bool], within_s: float) -> None:
        self._clock.wait_until(ready, self._clock.monotonic_s() + within_s)

    def _with_answers(self) -> SentStop:
        result = self.result
        self._wait(lambda: self._lives or not self._recipients, BESIDE_S)
        self._wait(lambda: self._answered or not self._lives, CONFIRMS_S)
        result.confirmed_by = next((one.pid for one in self._recipients if one.confirms), None)
        for one in self._recipients:
            if one.answer is None:
                result.problems.append(f"process {one.pid} was asked to stop but does not answer")
            elif not one.confirms:
                result.problems.append(f"process {one.pid} was asked to stop: {one.problem}")
        return result

    # --- bytes ---

    def _send_bytes(self) -> None:
        """Send the stop, again while a gateway with a single client has not noticed that the last one is gone."""
        deadline_s = self._clock.monotonic_s() + _AGAIN_FOR_S
        while True:
            self._send_once()
            again = self.result.state is None and self.result.notified and self._free
            if not again or self._clock.monotonic_s() >= deadline_s:
                return
            self._clock.wait_s(_AGAIN_S)

    def _send_once(self) -> None:
        """Send the stop without owning the port; failures are noted."""
        settings, result, problems, state = self._settings, self.result, list[str](), None

        def port(name: str) -> _StopPort:
            return _StopPort(name, settings.stage, self._clock, result, problems)

        try:
            with closing(stage_driver(port, self._clock, settings)) as stage:
                stage.stop()
                result.sent = True  # Whatever the reply is.
                state = stage.look().state
        except (StageError, TransportError) as error:
            problems.append(str(error))
        result.problems += problems
        if not problems:  # One of two ports does not show the state of the whole stage.
            result.state = state


class _Recipient:
    """Process that received the stop over its socket, and its reply, read by another thread."""

    def __init__(self, one: Announced) -> None:
        """Send the stop. Raises ControlError."""
        self.pid, self.is_run = one.pid, one.kind == "run"
        self.lives = False
        self.answer: dict[str, Any] | None = None
        wait_for_reply = one.post_stop(self._noted)
        threading.Thread(target=self._listen, args=(wait_for_reply,), name="answer", daemon=True).start()

    @property
    def confirms(self) -> bool:
        """Whether the process confirms the stop."""
        return self.answer is not None and not self.problem

    @property
    def problem(self) -> str:
        """Problem that it reports instead."""
        return str((self.answer or {}).get("unconfirmed", ""))

    def _noted(self) -> None:
        self.lives = True

    def _listen(self, answer: Callable[[float], dict[str, Any]]) -> None:
        try:
            self.answer = answer(LET_GO_S)
        except ControlError as error:
            if error.code != "no_reply":
                self.answer = {"unconfirmed": str(error)}


class _StopPort:
    """Transport of the stage for one stop, opened by its first byte without owning it.

    A port that does not open keeps no other one from its stop: its problem is noted, and it answers nothing.
    """

    def __init__(
        self, name: str, settings: StageSettings, clock: Clock, result: SentStop, problems: list[str]
    ) -> None:
        self.name, self._settings, self._clock = name, settings, clock
        self._result, self._problems = result, problems
        self._wire: Transport | None = None
        self._dead = False

    def write(self, data: bytes) -> None:
        """Write; open the port first. Raises TransportError if it is the only port."""
        try:
            if self._wire is None and not self._dead:
                stage = self._settings
                self._wire = open_port(self.name, stage.baud, character=stage.character, dtr=stage.dtr, owned=False)
            if self._wire is not None:
                self._wire.write(data)
                self._result.sent = True
        except TransportError as error:
            self._dead = True
            self._problems.append(str(error))
            if len(self._result.ports) == 1:
                raise

    def read(self, timeout_s: float) -> bytes:
        """Return received data; nothing if the port did not open. Raises TransportError."""
        if self._wire is not None and not self._dead:
            return self._wire.read(timeout_s)
        self._clock.wait_s(timeout_s)
        return b""

    def close(self) -> None:
        """Close the port."""
        if self._wire is not None:
            self._wire.close()
