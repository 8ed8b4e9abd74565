"""How measures and frames are written in figures and tables."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rig.compare.comparison import Pairing
from rig.report.style import signed
from sim.measures.measures import MEASURES, PLOTTED_AS_MAGNITUDE

Pair = tuple[int, int]  # measure, receptor

_STRAINS = MEASURES[:9]
_ABBREVIATED = {"sed": "SED"}


def label(measure: str) -> str:
    """A measure with its sign convention: "−ep1" where compression is plotted upwards."""
    name = _ABBREVIATED.get(measure, measure)
    return f"−{name}" if measure in PLOTTED_AS_MAGNITUDE else name


def unit(measure: str) -> str:
    """Strains are numbers, everything else is in pseudo-units."""
    return "strain" if measure in _STRAINS else "pseudo-units³" if measure == "third" else "pseudo-units"


def frame(pairings: Sequence[Pairing]) -> str:
    """How recorded positions and rates were laid over the simulation; printed on every figure that does."""
    changed = {f"{p.stimulus.indentor} {change}" for p in pairings for change in p.recording.changes}
    return "; ".join(["indentor x = recorded position + receptor x, no offset fitted", *sorted(changed)])


def named(receptor_mm: NDArray[np.float64], pair: Pair) -> str:
    """A measure at a receptor."""
    return f"{label(MEASURES[pair[0]])} at {signed(receptor_mm[pair[1]])} mm"
