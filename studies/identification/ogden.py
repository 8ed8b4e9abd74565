"""A finger of Ogden's tissue under a bench: its linear twin's forces, times what references found beside theirs.

The factor is that of a shape over depth at the pad's centre; beside the centre it is the same.
"""

import json
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from sim.config import FingertipConfig
from sim.contact.indentor import Indentor
from sim.contact.shapes import parse_shape
from sim.errors import ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.models.fingertip import Fingertip
from sim.models.sources import ModelSource, Recipe
from sim.models.stiffening import LINEAR_TISSUE, Stiffened, Under

Array = NDArray[np.float64]

_PLACES_KEPT = 64
REFERENCES = Path(__file__).with_suffix(".jsonl")


def references() -> list[dict[str, Any]]:
    """Return the presses at finite strain."""
    return [json.loads(line) for line in REFERENCES.read_text("utf-8").splitlines()]


class OgdenFinger(Fingertip):
    """The finger of a configuration, were its tissue Ogden's with the same moduli at small strain.

    Only its forces are; a press of a shape without references raises ModelRangeError.
    """

    def __init__(
        self, config: FingertipConfig, surface: FingertipSurface, source: ModelSource, recipe: Recipe
    ) -> None:
        super().__init__(config, surface, source, recipe)
        self._under = lru_cache(maxsize=_PLACES_KEPT)(partial(UnderOgden, config, surface))


class UnderOgden(Under):
    """An indentor at a place over tissue of Ogden's law."""

    def at(self, past_touch_mm: float, receptor_mm: Array) -> Stiffened:
        """So far past first touch. Raises ModelRangeError for a shape without references."""
        return LINEAR_TISSUE._replace(force=factor(self.indentor, max(past_touch_mm, 0.0)))


def factor(indentor: Indentor, depth_mm: float) -> float:
    """Force over the linear twin's. Raises ModelRangeError for a shape without references."""
    log_factor = _log_factors().get(indentor)
    if log_factor is None:
        raise ModelRangeError(f"{indentor.name}: no references of Ogden's law are kept")
    within_mm = min(depth_mm, float(log_factor.x[-1]))
    beyond_mm = depth_mm - within_mm  # straight
    return float(np.exp(log_factor(within_mm) + beyond_mm * log_factor(within_mm, 1)))


@cache
def _log_factors() -> dict[Indentor, PchipInterpolator]:
    """Of each shape, over mm: monotone between references and from 0 at first touch."""
    kept = references()
    found = {}
    for shape in dict.fromkeys(row["shape"] for row in kept):
        own = [(row["doi_mm"], np.log(row["force"] / row["linear"])) for row in kept if row["shape"] == shape]
        found[parse_shape(shape)] = PchipInterpolator(*np.array([(0.0, 0.0), *own]).T)
    return found
