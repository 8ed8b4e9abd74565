"""Titles of panels in lines that fit their width: names of height maps are long."""

from textwrap import wrap

_CHARACTERS_PER_IN = 125.0
"""Number of characters of 1 pt on an inch, on average."""


def title_lines(text: str, width_in: float, points: float) -> str:
    """Return a title in lines, which may also end after a comma; names that are too long are cut."""
    most = max(int(width_in * _CHARACTERS_PER_IN / points), 8)
    lines = [part for line in text.split("\n") for part in wrap(line.replace(",", ", "), most)]
    return "\n".join(lines)
