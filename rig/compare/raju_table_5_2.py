"""Table 5.2 of Raju (1998): receptors whose SSRPs match recorded ones by eye, and agreement with the shape test."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.measures.measures import MEASURES

Flags = NDArray[np.bool_]

SHAPES = ("step:1", "step:3", "step:5")

_E13 = (0, -0.5, -1, -1.25, -1.5)
_THREE = (-1, -1.25, -1.5)
_TWO = (-1, -1.25)

TABLE: dict[str, tuple[tuple[float, ...], ...]] = {
    "e11": (_TWO, _TWO, ()), "e22": (_TWO, _TWO, (-0.5,)), "e33": ((), (), ()),
    "e12": ((0,), (), ()), "e23": ((), (), ()), "e13": (_E13, _E13, _TWO),
    "ep1": (_THREE, _THREE, (-0.5, -1)), "ep2": ((), (), _TWO), "ep3": ((-0.5, -1), (-0.5, -1), (-0.5, -1)),
    "s11": ((), (), ()), "s22": (_TWO, (-1,), ()), "s33": ((-1,), (-1,), ()),
    "sp1": (_TWO, _TWO, ()), "sp2": ((), (), ()), "sp3": ((), (), ()),
    "sed": (_THREE, _TWO, (-1,)), "mean": ((-1,), (-1,), (-0.5,)), "third": ((), (), ()),
}  # fmt: skip
"""Receptors (x in mm) under steps 1, 3 and 5. The source prints +1.5 for e11 under step 1 in a third place, perhaps a
misprint for −1.5; it is listed in `DOUBTFUL` and included as printed."""

DOUBTFUL = ("e11", "step:1", 1.5)


@dataclass(frozen=True)
class Agreement:
    """Counts of cells that pass in both tables, only here, only in the source, and in neither."""

    both: int
    ours: int
    source: int
    neither: int

    @property
    def precision(self) -> float:
        """Share of the passes here that the source has; NaN without any."""
        return self.both / (self.both + self.ours) if self.both + self.ours else math.nan

    @property
    def recall(self) -> float:
        """Share of the source's passes that are found here; NaN without any."""
        return self.both / (self.both + self.source) if self.both + self.source else math.nan

    @property
    def matthews(self) -> float:
        """Matthews' correlation coefficient; 0 if one table is constant."""
        sides = (self.both + self.ours, self.both + self.source, self.neither + self.ours, self.neither + self.source)
        product = math.prod(sides)
        return (self.both * self.neither - self.ours * self.source) / math.sqrt(product) if product else 0.0


def source_flags(receptor_mm: NDArray[np.float64]) -> Flags:
    """Return (18, 3, receptors) flags of the table at receptors (n,) mm."""
    flags = np.zeros((len(MEASURES), len(SHAPES), len(receptor_mm)), dtype=bool)
    for m, measure in enumerate(MEASURES):
        for k, receptors in enumerate(TABLE.get(measure, ())):  # empty for measures that the source does not have
            flags[m, k] = np.isin(receptor_mm.round(6), receptors)
    measure, shape, x = DOUBTFUL
    flags[MEASURES.index(measure), SHAPES.index(shape)] |= receptor_mm.round(6) == x
    return flags


def agreement(ours: Flags, source: Flags) -> Agreement:
    """Count cells of two arrays of the same shape."""
    return Agreement(*(int(np.sum(v)) for v in (ours & source, ours & ~source, ~ours & source, ~ours & ~source)))
