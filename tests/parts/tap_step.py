"""A verb that is not there: the finger is tapped."""

from dataclasses import dataclass
from typing import ClassVar

from rig.engine import Engine
from rig.engine.indentation import touch_place
from rig.protocol.check import Spot, Walk, refuse_approach, refuse_count
from rig.protocol.steps import ExpectedTouch, Owed, Step


@dataclass(frozen=True, kw_only=True)
class Tap(Step[ExpectedTouch, None]):
    """Touch the present place so many times, to tell a subject that presses follow."""

    verb: ClassVar[str] = "tap"
    owed: ClassVar[Owed] = Owed.LAST

    times: int

    def check(self, walk: Walk) -> Spot:
        walk.need_ready(self.verb)
        refuse_count(self.verb, "times", self.times)
        return walk.spot("find", self.times)

    def expect(self, spot: Spot, walk: Walk) -> ExpectedTouch:
        contact_mm = walk.model.touch_height_mm(spot.indentor, spot.x_mm, spot.along_mm)
        refuse_approach(self.verb, contact_mm, walk.settings)
        return ExpectedTouch(spot.ids[0], contact_mm)

    def carry_out(self, engine: Engine, expected: ExpectedTouch) -> None:
        first = expected.press.index
        found = [touch_place(engine, first + k, expected.contact_mm) for k in range(self.times)]
        engine.record("tap", {"times": self.times, "x_mm": engine.x_mm, "contact_height_mm": sum(found) / self.times})
