"""Requests to the process of manual control: commands, and buttons that are held down."""

import threading
from collections.abc import Callable, Mapping
from typing import Any, Literal

from pydantic import BaseModel, Field, ValidationError

from rig.clock import Clock
from rig.devices.base import Axis
from rig.engine.dead_man import Direction
from rig.errors import LimitError, NotReadyError, first_problem
from rig.manual.jog import FASTEST_MM_S, HeldDirection
from rig.settings import SLOWEST_MM_S

HOLD_S = 0.25
"""A button signal is valid for this long after it was sent (s)."""

AHEAD_S = 1.0
"""Largest lead of the sender's clock (s)."""


class HoldRequest(BaseModel):
    """Signal that a button was down at unix_s; `press` numbers the presses of a tab."""

    axis: Axis
    sign: Literal[-1, 1]
    speed_mm_s: float = Field(ge=SLOWEST_MM_S, le=FASTEST_MM_S)
    tab: str = Field(max_length=100)
    press: int
    unix_s: float

    @classmethod
    def validated(cls, request: Mapping[str, Any]) -> "HoldRequest":
        """Validate a request. Raises LimitError."""
        try:
            return cls.model_validate(request)
        except ValidationError as error:
            raise LimitError(str(first_problem("hold", error)), "invalid_request") from None

    @property
    def direction(self) -> Direction:
        """Direction of the motion."""
        return Direction(self.axis, self.sign)

    def is_of(self, other: "HoldRequest") -> bool:
        """Return whether it is the same press of the same button."""
        return (self.tab, self.press, self.direction) == (other.tab, other.press, other.direction)


class Holds:
    """State of the held button. One press is one motion; after it ends, the button must be pressed again.

    The caller serializes access from several threads.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock, self._held = clock, HeldDirection(clock, HOLD_S)
        self.press: HoldRequest | None = None  # moves the stage or is about to, until `end`
        self._over: dict[str, int] = {}  # last press of each tab that has ended

    @property
    def live(self) -> bool:
        """Whether a button is held now."""
        return self._held() is not None

    def take(self, hold: HoldRequest) -> None:
        """Record a button signal. Raises LimitError if it is late, NotReadyError if another button is held."""
        ago_s = self._clock.unix_s() - hold.unix_s
        if not -AHEAD_S <= ago_s < HOLD_S:
            raise LimitError(
                f"the button signal is {ago_s:.2f} s old, at most {HOLD_S:g} s are allowed; press the button again",
                "late_hold",
            )
        if self._is_over(hold):
            raise NotReadyError("that motion has ended; press the button again", "motion_over")
        if self.press is None or not hold.is_of(self.press):
            if self.live:
                raise NotReadyError("busy: another button is held", "busy")
            self.drop()
            self.press = hold
        self._held.say(hold.direction, max(ago_s, 0.0))

    def release(self, tab: str, press: int) -> None:
        """Release a button, and every earlier press of its tab."""
        self._over[tab] = max(press, self._over.get(tab, press))
        if self.press is not None and self._is_over(self.press):
            self._held.say(None)

    def drop(self) -> None:
        """Release the button that is held."""
        if self.press is not None:
            self.release(self.press.tab, self.press.press)
            self.press = None

    def held(self, press: HoldRequest) -> Direction | None:
        """Return the direction while this press is held."""
        return self._held() if self.press is press else None

    def lapsed(self, press: HoldRequest) -> bool:
        """Return whether the signals of a press stopped without a release."""
        return not self._is_over(press) and not self.live

    def end(self, press: HoldRequest) -> None:
        """End a press; later signals of it are ignored."""
        self.release(press.tab, press.press)
        if self.press is press:
            self.press = None

    def _is_over(self, hold: HoldRequest) -> bool:
        return hold.tab in self._over and hold.press <= self._over[hold.tab]


Verb = Literal["home", "zero", "zero anyway"]

HOME_FIRST = "home first; nothing else moves until then, and homing starts with a lift"


class Orders:
    """Commands from any thread, carried out by the moving thread."""

    def __init__(self, clock: Clock) -> None:
        self._lock, self._holds = threading.RLock(), Holds(clock)
        self._verb: Verb | None = None  # requested
        self._doing: HoldRequest | Verb | None = None
        self.stopped = self.leaving = False
        self._stopped_since: bool  # since the present action began

    @property
    def busy(self) -> str | None:
        """Current or next action: home, zero or jog."""
        to_do = self._to_do
        return "jog" if isinstance(to_do, HoldRequest) else to_do and to_do.partition(" ")[0]

    @property
    def tab(self) -> str | None:
        """Tab whose button jogs."""
        to_do = self._to_do
        return to_do.tab if isinstance(to_do, HoldRequest) else None

    @property
    def _to_do(self) -> HoldRequest | Verb | None:
        with self._lock:
            return self._doing or self._verb or self._holds.press

    # --- called by any thread ---

    def hold(self, hold: HoldRequest) -> None:
        """Handle a button signal. Raises LimitError, NotReadyError."""
        with self._lock:
            self._refuse_stopped()
            if self.busy not in (None, "jog"):
                raise NotReadyError(f"busy: {self.busy}", "busy")
            self._holds.take(hold)

    def release(self, tab: str, press: int) -> None:
        """Handle the release of a button."""
        with self._lock:
            self._holds.release(tab, press)

    def do(self, verb: Verb) -> None:
        """Request homing or zeroing. Raises NotReadyError."""
        with self._lock:
            if verb != "home":
                self._refuse_stopped()
            if self.busy is not None:
                raise NotReadyError(f"busy: {self.busy}", "busy")
            self._verb = verb

    def stop(self) -> None:
        """Cancel all requests."""
        with self._lock:
            self.stopped = self._stopped_since = True
            self._holds.drop()
            self._verb = None

    def leave(self) -> None:
        """Release all buttons and start nothing else; may be called from a signal handler."""
        self.leaving = True

    # --- called by the moving thread ---

    def next(self) -> HoldRequest | Verb | None:
        """Return the next action."""
        with self._lock:
            self._doing, self._verb, self._stopped_since = self._to_do, None, False
            return self._doing

    def held(self, press: HoldRequest) -> Callable[[], Direction | None]:
        """Return a function that returns the direction of a press while it is held."""

        def held() -> Direction | None:
            with self._lock:
                return None if self.leaving else self._holds.held(press)

        return held

    def lapsed(self, done: HoldRequest | Verb) -> bool:
        """Return whether it is a press whose signals stopped without a release."""
        with self._lock:
            return isinstance(done, HoldRequest) and self._holds.lapsed(done)

    def over(self, done: HoldRequest | Verb) -> None:
        """Mark an action as ended."""
        with self._lock:
            self._doing = None
            if isinstance(done, HoldRequest):
                self._holds.end(done)

    def homed(self) -> None:
        """Clear a stop after homing, unless it came during the homing."""
        with self._lock:
            self.stopped = self._stopped_since

    def _refuse_stopped(self) -> None:
        if self.stopped:
            raise NotReadyError(f"stopped: {HOME_FIRST}", "stopped")
