"""Names of a protocol script: typed parameters, and `Rig` with its verbs."""

import inspect
from collections.abc import Callable, Mapping
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

from pydantic import BaseModel, ConfigDict, field_validator

from rig.protocol import steps
from rig.protocol.check import PressPlace, ScriptState
from rig.protocol.steps import Step
from rig.protocol.turns import Turns
from rig_shared.number_text import read_number

E = TypeVar("E")
A = TypeVar("A")
P = ParamSpec("P")


class ProtocolParameters(BaseModel):
    """Base class of a script's `Parameters`: typed, with defaults.

    Unknown keys and NaN are errors. A subclass adds fields with `rig.protocol.Field`.

    Examples
    --------
    >>> from rig.protocol import Field, ProtocolParameters
    >>> class Parameters(ProtocolParameters):
    ...     force_gwt: float = Field(2.33, gt=0, le=50, description="target force")
    >>> Parameters(force_gwt=8.0).force_gwt
    8.0
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True)

    @field_validator("*", mode="wrap")
    @classmethod
    def _plain_numbers(cls, value: Any, validated: Callable[[Any], Any]) -> Any:
        found = validated(value)
        if isinstance(value, str) and isinstance(found, int | float) and not isinstance(found, bool):
            read_number(value)
        return found


class Handler(Protocol):
    """Receiver of checked steps, which plans, executes or rehearses them, or answers from a journal."""

    def handle(self, step: Step[E, A], place: PressPlace) -> A:
        """Return the step's answer to the script."""


def _method(step: Callable[P, Step[Any, A]]) -> Callable[Concatenate["Rig", P], A]:
    """Return the method of `Rig` for a step class, with its arguments and documentation."""
    made: Any = step

    def method(rig: "Rig", /, *args: P.args, **arguments: P.kwargs) -> A:
        try:
            asked = step(*args, **arguments)
        except TypeError as error:
            raise TypeError(str(error).replace(f"{made.__name__}.__init__()", f"Rig.{made.verb}()")) from None
        return rig.do(asked)

    own = inspect.signature(step).parameters.values()
    answer = inspect.signature(made.execute).return_annotation
    method.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [inspect.Parameter("self", inspect.Parameter.POSITIONAL_OR_KEYWORD), *own], return_annotation=answer
    )
    method.__wrapped__ = made.execute  # type: ignore[attr-defined]
    method.__name__, method.__qualname__ = made.verb, f"Rig.{made.verb}"
    method.__doc__, method.__module__ = made.__doc__, __name__
    return method


class Rig:
    """Verbs of a protocol script.

    The program runs a script several times: to check it while nothing moves, and to carry it out. Each verb makes a
    step, checks it, and passes it to a handler. A script receives its `Rig` from the program.

    Parameters
    ----------
    parameters : ProtocolParameters
        The script's own `Parameters`.
    state : ScriptState
        State of the script while it is checked.
    handler : Handler
        What receives the checked steps.

    Examples
    --------
    >>> from rig.protocol import ProtocolParameters, Rig
    >>> class Parameters(ProtocolParameters):
    ...     force_gwt: float = 2.33
    >>> def run(rig: Rig) -> None:
    ...     rig.mount("bar:3.0")
    ...     rig.home()
    ...     rig.zero()
    ...     rig.move_to(x_mm=0.5)
    ...     rig.indent(force_gwt=rig.parameters.force_gwt, hold_s=1.0)
    """

    def __init__(self, parameters: ProtocolParameters, state: ScriptState, handler: Handler) -> None:
        self._parameters, self._state, self._handler = parameters, state, handler
        self._turns = Turns()

    @property
    def parameters(self) -> Any:
        """Parameters of the script, with the values of `--set`."""
        return self._parameters

    def mark(self, marks: Mapping[str, Any]) -> None:
        """Set the block, repeat and condition of the steps that follow.

        Schedules call this method; a script need not.

        Parameters
        ----------
        marks : mapping of str to object
            Values of `block`, `repeat` and `condition`; those that are left out are cleared.
        """
        self._state.marks = {name: value for name, value in marks.items() if value is not None}

    def do(self, step: Step[E, A]) -> A:
        """Carry out a step, or plan it, and return its answer; the verbs below do so with theirs.

        Parameters
        ----------
        step : Step
            The step, also of a class of your own.

        Returns
        -------
        object
            Answer of the step.

        Raises
        ------
        BadInputError
            If the step is not allowed here, or beyond a limit.
        """
        with self._turns.verb(step.verb):
            return self._handler.handle(step, step.check(self._state))

    mount = _method(steps.Mount)
    home = _method(steps.Home)
    zero = _method(steps.Zero)
    move_to = _method(steps.MoveTo)
    touch = _method(steps.Touch)
    indent = _method(steps.Indent)
    ramp = _method(steps.Ramp)
    precondition = _method(steps.Precondition)
    reference = _method(steps.Reference)
    retract = _method(steps.Retract)
    rest = _method(steps.Rest)
    checkpoint = _method(steps.Checkpoint)
    note = _method(steps.Note)
