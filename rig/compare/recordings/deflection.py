"""Deflection of the skin beside an indentor: measured, simulated, and compared.

Measured deflections are a CSV with the columns `deflection_mm` (downward displacement) and `x_mm`, `z_mm` or both
(location on the undeformed skin), in any order. x is lateral, 0 at the center of the pad; z runs along the finger
from the proximal edge. Without x, the points lie on the center line of the pad; without z, in the receptor plane.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.table import LEAVE_EMPTY, Row, column_list, no_rows, read_table
from rig.compare.recordings.totals import refuse_summary_rows
from rig_shared.outputs import Output
from sim.contact.patch import Z
from sim.models.result import IndentationResult

Array = NDArray[np.float64]

_COLUMNS = ("x_mm", "z_mm")
_CENTRE_MM, PROXIMAL_MM = 0.0, 0.0


@dataclass(frozen=True)
class SkinDeflection:
    """Measured downward displacements (n,) at undeformed locations (n,), in mm; NaN in z: receptor plane.

    `doi_mm` (n,) is the depth of the indentation, NaN if the file states none.
    """

    x_mm: Array
    z_mm: Array
    deflection_mm: Array
    doi_mm: Array


ANYWHERE = (("deflection_mm",), _COLUMNS)
ALONG_BY_DEPTH = (("z_mm", "deflection_mm"), ("doi_mm",))
"""Required and optional columns: of points anywhere under one press, and along the finger under presses by depth."""


def read_skin_deflection(path: Path, columns: tuple[tuple[str, ...], tuple[str, ...]] = ANYWHERE) -> SkinDeflection:
    """Read a measured deflection. Raises RecordingError with row and column."""
    rows = read_table(path, *columns)
    if not rows:
        raise no_rows(path, column_list(*columns))
    given = [name for name in _COLUMNS if name in rows[0].cells]
    if not given:
        raise RecordingError(f"{path}, row 1: must have a column x_mm, z_mm, or both", "no_place")
    usual = {"x_mm": _CENTRE_MM, "z_mm": np.nan}
    places = {
        name: np.array([row.number(name, least) if name in given else usual[name] for row in rows])
        for name, least in zip(_COLUMNS, (-np.inf, PROXIMAL_MM), strict=True)
    }
    doi_mm = np.array([row.number("doi_mm", 0.0, no_data=LEAVE_EMPTY) if row.cells.get("doi_mm") else np.nan
                       for row in rows])  # fmt: skip
    refuse_summary_rows(rows, "deflection_mm", given, "point", "doi_mm")
    return SkinDeflection(**places, deflection_mm=_downward_mm(path, rows), doi_mm=doi_mm)


def _downward_mm(path: Path, rows: Sequence[Row]) -> Array:
    """Return the downward displacements (n,) of a table in mm. Raises RecordingError if none is downward."""
    down = np.array([row.number("deflection_mm") for row in rows])
    if down.max() <= 0 and down.min() < 0:
        raise RecordingError(
            f"{path}, column deflection_mm: no value is above 0, and downward is positive; change the signs if "
            "downward is negative, or add a point that moves downward",
            "none_downward",
        )
    return down


def deflection_at(result: IndentationResult, x_mm: Array, z_mm: Array) -> Array:
    """Return the simulated downward displacement (n,) of the skin at undeformed locations (n,), in mm.

    NaN beside the patch. Linear between nodes, first along a row across the finger, then along the finger. A section
    has one row, which applies at every z.
    """
    patch = result.model.patch
    x, down = (values.reshape(patch.shape) for values in (patch.x, -result.state.displacement[-1]))
    order = np.argsort(x, axis=1)
    x, down = (np.take_along_axis(values, order, axis=1) for values in (x, down))
    across = np.array([np.interp(x_mm, *row, left=np.nan, right=np.nan) for row in zip(x, down, strict=True)])
    if len(across) == 1:
        return np.asarray(across[0])
    return _between_rows(across, patch.position_mm[:: patch.shape[1], Z], z_mm)


def _between_rows(values: Array, rows_mm: Array, z_mm: Array) -> Array:
    """Interpolate values (rows, n) linearly between rows, which may be unsorted, at z (n,); NaN beyond the outer
    rows.
    """
    order = np.argsort(rows_mm)
    values, rows_mm = values[order], rows_mm[order]
    low = np.clip(np.searchsorted(rows_mm, z_mm, side="right") - 1, 0, len(rows_mm) - 2)
    part = (z_mm - rows_mm[low]) / (rows_mm[low + 1] - rows_mm[low])
    at = np.arange(len(z_mm))
    between = values[low, at] * (1 - part) + values[low + 1, at] * part
    return np.where((part >= 0) & (part <= 1), between, np.nan)


class DeflectionJson(Output):
    """Measured skin deflection beside the model's."""

    points: int
    beside_the_patch: int
    mean_mm: float | None
    rms_mm: float | None
    x_mm: list[float]
    z_mm: list[float]
    measured_mm: list[float]
    model_mm: list[float | None]


def compared_deflection(result: IndentationResult, measured: SkinDeflection) -> DeflectionJson:
    """Return measured and simulated deflections at each location, and statistics of measured − model on the patch.

    The statistics are null if no location lies on the patch."""
    z_mm = np.where(np.isnan(measured.z_mm), result.model.plane_mm, measured.z_mm)
    model = deflection_at(result, measured.x_mm, z_mm)
    left = (measured.deflection_mm - model)[~np.isnan(model)]
    return {
        "points": len(model),
        "beside_the_patch": int(np.isnan(model).sum()),
        "mean_mm": float(left.mean()) if len(left) else None,
        "rms_mm": float(np.sqrt(np.mean(left**2))) if len(left) else None,
        "x_mm": measured.x_mm.tolist(),
        "z_mm": z_mm.tolist(),
        "measured_mm": measured.deflection_mm.tolist(),
        "model_mm": [None if np.isnan(value) else float(value) for value in model],
    }


def in_words(found: DeflectionJson) -> str:
    """Return the comparison as a line for the terminal."""
    on = found["points"] - found["beside_the_patch"]
    if not on:
        return f"none of {found['points']} measured points lies on the model's patch"
    beside = f"; {found['beside_the_patch']} beside the patch" if found["beside_the_patch"] else ""
    return f"measured − model {found['mean_mm']:+.3f} mm mean, {found['rms_mm']:.3f} mm rms, {on} points{beside}"
