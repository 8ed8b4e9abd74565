"""A place over the finger is gone to."""

from dataclasses import dataclass
from typing import ClassVar

from rig.engine import Engine, verbs
from rig.protocol.refusals import refuse_along, refuse_no_number, refuse_outside, refuse_place
from rig.protocol.steps.base import Owed, Step
from rig.protocol.walk import Spot, Walk


@dataclass(frozen=True, kw_only=True)
class MoveTo(Step[None, None]):
    """Go sideways, and along the finger, at clearance."""

    verb: ClassVar[str] = "move_to"
    owed: ClassVar[Owed] = Owed.LAST

    x_mm: float
    along_mm: float = 0.0

    def check(self, walk: Walk) -> Spot:
        settings = walk.settings
        walk.need(walk.homed, self.verb, "home()")
        refuse_no_number(self.verb, "x_mm", self.x_mm)
        refuse_along(self.along_mm, settings)
        refuse_outside(self.verb, "x_mm", self.x_mm, settings.limits.x_mm)
        refuse_place(self.x_mm, self.along_mm, settings)
        walk.x_mm, walk.along_mm = self.x_mm, self.along_mm
        return walk.spot()

    def carry_out(self, engine: Engine, expected: None) -> None:
        verbs.move_to(engine, float(self.x_mm), float(self.along_mm))
