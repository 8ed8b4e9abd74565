"""The finger is pressed to a depth or a force: data."""

from dataclasses import dataclass
from typing import ClassVar

from rig.engine import Engine, Hold, Indentation
from rig.engine.records import Target
from rig.protocol.refusals import checked_target
from rig.protocol.steps.base import Journalled, Owed, Step
from rig.protocol.steps.presses import ExpectedPresses, check_press, expect_press, press
from rig.protocol.walk import Spot, Walk


@dataclass(frozen=True, kw_only=True)
class Indent(Step[ExpectedPresses, Indentation]):
    """Touch off, press in equal increments, hold after each, lift."""

    verb: ClassVar[str] = "indent"
    owed: ClassVar[Owed] = Owed.ANSWER

    doi_mm: float | None = None
    force_gwt: float | None = None
    increments: int = 1
    speed_mm_s: float | None = None
    hold_s: float = 1.0

    @property
    def target(self) -> Target:
        """The one that was given. Raises BadInputError."""
        return checked_target(self.verb, self.doi_mm, self.force_gwt)

    def check(self, walk: Walk) -> Spot:
        check_press(
            self.verb,
            self.target,
            walk,
            increments=self.increments,
            hold_s=self.hold_s,
            speed_mm_s=self.speed_mm_s,
        )
        walk.hold(self.verb, self.increments * self.hold_s)
        return walk.spot("data", 1, self.marks)

    def expect(self, spot: Spot, walk: Walk) -> ExpectedPresses:
        return expect_press(
            self.verb,
            self.target,
            spot,
            walk,
            increments=self.increments,
            hold_s=self.hold_s,
            speed_mm_s=self.speed_mm_s,
        )

    def foreseen(self, expected: ExpectedPresses) -> Indentation:
        planned, n = expected.planned, self.increments
        holds = tuple(
            Hold(
                planned.target.part(k, n), planned.predicted_doi_mm * k / n, planned.predicted_force_gwt * k / n, 0.0
            )
            for k in range(1, n + 1)
        )
        return Indentation(expected.ids[0].index, planned.x_mm, holds)

    def carry_out(self, engine: Engine, expected: ExpectedPresses) -> Indentation:
        return press(engine, expected.ids[0], expected.planned, self.speed_mm_s)

    @classmethod
    def answers(cls, before: Journalled) -> dict[int, Indentation]:
        asked = {(e["index"], e["hold"]): Target(e["target"], e["commanded"]) for e in before.stream("hold_start")}
        return {
            index: Indentation(
                index,
                ends[0]["x_mm"],
                tuple(
                    Hold(asked[index, end["hold"]], end["doi_mm"], end["force_gwt"], end["force_sd_gwt"])
                    for end in ends
                ),
            )
            for index, ends in before.done.items()
        }
