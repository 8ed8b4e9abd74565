"""Stop of the stage from another thread or process, whatever the state of locks and disks."""

import io
import json
import os
import re
import sys
import threading
import tomllib
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from pydantic import ValidationError

from rig.clock import Clock, WallClock
from rig.control.client import Announced, ControlError, announced
from rig.devices.base import Stage, StageError
from rig.devices.make_drivers import open_stage, stage_driver
from rig.devices.registry import DEFAULTS, KindError, KnownBench, StageKind, checked, find, stage_ports
from rig.errors import RigError, first_problem
from rig.settings import BenchSettings, StageSettings
from rig.transport import NotOwnedError, PortOwner, Transport, TransportError, first_owner, open_port, port_owner
from rig.transport.stop_gate import StopGate
from rig.transport.wire import NeverQuietError, Sink, arrived
from rig_shared.user_files import MOST_TOML_BYTES, read_bytes, toml_of

_OPEN_S = 3.0
_IN_HAND_AGAIN_S = 0.005


class OwnedStage:
    """Stage that is opened once, before a stop can be requested, passed to the run's bench, and closed at the end.

    A stopped stage is closed when the bench returns it, because an operator may have to lift it at once. A port
    that was closed or lost is opened again when needed.
    """

    def __init__(self, settings: BenchSettings, clock: WallClock) -> None:
        """Prepare the stage, without opening it. clock: clock of the run, which may begin later."""
        self.clock, self.gate = clock, StopGate()
        self._settings = settings
        self._buffer = io.StringIO()
        self._log: Sink = self._buffer
        self._stage: Stage | None = None
        self._wires: list[Transport] = []
        self._lent = False
        self._changing = threading.RLock()

    @property
    def kept(self) -> str:
        """Byte log lines from outside of a run."""
        return self._buffer.getvalue()

    def write(self, text: str, /) -> None:
        """Write a line to the present byte log."""
        self._log.write(text)

    def open(self) -> Self:
        """Open the ports. Raises TransportError."""
        self._opened()
        return self

    def begin_run(self, run_s: float) -> None:
        """Begin a run, or its next part at run_s; bytes from before have times before it."""
        with self._changing:
            ahead_s = self.clock.begin_run(run_s)
            lines = [json.loads(line) for line in self._buffer.getvalue().splitlines()]
            self._buffer.seek(0)
            self._buffer.truncate()
            for line in lines:
                self._buffer.write(json.dumps({**line, "t_s": round(line["t_s"] - ahead_s, 6)}) + "\n")

    def lend(self, byte_log: Sink) -> Stage:
        """Pass the stage to the run's bench, and log its bytes there until the bench returns it. Raises
        TransportError.
        """
        with self._changing:
            self._log = byte_log
            stage = self._stage
            if stage is None or self._dropped():
                stage = self._opened()
            self._lent = True
            return stage

    def give_back(self) -> None:
        """Take the stage back; its ports stay open for a stop, unless it was stopped."""
        with self._changing:
            self._lent, self._log = False, self._buffer
            if self._stage is not None and not self._stage.homed:
                self.close()

    def active_inputs(self) -> frozenset[str]:
        """Return the stop inputs of a stage that may not be connected; changes nothing. From the run's thread.

        Raises TransportError, StageError.
        """
        stage = self._stage or self._opened()
        stage.look()
        return stage.active_inputs()

    def stop(self) -> None:
        """Stop from any thread but the run's; no later command is sent. Raises TransportError, StageError."""
        with self.gate.stopping(), self._changing:
            if self._stage is not None:
                with suppress(TransportError):
                    self._stage.stop()
                    if self._lent or not self._dropped():
                        return
            self._stop_anew()

    def close(self) -> None:
        """Close the ports."""
        with self._changing:
            stage, self._stage = self._stage, None
            self._wires.clear()
            if stage is not None:
                stage.close()

    def _opened(self) -> Stage:
        with self._changing:
            self.close()
            self._stage = open_stage(self._settings, self.clock, self, self._guarded)
            return self._stage

    def _guarded(self, wire: Transport) -> Transport:
        self._wires.append(wire)
        return self.gate.guarded(wire)

    def _dropped(self) -> bool:
        """Return whether a connection was closed meanwhile, without waiting."""
        try:
            for wire in self._wires:
                for _ in arrived(wire):
                    pass
        except NeverQuietError:
            return False
        except TransportError:
            return True
        return False

    def _stop_anew(self) -> None:
        """Stop through newly opened ports without the lock of their owner, because a stop waits for no lock."""
        deadline_s = self.clock.monotonic_s() + _OPEN_S
        while True:
            try:
                stage = self._opened()
                break
            except TransportError as busy:
                if isinstance(busy, NotOwnedError):
                    with suppress(TransportError):  # A gateway with a single client may become free soon.
                        self._stop_beside()
                        return
                if self.clock.monotonic_s() >= deadline_s:
                    raise
                self.clock.wait_s(_IN_HAND_AGAIN_S)
        stage.stop()

    def _stop_beside(self) -> None:
        """Stop without owning the ports, and close them at once; only a stop may do this."""
        with closing(open_stage(self._settings, self.clock, self, self.gate.guarded, owned=False)) as stage:
            stage.stop()


def answer_to_a_stop(stop: Callable[[], None]) -> dict[str, Any]:
    """Stop, and return the reply, even if the stage was not reached or does not report rest."""
    try:
        stop()
    except (StageError, TransportError) as error:
        return {"stopped": True, "unconfirmed": str(error)}
    return {"stopped": True}


class EndedError(RigError):
    """Error of a stop that came after the end."""

    default_code = "ended"


class StopSwitch:
    """Stop of the stage that also ends the main thread's work.

    A request may come before the main thread can be interrupted, and after its work has ended. The main thread
    checks for a stop when it begins, is interrupted later, and no stop is accepted while it records its end.
    """

    def __init__(self, stage: OwnedStage | None, interrupt: Callable[[], None]) -> None:
        """Prepare the switch. stage: None for a virtual bench, which the main thread stops itself. interrupt:
        interrupts the main thread.
        """
        self._stage, self._interrupt_main = stage, interrupt
        self._one, self._guard = threading.Lock(), threading.Lock()
        self._taken, self._over = True, False
        self.stopped = False

    @property
    def kept(self) -> str:
        """Byte log lines from outside of a run."""
        return "" if self._stage is None else self._stage.kept

    @property
    def clock(self) -> WallClock | None:
        """Clock of these lines."""
        return None if self._stage is None else self._stage.clock

    def stop(self) -> None:
        """Stop from any thread but the main one.

        Raises TransportError or StageError if the stage was not reached, EndedError if the work has ended.
        """
        with self._one:
            if self._over:
                raise EndedError("it has just ended, so it moves nothing")
            self.stopped = True  # Set first: it explains whatever fails in the main thread from now on.
            try:
                if self._stage is not None:
                    self._stage.stop()
            finally:
                self._interrupt()

    def noticed(self) -> bool:
        """Return whether there was a stop, after which the main thread is no longer interrupted."""
        if self.stopped:
            with self._guard:
                self._taken = True
        return self.stopped

    def begins(self) -> None:
        """Allow interrupts of the main thread. Raises KeyboardInterrupt if there was a stop before."""
        with self._guard:
            self._taken = already = self.stopped
        if already:
            raise KeyboardInterrupt

    def ready(self) -> None:
        """Allow interrupts of the main thread's next work."""
        with self._guard:
            self._taken = False

    def over(self) -> None:
        """Forbid interrupts of the main thread, wait for a stop in progress, and reject later stops."""
        with self._guard:
            self._taken = True
        with self._one:
            self._over = True

    def _interrupt(self) -> None:
        with self._guard:  # Also while it is sent: none is pending when over() returns.
            if not self._taken:
                self._taken = True
                self._interrupt_main()


_HEADER = re.compile(r"\s*\[+\s*[\"']?([A-Za-z_]\w*)")
_WHICH = ("kind", "port", "device_id")
_TRIES = 100  # number of invalid values that may be skipped


class NoStageError(RigError):
    """Error of a file that does not identify the stage."""

    default_code = "no_stage"


def stage_alone(path: Path) -> tuple[BenchSettings, tuple[str, ...]]:
    """Read [stage] of a configuration file, whatever errors the rest contains, with one line for each skipped value.

    An invalid value gets its default. The table of another kind is not read. Raises NoStageError if the file cannot
    be read, or kind, port or device id are invalid.
    """
    tables, passed = _tables(path)
    stage = _of_its_kind(tables.get("stage", {}))
    for _ in range(_TRIES):
        try:
            return KnownBench(stage=checked(StageSettings, stage)), tuple(passed)
        except ValidationError as error:
            where = [str(key) for key in error.errors(include_url=False)[0]["loc"]]
            wrong = NoStageError(str(first_problem(f"config {path}", error, within="stage")), "invalid_value")
            if not where or where[-1] in _WHICH or not _dropped(stage, where):
                raise wrong from None
            passed.append(str(wrong))
    raise NoStageError(f"config {path}: [stage] cannot be read")


def _tables(path: Path) -> tuple[dict[str, Any], list[str]]:
    try:
        text = read_bytes(path, MOST_TOML_BYTES).decode("utf-8-sig", "replace")
    except OSError as error:
        problem = str(error.strerror or error)
        raise NoStageError(f"config {path}: {problem}", "unreadable") from None
    try:
        return toml_of(text), []
    except tomllib.TOMLDecodeError as error:
        whole = NoStageError(f"config {path}: not valid TOML: {error}", "no_toml")
    try:
        return toml_of(_of_the_stage(text)), [str(whole)]
    except tomllib.TOMLDecodeError:
        raise whole from None


def _of_its_kind(stage: Any) -> Any:
    try:
        place = find(StageKind, stage.get("kind", DEFAULTS["stage"])).place
    except (AttributeError, KindError):
        return stage
    return {key: value for key, value in stage.items() if key == place or not isinstance(value, dict)}


def _of_the_stage(text: str) -> str:
    """Return the lines of [stage] and of its tables."""
    found, inside = [], False
    for line in text.splitlines():
        header = _HEADER.match(line)
        if header is not None:
            inside = header[1] == "stage"
        if inside:
            found.append(line)
    if not found:
        raise tomllib.TOMLDecodeError("no [stage]")
    return "\n".join(found)


def _dropped(table: Any, where: list[str]) -> bool:
    """Remove an invalid value, and return whether there was one; a location inside a list removes the list."""
    inner = table
    for n, key in enumerate(where):
        if not isinstance(inner, dict) or key not in inner:
            return False
        if n == len(where) - 1 or not isinstance(inner[key], dict):
            del inner[key]
            return True
        inner = inner[key]
    return False


BESIDE_S = 0.025
"""Time after which a silent owner is abandoned, and the bytes are sent beside it (s)."""

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
        result, route = self.result, _StopRoute(self._settings.stage, self._clock)
        try:
            with closing(stage_driver(lambda port: _LazyPort(port, route), self._clock, self._settings)) as stage:
                stage.stop()
                result.sent = True  # Whatever the reply is.
                state = stage.look().state
        except (StageError, TransportError) as error:
            route.problems.append(str(error))
        finally:
            result.sent = result.sent or route.sent
        result.problems += route.problems
        if not route.problems:  # One of two ports does not show the state of the whole stage.
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


class _LazyPort:
    """Transport of the stage for one stop, opened by its first byte; none waits for another that does not open."""

    def __init__(self, port: str, route: "_StopRoute") -> None:
        self.name, self._route = port, route
        self._wire: Transport | None = None
        self._dead = False

    def write(self, data: bytes) -> None:
        """Write; open the port first. Raises TransportError if it is the only port."""
        try:
            if self._wire is None and not self._dead:
                self._wire = self._route.open(self.name)
            if self._wire is not None:
                self._wire.write(data)
                self._route.sent = True
        except TransportError as error:
            self._dead = True
            self._route.problems.append(str(error))
            if self._route.only_one:
                raise

    def read(self, timeout_s: float) -> bytes:
        """Return received data; nothing if the port did not open. Raises TransportError."""
        if self._wire is not None and not self._dead:
            return self._wire.read(timeout_s)
        self._route.clock.wait_s(timeout_s)
        return b""

    def close(self) -> None:
        """Close the port."""
        if self._wire is not None:
            self._wire.close()


class _StopRoute:
    """Ports of the stage for one stop, and their problems."""

    def __init__(self, settings: StageSettings, clock: Clock) -> None:
        self._settings, self.clock = settings, clock
        self.only_one = len(stage_ports(settings)) == 1
        self.sent = False
        self.problems: list[str] = []

    def open(self, port: str) -> Transport:
        """Open a port that another process may own. Raises TransportError."""
        settings = self._settings
        return open_port(port, settings.baud, character=settings.character, dtr=settings.dtr, owned=False)
