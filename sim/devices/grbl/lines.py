"""How GRBL makes lines out of characters, and words out of a line, and what it refuses while it reads them.

Source: the 1.1h firmware, protocol.c, and gcode.c, step 2. Not simulated: arcs (G2, G3) and probing (G38), error 20.
"""

import re
from dataclasses import dataclass, field

from sim.errors import SimError

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
# With another decimal these are unknown commands; of all others it is the decimal that is wrong.
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
    """Takes one character at a time; overflowed tells whether the line just returned was too long."""

    def __init__(self) -> None:
        self.overflowed = False
        self.clear()

    def clear(self) -> None:
        self._text: list[str] = []
        self._comment = ""
        self._too_long = False

    def feed(self, byte: int) -> str | None:
        """Returns a line at CR or at LF (so CR LF gives an empty line more), else None."""
        char = chr(byte)
        if char in "\r\n":
            line, self.overflowed = "".join(self._text), self._too_long
            self.clear()
            return line
        self._add(char)
        return None

    def _add(self, char: str) -> None:
        if self._comment:
            if char == ")" and self._comment == "(":
                self._comment = ""
        elif char in "(;":
            self._comment = char
        elif char > " " and char != "/":
            self._too_long = self._too_long or len(self._text) >= LONGEST
            self._text.append(char.upper())


class GcodeError(SimError):
    """A line the parser refuses; number is GRBL's."""

    default_code = "refused_line"

    def __init__(self, number: int) -> None:
        super().__init__("error:{number}", number=number)
        self.number = number


@dataclass
class Line:
    """Commands by modal group, values by letter; what the axis words are for."""

    codes: dict[str, float] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)
    axis_command: str = ""

    @property
    def axes(self) -> str:
        """Those of X, Y, Z that have a word."""
        return "".join(axis for axis in "XYZ" if axis in self.values)


def read(text: str) -> Line:
    """Words of a line in capitals without spaces. Raises GcodeError."""
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
