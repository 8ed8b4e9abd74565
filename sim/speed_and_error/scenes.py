"""The scenes in which errors are measured."""

from dataclasses import dataclass

import numpy as np

OFFSET_RANGE_MM = 0.17
"""Positions are spread over one element of the default mesh, so that no answer rests on where a node falls."""


@dataclass(frozen=True)
class Scene:
    """One indentation to a depth; its family says what its errors stand for."""

    family: str  # "smooth", "bar" or "step"
    shape: str
    x_mm: float
    doi_mm: float

    @property
    def name(self) -> str:
        """As it is written in tables."""
        return f"{self.shape} at {self.x_mm:g}, DOI {self.doi_mm:g}"


def _offset(family: str, shape: str, x_mm: float, doi_mm: float, n: int) -> list[Scene]:
    offsets = np.arange(n) * OFFSET_RANGE_MM / n
    return [Scene(family, shape, round(x_mm + float(offset), 4), doi_mm) for offset in offsets]


SCENES = (
    *_offset("smooth", "cylinder:9", 0.0, 0.4, 2),
    *_offset("smooth", "cylinder:9", 0.0, 0.67, 2),
    *_offset("smooth", "cylinder:3", 0.0, 0.67, 2),
    *_offset("smooth", "step:5", -1.63, 0.73, 2),
    *_offset("bar", "bar:3.0", 0.0, 0.67, 4),
    *_offset("bar", "bar:1.5", 0.0, 0.67, 4),
    *_offset("step", "step:1", -1.63, 0.73, 4),
)

FAMILIES = ("smooth", "bar", "step")

QUICK_SCENES = tuple(scene for scene in SCENES if scene.x_mm in (0.0, -1.63))
"""The first position of each."""
