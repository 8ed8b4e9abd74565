"""What a recording is of: a shape, and the force or depth it was pressed to where several were."""

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from rig.compare.errors import RecordingError
from sim.contact.shapes import shape_name

_UNITS = {"doi_mm": "mm", "force_gwt": "gwt"}
_CONDITION = re.compile(r"(\d+\.?\d*|\.\d+) ?(mm|gwt)")


class ShapeKey(NamedTuple):
    """A shape by its canonical name, and a condition as stimuli have it ("8 gwt"), empty where any is meant."""

    shape: str
    condition: str

    def __str__(self) -> str:
        """As recordings are told apart: "step:1" or "step:1@8 gwt"."""
        return f"{self.shape}@{self.condition}" if self.condition else self.shape


def shape_key(text: str) -> ShapeKey:
    """From "step:1" or "step:1@8gwt". Raises RecordingError, ShapeError."""
    shape, at, said = text.partition("@")
    condition = _CONDITION.fullmatch(said.strip())
    if at and condition is None:
        raise RecordingError(
            "{given!r}: {condition!r}, expected a force or depth after @, like 8gwt or 0.5mm",
            code="no_condition",
            given=text,
            condition=said,
        )
    return ShapeKey(shape_name(shape), f"{float(condition[1]):g} {condition[2]}" if condition else "")


def condition_of(started: Mapping[str, Any]) -> str:
    """What an indentation of a run was commanded to, from its `indentation_start`."""
    return f"{started['value']:g} {_UNITS[started['target']]}"
