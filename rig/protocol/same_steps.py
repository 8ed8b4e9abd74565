"""Comparison of the steps of a resumed run with those in its journal: another order is another run."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from rig.errors import BadInputError
from rig.protocol.check import Spot
from rig.protocol.steps import (
    Indent,
    Journalled,
    Note,
    Precondition,
    PressStep,
    Ramp,
    Reference,
    Rest,
    Step,
)
from rig.records import PressId, Purpose

Asked = Mapping[str, Any]
"""What a step asks for: verb, indentor, position, target, motion, and place in the schedule."""

_ALIKE = 1e-3
"""Largest difference of equal numbers (mm, gwt, s): a script may compute with answers, which the journal rounds."""
_NOT_ASKED = ("index", "t_s", "contact_height_mm", "predicted_doi_mm", "predicted_force_gwt")
_STARTS: dict[Purpose, str] = {
    "data": "indentation_start",
    "precondition": "precondition_indentation_start",
    "reference": "reference_indentation_start",
    "find": "find",
}


class SameSteps:
    """Steps in the journal of a stopped run, to be compared with those that its script makes now."""

    def __init__(self, before: Journalled) -> None:
        self._recorded = dict(_recorded(before))
        self._notes = [str(event.get("text", "")) for event in before.stream("note")]
        self._rests_s = [float(event["rest_s"]) for event in before.stream("rest") if "rest_s" in event]
        self.differences: list[str] = []

    def compare(self, step: Step[Any, Any], spot: Spot, press_mm_s: float) -> None:
        """Compare a step; raise BadInputError for another press, and list another note or rest.

        press_mm_s: speed of a press that names none.
        """
        for press in spot.ids:
            recorded = self._recorded.get((press.purpose, press.index))
            if recorded is not None:
                _refuse_other(recorded, asked_of(step, spot, press, press_mm_s), press)
        if isinstance(step, Note) and self._notes:
            was = self._notes.pop(0)
            if was != step.text:
                self.differences.append(f"note: {step.text!r}, where the run has {was!r}")
        known_s = self._rests_s or [getattr(step, "seconds", 0.0)]
        if isinstance(step, Rest) and not any(_equal(step.seconds, was_s) for was_s in known_s):
            self.differences.append(f"rest: {step.seconds:g} s, where the run has {known_s[0]:g} s")


def asked_of(step: Step[Any, Any], spot: Spot, press: PressId, press_mm_s: float) -> Asked:
    """Return what a step asks for in one of its presses; of a step of another package, where and with what."""
    place = {"indentor": spot.indentor, "x_mm": spot.x_mm, **press.marks}
    if press.purpose == "find":
        return {**place, "along_mm": spot.along_mm}
    if not isinstance(step, Indent | Ramp | Precondition | Reference):
        return place
    speed_mm_s = getattr(step, "speed_mm_s", None)
    asked = {
        **place,
        "verb": step.verb if isinstance(step, PressStep) else Indent.verb,
        "target": step.target.kind,
        "value": step.target.value,
        "increments": getattr(step, "increments", 1),
        "speed_mm_s": press_mm_s if speed_mm_s is None else speed_mm_s,
    }
    return {**asked, "hold_s": step.hold_s}


def _recorded(before: Journalled) -> Iterator[tuple[tuple[Purpose, int], Asked]]:
    """Yield what each press in the journal was asked for; journals of 0.2 have neither verb, speed nor duration."""
    speeds_mm_s = {event["index"]: event["speed_mm_s"] for event in before.stream("ramp")}
    for purpose, stream in _STARTS.items():
        for event in before.stream(stream):
            asked = {key: value for key, value in event.items() if key not in _NOT_ASKED}
            if purpose == "data" and event["index"] in speeds_mm_s:
                asked |= {"verb": Ramp.verb, "speed_mm_s": speeds_mm_s[event["index"]]}
            yield (purpose, event["index"]), asked


def _refuse_other(recorded: Asked, asked: Asked, press: PressId) -> None:
    # Earlier versions recorded the place in the schedule only in part.
    marks = ("block", "repeat", "condition") if "hold_s" in recorded else ()
    shared = [key for key in recorded if key in asked]
    keys = [key for key in dict.fromkeys((*shared, *marks)) if not _equal(recorded.get(key), asked.get(key))]
    if not keys:
        return
    raise BadInputError(
        f"{press.purpose} press index {press.index}: the script now asks for {_in_words(asked, keys)}, where the "
        f"run has {_in_words(recorded, keys)}, so it would be another run; seed what is random "
        "(random.Random(7).shuffle), sort what is a set, and start a new run",
        "another_press",
    )


def _equal(one: Any, other: Any) -> bool:
    if isinstance(one, int | float) and isinstance(other, int | float):
        return math.isclose(one, other, rel_tol=_ALIKE, abs_tol=_ALIKE)
    return bool(one == other)


def _in_words(asked: Asked, keys: list[str]) -> str:
    values = {key: asked.get(key) for key in keys}
    return ", ".join(
        f"{key} = {one:g}" if isinstance(one, float) else f"{key} = {one}" for key, one in values.items()
    )
