"""A stop from another thread than the one that carries a run out."""

import threading
from collections.abc import Callable
from typing import Any

from rig.devices.stage.base import StageError
from rig.errors import RigError
from rig.session.control.stage_in_hand import StageInHand
from rig.transport import TransportError


def answer_to_a_stop(stop: Callable[[], None]) -> dict[str, Any]:
    """What whoever asked for it is told; also where the stage was not reached, or does not say that it stands."""
    try:
        stop()
    except (StageError, TransportError) as error:
        return {"stopped": True, "unconfirmed": str(error)}
    return {"stopped": True}


class EndedError(RigError):
    """What was to be stopped has ended. One line."""

    default_code = "ended"


class StopSwitch:
    """Stops the stage past whatever the main thread does, and then ends that.

    Whoever asks may come before the main thread is there to be ended, and after it has ended by itself. It learns of
    a stop when it begins, is interrupted meanwhile, and no stop is taken once it writes down how it ended.
    """

    def __init__(self, stage: StageInHand | None, interrupt: Callable[[], None]) -> None:
        """stage: None for a virtual bench, which the main thread stops itself. interrupt: ends what that does."""
        self._stage, self._interrupt_main = stage, interrupt
        self._one, self._guard = threading.Lock(), threading.Lock()
        self._taken, self._over = True, False
        self.stopped = False

    @property
    def kept(self) -> str:
        """The bytes that are in no run's byte log, as its lines."""
        return "" if self._stage is None else self._stage.kept

    def stop(self) -> None:
        """From any thread but the main one.

        Raises TransportError, StageError where the stage could not be told, EndedError where nothing of it moves any
        more.
        """
        with self._one:
            if self._over:
                raise EndedError("it has just ended: nothing of it moves any more")
            self.stopped = True  # first: whatever the main thread meets from now on is this
            try:
                if self._stage is not None:
                    self._stage.stop()
            finally:
                self._interrupt()

    def noticed(self) -> bool:
        """Whether there was a stop, which the main thread knows of from here on: it is not interrupted any more."""
        if self.stopped:
            with self._guard:
                self._taken = True
        return self.stopped

    def begins(self) -> None:
        """The main thread can be interrupted from here on. Raises KeyboardInterrupt where a stop has come before."""
        with self._guard:
            self._taken = already = self.stopped
        if already:
            raise KeyboardInterrupt

    def ready(self) -> None:
        """The main thread begins something else, which a stop may end."""
        with self._guard:
            self._taken = False

    def over(self) -> None:
        """The main thread is not interrupted any more. Returns when no stop is under way; none is taken after it."""
        with self._guard:
            self._taken = True
        with self._one:
            self._over = True

    def _interrupt(self) -> None:
        with self._guard:  # also while it is sent: none is on its way when over() returns
            if not self._taken:
                self._taken = True
                self._interrupt_main()
