"""The finger is touched and left again."""

from dataclasses import dataclass
from typing import ClassVar

from rig.engine import Engine
from rig.engine.pressing.indent import touch_place
from rig.engine.records import PressId
from rig.protocol.refusals import refuse_approach
from rig.protocol.steps.base import Journalled, Owed, Step
from rig.protocol.walk import Spot, Walk


@dataclass(frozen=True)
class ExpectedTouch:
    """Where the model has contact: height above the nominal apex, mm."""

    press: PressId
    contact_mm: float


@dataclass(frozen=True, kw_only=True)
class Touch(Step[ExpectedTouch, float]):
    """Touch off at the present place and lift; answers the height of contact."""

    verb: ClassVar[str] = "touch"
    owed: ClassVar[Owed] = Owed.ANSWER

    def check(self, walk: Walk) -> Spot:
        walk.need_ready(self.verb)
        return walk.spot("find", 1)

    def expect(self, spot: Spot, walk: Walk) -> ExpectedTouch:
        contact_mm = walk.model.touch_height_mm(spot.indentor, spot.x_mm, spot.along_mm)
        refuse_approach(self.verb, contact_mm, walk.settings)
        return ExpectedTouch(spot.ids[0], contact_mm)

    def foreseen(self, expected: ExpectedTouch) -> float:
        return expected.contact_mm

    def carry_out(self, engine: Engine, expected: ExpectedTouch) -> float:
        return touch_place(engine, expected.press.index, expected.contact_mm)

    @classmethod
    def answers(cls, before: Journalled) -> dict[int, float]:
        return {event["index"]: float(event["contact_height_mm"]) for event in before.stream("find")}
