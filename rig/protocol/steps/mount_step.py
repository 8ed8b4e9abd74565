"""An indentor is put on."""

from dataclasses import dataclass
from typing import ClassVar

from rig.engine import Engine, verbs
from rig.protocol.errors import BadInputError
from rig.protocol.steps.base import Owed, Step
from rig.protocol.walk import Spot, Walk


@dataclass(frozen=True, kw_only=True)
class Mount(Step[None, None]):
    """Have an indentor mounted."""

    verb: ClassVar[str] = "mount"
    owed: ClassVar[Owed] = Owed.LAST

    indentor: str

    def check(self, walk: Walk) -> Spot:
        if not isinstance(self.indentor, str):
            raise BadInputError("{verb}: expected the name of an indentor, got {value!r}", code="no_name",
                                verb=self.verb, value=self.indentor)  # fmt: skip
        walk.model.refuse_shape(self.indentor)
        walk.indentor = self.indentor
        return walk.spot()

    def carry_out(self, engine: Engine, expected: None) -> None:
        verbs.mount(engine, self.indentor)
