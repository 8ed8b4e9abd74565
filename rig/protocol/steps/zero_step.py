"""The force sensor is zeroed in the air."""

from dataclasses import dataclass
from typing import ClassVar

from rig.engine import Engine, verbs
from rig.protocol.steps.base import Owed, Step
from rig.protocol.walk import Spot, Walk


@dataclass(frozen=True, kw_only=True)
class Zero(Step[None, None]):
    """Zero the force sensor."""

    verb: ClassVar[str] = "zero"
    owed: ClassVar[Owed] = Owed.LAST

    def check(self, walk: Walk) -> Spot:
        walk.need(walk.homed, self.verb, "home()")
        walk.zeroed = True
        return walk.spot()

    def carry_out(self, engine: Engine, expected: None) -> None:
        verbs.zero(engine)
