"""The skin is pressed until it answers the same: no data."""

from dataclasses import dataclass
from typing import ClassVar

from rig.engine import Engine, verbs
from rig.engine.records import Target
from rig.protocol.refusals import checked_target, refuse_count
from rig.protocol.steps.base import Owed, Step
from rig.protocol.steps.presses import ExpectedPresses, check_press, expect_press, press
from rig.protocol.walk import Spot, Walk


@dataclass(frozen=True, kw_only=True)
class Precondition(Step[ExpectedPresses, None]):
    """Press so many times at the present place."""

    verb: ClassVar[str] = "precondition"
    owed: ClassVar[Owed] = Owed.LAST

    presses: int
    doi_mm: float | None = None
    force_gwt: float | None = None
    hold_s: float = 1.0

    @property
    def target(self) -> Target:
        """The one that was given. Raises BadInputError."""
        return checked_target(self.verb, self.doi_mm, self.force_gwt)

    def check(self, walk: Walk) -> Spot:
        refuse_count(self.verb, "presses", self.presses)
        check_press(self.verb, self.target, walk, increments=1, hold_s=self.hold_s)
        walk.hold(self.verb, self.presses * self.hold_s)
        return walk.spot("precondition", self.presses, self.marks)

    def expect(self, spot: Spot, walk: Walk) -> ExpectedPresses:
        return expect_press(self.verb, self.target, spot, walk, increments=1, hold_s=self.hold_s)

    def carry_out(self, engine: Engine, expected: ExpectedPresses) -> None:
        for press_id in expected.ids:
            verbs.be_over(engine, expected.planned.x_mm)
            press(engine, press_id, expected.planned)
