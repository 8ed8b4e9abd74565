"""Verbs of a script, a class each: its arguments, checks, prediction, execution, and what a resumed run repeats.

`rig.protocol.api.Rig` has a method for each, with the same arguments and documentation.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from rig.engine import Engine, indentation, verbs
from rig.engine.limits import refuse_no_ramps, refuse_outside
from rig.engine.reference import compare_reference
from rig.errors import BadInputError
from rig.protocol.check import (
    ForceTooDeepError,
    NoPredictionError,
    PressPlace,
    ScriptState,
    checked_target,
    refuse_along,
    refuse_approach,
    refuse_count,
    refuse_no_number,
    refuse_no_text,
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


class ResumeRule(Enum):
    """Part of a step before the first missing press that a resumed run repeats."""

    NOTHING = "nothing: it is done anyway, or of no consequence"
    LAST = "the last of its kind, before the next press"
    LAST_OF_INDENTOR = "the same, but nothing once another indentor is mounted"
    LAST_IF_NEXT = "the last of its kind, but not where the next press is done already"
    ONCE = "it is journalled once and for all"
    ANSWER = "nothing where the journal has its answer, else the step itself"


Asked = Mapping[str, Any]
"""What a step asks for: verb, indentor, position, target, motion, and place in the schedule."""


class Journalled(Protocol):
    """Stopped run, read from its journal."""

    @property
    def done(self) -> Mapping[int, list[dict[str, Any]]]:
        """Holds of each finished indentation, by index."""

    def stream(self, name: str) -> Sequence[dict[str, Any]]:
        """Return the events of a stream."""


@dataclass(frozen=True, kw_only=True)
class Step(ABC, Generic[E, A]):
    """Verb with the arguments from the script.

    E is the type of its prediction (None for most steps), A that of its answer to the script. `verb` is the method of
    `Rig` that creates it, `on_resume` what a resumed run repeats of it.
    """

    verb: ClassVar[str]
    on_resume: ClassVar[ResumeRule]

    @abstractmethod
    def check(self, state: ScriptState) -> PressPlace:
        """Check the step without the model, advance the state, and return the step's position and press numbers.

        Every pass over a script checks every step, because a script may decide as it runs. Raises BadInputError.
        """

    def asked(self, place: PressPlace, press_mm_s: float) -> Asked | None:
        """Return what a resumed run must ask for again (in `what`, may ask for otherwise); None if presses say it.

        press_mm_s: speed of a press that names none.
        """
        return _where(place) if place.ids else {"verb": self.verb}

    def expect(self, place: PressPlace, state: ScriptState) -> E:
        """Return the prediction at the place that `check` returned, within the limits. Raises BadInputError."""
        return None  # type: ignore[return-value]

    def foreseen(self, expected: E) -> A:
        """Return the predicted answer, which a script receives during planning."""
        return None  # type: ignore[return-value]

    def allowed_presses(self, expected: E) -> Sequence[PlannedIndentation]:
        """Return the presses that its answer may tell a script to make; the plan contains them all."""
        return ()

    @abstractmethod
    def execute(self, engine: Engine, expected: E) -> A:
        """Carry out the step as `expect` predicted, and return its answer to the script."""

    def rehearse(self, engine: Engine, expected: E) -> A:
        """Carry out the step in a rehearsal, where nobody answers; by default as in a run."""
        return self.execute(engine, expected)

    @classmethod
    def answers(cls, before: Journalled) -> dict[int, A]:
        """Return the answers in the journal of a stopped run, by the index of the press; under `ONCE` by order."""
        return {}


def _where(place: PressPlace) -> Asked:
    """Return indentor and position of the presses of a step, and their place in the schedule."""
    return {"indentor": place.indentor, "x_mm": place.x_mm, **place.ids[0].marks}


@dataclass(frozen=True, kw_only=True)
class Home(Step[None, None]):
    """Home the stage; no other motion is allowed before."""

    verb: ClassVar[str] = "home"
    on_resume: ClassVar[ResumeRule] = ResumeRule.NOTHING

    def check(self, state: ScriptState) -> PressPlace:
        state.homed, state.x_mm = True, math.nan
        return state.place()

    def execute(self, engine: Engine, expected: None) -> None:
        verbs.home(engine)


@dataclass(frozen=True)
class Mount(Step[None, None]):
    """Ask the operator to mount an indentor.

    Parameters
    ----------
    indentor : str
        Name of the indentor, for example ``"bar:3.0"``, ``"cylinder:9"`` or ``"step:1"`` (dimensions in mm).

    Raises
    ------
    BadInputError
        If there is no such indentor.
    """

    verb: ClassVar[str] = "mount"
    on_resume: ClassVar[ResumeRule] = ResumeRule.LAST

    indentor: str

    def check(self, state: ScriptState) -> PressPlace:
        if not isinstance(self.indentor, str):
            raise BadInputError(f"{self.verb}: expected the name of an indentor, got {self.indentor!r}", "no_name")
        state.model.refuse_shape(self.indentor)
        state.indentor = self.indentor
        return state.place()

    def asked(self, place: PressPlace, press_mm_s: float) -> None:
        return None

    def execute(self, engine: Engine, expected: None) -> None:
        verbs.mount(engine, self.indentor)


@dataclass(frozen=True, kw_only=True)
class MoveTo(Step[None, None]):
    """Move sideways at clearance.

    Parameters
    ----------
    x_mm : float
        Lateral position from the center of the finger pad (mm).
    along_mm : float, optional
        Position along the finger from the receptor plane (mm), where the stage has that axis.

    Raises
    ------
    BadInputError
        If the stage is not homed, or the position is outside the limits.
    """

    verb: ClassVar[str] = "move_to"
    on_resume: ClassVar[ResumeRule] = ResumeRule.LAST

    x_mm: float
    along_mm: float = 0.0

    def check(self, state: ScriptState) -> PressPlace:
        settings = state.settings
        state.need(state.homed, self.verb, "home()")
        refuse_no_number(self.verb, "x_mm", self.x_mm)
        refuse_along(self.along_mm, settings)
        refuse_outside(BadInputError, self.verb, "x_mm", self.x_mm, settings.limits.x_mm)
        refuse_place(self.x_mm, self.along_mm, settings)
        state.x_mm, state.along_mm = self.x_mm, self.along_mm
        return state.place()

    def asked(self, place: PressPlace, press_mm_s: float) -> None:
        return None

    def execute(self, engine: Engine, expected: None) -> None:
        verbs.move_to(engine, float(self.x_mm), float(self.along_mm))


@dataclass(frozen=True)
class ExpectedPresses:
    """Equal presses at one position: their numbers, and the prediction for each."""

    ids: tuple[PressId, ...]
    planned: PlannedIndentation


@dataclass(frozen=True)
class PressRequest:
    """Press past the skin that a step asks for; the default speed (mm/s) is habits.press_speed_mm_s."""

    target: Target
    increments: int
    hold_s: float
    speed_mm_s: float | None = None
    ramp: bool = False
    rest_s: float = 0.0


class StepWithPresses(Step[ExpectedPresses, A]):
    """Step of one or more equal presses."""

    @property
    @abstractmethod
    def request(self) -> PressRequest:
        """Each press of the step. Raises BadInputError."""

    def check_press(self, state: ScriptState, presses: int = 1) -> None:
        """Check the presses without the model, and count their holds. Raises BadInputError."""
        asked = self.request
        state.need_ready(self.verb)
        if state.along_mm:
            raise BadInputError(
                f"{self.verb}: along_mm = {state.along_mm:g}: must be 0; elsewhere only touch() is allowed",
                "along_the_finger",
            )
        refuse_count(self.verb, "increments", asked.increments)
        refuse_seconds(self.verb, "hold_s", asked.hold_s)
        refuse_seconds(self.verb, "rest_s", asked.rest_s)
        refuse_target(self.verb, asked.target, state.settings.limits)
        refuse_speeds(self.verb, asked.speed_mm_s, state.settings)
        state.hold(self.verb, presses * asked.increments * asked.hold_s)

    def asked(self, place: PressPlace, press_mm_s: float) -> Asked:
        asked = self.request
        return {
            **_where(place),
            "verb": Ramp.verb if asked.ramp else Indent.verb,
            "target": asked.target.kind,
            "value": asked.target.value,
            "increments": asked.increments,
            "speed_mm_s": press_mm_s if asked.speed_mm_s is None else asked.speed_mm_s,
            "hold_s": asked.hold_s,
            "rest_s": asked.rest_s,
        }

    def expect(self, place: PressPlace, state: ScriptState) -> ExpectedPresses:
        """Return the prediction for each press, in equal increments or a ramp.

        Raises BadInputError if the model has no prediction, or one beyond a limit.
        """
        asked, habits = self.request, state.settings.habits
        increment_mm = math.inf if asked.ramp else habits.increment_mm
        pace = Pace(asked.speed_mm_s or habits.press_speed_mm_s, increment_mm, asked.increments, asked.hold_s)
        try:
            found = state.model.press(place.indentor, place.x_mm, asked.target, pace)
        except ForceTooDeepError:
            raise BadInputError(
                f"{self.verb}: {asked.target.kind} = {asked.target.value:g} at x = {place.x_mm:g} mm is not reached "
                f"at a DOI of limits.max_doi_mm = {state.settings.limits.max_doi_mm:g}",
                "force_out_of_reach",
            ) from None
        except NoPredictionError as error:
            raise BadInputError(f"{self.verb}: {error}", error.code) from None
        planned = PlannedIndentation(
            **vars(found),
            increments=asked.increments,
            hold_s=asked.hold_s,
            ramp_mm_s=pace.speed_mm_s if asked.ramp else None,
        )
        refuse_reach(self.verb, planned, state.settings)
        refuse_pressure(self.verb, planned, state.settings.limits)
        return ExpectedPresses(place.ids, planned)


def press(
    engine: Engine,
    press_id: PressId,
    planned: PlannedIndentation,
    speed_mm_s: float | None = None,
    rest_s: float = 0.0,
) -> Indentation:
    """Press as planned, by increments; the default speed is habits.press_speed_mm_s."""
    return indentation.indent(
        engine,
        planned.target,
        increments=int(planned.increments),
        speed_mm_s=None if speed_mm_s is None else float(speed_mm_s),
        hold_s=float(planned.hold_s),
        rest_s=float(rest_s),
        expected_contact_mm=planned.expected_contact_mm,
        contact_area_mm2=planned.contact_area_mm2,
        predicted=_predicted(planned),
        press_id=press_id,
    )


def _predicted(planned: PlannedIndentation) -> indentation.PredictedPress:
    return indentation.PredictedPress(round(planned.predicted_doi_mm, 6), round(planned.predicted_force_gwt, 6))


class DataPress(StepWithPresses[Indentation]):
    """One press past the skin, whose holds are data."""

    on_resume: ClassVar[ResumeRule] = ResumeRule.ANSWER

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
class Indent(DataPress):
    """Find contact, press to a depth or a force, and lift to clearance.

    Parameters
    ----------
    doi_mm : float, optional
        Depth of the last increment past contact (mm). Pass either a depth or a force.
    force_gwt : float, optional
        Force of the last increment (gwt).
    increments : int, optional
        Number of equal increments to the target, each with a hold.
    speed_mm_s : float, optional
        Speed past contact (mm/s). Default: `habits.press_speed_mm_s`.
    hold_s : float, optional
        Duration of each hold (s).
    rest_s : float, optional
        Shortest time from the last lift-off to this touch (s). The way to the place and down counts.

    Returns
    -------
    Indentation
        Mean depth (mm) and mean force (gwt) of each hold.

    Raises
    ------
    BadInputError
        If a step that must come first is missing, an argument is out of range, or the finger model predicts a
        depth or a force beyond a limit.
    """

    verb: ClassVar[str] = "indent"

    doi_mm: float | None = None
    force_gwt: float | None = None
    increments: int = 1
    speed_mm_s: float | None = None
    hold_s: float = 1.0
    rest_s: float = 0.0

    @property
    def request(self) -> PressRequest:
        target = checked_target(self.verb, self.doi_mm, self.force_gwt)
        return PressRequest(target, self.increments, self.hold_s, self.speed_mm_s, rest_s=self.rest_s)

    def check(self, state: ScriptState) -> PressPlace:
        self.check_press(state)
        return state.place("data", 1)

    def execute(self, engine: Engine, expected: ExpectedPresses) -> Indentation:
        return press(engine, expected.ids[0], expected.planned, self.speed_mm_s, self.rest_s)


@dataclass(frozen=True, kw_only=True)
class Ramp(DataPress):
    """Find contact, move from above the skin to a depth at constant speed, hold, and lift to clearance.

    The first ramp at a place, and a deeper one, begins with a press by increments to the same depth, which
    measures the stiffness. A ramp trips at a force below the soft trip, such that it comes to rest within the
    trip and the overshoot of a press.

    Parameters
    ----------
    doi_mm : float
        Depth past contact (mm).
    speed_mm_s : float
        Speed (mm/s).
    hold_s : float, optional
        Duration of the hold (s).
    rest_s : float, optional
        Shortest time from the last lift-off to this touch (s). The way to the place and down counts.

    Returns
    -------
    Indentation
        Mean depth (mm) and mean force (gwt) of the hold.

    Raises
    ------
    BadInputError
        As `indent`; if the stage cannot ramp, or the ramp is too fast for the stiffness that the finger model
        predicts.
    """

    verb: ClassVar[str] = "ramp"

    doi_mm: float
    speed_mm_s: float
    hold_s: float = 1.0
    rest_s: float = 0.0

    @property
    def request(self) -> PressRequest:
        target = checked_target(self.verb, self.doi_mm, None)
        return PressRequest(target, 1, self.hold_s, self.speed_mm_s, ramp=True, rest_s=self.rest_s)

    def check(self, state: ScriptState) -> PressPlace:
        refuse_no_ramps(BadInputError, self.verb, state.settings)
        refuse_no_number(self.verb, "speed_mm_s", self.speed_mm_s)
        self.check_press(state)
        return state.place("data", 1)

    def execute(self, engine: Engine, expected: ExpectedPresses) -> Indentation:
        planned = expected.planned
        return indentation.ramp(
            engine,
            planned.target.value,
            float(self.speed_mm_s),
            hold_s=float(planned.hold_s),
            rest_s=float(self.rest_s),
            expected_contact_mm=planned.expected_contact_mm,
            contact_area_mm2=planned.contact_area_mm2,
            predicted=_predicted(planned),
            press_id=expected.ids[0],
        )


@dataclass(frozen=True, kw_only=True)
class Precondition(StepWithPresses[None]):
    """Press several times at the present position, to settle the skin.

    The journal stores these presses apart from data.

    Parameters
    ----------
    presses : int
        Number of presses.
    doi_mm : float, optional
        Depth of each press past contact (mm). Pass either a depth or a force.
    force_gwt : float, optional
        Force of each press (gwt).
    hold_s : float, optional
        Duration of each hold (s).

    Raises
    ------
    BadInputError
        As `indent`.
    """

    verb: ClassVar[str] = "precondition"
    on_resume: ClassVar[ResumeRule] = ResumeRule.LAST_OF_INDENTOR

    presses: int
    doi_mm: float | None = None
    force_gwt: float | None = None
    hold_s: float = 1.0

    @property
    def request(self) -> PressRequest:
        return PressRequest(checked_target(self.verb, self.doi_mm, self.force_gwt), 1, self.hold_s)

    def check(self, state: ScriptState) -> PressPlace:
        refuse_count(self.verb, "presses", self.presses)
        self.check_press(state, self.presses)
        return state.place("precondition", self.presses)

    def execute(self, engine: Engine, expected: ExpectedPresses) -> None:
        for press_id in expected.ids:
            verbs.be_over(engine, expected.planned.x_mm)
            press(engine, press_id, expected.planned)


@dataclass(frozen=True, kw_only=True)
class Reference(StepWithPresses[None]):
    """Press at a fixed position to monitor the skin.

    An alarm is raised where the force differs from that of the first such press by more than
    `limits.reference_band`. The journal stores these presses apart from data.

    Parameters
    ----------
    x_mm : float
        Lateral position from the center of the finger pad (mm).
    doi_mm : float
        Depth of the last increment past contact (mm).
    increments : int, optional
        Number of equal increments, each with a hold.
    hold_s : float, optional
        Duration of each hold (s).

    Raises
    ------
    BadInputError
        As `indent`.
    """

    verb: ClassVar[str] = "reference"
    on_resume: ClassVar[ResumeRule] = ResumeRule.LAST_OF_INDENTOR

    x_mm: float
    doi_mm: float
    increments: int = 2
    hold_s: float = 0.5

    @property
    def request(self) -> PressRequest:
        return PressRequest(checked_target(self.verb, self.doi_mm, None), self.increments, self.hold_s)

    def check(self, state: ScriptState) -> PressPlace:
        MoveTo(x_mm=self.x_mm).check(state)
        self.check_press(state)
        requested = (state.indentor, self.x_mm, self.doi_mm, self.increments, self.hold_s)
        first = state.reference_request = state.reference_request or requested
        if requested != first:
            raise BadInputError(
                f"{self.verb}: must be the same press each time, {first[0]} at x = {first[1]:g} mm to "
                f"{first[2]:g} mm, increments = {first[3]}",
                "another_reference",
            )
        return state.place("reference", 1)

    def execute(self, engine: Engine, expected: ExpectedPresses) -> None:
        verbs.be_over(engine, expected.planned.x_mm)
        band = expected.planned.band
        found = press(engine, expected.ids[0], expected.planned)
        compare_reference(engine, found, None if band is None else band.force_gwt)


@dataclass(frozen=True)
class Rest(Step[None, None]):
    """Wait at clearance.

    Parameters
    ----------
    seconds : float
        Duration (s).

    Raises
    ------
    BadInputError
        If the duration is out of range.
    """

    verb: ClassVar[str] = "rest"
    on_resume: ClassVar[ResumeRule] = ResumeRule.LAST_IF_NEXT

    seconds: float

    def check(self, state: ScriptState) -> PressPlace:
        state.need(state.homed, self.verb, "home()")
        refuse_seconds(self.verb, "seconds", self.seconds)
        return state.place()

    def asked(self, place: PressPlace, press_mm_s: float) -> Asked:
        return {"verb": self.verb, "what": self.seconds}

    def execute(self, engine: Engine, expected: None) -> None:
        verbs.rest(engine, float(self.seconds))


@dataclass(frozen=True, kw_only=True)
class Retract(Step[None, None]):
    """Lift to clearance.

    Raises
    ------
    BadInputError
        If the stage is not homed.
    """

    verb: ClassVar[str] = "retract"
    on_resume: ClassVar[ResumeRule] = ResumeRule.NOTHING

    def check(self, state: ScriptState) -> PressPlace:
        state.need(state.homed, self.verb, "home()")
        return state.place()

    def execute(self, engine: Engine, expected: None) -> None:
        verbs.retract(engine)


@dataclass(frozen=True)
class ExpectedTouch:
    """Number of a touch, and predicted contact height above the nominal apex (mm)."""

    press: PressId
    contact_mm: float


@dataclass(frozen=True, kw_only=True)
class Touch(Step[ExpectedTouch, float]):
    """Find contact at the present position, and lift.

    Returns
    -------
    float
        Height of contact above the nominal apex (mm).

    Raises
    ------
    BadInputError
        If a step that must come first is missing, or contact would be outside the travel of the stage.
    """

    verb: ClassVar[str] = "touch"
    on_resume: ClassVar[ResumeRule] = ResumeRule.ANSWER

    def check(self, state: ScriptState) -> PressPlace:
        state.need_ready(self.verb)
        return state.place("find", 1)

    def asked(self, place: PressPlace, press_mm_s: float) -> Asked:
        return {**_where(place), "along_mm": place.along_mm}

    def expect(self, place: PressPlace, state: ScriptState) -> ExpectedTouch:
        contact_mm = state.model.touch_height_mm(place.indentor, place.x_mm, place.along_mm)
        refuse_approach(self.verb, contact_mm, state.settings)
        return ExpectedTouch(place.ids[0], contact_mm)

    def foreseen(self, expected: ExpectedTouch) -> float:
        return expected.contact_mm

    @classmethod
    def answers(cls, before: Journalled) -> dict[int, float]:
        return {event["index"]: float(event["contact_height_mm"]) for event in before.stream("find")}

    def execute(self, engine: Engine, expected: ExpectedTouch) -> float:
        return indentation.touch_place(engine, expected.press.index, expected.contact_mm)


@dataclass(frozen=True)
class Checkpoint(Step[None, None]):
    """Write into the journal that the script has reached this point.

    Parameters
    ----------
    name : str
        Name of the checkpoint; a script uses each name once.

    Raises
    ------
    BadInputError
        If the name is no text, or is used already.
    """

    verb: ClassVar[str] = "checkpoint"
    on_resume: ClassVar[ResumeRule] = ResumeRule.ONCE

    name: str

    def check(self, state: ScriptState) -> PressPlace:
        refuse_no_text(self.verb, self.name)
        if self.name in state.checkpoints:
            raise BadInputError(
                f"{self.verb}: {self.name!r} has been passed already, expected another name", "passed_already"
            )
        state.checkpoints.add(self.name)
        return state.place()

    def asked(self, place: PressPlace, press_mm_s: float) -> Asked:
        return {"verb": self.verb, "name": self.name}

    def execute(self, engine: Engine, expected: None) -> None:
        verbs.checkpoint(engine, self.name)


@dataclass(frozen=True)
class Note(Step[None, None]):
    """Write a line of text into the journal.

    Parameters
    ----------
    text : str
        The line.

    Raises
    ------
    BadInputError
        If it is no text.
    """

    verb: ClassVar[str] = "note"
    on_resume: ClassVar[ResumeRule] = ResumeRule.ONCE

    text: str

    def check(self, state: ScriptState) -> PressPlace:
        refuse_no_text(self.verb, self.text)
        return state.place()

    def asked(self, place: PressPlace, press_mm_s: float) -> Asked:
        return {"verb": self.verb, "what": self.text}

    def execute(self, engine: Engine, expected: None) -> None:
        verbs.note(engine, self.text)


@dataclass(frozen=True, kw_only=True)
class Zero(Step[None, None]):
    """Zero the force sensor while the indentor is in the air.

    Raises
    ------
    BadInputError
        If the stage is not homed.
    """

    verb: ClassVar[str] = "zero"
    on_resume: ClassVar[ResumeRule] = ResumeRule.LAST

    def check(self, state: ScriptState) -> PressPlace:
        state.need(state.homed, self.verb, "home()")
        state.zeroed = True
        return state.place()

    def execute(self, engine: Engine, expected: None) -> None:
        verbs.zero(engine)
