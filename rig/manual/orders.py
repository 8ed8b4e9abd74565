"""Requests to the process of manual control, of which it carries out one at a time."""

import threading
from collections.abc import Mapping
from typing import Any, Literal

from pydantic import BaseModel, Field, ValidationError

from rig.clock import Clock
from rig.devices.base import Axis
from rig.engine.motion import Direction
from rig.engine.steps import MOST_MM
from rig.errors import LimitError, NotReadyError, first_problem

Verb = Literal["home", "zero", "zero anyway", "park"]

HOME_FIRST = "home first; nothing else moves until then, and homing starts with a lift"


class StepRequest(BaseModel):
    """Request for a step, from a tab of the panel."""

    axis: Axis
    sign: Literal[-1, 1]
    by_mm: float = Field(gt=0, le=MOST_MM)
    tab: str = Field(max_length=100)

    @classmethod
    def validated(cls, request: Mapping[str, Any]) -> "StepRequest":
        """Validate a request. Raises LimitError."""
        try:
            return cls.model_validate(request)
        except ValidationError as error:
            raise LimitError(str(first_problem("step", error)), "invalid_request") from None

    @property
    def direction(self) -> Direction:
        """Direction of the step."""
        return Direction(self.axis, self.sign)


Order = StepRequest | Verb

LATE_S = 1.0
"""Longest time between an order for a step and its beginning (s)."""


class Orders:
    """Next order from any thread, carried out by the moving thread; none is queued behind another."""

    def __init__(self, clock: Clock) -> None:
        self._lock, self._clock, self._taken_s = threading.RLock(), clock, 0.0
        self._next: Order | None = None
        self._doing: Order | None = None
        self.stopped = self.leaving = False
        self._stopped_since: bool  # since the present order began

    @property
    def busy(self) -> str | None:
        """Present or next order: home, zero, park or step."""
        order = self._order
        return "step" if isinstance(order, StepRequest) else order and order.partition(" ")[0]

    @property
    def tab(self) -> str | None:
        """Tab whose step is carried out."""
        order = self._order
        return order.tab if isinstance(order, StepRequest) else None

    @property
    def _order(self) -> Order | None:
        with self._lock:
            return self._doing or self._next

    # --- called by any thread ---

    def take(self, order: Order) -> None:
        """Take an order. Raises NotReadyError while another one is carried out, or after a stop."""
        with self._lock:
            if self.stopped and order != "home":
                raise NotReadyError(f"stopped: {HOME_FIRST}", "stopped")
            if self.busy is not None or self.leaving:
                raise NotReadyError(f"busy: {self.busy or 'leaving'}", "busy")
            self._next, self._taken_s = order, self._clock.monotonic_s()

    def stop(self) -> None:
        """Drop the next order, and refuse all but homing."""
        with self._lock:
            self.stopped = self._stopped_since = True
            self._next = None

    def leave(self) -> None:
        """Start nothing else; may be called from a signal handler."""
        self.leaving = True

    # --- called by the moving thread ---

    def begin_next(self) -> Order | None:
        """Return the next order; drop a step that had to wait, since nobody expects it any more."""
        with self._lock:
            late = self._clock.monotonic_s() - self._taken_s > LATE_S
            order = None if late and isinstance(self._next, StepRequest) else self._next
            self._doing, self._next, self._stopped_since = order, None, False
            return order

    def end(self) -> None:
        """Mark the present order as ended."""
        with self._lock:
            self._doing = None

    def clear_stop(self) -> None:
        """Clear a stop after homing, unless it came during the homing."""
        with self._lock:
            self.stopped = self._stopped_since
