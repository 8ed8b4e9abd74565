"""Steps of a script carried out by the engine, on hardware or on the virtual bench."""

from typing import TypeVar

from rig.engine import Engine
from rig.protocol.check import PressPlace, ScriptState
from rig.protocol.steps import Checkpoint, Note, Step

E = TypeVar("E")
A = TypeVar("A")


def execute(engine: Engine, step: Step[E, A], expected: E, *, rehearsal: bool = False) -> A:
    """Carry out a step as `step.expect` predicted, and return its answer; at its end all events are on disk."""
    try:
        answer = step.rehearse(engine, expected) if rehearsal else step.execute(engine, expected)
        engine.settle()
    except Exception:
        raise
    except BaseException:  # Stop the stage before the script can handle the exception.
        engine.stop()
        raise
    return answer


class Live:
    """Handler that carries out each step with the engine.

    A script may decide as it runs, so a step may differ from the plan. The state has checked it again, and the model
    predicts what the plan did not contain.
    """

    def __init__(self, engine: Engine, state: ScriptState) -> None:
        self._engine, self._state = engine, state

    def handle(self, step: Step[E, A], place: PressPlace) -> A:
        """Carry out the step and return its result; after a trip or a failure that the script swallowed, raise it."""
        if self._engine.problem is not None and not isinstance(step, Note | Checkpoint):
            raise self._engine.problem
        return execute(self._engine, step, step.expect(place, self._state))
