"""Steps: each verb of a script as frozen data that checks itself and requests its prediction.

A verb is a step class here, the method of `rig.protocol.api.Rig` that creates one, and the function in
`rig.session.execute` that carries it out.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from rig.errors import BadInputError
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
    refuse_no_ramps,
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
    """Part of a step before the first missing press that a resumed run repeats."""

    NOTHING = "nothing: it is done anyway, or of no consequence"
    LAST = "the last of its kind, before the next press"
    LAST_OF_INDENTOR = "the same, but nothing once another indentor is mounted"
    LAST_IF_NEXT = "the last of its kind, but not where the next press is done already"
    ONCE = "it is journalled once and for all"
    ANSWER = "nothing where the journal has its answer, else the step itself"


class Journalled(Protocol):
    """Stopped run, read from its journal."""

    @property
    def done(self) -> Mapping[int, list[dict[str, Any]]]:
        """Holds of each finished indentation, by index."""

    def stream(self, name: str) -> Sequence[dict[str, Any]]:
        """Return the events of a stream."""


@dataclass(frozen=True, kw_only=True)
class Step(ABC, Generic[E, A]):
    """Verb with the arguments from the script; a schedule fills in block, repeat and condition.

    E is the type of its prediction (None for most steps), A that of its answer to the script. `verb` is the method of
    `Rig` that creates it, `owed` what a resumed run repeats of it.
    """

    verb: ClassVar[str]
    owed: ClassVar[Owed]

    block: int | None = None
    repeat: int | None = None
    condition: str | None = None

    @property
    def marks(self) -> dict[str, Any]:
        """Block, repeat and condition, as far as a schedule has set them."""
        marks = {"block": self.block, "repeat": self.repeat, "condition": self.condition}
        return {name: value for name, value in marks.items() if value is not None}

    @abstractmethod
    def check(self, walk: Walk) -> Spot:
        """Check the step without the model, advance the walk, and return the step's position and press numbers.

        Every pass over a script checks every step, because a script may decide as it runs. Raises BadInputError.
        """

    def expect(self, spot: Spot, walk: Walk) -> E:
        """Return the prediction at the spot that `check` returned, within the limits. Raises BadInputError."""
        return None  # type: ignore[return-value]

    def foreseen(self, expected: E) -> A:
        """Return the predicted answer, which a script receives during planning."""
        return None  # type: ignore[return-value]

    @classmethod
    def answers(cls, before: Journalled) -> dict[int, A]:
        """Return the answers in the journal of a stopped run, by the index of the press."""
        return {}


@dataclass(frozen=True, kw_only=True)
class Home(Step[None, None]):
    """Home the stage. A resumed run homes before its first step in any case."""

    verb: ClassVar[str] = "home"
    owed: ClassVar[Owed] = Owed.NOTHING

    def check(self, walk: Walk) -> Spot:
        walk.homed, walk.x_mm = True, math.nan
        return walk.spot()


@dataclass(frozen=True, kw_only=True)
class Mount(Step[None, None]):
    """Ask the operator to mount an indentor."""

    verb: ClassVar[str] = "mount"
    owed: ClassVar[Owed] = Owed.LAST

    indentor: str

    def check(self, walk: Walk) -> Spot:
        if not isinstance(self.indentor, str):
            raise BadInputError(f"{self.verb}: expected the name of an indentor, got {self.indentor!r}", "no_name")
        walk.model.refuse_shape(self.indentor)
        walk.indentor = self.indentor
        return walk.spot()


@dataclass(frozen=True, kw_only=True)
class MoveTo(Step[None, None]):
    """Move sideways and along the finger, at clearance."""

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
    """Equal presses at one position: their numbers, and the prediction for each."""

    ids: tuple[PressId, ...]
    planned: PlannedIndentation


def check_press(
    verb: str, target: Target, walk: Walk, *, increments: int, hold_s: float, speed_mm_s: float | None = None
) -> None:
    """Check a press without the model. Raises BadInputError."""
    walk.need_ready(verb)
    if walk.along_mm:
        raise BadInputError(
            f"{verb}: along_mm = {walk.along_mm:g}: must be 0; elsewhere only touch() is allowed", "along_the_finger"
        )
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
    ramp: bool = False,
) -> ExpectedPresses:
    """Return the prediction for a press to a depth (mm) or force (gwt), in equal increments or a ramp.

    The default speed is habits.press_speed_mm_s. Raises BadInputError if the model has no prediction, or one beyond a
    limit.
    """
    habits = walk.settings.habits
    increment_mm = math.inf if ramp else habits.increment_mm
    pace = Pace(speed_mm_s or habits.press_speed_mm_s, increment_mm, increments, hold_s)
    try:
        found = walk.model.press(spot.indentor, spot.x_mm, target, pace)
    except ForceTooDeepError:
        raise BadInputError(
            f"{verb}: {target.kind} = {target.value:g} at x = {spot.x_mm:g} mm is not reached at a DOI of "
            f"limits.max_doi_mm = {walk.settings.limits.max_doi_mm:g}",
            "force_out_of_reach",
        ) from None
    except NoPredictionError as error:
        raise BadInputError(f"{verb}: {error}", error.code) from None
    ramp_mm_s = pace.speed_mm_s if ramp else None
    planned = PlannedIndentation(**vars(found), increments=increments, hold_s=hold_s, ramp_mm_s=ramp_mm_s)
    refuse_reach(verb, planned, walk.settings)
    refuse_pressure(verb, planned, walk.settings.limits)
    return ExpectedPresses(spot.ids, planned)


class PressStep(Step[ExpectedPresses, Indentation]):
    """One press past the skin, whose holds are data."""

    owed: ClassVar[Owed] = Owed.ANSWER

    def foreseen(self, expected: ExpectedPresses) -> Indentation:
        planned, n = expected.planned, expected.planned.increments
        holds = tuple(
            Hold(
                planned.target.part(k, n), planned.predicted_doi_mm * k / n, planned.predicted_force_gwt * k / n, 0.0
            )
            for k in range(1, n + 1)
        )
        return Indentation(expected.ids[0].index, planned.x_mm, holds)

    @classmethod
    def answers(cls, before: Journalled) -> dict[int, Indentation]:
        requested = {
            (e["index"], e["hold"]): Target(e["target"], e["commanded"]) for e in before.stream("hold_start")
        }
        return {
            index: Indentation(
                index,
                ends[0]["x_mm"],
                tuple(
                    Hold(requested[index, end["hold"]], end["doi_mm"], end["force_gwt"], end["force_sd_gwt"])
                    for end in ends
                ),
            )
            for index, ends in before.done.items()
        }


@dataclass(frozen=True, kw_only=True)
class Indent(PressStep):
    """Find contact, press in equal increments with a hold after each, and lift."""

    verb: ClassVar[str] = "indent"

    doi_mm: float | None = None
    force_gwt: float | None = None
    increments: int = 1
    speed_mm_s: float | None = None
    hold_s: float = 1.0

    @property
    def target(self) -> Target:
        """Depth or force from the script. Raises BadInputError."""
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


@dataclass(frozen=True, kw_only=True)
class Ramp(PressStep):
    """Find contact, move to a depth at constant speed, hold, and lift."""

    verb: ClassVar[str] = "ramp"

    doi_mm: float
    speed_mm_s: float
    hold_s: float = 1.0

    @property
    def target(self) -> Target:
        """Depth. Raises BadInputError."""
        return checked_target(self.verb, self.doi_mm, None)

    def check(self, walk: Walk) -> Spot:
        refuse_no_ramps(self.verb, walk.settings.stage)
        refuse_no_number(self.verb, "speed_mm_s", self.speed_mm_s)
        check_press(self.verb, self.target, walk, increments=1, hold_s=self.hold_s, speed_mm_s=self.speed_mm_s)
        walk.hold(self.verb, self.hold_s)
        return walk.spot("data", 1, self.marks)

    def expect(self, spot: Spot, walk: Walk) -> ExpectedPresses:
        return expect_press(
            self.verb,
            self.target,
            spot,
            walk,
            increments=1,
            hold_s=self.hold_s,
            speed_mm_s=self.speed_mm_s,
            ramp=True,
        )


@dataclass(frozen=True, kw_only=True)
class Precondition(Step[ExpectedPresses, None]):
    """Press several times at the present position, to settle the skin."""

    verb: ClassVar[str] = "precondition"
    owed: ClassVar[Owed] = Owed.LAST_OF_INDENTOR

    presses: int
    doi_mm: float | None = None
    force_gwt: float | None = None
    hold_s: float = 1.0

    @property
    def target(self) -> Target:
        """Depth or force from the script. Raises BadInputError."""
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
    """Press at a fixed position; an alarm is raised if the force differs from that of the first such press."""

    verb: ClassVar[str] = "reference"
    owed: ClassVar[Owed] = Owed.LAST_OF_INDENTOR

    x_mm: float
    doi_mm: float
    increments: int = 2
    hold_s: float = 0.5

    @property
    def target(self) -> Target:
        """Depth. Raises BadInputError."""
        return checked_target(self.verb, self.doi_mm, None)

    def check(self, walk: Walk) -> Spot:
        MoveTo(x_mm=self.x_mm).check(walk)
        check_press(self.verb, self.target, walk, increments=self.increments, hold_s=self.hold_s)
        self._refuse_another(walk)
        walk.hold(self.verb, self.increments * self.hold_s)
        return walk.spot("reference", 1, self.marks)

    def _refuse_another(self, walk: Walk) -> None:
        requested = (walk.indentor, self.x_mm, self.doi_mm, self.increments, self.hold_s)
        first = walk.reference_request = walk.reference_request or requested
        if requested != first:
            raise BadInputError(
                f"{self.verb}: must be the same press each time, {first[0]} at x = {first[1]:g} mm to "
                f"{first[2]:g} mm, increments = {first[3]}",
                "another_reference",
            )

    def expect(self, spot: Spot, walk: Walk) -> ExpectedPresses:
        return expect_press(self.verb, self.target, spot, walk, increments=self.increments, hold_s=self.hold_s)


@dataclass(frozen=True, kw_only=True)
class Rest(Step[None, None]):
    """Wait at clearance."""

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
    """Number of a touch, and predicted contact height above the nominal apex (mm)."""

    press: PressId
    contact_mm: float


@dataclass(frozen=True, kw_only=True)
class Touch(Step[ExpectedTouch, float]):
    """Find contact at the present position and lift; the answer is the height of contact (mm)."""

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
    """Journal that the script has reached a named point."""

    verb: ClassVar[str] = "checkpoint"
    owed: ClassVar[Owed] = Owed.ONCE

    name: str

    def check(self, walk: Walk) -> Spot:
        refuse_no_text(self.verb, self.name)
        if self.name in walk.checkpoints:
            raise BadInputError(
                f"{self.verb}: {self.name!r} has been passed already, expected another name", "passed_already"
            )
        walk.checkpoints.add(self.name)
        return walk.spot()


@dataclass(frozen=True, kw_only=True)
class Note(Step[None, None]):
    """Journal a line of text."""

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
