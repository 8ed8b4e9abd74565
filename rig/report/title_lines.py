"""Titles of panels in lines that fit their width: names of height maps are long."""

import re
from textwrap import wrap

from rig.report.style import wrapped

_CHARACTERS_PER_IN = 110.0
"""Number of characters of 1 pt on an inch, on average."""
_BEFORE_UNIT = re.compile(r"(?<=\d) (?=(?:mm|gwt)\b)")


def title_lines(text: str, width_in: float, points: float) -> str:
    """Return a title in lines, which may also end after a comma; names that are too long are cut."""
    text = _BEFORE_UNIT.sub("\N{NO-BREAK SPACE}", text)
    most = max(int(width_in * _CHARACTERS_PER_IN / points), 8)
    lines = [line for part in text.split("\n") for line in wrapped(part, most).split("\n")]
    return "\n".join(piece for line in lines for piece in wrap(line, most)).replace("\N{NO-BREAK SPACE}", " ")
