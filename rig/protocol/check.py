"""State of a script while it is checked, and every check of a step. All raise BadInputError."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any, Literal, Protocol

from rig.devices.registry import moves_along
from rig.engine.limits import refuse_outside, refuse_travel
from rig.errors import BadInputError, RigError
from rig.records import Pace, PlannedIndentation, Prediction, PressId, Purpose, Target
from rig.settings import SLOWEST_MM_S, ZERO_LIFT_MM, LimitSettings, RigSettings
from rig.units import GWT_N


class NoPredictionError(RigError):
    """Error of a missing or unreliable prediction."""

    default_code = "no_prediction"


class ForceTooDeepError(NoPredictionError):
    """Error of a force that no allowed depth reaches."""

    default_code = "force_out_of_reach"


class Model(Protocol):
    """Interface of the finger model for steps."""

    def refuse_shape(self, indentor: str) -> None:
        """Raise an error unless this is the name of an indentor."""

    def press(self, indentor: str, x_mm: float, target: Target, pace: Pace | None = None) -> Prediction:
        """Predict a press at a pace; a prediction is computed once. Raises NoPredictionError."""

    def touch_height_mm(self, indentor: str, x_mm: float, along_mm: float) -> float:
        """Return the height of the indentor at first touch above the nominal apex (mm)."""


@dataclass(frozen=True)
class PressPlace:
    """Indentor and position of a step, the numbers of its presses, and its place in a schedule."""

    indentor: str
    x_mm: float
    along_mm: float
    ids: tuple[PressId, ...]
    marks: Mapping[str, Any] = field(default_factory=dict)


class ScriptState:
    """State of a script that the next step depends on; each pass over a script has its own."""

    def __init__(self, settings: RigSettings, model: Model) -> None:
        self.settings, self.model = settings, model
        self.indentor: str | None = None
        self.x_mm, self.along_mm = math.nan, 0.0
        self.homed = self.zeroed = False
        self.marks: Mapping[str, Any] = {}  # block, repeat and condition, as far as a schedule has set them
        self.checkpoints: set[str] = set()
        self.pressed: Counter[Purpose] = Counter()
        self.held_s = 0.0
        self.reference_request: tuple[Any, ...] | None = None

    def need(self, condition: bool, verb: str, before: str) -> None:
        """Raise an error if a verb comes before one that it requires."""
        if not condition:
            raise BadInputError(f"{verb}: {before} must come first", "comes_too_early")

    def need_ready(self, verb: str) -> None:
        """Raise an error unless an indentor is mounted, the sensor zeroed and a position reached."""
        self.need(self.indentor is not None, verb, "mount()")
        self.need(self.zeroed, verb, "zero()")
        self.need(math.isfinite(self.x_mm), verb, "move_to()")

    def hold(self, verb: str, held_s: float) -> None:
        """Add to the total hold time (s); raise an error if it is too long."""
        self.held_s += held_s
        longest_s = self.settings.limits.max_contact_s
        if self.held_s > longest_s:
            raise BadInputError(
                f"{verb}: the finger would be held for {self.held_s:g} s in all, beyond limits.max_contact_s = "
                f"{longest_s:g}",
                "held_too_long",
            )

    def place(self, purpose: Purpose = "data", presses: int = 0) -> PressPlace:
        """Return the present position, and the next numbers of that many presses."""
        first = self.pressed[purpose]
        self.pressed[purpose] += presses
        marks = {} if purpose == "find" else self.marks
        ids = tuple(PressId(first + n, purpose, marks) for n in range(presses))
        return PressPlace(self.indentor or "", self.x_mm, self.along_mm, ids, self.marks)


_MAX_COUNT = 100
_LONGEST_S = 3600.0


def checked_target(verb: str, doi_mm: float | None, force_gwt: float | None) -> Target:
    """Return the depth or the force; exactly one of them must be passed."""
    if (doi_mm is None) == (force_gwt is None):
        raise BadInputError(f"{verb}: expected either doi_mm or force_gwt", "not_one_target")
    kind: Literal["doi_mm", "force_gwt"] = "force_gwt" if doi_mm is None else "doi_mm"
    value = force_gwt if doi_mm is None else doi_mm
    refuse_no_number(verb, kind, value)
    target = Target(kind, float(value))  # type: ignore[arg-type]
    if not (math.isfinite(target.value) and target.value > 0):
        raise BadInputError(f"{verb}: {target.kind} = {target.value}: expected a positive number", "not_positive")
    return target


def refuse_no_number(verb: str, name: str, value: object) -> None:
    """Raise an error unless a value is an integer or a float."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise BadInputError(f"{verb}: {name} = {value!r}: expected a number", "no_number")


def refuse_no_text(verb: str, value: object) -> None:
    """Raise an error unless a value is text."""
    if not isinstance(value, str):
        raise BadInputError(f"{verb}: expected text, got {value!r}", "no_text")


def refuse_count(verb: str, name: str, value: object) -> None:
    """Raise an error unless a value is a whole number from 1 to 100."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not 1 <= int(value) <= _MAX_COUNT:
        raise BadInputError(f"{verb}: {name} = {value!r}: expected a whole number, 1 … {_MAX_COUNT}", "no_count")


def refuse_seconds(verb: str, name: str, value: float) -> None:
    """Raise an error for a duration that is negative or longer than an hour."""
    refuse_no_number(verb, name, value)
    if not 0 <= value <= _LONGEST_S:
        raise BadInputError(f"{verb}: {name} = {value!r}: expected 0 … {_LONGEST_S:g} s", "outside_range")


def refuse_speeds(verb: str, speed_mm_s: float | None, settings: RigSettings) -> None:
    """Raise an error for a speed, passed or configured, that is too slow for a board or too fast for a finger."""
    habits = settings.habits
    if speed_mm_s is not None:
        refuse_no_number(verb, "speed_mm_s", speed_mm_s)
        _refuse_speed(verb, "speed_mm_s", speed_mm_s, settings.limits)
    else:
        _refuse_speed(verb, "habits.press_speed_mm_s", habits.press_speed_mm_s, settings.limits)
    _refuse_speed(verb, "habits.approach_speed_mm_s", habits.approach_speed_mm_s, settings.limits)


def _refuse_speed(verb: str, name: str, speed_mm_s: float, limits: LimitSettings) -> None:
    fastest = limits.max_press_speed_mm_s
    if not SLOWEST_MM_S <= speed_mm_s <= fastest:
        raise BadInputError(
            f"{verb}: {name} = {speed_mm_s!r}: expected {SLOWEST_MM_S:.2g} … {fastest:g} mm/s", "outside_range"
        )


def refuse_target(verb: str, target: Target, limits: LimitSettings) -> None:
    """Raise an error for a depth or force beyond its limit."""
    limit = {"doi_mm": "max_doi_mm", "force_gwt": "max_force_gwt"}[target.kind]
    if target.value > getattr(limits, limit):
        raise BadInputError(
            f"{verb}: {target.kind} = {target.value:g} is beyond limits.{limit} = {getattr(limits, limit):g}",
            "beyond_limit",
        )


def refuse_reach(verb: str, planned: PlannedIndentation, settings: RigSettings) -> None:
    """Raise an error for a press whose prediction is too deep, too forceful, or below the stage's travel."""
    limits, doi_mm, force_gwt = settings.limits, planned.deepest_mm, planned.highest_gwt
    if doi_mm > limits.max_doi_mm:
        raise _means(verb, planned, f"a DOI of {doi_mm:.3g} mm", limits, "max_doi_mm")
    refuse_force(verb, planned, force_gwt, limits)
    if force_gwt * GWT_N > limits.soft_trip_n:
        raise _means(verb, planned, f"{force_gwt * GWT_N:.3g} N", limits, "soft_trip_n")
    deflection_mm = settings.calibration.value("compliance_mm_per_n", 0.0) * force_gwt * GWT_N
    lowest_mm = planned.expected_contact_mm - max(doi_mm + deflection_mm, limits.search_mm)
    refuse_travel(BadInputError, settings, "z", settings.frame.apex_z_mm + lowest_mm)


def refuse_force(verb: str, planned: PlannedIndentation, force_gwt: float, limits: LimitSettings) -> None:
    """Raise an error for a target whose predicted force is beyond its limit."""
    if force_gwt > limits.max_force_gwt:
        raise _means(verb, planned, f"a force of {force_gwt:.3g} gwt", limits, "max_force_gwt")


def refuse_approach(verb: str, contact_mm: float, settings: RigSettings) -> None:
    """Raise an error for a touch that would search below the stage's travel, or too fast."""
    _refuse_speed(verb, "habits.approach_speed_mm_s", settings.habits.approach_speed_mm_s, settings.limits)
    refuse_travel(BadInputError, settings, "z", settings.frame.apex_z_mm + contact_mm - settings.limits.search_mm)


def refuse_place(x_mm: float, along_mm: float, settings: RigSettings) -> None:
    """Raise an error for a position at clearance that the stage cannot reach."""
    frame, highest_mm = settings.frame, settings.habits.clearance_mm + ZERO_LIFT_MM
    refuse_travel(BadInputError, settings, "x", frame.pad_centre_x_mm + x_mm)
    refuse_travel(BadInputError, settings, "y", frame.pad_y_mm + along_mm)
    refuse_travel(BadInputError, settings, "z", frame.apex_z_mm + highest_mm)


def refuse_pressure(verb: str, planned: PlannedIndentation, limits: LimitSettings) -> None:
    """Raise an error for too much force on the predicted contact area."""
    if planned.contact_area_mm2 <= 0:
        raise BadInputError(
            f"{_press(verb, planned)} means no contact that the model can detect; use a larger target", "no_contact"
        )
    if planned.mean_pressure_kpa > limits.max_pressure_kpa:
        found = f"{planned.mean_pressure_kpa:.3g} kPa over a contact of {planned.contact_area_mm2:.2g} mm²"
        raise _means(verb, planned, found, limits, "max_pressure_kpa")


def _means(verb: str, planned: PlannedIndentation, what: str, limits: LimitSettings, limit: str) -> BadInputError:
    """Return the error of a target whose prediction exceeds a limit."""
    return BadInputError(
        f"{_press(verb, planned)} means {what}, beyond limits.{limit} = {getattr(limits, limit):g}",
        "means_beyond_limit",
    )


def _press(verb: str, planned: PlannedIndentation) -> str:
    return f"{verb}: {planned.target.kind} = {planned.target.value:g} at x = {planned.x_mm:g} mm"


def refuse_along(along_mm: float, settings: RigSettings) -> None:
    """Raise an error for a position along the finger beyond the stage or the limits."""
    refuse_no_number("move_to", "along_mm", along_mm)
    refuse_outside(BadInputError, "move_to", "along_mm", along_mm, settings.limits.along_mm)
    if along_mm and not moves_along(settings.stage):
        raise BadInputError(
            f"move_to: along_mm = {along_mm:g}: a {settings.stage.kind} stage has no axis along the finger",
            "no_such_axis",
        )
