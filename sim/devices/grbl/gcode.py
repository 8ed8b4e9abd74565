"""GRBL's g-code parser, without arcs and probing.

Source: the 1.1h firmware, gcode.c, steps 3 and 4, in its order of checks; GRBL 1.1 wiki (error codes).
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import dist, inf

from sim.devices.grbl.planner import Vec
from sim.errors import SimError

# --- lines ---
#
# Source: the 1.1h firmware, protocol.c, and gcode.c, step 2. Not simulated: arcs (G2, G3) and probing (G38), error
# 20.

LONGEST = 79
NO_LETTER, BAD_NUMBER, NEGATIVE_VALUE, UNSUPPORTED, GROUP_TWICE = 1, 2, 4, 20, 21
NOT_WHOLE, TWO_AXIS_COMMANDS, REPEATED_WORD, TOOL_NUMBER = 23, 24, 25, 38
MOTION, ONCE, PLANE, DISTANCE, FEED_MODE, UNITS = "motion", "once", "plane", "distance", "feed mode", "units"
LENGTH, SYSTEM, FLOW, SPINDLE, COOLANT = "length", "system", "flow", "spindle", "coolant"
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)")
_G_GROUPS = {
    **dict.fromkeys((0.0, 1.0, 80.0), MOTION),
    **dict.fromkeys((4.0, 10.0, 28.0, 28.1, 30.0, 30.1, 53.0, 92.0, 92.1), ONCE),
    **dict.fromkeys((17.0, 18.0, 19.0), PLANE),
    **dict.fromkeys((90.0, 91.0), DISTANCE),
    **dict.fromkeys((93.0, 94.0), FEED_MODE),
    **dict.fromkeys((20.0, 21.0), UNITS),
    **dict.fromkeys((43.1, 49.0), LENGTH),
    **dict.fromkeys((54.0, 55.0, 56.0, 57.0, 58.0, 59.0), SYSTEM),
    **{91.1: "arc distance", 40.0: "cutter", 61.0: "path"},
}
# Other decimals of these are unknown commands; for all others the decimal is the error.
_WITH_DECIMALS = {28, 30, 38, 43, 61, 90, 91, 92}
_M_GROUPS = {0: FLOW, 1: FLOW, 2: FLOW, 30: FLOW, 3: SPINDLE, 4: SPINDLE, 5: SPINDLE, 8: COOLANT, 9: COOLANT}
_VALUES, _NEVER_NEGATIVE, _MOST_TOOLS = "FIJKLNPRSTXYZ", "FNPST", 255
MOVE, PLACE, TOOL_LENGTH = "move", "place", "tool length"
_AXIS_COMMANDS: dict[float, str] = {
    **dict.fromkeys((0.0, 1.0), MOVE),
    **dict.fromkeys((10.0, 28.0, 30.0, 92.0), PLACE),
    **dict.fromkeys((43.0, 49.0), TOOL_LENGTH),
}


class LineAssembler:
    """Assembler of lines from characters; `overflowed` refers to the line just returned."""

    def __init__(self) -> None:
        self.overflowed = False
        self.clear()

    def clear(self) -> None:
        self._text: list[str] = []
        self._comment = ""
        self._too_long = False

    def feed(self, byte: int) -> str | None:
        """Return a line at CR or at LF (so CR LF gives an extra empty line), else None."""
        char = chr(byte)
        if char in "\r\n":
            line, self.overflowed = "".join(self._text).upper(), self._too_long
            self.clear()
            return line
        if self._comment:
            if char == ")" and self._comment == "(":
                self._comment = ""
        elif char in "(;":
            self._comment = char
        elif char > " " and char != "/":
            self._too_long = self._too_long or len(self._text) >= LONGEST
            self._text.append(char)
        return None


class GcodeError(SimError):
    """Error of a line that the parser rejects, with GRBL's number."""

    default_code = "refused_line"

    def __init__(self, number: int) -> None:
        super().__init__(f"error:{number}")
        self.number = number


@dataclass
class Line:
    """Commands by modal group, values by letter, and the command that uses the axis words."""

    codes: dict[str, float] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)
    axis_command: str = ""

    @property
    def axes(self) -> str:
        """Axes X, Y, Z that have a word."""
        return "".join(axis for axis in "XYZ" if axis in self.values)


def read(text: str) -> Line:
    """Parse a line in capitals without spaces into words. Raises GcodeError."""
    line, at = Line(), 0
    while at < len(text):
        letter = text[at]
        if not letter.isalpha():
            raise GcodeError(NO_LETTER)
        match = NUMBER.match(text, at + 1)
        if match is None:
            raise GcodeError(BAD_NUMBER)
        _ADD.get(letter, _add_value)(line, letter, float(match[0]))
        at = match.end()
    return line


def _add_g(line: Line, _letter: str, value: float) -> None:
    whole, value = int(value), round(value, 2)
    command = _AXIS_COMMANDS.get(value if whole in (10, 28, 30, 92) else whole)
    if command:
        if line.axis_command:
            raise GcodeError(TWO_AXIS_COMMANDS)
        line.axis_command = command
    group = _G_GROUPS.get(value)
    if group is None:
        raise GcodeError(NOT_WHOLE if whole in _G_GROUPS and whole not in _WITH_DECIMALS else UNSUPPORTED)
    _add_code(line, group, value)


def _add_m(line: Line, _letter: str, value: float) -> None:
    if round(value, 2) != int(value):
        raise GcodeError(NOT_WHOLE)
    group = _M_GROUPS.get(int(value))
    if group is None:
        raise GcodeError(UNSUPPORTED)
    _add_code(line, group, value)


def _add_code(line: Line, group: str, value: float) -> None:
    if group in line.codes:
        raise GcodeError(GROUP_TWICE)
    line.codes[group] = value


def _add_value(line: Line, letter: str, value: float) -> None:
    if letter not in _VALUES:
        raise GcodeError(UNSUPPORTED)
    if letter == "T" and value > _MOST_TOOLS:
        raise GcodeError(TOOL_NUMBER)
    if letter in line.values:
        raise GcodeError(REPEATED_WORD)
    if letter in _NEVER_NEGATIVE and value < 0:
        raise GcodeError(NEGATIVE_VALUE)
    line.values[letter] = value


_ADD = {"G": _add_g, "M": _add_m}


# --- offsets ---
#
# Source: GRBL 1.1 interface wiki; the 1.1h firmware, gcode.c. All in machine millimeters.

ZERO: Vec = (0.0, 0.0, 0.0)
SYSTEMS = 6


@dataclass(frozen=True)
class Offsets:
    """Stored offsets, and those that a reset clears: G92 and the tool's length."""

    systems: tuple[Vec, ...] = (ZERO,) * SYSTEMS
    g28: Vec = ZERO
    g30: Vec = ZERO
    g92: Vec = ZERO
    length_mm: float = 0.0

    def of(self, system: int) -> Vec:
        """Return machine coordinates of the zero of a work coordinate system, counted from 0 for G54."""
        (x, y, z), (i, j, k) = self.systems[system], self.g92
        return (x + i, y + j, z + k + self.length_mm)

    def with_system(self, system: int, zero: Vec) -> "Offsets":
        systems = (*self.systems[:system], zero, *self.systems[system + 1 :])
        return replace(self, systems=systems)

    def after_reset(self) -> "Offsets":
        return replace(self, g92=ZERO, length_mm=0.0)


MM_PER_INCH = 25.4
NO_MOTION = 80
_LARGEST_LINE_NUMBER = 10_000_000
_INTEGER_OVERFLOW = 2.0**31  # the firmware overflows to a negative number, which passes
_IN_JOG = {DISTANCE, UNITS, ONCE}
INVALID_JOG, NO_FEED, NO_AXIS_WORDS, LINE_NUMBER, NO_VALUE_WORD = 16, 22, 26, 27, 28
NO_SYSTEM, G53_MOTION, AXIS_WORDS_LEFT, UNUSED_WORDS, LENGTH_AXIS = 29, 30, 31, 36, 37


@dataclass(frozen=True)
class Modal:
    """Modal state after a line; feed in mm/min, spindle speed in rpm."""

    motion: int = 0
    absolute: bool = True
    metric: bool = True
    inverse_time: bool = False
    plane: int = 17
    system: int = 0
    feed: float = 0.0
    spindle: int = 5
    coolant: int = 9
    speed: float = 0.0

    @property
    def outputs(self) -> tuple[int, int]:
        """M words of spindle and coolant in force."""
        return (self.spindle, self.coolant)

    def after_program(self) -> "Modal":
        """Return the modal state after M2 or M30."""
        return Modal(motion=1, metric=self.metric, feed=self.feed, speed=self.speed)


@dataclass(frozen=True)
class GcodeCommand:
    """Parsed line: machine positions in mm, in sequence, at a feed in mm/min (inf: rapid), or a dwell.

    flow is the M word of a pause or an end, None if there is none. zeroed: the work zero was set, even if unchanged.
    """

    modal: Modal
    offsets: Offsets
    targets_mm: tuple[Vec, ...] = ()
    feed: float = inf
    dwell_s: float | None = None
    flow: int | None = None
    zeroed: bool = False


def parse(text: str, modal: Modal, offsets: Offsets, position_mm: Vec, *, jog: bool = False) -> GcodeCommand:
    """Parse one line without spaces; position_mm is the end of the last move. Raises GcodeError."""
    line = read(text)
    if line.axes and not line.axis_command:
        line.axis_command = MOVE
    _require(not _LARGEST_LINE_NUMBER < line.values.get("N", 0.0) < _INTEGER_OVERFLOW, LINE_NUMBER)
    after = _modes(line, modal, jog)
    once = line.codes.get(ONCE, 0.0)
    if once == 4.0:
        _require("P" in line.values, NO_VALUE_WORD)
    moved = _offsets(line, after, offsets, position_mm, once)
    targets = _targets(line, after, moved, position_mm, once)
    _check_motion(line, after)
    _check_unused(line, once, jog)
    if jog:
        _require(set(line.codes) <= _IN_JOG and once in (0.0, 53.0), INVALID_JOG)
        # Without axis words the firmware jogs to machine zero.
        return GcodeCommand(modal, offsets, targets or (ZERO,), after.feed)
    dwell_s = line.values["P"] if once == 4.0 else None
    flow = int(line.codes[FLOW]) if FLOW in line.codes else None
    zeroed = once in (92.0, 92.1) or (moved.of(after.system) != offsets.of(modal.system))
    return GcodeCommand(after, moved, targets, _feed(line, after, once, position_mm, targets), dwell_s, flow, zeroed)


def _require(fulfilled: bool, code: int) -> None:
    if not fulfilled:
        raise GcodeError(code)


def _modes(line: Line, modal: Modal, jog: bool) -> Modal:
    codes = line.codes
    after = Modal(
        motion=1 if jog else int(codes.get(MOTION, modal.motion)),
        absolute=codes.get(DISTANCE, 90 if modal.absolute else 91) == 90,
        metric=codes.get(UNITS, 21 if modal.metric else 20) == 21,
        inverse_time=not jog and codes.get(FEED_MODE, 93 if modal.inverse_time else 94) == 93,
        plane=int(codes.get(PLANE, modal.plane)),
        system=int(codes.get(SYSTEM, modal.system + 54)) - 54,
        feed=modal.feed,
        spindle=int(codes.get(SPINDLE, modal.spindle)),
        coolant=int(codes.get(COOLANT, modal.coolant)),
        speed=line.values.get("S", modal.speed),
    )
    feed = _feed_word(line, modal, after, jog)
    return after if feed == modal.feed else replace(after, feed=feed)


def _feed_word(line: Line, before: Modal, after: Modal, jog: bool) -> float:
    needed = jog or (after.inverse_time and line.axis_command == MOVE and after.motion == 1)
    _require("F" in line.values or not needed, NO_FEED)
    if after.inverse_time:
        return line.values.get("F", 0.0)
    previous = 0.0 if before.inverse_time else before.feed
    return line.values["F"] * _unit(after) if "F" in line.values else previous


def _unit(modal: Modal) -> float:
    return 1.0 if modal.metric else MM_PER_INCH


def _offsets(line: Line, modal: Modal, offsets: Offsets, position_mm: Vec, once: float) -> Offsets:
    length = line.codes.get(LENGTH)
    if length == 43.1:
        _require(line.axes == "Z", LENGTH_AXIS)
        return replace(offsets, length_mm=line.values["Z"] * _unit(modal))
    if length == 49.0:
        return replace(offsets, length_mm=0.0)
    if once == 10.0:
        return _set_system(line, modal, offsets, position_mm)
    if once == 92.0:
        _require(bool(line.axes), NO_AXIS_WORDS)
        here = replace(offsets, g92=ZERO).of(modal.system)
        return replace(offsets, g92=_axes(line, modal, offsets.g92, lambda i, mm: position_mm[i] - here[i] - mm))
    if once == 92.1:
        return replace(offsets, g92=ZERO)
    if once == 28.1:
        return replace(offsets, g28=position_mm)
    return replace(offsets, g30=position_mm) if once == 30.1 else offsets


def _set_system(line: Line, modal: Modal, offsets: Offsets, position_mm: Vec) -> Offsets:
    values = line.values
    _require(bool(line.axes), NO_AXIS_WORDS)
    _require("P" in values or "L" in values, NO_VALUE_WORD)
    chosen = int(values.get("P", 0.0))
    _require(chosen <= SYSTEMS, NO_SYSTEM)
    _require(values.get("L") in (2.0, 20.0) and not (values["L"] == 2.0 and "R" in values), UNSUPPORTED)
    system = chosen - 1 if chosen else modal.system
    others = replace(offsets, systems=(ZERO,) * SYSTEMS).of(0)
    here = values["L"] == 20.0
    zero = _axes(line, modal, offsets.systems[system], lambda i, mm: position_mm[i] - others[i] - mm if here else mm)
    return offsets.with_system(system, zero)


def _axes(line: Line, modal: Modal, without: Vec, of: Callable[[int, float], float]) -> Vec:
    """Return of(number, word in mm) for each axis with a word, the default for the others."""
    x, y, z = (
        of(i, line.values[axis] * _unit(modal)) if axis in line.values else without[i] for i, axis in enumerate("XYZ")
    )
    return (x, y, z)


def _targets(line: Line, modal: Modal, offsets: Offsets, position_mm: Vec, once: float) -> tuple[Vec, ...]:
    if once == 53.0:
        _require(modal.motion in (0, 1), G53_MOTION)
    if line.axis_command == TOOL_LENGTH or once in (10.0, 92.0):
        return ()
    base = ZERO if once == 53.0 else offsets.of(modal.system) if modal.absolute else position_mm
    target = _axes(line, modal, position_mm, lambda i, mm: base[i] + mm)
    if once in (28.0, 30.0):
        home = offsets.g28 if once == 28.0 else offsets.g30
        if not line.axes:
            line.axis_command = ""
            return (home,)
        return (target, _axes(line, modal, position_mm, lambda i, _: home[i]))
    return (target,) if line.axes and line.axis_command == MOVE else ()


def _check_motion(line: Line, modal: Modal) -> None:
    if modal.motion == NO_MOTION:
        _require(not line.axes, AXIS_WORDS_LEFT)
    elif line.axis_command == MOVE:
        _require(modal.motion == 0 or modal.feed > 0, NO_FEED)
        if not line.axes:
            line.axis_command = ""


def _check_unused(line: Line, once: float, jog: bool) -> None:
    used = set("NF" if jog else "NFST")
    if line.axis_command:
        used |= set("XYZ")
    if once in (4.0, 10.0):
        used |= {"P"}
    if once == 10.0:
        used |= {"L"}
    _require(set(line.values) <= used, UNUSED_WORDS)


def _feed(line: Line, modal: Modal, once: float, position_mm: Vec, targets: tuple[Vec, ...]) -> float:
    if not targets or modal.motion == 0 or once in (28.0, 30.0):
        return inf
    return modal.feed * dist(position_mm, targets[0]) if modal.inverse_time else modal.feed
