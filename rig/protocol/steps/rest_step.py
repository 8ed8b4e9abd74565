"""The finger is let be."""

from dataclasses import dataclass
from typing import ClassVar

from rig.engine import Engine, verbs
from rig.protocol.refusals import refuse_seconds
from rig.protocol.steps.base import Owed, Step
from rig.protocol.walk import Spot, Walk


@dataclass(frozen=True, kw_only=True)
class Rest(Step[None, None]):
    """Let the finger be, at clearance."""

    verb: ClassVar[str] = "rest"
    owed: ClassVar[Owed] = Owed.LAST_IF_NEXT

    seconds: float

    def check(self, walk: Walk) -> Spot:
        walk.need(walk.homed, self.verb, "home()")
        refuse_seconds(self.verb, "seconds", self.seconds)
        return walk.spot()

    def carry_out(self, engine: Engine, expected: None) -> None:
        verbs.rest(engine, float(self.seconds))
