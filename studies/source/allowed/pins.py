"""What is left of each range, and what the source says something of."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from studies.source.allowed.ranges import RANGES, Range, place_of
from studies.source.allowed.waves import RemainingPlaces

Array = NDArray[np.float64]

MIDDLE = (0.05, 0.95)
PINNED = 0.75
"""A parameter is pinned where nine tenths of what is left take less than this part of what they took before."""


@dataclass(frozen=True)
class Pin:
    """One parameter: lowest and highest value that is left, the middle nine tenths, and their part of the range's."""

    one: Range
    least: float
    most: float
    low: float
    high: float
    part: float

    @property
    def pinned(self) -> bool:
        """Whether the source says something of it."""
        return self.part < PINNED


def pins(left: RemainingPlaces) -> list[Pin]:
    """In the order of the ranges."""
    found = []
    for one, units in zip(RANGES, left.places[left.allowed].T, strict=True):
        low, high = np.quantile(units, MIDDLE)
        part = float((high - low) / (MIDDLE[1] - MIDDLE[0]))
        least, most = one.at(float(units.min())), one.at(float(units.max()))
        found.append(Pin(one, least, most, one.at(float(low)), one.at(float(high)), part))
    return found


def but_for_the_pinned(left: RemainingPlaces) -> Array:
    """(d,) the default finger with what is pinned in the middle of what is left of it."""
    units = np.median(left.places[left.allowed], axis=0)
    values = {
        pin.one.name: pin.one.at(float(u)) if pin.pinned else pin.one.default
        for pin, u in zip(pins(left), units, strict=True)
    }
    return place_of(values)
