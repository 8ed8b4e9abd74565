"""Stage of the process that owns it: opened once, and stopped from any thread of that process."""

import io
import json
import threading
from collections.abc import Callable
from contextlib import closing, suppress
from typing import Any, Self

from rig.clock import WallClock
from rig.devices.base import Stage, StageError
from rig.devices.make_drivers import open_stage
from rig.errors import RigError
from rig.settings import BenchSettings
from rig.transport import NotOwnedError, Transport, TransportError
from rig.transport.stop_gate import StopGate
from rig.transport.wire import NeverQuietError, Sink, arrived

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
