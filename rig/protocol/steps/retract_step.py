"""The indentor is lifted."""

from dataclasses import dataclass
from typing import ClassVar

from rig.engine import Engine, verbs
from rig.protocol.steps.base import Owed, Step
from rig.protocol.walk import Spot, Walk


@dataclass(frozen=True, kw_only=True)
class Retract(Step[None, None]):
    """Lift to clearance."""

    verb: ClassVar[str] = "retract"
    owed: ClassVar[Owed] = Owed.NOTHING

    def check(self, walk: Walk) -> Spot:
        walk.need(walk.homed, self.verb, "home()")
        return walk.spot()

    def carry_out(self, engine: Engine, expected: None) -> None:
        verbs.retract(engine)
