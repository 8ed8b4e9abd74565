"""Steps: each verb of a script as frozen data that checks itself and asks the model what to expect.

A verb is a step class here, the method of `rig.protocol.api.Rig` that makes one, and the function in
`rig.session.execute` that has the engine carry it out.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from rig.errors import BadInputError, around
from rig.protocol.check import (
    ForceTooDeepError,
    NoPredictionError,
    Spot,
    Walk,
    checked_target,
    refuse_along,
    refuse_approach,
    refuse_count,
    refuse_no_number,
    refuse_no_text,
    refuse_outside,
    refuse_place,
    refuse_pressure,
    refuse_reach,
    refuse_seconds,
    refuse_speeds,
    refuse_target,
)
from rig.records import Hold, Indentation, Pace, PlannedIndentation, PressId, Target

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

    @classmethod
    def answers(cls, before: Journalled) -> dict[int, A]:
        """What a run that stopped has answered already, by the number of the press."""
        return {}


@dataclass(frozen=True, kw_only=True)
class Home(Step[None, None]):
    """Home the stage; a run that is taken up has homed before its first step."""

    verb: ClassVar[str] = "home"
    owed: ClassVar[Owed] = Owed.NOTHING

    def check(self, walk: Walk) -> Spot:
        walk.homed, walk.x_mm = True, math.nan
        return walk.spot()


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


@dataclass(frozen=True, kw_only=True)
class MoveTo(Step[None, None]):
    """Go sideways, and along the finger, at clearance."""

    verb: ClassVar[str] = "move_to"
    owed: ClassVar[Owed] = Owed.LAST

    x_mm: float
    along_mm: float = 0.0

    def check(self, walk: Walk) -> Spot:
        settings = walk.settings
        walk.need(walk.homed, self.verb, "home()")
        refuse_no_number(self.verb, "x_mm", self.x_mm)
        refuse_along(self.along_mm, settings)
        refuse_outside(self.verb, "x_mm", self.x_mm, settings.limits.x_mm)
        refuse_place(self.x_mm, self.along_mm, settings)
        walk.x_mm, walk.along_mm = self.x_mm, self.along_mm
        return walk.spot()


@dataclass(frozen=True)
class ExpectedPresses:
    """The same press so many times at one place."""

    ids: tuple[PressId, ...]
    planned: PlannedIndentation


def check_press(
    verb: str, target: Target, walk: Walk, *, increments: int, hold_s: float, speed_mm_s: float | None = None
) -> None:
    """Refuse what needs no model to be refused."""
    walk.need_ready(verb)
    if walk.along_mm:
        raise BadInputError("{verb}: along_mm = {along_mm:g}: expected 0, elsewhere only touch()",
                            code="along_the_finger", verb=verb, along_mm=walk.along_mm)  # fmt: skip
    refuse_count(verb, "increments", increments)
    refuse_seconds(verb, "hold_s", hold_s)
    refuse_target(verb, target, walk.settings.limits)
    refuse_speeds(verb, speed_mm_s, walk.settings)


def expect_press(
    verb: str,
    target: Target,
    spot: Spot,
    walk: Walk,
    *,
    increments: int,
    hold_s: float,
    speed_mm_s: float | None = None,
) -> ExpectedPresses:
    """What the model says of it, within the limits."""
    habits = walk.settings.habits
    pace = Pace(speed_mm_s or habits.press_speed_mm_s, habits.increment_mm, increments, hold_s)
    try:
        found = walk.model.press(spot.indentor, spot.x_mm, target, pace)
    except ForceTooDeepError:
        raise BadInputError(
            "{verb}: {key} = {value:g} at x = {x_mm:g} mm is not reached at a DOI of limits.max_doi_mm = {high:g}",
            code="force_out_of_reach",
            verb=verb,
            key=target.kind,
            value=target.value,
            x_mm=spot.x_mm,
            high=walk.settings.limits.max_doi_mm,
        ) from None
    except NoPredictionError as error:
        raise around(BadInputError, "{verb}: {problem}", error, verb=verb) from None
    planned = PlannedIndentation(**vars(found), increments=increments, hold_s=hold_s)
    refuse_reach(verb, planned, walk.settings)
    refuse_pressure(verb, planned, walk.settings.limits)
    return ExpectedPresses(spot.ids, planned)


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


@dataclass(frozen=True, kw_only=True)
class Precondition(Step[ExpectedPresses, None]):
    """Press so many times at the present place."""

    verb: ClassVar[str] = "precondition"
    owed: ClassVar[Owed] = Owed.LAST

    presses: int
    doi_mm: float | None = None
    force_gwt: float | None = None
    hold_s: float = 1.0

    @property
    def target(self) -> Target:
        """The one that was given. Raises BadInputError."""
        return checked_target(self.verb, self.doi_mm, self.force_gwt)

    def check(self, walk: Walk) -> Spot:
        refuse_count(self.verb, "presses", self.presses)
        check_press(self.verb, self.target, walk, increments=1, hold_s=self.hold_s)
        walk.hold(self.verb, self.presses * self.hold_s)
        return walk.spot("precondition", self.presses, self.marks)

    def expect(self, spot: Spot, walk: Walk) -> ExpectedPresses:
        return expect_press(self.verb, self.target, spot, walk, increments=1, hold_s=self.hold_s)


@dataclass(frozen=True, kw_only=True)
class Reference(Step[ExpectedPresses, None]):
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

    def expect(self, spot: Spot, walk: Walk) -> ExpectedPresses:
        return expect_press(self.verb, self.target, spot, walk, increments=self.increments, hold_s=self.hold_s)


@dataclass(frozen=True, kw_only=True)
class Rest(Step[None, None]):
    """Let the finger be, at clearance."""

    verb: ClassVar[str] = "rest"
    owed: ClassVar[Owed] = Owed.LAST_IF_NEXT

    seconds: float

    def check(self, walk: Walk) -> Spot:
        walk.need(walk.homed, self.verb, "home()")
        refuse_seconds(self.verb, "seconds", self.seconds)
        return walk.spot()


@dataclass(frozen=True, kw_only=True)
class Retract(Step[None, None]):
    """Lift to clearance."""

    verb: ClassVar[str] = "retract"
    owed: ClassVar[Owed] = Owed.NOTHING

    def check(self, walk: Walk) -> Spot:
        walk.need(walk.homed, self.verb, "home()")
        return walk.spot()


@dataclass(frozen=True)
class ExpectedTouch:
    """Where the model has contact: height above the nominal apex, mm."""

    press: PressId
    contact_mm: float


@dataclass(frozen=True, kw_only=True)
class Touch(Step[ExpectedTouch, float]):
    """Touch off at the present place and lift; answers the height of contact."""

    verb: ClassVar[str] = "touch"
    owed: ClassVar[Owed] = Owed.ANSWER

    def check(self, walk: Walk) -> Spot:
        walk.need_ready(self.verb)
        return walk.spot("find", 1)

    def expect(self, spot: Spot, walk: Walk) -> ExpectedTouch:
        contact_mm = walk.model.touch_height_mm(spot.indentor, spot.x_mm, spot.along_mm)
        refuse_approach(self.verb, contact_mm, walk.settings)
        return ExpectedTouch(spot.ids[0], contact_mm)

    def foreseen(self, expected: ExpectedTouch) -> float:
        return expected.contact_mm

    @classmethod
    def answers(cls, before: Journalled) -> dict[int, float]:
        return {event["index"]: float(event["contact_height_mm"]) for event in before.stream("find")}


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


@dataclass(frozen=True, kw_only=True)
class Note(Step[None, None]):
    """A line."""

    verb: ClassVar[str] = "note"
    owed: ClassVar[Owed] = Owed.ONCE

    text: str

    def check(self, walk: Walk) -> Spot:
        refuse_no_text(self.verb, self.text)
        return walk.spot()


@dataclass(frozen=True, kw_only=True)
class Zero(Step[None, None]):
    """Zero the force sensor."""

    verb: ClassVar[str] = "zero"
    owed: ClassVar[Owed] = Owed.LAST

    def check(self, walk: Walk) -> Spot:
        walk.need(walk.homed, self.verb, "home()")
        walk.zeroed = True
        return walk.spot()
