"""Executors of the steps of a script, on hardware or on the virtual bench."""

from collections.abc import Callable
from typing import Any, TypeVar

from rig.engine import Engine, indentation, verbs
from rig.engine.reference import compare_reference
from rig.errors import BadInputError
from rig.protocol.check import Spot, Walk
from rig.protocol.steps import (
    Checkpoint,
    ExpectedPresses,
    ExpectedTouch,
    Home,
    Indent,
    Mount,
    MoveTo,
    Note,
    Precondition,
    Ramp,
    Reference,
    Rest,
    Retract,
    Step,
    Touch,
    Zero,
)
from rig.records import Indentation, PlannedIndentation, PressId

E = TypeVar("E")
A = TypeVar("A")
S = TypeVar("S")

Executor = Callable[[Engine, Any, Any], Any]
"""Function (engine, step, expected) that carries out a step and returns its answer to the script."""

EXECUTE: dict[type[Step[Any, Any]], Executor] = {}
"""Executors by step class."""


def executes(kind: type[Step[E, A]]) -> Callable[[Callable[[Engine, S, E], A]], Callable[[Engine, S, E], A]]:
    """Register the decorated function as the executor of a step class.

    It gets (engine, step, expected) and returns the step's answer. The class may be of a package or script of your
    own. A subclass needs its own executor.
    """

    def register(executor: Callable[[Engine, S, E], A]) -> Callable[[Engine, S, E], A]:
        EXECUTE[kind] = executor
        return executor

    return register


def execute(engine: Engine, step: Step[E, A], expected: E) -> A:
    """Carry out a step as `step.expect` predicted, and return its answer; at its end all events are on disk.

    Raises BadInputError if the step's class has no executor.
    """
    executor = EXECUTE.get(type(step))
    if executor is None:
        raise BadInputError(
            f"{step.verb}: no executor is registered for {type(step).__name__}; register a function with "
            f"@executes({type(step).__name__})",
            "no_executor",
        )
    try:
        answer: A = executor(engine, step, expected)
        engine.settle()
    except Exception:
        raise
    except BaseException:  # Stop the stage before the script can handle the exception.
        engine.stop()
        raise
    return answer


class Live:
    """Handler that carries out each step with the engine.

    A script may decide as it runs, so a step may differ from the plan. The walk has checked it again, and the model
    predicts what the plan did not contain.
    """

    def __init__(self, engine: Engine, walk: Walk) -> None:
        self._engine, self._walk = engine, walk

    def handle(self, step: Step[E, A], spot: Spot) -> A:
        """Carry out the step and return its result; after a trip or a failure that the script swallowed, raise it."""
        if self._engine.problem is not None and not isinstance(step, Note | Checkpoint):
            raise self._engine.problem
        return execute(self._engine, step, step.expect(spot, self._walk))


@executes(Home)
def home(engine: Engine, step: Home, expected: None) -> None:
    """Home the stage."""
    verbs.home(engine)


@executes(Mount)
def mount(engine: Engine, step: Mount, expected: None) -> None:
    """Ask the operator for the indentor."""
    verbs.mount(engine, step.indentor)


@executes(MoveTo)
def move_to(engine: Engine, step: MoveTo, expected: None) -> None:
    """Move to the position at clearance."""
    verbs.move_to(engine, float(step.x_mm), float(step.along_mm))


@executes(Indent)
def indent(engine: Engine, step: Indent, expected: ExpectedPresses) -> Indentation:
    """Press at the present position."""
    return _press(engine, expected.ids[0], expected.planned, step.speed_mm_s)


@executes(Ramp)
def ramp(engine: Engine, step: Ramp, expected: ExpectedPresses) -> Indentation:
    """Press at the present position at constant speed."""
    planned = expected.planned
    return indentation.ramp(
        engine,
        planned.target.value,
        float(step.speed_mm_s),
        hold_s=float(planned.hold_s),
        expected_contact_mm=planned.expected_contact_mm,
        contact_area_mm2=planned.contact_area_mm2,
        predicted=_predicted(planned),
        press_id=expected.ids[0],
    )


@executes(Precondition)
def precondition(engine: Engine, step: Precondition, expected: ExpectedPresses) -> None:
    """Press repeatedly at the planned position."""
    for press_id in expected.ids:
        verbs.be_over(engine, expected.planned.x_mm)
        _press(engine, press_id, expected.planned)


@executes(Reference)
def reference(engine: Engine, step: Reference, expected: ExpectedPresses) -> None:
    """Press at the reference position, and compare the forces with those of the first reference press."""
    verbs.be_over(engine, expected.planned.x_mm)
    band = expected.planned.band
    found = _press(engine, expected.ids[0], expected.planned)
    compare_reference(engine, found, None if band is None else band.force_gwt)


def _predicted(planned: PlannedIndentation) -> indentation.PredictedPress:
    return indentation.PredictedPress(round(planned.predicted_doi_mm, 6), round(planned.predicted_force_gwt, 6))


def _press(
    engine: Engine, press_id: PressId, planned: PlannedIndentation, speed_mm_s: float | None = None
) -> Indentation:
    return indentation.indent(
        engine,
        planned.target,
        increments=int(planned.increments),
        speed_mm_s=None if speed_mm_s is None else float(speed_mm_s),
        hold_s=float(planned.hold_s),
        expected_contact_mm=planned.expected_contact_mm,
        contact_area_mm2=planned.contact_area_mm2,
        predicted=_predicted(planned),
        press_id=press_id,
    )


@executes(Touch)
def touch(engine: Engine, step: Touch, expected: ExpectedTouch) -> float:
    """Find contact at the present position, and lift."""
    return indentation.touch_place(engine, expected.press.index, expected.contact_mm)


@executes(Rest)
def rest(engine: Engine, step: Rest, expected: None) -> None:
    """Wait at clearance."""
    verbs.rest(engine, float(step.seconds))


@executes(Retract)
def retract(engine: Engine, step: Retract, expected: None) -> None:
    """Lift to clearance."""
    verbs.retract(engine)


@executes(Zero)
def zero(engine: Engine, step: Zero, expected: None) -> None:
    """Zero the force sensor."""
    verbs.zero(engine)


@executes(Checkpoint)
def checkpoint(engine: Engine, step: Checkpoint, expected: None) -> None:
    """Journal the checkpoint."""
    verbs.checkpoint(engine, step.name)


@executes(Note)
def note(engine: Engine, step: Note, expected: None) -> None:
    """Journal the text."""
    verbs.note(engine, step.text)
