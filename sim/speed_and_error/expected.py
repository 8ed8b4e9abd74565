"""How wrong and how dear each model is, as measured: a table by family of shapes, depth and place.

`python -m studies.choice.table` makes it.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

from sim.models.catalogue import ModelName
from sim.speed_and_error.candidates import SHARES
from sim.speed_and_error.situation import Situation

FILE = "expected_errors.json"

DEPTHS_MM = (0.3, 0.7, 1.35)
PLACES_MM = (0.5, 1.8)
"""The upper ends of the bands: of the depth, and of the first touch's distance from the pad's centre."""


class Cell(NamedTuple):
    """Scenes that are expected to be equally hard: a family, up to a depth, up to a distance from the centre."""

    family: str
    depth_mm: float
    place_mm: float


class Rung(NamedTuple):
    """A model and the level of its mesh."""

    model: ModelName
    level: str


class Cost(NamedTuple):
    """Of a press, from nothing: processor seconds of one thread, and the memory that building takes."""

    build_s: float  # without receptors
    receptors_s: float  # for ten of them
    press_s: float
    memory_mb: float


def cell_of(situation: Situation) -> Cell | None:
    """Where a scene of known depth belongs; None where nothing was measured."""
    cells = cells_of(situation)
    return cells[0] if situation.depth_mm is not None and cells else None


def cells_of(situation: Situation) -> list[Cell]:
    """Where a scene may belong: at every depth, if its own is not known. None where nothing was measured."""
    place = next((band for band in PLACES_MM if situation.place_mm <= band), None)
    if place is None:
        return []
    if situation.depth_mm is None:
        return [Cell(situation.family, depth, place) for depth in DEPTHS_MM]
    if not situation.depth_mm > 0:
        return []
    return [Cell(situation.family, depth, place) for depth in DEPTHS_MM if situation.depth_mm <= depth][:1]


@dataclass(frozen=True)
class Expected:
    """The largest errors in each cell, by rung and quantity, and what each rung costs on a share of the patch."""

    largest: Mapping[Cell, Mapping[Rung, Mapping[str, float]]]
    costs: Mapping[tuple[Rung, tuple[int, ...], float, bool], Cost]  # by axes of slope, share, sharp

    def errors(self, situation: Situation) -> dict[Rung, dict[str, float]]:
        """Of those measured in every cell to which a scene may belong."""
        cells = [self.largest.get(cell, {}) for cell in cells_of(situation)]
        if not cells:
            return {}
        shared = set.intersection(*(set(cell) for cell in cells))
        return {
            rung: {quantity: max(cell[rung][quantity] for cell in cells) for quantity in cells[0][rung]}
            for rung in sorted(shared)
        }

    def share(self, rung: Rung, situation: Situation) -> float:
        """Of the patch: the smallest that is large enough and whose cost is known."""
        known = (s for s in SHARES if (rung, situation.axes, s, situation.sharp) in self.costs)
        return next(share for share in known if share >= situation.share)

    def cost(self, rung: Rung, situation: Situation) -> Cost:
        """Of one press."""
        return self.costs[rung, situation.axes, self.share(rung, situation), situation.sharp]


@cache
def bundled() -> Expected:
    """What was measured."""
    return from_json((files("sim") / "data" / FILE).read_text(encoding="utf-8"))


def from_json(text: str) -> Expected:
    """What `studies/choice/table.py` wrote."""
    content = json.loads(text)
    largest = {
        Cell(row["family"], row["depth_mm"], row["place_mm"]): {
            Rung(one["model"], one["level"]): dict(one["errors"]) for one in row["largest"]
        }
        for row in content["errors"]
    }
    return Expected(largest, {key: cost for row in content["costs"] for key, cost in _costs(row)})


def _costs(row: Mapping[str, Any]) -> Iterator[tuple[tuple[Rung, tuple[int, ...], float, bool], Cost]]:
    for sharp, press_s in ((False, row["smooth_press_s"]), (True, row["sharp_press_s"])):
        key = Rung(row["model"], row["level"]), tuple(row["axes"]), row["share"], sharp
        yield key, Cost(row["build_s"] - row["receptors_s"], row["receptors_s"], press_s, row["memory_mb"])
