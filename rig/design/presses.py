"""Presses that a design may choose from: shapes, positions, and depths or forces."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

from rig.design.exceptions import DesignError
from rig.protocol import Rig, about_the_centre

Kind = Literal["doi_mm", "force_gwt"]

SOURCE_POSITIONS_MM = (2.0, 1.5, 1.0, 0.5, 0.17, 0.0, -0.17, -0.34, -0.51, -0.68, -0.85, -1.02, -1.19, -1.36, -1.63,
                       -1.8, -1.97, -2.25, -2.75, -3.25, -3.69)  # fmt: skip
"""The 21 positions of step 1 in the source (Raju 1998, ch. 5)."""


class PossiblePress(NamedTuple):
    """One press: the shape, its position across the finger, and the depth or force."""

    shape: str
    x_mm: float
    kind: Kind
    target: float

    @property
    def title(self) -> str:
        """Title, e.g. "bar:3.0 at −0.34 mm to 0.5 mm"."""
        unit = {"doi_mm": "mm", "force_gwt": "gwt"}[self.kind]
        return f"{self.shape} at {self.x_mm:g} mm to {self.target:g} {unit}".replace("-", "−")

    def make(self, rig: Rig, hold_s: float) -> None:
        """Move there and press, with this shape mounted."""
        rig.move_to(x_mm=self.x_mm)
        if self.kind == "doi_mm":
            rig.indent(doi_mm=self.target, hold_s=hold_s)
        else:
            rig.indent(force_gwt=self.target, hold_s=hold_s)


def positions_mm(shape: str) -> tuple[float, ...]:
    """Return the 21 positions of a shape (mm): those of the source for steps, 0.17 mm apart for others."""
    return SOURCE_POSITIONS_MM if shape.startswith("step") else about_the_centre(len(SOURCE_POSITIONS_MM))


def possible_presses(shapes: Sequence[str], kind: Kind, targets: Sequence[float]) -> list[PossiblePress]:
    """Return every combination of a shape, one of its positions, and a depth (mm) or force (gwt)."""
    return [
        PossiblePress(shape, x, kind, target) for shape in shapes for x in positions_mm(shape) for target in targets
    ]


def planned_presses(design: Mapping[str, Any], blocks: Any) -> tuple[PossiblePress, ...]:
    """Return the presses of the blocks of a designed script, in order. Raises DesignError."""
    try:
        return tuple(
            PossiblePress(str(shape), float(x_mm), design["kind"], float(target))
            for shape, pairs in blocks
            for x_mm, target in pairs
        )
    except (KeyError, TypeError, ValueError):
        raise DesignError("BLOCKS: must be shapes, each with pairs of numbers", "bad_blocks") from None
