"""The stage of a run, its ports open for as long as the run is announced: a stop is one write, whatever is done."""

import io
import threading
from contextlib import closing, suppress
from typing import Self

from rig.devices.bench_settings import BenchSettings
from rig.devices.drivers import open_stage
from rig.devices.stage.base import Stage
from rig.transport import NotOwnedError, Transport, TransportError
from rig.transport.byte_log import Sink
from rig.transport.clock import WallClock
from rig.transport.stop_gate import StopGate

_OPEN_S = 3.0
_AGAIN_S = 0.005


class StageInHand:
    """Opened once, before anybody can ask for a stop; lent to the run's bench; closed when nobody can ask any more.

    A stage that was stopped is let go when the bench gives it back: somebody may have to lift it at once. Where a
    port was let go, or has dropped, it is opened anew for whoever needs it.
    """

    def __init__(self, settings: BenchSettings, clock: WallClock) -> None:
        """clock: the run's."""
        self.clock, self.gate = clock, StopGate()
        self._settings = settings
        self._kept = io.StringIO()
        self._log: Sink = self._kept
        self._stage: Stage | None = None
        self._wires: list[Transport] = []
        self._lent = False
        self._changing = threading.RLock()

    @property
    def kept(self) -> str:
        """The bytes that went while no run's byte log was there, as its lines."""
        return self._kept.getvalue()

    def write(self, text: str, /) -> None:
        """A line of a byte log, for the one that is there."""
        self._log.write(text)

    def open(self) -> Self:
        """Raises TransportError."""
        self._opened()
        return self

    def lend(self, byte_log: Sink) -> Stage:
        """To the run's bench, until it gives it back; meanwhile the bytes go to its log. Raises TransportError."""
        with self._changing:
            self._log = byte_log
            stage = self._stage
            if stage is None or self._dropped():
                stage = self._opened()
            self._lent = True
            return stage

    def give_back(self) -> None:
        """Its wires stay open for a stop, unless it was stopped."""
        with self._changing:
            self._lent, self._log = False, self._kept
            if self._stage is not None and not self._stage.homed:
                self.close()

    def active_inputs(self) -> frozenset[str]:
        """Ask a stage that has not been spoken to for its stop inputs; changes nothing. From the run's thread.

        Raises TransportError, StageError.
        """
        stage = self._stage or self._opened()
        stage.look()
        return stage.active_inputs()

    def stop(self) -> None:
        """From any thread but the run's; behind it nothing else goes out. Raises TransportError, StageError."""
        with self.gate.stopping(), self._changing:
            if self._stage is not None:
                with suppress(TransportError):
                    self._stage.stop()
                    if self._lent or not self._dropped():
                        return
            self._stop_anew()

    def close(self) -> None:
        """Give the ports back."""
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
        """Whether a wire has come to its end while nobody listened; what has come on it is not waited for."""
        try:
            for wire in self._wires:
                while wire.read(0.0):
                    pass
        except TransportError:
            return True
        return False

    def _stop_anew(self) -> None:
        """Through ports that are opened for it, beside whoever has them meanwhile: a stop waits for no lock."""
        deadline_s = self.clock.monotonic_s() + _OPEN_S
        while True:
            try:
                stage = self._opened()
                break
            except TransportError as busy:
                if isinstance(busy, NotOwnedError):
                    with suppress(TransportError):  # a gateway that takes one client: it may be free soon
                        self._stop_beside()
                        return
                if self.clock.monotonic_s() >= deadline_s:
                    raise
                self.clock.wait_s(_AGAIN_S)
        stage.stop()

    def _stop_beside(self) -> None:
        """Without owning the ports, which are given back at once: nothing but a stop may go out like this."""
        with closing(open_stage(self._settings, self.clock, self, self.gate.guarded, owned=False)) as stage:
            stage.stop()
