"""A stop from another thread than the one that carries a run out."""

import io
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

from rig.devices.bench_settings import BenchSettings
from rig.devices.drivers import open_stage
from rig.transport import TransportError
from rig.transport.clock import WallClock

_OPEN_S = 3.0
_AGAIN_S = 0.005


class StopSwitch:
    """Stops the stage past whatever the main thread does, and then ends that.

    Where the engine has the stage's port open, it is the stop of the heartbeat's thread; elsewhere the port is opened
    for it, as by `rig stop`, and `sent` has its bytes, as lines of a byte log.
    """

    def __init__(self, settings: BenchSettings | None, interrupt: Callable[[], None]) -> None:
        """settings: None for a virtual bench, which the main thread stops itself. interrupt: ends what that does."""
        self._settings, self._interrupt_main = settings, interrupt
        self._at_hand: Callable[[], None] | None = None
        self._one, self._guard = threading.Lock(), threading.Lock()
        self._taken = False
        self.stopped = False
        self.sent = io.StringIO()

    def stop(self) -> None:
        """From any thread but the main one. Raises TransportError, StageError where the stage could not be told."""
        with self._one:
            self.stopped = True  # first: whatever the main thread meets from now on is this
            try:
                self._tell_the_stage()
            finally:
                self._interrupt()

    @contextmanager
    def at_hand(self, stop: Callable[[], None]) -> Iterator[None]:
        """While the engine has the port open: what stops its stage, from any thread."""
        self._at_hand = None if self._settings is None else stop
        try:
            yield
        finally:
            self._at_hand = None

    def noticed(self) -> bool:
        """Whether there was a stop, which the main thread knows of from here on: it is not interrupted any more."""
        if self.stopped:
            with self._guard:
                self._taken = True
        return self.stopped

    def ready(self) -> None:
        """The main thread begins something else, which a stop may end."""
        with self._guard:
            self._taken = False

    def settled(self) -> None:
        """Returns when no stop is under way."""
        with self._one:
            pass

    def _tell_the_stage(self) -> None:
        if self._settings is None:
            return None
        clock = WallClock()
        deadline_s = clock.monotonic_s() + _OPEN_S
        while (stop := self._at_hand) is None:
            try:
                with closing(open_stage(self._settings, clock, self.sent)) as stage:
                    return stage.stop()
            except TransportError:
                if clock.monotonic_s() >= deadline_s:
                    raise
                self._interrupt()  # it may be about to open or to close the port
                clock.wait_s(_AGAIN_S)
        return stop()

    def _interrupt(self) -> None:
        with self._guard:
            if self._taken:
                return
            self._taken = True
        self._interrupt_main()
