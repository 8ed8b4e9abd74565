"""A stop from a process that does not own the stage: it goes out whatever the state of owners, locks and disks is."""

import threading
from collections.abc import Callable, Iterable
from contextlib import closing, suppress
from dataclasses import dataclass, field
from typing import Any

from rig.devices.bench_settings import BenchSettings, StageSettings
from rig.devices.drivers import stage_driver
from rig.devices.stage.base import StageError
from rig.session.control.announcements import Announced, ControlError, announced
from rig.transport import NotOwnedError, PortOwner, Transport, TransportError, first_owner, open_port, port_owner
from rig.transport.clock import Clock, WallClock

BESIDE_S = 0.025
"""An owner that has not answered by then may hang: the bytes go out beside it."""

CONFIRMS_S = 1.5
"""How long one that was heard may take to say that the stage stands: a drive is told again for a second."""

LET_GO_S = 5.0
"""How long an owner is waited for that stops, or that alone can reach the stage."""

_AGAIN_S = 0.02
_AGAIN_FOR_S = 1.0


@dataclass
class SentStop:
    """What became of a stop.

    Attributes
    ----------
    ports : tuple of str
        Ports of the stage.
    sent : bool
        Whether bytes went out from this process.
    state : str or None
        What the stage reported behind the bytes; None where it has not answered.
    owner : PortOwner or None
        Who had the port when the stop came.
    told : tuple of int
        Processes that were told to stop, over their sockets or by a signal.
    confirmed_by : int or None
        Process that has answered that the stage was stopped.
    problems : list of str
        What stood in the way, one line each.
    """

    ports: tuple[str, ...]
    sent: bool = False
    state: str | None = None
    owner: PortOwner | None = None
    told: tuple[int, ...] = ()
    confirmed_by: int | None = None
    problems: list[str] = field(default_factory=list)

    @property
    def done(self) -> bool:
        """Whether the stage itself, or the process that has it, says that it was stopped."""
        return self.state is not None or self.confirmed_by is not None

    @property
    def words(self) -> str:
        """One line that begins with what is known about the stage."""
        ports = " and ".join(self.ports)
        if self.sent and self.state is not None:
            return f"Stop sent to {ports}: the stage reports {self.state}."
        if self.confirmed_by is not None:
            return f"Stop sent to {ports} by process {self.confirmed_by}, which has it."
        why = "; ".join(dict.fromkeys(self.problems)) or "the stage does not answer"
        if self.sent:
            return f"Stop sent to {ports}, not confirmed: {why}: use the emergency stop."
        return f"Stop NOT sent to {ports}: {why}: use the emergency stop."


def send_stop(
    settings: BenchSettings,
    *,
    signal: Callable[[int], object] | None = None,
    find: Callable[[], Iterable[Announced]] = announced,
) -> SentStop:
    """Stop a stage from outside of whatever owns it.

    Its owner is told first, which waits for nothing. The bytes then go out from here as well: at once where nobody
    has the port, behind an owner that stops and lets go of it, and beside one that does not answer within BESIDE_S.

    Parameters
    ----------
    settings : BenchSettings
        Of the stage.
    signal : callable, optional
        Tells a process by a signal; called only with one that holds the lock of the port and is of this account.
    find : callable
        Returns the processes that have announced themselves.

    Returns
    -------
    SentStop
        What became of it. Nothing is raised that stood in the way.
    """
    return _Stopping(settings, signal, find).stopped()


class _Stopping:
    """One stop."""

    def __init__(
        self,
        settings: BenchSettings,
        signal: Callable[[int], object] | None,
        find: Callable[[], Iterable[Announced]],
    ) -> None:
        self._settings, self._signal, self._find = settings, signal, find
        self._clock = WallClock()
        self._told: list[_Told] = []
        self.result = SentStop(settings.stage.ports)

    def stopped(self) -> SentStop:
        """In the order of what is surest and soonest."""
        self._tell()
        if self._by_itself():
            return self._with_answers()
        if not self._told:
            self._signal_owner()
        if self.result.owner is not None:  # where nobody has it, it only cannot be locked
            self._wait(lambda: self._lives or self._free, BESIDE_S)
            if self._lives:  # what it does about it, it does now, and nobody else should read the answers
                self._wait(lambda: self._answered or self._free, CONFIRMS_S)
            if self._lets_go:
                self._wait(lambda: self._free, LET_GO_S)
            if self._free and self._by_itself():
                return self._with_answers()
        self._carry_out(owned=False)
        if self.result.state is None and self.result.owner is not None:
            self._wait(lambda: self._answered or self._free, LET_GO_S)
            if not self._answered:
                self._signal_owner()
                self._wait(lambda: self._free, LET_GO_S if self.result.told else 0.0)
            self._by_itself()
        return self._with_answers()

    # --- whoever has the port ---

    def _tell(self) -> None:
        """Whoever has the port under any name, and whoever has let go of it and may take it again."""
        ports = self.result.ports
        holders = [owner.pid for port in ports if (owner := port_owner(port)) is not None]
        with suppress(OSError):  # nobody can be announced there
            for one in self._find():
                if not one.virtual and (one.pid in holders or set(one.ports) & set(ports)):
                    self._tell_one(one)

    def _tell_one(self, one: Announced) -> None:
        try:
            self._told.append(_Told(one))
        except ControlError as error:  # the signal is left
            self.result.problems.append(str(error))
        else:
            self.result.told += (one.pid,)

    def _signal_owner(self) -> None:
        owner = first_owner(self.result.ports)
        if self._signal is None or owner is None or owner.pid is None or not owner.ours:
            return
        with suppress(OSError):  # it has just ended
            self._signal(owner.pid)
            self.result.told += (owner.pid,)

    @property
    def _answered(self) -> bool:
        return any(one.answer is not None for one in self._told)

    @property
    def _lives(self) -> bool:
        return any(one.lives for one in self._told)

    @property
    def _lets_go(self) -> bool:
        """A run that was stopped gives its stage back, however it was told; what has it by hand keeps it."""
        return any(one.is_run and one.confirms for one in self._told)

    @property
    def _free(self) -> bool:
        return first_owner(self.result.ports) is None

    def _wait(self, ready: Callable[[], bool], within_s: float) -> None:
        self._clock.wait_until(ready, self._clock.monotonic_s() + within_s)

    def _with_answers(self) -> SentStop:
        result = self.result
        result.confirmed_by = next((one.pid for one in self._told if one.confirms), None)
        for one in self._told:
            if one.answer is None:
                result.problems.append(f"process {one.pid} was told to stop and does not answer")
            elif not one.confirms:
                result.problems.append(f"process {one.pid} was told to stop: {one.problem}")
        return result

    # --- the bytes ---

    def _by_itself(self) -> bool:
        """As the owner of the port; False where somebody else is that, or it cannot be locked."""
        deadline_s = self._clock.monotonic_s() + _AGAIN_FOR_S
        while True:
            try:
                self._carry_out(owned=True)
            except NotOwnedError as busy:
                self.result.owner = self.result.owner or busy.owner
                if busy.owner is None:
                    self.result.problems.append(str(busy))
                return False
            # A gateway for one client may need a moment to see that the last one has gone.
            if self.result.state is not None or not self.result.told or self._clock.monotonic_s() >= deadline_s:
                return True
            self._clock.wait_s(_AGAIN_S)

    def _carry_out(self, *, owned: bool) -> None:
        """Raises NotOwnedError; everything else that fails is noted."""
        wires = _Wires(self._settings.stage, self._clock, owned=owned)
        problems = wires.problems
        try:
            with closing(stage_driver(lambda port: _Way(port, wires), self._clock, self._settings)) as stage:
                stage.stop()
                self.result.sent = True  # whatever comes of the question
                state = stage.look().state
        except NotOwnedError:
            raise
        except (StageError, TransportError) as error:
            problems.append(str(error))
        finally:
            self.result.sent = self.result.sent or wires.sent
        self.result.problems += problems
        if not problems:  # of two wires one alone says nothing of the whole stage
            self.result.state = state


class _Told:
    """A process that was told over its socket, and what it answers, which is waited for elsewhere."""

    def __init__(self, one: Announced) -> None:
        """Raises ControlError."""
        self.pid, self.is_run = one.pid, one.kind == "run"
        self.lives = False
        self.answer: dict[str, Any] | None = None
        said = one.say_stop(self._heard)
        threading.Thread(target=self._listen, args=(said,), name="answer", daemon=True).start()

    @property
    def confirms(self) -> bool:
        """Whether it says that the stage was stopped."""
        return self.answer is not None and not self.problem

    @property
    def problem(self) -> str:
        """What it answered instead."""
        return str((self.answer or {}).get("unconfirmed", ""))

    def _heard(self) -> None:
        self.lives = True

    def _listen(self, answer: Callable[[float], dict[str, Any]]) -> None:
        try:
            self.answer = answer(LET_GO_S)
        except ControlError as error:
            self.answer = {"unconfirmed": str(error)}


class _Way:
    """A wire of the stage for one stop, opened by its first byte: none waits for another that cannot be opened."""

    def __init__(self, port: str, wires: "_Wires") -> None:
        self.name, self._wires = port, wires
        self._wire: Transport | None = None
        self._dead = False

    def write(self, data: bytes) -> None:
        """Raises NotOwnedError; TransportError where there is no other wire."""
        try:
            if self._wire is None and not self._dead:
                self._wire = self._wires.open(self.name)
            if self._wire is not None:
                self._wire.write(data)
                self._wires.sent = True
        except NotOwnedError:
            raise
        except TransportError as error:
            self._dead = True
            self._wires.problems.append(str(error))
            if self._wires.only_one:
                raise

    def read(self, timeout_s: float) -> bytes:
        """What comes; nothing where it could not be opened. Raises TransportError."""
        if self._wire is not None and not self._dead:
            return self._wire.read(timeout_s)
        self._wires.clock.wait_s(timeout_s)
        return b""

    def close(self) -> None:
        """Give it back."""
        if self._wire is not None:
            self._wire.close()


class _Wires:
    """Those of the stage, and what became of them."""

    def __init__(self, settings: StageSettings, clock: Clock, *, owned: bool) -> None:
        self._settings, self.clock, self._owned = settings, clock, owned
        self.only_one = len(settings.ports) == 1
        self.sent = False
        self.problems: list[str] = []

    def open(self, port: str) -> Transport:
        """Raises TransportError."""
        told = self._settings
        return open_port(port, told.baud, character=told.character, dtr=told.dtr, owned=self._owned)
