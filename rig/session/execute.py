"""Steps carried out, on hardware or on the virtual bench."""

from typing import TypeVar

from rig.engine import Engine
from rig.protocol.check import Spot, Walk
from rig.protocol.steps import Step

E = TypeVar("E")
A = TypeVar("A")


class Live:
    """Has the engine do each step, with what the model expects of it.

    A script may decide as it goes, so what it asks now need not be what was planned: the walk has checked it once
    more, and what the plan did not ask the model is asked now.
    """

    def __init__(self, engine: Engine, walk: Walk) -> None:
        self._engine, self._walk = engine, walk

    def handle(self, step: Step[E, A], spot: Spot) -> A:
        """What the engine found."""
        return step.carry_out(self._engine, step.expect(spot, self._walk))
