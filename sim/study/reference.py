"""The reference that errors are measured against: values with error bars, made by `bench/reference.py`."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.study.measure import QUANTITIES, Answer
from sim.study.scenes import Scene

Array = NDArray[np.float64]

FILE = "study_reference.json"
_ORDER = 2.0  # of hex8 in displacement and force; the bar is as long as the extrapolation, whatever the order


@dataclass(frozen=True)
class Reference:
    """For each scene and quantity (k,) values, and (k,) bars within which a further level lands."""

    values: Mapping[Scene, Mapping[str, Array]]
    bars: Mapping[Scene, Mapping[str, Array]]
    provenance: Mapping[str, Any]

    def error(self, scene: Scene, quantity: str, answer: Answer) -> float:
        """Largest deviation, over the largest value of the quantity: over all receptors, where it is theirs."""
        value = self.values[scene][quantity]
        return relative(answer.value(quantity) - value, value)

    def bar(self, scene: Scene, quantity: str) -> float:
        """The error bar in the same measure."""
        return relative(self.bars[scene][quantity], self.values[scene][quantity])


def relative(deviation: Array, value: Array) -> float:
    """Largest deviation over the largest value."""
    return float(np.abs(deviation).max() / np.abs(value).max())


def extrapolated(
    coarse: Mapping[Scene, Answer], fine: Mapping[Scene, Answer], ratio: float, provenance: Mapping[str, Any]
) -> Reference:
    """Richardson's extrapolation from two levels whose spacings have a ratio > 1; the bar is what it adds.

    Widths are not extrapolated: they go by steps of the places where contact is enforced.
    """
    values: dict[Scene, dict[str, Array]] = {}
    bars: dict[Scene, dict[str, Array]] = {}
    for scene in fine:
        values[scene], bars[scene] = {}, {}
        for quantity in QUANTITIES:
            change = fine[scene].value(quantity) - coarse[scene].value(quantity)
            added = 0.0 * change if quantity == "width" else change / (ratio**_ORDER - 1)
            values[scene][quantity] = fine[scene].value(quantity) + added
            bars[scene][quantity] = np.abs(change) if quantity == "width" else np.abs(added)
    return Reference(values, bars, provenance)


def stored() -> Reference:
    """The reference that is shipped."""
    return _read((files("sim") / "data" / FILE).read_text(encoding="utf-8"))


@cache
def _read(text: str) -> Reference:
    content = json.loads(text)
    values, bars = (
        {Scene(**row["scene"]): {q: np.array(row[part][q]) for q in QUANTITIES} for row in content["scenes"]}
        for part in ("values", "bars")
    )
    return Reference(values, bars, content["provenance"])


def as_json(reference: Reference) -> str:
    """What `stored` reads."""
    rows = [
        {
            "scene": asdict(scene),
            **{
                part: {q: table[scene][q].tolist() for q in QUANTITIES}
                for part, table in (("values", reference.values), ("bars", reference.bars))
            },
        }
        for scene in reference.values
    ]
    return json.dumps({"provenance": dict(reference.provenance), "scenes": rows}, indent=1) + "\n"
