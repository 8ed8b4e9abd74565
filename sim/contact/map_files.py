"""Height maps from files: a picture, a table of numbers, or points.

A table or picture shows the indentor's face with the finger's tip up: columns along x, the first row nearest the
tip. Its middle is the reference point.
"""

import struct
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig_shared.number_text import read_number
from rig_shared.summary_rows import last_digit, summary_row
from rig_shared.user_files import lines_of, open_file
from sim.contact.height_map import (
    LEAST_POINTS,
    MOST_POINTS,
    HeightMap,
    HeightMapError,
    away_from_skin,
    refuse_far,
    refuse_uneven,
)

Array = NDArray[np.float64]

COLUMNS = "x_mm,z_mm,height_mm"
PICTURE_EDGE_MM = 0.05
"""Radius of the edges in a picture (mm), that of a bar's edge. [free]"""

LEAST_EDGE_SPACINGS = 0.7
"""Smallest edge radius relative to the spacing; below it the spline overshoots by more than 1 % of the relief."""

MOST_BYTES = 100_000_000
"""Largest file of numbers: each of a million points with three long ones."""

_MOST_TINT = 2  # largest difference between the red, green and blue of a gray, of 255: its rounding
_LEAST_GRAYS = 0.5  # of black to white: 8, 12 and 14 bits in a file of 16 have less
RAISED_IN_PICTURES = ("dark", "light")
_OPTIONS = {"width_mm": (0.1, 30.0), "height_mm": (0.01, 5.0), "spacing_mm": (0.001, 2.0), "edge_mm": (0.0, 2.0)}


def read_height_map(file: str, options: Sequence[str]) -> HeightMap:
    """Read a map from FILE.png, FILE.npy or FILE.csv with options "key=value". Raises HeightMapError."""
    where = f"heightmap {file}"
    settings = _parse_options(where, options)
    readers: dict[str, Callable[[str, str, Mapping[str, str]], tuple[Array, Array, Array]]]
    readers = {".png": _picture, ".npy": _array, ".csv": _table}
    suffix = Path(file).suffix.lower()
    if suffix not in readers:
        raise HeightMapError(f"{where}: must be a file named .png, .npy or .csv", "unknown_suffix")
    x, z, height = readers[suffix](where, file, settings)
    if min(height.shape) > 1:
        for axis, positions in (("x", x), ("z", z)):
            refuse_uneven(where, axis, positions)
        refuse_far(where, "height", height)
        if suffix != ".png":
            height = height * away_from_skin(where, settings.get("raised", ""), "raised={}")
        from scipy.ndimage import gaussian_filter  # slow to import, and few scenes have a map

        spacing = x[1] - x[0], z[1] - z[0]
        edge_mm = _edge_mm(where, settings, LEAST_EDGE_SPACINGS * max(spacing), picture=suffix == ".png")
        height = gaussian_filter(height, (edge_mm / spacing[1], edge_mm / spacing[0]), mode="nearest")
    name = ",".join([f"heightmap:{file}", *(f"{key}={_plain(value)}" for key, value in settings.items())])
    try:
        return HeightMap.from_arrays(x, z, height, raised="low", name=name)
    except HeightMapError as error:
        raise HeightMapError(where + str(error).removeprefix(name), error.code) from None


def raised_in_words(file: str, options: str) -> str:
    """Return which side of a height map is up, by its file's name and its options."""
    raised = dict(option.partition("=")[::2] for option in options.split(",")).get("raised", "")
    if file.lower().endswith(".png"):
        return f"{raised or RAISED_IN_PICTURES[0]} is raised"
    return {"high": "the highest touches first", "low": "the lowest touches first"}.get(raised, "")


def grays_in_words(file: str) -> str:
    """Return the range of gray in a picture. Raises HeightMapError."""
    levels, white = _gray_levels(f"heightmap {file}", file)
    return f"gray levels {levels.min()} to {levels.max()} of {white}"


def _edge_mm(where: str, settings: Mapping[str, str], least_mm: float, *, picture: bool) -> float:
    """Return the standard deviation of the Gaussian that rounds edges (mm); 0 keeps them."""
    if "edge_mm" not in settings:
        return max(PICTURE_EDGE_MM, least_mm) if picture else 0.0
    edge_mm = _number(where, settings, "edge_mm")
    if 0 < edge_mm < (1 - 1e-9) * least_mm:
        raise HeightMapError(
            f"{where}: edge_mm={edge_mm:g}: must be 0, or at least {float(least_mm):.3g} mm for this spacing",
            "edge_too_small",
        )
    return edge_mm


def _parse_options(where: str, options: Sequence[str]) -> dict[str, str]:
    settings: dict[str, str] = {}
    for option in options:
        key, _, value = option.partition("=")
        if key in settings or key not in (*_OPTIONS, "raised"):
            raise HeightMapError(
                f"{where}: the option {option} is unknown or repeated; use {', '.join(_OPTIONS)} or raised, each "
                "once",
                "unknown_option",
            )
        settings[key] = value
    return settings


def _plain(value: str) -> str:
    try:
        return f"{float(value):g}"
    except ValueError:
        return value


def _number(where: str, settings: Mapping[str, str], key: str) -> float:
    low, high = _OPTIONS[key]
    try:
        value = read_number(settings[key])
    except ValueError:
        value = float("nan")
    if not low <= value <= high:
        raise HeightMapError(f"{where}: {key}={settings[key]}: must be {low:g} to {high:g} mm", "option_out_of_range")
    return value


def _required(
    where: str, settings: Mapping[str, str], needed: Sequence[str], allowed: Sequence[str] = ()
) -> list[float]:
    """Return the values of the required options; raise HeightMapError for options that do not apply."""
    for key in needed:
        if key not in settings:
            raise HeightMapError(f"{where} requires {key}=…; add it", "option_missing")
    for key in settings:
        if key not in (*needed, *allowed, "edge_mm"):
            takes = ", ".join([*needed, *allowed, "edge_mm"])
            raise HeightMapError(
                f"{where}: {key} does not apply to this type of file; use {takes}", "option_of_no_use"
            )
    return [_number(where, settings, key) for key in needed]


def _picture(where: str, file: str, settings: Mapping[str, str]) -> tuple[Array, Array, Array]:
    """Read a picture; dark is raised by `height_mm` unless `raised=light`."""
    width_mm, height_mm = _required(where, settings, ("width_mm", "height_mm"), ("raised",))
    raised = settings.get("raised", RAISED_IN_PICTURES[0])
    if raised not in RAISED_IN_PICTURES:
        raise HeightMapError(f"{where}: raised={raised}: must be {' or '.join(RAISED_IN_PICTURES)}", "unknown_raised")
    levels, white = _gray_levels(where, file)
    low, high = int(levels.min()), int(levels.max())
    if high - low < _LEAST_GRAYS * white:
        raise HeightMapError(
            f"{where}: has gray levels {low} to {high} of {white}; height_mm={height_mm:g} is from black to white, "
            f"so its relief would be {height_mm * (high - low) / white:.2g} mm; stretch the levels from black to "
            "white, or give the heights as numbers (.npy, .csv)",
            "few_grays",
        )
    away = levels if raised == "dark" else white - levels
    return _centered(np.asarray(height_mm / white * away, dtype=np.float64), width_mm / levels.shape[1])


def _gray_levels(where: str, file: str) -> tuple[NDArray[np.int64], int]:
    """Return the (rows, columns) gray levels of a picture from 0, black, and that of white.

    Transparent pixels are white. Raises HeightMapError, also for colors.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with (
            warnings.catch_warnings(action="ignore"),  # of a size that is checked below, and of animations
            open_file(file) as stream,
            Image.open(stream, formats=["PNG"]) as image,
        ):
            if image.width * image.height > MOST_POINTS:
                raise HeightMapError(
                    f"{where}: {image.width} × {image.height} pixels; at most {MOST_POINTS} in all are allowed",
                    "too_many_pixels",
                )
            if image.mode.startswith("I"):  # 16 bits
                return np.asarray(image, dtype=np.int64), 65535
            whole = image.convert("RGBA")
            white = Image.new("RGBA", whole.size, "white")
            opaque = Image.alpha_composite(white, whole).convert("RGB")
            colors = np.asarray(opaque, dtype=np.int64)
            if (np.ptp(colors, axis=2) > _MOST_TINT).any():
                raise HeightMapError(
                    f"{where}: the picture is colored, and height is read from gray; save the heights in gray "
                    "levels, or as numbers (.npy, .csv)",
                    "colored",
                )
            return np.asarray(opaque.convert("L"), dtype=np.int64), 255
    except OSError as error:
        what = "not a picture" if isinstance(error, UnidentifiedImageError) else error.strerror or "damaged"
        raise _no_picture(where, what) from None
    except (SyntaxError, ValueError, LookupError, struct.error, Image.DecompressionBombError) as error:
        if isinstance(error, HeightMapError):
            raise
        raise _no_picture(where, str(error)) from None


def _no_picture(where: str, problem: str) -> HeightMapError:
    return HeightMapError(f"{where}: {problem}; must be a PNG file", "no_picture")


def _array(where: str, file: str, settings: Mapping[str, str]) -> tuple[Array, Array, Array]:
    (spacing_mm,) = _required(where, settings, ("spacing_mm",), ("raised",))
    try:
        open_file(file).close()  # for its checks
        height = np.load(file, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # NumPy raises whatever the text of a wrong header leads to
        what = getattr(error, "strerror", None) or "not an array"
        raise HeightMapError(f"{where}: {what}; must be a NumPy file of numbers", "no_array") from None
    if not isinstance(height, np.ndarray) or height.ndim != 2 or height.dtype.kind not in "iuf":
        raise HeightMapError(f"{where}: must contain numbers in rows and columns, heights in mm", "no_heights")
    if height.size > MOST_POINTS:
        raise HeightMapError(
            f"{where}: {height.size} points; at most {MOST_POINTS} in all are allowed", "too_many_heights"
        )
    return _of_numbers(where, np.array(height, dtype=np.float64), spacing_mm)


_SEPARATE = "; separate the numbers by commas, and write decimal points"


def _is_separated_otherwise(line: str) -> bool:
    return ";" in line or "\t" in line


_SHOWN = 60  # characters of a wrong header


def _table(where: str, file: str, settings: Mapping[str, str]) -> tuple[Array, Array, Array]:
    """Read points under a header, or rows of heights at a spacing."""
    try:
        lines = [line.strip() for line in lines_of(file, most=MOST_BYTES)]
    except (OSError, UnicodeDecodeError) as error:
        what = getattr(error, "strerror", None) or "not text"
        raise HeightMapError(f"{where}: {what}; must be a CSV file", "no_text") from None
    points = bool(lines) and lines[0].replace(" ", "") == COLUMNS
    if not points and "spacing_mm" not in settings:
        read = lines[0][:_SHOWN] if lines else "nothing"
        hint = _SEPARATE if lines and _is_separated_otherwise(lines[0]) else ""
        raise HeightMapError(
            f"{where}: must have the columns {COLUMNS}, or rows of heights and spacing_mm=…; read {read}{hint}",
            "no_columns",
        )
    if sum(line.count(",") + 1 for line in lines) > 3 * MOST_POINTS + 3:
        raise _too_many(where)
    rows = [_numbers(where, n, line) for n, line in enumerate(lines, 1) if line and not (points and n == 1)]
    if sum(map(len, rows)) > (3 if points else 1) * MOST_POINTS:
        raise _too_many(where)
    for n, row in enumerate(rows):
        if len(row) != (3 if points else len(rows[0])):
            expected = 3 if points else len(rows[0])
            raise HeightMapError(
                f"{where}, row {n + 1} of numbers: {len(row)} numbers; must be {expected}", "map_row_length"
            )
    if points:
        _required(where, settings, (), ("raised",))
        return _gridded(where, np.array(rows).reshape(-1, 3))
    (spacing_mm,) = _required(where, settings, ("spacing_mm",), ("raised",))
    return _of_numbers(where, np.array(rows).reshape(len(rows), len(rows[0]) if rows else 0), spacing_mm)


def _of_numbers(where: str, rows: Array, spacing_mm: float) -> tuple[Array, Array, Array]:
    if (np.abs(rows) < 1e9).all():  # Others are refused as heights.
        _refuse_axes_and_summaries(where, rows, spacing_mm)
    return _centered(rows, spacing_mm)


def _too_many(where: str) -> HeightMapError:
    return HeightMapError(f"{where}: more than {MOST_POINTS} points; use a coarser map", "too_many_numbers")


def _numbers(where: str, line: int, text: str) -> list[float]:
    values = []
    for cell in text.split(","):
        try:
            values.append(read_number(cell))
        except ValueError:
            hint = _SEPARATE if _is_separated_otherwise(text) else ""
            raise HeightMapError(
                f"{where}, line {line}: {cell.strip()!r} must be a number{hint}", "no_number"
            ) from None
    return values


def _gridded(where: str, points: Array) -> tuple[Array, Array, Array]:
    """Sort points into a grid, one for every location."""
    if not np.isfinite(points[:, :2]).all():
        raise HeightMapError(f"{where}: every x_mm and z_mm must be a number", "no_place")
    (x, i), (z, k) = (np.unique(points[:, axis], return_inverse=True) for axis in (0, 1))
    there, first, count = np.unique(k * len(x) + i, return_index=True, return_counts=True)  # row by row
    overhangs, holes = np.flatnonzero(count > 1), len(z) * len(x) - len(there)
    _refuse_location(where, "overhang", "more than one height (an overhang)", there[overhangs], len(overhangs), x, z)
    missing = np.flatnonzero(there != np.arange(len(there)))[:1] if holes else there[:0]
    _refuse_location(where, "hole", "a hole: no height", missing if len(missing) else there[-1:] + 1, holes, x, z)
    return x, z, points[first, 2].reshape(len(z), len(x))


def _refuse_location(
    where: str, code: str, what: str, locations: NDArray[np.int64], places: int, x: Array, z: Array
) -> None:
    """Raise HeightMapError for locations of a grid, which count row by row; do nothing for no place."""
    if places:
        row, column = divmod(int(locations[0]), len(x))
        raise HeightMapError(
            f"{where}: {what} at x = {float(x[column]):g}, z = {float(z[row]):g} mm ({places} locations); each "
            f"location of the {len(x)} × {len(z)} grid must have exactly one height",
            code,
        )


_LEAST_AXIS = 0.1  # slope of an axis among heights: positions in cm beside a spacing in mm
_EVEN = 1e-3  # of the step
_UNLIKE = 0.5  # of the axis's span: how unevenly the next row lies below it
_BROKEN, _BROKEN_DIGITS = 0.1, 8  # of the relief, and last digits: how far a row lies from a surface that ends before
_SIDES = {"first row": (0, 1), "last row": (0, -1), "first column": (1, 1), "last column": (1, -1)}


def _refuse_axes_and_summaries(where: str, rows: Array, spacing_mm: float) -> None:
    """Raise HeightMapError for a row or column at the rim that has positions, or sums up the others."""
    for side, (axis, order) in _SIDES.items():
        table = (rows.T if axis else rows)[::order]
        if min(table.shape) > LEAST_POINTS and _is_axis(table[0, 1:], table[1, 1:], spacing_mm):
            step = float(table[0, 2] - table[0, 1])
            raise HeightMapError(
                f"{where}: the {side} changes by even steps of {step:.4g}, as an axis does, and unlike the one "
                f"beside it; delete it, or give the columns {COLUMNS}",
                "axis_among_heights",
            )
    for axis, name in enumerate(("row", "column")):
        table = rows.T if axis else rows
        found = summary_row(table)
        if found is None or not found.sure:
            continue
        k, what = found.row, found.word
        others = np.delete(table, k, axis=0)
        if not (others == table[k]).any(axis=0).all() and not _continues(table, k):
            raise HeightMapError(
                f"{where}: {name} {k + 1} of heights has the {what} of the other {name}s; delete it",
                "summary_among_heights",
            )


def _is_axis(line: Array, beside: Array, spacing_mm: float) -> bool:
    """Return whether numbers rise or fall by even steps, unlike those beside them."""
    steps = np.diff(line)
    step = float(steps.mean())
    even = np.abs(steps - step).max() <= _EVEN * abs(step)
    return bool(even and abs(step) >= _LEAST_AXIS * spacing_mm and np.ptp(beside - line) > _UNLIKE * np.ptp(line))


def _continues(rows: Array, k: int) -> bool:
    """Return whether a row near an end continues the surface of the rows towards the middle, by a quadratic.

    Rows of a smooth surface differ by little more than one number, and one of them may well equal their mean.
    """
    inward = 1 if k < len(rows) / 2 else -1
    first, second, third = (rows[k + inward * n] for n in (1, 2, 3))
    broken_mm = max(_BROKEN * np.ptp(rows[2:-2]), _BROKEN_DIGITS * last_digit(rows).min())
    return bool(np.abs(rows[k] - (3 * first - 3 * second + third)).max() < broken_mm)


def _centered(rows: Array, spacing_mm: float) -> tuple[Array, Array, Array]:
    """Center rows of heights, the first nearest the tip."""
    x, z = (spacing_mm * (np.arange(n) - 0.5 * (n - 1)) for n in (rows.shape[1], rows.shape[0]))
    return x, z, rows[::-1]
