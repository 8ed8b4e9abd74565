"""The home switches are found."""

import math
from dataclasses import dataclass
from typing import ClassVar

from rig.engine import Engine, verbs
from rig.protocol.steps.base import Owed, Step
from rig.protocol.walk import Spot, Walk


@dataclass(frozen=True, kw_only=True)
class Home(Step[None, None]):
    """Home the stage; a run that is taken up has homed before its first step."""

    verb: ClassVar[str] = "home"
    owed: ClassVar[Owed] = Owed.NOTHING

    def check(self, walk: Walk) -> Spot:
        walk.homed, walk.x_mm = True, math.nan
        return walk.spot()

    def carry_out(self, engine: Engine, expected: None) -> None:
        verbs.home(engine)
