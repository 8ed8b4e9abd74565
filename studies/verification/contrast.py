"""Layers of very unlike stiffness: does condensation keep its digits?

A box of 6 × 6 mm (a quarter of it meshed), 3 mm deep, on a rigid base. Bone is a stiff layer below, as in the finger;
the other case is a stiff skin floating on a soft base, where K·u loses as many digits as the stiffness has more.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from studies.verification.box import Box, BoxBody, condense

Array = NDArray[np.float64]

POISSON = 0.48


@dataclass(frozen=True)
class Condensed:
    """What the condensed body answers, and how well that satisfies the whole one."""

    displacement: Array  # (3, n_patch) mm under a unit pressure
    imbalance: float  # ‖K u − f‖ / ‖f‖ with everything free
    mismatch: float  # condensed against whole displacement, relative to the largest


def condensed(ratio: float, stiff: Literal["bone", "skin"]) -> Condensed:
    """Condense, press on every node of the patch, and put the forces back into the whole body."""
    x = np.linspace(0, 3, 10)
    box = Box(x, np.linspace(-3, 0, 13), x)
    y = box.centroids[:, 1]
    young = np.where((y < -2) if stiff == "bone" else (y > -0.5), ratio, 1.0)
    body = BoxBody(box, young, POISSON)
    patch = condense(box, body, 1.5)
    force = np.zeros((len(patch.axes), len(patch)))
    force[-1] = -patch.area_mm2
    u = patch.displaced(force)
    loads = np.zeros((1, len(box.nodes), 3))
    on = box.number[: patch.shape[1], -1, : patch.shape[0]].T.ravel()
    loads[0, on, 1] = force[-1]
    whole = body.solve(loads)[0]
    mismatch = np.abs(whole[on][:, patch.axes].T - u).max() / np.abs(u).max()
    return Condensed(u, body.imbalance(whole, loads[0]), float(mismatch))
