"""Measures on a grid of receptor positions, interpolated, and the range of the receptor location."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import ComparisonError
from rig.compare.verdict import LEVEL, six_digits
from rig_shared.outputs import File, Interval, Name, Output, Ratio, Unit, listed
from sim.config import FingertipConfig
from sim.measures.measures import BY_NAME, MeasureName
from sim.models.fingertip import Fingertip

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

Array = NDArray[np.float64]
Range = tuple[float, float]

X_STEP_MM, DEPTH_STEP_MM = 0.125, 0.15
"""Maximum spacing of the nodes (mm); locations between them are interpolated (docs/validation/comparison.md)."""

BELOW_EPIDERMIS_MM = (0.1, 0.7)
"""Default range of depths below the epidermis (mm)."""


class PlaceRowJson(Output):
    """A measure at its maximum-likelihood place, with 95 % intervals."""

    measure: MeasureName
    unit: Unit
    x_mm: float | None
    depth_mm: float | None
    offset_mm: float | None
    k: float | None
    eps0: float | None
    deviance: Ratio | None
    lack_of_fit: Ratio | None
    p_fit: Ratio | None
    x_interval_mm: Interval
    depth_interval_mm: Interval
    offset_interval_mm: Interval | None
    fits: bool
    at_bounds: list[
        Annotated[str, listed(f"{place} {end}" for place in ("x", "depth", "offset") for end in ("low", "high"))]
    ]


class PlaceJson(Output):
    """Location of one afferent's receptor."""

    stimuli: list[Name]
    recordings: list[File]
    positions: int
    positions_recorded: int
    x_range_mm: Range
    depth_range_mm: Range
    offset_range_mm: Range | None
    frame_text: str
    rows: list[PlaceRowJson]


class PlaceRange(NamedTuple):
    """Range of the receptor location: x, depth below the skin, and offset of the field center (mm)."""

    x_mm: Range
    depth_mm: Range
    offset_mm: Range = (0.0, 0.0)

    @property
    def free(self) -> int:
        """Number of fitted coordinates."""
        return sum(low < high for low, high in self)

    @property
    def x_nodes(self) -> Array:
        """Nodes in x (nx,), mm."""
        return nodes(self.x_mm, X_STEP_MM)

    @property
    def depth_nodes(self) -> Array:
        """Nodes in depth (nd,), mm."""
        return nodes(self.depth_mm, DEPTH_STEP_MM)


def place_range(x_mm: Range, depth_mm: Range | None, offset_mm: Range | None, config: FingertipConfig) -> PlaceRange:
    """Return the requested range, by default below the epidermis of this finger; raise ComparisonError if invalid."""
    skin = config.tissue.epidermis_mm
    depth = depth_mm or (skin + BELOW_EPIDERMIS_MM[0], skin + BELOW_EPIDERMIS_MM[1])
    _refuse("--depth-range-mm", depth)
    _refuse("--offset-mm", offset_mm or (0.0, 1.0))
    if not x_mm[0] < x_mm[1]:
        raise ComparisonError(
            "--place requires receptors at two or more x, the ends of the search; set --receptor-x-mm",
            "one_receptor_x",
        )
    if depth[0] < skin < depth[1]:
        raise ComparisonError(
            f"--depth-range-mm {depth[0]:g},{depth[1]:g}: the range must not cross the end of the epidermis at "
            f"{skin:g} mm, where strains jump",
            "across_epidermis",
        )
    return PlaceRange(x_mm, depth, offset_mm or (0.0, 0.0))


def _refuse(option: str, requested: Range) -> None:
    if not (all(map(math.isfinite, requested)) and requested[0] < requested[1]):
        raise ComparisonError(
            f"{option} {requested[0]:g},{requested[1]:g}: must be two numbers in mm, the lower one first",
            "not_ascending",
        )


def nodes(requested: Range, step: float) -> Array:
    """Return equally spaced nodes from end to end, with a spacing of at most `step`."""
    low, high = requested
    return np.linspace(low, high, math.ceil((high - low) / step - 1e-9) + 1)


def finger_with_grid(config: FingertipConfig, where: PlaceRange) -> Fingertip:
    """Return the finger with receptors at every node; x varies fastest."""
    return Fingertip.load(
        config,
        receptor_x_mm=where.x_nodes.round(6).tolist(),
        receptor_depth_mm=where.depth_nodes.round(6).tolist(),
    )


def spline_weights(at_nodes: Array, at: Array) -> Array:
    """Return (…, n) weights of a cubic spline through values at nodes (n,), for locations (…,)."""
    if len(at_nodes) == 1:
        return np.ones((*np.shape(at), 1))
    return np.asarray(_cardinal(tuple(at_nodes.tolist()))(at))


@lru_cache(maxsize=8)
def _cardinal(at_nodes: tuple[float, ...]) -> "BSpline":
    """Return the splines that are 1 at one node and 0 at the others."""
    from scipy.interpolate import make_interp_spline  # slow to import, and most comparisons do not need it

    return make_interp_spline(np.array(at_nodes), np.eye(len(at_nodes)), k=min(3, len(at_nodes) - 1))


@dataclass(frozen=True)
class PlaceRow:
    """Measure at its maximum-likelihood location (mm), with 95 % intervals; `at_bounds` are range ends inside one."""

    measure: str
    x_mm: float
    depth_mm: float
    offset_mm: float
    x_interval: Range
    depth_interval: Range
    offset_interval: Range
    k: float
    eps0: float
    deviance: float
    lack_of_fit: float
    p_fit: float
    at_bounds: tuple[str, ...]

    @property
    def fits(self) -> bool:
        """Whether the fit is not rejected."""
        return self.p_fit >= LEVEL


@dataclass(frozen=True)
class ReceptorLocation:
    """Receptor location of one afferent, the `requested` range, and the part of it that the runs cover (`where`).

    `rows` has every measure, best first, all over the same `positions` of those `recorded`.
    """

    stimuli: tuple[str, ...]
    recordings: tuple[str, ...]
    positions: int
    recorded: int
    requested: PlaceRange
    where: PlaceRange
    rows: tuple[PlaceRow, ...]

    @property
    def with_offset(self) -> bool:
        """Whether an offset of the field's center was fitted."""
        return self.requested.offset_mm[0] < self.requested.offset_mm[1]

    @property
    def frame(self) -> str:
        """Treatment of the offset; shown with every table of rows."""
        if not self.with_offset:
            return "indentor x = recorded position + receptor x, no offset fitted"
        low, high = map(in_mm, self.requested.offset_mm)
        return f"indentor x = recorded position + receptor x + offset, fitted between {low} and {high} mm"


def in_mm(x: float) -> str:
    """Format a number, e.g. "−1.25"."""
    return f"{x + 0.0:.2f}".replace("-", "−")


def place_lines(found: Sequence[ReceptorLocation], most: int = 3) -> list[str]:
    """Return lines for the terminal: the best measures that fit each afferent, or the closest one."""
    return [line for one in found for line in _lines(one, most)]


def _lines(found: ReceptorLocation, most: int) -> list[str]:
    fitting = [row for row in found.rows if row.fits][:most]
    rows = fitting or list(found.rows[:1])
    return [f"{_line(row, found)}{'' if row.fits else '; the fit is rejected'}" for row in rows] + [found.frame]


def _line(row: PlaceRow, found: ReceptorLocation) -> str:
    line = f"{row.measure}: x {within(row.x_mm, row.x_interval)}, depth {within(row.depth_mm, row.depth_interval)}"
    line += f", offset {within(row.offset_mm, row.offset_interval)}" if found.with_offset else ""
    return f"{line} mm" + (f"; at a limit of the search: {', '.join(row.at_bounds)}" if row.at_bounds else "")


def within(value: float, interval: Range) -> str:
    """Format a value with its interval, e.g. "−0.98 (−1.10 … −0.85)"."""
    return f"{in_mm(value)} ({in_mm(interval[0])} … {in_mm(interval[1])})"


def places_as_json(found: Sequence[ReceptorLocation]) -> list[PlaceJson]:
    """Return a JSON object per afferent; intervals are [low, high] in mm, None for an offset that was not fitted."""
    return [
        {
            "stimuli": list(one.stimuli),
            "recordings": list(one.recordings),
            "positions": one.positions,
            "positions_recorded": one.recorded,
            "x_range_mm": one.where.x_mm,
            "depth_range_mm": one.where.depth_mm,
            "offset_range_mm": one.requested.offset_mm if one.with_offset else None,
            "frame_text": one.frame,
            "rows": [_as_json(row, with_offset=one.with_offset) for row in one.rows],
        }
        for one in found
    ]


def _interval(of: Range) -> Interval:
    low, high = of
    return six_digits(low), six_digits(high)


def _as_json(row: PlaceRow, *, with_offset: bool) -> PlaceRowJson:
    return {
        "measure": row.measure,
        "unit": BY_NAME[row.measure].unit,
        "x_mm": six_digits(row.x_mm),
        "depth_mm": six_digits(row.depth_mm),
        "offset_mm": six_digits(row.offset_mm),
        "k": six_digits(row.k),
        "eps0": six_digits(row.eps0),
        "deviance": six_digits(row.deviance),
        "lack_of_fit": six_digits(row.lack_of_fit),
        "p_fit": six_digits(row.p_fit),
        "x_interval_mm": _interval(row.x_interval),
        "depth_interval_mm": _interval(row.depth_interval),
        "offset_interval_mm": _interval(row.offset_interval) if with_offset else None,
        "fits": row.fits,
        "at_bounds": list(row.at_bounds),
    }
