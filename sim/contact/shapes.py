"""Indentors by the names they have on the command line."""

from collections.abc import Callable

from sim.contact.indentors import STEP_HALF_WAVELENGTH_MM, Bar, Cylinder, Grating, Profile, Step, Wedge
from sim.contact.measured_profile import ProfileError, read_profile

EXPECTED = "bar:WIDTH, cylinder:DIAMETER, step:1|3|5, grating:RIDGE,PITCH, wedge:ANGLE or profile:FILE.csv"
NOT_BUILT = ("sphere", "flat", "cone", "line", "point")


class ShapeError(ValueError):
    """The name of an indentor is not understood, or its dimension is out of range."""


def parse_shape(text: str) -> Profile:
    """Indentor named as on the command line, e.g. "bar:3.0"; raises ShapeError with what was expected."""
    kind, _, argument = text.partition(":")
    if kind in NOT_BUILT:
        raise ShapeError(f"shape {text!r}: {kind} is not built yet, expected {EXPECTED}")
    if kind not in _KINDS:
        raise ShapeError(f"shape {text!r}: no such indentor, expected {EXPECTED}")
    return _KINDS[kind](text, argument)


def _step(text: str, argument: str) -> Profile:
    if argument not in STEP_HALF_WAVELENGTH_MM:
        raise ShapeError(f"shape {text!r}: expected step:1, step:3 or step:5")
    return Step(argument)


def _bar(text: str, argument: str) -> Profile:
    return Bar(_number(text, argument, "width", "mm", 0.2, 20.0))


def _cylinder(text: str, argument: str) -> Profile:
    return Cylinder(_number(text, argument, "diameter", "mm", 0.5, 50.0))


def _wedge(text: str, argument: str) -> Profile:
    return Wedge(_number(text, argument, "half-angle", "degrees", 5.0, 89.0))


def _grating(text: str, argument: str) -> Profile:
    ridge, comma, pitch = argument.partition(",")
    if not comma:
        raise ShapeError(f"shape {text!r}: expected grating:RIDGE,PITCH in mm")
    ridge_mm = _number(text, ridge, "ridge", "mm", 0.15, 10.0)
    return Grating(ridge_mm, _number(text, pitch, "pitch", "mm", ridge_mm + 0.05, 20.0))


def _profile(text: str, argument: str) -> Profile:
    try:
        return read_profile(argument)
    except ProfileError as error:
        raise ShapeError(str(error)) from None


_KINDS: dict[str, Callable[[str, str], Profile]] = {
    "bar": _bar,
    "cylinder": _cylinder,
    "step": _step,
    "grating": _grating,
    "wedge": _wedge,
    "profile": _profile,
}


def _number(text: str, argument: str, what: str, unit: str, low: float, high: float) -> float:
    try:
        value = float(argument)
    except ValueError:
        raise ShapeError(f"shape {text!r}: expected a {what} in {unit} after the colon") from None
    if not low <= value <= high:
        raise ShapeError(f"shape {text!r}: {what} {value:g} {unit} is outside {low:g} … {high:g} {unit}")
    return value
