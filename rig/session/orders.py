"""Presses ordered one by one by another program, within what a person has confirmed.

The script of such a run waits for orders; each one becomes the verbs of any protocol, with the same checks. The plan
contains the highest press at every position, so the page, the limits and the soft trip are those of any run.
"""

import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rig.clock import WallClock
from rig.engine import Engine, verbs
from rig.errors import BadInputError, first_problem
from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.check import PressPlace, ScriptState
from rig.protocol.script import Script
from rig.protocol.steps import ResumeRule, Step

E = TypeVar("E")
A = TypeVar("A")

LOOK_S = 0.005
_AT_MM = 1e-9


class OrderScope(ProtocolParameters):
    """Limits of the orders of a run, which a person confirms: the highest press, the positions and the numbers."""

    indentor: str = Field(description="shape of the indentor")
    x_mm: tuple[float, ...] = Field((0.0,), min_length=1, description="positions of the presses")
    doi_mm: float | None = Field(None, gt=0, description="deepest press past contact; or force_gwt")
    force_gwt: float | None = Field(None, gt=0, description="highest force of a press")
    presses: int = Field(1, ge=1, le=1000, description="number of presses at most")
    increments: int = Field(1, ge=1, le=100, description="increments of a press at most")
    hold_s: float = Field(1.0, gt=0, description="longest hold")

    @property
    def highest(self) -> dict[str, float]:
        """Target of the highest press, as an argument of `Rig.indent`."""
        return _target(self.doi_mm, self.force_gwt)


def _target(doi_mm: float | None, force_gwt: float | None) -> dict[str, float]:
    targets = {"doi_mm": doi_mm, "force_gwt": force_gwt}
    return {name: value for name, value in targets.items() if value is not None}


class Order(BaseModel):
    """One order: a move to a position at clearance, a press there, the end of the run, or a lift from a press."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    what: Literal["move", "press", "leave", "lift"]
    x_mm: float | None = None
    doi_mm: float | None = None
    force_gwt: float | None = None
    increments: int = Field(1, ge=1)
    hold_s: float = Field(1.0, gt=0)

    @property
    def target(self) -> dict[str, float]:
        """Target of the press."""
        return _target(self.doi_mm, self.force_gwt)


@dataclass(frozen=True, kw_only=True)
class NextOrder(Step[None, Order | None]):
    """Wait at clearance for the next order; None ends the run."""

    verb: ClassVar[str] = "next_order"
    on_resume: ClassVar[ResumeRule] = ResumeRule.NOTHING

    planned: Order | None
    orders: "PressOrders"

    def check(self, state: ScriptState) -> PressPlace:
        return state.place()

    def foreseen(self, expected: None) -> Order | None:
        return self.planned

    def execute(self, engine: Engine, expected: None) -> Order | None:
        return self.orders.next(engine)

    def rehearse(self, engine: Engine, expected: None) -> Order | None:
        return self.planned


class PressOrders:
    """Orders of a run: other threads put them in, one at a time, and the script carries them out."""

    def __init__(self, scope: OrderScope, alone: Callable[[], bool] = lambda: False) -> None:
        """Prepare to read orders. alone: returns whether their sender has ended, which ends the run."""
        self.scope, self._alone = scope, alone
        self.end: Callable[[], None] = lambda: None  # Ends the run at the next safe point, lifted.
        self._guard = threading.Lock()
        self._waiting = False
        self._order: Order | None = None
        self._presses = 0

    def as_script(self) -> Script:
        """Return the script that carries out orders."""
        return Script(Path(__file__), "orders", "Presses ordered by another program", "", self.scope, self.run)

    def run(self, rig: Rig) -> None:
        """Mount, home and zero, then carry out orders until the last one."""
        rig.mount(self.scope.indentor)
        rig.home()
        at_mm = self.scope.x_mm[0]
        rig.move_to(x_mm=at_mm)
        rig.zero()
        planned = self._planned()
        while order := rig.do(NextOrder(planned=next(planned, None), orders=self)):
            if order.x_mm is not None and (order.what == "move" or order.x_mm != at_mm):
                at_mm = order.x_mm
                rig.move_to(x_mm=at_mm)
            if order.what == "press":
                rig.indent(**order.target, increments=order.increments, hold_s=order.hold_s)

    def _planned(self) -> Iterator[Order]:
        scope = self.scope
        for n in range(scope.presses):
            x_mm, held = scope.x_mm[n % len(scope.x_mm)], {"increments": scope.increments, "hold_s": scope.hold_s}
            yield Order(what="press", x_mm=x_mm, **scope.highest, **held)  # type: ignore[arg-type]

    # --- orders from other threads ---

    @property
    def answers(self) -> Mapping[str, Callable[[Mapping[str, Any]], dict[str, Any]]]:
        """Handlers of requests, by name."""
        return {"order": self.take}

    def take(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Put in an order for the waiting run. Raises BadInputError if it is not allowed; nothing moves then."""
        try:
            order = Order.model_validate({key: value for key, value in request.items() if key != "do"})
        except ValidationError as error:
            raise first_problem("order", error) from None
        with self._guard:
            self._refuse(order)
            if order.what == "lift" and not self._waiting:
                self.end()
                return {}
            if not self._waiting:
                raise BadInputError("order: the run is not ready for an order; wait for the last one", "busy")
            self._waiting, self._order = False, order
            self._presses += order.what == "press"
        return {}

    def _refuse(self, order: Order) -> None:
        """Raise an error for an order outside the confirmed scope."""
        scope = self.scope
        if order.what == "press" and order.target.keys() != scope.highest.keys():
            raise BadInputError(
                f"order: a press needs {next(iter(scope.highest))} alone, as it was confirmed", "another_target"
            )
        if order.what == "move" and order.x_mm is None:
            raise BadInputError("order: a move needs x_mm", "no_position")
        if order.x_mm is not None and all(abs(order.x_mm - x_mm) > _AT_MM for x_mm in scope.x_mm):
            expected = ", ".join(f"{x_mm:g}" for x_mm in scope.x_mm)
            raise BadInputError(
                f"order: x_mm = {order.x_mm:g}: the confirmed positions are {expected}", "another_position"
            )
        most = {"increments": scope.increments, "hold_s": scope.hold_s, **scope.highest}
        asked = {"increments": order.increments, "hold_s": order.hold_s, **order.target}
        for key in most if order.what == "press" else ():
            if not 0 < asked[key] <= most[key]:
                raise BadInputError(
                    f"order: {key} = {asked[key]:g}: more than 0 and at most {most[key]:g} was confirmed",
                    "not_confirmed",
                )
        if order.what == "press" and self._presses >= scope.presses:
            raise BadInputError(f"order: all {scope.presses} confirmed presses are done", "too_many_presses")

    # --- the run's own thread ---

    def next(self, engine: Engine) -> Order | None:
        """Wait for the next order at clearance; None ends the run.

        A pause takes effect there, and a stop input or a lost device ends the run.
        """
        with self._guard:
            self._waiting, self._order = True, None
        clock = WallClock()
        look = verbs.LooksAtClearance(engine, clock)
        while True:
            verbs.safe_point(engine)
            look()
            order, over = self._look()
            if order is not None:
                return None if order.what in ("leave", "lift") else order
            if over:
                return None
            clock.wait_s(LOOK_S)

    def _look(self) -> tuple[Order | None, bool]:
        """Return the order if there is one, and whether no order can follow."""
        with self._guard:
            over = self._order is None and self._alone()
            self._waiting = self._waiting and not over
            return self._order, over


def scope_of(values: Mapping[str, Any]) -> OrderScope:
    """Return the checked limits of orders. Raises BadInputError."""
    try:
        scope = OrderScope.model_validate(values)
    except ValidationError as error:
        raise first_problem("orders", error) from None
    if len(scope.highest) != 1:
        raise BadInputError("orders: expected either doi_mm or force_gwt", "not_one_target")
    return scope
