"""Indentors by their names on the command line."""

import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from rig_shared.number_text import read_number
from rig_shared.user_files import sha256_of
from sim.contact.height_map import HeightMap, HeightMapError
from sim.contact.indentor import ACROSS, MOST_TURN_DEG, Indentor, Prismatic, Revolved
from sim.contact.map_files import grays_in_words, raised_in_words, read_height_map
from sim.contact.measured_profile import LINEAR, MeasuredProfile, ProfileError, read_profile
from sim.contact.profiles import STEP_HALF_WAVELENGTH_MM, Bar, Cylinder, Grating, Plane, SinusoidalStep, Wedge
from sim.errors import ArgumentError, SimError

EXPECTED = (
    "bar:WIDTH, cylinder:DIAMETER, step:1|3|5, grating:RIDGE,PITCH, wedge:ANGLE, profile:FILE.csv[,linear], "
    "sphere:RADIUS, flat:RADIUS, cone:ANGLE, flat, line or heightmap:FILE,…; round ones also as r=RADIUS or "
    "d=DIAMETER, ones along the finger also with ,across or ,turn_deg=ANGLE"
)
LINE_THICKNESS_MM = 0.2
"""Thickness of the plate whose rounded edge is the line load (mm). [free]"""

_OPTION = r",linear|,(?:width_mm|height_mm|spacing_mm|edge_mm|raised)=[^,]*"
_MEASURED = re.compile(r"(cylinder|sphere|flat):([rd])=([^,]*)(.*)", re.DOTALL)
_TURN = re.compile(rf"(.*?),(?:across|turn_deg=([^,]*))((?:{_OPTION})*)", re.DOTALL)
_FILE = re.compile(rf"(profile|heightmap):(.*?)((?:,across|,turn_deg=[^,]*|{_OPTION})*)", re.DOTALL)


class ShapeError(SimError, ValueError):
    """Error of a shape whose name is unknown, or whose dimension is out of range."""

    default_code = "bad_shape"


def parse_shape(text: str) -> Indentor:
    """Return the indentor with a name as on the command line.

    Parameters
    ----------
    text : str
        For example ``"bar:3.0"``, ``"cylinder:9"`` or ``"wedge:45,across"``; dimensions in mm, angles in degrees
        (`docs/shapes.md` has all shapes).

    Returns
    -------
    Indentor
        The indentor.

    Raises
    ------
    ShapeError
        If there is no such shape, a dimension is out of range, or a file cannot be read.

    Notes
    -----
    The profiles of bars, cylinders and steps follow Raju (1998, ch. 4); `docs/contact.md` lists the free numbers.

    Examples
    --------
    >>> from sim import parse_shape
    >>> parse_shape("bar:3.0").name, parse_shape("sphere:4").sharp
    ('bar:3', False)
    """
    kind, _, argument = text.partition(":")
    if kind == "point":
        raise ShapeError(f"shape {text!r}: a point load has no contact; choose {EXPECTED}", "point_load")
    turned = _TURN.fullmatch(text)
    if turned is not None:
        return _turned(text, turned[1] + turned[3], turned[2])
    if kind not in _KINDS:
        raise ShapeError(f"shape {text!r}: there is no such indentor; choose {EXPECTED}", "no_such")
    return _KINDS[kind](text, argument)


def shape_name(text: str) -> str:
    """Return the canonical name, "bar:3" for bar:3.0 and "sphere:1" for sphere:d=2, to compare shapes by.

    It reads no file that the shape names. Raises ShapeError.
    """
    if named_file(text) is not None:
        return text
    found = parse_shape(text)
    measured = _MEASURED.fullmatch(found.name)
    if measured is None:
        return found.name
    kind, by, number, rest = measured.groups()
    bare = "d" if kind == "cylinder" else "r"
    return f"{kind}:{float(number) * {'rd': 2.0, 'dr': 0.5}.get(by + bare, 1.0):g}{rest}"


def shape_filter(text: str) -> Callable[[str], bool]:
    """Return a test of names of shapes: whether they mean the same shape, or one of a kind such as "bar".

    Raises ShapeError.
    """
    if text in _KINDS:
        return lambda other: other.partition(":")[0] == text
    wanted = shape_name(text)
    return lambda other: _name_or_text(other) == wanted


def _name_or_text(text: str) -> str:
    try:
        return shape_name(text)
    except ShapeError:
        return text  # of a run of another version


def shape_size(text: str) -> str:
    """Return the size of a shape in words, with radius and width where it is round; empty where its name says all.

    Of a file: which side is up, and what was read from it. Raises ShapeError.
    """
    file = _FILE.fullmatch(text)
    if file is not None:
        up = "the lowest touches first" if file[1] == "profile" else raised_in_words(file[2], file[3])
        return ", ".join(filter(None, (up, _read_in_words(text))))
    match parse_shape(text):
        case Prismatic(profile=Cylinder(diameter_mm=wide)) | Revolved(profile=Cylinder(diameter_mm=wide)):
            return f"radius {wide / 2:g} mm, {wide:g} mm wide"
        case Revolved(profile=Bar(width_mm=wide)):
            return f"radius {wide / 2:g} mm, {wide:g} mm wide"
        case Prismatic(name=name, profile=Bar(width_mm=wide)) if name != "line":
            return f"{wide:g} mm wide"
    return ""


@lru_cache(maxsize=32)
def _read_in_words(text: str) -> str:
    """Return the size and relief of a shape from a file, and the grays of a picture; empty if it cannot be read."""
    file, turn = _FILE.fullmatch(text), _TURN.fullmatch(text)
    assert file is not None
    try:
        shape = parse_shape(text if turn is None else turn[1] + turn[3])
        grays = f": {grays_in_words(file[2])}" if file[2].lower().endswith(".png") else ""
    except (SimError, OSError):
        return ""  # of a run whose file is gone
    if isinstance(shape, HeightMap):
        wide_mm, long_mm, relief_mm = (float(np.ptp(one)) for one in (shape.x_mm, shape.z_mm, shape.height_mm))
        size = f"{len(shape.x_mm)} × {len(shape.z_mm)} points over {wide_mm:.3g} × {long_mm:.3g} mm"
    else:
        assert isinstance(shape, Prismatic)
        assert isinstance(shape.profile, MeasuredProfile)
        profile = shape.profile
        relief_mm = max(profile.height_mm)
        size = f"{len(profile.x_mm)} points, x {profile.x_mm[0]:g} to {profile.x_mm[-1]:g} mm"
    stated = re.search(r",height_mm=([^,]+)", text)
    of = f" of height_mm = {float(stated[1]):g} mm" if stated else ""
    return f"{size}, relief {relief_mm:.3g} mm{of}{grays}"


def with_size(text: str) -> str:
    """Return a shape's name, followed by its size where that adds something. Raises ShapeError."""
    size = shape_size(text)
    return f"{text} ({size})" if size else text


def named_file(text: str) -> str | None:
    """Return the file that a shape's name contains, or None."""
    found = _FILE.fullmatch(text)
    return found[2] if found else None


def contents(shapes: Iterable[str]) -> list[str]:
    """Return the SHA-256 of each file in the names of shapes, "missing" for a file that cannot be read."""
    return [_content(Path(file)) for file in map(named_file, shapes) if file is not None]


def _content(path: Path) -> str:
    try:
        return sha256_of(path)
    except OSError:
        return "missing"  # reading the shape reports it


def with_file(text: str, file: str) -> str:
    """Return the name of the same shape, read from another file."""
    found = _FILE.fullmatch(text)
    return f"{found[1]}:{file}{found[3]}" if found else text


def with_file_beside(folder: Path, text: str) -> str:
    """Return a shape with the file in its name beside the script or file that names it, else in the current folder.

    Raises ShapeError if it is in neither.
    """
    file = named_file(text)
    if file is None or Path(file).is_absolute():
        return text
    places = dict.fromkeys((folder.resolve(), Path.cwd()))
    for place in places:
        if (place / file).is_file():
            return with_file(text, str(place / file))
    raise ShapeError(
        f"shape {text!r}: there is no file {file} in {' or '.join(map(str, places))}", "shape_file_missing"
    )


def with_raised_side(text: str) -> str:
    """Return the name of a height map of numbers with the side that is raised: of earlier versions, the lowest."""
    found = _FILE.fullmatch(text)
    if found is None or found[1] != "heightmap" or found[2].lower().endswith(".png") or ",raised=" in found[3]:
        return text
    return f"{text},raised=low"


def _turned(text: str, shape: str, turn: str | None) -> Indentor:
    try:
        turn_deg = 90.0 if turn is None else read_number(turn)
    except ValueError:
        turn_deg = float("nan")
    if not abs(turn_deg) <= MOST_TURN_DEG:
        raise ShapeError(
            f"shape {text!r}: turn_deg = {turn}: must be an angle within ± {MOST_TURN_DEG:g} degrees",
            "turn_out_of_range",
        )
    try:
        return parse_shape(shape).turned(turn_deg)
    except ShapeError:
        raise
    except ArgumentError as error:
        raise ShapeError(f"shape {text!r}: {error}; remove across and turn_deg", error.code) from None


def _step(text: str, argument: str) -> Indentor:
    if argument not in STEP_HALF_WAVELENGTH_MM:
        raise ShapeError(f"shape {text!r}: must be step:1, step:3 or step:5", "no_such_step")
    return Indentor.along(SinusoidalStep(argument))


def _bar(text: str, argument: str) -> Indentor:
    return Indentor.along(Bar(_number(text, argument, "width", "mm", 0.2, 20.0)))


def _cylinder(text: str, argument: str) -> Indentor:
    found = Prismatic.along(Cylinder(2 * _radius_mm(text, argument, 0.25, 25.0, bare=0.5)))
    return replace(found, name=_as_written("cylinder", argument) or found.name)


def _wedge(text: str, argument: str) -> Indentor:
    return Indentor.along(Wedge(_number(text, argument, "half-angle", "degrees", 5.0, 89.0)))


def _grating(text: str, argument: str) -> Indentor:
    ridge, comma, pitch = argument.partition(",")
    if not comma:
        raise ShapeError(f"shape {text!r}: must be grating:RIDGE,PITCH in mm", "no_pitch")
    ridge_mm = _number(text, ridge, "ridge", "mm", 0.15, 10.0)
    return Indentor.along(Grating(ridge_mm, _number(text, pitch, "pitch", "mm", ridge_mm + 0.05, 20.0)))


def _profile(text: str, argument: str) -> Indentor:
    try:
        return Indentor.along(read_profile(argument.removesuffix(LINEAR), linear=argument.endswith(LINEAR)))
    except ProfileError as error:
        raise ShapeError(str(error), error.code) from None


def _height_map(text: str, argument: str) -> Indentor:
    found = _FILE.fullmatch(text)
    if found is None or not argument:
        raise ShapeError(f"shape {text!r}: must be heightmap:FILE.png|npy|csv followed by its scale", "no_file")
    try:
        return read_height_map(found[2], [option for option in found[3].split(",") if option])
    except HeightMapError as error:
        raise ShapeError(str(error), error.code) from None


def _sphere(text: str, argument: str) -> Indentor:
    radius = _radius_mm(text, argument, 0.25, 25.0)
    return Revolved(_as_written("sphere", argument) or f"sphere:{radius:g}", Cylinder(2 * radius))


def _flat(text: str, argument: str) -> Indentor:
    if ":" not in text:
        return Indentor.along(Plane())
    radius = _radius_mm(text, argument, 0.1, 10.0)
    return Revolved(_as_written("flat", argument) or f"flat:{radius:g}", Bar(2 * radius))


def _cone(text: str, argument: str) -> Indentor:
    angle = _number(text, argument, "half-angle", "degrees", 5.0, 89.0)
    return Revolved(f"cone:{angle:g}", Wedge(angle))


def _line(text: str, argument: str) -> Indentor:
    if argument:
        raise ShapeError(f"shape {text!r}: must be line, without a dimension; its position is z", "line_with_number")
    return Prismatic("line", Bar(LINE_THICKNESS_MM, 0.5 * LINE_THICKNESS_MM), ACROSS)


_KINDS: dict[str, Callable[[str, str], Indentor]] = {
    "bar": _bar,
    "cylinder": _cylinder,
    "step": _step,
    "grating": _grating,
    "wedge": _wedge,
    "profile": _profile,
    "sphere": _sphere,
    "flat": _flat,
    "cone": _cone,
    "line": _line,
    "heightmap": _height_map,
}


def _radius_mm(text: str, argument: str, low: float, high: float, bare: float = 1.0) -> float:
    """Return the radius of r=RADIUS, d=DIAMETER or a bare number, which times `bare` is the radius."""
    named, _, number = argument.partition("=")
    per, number = {"r": (1.0, number), "d": (0.5, number)}.get(named, (bare, argument))
    what = "radius" if per == 1.0 else "diameter"
    return per * _number(text, number, what, "mm", low / per, high / per)


def _as_written(kind: str, argument: str) -> str:
    """Return the name of a round shape by the measure in its name; empty for a bare number."""
    by, equals, number = argument.partition("=")
    return f"{kind}:{by}={float(number):g}" if equals else ""


def _number(text: str, argument: str, what: str, unit: str, low: float, high: float) -> float:
    try:
        value = read_number(argument)
    except ValueError:
        raise ShapeError(f"shape {text!r}: must have a {what} in {unit} after the colon", "no_dimension") from None
    if not low <= value <= high:
        raise ShapeError(
            f"shape {text!r}: {what} {value:g} {unit}: must be {low:g} to {high:g} {unit}", "dimension_out_of_range"
        )
    return value
