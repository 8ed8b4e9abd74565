"""What is asked of the process at the bench: by threads that ask, of the one thread that does it, one at a time."""

import threading
from collections.abc import Callable
from typing import Literal

from rig.engine.by_hand import Direction
from rig.engine.errors import NotReadyError
from rig.session.by_hand.holds import Hold, Holds
from rig.transport.clock import Clock

Verb = Literal["home", "zero", "zero anyway"]

HOME_FIRST = "home first: nothing else moves until then, and homing lifts before anything else"


class Orders:
    """Whoever asks is refused, or has it begun as soon as the other thread comes by."""

    def __init__(self, clock: Clock) -> None:
        self._lock, self._holds = threading.RLock(), Holds(clock)
        self._verb: Verb | None = None  # asked for
        self._doing: Hold | Verb | None = None
        self.stopped = self.leaving = False
        self._stopped_since: bool  # what is done now was begun

    @property
    def busy(self) -> str | None:
        """What is done or about to be: home, zero or jog."""
        to_do = self._to_do
        return "jog" if isinstance(to_do, Hold) else to_do and to_do.partition(" ")[0]

    @property
    def tab(self) -> str | None:
        """Whose button it is that jogs."""
        to_do = self._to_do
        return to_do.tab if isinstance(to_do, Hold) else None

    @property
    def _to_do(self) -> Hold | Verb | None:
        with self._lock:
            return self._doing or self._verb or self._holds.press

    # what is asked, by any thread

    def hold(self, hold: Hold) -> None:
        """A button is down. Raises LimitError, NotReadyError."""
        with self._lock:
            self._refuse_stopped()
            if self.busy not in (None, "jog"):
                raise NotReadyError("busy: {busy}", code="busy", busy=self.busy)
            self._holds.take(hold)

    def release(self, tab: str, press: int) -> None:
        """It is down no more."""
        with self._lock:
            self._holds.release(tab, press)

    def do(self, verb: Verb) -> None:
        """Home or zero. Raises NotReadyError."""
        with self._lock:
            if verb != "home":
                self._refuse_stopped()
            if self.busy is not None:
                raise NotReadyError("busy: {busy}", code="busy", busy=self.busy)
            self._verb = verb

    def stop(self) -> None:
        """Nothing that was asked for counts any more."""
        with self._lock:
            self.stopped = self._stopped_since = True
            self._holds.drop()
            self._verb = None

    def leave(self) -> None:
        """What is held counts no more, and nothing else is begun; from a signal's handler, too."""
        self.leaving = True

    # what is done, by one thread

    def next(self) -> Hold | Verb | None:
        """What is to be done now."""
        with self._lock:
            self._doing, self._verb, self._stopped_since = self._to_do, None, False
            return self._doing

    def held(self, press: Hold) -> Callable[[], Direction | None]:
        """For the motion of a press: which way, as long as it is held."""

        def held() -> Direction | None:
            with self._lock:
                return None if self.leaving else self._holds.held(press)

        return held

    def lapsed(self, done: Hold | Verb) -> bool:
        """Whether it is a press whose button was not let go, and yet not heard of for too long."""
        with self._lock:
            return isinstance(done, Hold) and self._holds.lapsed(done)

    def over(self, done: Hold | Verb) -> None:
        """It is over."""
        with self._lock:
            self._doing = None
            if isinstance(done, Hold):
                self._holds.end(done)

    def homed(self) -> None:
        """A stop is over with that, unless it came later than what is done now began."""
        with self._lock:
            self.stopped = self._stopped_since

    def _refuse_stopped(self) -> None:
        if self.stopped:
            raise NotReadyError("stopped: {next}", code="stopped", next=HOME_FIRST)
