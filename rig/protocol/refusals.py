"""What no script may ask for: numbers that are none, and what lies beyond a limit. All raise BadInputError."""

import math
from numbers import Integral, Real
from typing import Literal

from rig.devices.bench_settings import SLOWEST_MM_S
from rig.devices.units import GWT_N
from rig.engine.records import Target
from rig.engine.rig_settings import LimitSettings, RigSettings
from rig.protocol.errors import BadInputError
from rig.protocol.planned import PlannedIndentation

_MAX_COUNT = 100
_LONGEST_S = 3600.0


def checked_target(verb: str, doi_mm: float | None, force_gwt: float | None) -> Target:
    """The one target that was given."""
    if (doi_mm is None) == (force_gwt is None):
        raise BadInputError(f"{verb}: expected either doi_mm or force_gwt")
    kind: Literal["doi_mm", "force_gwt"] = "force_gwt" if doi_mm is None else "doi_mm"
    value = force_gwt if doi_mm is None else doi_mm
    refuse_no_number(verb, kind, value)
    target = Target(kind, float(value))  # type: ignore[arg-type]
    if not (math.isfinite(target.value) and target.value > 0):
        raise BadInputError(f"{verb}: {target.kind} = {target.value}: expected a positive number")
    return target


def refuse_no_number(verb: str, name: str, value: object) -> None:
    """What is neither an integer nor a float."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise BadInputError(f"{verb}: {name} = {value!r}: expected a number")


def refuse_no_text(verb: str, value: object) -> None:
    """What is no text, or an empty one."""
    if not isinstance(value, str):
        raise BadInputError(f"{verb}: expected text, got {value!r}")


def refuse_count(verb: str, name: str, value: object) -> None:
    """What is not a small whole number."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not 1 <= int(value) <= _MAX_COUNT:
        raise BadInputError(f"{verb}: {name} = {value!r}: expected a whole number, 1 … {_MAX_COUNT}")


def refuse_seconds(verb: str, name: str, value: float) -> None:
    """What is no time that anybody waits."""
    refuse_no_number(verb, name, value)
    if not 0 <= value <= _LONGEST_S:
        raise BadInputError(f"{verb}: {name} = {value!r}: expected 0 … {_LONGEST_S:g} s")


def refuse_speeds(verb: str, speed_mm_s: float | None, settings: RigSettings) -> None:
    """Slower than a board moves, or too fast for a finger: the speed that was given, or what the habits say."""
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
        expected = f"{SLOWEST_MM_S:.2g} … {fastest:g} mm/s"
        raise BadInputError(f"{verb}: {name} = {speed_mm_s!r}: expected {expected}")


def refuse_target(verb: str, target: Target, limits: LimitSettings) -> None:
    """What no model is needed to refuse."""
    limit = {"doi_mm": "max_doi_mm", "force_gwt": "max_force_gwt"}[target.kind]
    if target.value > getattr(limits, limit):
        raise BadInputError(
            f"{verb}: {target.kind} = {target.value:g} is beyond limits.{limit} = {getattr(limits, limit):g}"
        )


def refuse_reach(verb: str, planned: PlannedIndentation, settings: RigSettings) -> None:
    """What the model says is too deep, too hard, or below the stage's travel."""
    limits, doi_mm, force_gwt = settings.limits, planned.deepest_mm, planned.highest_gwt
    means = f"{verb}: {planned.target.kind} = {planned.target.value:g} at x = {planned.x_mm:g} mm means"
    if doi_mm > limits.max_doi_mm:
        raise BadInputError(f"{means} a DOI of {doi_mm:.3g} mm, beyond limits.max_doi_mm = {limits.max_doi_mm:g}")
    if force_gwt > limits.max_force_gwt:
        raise BadInputError(
            f"{means} a force of {force_gwt:.3g} gwt, beyond limits.max_force_gwt = {limits.max_force_gwt:g}"
        )
    if force_gwt * GWT_N > limits.soft_trip_n:
        raise BadInputError(f"{means} {force_gwt * GWT_N:.3g} N, beyond limits.soft_trip_n = {limits.soft_trip_n:g}")
    given_mm = settings.calibration.value("compliance_mm_per_n", 0.0) * force_gwt * GWT_N
    lowest_mm = planned.expected_contact_mm - max(doi_mm + given_mm, limits.search_mm)
    refuse_travel("z", settings.frame.apex_z_mm + lowest_mm, settings)


def refuse_approach(verb: str, contact_mm: float, settings: RigSettings) -> None:
    """A touch that would be looked for below the stage's travel, or too fast."""
    _refuse_speed(verb, "habits.approach_speed_mm_s", settings.habits.approach_speed_mm_s, settings.limits)
    refuse_travel("z", settings.frame.apex_z_mm + contact_mm - settings.limits.search_mm, settings)


def refuse_place(x_mm: float, along_mm: float, settings: RigSettings) -> None:
    """A place over the finger, at clearance, that the stage does not reach."""
    refuse_travel("x", settings.frame.pad_centre_x_mm + x_mm, settings)
    refuse_travel("y", settings.frame.pad_y_mm + along_mm, settings)
    refuse_travel("z", settings.frame.apex_z_mm + settings.habits.clearance_mm, settings)


def refuse_pressure(verb: str, planned: PlannedIndentation, limits: LimitSettings) -> None:
    """Too much force for the area that the model expects to carry it."""
    means = f"{verb}: {planned.target.kind} = {planned.target.value:g} at x = {planned.x_mm:g} mm means"
    if planned.contact_area_mm2 <= 0:
        raise BadInputError(f"{means} no contact that the model could tell from none: expected a larger target")
    if planned.mean_pressure_n_cm2 > limits.max_pressure_n_cm2:
        raise BadInputError(
            f"{means} {planned.mean_pressure_n_cm2:.3g} N/cm² over a contact of {planned.contact_area_mm2:.2g} mm², "
            f"beyond limits.max_pressure_n_cm2 = {limits.max_pressure_n_cm2:g}"
        )


def refuse_along(along_mm: float, settings: RigSettings) -> None:
    """A place along the finger that the stage cannot reach or the limits forbid."""
    refuse_no_number("move_to", "along_mm", along_mm)
    low, high = settings.limits.along_mm
    if not low <= along_mm <= high:
        raise BadInputError(f"move_to: along_mm = {along_mm:g} is outside limits.along_mm = {low:g} … {high:g}")
    if along_mm and not settings.stage.moves_along:
        raise BadInputError(
            f"move_to: along_mm = {along_mm:g}: a {settings.stage.kind} stage has no axis along the finger"
        )


def refuse_travel(axis: Literal["x", "y", "z"], machine_mm: float, settings: RigSettings) -> None:
    """Where the stage cannot go."""
    travel_mm = settings.stage.travel_mm["xyz".index(axis)]
    if not -travel_mm <= machine_mm <= 0:
        raise BadInputError(
            f"machine {axis} = {machine_mm:.3f} mm is outside the stage's travel, {-travel_mm:g} … 0 mm"
        )
    if axis == "z" and machine_mm < settings.bounds.lowest_z_mm - 1e-9:
        raise BadInputError(f"machine z = {machine_mm:.3f} mm is below {settings.floor}")
