"""A step: one verb of a script as data, with what the plan checks, what it expects, and what the engine does.

A verb is a step in a file here, and the method of `rig.protocol.api.Rig` that makes one.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from rig.engine import Engine
from rig.protocol.walk import Spot, Walk

E = TypeVar("E")
A = TypeVar("A")


class Owed(Enum):
    """What a run that is taken up again owes of a step that lies before what is missing."""

    NOTHING = "nothing: it is done anyway, or of no consequence"
    LAST = "the last of its kind, before the next press"
    LAST_IF_NEXT = "the same, but not where that press is done already"
    ONCE = "it is journalled once and for all"
    ANSWER = "nothing where the journal has its answer, else the step itself"


class Journalled(Protocol):
    """A run that stopped, as its journal tells it."""

    @property
    def done(self) -> Mapping[int, list[dict[str, Any]]]:
        """The holds of every finished indentation, by index."""

    def stream(self, name: str) -> list[dict[str, Any]]:
        """The events of one stream."""


@dataclass(frozen=True, kw_only=True)
class Step(ABC, Generic[E, A]):
    """One verb with its arguments, as the script gave them; schedules fill in block, repeat and condition.

    E is what it expects of the model (None for most), A what it answers the script.
    """

    verb: ClassVar[str]
    owed: ClassVar[Owed]

    block: int | None = None
    repeat: int | None = None
    condition: str | None = None

    @property
    def marks(self) -> dict[str, Any]:
        """Where it stands in a schedule, as far as it stands in one."""
        given = {"block": self.block, "repeat": self.repeat, "condition": self.condition}
        return {name: value for name, value in given.items() if value is not None}

    @abstractmethod
    def check(self, walk: Walk) -> Spot:
        """Refuse what needs no model to be refused, and take the walk on. Raises BadInputError.

        Done for every step on every pass: a script may decide as it goes.
        """

    def expect(self, spot: Spot, walk: Walk) -> E:
        """What the model says, and refuse what lies beyond the limits by that. Raises BadInputError."""
        return None  # type: ignore[return-value]

    def foreseen(self, expected: E) -> A:
        """What the plan answers the script, nothing having moved."""
        return None  # type: ignore[return-value]

    @abstractmethod
    def carry_out(self, engine: Engine, expected: E) -> A:
        """Have the engine do it."""

    @classmethod
    def answers(cls, before: Journalled) -> dict[int, A]:
        """What a run that stopped has answered already, by the number of the press."""
        return {}
