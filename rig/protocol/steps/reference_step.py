"""The same press again and again, to see whether the finger still answers the same: no data."""

from dataclasses import dataclass
from typing import ClassVar

from rig.engine import Engine, verbs
from rig.engine.pressing.reference import Reference as Comparison
from rig.engine.records import Target
from rig.protocol.errors import BadInputError
from rig.protocol.refusals import checked_target
from rig.protocol.steps.base import Owed, Step
from rig.protocol.steps.move_to_step import MoveTo
from rig.protocol.steps.presses import ExpectedPresses, check_press, expect_press, press
from rig.protocol.walk import Spot, Walk


@dataclass(frozen=True)
class ExpectedReference(ExpectedPresses):
    """A press, and what its forces are compared with."""

    comparison: Comparison


@dataclass(frozen=True, kw_only=True)
class Reference(Step[ExpectedReference, None]):
    """Go there and press; an alarm where force at depth is not what it was the first time."""

    verb: ClassVar[str] = "reference"
    owed: ClassVar[Owed] = Owed.LAST

    x_mm: float
    doi_mm: float
    increments: int = 2
    hold_s: float = 0.5

    @property
    def target(self) -> Target:
        """A depth. Raises BadInputError."""
        return checked_target(self.verb, self.doi_mm, None)

    def check(self, walk: Walk) -> Spot:
        MoveTo(x_mm=self.x_mm).check(walk)
        check_press(self.verb, self.target, walk, increments=self.increments, hold_s=self.hold_s)
        self._refuse_another(walk)
        walk.hold(self.verb, self.increments * self.hold_s)
        return walk.spot("reference", 1, self.marks)

    def _refuse_another(self, walk: Walk) -> None:
        asked = (walk.indentor, self.x_mm, self.doi_mm, self.increments, self.hold_s)
        first = walk.reference_asked = walk.reference_asked or asked
        if asked != first:
            raise BadInputError(
                "{verb}: expected the same press each time, {indentor} at x = {x_mm:g} mm to {doi_mm:g} mm in "
                "{increments}",
                code="another_reference",
                verb=self.verb,
                indentor=first[0],
                x_mm=first[1],
                doi_mm=first[2],
                increments=first[3],
            )

    def expect(self, spot: Spot, walk: Walk) -> ExpectedReference:
        found = expect_press(self.verb, self.target, spot, walk, increments=self.increments, hold_s=self.hold_s)
        return ExpectedReference(found.ids, found.planned, walk.reference)

    def carry_out(self, engine: Engine, expected: ExpectedReference) -> None:
        verbs.be_over(engine, expected.planned.x_mm)
        band = expected.planned.band
        found = press(engine, expected.ids[0], expected.planned)
        expected.comparison.compare(engine, found, None if band is None else band.force_gwt)
