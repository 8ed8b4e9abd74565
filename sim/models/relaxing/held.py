"""Skin that forces hold where it would not lie by itself."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim.contact.patch import Patch

Array = NDArray[np.float64]


def held_by(patch: Patch, force: Array) -> Patch:
    """The patch where (m, n) forces hold it: further ones act on it as on skin at rest; its areas stay."""
    return held_at(patch, patch.displaced(force))


def held_at(patch: Patch, displaced_mm: Array) -> Patch:
    """The same where (m, n) displacements are known."""
    position_mm = patch.position_mm.copy()
    position_mm[:, list(patch.axes)] += displaced_mm.T
    return replace(patch, position_mm=position_mm)
