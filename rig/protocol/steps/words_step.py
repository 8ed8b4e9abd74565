"""What a script writes into the journal."""

from dataclasses import dataclass
from typing import ClassVar

from rig.engine import Engine, verbs
from rig.protocol.errors import BadInputError
from rig.protocol.refusals import refuse_no_text
from rig.protocol.steps.base import Owed, Step
from rig.protocol.walk import Spot, Walk


@dataclass(frozen=True, kw_only=True)
class Checkpoint(Step[None, None]):
    """The script has come to here."""

    verb: ClassVar[str] = "checkpoint"
    owed: ClassVar[Owed] = Owed.ONCE

    name: str

    def check(self, walk: Walk) -> Spot:
        refuse_no_text(self.verb, self.name)
        if self.name in walk.checkpoints:
            raise BadInputError("{verb}: {name!r} has been passed already, expected another name",
                                code="passed_already", verb=self.verb, name=self.name)  # fmt: skip
        walk.checkpoints.add(self.name)
        return walk.spot()

    def carry_out(self, engine: Engine, expected: None) -> None:
        verbs.checkpoint(engine, self.name)


@dataclass(frozen=True, kw_only=True)
class Note(Step[None, None]):
    """A line."""

    verb: ClassVar[str] = "note"
    owed: ClassVar[Owed] = Owed.ONCE

    text: str

    def check(self, walk: Walk) -> Spot:
        refuse_no_text(self.verb, self.text)
        return walk.spot()

    def carry_out(self, engine: Engine, expected: None) -> None:
        verbs.note(engine, self.text)
