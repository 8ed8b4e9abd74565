"""The part of GRBL's g-code that a rig needs: G0 G1 G4 G20 G21 G53 G90 G91, F, and the same inside `$J=`.

Also the outputs: M3 M4 M5 with S, M8 M9. Source: GRBL 1.1 wiki (supported g-codes, error codes). Everything else is
error:20, arcs, offsets (G10, G92), probing and other M words included.
"""

import re
from dataclasses import dataclass, field, replace
from math import inf

from sim.devices.grbl.motion import Vec

MM_PER_INCH = 25.4
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)")
_WORDS = "FGMNPSXYZ"
_MOTION, _DISTANCE, _UNITS, _ONCE = "motion", "distance", "units", "once"
_GROUPS = {0.0: _MOTION, 1.0: _MOTION, 4.0: _ONCE, 53.0: _ONCE, 20.0: _UNITS, 21.0: _UNITS,
           90.0: _DISTANCE, 91.0: _DISTANCE, 17.0: "plane", 54.0: "system", 94.0: "feed mode"}  # fmt: skip
_SPINDLE, _COOLANT = "spindle", "coolant"
_M_GROUPS = {3.0: _SPINDLE, 4.0: _SPINDLE, 5.0: _SPINDLE, 8.0: _COOLANT, 9.0: _COOLANT}
_IN_JOG = {20.0, 21.0, 53.0, 90.0, 91.0}

NO_LETTER, BAD_NUMBER, INVALID_STATEMENT, NEGATIVE_VALUE = 1, 2, 3, 4
INVALID_JOG, UNSUPPORTED, GROUP_TWICE, NO_FEED = 16, 20, 21, 22
REPEATED_WORD, NO_AXIS_WORDS, NO_VALUE_WORD, UNUSED_WORDS = 25, 26, 28, 36


class GcodeError(Exception):
    """A line the parser refuses; code is GRBL's error number."""

    def __init__(self, code: int) -> None:
        super().__init__(f"error:{code}")
        self.code = code


@dataclass(frozen=True)
class Modal:
    """What one line leaves behind for the next; feed in mm/min, speed of the spindle in rpm."""

    rapid: bool = True
    absolute: bool = True
    metric: bool = True
    feed: float = 0.0
    spindle: int = 5
    coolant: int = 9
    speed: float = 0.0

    @property
    def outputs(self) -> tuple[int, int]:
        """The M words in force, spindle and coolant."""
        return (self.spindle, self.coolant)


@dataclass(frozen=True)
class Command:
    """What a line asks for: a machine position in mm at a feed in mm/min (inf: rapid), or a dwell in s."""

    modal: Modal
    target_mm: Vec | None = None
    feed: float = inf
    dwell_s: float | None = None


@dataclass
class _Line:
    codes: dict[str, float] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)


def parse(text: str, modal: Modal, position_mm: Vec, offset_mm: Vec, *, jog: bool = False) -> Command:
    """Read one line without spaces; position is the end of the last move, offset that of G54, both in mm.

    Raises GcodeError.
    """
    line = _read(text, jog)
    after = _modes(line, modal)
    if jog:
        target = _target(line, after, position_mm, offset_mm)
        if target is None:
            raise GcodeError(NO_AXIS_WORDS)
        return Command(modal, target, _feed(line.values.get("F", 0.0) * _unit(after)))
    if line.codes.get(_ONCE) == 4.0:
        return Command(after, dwell_s=_dwell(line))
    if "P" in line.values:
        raise GcodeError(UNUSED_WORDS)
    target = _target(line, after, position_mm, offset_mm)
    return Command(after, target, inf if after.rapid or target is None else _feed(after.feed))


def _read(text: str, jog: bool) -> _Line:
    line, at = _Line(), 0
    while at < len(text):
        letter = text[at]
        match = _NUMBER.match(text, at + 1)
        if not letter.isalpha():
            raise GcodeError(NO_LETTER)
        if match is None:
            raise GcodeError(BAD_NUMBER)
        _add_word(line, letter, float(match[0]), jog)
        at = match.end()
    return line


def _add_word(line: _Line, letter: str, value: float, jog: bool) -> None:
    if letter not in _WORDS:
        raise GcodeError(UNSUPPORTED)
    if letter in "FNPS" and value < 0:
        raise GcodeError(NEGATIVE_VALUE)
    if letter not in "GM":
        if letter in line.values:
            raise GcodeError(REPEATED_WORD)
        line.values[letter] = value
        return
    group = (_GROUPS if letter == "G" else _M_GROUPS).get(value)
    if group is None:
        raise GcodeError(UNSUPPORTED)
    if jog and (letter == "M" or value not in _IN_JOG):
        raise GcodeError(INVALID_JOG)
    if group in line.codes:
        raise GcodeError(GROUP_TWICE)
    line.codes[group] = value


def _modes(line: _Line, modal: Modal) -> Modal:
    codes = line.codes
    modal = replace(
        modal,
        rapid=codes[_MOTION] == 0 if _MOTION in codes else modal.rapid,
        absolute=codes[_DISTANCE] == 90 if _DISTANCE in codes else modal.absolute,
        metric=codes[_UNITS] == 21 if _UNITS in codes else modal.metric,
        spindle=int(codes.get(_SPINDLE, modal.spindle)),
        coolant=int(codes.get(_COOLANT, modal.coolant)),
        speed=line.values.get("S", modal.speed),
    )
    return replace(modal, feed=line.values["F"] * _unit(modal)) if "F" in line.values else modal


def _unit(modal: Modal) -> float:
    return 1.0 if modal.metric else MM_PER_INCH


def _target(line: _Line, modal: Modal, position_mm: Vec, offset_mm: Vec) -> Vec | None:
    if not any(axis in line.values for axis in "XYZ"):
        return None
    base: Vec = offset_mm if modal.absolute else position_mm
    if line.codes.get(_ONCE) == 53.0:
        base = (0.0, 0.0, 0.0)
    x, y, z = (
        origin + line.values[axis] * _unit(modal) if axis in line.values else now
        for axis, now, origin in zip("XYZ", position_mm, base, strict=True)
    )
    return (x, y, z)


def _feed(mm_per_min: float) -> float:
    if mm_per_min <= 0:
        raise GcodeError(NO_FEED)
    return mm_per_min


def _dwell(line: _Line) -> float:
    if "P" not in line.values:
        raise GcodeError(NO_VALUE_WORD)
    if any(axis in line.values for axis in "XYZ"):
        raise GcodeError(UNUSED_WORDS)
    return line.values["P"]
