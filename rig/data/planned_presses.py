"""What a script pressed in a run beside what it planned when the run began."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.data.folder import PLAN
from rig_shared.plural import number_of
from rig_shared.user_files import json_of, read_bytes

if TYPE_CHECKING:
    from rig.data.run import Run

_ALIKE = 1e-3
"""Largest difference of equal numbers (mm, gwt, s): a script may compute with answers, which the journal rounds."""
_NUMBERS = ("press", "index", "presses")


def planned_steps(path: Path) -> list[dict[str, Any]]:
    """Return the steps that a run stored when it began. Raises OSError, ValueError, TypeError."""
    return [dict(json_of(line)) for line in read_bytes(path).splitlines()]


def is_alike(one: Any, other: Any) -> bool:
    """Return whether two arguments of a step are equal, apart from rounding."""
    if isinstance(one, int | float) and isinstance(other, int | float):
        return math.isclose(one, other, rel_tol=_ALIKE, abs_tol=_ALIKE)
    return bool(one == other)


def pressed_otherwise(run: "Run") -> str | None:
    """Return a sentence on the presses that are not those of the plan; None without any, or without a plan.

    A session that chooses each press by the responses has no fixed plan.
    """
    planned = _planned(run)
    if not planned or run.stream("choice"):
        return None
    starts = run.stream("indentation_start")
    found = [(start["index"], said) for start in starts if (said := _difference(start, planned.get(start["index"])))]
    if not found:
        return None
    index, said = found[0]
    some = f"{len(found)} of {number_of(len(starts), 'presses')} {'is' if len(found) == 1 else 'are'}"
    return (
        f"run folder {run.folder.path}: {some} not as planned, first at index {index}: {said}; unless the script "
        "presses by what it measures, it draws without a seed or loops over a set: seed what is random "
        "(random.Random(7).shuffle), sort what is a set"
    )


def _planned(run: "Run") -> dict[int, Mapping[str, Any]]:
    """Return the planned presses that are data, by index; none without a plan, or with a damaged one."""
    try:
        presses = [step for step in planned_steps(run.folder.path / PLAN) if step.get("press") == "data"]
        return {step["index"] + n: step for step in presses for n in range(step.get("presses", 1))}
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}


def _difference(start: Mapping[str, Any], planned: Mapping[str, Any] | None) -> str:
    """Return how the beginning of a press differs from its plan; "" if it does not."""
    if planned is None:
        return "a press that was not planned"
    keys = [key for key, was in planned.items() if key not in _NUMBERS and was is not None]
    other = [key for key in keys if not is_alike(start.get(key), planned[key])]
    return ", ".join(f"{key} = {_said(start.get(key))}, planned {_said(planned[key])}" for key in other)


def _said(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
