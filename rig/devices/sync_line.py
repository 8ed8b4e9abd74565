"""Lines that carry the pulse for a recording amplifier: an output of the stage, or RTS or DTR of a serial adapter."""

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple, Protocol

from rig.clock import Clock
from rig.devices.base import Stage
from rig.errors import RigError
from rig.settings import SyncSettings
from rig.transport import SerialTransport, TransportError

CONFIRMED_S = 0.1
"""Longest wait for an adapter to confirm a level (s); a lift after a pulse waits no longer for it."""


class SyncLineError(RigError):
    """Error of the line of a serial adapter, which neither moves nor senses anything."""

    default_code = "sync_line_lost"


class SyncLine(Protocol):
    """Line to the recording amplifier; another kind of output is another class with this method."""

    def switch(self, on: bool) -> tuple[float, float]:
        """Begin or end a pulse; return when it was requested and when it was confirmed (s on the clock).

        Raises StageError or TransportError of the stage's own output, SyncLineError of any other line.
        """
        ...


class StageOutput:
    """Output of the stage's controller."""

    def __init__(self, stage: Stage, clock: Clock) -> None:
        self._stage, self._clock = stage, clock

    def switch(self, on: bool) -> tuple[float, float]:
        """Switch the output; the controller confirms it."""
        requested_s = self._clock.monotonic_s()
        self._stage.set_output(on)
        return requested_s, self._clock.monotonic_s()


class AdapterOutput:
    """RTS or DTR of a serial adapter, at rest from its opening to its closing but for the pulses.

    Each switch has a thread of its own, because an adapter that is lost may block the system call for seconds.
    Raises TransportError if the port cannot be opened or has no such line; NotOwnedError if it is owned.
    """

    def __init__(self, settings: SyncSettings, clock: Clock) -> None:
        adapter = settings.adapter
        assert adapter is not None
        self.name, self._line, self._inverted = str(adapter), adapter.name, settings.inverted
        self._clock = clock
        levels = {"rts": False, "dtr": False, adapter.name: settings.inverted}
        try:
            self._port = SerialTransport(adapter.port, dtr=levels["dtr"], rts=levels["rts"])
        except TransportError as error:
            error.args = (f"sync.output: {error}",)
            raise
        try:
            self._port.set_line(self._line, level=settings.inverted)
        except TransportError as error:
            self._port.close()
            raise TransportError(
                f"sync.output: {adapter.port} has no {adapter.name.upper()} line ({error}); use the port of a serial "
                "adapter",
                "no_line",
            ) from error

    def switch(self, on: bool) -> tuple[float, float]:
        """Set the line; confirmed is the return of the system call."""
        return self._within(lambda: self._port.set_line(self._line, level=on != self._inverted))

    def answers(self) -> bool:
        """Return whether the input beside the line, CTS of RTS or DSR of DTR, has the level of a pulse."""
        return self._port.input_of(self._line) != self._inverted

    def close(self) -> None:
        """Put the line at rest and release the port."""
        with suppress(SyncLineError):
            self.switch(False)
        with suppress(SyncLineError):
            self._within(self._port.close)

    def _within(self, act: Callable[[], None]) -> tuple[float, float]:
        """Call a function in a thread; return its beginning and end (s).

        Raises SyncLineError if it fails or does not return in time.
        """
        problem, times, done = list[TransportError](), list[float](), threading.Event()

        def call() -> None:
            times.append(self._clock.monotonic_s())
            try:
                act()
                times.append(self._clock.monotonic_s())
            except TransportError as error:
                problem.append(error)
            finally:
                done.set()

        threading.Thread(target=call, name=f"sync line {self.name}", daemon=True).start()
        if not done.wait(CONFIRMED_S):
            raise SyncLineError(f"{self.name} did not confirm within {CONFIRMED_S:g} s", "sync_line_late")
        if problem:
            raise SyncLineError(f"{self.name}: {problem[0]}") from problem[0]
        requested_s, confirmed_s = times
        return requested_s, confirmed_s


class Pulse(NamedTuple):
    """Pulse that was sent: when its rise was requested and confirmed (s on the clock), and how long it lasted (s)."""

    requested_s: float
    rise_s: float
    width_s: float

    @property
    def uncertainty_s(self) -> float:
        """Time from the request to the confirmation of the rise (s): it may have been earlier by as much."""
        return self.rise_s - self.requested_s


def send_pulse(line: SyncLine, clock: Clock, width_s: float, during: Callable[[], None] | None = None) -> Pulse:
    """Send one pulse; return when its end is confirmed. Raises what the line raises.

    during: called once the rise is confirmed; its time is part of the width.
    """
    requested_s, rise_s = line.switch(True)
    if during is not None:
        during()
    clock.wait_s(max(rise_s + width_s - clock.monotonic_s(), 0.0))
    _, fall_s = line.switch(False)
    return Pulse(requested_s, rise_s, fall_s - rise_s)
