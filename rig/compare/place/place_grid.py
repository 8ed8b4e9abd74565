"""Measures at receptors over a range of lateral places and depths, between which they are interpolated by splines."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.errors import ComparisonError
from sim.config import FingertipConfig
from sim.models.fingertip import Fingertip

Array = NDArray[np.float64]
Range = tuple[float, float]

X_STEP_MM, DEPTH_STEP_MM = 0.125, 0.15
"""Of the nodes, at most; places between them are interpolated (docs/comparison_quality.md says how well)."""

BELOW_EPIDERMIS_MM = (0.1, 0.7)
"""Where nothing else is asked for, receptors are sought so far below the epidermis."""


class PlaceRange(NamedTuple):
    """Where the receptor may be: x, depth below the skin, and the field's centre off the receptor; mm."""

    x_mm: Range
    depth_mm: Range
    offset_mm: Range = (0.0, 0.0)

    @property
    def free(self) -> int:
        """How many of them are fitted."""
        return sum(low < high for low, high in self)

    @property
    def x_nodes(self) -> Array:
        """(nx,) mm."""
        return nodes(self.x_mm, X_STEP_MM)

    @property
    def depth_nodes(self) -> Array:
        """(nd,) mm."""
        return nodes(self.depth_mm, DEPTH_STEP_MM)


def place_range(x_mm: Range, depth_mm: Range | None, offset_mm: Range | None, config: FingertipConfig) -> PlaceRange:
    """What is asked for, below the epidermis of this finger. Raises ComparisonError."""
    skin = config.tissue.epidermis_mm
    depth = depth_mm or (skin + BELOW_EPIDERMIS_MM[0], skin + BELOW_EPIDERMIS_MM[1])
    _refuse("--depth-range-mm", depth)
    _refuse("--offset-mm", offset_mm or (0.0, 1.0))
    if not x_mm[0] < x_mm[1]:
        raise ComparisonError(
            "--place: expected receptors at two or more x, between which it is sought", code="one_receptor_x"
        )
    if depth[0] < skin < depth[1]:
        raise ComparisonError(
            "--depth-range-mm {low_mm:g},{high_mm:g}: the epidermis ends at {epidermis_mm:g} mm, where strains jump; "
            "expected a range on one side of it",
            code="across_epidermis",
            low_mm=depth[0],
            high_mm=depth[1],
            epidermis_mm=skin,
        )
    return PlaceRange(x_mm, depth, offset_mm or (0.0, 0.0))


def _refuse(option: str, asked: Range) -> None:
    if not (all(map(math.isfinite, asked)) and asked[0] < asked[1]):
        raise ComparisonError(
            "{option} {low_mm:g},{high_mm:g}: expected two numbers, the lower one first",
            code="not_ascending",
            option=option,
            low_mm=asked[0],
            high_mm=asked[1],
        )


def nodes(asked: Range, step: float) -> Array:
    """From end to end in equal steps, none above `step`."""
    low, high = asked
    return np.linspace(low, high, math.ceil((high - low) / step - 1e-9) + 1)


def finger_with_grid(config: FingertipConfig, where: PlaceRange) -> Fingertip:
    """The finger with receptors at every node, x going fastest."""
    return Fingertip.load(
        config,
        receptor_x_mm=where.x_nodes.round(6).tolist(),
        receptor_depth_mm=where.depth_nodes.round(6).tolist(),
    )


def spline_weights(at_nodes: Array, at: Array) -> Array:
    """(…, n) weights of values at nodes (n,), by which a cubic spline through them has its values at places (…,)."""
    if len(at_nodes) == 1:
        return np.ones((*np.shape(at), 1))
    from scipy.interpolate import make_interp_spline  # most comparisons do without

    spline = make_interp_spline(at_nodes, np.eye(len(at_nodes)), k=min(3, len(at_nodes) - 1))
    return np.asarray(spline(at))
