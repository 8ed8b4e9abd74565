"""What is written over figures in which recordings lie over the simulation."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rig.compare.comparison import Overlay
from rig.compare.tables import Pair
from rig.report.labels import label
from rig.report.style import signed
from sim.measures.measures import MEASURES


def frame(overlays: Sequence[Overlay]) -> str:
    """How recorded positions and rates were laid over the simulation; printed on every figure that does."""
    changed = {f"{p.stimulus.indentor} {change}" for p in overlays for change in p.recording.changes}
    return "; ".join(["indentor x = recorded position + receptor x, no offset fitted", *sorted(changed)])


def named(receptor_mm: NDArray[np.float64], pair: Pair) -> str:
    """A measure at a receptor."""
    return f"{label(MEASURES[pair[0]])} at {signed(receptor_mm[pair[1]])} mm"
