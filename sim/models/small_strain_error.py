"""Measured deviation of small-strain results from finite strain.

`docs/small_strain.md` explains the table.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import pairwise
from typing import NamedTuple

from rig_shared.outputs import Ends, Output
from sim.models.stiffening import FORCE_ERROR, SED_ERROR

FILE = "small_strain.json"
_LEAST_REPORTED = 0.01


class SmallStrainJson(Output):
    """Deviation of a linear result from finite strain: smallest and largest; null without a comparison."""

    note_text: str
    force: Ends | None
    sed: Ends | None


class DeviationRange(NamedTuple):
    """Smallest and largest of linear / finite strain − 1 over all compared shapes."""

    low: float
    high: float

    def __str__(self) -> str:
        low, high = round(100 * self.low), round(100 * self.high)
        if max(abs(self.low), abs(self.high)) < _LEAST_REPORTED:
            return "within 1 %"
        if low == high:
            return f"{abs(low)} % {_side(low)}"
        if low >= 0 or high <= 0:
            near, far = sorted((abs(low), abs(high)))
            return f"{near} to {far} % {_side(low + high)}"
        return f"{-low} % low to {high} % high"


@dataclass(frozen=True)
class SmallStrain:
    """Deviation of a small-strain result at a depth, by kind of model; None where nothing was compared.

    At finite strain, stiffening is a number, and it is the deviation of the correction.
    """

    kind: str
    doi_mm: float
    force: DeviationRange | None
    sed: DeviationRange | None
    stiffening: float | None = None
    compared: bool = True
    """Whether the finger is the one that was compared with finite strain, the default one."""

    @property
    def note(self) -> str:
        """Summary in one line."""
        if self.stiffening is not None:
            force, sed = (f"{100 * error:g} %" for error in (FORCE_ERROR, SED_ERROR))
            return (
                f"finite strain, stiffening {self.stiffening:g}: force within {force}, highest SED within {sed} on "
                "the eight fingers that were compared"
            )
        if not self.compared:
            return "small strain: not measured for this finger, only for the default one"
        if self.force is None or self.sed is None:
            return (
                f"small strain: a {self.kind} pressed {self.doi_mm:.2f} mm deep was not compared with finite strain"
            )
        return f"small strain: at {self.doi_mm:.2f} mm the linear force is {self.force}, SED {self.sed}"

    def as_json(self) -> SmallStrainJson:
        """Return the entry of JSON output."""
        return {"note_text": self.note, "force": self.force, "sed": self.sed}


def small_strain(kind: str, doi_mm: float, stiffening: float | None = None, *, compared: bool = True) -> SmallStrain:
    """Return the deviation for a kind of model ("finger", "section", "halfspace") at a depth in mm.

    It is known for a finger that was `compared` with finite strain, or that has a stiffening, at finite strain.
    """
    if stiffening is not None:
        force, sed = (DeviationRange(-error, error) for error in (FORCE_ERROR, SED_ERROR))
        return SmallStrain(kind, doi_mm, force, sed, stiffening)
    if not compared:
        return SmallStrain(kind, doi_mm, None, None, compared=False)
    curve = _curves().get(kind.removeprefix("interpolated "), ())
    points = [(0.0, DeviationRange(0.0, 0.0), DeviationRange(0.0, 0.0)), *curve]
    for (above, force, sed), (below, force_below, sed_below) in pairwise(points):
        if doi_mm <= below:
            share = (doi_mm - above) / (below - above)
            return SmallStrain(kind, doi_mm, _between(force, force_below, share), _between(sed, sed_below, share))
    return SmallStrain(kind, doi_mm, None, None)


Point = tuple[float, DeviationRange, DeviationRange]


@cache
def _curves() -> Mapping[str, tuple[Point, ...]]:
    stored = json.loads((files("sim.data") / FILE).read_text("utf-8"))
    return {
        kind: tuple((row["doi_mm"], DeviationRange(*row["force"]), DeviationRange(*row["sed"])) for row in rows)
        for kind, rows in stored["curves"].items()
    }


def _between(above: DeviationRange, below: DeviationRange, share: float) -> DeviationRange:
    return DeviationRange(*(a + share * (b - a) for a, b in zip(above, below, strict=True)))


def _side(percent: int) -> str:
    return "high" if percent > 0 else "low"
