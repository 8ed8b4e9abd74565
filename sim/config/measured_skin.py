"""What a user measured of a finger's skin: points of the pulp or a table of sections, and whether it will do."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.config.csv_table import Row, read_columns

Array = NDArray[np.float64]

POINT_COLUMNS = ("x_mm", "y_mm", "z_mm")
SECTION_COLUMNS = ("z_mm", "half_width_mm", "height_mm", "lean_mm")

FEWEST_POINTS = 12
MOST_POINTS = 10_000
FEWEST_SECTIONS = 5

_NARROWEST_MM, _WIDEST_MM = 2.0, 60.0
_LEAST_SPREAD = 0.5  # of the finger's length, along z; the published points span 0.58
_WIDEST_GAP = 0.25  # of the finger's length, along z; the published points leave 0.14
_LEAST_SIDE = 0.05  # of the finger's length, to either side of x = 0


def rows_from(value: object, columns: Sequence[str], folder: Path) -> object:
    """The rows of the CSV file that a path names, relative to the folder; what is no path is left as it is."""
    return read_columns(folder / value, columns) if isinstance(value, str) else value


def check_points(points: Sequence[Row], length_mm: float) -> None:
    """Raise ValueError, saying what is missing, when (x, y, z) rows in mm cannot hold the pulp of a finger."""
    if not FEWEST_POINTS <= len(points) <= MOST_POINTS:
        raise ValueError(f"{len(points)} points, expected {FEWEST_POINTS} to {MOST_POINTS}")
    xyz = np.array(points)
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    spans = " × ".join(f"{span:.3g}" for span in high - low)
    if not _NARROWEST_MM <= (high - low).max() <= _WIDEST_MM:
        raise ValueError(f"the points span {spans}: expected millimetres, {_NARROWEST_MM:g} to {_WIDEST_MM:g}")
    if low[2] < 0 or high[2] > length_mm:
        raise ValueError(
            f"z {low[2]:.2f} … {high[2]:.2f} mm: expected z from 0, the proximal edge, to length_mm = {length_mm:g}"
        )
    z = np.sort(xyz[:, 2])
    if z[-1] - z[0] < _LEAST_SPREAD * length_mm:
        raise ValueError(
            f"z {z[0]:.2f} … {z[-1]:.2f} mm: expected points over {_LEAST_SPREAD * length_mm:.2f} mm of z or more, "
            f"half of length_mm = {length_mm:g}"
        )
    gap = int(np.argmax(np.diff(z)))
    if z[gap + 1] - z[gap] > _WIDEST_GAP * length_mm:
        raise ValueError(
            f"no points from z = {z[gap]:.2f} to {z[gap + 1]:.2f} mm: expected gaps of at most "
            f"{_WIDEST_GAP * length_mm:.2f} mm, a quarter of length_mm = {length_mm:g}"
        )
    side = _LEAST_SIDE * length_mm
    if low[0] > -side or high[0] < side:
        raise ValueError(
            f"x {low[0]:.2f} … {high[0]:.2f} mm: expected points on both sides of the midline x = 0, "
            f"{side:.2f} mm from it or more"
        )
    if high[1] < _NARROWEST_MM / 2:
        raise ValueError(f"highest y = {high[1]:.2f} mm: expected y upwards from the bone's axis to the pulp's skin")


def check_sections(sections: Sequence[Row], length_mm: float) -> None:
    """Raise ValueError when (z, half-width, height, lean) rows in mm are no finger from 0 to its length."""
    if len(sections) < FEWEST_SECTIONS:
        raise ValueError(f"{len(sections)} sections, expected at least {FEWEST_SECTIONS}")
    z, half_width, height, _ = np.array(sections).T
    back = np.flatnonzero(np.diff(z) <= 0)
    if len(back):
        raise ValueError(f"z_mm = {z[back[0] + 1]:g} after {z[back[0]]:g}: expected z_mm to rise from row to row")
    if z[-1] < _NARROWEST_MM:
        raise ValueError(f"z_mm ends at {z[-1]:g}: expected millimetres")
    if abs(z[0]) > 1e-6 * length_mm or abs(z[-1] - length_mm) > 1e-6 * length_mm:
        raise ValueError(
            f"z_mm {z[0]:g} … {z[-1]:g}: expected z = 0, the proximal edge, to length_mm = {length_mm:g}"
        )
    for name, values in (("half_width_mm", half_width), ("height_mm", height)):
        if (values <= 0).any():
            k = int(np.argmax(values <= 0))
            raise ValueError(f"{name} = {values[k]:g} at z_mm = {z[k]:g}: expected more than 0")
