"""The reference that errors are measured against: a fine mesh and its error bars.

`studies/accuracy/reference_levels.py` makes it.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.speed_and_error.measure import QUANTITIES, Answer
from sim.speed_and_error.scenes import FAMILIES, Scene

Array = NDArray[np.float64]
Bars = Mapping[str, Mapping[str, float]]

FILE = "reference_answers.json"


@dataclass(frozen=True)
class Reference:
    """(k,) values for each scene and quantity, and relative error bars for each family and quantity."""

    values: Mapping[Scene, Mapping[str, Array]]
    bars: Bars
    provenance: Mapping[str, Any]

    def error(self, scene: Scene, quantity: str, answer: Answer) -> float:
        """Largest deviation, over the largest value of the quantity: over all receptors, where it is theirs."""
        value = self.values[scene][quantity]
        return float(np.abs(answer.value(quantity) - value).max() / np.abs(value).max())

    def largest_errors(self, answers: Mapping[Scene, Answer]) -> dict[str, dict[str, float]]:
        """By family and quantity, over the family's scenes."""
        return {
            family: {
                quantity: max(
                    self.error(scene, quantity, a) for scene, a in answers.items() if scene.family == family
                )
                for quantity in QUANTITIES
            }
            for family in FAMILIES
        }


def from_levels(coarse: Mapping[Scene, Answer], fine: Mapping[Scene, Answer], about: Mapping[str, Any]) -> Reference:
    """The finer of two levels; its bars are the largest changes from the coarser one.

    Nothing is extrapolated: under sharp shapes the changes from level to level do not fall by any one order.
    """
    values = {scene: {quantity: answer.value(quantity) for quantity in QUANTITIES} for scene, answer in fine.items()}
    bars = Reference(values, {}, about).largest_errors(coarse)
    return Reference(values, bars, about)


def stored() -> Reference:
    """The reference that is shipped."""
    return _read((files("sim") / "data" / FILE).read_text(encoding="utf-8"))


@cache
def _read(text: str) -> Reference:
    content = json.loads(text)
    values = {
        Scene(**row["scene"]): {quantity: np.array(row[quantity]) for quantity in QUANTITIES}
        for row in content["scenes"]
    }
    return Reference(values, content["bars"], content["provenance"])


def as_json(reference: Reference) -> str:
    """What `stored` reads."""
    rows = [
        {"scene": asdict(scene), **{quantity: value.tolist() for quantity, value in values.items()}}
        for scene, values in reference.values.items()
    ]
    content = {"provenance": reference.provenance, "bars": reference.bars, "scenes": rows}
    return json.dumps(content, indent=1) + "\n"
